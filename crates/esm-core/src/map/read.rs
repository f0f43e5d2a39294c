//! Opening a map file: every byte but the points' is verified, then every value is checked.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use bytemuck::Pod;
use memmap2::Mmap;

use super::blocks::PointBlocks;
use super::check;
use super::column::Column;
use super::container::{Map, Origin};
use super::data::DescriptorInfo;
use super::layout::*;
use super::mmap;
use super::problem::Problem;
use super::records::MetaRecord;
use super::standardizer::Standardizer;
use crate::error::Error;

pub(super) fn open(path: &Path) -> Result<Map, Error> {
    let file = Arc::new(mmap::map_file(path)?);
    read(&file, path).map_err(|p| p.in_file(path))
}

pub(super) fn load(path: &Path) -> Result<Map, Error> {
    let copy = Arc::new(mmap::copy_file(path)?);
    let map = read(&copy, path).map_err(|p| p.in_file(path))?;
    map.verify_points()?;
    Ok(map)
}

fn read(file: &Arc<Mmap>, path: &Path) -> Result<Map, Problem> {
    let header = header(file)?;
    let entries = table(file, &header)?;
    entries.iter().try_for_each(|e| verify_section(file, e))?;
    let found = Found { file, entries: &entries };

    let [meta] = found.column::<MetaRecord>(&META)?[..] else {
        return Err(Problem::invalid("section META does not hold exactly one row"));
    };
    let name = found.text(&DESCRIPTOR, check::MAX_NAME)?;
    let points = found.range(&POINTS)?;
    let blocks = PointBlocks::new(file, points.start, points.len(), found.column(&BLOCK_CRCS)?)?;
    let map = Map {
        meta,
        frame_id: found.text(&FRAME, check::MAX_FRAME)?,
        descriptor: DescriptorInfo { name, version: meta.descriptor_version, dim: meta.descriptor_dim },
        standardizer: standardizer(&found.column(&STANDARDIZER)?)?,
        settings: found.text(&SETTINGS, check::MAX_SETTINGS)?,
        source: found.text(&SOURCE, check::MAX_SOURCE)?,
        segments: found.column(&SEGMENTS)?,
        descriptors: found.column(&DESCRIPTORS)?,
        quality: found.column(&QUALITY)?,
        runs: found.column(&RUNS)?,
        ground: found.column(&GROUND)?,
        structure: found.column(&STRUCTURE)?,
        path: found.column(&PATH)?,
        coverage: found.column(&COVERAGE)?,
        points: found.column(&POINTS)?,
        origin_of: Origin::File {
            path: path.to_owned(),
            len: header.file_len,
            sections: entries.iter().map(SectionInfo::of).collect(),
            blocks,
        },
    };
    check::check(&map)?;
    Ok(map)
}

fn header(bytes: &[u8]) -> Result<Header, Problem> {
    let start = &bytes[..bytes.len().min(MAGIC.len())];
    if !MAGIC.starts_with(start) {
        return Err(Problem::not_a_map("this is not an esm map (its first bytes are not a map's)"));
    }
    let Some(raw) = bytes.get(..HEADER_LEN) else {
        return Err(Problem::damaged(format!(
            "cut short: {} bytes, the header alone takes {HEADER_LEN}",
            bytes.len()
        )));
    };
    let header: Header = bytemuck::pod_read_unaligned(raw);
    // Before anything else is believed, the version included: where it stands is the same in every version.
    if crc32fast::hash(&raw[..HEADER_LEN - 4]) != header.header_crc {
        return Err(Problem::damaged(format!("the header (bytes 0 to {HEADER_LEN}) fails its checksum")));
    }
    let (reads, _) = FORMAT_VERSION;
    if header.major > reads {
        let (major, minor) = (header.major, header.minor);
        return Err(Problem::newer(format!(
            "written by a newer esm (format {major}.{minor}, this build reads {reads})"
        )));
    }
    if header.major < reads {
        return Err(Problem::invalid(format!("format {} does not exist", header.major)));
    }
    if header.reserved != [0; 8] {
        return Err(Problem::invalid("reserved bytes of the header are not zero"));
    }
    let len = bytes.len() as u64;
    if len < header.file_len {
        return Err(Problem::damaged(format!("cut short: {len} bytes of {}", header.file_len)));
    }
    if len > header.file_len {
        let more = len - header.file_len;
        return Err(Problem::damaged(format!(
            "{more} bytes follow the end of the map at {}",
            header.file_len
        )));
    }
    Ok(header)
}

