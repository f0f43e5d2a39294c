//! The framing of MCAP records: one byte of opcode, eight of length, the body.

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::input::open_regular;

/// Opcode and length.
pub(super) const HEAD: u64 = 9;

/// Longest record taken into memory, bytes: no cloud of one sweep comes near, hostile lengths stop here.
pub(super) const RECORD_LIMIT: u64 = 256 << 20;

/// Bytes of a chunk's body before the name of its compression, and between that name and the data.
const CHUNK_BEFORE_NAME: usize = 32;
const CHUNK_AFTER_NAME: usize = 8;

/// Bytes of the longest chunk head looked at: names of compressions are short.
pub(super) const CHUNK_HEAD: usize = HEAD as usize + CHUNK_BEFORE_NAME + 64 + CHUNK_AFTER_NAME;

/// A file read at given places.
pub(super) struct RecordFile {
    pub(super) path: PathBuf,
    file: BufReader<File>,
    /// Length when it was opened.
    pub(super) len: u64,
    at: u64,
}

/// What stands before a chunk's data.
#[derive(Clone, Debug)]
pub(super) struct ChunkHead {
    /// Length of the record's body.
    pub(super) len: u64,
    pub(super) uncompressed_size: u64,
    pub(super) uncompressed_crc: u32,
    pub(super) compression: String,
}

impl RecordFile {
    pub(super) fn open(path: &Path) -> Result<Self, Error> {
        let (file, len) = open_regular(path)?;
        Ok(Self { path: path.to_owned(), file: BufReader::with_capacity(1 << 16, file), len, at: 0 })
    }

    pub(super) fn seek(&mut self, to: u64) -> Result<(), Error> {
        if to == self.at {
            return Ok(());
        }
        // A short way stays inside the buffer.
        let moved = match i64::try_from(i128::from(to) - i128::from(self.at)) {
            Ok(step) => self.file.seek_relative(step),
            Err(_) => self.file.seek(SeekFrom::Start(to)).map(drop),
        };
        moved.map_err(|e| Error::io(&self.path, "reading", e))?;
        self.at = to;
        Ok(())
    }

    /// Reads as much as there is, up to the buffer's length.
    pub(super) fn read_some(&mut self, buf: &mut [u8]) -> Result<usize, Error> {
        let mut done = 0;
        while done < buf.len() {
            match self.file.read(&mut buf[done..]) {
                Ok(0) => break,
                Ok(n) => done += n,
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(Error::io(&self.path, "reading", e)),
            }
        }
        self.at += done as u64;
        Ok(done)
    }

    /// Fills the buffer; `false` where the file ends first.
    pub(super) fn read_all(&mut self, buf: &mut [u8]) -> Result<bool, Error> {
        Ok(self.read_some(buf)? == buf.len())
    }

    /// Opcode and length of the record at a place; `None` where the file ends inside them.
    pub(super) fn head(&mut self, at: u64) -> Result<Option<(u8, u64)>, Error> {
        let mut head = [0; HEAD as usize];
        self.seek(at)?;
        if !self.read_all(&mut head)? {
            return Ok(None);
        }
        Ok(Some((head[0], le_u64(&head[1..]))))
    }

    /// Reads a record's body of a length that the caller has compared with the file's and with [`RECORD_LIMIT`].
    pub(super) fn body(&mut self, at: u64, len: u64, buf: &mut Vec<u8>) -> Result<bool, Error> {
        self.seek(at + HEAD)?;
        buf.clear();
        buf.resize(len as usize, 0);
        self.read_all(buf)
    }

    /// The head of the chunk at a place; `None` where its lengths contradict each other, as they do anywhere else in a
    /// file.
    pub(super) fn chunk_head(&mut self, at: u64) -> Result<Option<ChunkHead>, Error> {
        let mut buf = [0; CHUNK_HEAD];
        self.seek(at)?;
        let n = self.read_some(&mut buf)?;
        Ok(parse_chunk_head(&buf[..n]))
    }

    /// The next place at or after `from` where a chunk's head stands whose lengths agree: how reading goes on behind
    /// damage. By chance 64 bits of length agree with nothing.
    pub(super) fn find_chunk(&mut self, from: u64) -> Result<Option<u64>, Error> {
        const WINDOW: usize = 1 << 18;
        let mut buf = vec![0; WINDOW + CHUNK_HEAD];
        let mut base = from;
        while base < self.len {
            self.seek(base)?;
            let n = self.read_some(&mut buf)?;
            let window = &buf[..n];
            for i in (0..n.min(WINDOW)).filter(|&i| window[i] == mcap::records::op::CHUNK) {
                if parse_chunk_head(&window[i..]).is_some_and(|head| known_compression(&head.compression)) {
                    return Ok(Some(base + i as u64));
                }
            }
            base += WINDOW as u64;
        }
        Ok(None)
    }
}

pub(super) fn known_compression(name: &str) -> bool {
    matches!(name, "" | "zstd" | "lz4")
}

/// Parses opcode, length and head of a chunk; `None` where they contradict each other.
fn parse_chunk_head(bytes: &[u8]) -> Option<ChunkHead> {
    let body = bytes.get(HEAD as usize..)?;
    let len = le_u64(&bytes[1..HEAD as usize]);
    let uncompressed_size = le_u64(body.get(16..24)?);
    let uncompressed_crc = le_u32(body.get(24..28)?);
    let name_len = le_u32(body.get(28..32)?) as usize;
    let name = body.get(CHUNK_BEFORE_NAME..CHUNK_BEFORE_NAME.checked_add(name_len)?)?;
    let compressed = le_u64(body.get(CHUNK_BEFORE_NAME + name_len..)?.get(..CHUNK_AFTER_NAME)?);
    let head_len = (CHUNK_BEFORE_NAME + name_len + CHUNK_AFTER_NAME) as u64;
    if bytes[0] != mcap::records::op::CHUNK || head_len.checked_add(compressed)? != len {
        return None;
    }
    let compression = String::from_utf8_lossy(name).into_owned();
    Some(ChunkHead { len, uncompressed_size, uncompressed_crc, compression })
}

pub(super) fn le_u16(bytes: &[u8]) -> u16 {
    bytes.iter().take(2).rev().fold(0, |v, &b| v << 8 | u16::from(b))
}

pub(super) fn le_u32(bytes: &[u8]) -> u32 {
    bytes.iter().take(4).rev().fold(0, |v, &b| v << 8 | u32::from(b))
}

pub(super) fn le_u64(bytes: &[u8]) -> u64 {
    bytes.iter().take(8).rev().fold(0, |v, &b| v << 8 | u64::from(b))
}
