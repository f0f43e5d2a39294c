//! An independent reading of `FORMAT.md`: finds sections and puts all checksums right after bytes were changed, as a
//! hostile or faulty writer would. Values out of range are left alone.

use std::ops::Range;

pub(crate) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

pub(crate) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

pub(crate) fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes[at..at + value.len()].copy_from_slice(value);
}

/// Where the table entry of section `id` lies.
pub(crate) fn entry(bytes: &[u8], id: &str) -> usize {
    let count = u32_at(bytes, 12) as usize;
    (0..count).map(|i| 64 + 32 * i).find(|&at| bytes[at..at + 4] == *id.as_bytes()).unwrap()
}

/// Where the section `id` lies, without padding.
pub(crate) fn section(bytes: &[u8], id: &str) -> Range<usize> {
    let at = entry(bytes, id);
    let start = u64_at(bytes, at + 8) as usize;
    start..start + u64_at(bytes, at + 16) as usize
}

pub(crate) fn up64(n: usize) -> usize {
    n.div_ceil(64) * 64
}

/// Puts every checksum right that can be found.
pub(crate) fn reseal(bytes: &mut [u8]) {
    let count = u32_at(bytes, 12) as usize;
    let table_end = count.checked_mul(32).map(|n| up64(64 + n)).filter(|&end| end <= bytes.len());
    if let Some(table_end) = table_end {
        let entries: Vec<usize> = (0..count).map(|i| 64 + 32 * i).collect();
        let padded = |bytes: &[u8], at: usize| {
            let (start, len) = (u64_at(bytes, at + 8), u64_at(bytes, at + 16));
            let end = start.checked_add(len.checked_next_multiple_of(64)?)?;
            (end <= bytes.len() as u64).then_some(start as usize..end as usize)
        };
        let find = |bytes: &[u8], id: &[u8]| entries.iter().copied().find(|&at| bytes[at..at + 4] == *id);
        if let (Some(points), Some(sums)) = (find(bytes, b"PNTS"), find(bytes, b"PCRC"))
            && let (Some(points), Some(sums)) = (padded(bytes, points), padded(bytes, sums))
        {
            let crcs: Vec<u32> = bytes[points].chunks(65_536).map(crc32fast::hash).collect();
            for (i, crc) in crcs.into_iter().enumerate().take_while(|(i, _)| 4 * i + 4 <= sums.len()) {
                put(bytes, sums.start + 4 * i, &crc.to_le_bytes());
            }
        }
        for at in entries {
            if u32_at(bytes, at + 4) & 2 == 0
                && let Some(range) = padded(bytes, at)
            {
                let crc = crc32fast::hash(&bytes[range]);
                put(bytes, at + 28, &crc.to_le_bytes());
            }
        }
        let crc = crc32fast::hash(&bytes[64..table_end]);
        put(bytes, 56, &crc.to_le_bytes());
    }
    let crc = crc32fast::hash(&bytes[..60]);
    put(bytes, 60, &crc.to_le_bytes());
}

/// Adds a section at the end, with its padding, and seals the file. Where the table's padding has no room for one more
/// entry, the table grows and all sections move.
pub(crate) fn add_section(bytes: &mut Vec<u8>, id: &[u8; 4], flags: u32, body: &[u8]) {
    let count = u32_at(bytes, 12) as usize;
    let at = 64 + 32 * count;
    let (old_end, new_end) = (up64(at), up64(at + 32));
    let grown = new_end - old_end;
    bytes.splice(old_end..old_end, vec![0; grown]);
    for entry in (0..count).map(|i| 64 + 32 * i) {
        let offset = u64_at(bytes, entry + 8) + grown as u64;
        put(bytes, entry + 8, &offset.to_le_bytes());
    }
    let offset = bytes.len() as u64;
    bytes.extend(body);
    bytes.resize(up64(bytes.len()), 0);
    put(bytes, at, id);
    put(bytes, at + 4, &flags.to_le_bytes());
    put(bytes, at + 8, &offset.to_le_bytes());
    put(bytes, at + 16, &(body.len() as u64).to_le_bytes());
    put(bytes, at + 24, &1u32.to_le_bytes());
    put(bytes, 12, &(count as u32 + 1).to_le_bytes());
    let len = bytes.len() as u64;
    put(bytes, 16, &len.to_le_bytes());
    reseal(bytes);
}
