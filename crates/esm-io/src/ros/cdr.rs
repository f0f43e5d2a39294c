//! CDR, the encoding of ROS 2 messages: numbers aligned to their size from the end of a four-byte header that tells the
//! byte order. An own reader of a page: the four messages need eight primitives, in both byte orders, borrowed where
//! they are long, and every length checked against what is there.

/// Reads one CDR message front to back. The errors are complete phrases for [`crate::Error::Malformed`].
pub(crate) struct CdrReader<'a> {
    /// The message after its header: alignment counts from here.
    body: &'a [u8],
    at: usize,
    big_endian: bool,
}

impl<'a> CdrReader<'a> {
    pub(crate) fn new(message: &'a [u8]) -> Result<Self, String> {
        let Some((&[_, kind, _, _], body)) = message.split_first_chunk::<4>() else {
            return Err(format!("the message has {} bytes, fewer than CDR's header", message.len()));
        };
        // Plain CDR version 1, which is what ROS 2 records; the first byte is 0 for it.
        let big_endian = match (message[0], kind) {
            (0, 0) => true,
            (0, 1) => false,
            (high, low) => return Err(format!("the encoding {high:02x}{low:02x} is no plain CDR")),
        };
        Ok(Self { body, at: 0, big_endian })
    }

    fn bytes(&mut self, n: usize) -> Result<&'a [u8], String> {
        let rest = &self.body[self.at..];
        if n > rest.len() {
            return Err(format!(
                "the message ends at byte {}: {n} more bytes are declared, {} are there",
                self.body.len() + 4,
                rest.len()
            ));
        }
        self.at += n;
        Ok(&rest[..n])
    }

    /// `N` bytes aligned to `N`, in little-endian order.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let padding = self.at.next_multiple_of(N) - self.at;
        self.bytes(padding)?;
        let mut out = [0; N];
        out.copy_from_slice(self.bytes(N)?);
        if self.big_endian {
            out.reverse();
        }
        Ok(out)
    }

    pub(crate) fn u8(&mut self) -> Result<u8, String> {
        Ok(self.number::<1>()?[0])
    }

    pub(crate) fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.number()?))
    }

    pub(crate) fn i32(&mut self) -> Result<i32, String> {
        Ok(i32::from_le_bytes(self.number()?))
    }

    pub(crate) fn f64(&mut self) -> Result<f64, String> {
        Ok(f64::from_le_bytes(self.number()?))
    }

    pub(crate) fn f64s<const N: usize>(&mut self) -> Result<[f64; N], String> {
        let mut out = [0.0; N];
        for v in &mut out {
            *v = self.f64()?;
        }
        Ok(out)
    }

    /// A `uint8[]`.
    pub(crate) fn byte_sequence(&mut self) -> Result<&'a [u8], String> {
        let n = self.u32()?;
        self.bytes(n as usize)
    }

    /// A `string`; its length counts a final NUL, which is left out here. Some writers leave it out too.
    pub(crate) fn string(&mut self) -> Result<String, String> {
        let bytes = self.byte_sequence()?;
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        Ok(String::from_utf8_lossy(bytes).into_owned())
    }
}

/// `std_msgs/Header`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Header {
    /// Nanoseconds.
    pub(crate) stamp_ns: i64,
    pub(crate) frame_id: String,
}

impl Header {
    pub(crate) fn read(cdr: &mut CdrReader<'_>) -> Result<Self, String> {
        let sec = cdr.i32()?;
        let nanosec = cdr.u32()?;
        Ok(Self {
            stamp_ns: i64::from(sec) * 1_000_000_000 + i64::from(nanosec),
            frame_id: frame_name(&cdr.string()?),
        })
    }
}

/// Frame names without the leading slash that ROS 1 had.
pub(crate) fn frame_name(name: &str) -> String {
    name.trim_start_matches('/').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn aligns_from_the_end_of_the_header() {
        // u8 7, then u32 aligned to 4, then f64 aligned to 8.
        let mut little = vec![0, 1, 0, 0, 7, 0, 0, 0, 4, 3, 2, 1];
        little.extend(2.5f64.to_le_bytes());
        let mut big = vec![0, 0, 0, 0, 7, 0, 0, 0, 1, 2, 3, 4];
        big.extend(2.5f64.to_be_bytes());
        for message in [little, big] {
            let mut cdr = CdrReader::new(&message).unwrap();
            assert_eq!((cdr.u8(), cdr.u32(), cdr.f64()), (Ok(7), Ok(0x0102_0304), Ok(2.5)));
            assert_eq!(
                cdr.u8().unwrap_err(),
                "the message ends at byte 20: 1 more bytes are declared, 0 are there"
            );
        }
    }

    #[test]
    fn strings_with_and_without_nul() {
        for s in [b"\x00\x01\x00\x00\x03\x00\x00\x00ab\x00".as_slice(), b"\x00\x01\x00\x00\x02\x00\x00\x00ab"]
        {
            assert_eq!(CdrReader::new(s).unwrap().string().unwrap(), "ab");
        }
    }

    #[test]
    fn refuses_other_encodings_and_hostile_lengths() {
        assert_eq!(
            CdrReader::new(&[0, 1]).err().unwrap(),
            "the message has 2 bytes, fewer than CDR's header"
        );
        assert_eq!(CdrReader::new(&[0, 3, 0, 0]).err().unwrap(), "the encoding 0003 is no plain CDR");
        let mut cdr = CdrReader::new(&[0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff, 1]).unwrap();
        assert_eq!(
            cdr.byte_sequence().unwrap_err(),
            "the message ends at byte 9: 4294967295 more bytes are declared, 1 are there"
        );
    }

    proptest! {
        #[test]
        fn never_panics(message in proptest::collection::vec(any::<u8>(), 0..64), ops in proptest::collection::vec(0..5u8, 0..20)) {
            if let Ok(mut cdr) = CdrReader::new(&message) {
                for op in ops {
                    let failed = match op {
                        0 => cdr.u8().is_err(),
                        1 => cdr.i32().is_err(),
                        2 => cdr.f64s::<3>().is_err(),
                        3 => cdr.string().is_err(),
                        _ => cdr.byte_sequence().is_err(),
                    };
                    if failed { break; }
                }
                prop_assert!(cdr.at <= cdr.body.len());
            }
        }
    }
}
