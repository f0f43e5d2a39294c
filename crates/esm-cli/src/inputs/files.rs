//! What can be said of given paths before anything is read.

use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use crate::outcome::Failure;

/// Most names in one message.
const MAX_NAMES: usize = 4;

/// The paths as given, as messages name them; of many only the first ones.
pub(crate) fn paths(inputs: &[PathBuf]) -> String {
    let mut names: Vec<String> = inputs.iter().take(MAX_NAMES).map(|p| p.display().to_string()).collect();
    if inputs.len() > MAX_NAMES {
        names.push(format!("and {} more", inputs.len() - MAX_NAMES));
    }
    names.join(", ")
}

/// Refuses an input that is given twice, under whatever name: its scans would count twice.
pub(crate) fn check_distinct(inputs: &[PathBuf]) -> Result<(), Failure> {
    let mut seen: Vec<(PathBuf, &Path)> = Vec::with_capacity(inputs.len());
    for path in inputs {
        // What cannot be found is told by whoever opens it.
        let Ok(real) = fs::canonicalize(path) else { continue };
        if let Some((_, first)) = seen.iter().find(|(other, _)| *other == real) {
            let what = match *first == path.as_path() {
                true => format!("{}: this input is given twice", path.display()),
                false => format!("{}: this is the same input as {}", path.display(), first.display()),
            };
            return Err(Failure::new(what, "give every input once"));
        }
        seen.push((real, path));
    }
    Ok(())
}

/// Refuses what is there and is no regular file: opening a named pipe waits for a writer that may never come.
pub(crate) fn check_regular(path: &Path) -> Result<(), Failure> {
    let what = match fs::metadata(path) {
        Ok(kind) if kind.is_dir() => "this is a directory, not a regular file",
        Ok(kind) if !kind.is_file() => "this is not a regular file",
        // What is not there is told by whoever opens it.
        _ => return Ok(()),
    };
    Err(Failure::new(format!("{}: {what}", path.display()), "give the name of a file"))
}

/// Reads a text that cannot be long, whole.
///
/// # Errors
/// [`Failure`] with `hint` where it is more than `limit` bytes, is no UTF-8 or cannot be read.
pub(crate) fn read_text(path: &Path, limit: u64, too_long: &str, hint: &str) -> Result<String, Failure> {
    check_regular(path)?;
    let failed = |what: String| Failure::new(format!("{}: {what}", path.display()), hint);
    let mut text = String::new();
    let read = fs::File::open(path).and_then(|file| file.take(limit + 1).read_to_string(&mut text));
    match read {
        Ok(n) if n as u64 > limit => Err(failed(too_long.to_owned())),
        Ok(_) => Ok(text),
        // The limit may have cut a character in two.
        Err(e) if e.kind() == io::ErrorKind::InvalidData && longer(path, limit) => {
            Err(failed(too_long.to_owned()))
        }
        Err(e) => Err(failed(format!("reading it: {e}"))),
    }
}

fn longer(path: &Path, limit: u64) -> bool {
    fs::metadata(path).is_ok_and(|m| m.len() > limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_are_not_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.toml");
        let read = |text: &[u8]| {
            fs::write(&path, text).unwrap();
            read_text(&path, 8, "too long", "a hint").map_err(|e| e.to_string())
        };
        assert_eq!(read(b"12345678"), Ok("12345678".to_owned()));
        let error = Err(format!("{}: too long\nhint: a hint", path.display()));
        assert_eq!(read(b"123456789"), error);
        assert_eq!(read("1234567°°".as_bytes()), error, "also cut within a character");
        assert!(read(b"\xff").unwrap_err().contains("reading it: "));
        let error = read_text(dir.path(), 8, "too long", "a hint").unwrap_err().to_string();
        assert!(error.contains("this is a directory"), "{error}");
    }

    #[test]
    fn many_paths_are_not_all_named() {
        let all: Vec<PathBuf> = (1..=6).map(|i| PathBuf::from(format!("d/{i}.pcd"))).collect();
        assert_eq!(paths(&all[..2]), "d/1.pcd, d/2.pcd");
        assert_eq!(paths(&all), "d/1.pcd, d/2.pcd, d/3.pcd, d/4.pcd, and 2 more");
    }

    #[test]
    fn an_input_given_twice_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let (a, b) = (dir.path().join("a.pcd"), dir.path().join("b.pcd"));
        fs::write(&a, "").unwrap();
        fs::write(&b, "").unwrap();
        check_distinct(&[a.clone(), b.clone(), dir.path().join("none")]).unwrap();
        let error = check_distinct(&[a.clone(), b, a.clone()]).unwrap_err().to_string();
        assert_eq!(error, format!("{}: this input is given twice\nhint: give every input once", a.display()));
    }

    #[cfg(unix)]
    #[test]
    fn a_link_is_the_same_input() {
        let dir = tempfile::tempdir().unwrap();
        let (a, link) = (dir.path().join("a.pcd"), dir.path().join("link.pcd"));
        fs::write(&a, "").unwrap();
        std::os::unix::fs::symlink(&a, &link).unwrap();
        let error = check_distinct(&[a.clone(), link.clone()]).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{}: this is the same input as {}", link.display(), a.display())));
    }
}
