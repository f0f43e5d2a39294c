//! The summary at the end of an MCAP file: its channels and how many messages each has.
//!
//! Read record by record: `mcap`'s summary reader keeps every chunk's index, which grows with the recording.

use std::collections::BTreeMap;
use std::path::Path;

use mcap::MAGIC;
use mcap::records::{Record, op};

use super::definitions::{ChannelInfo, define};
use super::records::{HEAD, RECORD_LIMIT, RecordFile, le_u32, le_u64};
use crate::error::Error;

/// Body of the footer, and everything from its opcode to the end of the file.
const FOOTER_BODY: u64 = 20;
const TAIL: u64 = HEAD + FOOTER_BODY + MAGIC.len() as u64;

#[derive(Default)]
pub(super) struct Summary {
    pub(super) channels: BTreeMap<u16, ChannelInfo>,
    /// Messages by channel.
    pub(super) counts: BTreeMap<u16, u64>,
}

/// The summary, `None` where the file has none that is complete and passes its CRC.
pub(super) fn read(path: &Path) -> Result<Option<Summary>, Error> {
    let mut file = RecordFile::open(path)?;
    let Some(footer_at) = file.len.checked_sub(TAIL) else { return Ok(None) };
    let mut tail = [0; TAIL as usize];
    file.seek(footer_at)?;
    let complete = file.read_all(&mut tail)?;
    let (footer, magic) = tail.split_at((HEAD + FOOTER_BODY) as usize);
    let body = &footer[HEAD as usize..];
    let is_footer = footer[0] == op::FOOTER && le_u64(&footer[1..]) == FOOTER_BODY && magic == MAGIC;
    let start = le_u64(body);
    if !complete || !is_footer || start < MAGIC.len() as u64 || start >= footer_at {
        return Ok(None);
    }

    let mut summary = Summary::default();
    let mut schemas = BTreeMap::new();
    let mut counted = false;
    let mut hasher = crc32fast::Hasher::new();
    let mut buf = Vec::new();
    let mut at = start;
    while at < footer_at {
        let Some((opcode, len)) = file.head(at)? else { return Ok(None) };
        let end = at.saturating_add(HEAD).saturating_add(len);
        if end > footer_at || len > RECORD_LIMIT {
            return Ok(None);
        }
        file.body(at, len, &mut buf)?;
        hasher.update(&[opcode]);
        hasher.update(&len.to_le_bytes());
        hasher.update(&buf);
        if opcode == op::STATISTICS {
            let Ok(Record::Statistics(statistics)) = mcap::parse_record(opcode, &buf) else {
                return Ok(None);
            };
            // Some writers leave the counts by channel out.
            counted = !statistics.channel_message_counts.is_empty() || statistics.message_count == 0;
            summary.counts = statistics.channel_message_counts;
        } else if define(&mut schemas, &mut summary.channels, opcode, &buf).is_err() {
            return Ok(None);
        }
        at = end;
    }
    hasher.update(&footer[..(HEAD + FOOTER_BODY - 4) as usize]);
    let saved = le_u32(&body[16..]);
    let intact = saved == 0 || saved == hasher.finalize();
    let useful = counted && !summary.channels.is_empty();
    Ok((intact && useful).then_some(summary))
}
