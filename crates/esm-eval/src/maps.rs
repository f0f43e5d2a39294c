//! Maps: built once for each site and method, kept in the cache, and thinned for the modes that want it.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use esm_core::map::MapData;
use esm_core::{Config, Map, MapBuilder};
use esm_io::InputKind;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::cache::Cache;
use crate::digest;
use crate::error::Error;
use crate::memory;
use crate::method::Model;
use crate::site::Site;
use crate::watch::Teller;

/// What is kept about a map beside its file.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Kept {
    /// Of the file: one that was cut or changed is made again.
    digest: String,
    built_s: f64,
    peak_mib: Option<f64>,
}

/// A map that is there.
pub(crate) struct Built {
    pub(crate) map: Arc<Map>,
    pub(crate) built_s: f64,
    /// Highest memory while it was built.
    pub(crate) peak_mib: Option<f64>,
}

/// What a map is made from.
pub(crate) fn key(site: &Site, config: &Config, model: &Model) -> Value {
    // The path of a weights file says nothing that the digest of its content does not.
    let settings = Config { descriptor: String::new(), ..config.clone() };
    json!({ "kind": "map", "inputs": site.map_digest, "descriptor": model.digest, "config": settings })
}

/// What a map with a share of its segments left out is made from.
pub(crate) fn thinned_key(whole: &Value, share: f64, seed: u64) -> Value {
    json!({ "kind": "thinned map", "of": digest::of_bytes(whole.to_string().as_bytes()), "share": share, "seed": seed })
}

/// The map for a key, from the cache or made by `make`.
pub(crate) fn get(
    cache: &Cache,
    key: &Value,
    make: impl FnOnce() -> Result<Map, Error>,
) -> Result<Built, Error> {
    let path = cache.path(key, "esm");
    let kept: Option<Kept> =
        cache.get(key).filter(|k: &Kept| digest::of_input(&path).is_ok_and(|d| d == k.digest));
    let kept = match kept {
        Some(kept) => kept,
        None => {
            memory::reset_peak();
            let started = Instant::now();
            let map = make()?;
            let built_s = started.elapsed().as_secs_f64();
            map.write(&path).map_err(Error::core("keeping a map"))?;
            let kept = Kept { digest: digest::of_input(&path)?, built_s, peak_mib: memory::peak_mib() };
            cache.put(key, &kept)?;
            kept
        }
    };
    let map = Map::open(&path).map_err(Error::core("a kept map"))?;
    Ok(Built { map: Arc::new(map), built_s: kept.built_s, peak_mib: kept.peak_mib })
}

/// Where the map for a key lies.
pub(crate) fn path(cache: &Cache, key: &Value) -> PathBuf {
    cache.path(key, "esm")
}

/// Builds the map of a site.
pub(crate) fn build(
    site: &Site,
    config: &Config,
    model: &Model,
    words: &str,
    teller: &mut Teller<'_, '_>,
) -> Result<Map, Error> {
    let failed = || Error::core(words);
    let source = site.files.map.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut builder = MapBuilder::with_descriptor(config, Arc::clone(&model.descriptor)).map_err(failed())?;
    builder.set_source(&source);
    if esm_io::classify(&site.files.map)? == InputKind::PriorCloud && site.files.map_poses.is_none() {
        teller.begins(format!("mapping {words}"), None)?;
        let prior = esm_io::read_prior_cloud(&site.files.map)?;
        builder.push_prior_cloud(prior.origin, &prior.cloud).map_err(failed())?;
    } else {
        let recording = site.open_map(false)?;
        teller.begins(format!("mapping {words}"), recording.sweep_count_hint())?;
        let mut posed = 0;
        for sweep in recording.sweeps()? {
            let sweep = sweep?;
            teller.step()?;
            let Some(pose_map_sensor) = sweep.pose_odom_sensor else { continue };
            builder.push_sweep(sweep.stamp, &sweep.cloud, &pose_map_sensor).map_err(failed())?;
            posed += 1;
        }
        if posed == 0 {
            let hint = "the poses must cover the time of the scans; compare their stamps";
            return Err(Error::input(&site.files.map, "no scan has a pose", hint));
        }
    }
    builder.finish().map_err(failed())
}

/// The map without a share of its segments, drawn by a seed. Their points stay: what stands there is still seen when a place
/// is verified, but nothing can be matched with it.
pub(crate) fn thinned(map: &Map, share: f64, seed: u64) -> Result<Map, Error> {
    let failed = || Error::core("a map without some of its segments");
    let mut order: Vec<usize> = (0..map.len()).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for i in (1..order.len()).rev() {
        order.swap(i, rng.random_range(0..=i));
    }
    // A map without any segment is none.
    let mut keep = order.split_off(((share * map.len() as f64).round() as usize).min(map.len() - 1));
    keep.sort_unstable();
    let mut data = MapData::new(map.origin(), map.descriptor_info().clone());
    data.frame_id = map.frame_id().to_owned();
    data.standardizer = map.standardizer().cloned();
    let dim = map.descriptor_info().dim as usize;
    for &i in &keep {
        let points = map.segment_points(i).map_err(failed())?;
        if let Some(segment) = esm_core::segment::Segment::from_points(points) {
            let record = map.segments()[i];
            data.push_segment(&segment, record.observations).map_err(failed())?;
            // As it was measured before the points were rounded.
            if let Some(kept) = data.segments.last_mut() {
                *kept = record;
            }
            data.descriptors.extend_from_slice(&map.descriptors()[i * dim..(i + 1) * dim]);
            data.quality.push(map.quality()[i]);
        }
    }
    let mut points = Vec::new();
    for tile in 0..map.ground_tiles().len() {
        map.ground_tile_points_into(tile, &mut points).map_err(failed())?;
        data.push_ground_tile(&points).map_err(failed())?;
    }
    for tile in 0..map.structure_tiles().len() {
        map.structure_tile_points_into(tile, &mut points).map_err(failed())?;
        data.push_structure_tile(&points).map_err(failed())?;
    }
    data.path = map.path().to_vec();
    data.coverage = map.coverage().to_vec();
    data.settings = map.settings().to_owned();
    data.source = map.source().to_owned();
    Map::from_data(data).map_err(failed())
}
