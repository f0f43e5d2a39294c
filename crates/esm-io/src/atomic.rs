//! Files that appear whole or not at all.

use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::error::Error;

/// A file under a temporary name beside its target; [`commit`](Self::commit) syncs it and moves it there.
/// Dropped before that, it leaves nothing behind, unless it was made to.
pub(crate) struct AtomicFile {
    target: PathBuf,
    file: BufWriter<NamedTempFile>,
}

impl AtomicFile {
    pub(crate) fn create(target: &Path) -> Result<Self, Error> {
        let mut builder = tempfile::Builder::new();
        Self::build(target, builder.prefix(".esm-").suffix(".part"))
    }

    /// Under a name of its own beside the target, which stays with what was written when this is dropped. What has that
    /// name already is replaced.
    pub(crate) fn create_lasting(target: &Path, name: &str) -> Result<Self, Error> {
        match std::fs::remove_file(target.with_file_name(name)) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(Error::io(target, "creating", e)),
            _ => {}
        }
        let mut builder = tempfile::Builder::new();
        Self::build(target, builder.prefix(name).rand_bytes(0).disable_cleanup(true))
    }

    fn build(target: &Path, builder: &mut tempfile::Builder<'_, '_>) -> Result<Self, Error> {
        let directory = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        // The result gets the permissions of any new file, not the private ones of a temporary file.
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let file =
            builder.tempfile_in(directory).map_err(|e| Error::io(target, "creating", e.kind().into()))?;
        Ok(Self { target: target.to_owned(), file: BufWriter::new(file) })
    }

    pub(crate) fn commit(self) -> Result<(), Error> {
        let target = self.target;
        let file = self.file.into_inner().map_err(|e| Error::io(&target, "writing", e.into_error()))?;
        file.as_file().sync_all().map_err(|e| Error::io(&target, "writing", e))?;
        file.persist(&target).map_err(|e| Error::io(&target, "moving it into place", e.error))?;
        Ok(())
    }
}

/// Writes a file that appears whole or not at all.
///
/// # Errors
/// [`Error::Io`].
pub fn write_file(path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), Error> {
    let path = path.as_ref();
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes).map_err(|e| Error::io(path, "writing", e))?;
    file.commit()
}

impl Write for AtomicFile {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        self.file.write(buf)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, pos: io::SeekFrom) -> io::Result<u64> {
        self.file.seek(pos)
    }
}
