//! One chunk, read by `mcap`'s sans-io linear reader.

use std::collections::BTreeMap;

use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::records::{ChunkHead, RECORD_LIMIT, RecordFile};
use crate::error::Error;

/// Most bytes handed to the chunk reader at once.
const FEED: usize = 1 << 18;

/// A chunk that is being read.
pub(super) struct OpenChunk {
    pub(super) reader: LinearReader,
    pub(super) start: u64,
    pub(super) end: u64,
    fed: u64,
    /// The file ends inside it.
    pub(super) torn: bool,
    /// Unpacked bytes that have not come yet.
    pub(super) left: u64,
    /// Messages read, by channel.
    pub(super) read: BTreeMap<u16, u64>,
}

impl OpenChunk {
    /// The chunk from `start` to `end`, to be read for its messages, or to `check` its CRC.
    pub(super) fn new(start: u64, end: u64, head: &ChunkHead, torn: bool, check: bool) -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(check)
            .with_record_length_limit(RECORD_LIMIT as usize);
        let reader = LinearReader::new_with_options(options);
        Self { reader, start, end, fed: start, torn, left: head.uncompressed_size, read: BTreeMap::new() }
    }

    /// Gives the chunk's reader what it asks for, as far as the chunk goes.
    pub(super) fn feed(&mut self, file: &mut RecordFile, request: usize) -> Result<(), Error> {
        let left = usize::try_from(self.end - self.fed).unwrap_or(usize::MAX);
        let n = request.clamp(1, FEED).min(left);
        file.seek(self.fed)?;
        let got = match n {
            0 => 0,
            n => file.read_some(self.reader.insert(n))?,
        };
        self.reader.notify_read(got);
        self.fed += got as u64;
        Ok(())
    }

    /// Reads a chunk for its CRC only; says what is wrong.
    pub(super) fn check(&mut self, file: &mut RecordFile) -> Result<Option<String>, Error> {
        loop {
            let request = match self.reader.next_event() {
                None => return Ok(None),
                Some(Err(e)) => return Ok(Some(e.to_string())),
                Some(Ok(LinearReadEvent::ReadRequest(n))) => n,
                Some(Ok(LinearReadEvent::Record { .. })) => continue,
            };
            self.feed(file, request)?;
        }
    }
}
