//! [`Cache`]: results by what they were made from, so that nothing is computed twice.
//!
//! An entry's name is the digest of its key, which tells everything that goes into the result. Its first line holds the
//! digest of the rest: an entry that was torn or changed is as good as missing, and made again. Which program made it
//! stands inside: results of another build are taken only where that was asked for.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::digest;
use crate::error::Error;

/// Raised whenever what entries hold changes its meaning.
const VERSION: u32 = 1;

/// A directory of results.
pub(crate) struct Cache {
    dir: PathBuf,
    program: String,
    reuse_older: bool,
}

/// What an entry holds.
#[derive(Serialize, Deserialize)]
struct Entry {
    version: u32,
    program: String,
    /// For people who look; what counts is the name.
    key: Value,
    value: Value,
}

impl Cache {
    /// In a directory, made where it is missing. `program` names the build that computes.
    pub(crate) fn open(dir: &Path, program: &str, reuse_older: bool) -> Result<Self, Error> {
        std::fs::create_dir_all(dir).map_err(|e| Error::io(dir, "creating the directory", e))?;
        Ok(Self { dir: dir.to_owned(), program: program.to_owned(), reuse_older })
    }

    /// Where a file for this key belongs.
    pub(crate) fn path(&self, key: &Value, extension: &str) -> PathBuf {
        self.dir.join(format!("{}.{extension}", digest::of_bytes(key.to_string().as_bytes())))
    }

    /// The result for a key; `None` where there is none that is whole and may be used.
    pub(crate) fn get<T: DeserializeOwned>(&self, key: &Value) -> Option<T> {
        let path = self.path(key, "json");
        let text = std::fs::read_to_string(&path).ok()?;
        let whole = text
            .split_once('\n')
            .filter(|(sum, body)| *sum == digest::of_bytes(body.as_bytes()))
            .and_then(|(_, body)| serde_json::from_str::<Entry>(body).ok());
        let Some(entry) = whole else {
            tracing::warn!("{}: a damaged result, which is made again", path.display());
            // Said once. Where it cannot be removed it will be replaced.
            let _ = std::fs::remove_file(&path);
            return None;
        };
        let usable = entry.version == VERSION && (self.reuse_older || entry.program == self.program);
        // Numbers of the key may have lost their last bit on the way through the text: the name has all of it.
        usable.then(|| serde_json::from_value(entry.value).ok()).flatten()
    }

    /// The result for a key, and whether it was there; where it was not, `make` makes it.
    pub(crate) fn get_or<T: DeserializeOwned + Serialize>(
        &self,
        key: &Value,
        make: impl FnOnce() -> Result<T, Error>,
    ) -> Result<(T, bool), Error> {
        if let Some(kept) = self.get(key) {
            return Ok((kept, true));
        }
        let made = make()?;
        self.put(key, &made)?;
        // Through the text in any case: a number that is read may differ in its last bit from the one that was written, and
        // the second run is to tell what the first one told.
        Ok((self.get(key).unwrap_or(made), false))
    }

    /// Keeps a result, whole or not at all.
    pub(crate) fn put<T: Serialize>(&self, key: &Value, value: &T) -> Result<(), Error> {
        let path = self.path(key, "json");
        let odd = |e: serde_json::Error| Error::io(&path, "writing it", e.into());
        let value = serde_json::to_value(value).map_err(odd)?;
        let entry = Entry { version: VERSION, program: self.program.clone(), key: key.clone(), value };
        let body = serde_json::to_string(&entry).map_err(odd)?;
        let text = format!("{}\n{body}", digest::of_bytes(body.as_bytes()));
        Ok(esm_io::write_file(&path, text.as_bytes())?)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn what_was_put_is_got_by_its_key_and_its_program() {
        let dir = tempfile::tempdir().unwrap();
        let cache = Cache::open(dir.path(), "a", false).unwrap();
        let key = json!({"map": "x", "n": 1});
        assert_eq!(cache.get::<Vec<f64>>(&key), None);
        cache.put(&key, &vec![0.1, 2.0]).unwrap();
        assert_eq!(cache.get::<Vec<f64>>(&key), Some(vec![0.1, 2.0]));
        assert_eq!(cache.get::<Vec<f64>>(&json!({"map": "x", "n": 2})), None);
        assert_eq!(Cache::open(dir.path(), "b", false).unwrap().get::<Vec<f64>>(&key), None);
        assert!(Cache::open(dir.path(), "b", true).unwrap().get::<Vec<f64>>(&key).is_some());
    }

    #[test]
    fn a_damaged_entry_is_as_good_as_missing() {
        let dir = tempfile::tempdir().unwrap();
        let cache = Cache::open(dir.path(), "a", false).unwrap();
        let key = json!("k");
        cache.put(&key, &12345).unwrap();
        let path = cache.path(&key, "json");
        let whole = std::fs::read(&path).unwrap();
        for at in 0..whole.len() {
            std::fs::write(&path, &whole[..at]).unwrap();
            assert_eq!(cache.get::<i32>(&key), None, "cut at {at}");
            let mut flipped = whole.clone();
            flipped[at] ^= 1;
            std::fs::write(&path, &flipped).unwrap();
            assert_eq!(cache.get::<i32>(&key), None, "flipped at {at}");
        }
        std::fs::write(&path, &whole).unwrap();
        assert_eq!(cache.get::<i32>(&key), Some(12345));
    }
}
