//! What can be said of given paths before anything is read.

use std::fs;
use std::path::{Path, PathBuf};

use crate::outcome::Failure;

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

#[cfg(test)]
mod tests {
    use super::*;

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
