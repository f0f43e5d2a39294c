//! [`Maps`]: the maps in service by name, loaded whole, swapped in one step.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};

use axum::http::StatusCode;
use esm_core::{Config, Localizer, Map, describe};
use serde_json::{Value, json};

use crate::error::Error;
use crate::options::Options;
use crate::problem::Problem;

/// Longest name of a map, bytes.
const MAX_NAME: usize = 64;

/// A map in service. Whoever holds one goes on with it, whatever takes its name meanwhile.
pub(crate) struct LoadedMap {
    pub(crate) name: String,
    /// The file it was loaded from.
    pub(crate) file: PathBuf,
    pub(crate) map: Arc<Map>,
    pub(crate) localizer: Arc<Localizer>,
}

impl LoadedMap {
    /// What `GET /v1/maps` tells about it.
    pub(crate) fn json(&self) -> Value {
        let (map, descriptor) = (&self.map, self.map.descriptor_info());
        let (min, max) = map.bounds();
        json!({
            "name": self.name,
            "file": self.file,
            "segments": map.len(),
            "points": map.point_count(),
            "path_length_m": map.path_length_m(),
            "descriptor": {"name": descriptor.name, "version": descriptor.version, "dim": descriptor.dim},
            "bytes": map.file_size(),
            "frame_id": map.frame_id(),
            "bounds": {"min": min, "max": max},
        })
    }
}

/// The maps in service.
pub(crate) struct Maps {
    by_name: RwLock<BTreeMap<String, Arc<LoadedMap>>>,
    config: Config,
    descriptor_given: bool,
    /// Canonical folders that maps may be loaded from.
    roots: Vec<PathBuf>,
    max_bytes: u64,
    max_maps: usize,
}

impl Maps {
    /// Loads the maps the service starts with.
    pub(crate) fn load(options: &Options, maps: &[(String, PathBuf)]) -> Result<Self, Error> {
        let mut roots = Vec::new();
        for root in &options.map_roots {
            roots.push(fs::canonicalize(root).map_err(|e| Error::File {
                path: root.clone(),
                what: e.to_string(),
                hint: "name an existing folder of maps",
            })?);
        }
        let mut all = Self {
            by_name: RwLock::default(),
            config: options.config.clone(),
            descriptor_given: options.descriptor_given,
            roots: Vec::new(),
            max_bytes: options.max_map_bytes,
            max_maps: options.max_maps,
        };
        let mut by_name = BTreeMap::new();
        for (name, file) in maps {
            check_name(name).map_err(|p| Error::Options { what: p.detail, hint: p.hint })?;
            let loaded = all.open(name, file)?;
            if by_name.insert(name.clone(), Arc::new(loaded)).is_some() {
                return Err(Error::Options {
                    what: format!("two maps are called '{name}'"),
                    hint: "name them: --map NAME=MAP.esm".to_owned(),
                });
            }
            if let Some(folder) = fs::canonicalize(file).ok().as_deref().and_then(Path::parent) {
                roots.push(folder.to_owned());
            }
        }
        roots.sort();
        roots.dedup();
        all.roots = roots;
        all.by_name = RwLock::new(by_name);
        Ok(all)
    }

    /// All maps by name.
    pub(crate) fn all(&self) -> Vec<Arc<LoadedMap>> {
        self.by_name.read().unwrap_or_else(PoisonError::into_inner).values().cloned().collect()
    }

    /// The maps to search: the named one, or all.
    pub(crate) fn pick(&self, name: Option<&str>) -> Result<Vec<Arc<LoadedMap>>, Problem> {
        let maps = self.by_name.read().unwrap_or_else(PoisonError::into_inner);
        match name {
            Some(name) => match maps.get(name) {
                Some(map) => Ok(vec![Arc::clone(map)]),
                None => Err(unknown(name, &maps)),
            },
            None if maps.is_empty() => {
                Err(Problem::busy("no map is loaded", "load one: PUT /v1/maps/NAME {\"file\": \"MAP.esm\"}"))
            }
            None => Ok(maps.values().cloned().collect()),
        }
    }

    /// Loads a file under a name, in the place of what had it before; what had it stays where the file cannot be used.
    /// Takes a while: not for threads that talk.
    pub(crate) fn put(&self, name: &str, file: &Path) -> Result<Arc<LoadedMap>, Problem> {
        check_name(name)?;
        let full = |maps: &BTreeMap<String, Arc<LoadedMap>>| {
            (!maps.contains_key(name) && maps.len() >= self.max_maps).then(|| {
                let what = format!("{} maps are loaded, as many as may be", maps.len());
                Problem::new(StatusCode::CONFLICT, what, "DELETE one first")
            })
        };
        if let Some(problem) = full(&self.by_name.read().unwrap_or_else(PoisonError::into_inner)) {
            return Err(problem);
        }
        let file = self.allowed(file)?;
        let refused = |e: Error| Problem::of(StatusCode::UNPROCESSABLE_ENTITY, &e);
        let loaded = Arc::new(self.open(name, &file).map_err(refused)?);
        let mut maps = self.by_name.write().unwrap_or_else(PoisonError::into_inner);
        // Another may have taken the last place meanwhile.
        if let Some(problem) = full(&maps) {
            return Err(problem);
        }
        maps.insert(name.to_owned(), Arc::clone(&loaded));
        Ok(loaded)
    }

