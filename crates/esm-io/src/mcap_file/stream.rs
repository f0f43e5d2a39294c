//! The messages of an MCAP file front to back, across whatever damage it has.
//!
//! The records' framing is walked here and every chunk is given to `mcap`'s sans-io linear reader: on a whole file that
//! reader stops at the first bad chunk, hands out a chunk's messages before it has checked the chunk's CRC, and takes
//! attachments of any size into memory. Here a chunk's CRC is checked in a first pass over it; a chunk that fails is
//! left out; reading goes on behind it. From the last chunk of a torn file every message that is there in full is used.
//! Memory: one record, and the compressor's window.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use mcap::MAGIC;
use mcap::records::op;
use mcap::sans_io::linear_reader::LinearReadEvent;

use super::chunk::OpenChunk;
use super::damage::{Damage, DamageLog};
use super::definitions::{ChannelInfo, Undefined, define, long_name};
use super::records::{ChunkHead, HEAD, RECORD_LIMIT, RecordFile, known_compression, le_u16, le_u32, le_u64};
use crate::error::Error;

/// Bytes of a message record before the message.
const MESSAGE_HEAD: u64 = 22;

/// Bytes of a message index before its entries, and of one entry.
const INDEX_HEAD: u64 = 6;
const INDEX_ENTRY: u64 = 16;

/// Bytes read at once for the data section's CRC.
const CRC_WINDOW: usize = 1 << 18;

/// Which messages are handed out; the others are counted only.
pub(crate) enum Wanted {
    /// None: reading counts and checks.
    Nothing,
    /// Those of these channels.
    Channels(BTreeSet<u16>),
    /// All of them.
    Everything,
}

/// One message; its bytes are in [`MessageStream::data`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Message {
    pub(crate) channel: u16,
    /// Nanoseconds.
    pub(crate) log_time: u64,
}

pub(crate) struct MessageStream {
    file: RecordFile,
    /// Where the next record starts.
    at: u64,
    chunk: Option<OpenChunk>,
    wanted: Wanted,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, ChannelInfo>,
    /// Messages read, by channel.
    read: BTreeMap<u16, u64>,
    log: DamageLog,
    data: Vec<u8>,
    chunks_read: u64,
    /// Where records start that nothing but their length vouches for, and that have led here.
    doubt: Option<u64>,
    /// CRC of the data section is worth checking: messages stand outside of chunks.
    loose_messages: bool,
    ended: bool,
    /// The first definition that was left out, and why.
    left_out: Option<(String, String)>,
}

/// One step inside a chunk.
enum Step {
    Message(Message),
    Other,
    Done,
    Broken(String),
}

impl MessageStream {
    /// Opens a file and checks that it is MCAP at all.
    pub(crate) fn open(path: &Path, wanted: Wanted) -> Result<Self, Error> {
        let mut file = RecordFile::open(path)?;
        let mut start = [0; 16];
        let n = file.read_some(&mut start)?;
        if !start[..n].starts_with(MAGIC) {
            return Err(not_mcap(path, &start[..n]));
        }
        Ok(Self {
            file,
            at: MAGIC.len() as u64,
            chunk: None,
            wanted,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            read: BTreeMap::new(),
            log: DamageLog::default(),
            data: Vec::new(),
            chunks_read: 0,
            doubt: None,
            loose_messages: false,
            ended: false,
            left_out: None,
        })
    }

    /// Definitions that are known beforehand: in a damaged file they may stand in a part that is lost.
    pub(crate) fn know_channels(&mut self, channels: BTreeMap<u16, ChannelInfo>) {
        self.channels = channels;
    }

    /// The channels met so far.
    pub(crate) fn channels(&self) -> &BTreeMap<u16, ChannelInfo> {
        &self.channels
    }

    /// Messages read so far, by channel.
    pub(crate) fn counts(&self) -> &BTreeMap<u16, u64> {
        &self.read
    }

    /// The bytes of the message handed out last.
    pub(crate) fn data(&self) -> &[u8] {
        &self.data
    }

