//! Writes CDR, little-endian: numbers aligned to their size from the end of the four header bytes.

/// A message that is being encoded.
pub(crate) struct CdrWriter(Vec<u8>);

impl CdrWriter {
    pub(crate) fn with_capacity(bytes: usize) -> Self {
        let mut out = Vec::with_capacity(bytes + 4);
        out.extend([0, 1, 0, 0]);
        Self(out)
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        self.0.resize(4 + (self.0.len() - 4).next_multiple_of(N), 0);
        self.0.extend(bytes);
    }

    pub(crate) fn u8(&mut self, v: u8) {
        self.0.push(v);
    }

    pub(crate) fn u32(&mut self, v: u32) {
        self.number(v.to_le_bytes());
    }

    pub(crate) fn f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|v| self.number(v.to_le_bytes()));
    }

    /// A `string`, with its final NUL counted.
    pub(crate) fn string(&mut self, s: &str) {
        self.u32(s.len() as u32 + 1);
        self.0.extend(s.as_bytes());
        self.0.push(0);
    }

    /// A `uint8[]`.
    pub(crate) fn byte_sequence(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.0.extend(bytes);
    }

    /// `std_msgs/Header`; `int32` seconds hold until 2038.
    pub(crate) fn header(&mut self, stamp_ns: i64, frame_id: &str) {
        let sec = stamp_ns.div_euclid(1_000_000_000).clamp(i32::MIN.into(), i32::MAX.into()) as i32;
        self.number(sec.to_le_bytes());
        self.u32(stamp_ns.rem_euclid(1_000_000_000) as u32);
        self.string(frame_id);
    }

    pub(crate) fn finish(self) -> Vec<u8> {
        self.0
    }
}