    /// Takes a map out of service.
    pub(crate) fn remove(&self, name: &str) -> Result<(), Problem> {
        let mut maps = self.by_name.write().unwrap_or_else(PoisonError::into_inner);
        match maps.remove(name) {
            Some(_) => Ok(()),
            None => Err(unknown(name, &maps)),
        }
    }

    /// Files of the service's own folders only: whoever may load maps may not feel around the machine for others.
    fn allowed(&self, file: &Path) -> Result<PathBuf, Problem> {
        let outside = || {
            let roots: Vec<String> = self.roots.iter().map(|r| r.display().to_string()).collect();
            let what = format!("{}: maps are loaded from {} only", file.display(), roots.join(", "));
            Problem::new(StatusCode::FORBIDDEN, what, "put it there, or start with --map-root FOLDER")
        };
        if !file.is_absolute() {
            let what = format!("{}: this is no absolute path", file.display());
            return Err(Problem::new(StatusCode::BAD_REQUEST, what, "give the file with its whole path"));
        }
        // Links are followed before the folder is looked at, as far as there is something to follow.
        let real = match fs::canonicalize(file) {
            Ok(real) => real,
            Err(_) => {
                let folder = file.parent().and_then(|p| fs::canonicalize(p).ok()).ok_or_else(outside)?;
                folder.join(file.file_name().ok_or_else(outside)?)
            }
        };
        if self.roots.iter().any(|root| real.starts_with(root)) { Ok(real) } else { Err(outside()) }
    }

    fn open(&self, name: &str, file: &Path) -> Result<LoadedMap, Error> {
        if let Ok(kind) = fs::metadata(file)
            && kind.is_file()
            && kind.len() > self.max_bytes
        {
            return Err(Error::File {
                path: file.to_owned(),
                what: format!("{} bytes are more than a map may have here ({})", kind.len(), self.max_bytes),
                hint: "raise --max-map-mb, or cut the site into several maps",
            });
        }
        let map = Arc::new(Map::load(file)?);
        let mut config = self.config.clone();
        let descriptor = &map.descriptor_info().name;
        if !self.descriptor_given && describe::NAMES.contains(&descriptor.as_str()) {
            config.descriptor.clone_from(descriptor);
        }
        // Settings of another version may not be readable; the descriptor's version is what must agree.
        if toml::from_str::<Config>(map.settings()).is_ok_and(|built| built.segment != config.segment) {
            let file = file.display().to_string();
            tracing::warn!(
                map = name,
                file,
                "the map was built with another [segment] configuration: expect fewer clouds to be located"
            );
        }
        let localizer = Arc::new(Localizer::new(Arc::clone(&map), &config)?);
        Ok(LoadedMap { name: name.to_owned(), file: file.to_owned(), map, localizer })
    }
}

fn unknown(name: &str, maps: &BTreeMap<String, Arc<LoadedMap>>) -> Problem {
    let names: Vec<&str> = maps.keys().map(String::as_str).collect();
    let hint = match names.is_empty() {
        true => "no map is loaded".to_owned(),
        false => format!("there are: {}", names.join(", ")),
    };
    let name: String = name.chars().take(MAX_NAME).flat_map(char::escape_debug).collect();
    Problem::new(StatusCode::NOT_FOUND, format!("there is no map '{name}'"), hint)
}

/// Whether a map may be called so: it stands in paths, labels and flags.
pub(crate) fn check_name(name: &str) -> Result<(), Problem> {
    let fine = (1..=MAX_NAME).contains(&name.len())
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b))
        && !name.starts_with('.');
    match fine {
        true => Ok(()),
        false => Err(Problem::new(
            StatusCode::BAD_REQUEST,
            format!(
                "'{}' cannot be the name of a map",
                name.chars().take(MAX_NAME).flat_map(char::escape_debug).collect::<String>()
            ),
            "names have 1 to 64 letters, digits, '-', '_' and '.', and do not begin with '.'",
        )),
    }
}

/// Reads `[NAME=]MAP.esm`: without a name the file's, less its extension and whatever names cannot hold.
///
/// ```
/// use esm_serve::named_map;
///
/// assert_eq!(named_map("yard=maps/a.esm"), ("yard".to_owned(), "maps/a.esm".into()));
/// assert_eq!(named_map("maps/old town.esm"), ("old-town".to_owned(), "maps/old town.esm".into()));
/// assert_eq!(named_map("/a=b/c.esm"), ("c".to_owned(), "/a=b/c.esm".into()));
/// ```
pub fn named_map(text: &str) -> (String, PathBuf) {
    if let Some((name, file)) = text.split_once('=')
        && check_name(name).is_ok()
    {
        return (name.to_owned(), file.into());
    }
    let file = PathBuf::from(text);
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '-' };
    let name: String = stem.chars().map(plain).take(MAX_NAME).collect();
    let name = name.trim_start_matches('.');
    (if name.is_empty() { "map".to_owned() } else { name.to_owned() }, file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_plain() {
        for good in ["a", "site-1", "A.b_c", &"x".repeat(64)] {
            check_name(good).unwrap();
        }
        for bad in ["", ".", "..", ".a", "a/b", "a b", "ä", "a\n", &"x".repeat(65)] {
            assert_eq!(check_name(bad).unwrap_err().status, 400, "{bad:?}");
        }
    }
}