/// The section table, after which every section is known to lie inside the file, one after the other.
fn table(bytes: &[u8], header: &Header) -> Result<Vec<Entry>, Problem> {
    let count = header.sections as usize;
    if count == 0 || count > MAX_SECTIONS {
        return Err(Problem::invalid(format!("{count} sections, 1 to {MAX_SECTIONS} are possible")));
    }
    let end = table_end(count);
    let Some(raw) = bytes.get(HEADER_LEN..end as usize) else {
        return Err(Problem::damaged(format!("cut short: the section table ends at byte {end}")));
    };
    if crc32fast::hash(raw) != header.table_crc {
        return Err(Problem::damaged(format!(
            "the section table (bytes {HEADER_LEN} to {end}) fails its checksum"
        )));
    }
    let (rows, padding) = raw.split_at(count * ENTRY_LEN);
    zero_padding("the section table", padding)?;
    let entries: Vec<Entry> = rows.chunks_exact(ENTRY_LEN).map(bytemuck::pod_read_unaligned).collect();
    let mut next = end;
    for (i, e) in entries.iter().enumerate() {
        let id = id_text(e.id);
        if entries[..i].iter().any(|other| other.id == e.id) {
            return Err(Problem::invalid(format!("section {id} exists twice")));
        }
        if e.offset != next {
            return Err(Problem::invalid(format!("section {id} starts at byte {}, not at {next}", e.offset)));
        }
        next = padded(e.len)
            .and_then(|l| next.checked_add(l))
            .filter(|&end| end <= header.file_len)
            .ok_or_else(|| {
                Problem::invalid(format!(
                    "section {id} ({} bytes at {}) reaches beyond the file",
                    e.len, e.offset
                ))
            })?;
        check_kind(e, &id)?;
    }
    if next != header.file_len {
        let left = header.file_len - next;
        return Err(Problem::invalid(format!("{left} bytes after the last section belong to none")));
    }
    Ok(entries)
}

fn check_kind(e: &Entry, id: &str) -> Result<(), Problem> {
    match KINDS.iter().find(|k| k.id == e.id) {
        Some(kind) => {
            if e.flags != kind.flags || e.row_len as usize != kind.row_len {
                return Err(Problem::invalid(format!(
                    "section {id} has flags {} and rows of {} bytes, this format has {} and {}",
                    e.flags, e.row_len, kind.flags, kind.row_len
                )));
            }
            if !e.len.is_multiple_of(kind.row_len as u64) {
                return Err(Problem::invalid(format!("section {id} ends inside a row")));
            }
            if e.flags & FLAG_BLOCKS != 0 && e.crc != 0 {
                return Err(Problem::invalid(format!(
                    "section {id} has a checksum of its own beside its blocks'"
                )));
            }
            Ok(())
        }
        // A later minor version may add sections that old readers can do without.
        None if e.flags == 0 => Ok(()),
        None => {
            Err(Problem::newer(format!("section {id} is needed to use this map and unknown to this build")))
        }
    }
}

fn verify_section(bytes: &[u8], e: &Entry) -> Result<(), Problem> {
    if e.flags & FLAG_BLOCKS != 0 {
        return Ok(());
    }
    let section = byte_range(e).and_then(|r| Some((bytes.get(r.clone())?, r)));
    let padded = padded(e.len).and_then(|l| bytes.get(e.offset as usize..(e.offset + l) as usize));
    let (Some((_, range)), Some(padded)) = (section, padded) else {
        return Err(Problem::damaged(format!("section {} reaches beyond the file", id_text(e.id))));
    };
    if crc32fast::hash(padded) != e.crc {
        let end = range.start + padded.len();
        return Err(Problem::damaged(format!(
            "section {} (bytes {} to {end}) fails its checksum",
            id_text(e.id),
            range.start
        )));
    }
    zero_padding(&format!("section {}", id_text(e.id)), &padded[range.len()..])
}

fn zero_padding(what: &str, padding: &[u8]) -> Result<(), Problem> {
    match padding.iter().all(|&b| b == 0) {
        true => Ok(()),
        false => Err(Problem::invalid(format!("the padding after {what} is not zero"))),
    }
}

/// The sections of a file whose table has been checked.
struct Found<'a> {
    file: &'a Arc<Mmap>,
    entries: &'a [Entry],
}

impl Found<'_> {
    fn range(&self, kind: &Kind) -> Result<Range<usize>, Problem> {
        let entry = self.entries.iter().find(|e| e.id == kind.id);
        entry.and_then(byte_range).ok_or_else(|| {
            Problem::invalid(format!("section {} ({}) is missing", id_text(kind.id), kind.what))
        })
    }

    fn column<T: Pod>(&self, kind: &Kind) -> Result<Column<T>, Problem> {
        let range = self.range(kind)?;
        Column::mapped(self.file, range)
            .ok_or_else(|| Problem::damaged(format!("section {} reaches beyond the file", id_text(kind.id))))
    }

    fn text(&self, kind: &Kind, most: usize) -> Result<String, Problem> {
        let bytes = self.column::<u8>(kind)?;
        let (id, len) = (id_text(kind.id), bytes.len());
        if len > most {
            let what = kind.what;
            return Err(Problem::invalid(format!(
                "section {id} ({what}) has {len} bytes, at most {most} are possible"
            )));
        }
        String::from_utf8(bytes.to_vec()).map_err(|e| {
            let at = e.utf8_error().valid_up_to();
            Problem::invalid(format!("section {id} ({}) is not UTF-8 at its byte {at}", kind.what))
        })
    }
}

fn byte_range(e: &Entry) -> Option<Range<usize>> {
    let start = usize::try_from(e.offset).ok()?;
    Some(start..start.checked_add(usize::try_from(e.len).ok()?)?)
}

fn standardizer(rows: &[f32]) -> Result<Option<Standardizer>, Problem> {
    if rows.is_empty() {
        return Ok(None);
    }
    if !rows.len().is_multiple_of(2) {
        return Err(Problem::invalid("section STDZ does not hold a mean and a spread a dimension"));
    }
    let (mean, inv_std) = rows.split_at(rows.len() / 2);
    Ok(Some(Standardizer { mean: mean.to_vec(), inv_std: inv_std.to_vec() }))
}
