//! An opened input file: its length, and lines that cannot grow without bound.

use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};

use crate::error::{Error, HINT_INCOMPLETE};

/// Longest line accepted in a text header or a text body, bytes. Real ones are below a kilobyte.
pub(crate) const LINE_LIMIT: u64 = 64 * 1024;

/// A file, or its bytes, opened for reading from the start.
pub(crate) struct Input<R = File> {
    pub(crate) path: PathBuf,
    /// Length of the file in bytes when it was opened.
    pub(crate) len: u64,
    pub(crate) reader: BufReader<R>,
    /// Bytes taken so far.
    pub(crate) taken: u64,
    /// Number of the last line read, from 1.
    pub(crate) line: u64,
    /// Most bytes that compressed content may unpack to.
    pub(crate) unpack_limit: u64,
}

impl Input {
    pub(crate) fn open(path: &Path) -> Result<Self, Error> {
        let (file, len) = open_regular(path)?;
        Ok(Self::new(file, len, path))
    }
}

impl<'a> Input<&'a [u8]> {
    /// The bytes of a file that lies in memory; `name` stands for it in messages.
    pub(crate) fn of_bytes(bytes: &'a [u8], name: &str, unpack_limit: u64) -> Self {
        Self { unpack_limit, ..Self::new(bytes, bytes.len() as u64, Path::new(name)) }
    }
}

impl<R: Read> Input<R> {
    fn new(source: R, len: u64, path: &Path) -> Self {
        let reader = BufReader::with_capacity(1 << 16, source);
        Self { path: path.to_owned(), len, reader, taken: 0, line: 0, unpack_limit: u64::MAX }
    }

    /// An error where the file has no byte at all.
    pub(crate) fn refuse_empty(&self) -> Result<(), Error> {
        match self.len {
            0 => Err(Error::empty(&self.path, "the file is empty (0 bytes)", HINT_INCOMPLETE)),
            _ => Ok(()),
        }
    }

    /// Bytes not taken yet.
    pub(crate) fn remaining(&self) -> u64 {
        self.len.saturating_sub(self.taken)
    }

    /// Reads the next line into `buf` without its line break; `false` at the end of the file.
    pub(crate) fn next_line(&mut self, buf: &mut Vec<u8>) -> Result<bool, Error> {
        buf.clear();
        let n = (&mut self.reader)
            .take(LINE_LIMIT)
            .read_until(b'\n', buf)
            .map_err(|e| Error::io(&self.path, "reading", e))?;
        if n == 0 {
            return Ok(false);
        }
        self.taken += n as u64;
        self.line += 1;
        if buf.last() != Some(&b'\n') && n as u64 == LINE_LIMIT {
            return Err(Error::malformed(
                &self.path,
                format!("line {}", self.line),
                format!("the line is longer than {LINE_LIMIT} bytes"),
                "this does not look like text; check the file's format",
            ));
        }
        while matches!(buf.last(), Some(b'\n' | b'\r')) {
            buf.pop();
        }
        Ok(true)
    }

    /// Fills `buf`; `false` where the file ends first.
    pub(crate) fn fill(&mut self, buf: &mut [u8]) -> Result<bool, Error> {
        match self.reader.read_exact(buf) {
            Ok(()) => {
                self.taken += buf.len() as u64;
                Ok(true)
            }
            Err(e) if e.kind() == ErrorKind::UnexpectedEof => Ok(false),
            Err(e) => Err(Error::io(&self.path, "reading", e)),
        }
    }

    /// An error at the line read last.
    pub(crate) fn line_error(&self, what: impl Into<String>, hint: impl Into<String>) -> Error {
        Error::malformed(&self.path, format!("line {}", self.line), what, hint)
    }
}

/// Opens a regular file; also gives its length in bytes. What it is is looked at before: opening a named pipe waits for
/// somebody to write into it.
pub(crate) fn open_regular(path: &Path) -> Result<(File, u64), Error> {
    let refuse_others = |meta: std::fs::Metadata| {
        if meta.is_dir() {
            let what = "is a directory where a file was expected";
            return Err(Error::unsupported(path, what, "name one file inside it"));
        }
        if !meta.is_file() {
            let hint = "pipes, sockets and devices cannot be read: write the data to a file first";
            return Err(Error::unsupported(path, "this is not a regular file", hint));
        }
        Ok(meta.len())
    };
    refuse_others(std::fs::metadata(path).map_err(|e| Error::io(path, "opening", e))?)?;
    let file = File::open(path).map_err(|e| Error::io(path, "opening", e))?;
    let len = refuse_others(file.metadata().map_err(|e| Error::io(path, "reading its size", e))?)?;
    Ok((file, len))
}

/// Splits at blanks and tabs, without assuming that the rest of the line is UTF-8.
pub(crate) fn tokens(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|t| !t.is_empty())
}

/// A token as text for messages and for parsing.
pub(crate) fn text(token: &[u8]) -> std::borrow::Cow<'_, str> {
    String::from_utf8_lossy(token)
}
