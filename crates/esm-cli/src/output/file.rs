//! Files that appear whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::outcome::Failure;
use crate::signals::Unfinished;

/// A file format by its extension.
pub(crate) struct Format {
    /// With the dot: `.tum`.
    pub(crate) extension: &'static str,
}

impl Format {
    /// The one of `formats` that the path's extension names, in any case.
    ///
    /// # Errors
    /// [`Failure`] with the possible ones.
    pub(crate) fn of<'a>(path: &Path, formats: &'a [Format]) -> Result<&'a Format, Failure> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        formats.iter().find(|f| name.ends_with(f.extension) && name.len() > f.extension.len()).ok_or_else(
            || {
                let all: Vec<&str> = formats.iter().map(|f| f.extension).collect();
                Failure::new(
                    format!("{}: the extension decides the format, and this one is unknown", path.display()),
                    format!("end the name in {}", all.join(" or ")),
                )
            },
        )
    }
}

/// Checks, before any work, that a file could be written there and is not one of those that are read.
pub(crate) fn check_target(path: &Path, read: &[PathBuf]) -> anyhow::Result<()> {
    if let Ok(target) = fs::canonicalize(path)
        && read.iter().any(|r| fs::canonicalize(r).is_ok_and(|r| r == target))
    {
        let what = format!("{}: this file is read, and would be overwritten", path.display());
        return Err(Failure::new(what, "give the output another name").into());
    }
    Target::create(path).map(drop)
}

/// A file under a temporary name in the folder of its final one.
pub(crate) struct Target {
    // Gone only while finishing; dropping it removes it.
    file: Option<BufWriter<NamedTempFile>>,
    path: PathBuf,
    target: PathBuf,
    // Dropped after the file.
    _unfinished: Unfinished,
}

impl Target {
    /// Creates the temporary file.
    ///
    /// # Errors
    /// [`Failure`] where the path is no place for a file or its folder is not writable.
    pub(crate) fn create(path: &Path) -> anyhow::Result<Self> {
        let target = resolve(path)?;
        let folder = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let name = target.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let prefix = format!(".{name}.");
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(".tmp");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // As any new file, less the umask.
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let unfinished = Unfinished::begin();
        let file = builder.tempfile_in(folder).map_err(|e| {
            let hint = match e.kind() {
                io::ErrorKind::NotFound if std::env::current_dir().is_err() && target.is_relative() => {
                    "the working directory is gone: change to one that exists".to_owned()
                }
                io::ErrorKind::NotFound if !folder.exists() => {
                    format!("create the directory {} first", folder.display())
                }
                // As /proc answers, which is no place for files.
                io::ErrorKind::NotFound => {
                    format!("no files can be created in {}: choose another place", folder.display())
                }
                _ => format!("files must be writable in {}", folder.display()),
            };
            Failure::new(format!("{}: it cannot be written: {}", path.display(), plain(&e)), hint)
        })?;
        let file = BufWriter::with_capacity(1 << 16, file);
        Ok(Self { file: Some(file), path: path.to_owned(), target, _unfinished: unfinished })
    }

    /// Gives the file its final name.
    ///
    /// # Errors
    /// Where the system refuses; what was there before is then untouched.
    pub(crate) fn finish(mut self) -> anyhow::Result<()> {
        let Some(file) = self.file.take() else { return Ok(()) };
        let file = file.into_inner().map_err(|e| self.failed("writing it", &e.into_error()))?;
        file.as_file().sync_all().map_err(|e| self.failed("syncing it to the disk", &e))?;
        file.persist(&self.target).map_err(|e| self.failed("renaming the finished file", &e.error))?;
        // Not every file system can sync a folder; the file itself is whole either way.
        if let Some(folder) = self.target.parent()
            && let Ok(folder) = File::open(folder)
        {
            let _ = folder.sync_all();
        }
        Ok(())
    }

    /// The system's error of the same kind, with the file's name instead of the temporary one.
    fn failed(&self, doing: &str, error: &io::Error) -> io::Error {
        let what = format!("{}: {doing}: {}", self.path.display(), plain(error));
        io::Error::new(error.kind(), what)
    }
}

impl Write for Target {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.as_mut().map_or(Ok(0), |f| f.write(bytes));
        written.map_err(|e| self.failed("writing it", &e))
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = self.file.as_mut().map_or(Ok(()), Write::flush);
        flushed.map_err(|e| self.failed("writing it", &e))
    }
}

/// The system's words, without the temporary name that nobody typed.
pub(super) fn plain(error: &io::Error) -> String {
    let text = error.to_string();
    text.split(" at path ").next().unwrap_or(&text).to_owned()
}

/// The file to replace: the path itself, or what it links to.
fn resolve(path: &Path) -> Result<PathBuf, Failure> {
    let refuse = |what: &str| {
        Failure::new(format!("{}: {what}", path.display()), "give the name of a file to be written")
    };
    if path.file_name().is_none() {
        return Err(refuse("this names no file"));
    }
    match fs::metadata(path) {
        Ok(kind) if kind.is_dir() => Err(refuse("this is a directory")),
        Ok(kind) if !kind.is_file() => Err(refuse("this is not a regular file")),
        Ok(_) => fs::canonicalize(path).map_err(|e| refuse(&format!("its links lead nowhere: {e}"))),
        Err(_) => Ok(path.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_appears_when_it_is_finished_and_only_then() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tum");
        let mut target = Target::create(&path).unwrap();
        target.write_all(b"1 2 3\n").unwrap();
        assert!(!path.exists());
        target.finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"1 2 3\n");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn an_abandoned_file_leaves_nothing_and_keeps_the_old_one() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tum");
        fs::write(&path, "old").unwrap();
        let mut target = Target::create(&path).unwrap();
        target.write_all(b"new").unwrap();
        drop(target);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_is_read_is_not_written() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.mcap");
        fs::write(&path, "precious").unwrap();
        let error = check_target(&dir.path().join("./a.mcap"), std::slice::from_ref(&path)).unwrap_err();
        assert!(error.to_string().contains("would be overwritten"), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"precious");
    }

    #[test]
    fn places_that_cannot_hold_a_file_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        fs::write(&file, "").unwrap();
        for (path, words) in [
            (dir.path().to_owned(), "this is a directory"),
            (dir.path().join("none/a.tum"), "create the directory"),
            (file.join("a.tum"), "cannot be written"),
        ] {
            let error = check_target(&path, &[]).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
            assert!(!error.contains(".a.tum."), "no temporary name that nobody typed: {error}");
        }
    }

    #[test]
    fn formats_go_by_extension() {
        const FORMATS: &[Format] = &[Format { extension: ".tum" }, Format { extension: ".mcap" }];
        assert_eq!(Format::of(Path::new("x/A.TUM"), FORMATS).unwrap().extension, ".tum");
        for bad in ["a.txt", "a", ".tum"] {
            let error = Format::of(Path::new(bad), FORMATS).err().unwrap().to_string();
            assert!(error.ends_with("hint: end the name in .tum or .mcap"), "{error}");
        }
    }
}
