//! What a LAZ file's tables may ask for, looked at before the `laz` crate reads them.
//!
//! `laz` 0.13 reserves memory for as many chunks as the chunk table's head says (up to 64 GB), allocates each layer of a
//! layered chunk by its declared length (up to 4 GB each) and asserts that the items agree with the buffer it is given.
//! This walks the same numbers and compares them with the file.

use std::io::{Read, Seek, SeekFrom};

use crate::input::Input;

/// Bytes of the laszip record before its list of items, and of one item.
const RECORD_HEAD: usize = 34;
const ITEM: usize = 6;

/// One field group of a point as the laszip record lists it.
struct Item {
    size: u16,
    /// Layers it has in a chunk of the layered kind.
    layers: u64,
    layered: bool,
}

impl Item {
    fn parse(bytes: &[u8]) -> Option<Self> {
        let word = |i: usize| u16::from_le_bytes([bytes[i], bytes[i + 1]]);
        let (kind, size, version) = (word(0), word(2), word(4));
        // Size of each type where it is fixed, and its layers: after the LAZ specification, table of items.
        let (expected, layers) = match kind {
            0 => (size, 0),
            6 => (20, 0),
            7 => (8, 0),
            8 => (6, 0),
            9 => (29, 0),
            10 => (30, 9),
            11 => (6, 1),
            12 => (8, 2),
            13 => (29, 1),
            14 => (size, u64::from(size)),
            _ => return None,
        };
        let layered = kind >= 10;
        let versions = if layered { 3..=4 } else { 1..=2 };
        (size == expected && size > 0 && versions.contains(&version)).then_some(Self {
            size,
            layers,
            layered,
        })
    }
}

/// Checks the laszip record, the chunk table and the chunks; `start` is where the points begin. Says what is wrong.
pub(super) fn check(
    input: &mut Input,
    laszip_record: &[u8],
    start: u64,
    record_length: u16,
    points: u64,
) -> std::io::Result<Result<(), String>> {
    let Some(items) = items(laszip_record) else {
        return Ok(Err("the laszip record lists fields that are not known".to_owned()));
    };
    let point: u64 = items.iter().map(|i| u64::from(i.size)).sum();
    if point != u64::from(record_length) {
        return Ok(Err(format!("the laszip record lists {point} bytes a point, the header {record_length}")));
    }
    let layered = items[0].layered;
    let kind = u16::from_le_bytes([laszip_record[0], laszip_record[1]]);
    if items.iter().any(|i| i.layered != layered) || layered != (kind == 3) {
        return Ok(Err("the laszip record mixes layered and plain fields".to_owned()));
    }
    if points == 0 || kind == 1 {
        return Ok(Ok(()));
    }
    let data = start + 8;
    let table = match chunk_table(input, start)? {
        Ok(table) => table,
        Err(what) => return Ok(Err(what)),
    };
    // A chunk holds its first point as it is.
    if let Some((at, chunks)) = table
        && chunks > at.saturating_sub(data) / point
    {
        return Ok(Err(format!(
            "the chunk table at byte {at} says {chunks} chunks, the file cannot hold them"
        )));
    }
    if layered {
        return walk_layers(input, &items, data, table.map_or(input.len, |t| t.0), points);
    }
    Ok(Ok(()))
}

fn items(record: &[u8]) -> Option<Vec<Item>> {
    let n = usize::from(u16::from_le_bytes([*record.get(RECORD_HEAD - 2)?, *record.get(RECORD_HEAD - 1)?]));
    let list = record.get(RECORD_HEAD..RECORD_HEAD + n * ITEM)?;
    let items: Option<Vec<Item>> = list.chunks_exact(ITEM).map(Item::parse).collect();
    items.filter(|i| !i.is_empty())
}

/// Place of the chunk table and number of chunks.
type ChunkTable = Option<(u64, u64)>;

/// The chunk table as `laz` finds it: at the offset before the points, or where the writer could not go back, at the one
/// in the file's last eight bytes. `None` where there is none.
fn chunk_table(input: &mut Input, start: u64) -> std::io::Result<Result<ChunkTable, String>> {
    let len = input.len;
    let mut u64_at = |at: u64| -> std::io::Result<Option<u64>> {
        if at.checked_add(8).is_none_or(|end| end > len) {
            return Ok(None);
        }
        let mut bytes = [0; 8];
        input.reader.seek(SeekFrom::Start(at))?;
        input.reader.read_exact(&mut bytes)?;
        Ok(Some(u64::from_le_bytes(bytes)))
    };
    let Some(mut at) = u64_at(start)? else {
        return Ok(Err(format!("the file ends at byte {len} before its points")));
    };
    // Not written yet is 0 or -1.
    let unwritten = |at: u64| at as i64 <= start as i64;
    if unwritten(at) {
        at = u64_at(len - 8)?.unwrap_or(0);
        if unwritten(at) {
            return Ok(Ok(None));
        }
    }
    // Version and number of chunks, a u32 each.
    Ok(match u64_at(at)? {
        Some(head) => Ok(Some((at, head >> 32))),
        None => Err(format!("the chunk table is to follow at byte {at}, the file ends at byte {len}")),
    })
}

/// Goes from layered chunk to layered chunk: a whole point, the number of points, the length of every layer, the layers.
fn walk_layers(
    input: &mut Input,
    items: &[Item],
    data: u64,
    end: u64,
    points: u64,
) -> std::io::Result<Result<(), String>> {
    let point: u64 = items.iter().map(|i| u64::from(i.size)).sum();
    let layers: u64 = items.iter().map(|i| i.layers).sum();
    let mut head = vec![0; (point + 4 + 4 * layers) as usize];
    let (mut at, mut seen) = (data, 0u64);
    while seen < points {
        let after = at + head.len() as u64;
        if after > end {
            return Ok(Err(format!(
                "the header says {points} points, the chunks before byte {at} hold {seen}"
            )));
        }
        input.reader.seek(SeekFrom::Start(at))?;
        input.reader.read_exact(&mut head)?;
        let mut numbers =
            head[point as usize..].chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let count = u64::from(numbers.next().unwrap_or(0));
        let bytes: u64 = numbers.map(u64::from).sum();
        if bytes > end - after || count == 0 {
            let what = format!(
                "the chunk at byte {at} says {count} points in {bytes} bytes, {} are there",
                end - after
            );
            return Ok(Err(what));
        }
        seen = seen.saturating_add(count);
        at = after + bytes;
    }
    Ok(Ok(()))
}