    /// Counts a message that was handed out among the lost, as one that contradicts itself.
    pub(crate) fn refuse(&mut self, channel: u16, place: String) {
        if let Some(n) = self.read.get_mut(&channel) {
            *n = n.saturating_sub(1);
        }
        self.log.refuse(channel);
        self.log.place(place);
    }

    /// The first thing found wrong with the file so far.
    pub(crate) fn first_damage(&self) -> Option<&str> {
        self.log.first_place()
    }

    /// The first definition that was left out though it is intact: its place, and why.
    pub(crate) fn left_out(&self) -> Option<&(String, String)> {
        self.left_out.as_ref()
    }

    /// What is damaged, once the end was reached; `expected` are the statistics' counts by channel.
    pub(crate) fn damage(
        &self,
        expected: Option<&BTreeMap<u16, u64>>,
        is_cloud: &dyn Fn(u16) -> bool,
    ) -> Option<Damage> {
        self.log.report(expected, &self.read, is_cloud)
    }

    /// The next wanted message, `None` at the end.
    pub(crate) fn next_message(&mut self) -> Result<Option<Message>, Error> {
        while !self.ended {
            let message = match self.chunk.take() {
                Some(chunk) => self.step_chunk(chunk)?,
                None => self.step_record()?,
            };
            if message.is_some() {
                return Ok(message);
            }
        }
        Ok(None)
    }

    /// One step inside a chunk, which is put back unless it is finished.
    fn step_chunk(&mut self, mut chunk: OpenChunk) -> Result<Option<Message>, Error> {
        match self.read_chunk(&mut chunk)? {
            Step::Message(message) => {
                self.chunk = Some(chunk);
                return Ok(Some(message));
            }
            Step::Other => self.chunk = Some(chunk),
            Step::Done => {
                self.chunks_read += 1;
                self.at = chunk.end;
            }
            Step::Broken(_) if chunk.torn => {
                self.log.place(format!("the file ends inside the chunk at byte {}", chunk.start));
                self.log.lose_uncounted(u64::from(chunk.left > 0));
                self.ended = true;
            }
            Step::Broken(why) => {
                self.log.place(format!("the chunk at byte {} is broken: {why}", chunk.start));
                self.log.lose_chunk(chunk.read);
                self.at = chunk.end;
            }
        }
        Ok(None)
    }

    fn read_chunk(&mut self, chunk: &mut OpenChunk) -> Result<Step, Error> {
        let event = match chunk.reader.next_event() {
            None => return Ok(Step::Done),
            Some(Err(e)) => return Ok(Step::Broken(e.to_string())),
            Some(Ok(event)) => event,
        };
        let (opcode, data) = match event {
            LinearReadEvent::ReadRequest(n) => {
                chunk.feed(&mut self.file, n)?;
                return Ok(Step::Other);
            }
            LinearReadEvent::Record { opcode, data } => (opcode, data),
        };
        chunk.left = chunk.left.saturating_sub(HEAD + data.len() as u64);
        if opcode != op::MESSAGE {
            return Ok(match define(&mut self.schemas, &mut self.channels, opcode, data) {
                Ok(()) => Step::Other,
                Err(Undefined::Broken(why)) => Step::Broken(why),
                Err(Undefined::LongName(bytes)) => {
                    self.leave_out(format!("in the chunk at byte {}", chunk.start), bytes);
                    Step::Other
                }
            });
        }
        let Some(message) = message_head(data) else {
            return Ok(Step::Broken(format!("a message record of {} bytes is too short", data.len())));
        };
        *chunk.read.entry(message.channel).or_default() += 1;
        if !count(&self.channels, &self.wanted, &mut self.read, message) {
            return Ok(Step::Other);
        }
        self.data.clear();
        self.data.extend_from_slice(&data[MESSAGE_HEAD as usize..]);
        Ok(Step::Message(message))
    }

