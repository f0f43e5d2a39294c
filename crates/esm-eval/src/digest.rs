//! SHA-256 of what goes into a result: two inputs with one digest are the same input.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use ring::digest::{Context, SHA256};

use crate::error::Error;

/// Bytes read at a time.
const BLOCK: usize = 1 << 20;

/// Of bytes, in hexadecimal digits.
pub(crate) fn of_bytes(bytes: &[u8]) -> String {
    hex(ring::digest::digest(&SHA256, bytes).as_ref())
}

/// Of a file's content, or of the names and contents of a directory's files in the order of their names.
pub(crate) fn of_input(path: &Path) -> Result<String, Error> {
    let mut context = Context::new(&SHA256);
    if path.is_dir() {
        for file in files_in(path)? {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            // Lengths keep a name from being taken for a part of what comes before it.
            context.update(&(name.len() as u64).to_le_bytes());
            context.update(name.as_bytes());
            let mut one = Context::new(&SHA256);
            add_file(&mut one, &file)?;
            context.update(one.finish().as_ref());
        }
    } else {
        add_file(&mut context, path)?;
    }
    Ok(hex(context.finish().as_ref()))
}

fn files_in(dir: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = std::fs::read_dir(dir).map_err(|e| Error::io(dir, "listing it", e))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| Error::io(dir, "listing it", e))?.path();
        if path.is_file() {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

fn add_file(context: &mut Context, path: &Path) -> Result<(), Error> {
    let mut file = File::open(path).map_err(|e| Error::io(path, "opening it", e))?;
    let mut block = vec![0; BLOCK];
    loop {
        match file.read(&mut block).map_err(|e| Error::io(path, "reading it", e))? {
            0 => return Ok(()),
            n => context.update(&block[..n]),
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a String cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_digest_is_sha_256() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(of_bytes(b"abc"), abc);
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("a");
        std::fs::write(&file, "abc").unwrap();
        assert_eq!(of_input(&file).unwrap(), abc);
    }

    #[test]
    fn a_directory_is_its_names_and_contents() {
        let dir = tempfile::tempdir().unwrap();
        let put = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
        put("a", "1");
        put("b", "2");
        let first = of_input(dir.path()).unwrap();
        put("b", "3");
        assert_ne!(of_input(dir.path()).unwrap(), first);
        put("b", "2");
        assert_eq!(of_input(dir.path()).unwrap(), first);
        std::fs::rename(dir.path().join("b"), dir.path().join("c")).unwrap();
        assert_ne!(of_input(dir.path()).unwrap(), first);
    }
}
