//! LZF decompression, the codec of `DATA binary_compressed` in PCD files.
//!
//! Marc Lehmann's format: a control byte below 32 announces that many literal bytes plus one; any other holds a length
//! in its upper three bits (7 = one more byte follows) and the upper five bits of a distance back.

/// Longest run one back reference of three bytes can stand for: it bounds what hostile lengths may ask for.
const LONGEST_RUN: u64 = 264;

/// The most bytes that `compressed` bytes can unpack to.
pub(super) fn largest_output(compressed: u64) -> u64 {
    compressed.saturating_mul(LONGEST_RUN)
}

/// Unpacks `input` to exactly `size` bytes. The message says what is wrong, with the offset in `input`.
pub(super) fn decompress(input: &[u8], size: usize) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    let mut at = 0;
    while at < input.len() {
        let start = at;
        let control = usize::from(input[at]);
        at += 1;
        let cut = || format!("the compressed data ends inside the run at its byte {start}");
        if control < 32 {
            let run = input.get(at..at + control + 1).ok_or_else(cut)?;
            out.extend_from_slice(run);
            at += control + 1;
        } else {
            let mut length = (control >> 5) + 2;
            if length == 9 {
                length += usize::from(*input.get(at).ok_or_else(cut)?);
                at += 1;
            }
            let distance = ((control & 31) << 8) + usize::from(*input.get(at).ok_or_else(cut)?) + 1;
            at += 1;
            let from = out.len().checked_sub(distance).ok_or_else(|| {
                format!("the run at byte {start} of the compressed data points before its beginning")
            })?;
            // A run may overlap what it writes: copied byte by byte.
            for i in from..from + length {
                out.push(out[i]);
            }
        }
        if out.len() > size {
            return Err(format!("the data unpacks to more than the {size} bytes declared"));
        }
    }
    if out.len() < size {
        return Err(format!("the data unpacks to {} bytes, {size} are declared", out.len()));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn unpacks_hand_made_runs() {
        // Three literals, a run of 3 at distance 3, a run of 9 + 4 at distance 1.
        let packed = [2, b'a', b'b', b'c', 0b001_00000, 2, 0b111_00000, 4, 0];
        assert_eq!(decompress(&packed, 19).unwrap(), [b"abcabc".as_slice(), &[b'c'; 13]].concat());
    }

    #[test]
    fn says_what_is_wrong() {
        assert_eq!(
            decompress(&[3, 1], 4).unwrap_err(),
            "the compressed data ends inside the run at its byte 0"
        );
        assert_eq!(
            decompress(&[0, 7, 0b001_00000, 5], 4).unwrap_err(),
            "the run at byte 2 of the compressed data points before its beginning"
        );
        assert_eq!(decompress(&[0, 7], 4).unwrap_err(), "the data unpacks to 1 bytes, 4 are declared");
        assert_eq!(
            decompress(&[1, 7, 7], 1).unwrap_err(),
            "the data unpacks to more than the 1 bytes declared"
        );
    }

    proptest! {
        #[test]
        fn never_panics(bytes in proptest::collection::vec(any::<u8>(), 0..200), size in 0usize..2000) {
            if let Ok(out) = decompress(&bytes, size) {
                prop_assert_eq!(out.len(), size);
                prop_assert!(out.len() as u64 <= largest_output(bytes.len() as u64));
            }
        }
    }
}
