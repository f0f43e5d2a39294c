//! The number types that point records are made of.

/// One number type of a point field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    /// Size in bytes.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// Reads the number that starts at `bytes[at]`; the caller has checked that it lies inside.
    #[inline]
    pub(crate) fn read(self, bytes: &[u8], at: usize, big_endian: bool) -> f64 {
        /// The `N` bytes at `at`, in little-endian order.
        #[inline]
        fn take<const N: usize>(bytes: &[u8], at: usize, big_endian: bool) -> [u8; N] {
            let mut out = [0; N];
            out.copy_from_slice(&bytes[at..at + N]);
            if big_endian {
                out.reverse();
            }
            out
        }
        match self {
            Self::I8 => f64::from(bytes[at] as i8),
            Self::U8 => f64::from(bytes[at]),
            Self::I16 => f64::from(i16::from_le_bytes(take(bytes, at, big_endian))),
            Self::U16 => f64::from(u16::from_le_bytes(take(bytes, at, big_endian))),
            Self::I32 => f64::from(i32::from_le_bytes(take(bytes, at, big_endian))),
            Self::U32 => f64::from(u32::from_le_bytes(take(bytes, at, big_endian))),
            Self::I64 => i64::from_le_bytes(take(bytes, at, big_endian)) as f64,
            Self::U64 => u64::from_le_bytes(take(bytes, at, big_endian)) as f64,
            Self::F32 => f64::from(f32::from_le_bytes(take(bytes, at, big_endian))),
            Self::F64 => f64::from_le_bytes(take(bytes, at, big_endian)),
        }
    }
}

/// Where x, y and z stand in a point record, bytes from its start.
#[derive(Clone, Copy, Debug)]
pub(crate) struct XyzLayout {
    pub(crate) fields: [(usize, Scalar); 3],
    pub(crate) big_endian: bool,
}

impl XyzLayout {
    /// The bytes a record must have for x, y and z to lie inside; `None` where that overflows.
    pub(crate) fn extent(&self) -> Option<usize> {
        let mut extent = 0;
        for (offset, scalar) in self.fields {
            extent = extent.max(offset.checked_add(scalar.size())?);
        }
        Some(extent)
    }

    /// Reads one record of at least [`extent`](Self::extent) bytes.
    #[inline]
    pub(crate) fn read(&self, record: &[u8]) -> [f64; 3] {
        self.fields.map(|(offset, scalar)| scalar.read(record, offset, self.big_endian))
    }
}
