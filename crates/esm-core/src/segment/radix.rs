//! Stable radix sort of packed words: a cell key above a point index.
//!
//! Sorting points by grid cell is the one operation that the voxel filter, the ground filter and the clustering
//! share. A counting sort is linear, and its order depends on the data alone, never on a hash.

/// A word that holds a key in its upper bits and a 32-bit point index in its lower 32.
pub(crate) trait Word: Copy + Default {
    /// Packs a key (`key < 2^key_bits`) and an index.
    fn pack(key: u128, index: u32) -> Self;
    /// The point index.
    fn index(self) -> u32;
    /// The key.
    fn key(self) -> u128;
    /// `bits` bits of the key, from bit `shift` of the key on.
    fn digit(self, shift: u32, bits: u32) -> usize;
}

impl Word for u64 {
    #[inline]
    fn pack(key: u128, index: u32) -> Self {
        (key as u64) << 32 | u64::from(index)
    }
    #[inline]
    fn index(self) -> u32 {
        self as u32
    }
    #[inline]
    fn key(self) -> u128 {
        u128::from(self >> 32)
    }
    #[inline]
    fn digit(self, shift: u32, bits: u32) -> usize {
        (self >> (32 + shift)) as usize & ((1 << bits) - 1)
    }
}

impl Word for u128 {
    #[inline]
    fn pack(key: u128, index: u32) -> Self {
        key << 32 | u128::from(index)
    }
    #[inline]
    fn index(self) -> u32 {
        self as u32
    }
    #[inline]
    fn key(self) -> u128 {
        self >> 32
    }
    #[inline]
    fn digit(self, shift: u32, bits: u32) -> usize {
        (self >> (32 + shift)) as usize & ((1 << bits) - 1)
    }
}

/// Widest digit: 2,048 counters stay in the first-level cache.
const MAX_DIGIT_BITS: u32 = 11;

/// Sorts by key; words of equal keys keep their order. `key_bits` bounds the keys: every key is below `2^key_bits`.
pub(crate) fn sort_by_key<W: Word>(words: Vec<W>, key_bits: u32) -> Vec<W> {
    let passes = key_bits.div_ceil(MAX_DIGIT_BITS);
    if passes == 0 || words.len() < 2 {
        return words;
    }
    let digit_bits = key_bits.div_ceil(passes);
    let mut from = words;
    let mut to = vec![W::default(); from.len()];
    for pass in 0..passes {
        let shift = pass * digit_bits;
        let mut starts = vec![0u32; 1 << digit_bits];
        for w in &from {
            starts[w.digit(shift, digit_bits)] += 1;
        }
        let mut sum = 0;
        for s in &mut starts {
            (*s, sum) = (sum, sum + *s);
        }
        for w in &from {
            let start = &mut starts[w.digit(shift, digit_bits)];
            to[*start as usize] = *w;
            *start += 1;
        }
        std::mem::swap(&mut from, &mut to);
    }
    from
}

/// Bits needed for values `0..=max`.
pub(crate) fn bits_for(max: u64) -> u32 {
    u64::BITS - max.leading_zeros()
}

/// `floor(v)` as an integer, saturating; several times faster than `f64::floor` where the target has no rounding
/// instruction.
#[inline]
pub(crate) fn floor_i64(v: f64) -> i64 {
    let t = v as i64;
    t.saturating_sub(i64::from((t as f64) > v))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn floor_is_the_floor() {
        for v in [-2.0, -1.5, -1e-9, -0.0, 0.0, 0.3, 1.0, 7.999, 1e15, -1e15] {
            assert_eq!(floor_i64(v), v.floor() as i64, "{v}");
        }
        assert_eq!(floor_i64(f64::MIN), i64::MIN);
    }

    proptest! {
        #[test]
        fn sorts_like_std(keys in prop::collection::vec(0u128..1 << 90, 0..300), bits in 1u32..91) {
            let mask = (1u128 << bits) - 1;
            let words: Vec<u128> = keys.iter().enumerate().map(|(i, k)| u128::pack(k & mask, i as u32)).collect();
            let mut expected = words.clone();
            expected.sort_by_key(|w| w.key());
            prop_assert_eq!(sort_by_key(words, bits), expected);
        }

        #[test]
        fn sorts_narrow_words_like_std(keys in prop::collection::vec(any::<u32>(), 0..300), bits in 0u32..33) {
            let mask = ((1u64 << bits) - 1) as u32;
            let words: Vec<u64> =
                keys.iter().enumerate().map(|(i, k)| u64::pack(u128::from(k & mask), i as u32)).collect();
            let mut expected = words.clone();
            expected.sort_by_key(|w| w.key());
            prop_assert_eq!(sort_by_key(words, bits), expected);
        }
    }
}
