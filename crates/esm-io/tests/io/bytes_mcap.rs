//! MCAP files written by hand, record by record after the specification.

use std::collections::BTreeMap;

pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";
pub(crate) const CLOUD: &str = "sensor_msgs/msg/PointCloud2";
pub(crate) const ODOMETRY: &str = "nav_msgs/msg/Odometry";
pub(crate) const POSE: &str = "geometry_msgs/msg/PoseStamped";
pub(crate) const TF: &str = "tf2_msgs/msg/TFMessage";

/// An MCAP file that grows. Records go to the file, or to the chunk that is open.
pub(crate) struct Mcap {
    pub(crate) bytes: Vec<u8>,
    chunk: Option<Vec<u8>>,
    /// By channel: log time and offset in the chunk.
    index: BTreeMap<u16, Vec<(u64, u64)>>,
    definitions: Vec<u8>,
    counts: BTreeMap<u16, u64>,
    /// Where each chunk's record starts.
    pub(crate) chunks: Vec<usize>,
}

impl Mcap {
    pub(crate) fn new() -> Self {
        let mut mcap = Self {
            bytes: MAGIC.to_vec(),
            chunk: None,
            index: BTreeMap::new(),
            definitions: Vec::new(),
            counts: BTreeMap::new(),
            chunks: Vec::new(),
        };
        let mut header = string("ros2");
        header.extend(string("by hand"));
        mcap.record(0x01, &header);
        mcap
    }

    fn record(&mut self, opcode: u8, body: &[u8]) {
        let out = self.chunk.as_mut().unwrap_or(&mut self.bytes);
        out.extend(record(opcode, body));
    }

    /// A channel with a schema of the same number.
    pub(crate) fn channel(&mut self, id: u16, topic: &str, schema: &str) -> &mut Self {
        self.channel_encoded(id, topic, schema, "cdr")
    }

    pub(crate) fn channel_encoded(
        &mut self,
        id: u16,
        topic: &str,
        schema: &str,
        encoding: &str,
    ) -> &mut Self {
        let mut body = id.to_le_bytes().to_vec();
        body.extend(string(schema));
        body.extend(string("ros2msg"));
        body.extend(0u32.to_le_bytes());
        self.record(0x03, &body);
        self.definitions.extend(record(0x03, &body));
        let mut body = id.to_le_bytes().to_vec();
        body.extend(id.to_le_bytes());
        body.extend(string(topic));
        body.extend(string(encoding));
        body.extend(0u32.to_le_bytes());
        self.record(0x04, &body);
        self.definitions.extend(record(0x04, &body));
        self
    }

    pub(crate) fn message(&mut self, channel: u16, log_time: u64, data: &[u8]) -> &mut Self {
        let mut body = channel.to_le_bytes().to_vec();
        body.extend(0u32.to_le_bytes());
        body.extend(log_time.to_le_bytes());
        body.extend(log_time.to_le_bytes());
        body.extend(data);
        if let Some(chunk) = &self.chunk {
            self.index.entry(channel).or_default().push((log_time, chunk.len() as u64));
        }
        *self.counts.entry(channel).or_default() += 1;
        self.record(0x05, &body);
        self
    }

    pub(crate) fn begin_chunk(&mut self) -> &mut Self {
        self.chunk = Some(Vec::new());
        self
    }

    /// Closes the chunk, uncompressed, with its CRC and indexes.
    pub(crate) fn end_chunk(&mut self) -> &mut Self {
        self.end_chunk_as("", true)
    }

    pub(crate) fn end_chunk_as(&mut self, compression: &str, with_crc: bool) -> &mut Self {
        let data = self.chunk.take().unwrap();
        let mut body = vec![0; 16];
        body.extend((data.len() as u64).to_le_bytes());
        body.extend((if with_crc { crc32(&data) } else { 0 }).to_le_bytes());
        body.extend(string(compression));
        body.extend((data.len() as u64).to_le_bytes());
        body.extend(&data);
        self.chunks.push(self.bytes.len());
        self.record(0x06, &body);
        for (channel, entries) in std::mem::take(&mut self.index) {
            let mut body = channel.to_le_bytes().to_vec();
            body.extend((16 * entries.len() as u32).to_le_bytes());
            for (time, offset) in entries {
                body.extend(time.to_le_bytes());
                body.extend(offset.to_le_bytes());
            }
            self.record(0x07, &body);
        }
        self
    }

    /// The file without any closing records, as a recorder leaves it that is killed.
    pub(crate) fn unfinished(&self) -> Vec<u8> {
        self.bytes.clone()
    }

    /// The file with its end but no summary.
    pub(crate) fn without_summary(&self) -> Vec<u8> {
        let mut bytes = self.bytes.clone();
        bytes.extend(record(0x0F, &0u32.to_le_bytes()));
        bytes.extend(record(0x02, &[0; 20]));
        bytes.extend(MAGIC);
        bytes
    }

    /// The complete file: CRC of the data section, definitions and statistics, CRC of the summary.
    pub(crate) fn finished(&self) -> Vec<u8> {
        let mut bytes = self.bytes.clone();
        let crc = crc32(&bytes);
        bytes.extend(record(0x0F, &crc.to_le_bytes()));
        let start = bytes.len();
        bytes.extend(&self.definitions);
        let mut body = self.counts.values().sum::<u64>().to_le_bytes().to_vec();
        body.extend((self.counts.len() as u16).to_le_bytes());
        body.extend((self.counts.len() as u32).to_le_bytes());
        body.extend([0; 8]);
        body.extend((self.chunks.len() as u32).to_le_bytes());
        body.extend([0; 16]);
        body.extend((10 * self.counts.len() as u32).to_le_bytes());
        for (channel, n) in &self.counts {
            body.extend(channel.to_le_bytes());
            body.extend(n.to_le_bytes());
        }
        bytes.extend(record(0x0B, &body));
        let mut footer = (start as u64).to_le_bytes().to_vec();
        footer.extend(0u64.to_le_bytes());
        let mut covered = bytes[start..].to_vec();
        covered.push(0x02);
        covered.extend(20u64.to_le_bytes());
        covered.extend(&footer);
        footer.extend(crc32(&covered).to_le_bytes());
        bytes.extend(record(0x02, &footer));
        bytes.extend(MAGIC);
        bytes
    }
}

pub(crate) fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
    let mut out = vec![opcode];
    out.extend((body.len() as u64).to_le_bytes());
    out.extend(body);
    out
}

fn string(s: &str) -> Vec<u8> {
    let mut out = (s.len() as u32).to_le_bytes().to_vec();
    out.extend(s.as_bytes());
    out
}

/// CRC-32 as in zip, bit by bit.
pub(crate) fn crc32(data: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| {
        (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xEDB8_8320 } else { c >> 1 })
    };
    !data.iter().fold(!0, step)
}
