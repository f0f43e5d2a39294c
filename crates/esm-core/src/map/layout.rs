//! The file's skeleton: header, section table and the kinds of sections. `FORMAT.md` says the same in words.

use bytemuck::{Pod, Zeroable};

use super::records::{MetaRecord, PointRun, SegmentRecord};

/// The format this build writes: (major, minor). It reads every minor of this major.
pub const FORMAT_VERSION: (u16, u16) = (1, 0);

/// First bytes of every map, of any version. As in PNG: the high bit and the line ends show transfers that were not
/// binary-safe.
pub(super) const MAGIC: [u8; 8] = *b"\x89ESM\r\n\x1a\n";
pub(super) const HEADER_LEN: usize = size_of::<Header>();
pub(super) const ENTRY_LEN: usize = size_of::<Entry>();
/// Sections (and the end of the table) lie on multiples of this; the gap is zero bytes.
pub(super) const ALIGN: usize = 64;
/// Points are checksummed in blocks of this many bytes.
pub(super) const BLOCK_LEN: usize = 64 * 1024;
/// More sections than any format will need; bounds the table.
pub(super) const MAX_SECTIONS: usize = 64;

/// A reader that does not know the section must refuse the file.
pub(super) const FLAG_REQUIRED: u32 = 1;
/// The section's bytes are checksummed block by block in `PCRC`; its own checksum field is zero.
pub(super) const FLAG_BLOCKS: u32 = 2;

#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(super) struct Header {
    pub(super) magic: [u8; 8],
    pub(super) major: u16,
    pub(super) minor: u16,
    pub(super) sections: u32,
    pub(super) file_len: u64,
    pub(super) reserved: [u32; 8],
    /// Of the table and its padding, up to the first section.
    pub(super) table_crc: u32,
    /// Of the 60 bytes before it.
    pub(super) header_crc: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(super) struct Entry {
    pub(super) id: [u8; 4],
    pub(super) flags: u32,
    pub(super) offset: u64,
    pub(super) len: u64,
    pub(super) row_len: u32,
    /// Of the section and its padding, up to the next section or the end of the file.
    pub(super) crc: u32,
}

/// A kind of section this build knows.
#[derive(Debug, PartialEq)]
pub(super) struct Kind {
    pub(super) id: [u8; 4],
    /// Bytes a row.
    pub(super) row_len: usize,
    pub(super) flags: u32,
    pub(super) what: &'static str,
}

const fn kind<T>(id: &[u8; 4], what: &'static str) -> Kind {
    Kind { id: *id, row_len: size_of::<T>(), flags: FLAG_REQUIRED, what }
}

pub(super) const META: Kind = kind::<MetaRecord>(b"META", "origin, bounds, descriptor version and size");
pub(super) const FRAME: Kind = kind::<u8>(b"FRAM", "frame name");
pub(super) const DESCRIPTOR: Kind = kind::<u8>(b"DNAM", "descriptor name");
pub(super) const SETTINGS: Kind = kind::<u8>(b"SETT", "build settings");
pub(super) const SOURCE: Kind = kind::<u8>(b"SRCE", "source name");
pub(super) const STANDARDIZER: Kind = kind::<f32>(b"STDZ", "descriptor statistics");
pub(super) const SEGMENTS: Kind = kind::<SegmentRecord>(b"SEGM", "segments");
pub(super) const DESCRIPTORS: Kind = kind::<f32>(b"DESC", "descriptors");
pub(super) const QUALITY: Kind = kind::<f32>(b"QUAL", "descriptor quality");
pub(super) const RUNS: Kind = kind::<PointRun>(b"SRUN", "segments' point runs");
pub(super) const GROUND: Kind = kind::<PointRun>(b"GRUN", "ground tiles' point runs");
pub(super) const STRUCTURE: Kind = kind::<PointRun>(b"TRUN", "structure tiles' point runs");
pub(super) const PATH: Kind = kind::<[f64; 3]>(b"PATH", "mapped path");
pub(super) const COVERAGE: Kind = kind::<[i32; 2]>(b"COVR", "covered cells");
pub(super) const BLOCK_CRCS: Kind = kind::<u32>(b"PCRC", "point block checksums");
pub(super) const POINTS: Kind =
    Kind { id: *b"PNTS", row_len: size_of::<[u16; 3]>(), flags: FLAG_REQUIRED | FLAG_BLOCKS, what: "points" };

/// All of them.
pub(super) const KINDS: [&Kind; 16] = [
    &META,
    &FRAME,
    &DESCRIPTOR,
    &SETTINGS,
    &SOURCE,
    &STANDARDIZER,
    &SEGMENTS,
    &DESCRIPTORS,
    &QUALITY,
    &RUNS,
    &GROUND,
    &STRUCTURE,
    &PATH,
    &COVERAGE,
    &BLOCK_CRCS,
    &POINTS,
];

/// One section of a map's file, for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SectionInfo {
    /// Four letters, as in `FORMAT.md`.
    pub id: String,
    /// What it holds.
    pub what: &'static str,
    /// First byte in the file.
    pub offset: u64,
    /// Bytes, without padding.
    pub len: u64,
}

impl SectionInfo {
    pub(super) fn of(e: &Entry) -> Self {
        let what = KINDS.iter().find(|k| k.id == e.id).map_or("unknown to this build", |k| k.what);
        Self { id: id_text(e.id), what, offset: e.offset, len: e.len }
    }
}

/// The next multiple of [`ALIGN`]; `None` where it does not fit.
pub(super) fn padded(len: u64) -> Option<u64> {
    len.checked_next_multiple_of(ALIGN as u64)
}

/// Where the first section starts when there are `sections` of them.
pub(super) fn table_end(sections: usize) -> u64 {
    // At most MAX_SECTIONS, so this cannot overflow.
    ((HEADER_LEN + sections * ENTRY_LEN) as u64).next_multiple_of(ALIGN as u64)
}

/// Point blocks that cover a points section of `len` bytes and its padding.
pub(super) fn block_count(len: u64) -> Option<u64> {
    padded(len).map(|l| l.div_ceil(BLOCK_LEN as u64))
}

/// A section's four letters, for messages.
pub(super) fn id_text(id: [u8; 4]) -> String {
    id.escape_ascii().to_string()
}
