//! Writing a map file: the layout of `FORMAT.md`, through [`atomic`](super::atomic).

use std::borrow::Cow;
use std::path::Path;

use bytemuck::{bytes_of, cast_slice};
use rayon::prelude::*;

use super::atomic;
use super::container::Map;
use super::layout::*;
use crate::error::Error;

pub(super) fn write(map: &Map, path: &Path) -> Result<(), Error> {
    // Damage in the file this map may come from must not get fresh, matching checksums.
    map.verify_points()?;
    let point_bytes: &[u8] = cast_slice(&map.points);
    let blocks: Vec<&[u8]> = point_bytes.chunks(BLOCK_LEN).collect();
    // A whole block is a whole number of alignments, so only the last one can have padding.
    let crcs: Vec<u32> = blocks.into_par_iter().map(padded_crc).collect();
    let bodies = bodies(map, &crcs);
    let (mut entries, file_len) = layout(bodies.iter().map(|(kind, body)| (*kind, body.len() as u64)));
    for (entry, (_, body)) in entries.iter_mut().zip(&bodies) {
        if entry.flags & FLAG_BLOCKS == 0 {
            entry.crc = padded_crc(body);
        }
    }
    let mut table = cast_slice(&entries).to_vec();
    table.resize(table_end(entries.len()) as usize - HEADER_LEN, 0);
    let (major, minor) = FORMAT_VERSION;
    let mut header = Header {
        magic: MAGIC,
        major,
        minor,
        sections: entries.len() as u32,
        file_len,
        reserved: [0; 8],
        table_crc: crc32fast::hash(&table),
        header_crc: 0,
    };
    header.header_crc = crc32fast::hash(&bytes_of(&header)[..HEADER_LEN - 4]);

    atomic::replace(path, |out| {
        out.write_all(bytes_of(&header))?;
        out.write_all(&table)?;
        bodies.iter().try_for_each(|(_, body)| {
            out.write_all(body)?;
            out.write_all(padding(body.len()))
        })
    })
}

/// The sections as they would be written, and the file's length.
pub(super) fn plan(map: &Map) -> (Vec<SectionInfo>, u64) {
    let blocks = size_of_val::<[[u16; 3]]>(&map.points).div_ceil(BLOCK_LEN);
    let bodies = bodies(map, &vec![0; blocks]);
    let (entries, len) = layout(bodies.iter().map(|(kind, body)| (*kind, body.len() as u64)));
    (entries.iter().map(SectionInfo::of).collect(), len)
}

/// Every section's bytes. Points come last: opening reads the front of the file in one sweep.
fn bodies<'a>(map: &'a Map, crcs: &[u32]) -> [(&'static Kind, Cow<'a, [u8]>); KINDS.len()] {
    fn rows<T: bytemuck::Pod>(rows: &[T]) -> Cow<'_, [u8]> {
        Cow::Borrowed(cast_slice(rows))
    }
    let statistics =
        map.standardizer.as_ref().map_or(Vec::new(), |s| [s.mean.as_slice(), &s.inv_std].concat());
    [
        (&META, Cow::Borrowed(bytes_of(&map.meta))),
        (&FRAME, rows(map.frame_id.as_bytes())),
        (&DESCRIPTOR, rows(map.descriptor.name.as_bytes())),
        (&SETTINGS, rows(map.settings.as_bytes())),
        (&SOURCE, rows(map.source.as_bytes())),
        (&STANDARDIZER, Cow::Owned(cast_slice(&statistics).to_vec())),
        (&SEGMENTS, rows(&map.segments)),
        (&DESCRIPTORS, rows(&map.descriptors)),
        (&QUALITY, rows(&map.quality)),
        (&RUNS, rows(&map.runs)),
        (&GROUND, rows(&map.ground)),
        (&STRUCTURE, rows(&map.structure)),
        (&PATH, rows(&map.path)),
        (&COVERAGE, rows(&map.coverage)),
        (&BLOCK_CRCS, Cow::Owned(cast_slice(crcs).to_vec())),
        (&POINTS, rows(&map.points)),
    ]
}

/// Table entries, checksums still zero, and the file's length.
fn layout(sections: impl ExactSizeIterator<Item = (&'static Kind, u64)>) -> (Vec<Entry>, u64) {
    let mut offset = table_end(sections.len());
    let entries = sections
        .map(|(kind, len)| {
            let entry =
                Entry { id: kind.id, flags: kind.flags, offset, len, row_len: kind.row_len as u32, crc: 0 };
            // Lengths of things in memory: their sum fits.
            offset += len.next_multiple_of(ALIGN as u64);
            entry
        })
        .collect();
    (entries, offset)
}

fn padding(len: usize) -> &'static [u8] {
    &[0; ALIGN][..len.next_multiple_of(ALIGN) - len]
}

fn padded_crc(bytes: &[u8]) -> u32 {
    let mut crc = crc32fast::Hasher::new();
    crc.update(bytes);
    crc.update(padding(bytes.len()));
    crc.finalize()
}
