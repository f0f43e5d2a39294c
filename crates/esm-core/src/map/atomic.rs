//! Replacing a file in one step: readers see the old one or the new one, and a crash leaves one of the two.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::error::Error;

/// Writes a file through `body` under a temporary name in the same folder, syncs it, renames it to `path` and syncs the
/// folder. On failure the temporary file is removed and what was at `path` is untouched; a process that is killed in
/// between leaves a file `.NAME.??????.tmp` that nothing ever reads.
///
/// # Errors
/// [`Error::Io`] with what was being done; [`Error::MapFile`] where `path` is something other than a regular file,
/// which a rename would put out of the way.
pub(super) fn replace(path: &Path, body: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), Error> {
    let fail = |doing| move |source| Error::Io { path: path.to_owned(), doing, source };
    let target = resolve(path)?;
    let name = target.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let folder = match target.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let prefix = format!(".{name}.");
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As any new file, less the umask; temporary files are private by default and a map is not.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(folder).map_err(fail("creating a temporary file in its folder"))?;
    let mut out = BufWriter::with_capacity(1 << 20, file.as_file_mut());
    body(&mut out).and_then(|()| out.flush()).map_err(fail("writing it under a temporary name"))?;
    drop(out);
    file.as_file().sync_all().map_err(fail("syncing it to the disk"))?;
    file.persist(&target).map_err(|e| fail("renaming the finished file")(e.error))?;
    sync_folder(folder).map_err(fail("syncing its folder to the disk"))
}

/// Where to rename to: the path itself, or what it points to if it is a link (which then stays one).
fn resolve(path: &Path) -> Result<PathBuf, Error> {
    let fail = |doing| move |source| Error::Io { path: path.to_owned(), doing, source };
    let refuse = |what: &str| Error::MapFile {
        path: path.to_owned(),
        what: what.to_owned(),
        hint: "give the name of a file, such as MAP.esm",
    };
    if path.file_name().is_none() {
        return Err(refuse("this names no file"));
    }
    match fs::metadata(path) {
        Ok(kind) if kind.is_dir() => Err(refuse("this is a directory")),
        Ok(kind) if !kind.is_file() => Err(refuse("this is not a regular file")),
        Ok(_) => fs::canonicalize(path).map_err(fail("following its links")),
        // Nothing there yet, or not to be looked at: creating the temporary file will tell.
        Err(_) => Ok(path.to_owned()),
    }
}

#[cfg(unix)]
fn sync_folder(folder: &Path) -> io::Result<()> {
    match File::open(folder)?.sync_all() {
        // Some network file systems cannot sync a folder; the file itself is synced and renamed.
        Err(e) if matches!(e.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => Ok(()),
        other => other,
    }
}

#[cfg(not(unix))]
fn sync_folder(_folder: &Path) -> io::Result<()> {
    // Other systems have no handle of a folder that could be synced.
    Ok(())
}
