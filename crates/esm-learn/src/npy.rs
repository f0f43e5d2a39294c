//! A NumPy array file that grows row by row (NEP 1): a header of fixed length whose row count is patched at the end.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::error::Error;

/// Bytes before the numbers.
const HEADER: usize = 128;

pub(crate) struct NpyWriter {
    file: BufWriter<File>,
    path: PathBuf,
    descr: &'static str,
    columns: Option<usize>,
    rows: u64,
}

impl NpyWriter {
    /// Creates the file; `descr` is NumPy's name of the number type, `columns` the second dimension, if any.
    pub(crate) fn create(path: PathBuf, descr: &'static str, columns: Option<usize>) -> Result<Self, Error> {
        let file = File::create(&path).map_err(io(&path, "creating"))?;
        let mut writer = Self { file: BufWriter::new(file), path, descr, columns, rows: 0 };
        writer.header()?;
        Ok(writer)
    }

    /// Appends the bytes of `rows` rows, little-endian.
    pub(crate) fn push(&mut self, bytes: &[u8], rows: u64) -> Result<(), Error> {
        self.rows += rows;
        self.file.write_all(bytes).map_err(io(&self.path, "writing"))
    }

    /// Patches the row count, and sees the file on the disk.
    pub(crate) fn finish(mut self) -> Result<u64, Error> {
        self.file.seek(SeekFrom::Start(0)).map_err(io(&self.path, "writing"))?;
        self.header()?;
        self.file.flush().map_err(io(&self.path, "writing"))?;
        self.file.get_ref().sync_all().map_err(io(&self.path, "writing"))?;
        Ok(self.rows)
    }

    fn header(&mut self) -> Result<(), Error> {
        let shape = match self.columns {
            Some(columns) => format!("({}, {columns})", self.rows),
            None => format!("({},)", self.rows),
        };
        let text = format!("{{'descr': '{}', 'fortran_order': False, 'shape': {shape}, }}", self.descr);
        let mut header = b"\x93NUMPY\x01\x00".to_vec();
        header.extend((HEADER as u16 - 10).to_le_bytes());
        header.extend(text.as_bytes());
        header.resize(HEADER - 1, b' ');
        header.push(b'\n');
        self.file.write_all(&header).map_err(io(&self.path, "writing"))
    }
}

/// Wraps an error of the system.
pub(crate) fn io(path: &Path, doing: &'static str) -> impl FnOnce(std::io::Error) -> Error {
    let path = path.to_owned();
    move |source| Error::Io {
        path,
        doing,
        source,
        hint: "is there room on the disk, and may you write there?",
    }
}