    /// One record outside of chunks.
    fn step_record(&mut self) -> Result<Option<Message>, Error> {
        let at = self.at;
        let Some((opcode, len)) = self.file.head(at)? else {
            self.end_torn();
            return Ok(None);
        };
        if opcode != op::MESSAGE_INDEX {
            self.log.close_chunk();
        }
        let end = at.saturating_add(HEAD).saturating_add(len);
        let inside = end <= self.file.len;
        let doubt = self.doubt.take();
        match opcode {
            op::CHUNK => {
                let Some(head) = self.file.chunk_head(at)? else {
                    return self.resume_behind(doubt.unwrap_or(at));
                };
                self.open_chunk(at, &head)?;
            }
            op::DATA_END | op::FOOTER if len == if opcode == op::FOOTER { 20 } else { 4 } => {
                self.check_data_crc(at, opcode)?;
                self.check_closing()?;
                self.ended = true;
            }
            op::MESSAGE if (MESSAGE_HEAD..=RECORD_LIMIT).contains(&len) && inside => {
                self.loose_messages = true;
                self.at = end;
                let mut head = [0; MESSAGE_HEAD as usize];
                self.file.read_all(&mut head)?;
                let Some(message) = message_head(&head) else { return Ok(None) };
                if count(&self.channels, &self.wanted, &mut self.read, message) {
                    self.data.clear();
                    self.data.resize((len - MESSAGE_HEAD) as usize, 0);
                    self.file.read_all(&mut self.data)?;
                    return Ok(Some(message));
                }
            }
            op::SCHEMA | op::CHANNEL if len <= RECORD_LIMIT && inside => {
                let mut body = Vec::new();
                self.file.body(at, len, &mut body)?;
                match define(&mut self.schemas, &mut self.channels, opcode, &body) {
                    Ok(()) => {}
                    Err(Undefined::Broken(_)) => return self.resume_behind(doubt.unwrap_or(at)),
                    Err(Undefined::LongName(bytes)) => self.leave_out(format!("at byte {at}"), bytes),
                }
                self.at = end;
            }
            op::MESSAGE_INDEX if len >= INDEX_HEAD && inside => {
                let mut head = [0; INDEX_HEAD as usize];
                self.file.seek(at + HEAD)?;
                self.file.read_all(&mut head)?;
                let bytes = u64::from(le_u32(&head[2..]));
                if INDEX_HEAD + bytes != len || bytes % INDEX_ENTRY != 0 {
                    return self.resume_behind(doubt.unwrap_or(at));
                }
                self.log.index(le_u16(&head), bytes / INDEX_ENTRY);
                self.at = end;
            }
            // The records a reader of messages does not need, and those of later versions: a damaged length among them
            // shows at the record it leads to.
            1.. if !matches!(opcode, op::MESSAGE | op::SCHEMA | op::CHANNEL | op::MESSAGE_INDEX)
                && inside =>
            {
                self.doubt = doubt.or(Some(at));
                self.at = end;
            }
            _ => return self.resume_behind(doubt.unwrap_or(at)),
        }
        Ok(None)
    }

    /// A topic is left out for its name, or that of its message type. Told once: chunks repeat definitions.
    fn leave_out(&mut self, place: String, bytes: usize) {
        if self.left_out.is_none() {
            let what = long_name(bytes);
            self.log.place(format!("the definition {place} cannot be used: {what}"));
            self.log.lose_uncounted(0);
            self.left_out = Some((format!("the definition {place}"), what));
        }
    }

    /// The framing is lost since a place: looks for the next chunk.
    fn resume_behind(&mut self, at: u64) -> Result<Option<Message>, Error> {
        match self.file.find_chunk(at + 1)? {
            Some(next) => {
                self.log.place(format!("bytes {at} to {next} are no valid records"));
                self.log.lose_uncounted(0);
                self.at = next;
            }
            None => {
                // A last record that is cut is the usual end of a torn file.
                self.log.place(format!("the file ends inside the record at byte {at}"));
                self.log.lose_uncounted(0);
                self.ended = true;
            }
        }
        Ok(None)
    }

    fn end_torn(&mut self) {
        self.log.close_chunk();
        self.log.place(format!("the file ends at byte {} without its closing records", self.file.len));
        self.log.lose_uncounted(0);
        self.ended = true;
    }

