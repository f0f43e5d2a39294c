//! [`Column`]: rows of one kind, owned or lying in a memory-mapped file, used alike.

use std::marker::PhantomData;
use std::ops::{Deref, Range};
use std::sync::Arc;

use bytemuck::Pod;
use memmap2::Mmap;

/// Rows of type `T`; derefs to `&[T]`.
pub(super) enum Column<T> {
    Owned(Vec<T>),
    Mapped(MappedColumn<T>),
}

/// A checked byte range of a mapped file. Fields are private so that only [`Column::mapped`] makes one.
pub(super) struct MappedColumn<T> {
    file: Arc<Mmap>,
    range: Range<usize>,
    rows: PhantomData<fn() -> T>,
}

impl<T: Pod> Column<T> {
    /// A view of `range`; `None` where it is outside the file, misaligned for `T`, or not whole rows.
    pub(super) fn mapped(file: &Arc<Mmap>, range: Range<usize>) -> Option<Self> {
        let bytes = file.get(range.clone())?;
        bytemuck::try_cast_slice::<u8, T>(bytes).ok()?;
        Some(Self::Mapped(MappedColumn { file: Arc::clone(file), range, rows: PhantomData }))
    }
}

impl<T: Pod> Deref for Column<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match self {
            Self::Owned(rows) => rows,
            // Cannot fail: `mapped` has made the same cast of the same bytes, and a mapping never moves.
            Self::Mapped(m) => bytemuck::cast_slice(&m.file[m.range.clone()]),
        }
    }
}

impl<T> From<Vec<T>> for Column<T> {
    fn from(rows: Vec<T>) -> Self {
        Self::Owned(rows)
    }
}
