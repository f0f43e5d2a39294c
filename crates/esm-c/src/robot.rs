//! A robot: sweeps and their motion in, answers out.

use std::path::Path;
use std::sync::Arc;

use esm_core::describe;
use esm_core::map::Map;
use esm_core::{Accumulator, Config, Error, Localization, Localizer, PointCloud, Pose, SequenceLocalizer};

/// What can go wrong, in words for the one who called.
pub type Failure = String;

/// A robot in a map: it keeps the last metres of travel and what it believes of its place.
pub struct Robot {
    accumulator: Accumulator,
    localizer: SequenceLocalizer,
}

/// Opens a map.
///
/// # Errors
/// The core's, which names the file, the place in it and what to do.
pub fn open(file: &Path) -> Result<Arc<Map>, Failure> {
    Map::open(file).map(Arc::new).map_err(words)
}

impl Robot {
    /// A robot that may be anywhere in the map. `settings` is TOML as `esm-cli config` prints it, or empty; the descriptor is
    /// the map's unless the settings name one.
    ///
    /// # Errors
    /// For settings that are no TOML, unknown or out of range, and for a descriptor that is not the map's.
    pub fn new(map: Arc<Map>, settings: &str) -> Result<Self, Failure> {
        let mut config: Config = toml::from_str(settings).map_err(|e| format!("settings: {e}"))?;
        let named = settings.parse::<toml::Table>().is_ok_and(|t| t.contains_key("descriptor"));
        let of_map = &map.descriptor_info().name;
        if !named && describe::NAMES.contains(&of_map.as_str()) {
            config.descriptor.clone_from(of_map);
        }
        Ok(Self {
            accumulator: Accumulator::new(config.accumulate.clone()).map_err(words)?,
            localizer: SequenceLocalizer::new(Localizer::new(map, &config).map_err(words)?),
        })
    }

    /// Takes the next sweep, points in the sensor frame, and finds the cloud that ends with it; `None` while a swathe is not
    /// complete. Points that are not finite are dropped; how many is the second answer.
    ///
    /// # Errors
    /// Where points of the map that are needed turn out to be damaged.
    pub fn push(
        &mut self,
        stamp: f64,
        points_sensor: Vec<[f32; 3]>,
        pose_odom_sensor: Option<Pose>,
    ) -> Result<(Option<Localization>, usize), Failure> {
        let (sweep, dropped) = PointCloud::from_finite(points_sensor);
        let Some(live) = self.accumulator.push(stamp, &sweep, pose_odom_sensor) else {
            return Ok((None, dropped));
        };
        Ok((Some(self.localizer.localize(&live).map_err(words)?), dropped))
    }

    /// Forgets where the robot was and what it saw last: after a gap, or when it was carried elsewhere.
    pub fn forget(&mut self) {
        self.localizer.forget();
        self.accumulator.clear();
    }
}

fn words(error: Error) -> Failure {
    error.to_string()
}
