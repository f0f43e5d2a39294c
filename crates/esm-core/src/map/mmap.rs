//! Mapping a file into memory: the crate's only unsafe code.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use memmap2::{Mmap, MmapMut, MmapOptions};

use super::layout::HEADER_LEN;
use super::problem::{HINT_DAMAGED, HINT_NOT_A_MAP};
use crate::error::Error;

/// Maps a whole regular file, read-only.
///
/// # Errors
/// [`Error::MapFile`] where there is no file, or something that is not a regular file, or an empty one;
/// [`Error::Io`] where the system refuses.
pub(super) fn map_file(path: &Path) -> Result<Mmap, Error> {
    let (file, len) = open_regular(path)?;
    map(&file, len).map_err(|source| Error::Io {
        path: path.to_owned(),
        doing: "mapping the file into memory",
        source,
    })
}

/// Copies a whole regular file into memory of our own: whatever happens to the file later changes nothing.
///
/// # Errors
/// As [`map_file`].
pub(super) fn copy_file(path: &Path) -> Result<Mmap, Error> {
    let (mut file, len) = open_regular(path)?;
    let io_error = |doing| move |source| Error::Io { path: path.to_owned(), doing, source };
    let mut memory = MmapMut::map_anon(len).map_err(io_error("making room for the map"))?;
    file.read_exact(&mut memory).map_err(|e| match e.kind() {
        io::ErrorKind::UnexpectedEof => Error::MapFile {
            path: path.to_owned(),
            what: "the file became shorter while it was read".to_owned(),
            hint: HINT_DAMAGED,
        },
        _ => io_error("reading the map file")(e),
    })?;
    memory.make_read_only().map_err(io_error("protecting the map's memory"))
}

/// Opens a regular file that is not empty; also gives its length.
fn open_regular(path: &Path) -> Result<(File, usize), Error> {
    let io_error = |doing| move |source| Error::Io { path: path.to_owned(), doing, source };
    let refuse = |what: &str, hint| Error::MapFile { path: path.to_owned(), what: what.to_owned(), hint };

    // Looked at before it is opened: opening a pipe would wait for a writer.
    let kind = match fs::metadata(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            return Err(refuse(
                "there is no such file",
                "build a map first: esm-cli map build INPUT... -o MAP.esm",
            ));
        }
        other => other.map_err(io_error("looking at the map file"))?,
    };
    if kind.is_dir() {
        return Err(refuse("this is a directory, not a map file", HINT_NOT_A_MAP));
    }
    if !kind.is_file() {
        return Err(refuse("this is not a regular file", HINT_NOT_A_MAP));
    }
    let file = File::open(path).map_err(io_error("opening the map file"))?;
    let len = file.metadata().map_err(io_error("looking at the map file"))?.len();
    if len == 0 {
        return Err(refuse(
            &format!("the file is empty (a map's header takes {HEADER_LEN} bytes)"),
            HINT_DAMAGED,
        ));
    }
    let len = usize::try_from(len).map_err(|_| {
        refuse(
            &format!("the file has {len} bytes, more than this machine can address"),
            "use a 64-bit machine",
        )
    })?;
    Ok((file, len))
}

#[allow(unsafe_code)]
fn map(file: &File, len: usize) -> io::Result<Mmap> {
    // SAFETY: the mapping is read-only and exactly as long as the file was a moment ago; it is only ever
    // viewed as plain numbers for which every bit pattern is valid, so bytes that change can make no invalid value.
    // What no library can rule out is another process editing the file underneath:
    // * Overwritten in place: numbers read later differ from the checksummed ones. Whatever indexes with a number from
    //   the file does so with a checked `get`, so the outcome is a wrong number or an error, not a wild access (the
    //   language itself makes no promise about memory that changes behind a shared reference).
    // * Cut shorter in place: touching a page past the new end raises SIGBUS and ends the process. A file that is
    //   already shorter than its header declares is refused when it is opened.
    // Neither happens to files written by this crate: a map is never edited in place, a new one replaces the name by
    // rename, and the mapping keeps the old file alive. Other tools must do the same (`mv`, not `cp` over a map in use).
    unsafe { MmapOptions::new().len(len).map(file) }
}