    fn open_chunk(&mut self, at: u64, head: &ChunkHead) -> Result<(), Error> {
        let end = at.saturating_add(HEAD).saturating_add(head.len);
        let torn = end > self.file.len;
        if !known_compression(&head.compression) {
            let what = format!("chunks are compressed with '{}', which is not known", head.compression);
            if self.chunks_read == 0 {
                let hint = "known are zstd, lz4 and none; convert with 'mcap compress --compression zstd'";
                return Err(Error::malformed(&self.file.path, format!("chunk at byte {at}"), what, hint));
            }
            self.log.place(format!("the chunk at byte {at} is broken: {what}"));
            self.log.lose_chunk(BTreeMap::new());
            self.at = end.min(self.file.len);
            return Ok(());
        }
        // Without a CRC, and at a torn end, nothing can be checked beforehand: messages count as far as they come.
        if head.uncompressed_crc != 0 && !torn {
            let mut check = OpenChunk::new(at, end, head, torn, true);
            if let Some(why) = check.check(&mut self.file)? {
                self.log.place(format!("the chunk at byte {at} is broken: {why}"));
                self.log.lose_chunk(BTreeMap::new());
                self.at = end;
                return Ok(());
            }
        }
        self.chunk = Some(OpenChunk::new(at, end.min(self.file.len), head, torn, false));
        Ok(())
    }

    /// All messages were read; says so where the file's end is missing all the same.
    fn check_closing(&mut self) -> Result<(), Error> {
        let mut magic = [0; 8];
        self.file.seek(self.file.len.saturating_sub(magic.len() as u64))?;
        if !self.file.read_all(&mut magic)? || magic != *MAGIC {
            self.log.place(format!("the file ends at byte {} inside its summary", self.file.len));
        }
        Ok(())
    }

    /// Messages outside of chunks have no CRC but the one of the whole data section.
    fn check_data_crc(&mut self, at: u64, opcode: u8) -> Result<(), Error> {
        let mut saved = [0; 4];
        if !self.loose_messages || opcode != op::DATA_END || !self.file.read_all(&mut saved)? {
            return Ok(());
        }
        let saved = le_u32(&saved);
        if saved == 0 {
            return Ok(());
        }
        let mut hasher = crc32fast::Hasher::new();
        let mut buf = vec![0; CRC_WINDOW];
        let mut left = at;
        self.file.seek(0)?;
        while left > 0 {
            let n = buf.len().min(usize::try_from(left).unwrap_or(usize::MAX));
            if !self.file.read_all(&mut buf[..n])? {
                break;
            }
            hasher.update(&buf[..n]);
            left -= n as u64;
        }
        if hasher.finalize() != saved {
            self.log
                .place("the data section's checksum is wrong: a message may have been altered".to_owned());
            self.log.lose_uncounted(0);
        }
        Ok(())
    }
}

fn message_head(data: &[u8]) -> Option<Message> {
    let head = data.get(..MESSAGE_HEAD as usize)?;
    Some(Message { channel: le_u16(head), log_time: le_u64(&head[6..]) })
}

/// Counts a message; whether it is wanted.
fn count(
    channels: &BTreeMap<u16, ChannelInfo>,
    wanted: &Wanted,
    read: &mut BTreeMap<u16, u64>,
    message: Message,
) -> bool {
    // Without its definition a message cannot be understood: it stays among the lost.
    if !channels.contains_key(&message.channel) {
        return false;
    }
    *read.entry(message.channel).or_default() += 1;
    match wanted {
        Wanted::Nothing => false,
        Wanted::Everything => true,
        Wanted::Channels(ids) => ids.contains(&message.channel),
    }
}

fn not_mcap(path: &Path, start: &[u8]) -> Error {
    if start.is_empty() {
        return Error::empty(path, "the file is empty (0 bytes)", crate::error::HINT_INCOMPLETE);
    }
    let (what, hint) = if start.starts_with(b"#ROSBAG") {
        ("is a ROS 1 bag, not MCAP", "convert it: 'mcap convert in.bag out.mcap', then to ROS 2 messages")
    } else if start.starts_with(b"SQLite format 3") {
        (
            "is a ROS 2 bag of the sqlite3 kind, not MCAP",
            "convert it: 'ros2 bag convert' with storage_id: mcap",
        )
    } else {
        (
            "does not start with MCAP's magic bytes",
            "check that this is an MCAP recording and that its copy is complete",
        )
    };
    Error::unsupported(path, what, hint)
}
