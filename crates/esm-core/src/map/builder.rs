//! [`MapBuilder`]: a map from a posed recording (overlapping windows, duplicates merged) or from one prior cloud.

use std::collections::BTreeMap;
use std::sync::Arc;

use rustc_hash::{FxHashMap, FxHashSet};
use serde::{Deserialize, Serialize};

use super::Map;
use super::data::{DescriptorInfo, MapData};
use super::records::COVERAGE_CELL_M;
use super::standardizer::Standardizer;
use crate::accumulate::{AccumulateConfig, Accumulator, LiveCloud};
use crate::cloud::{PointCloud, Pose, transform_point};
use crate::config::Config;
use crate::describe::{self, Descriptor};
use crate::error::{Error, require};
use crate::segment::{Segment, Segmentation, segment};

/// Configuration of the map builder.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct BuildConfig {
    /// Metres of travel from one window to the next; each window is an accumulated cloud.
    pub window_step_m: f64,
    /// Besides windows of `accumulate.distance_m`, the map holds windows of these shorter lengths, metres; 0: single sweeps.
    /// Clouds that hold less travel see less of things, and find them where they were mapped so. Longer ones than
    /// `accumulate.distance_m` are left out.
    pub short_windows_m: Vec<f64>,
    /// Metres of travel from one of those to the next.
    pub short_step_m: f64,
    /// A segment and an older one are the same object, seen the same way, when their voxels overlap by at least this
    /// (intersection over union); the fuller one stays. Above 1 nothing is merged.
    pub merge_overlap: f64,
    /// The ground is kept at one point a voxel of this edge, metres.
    pub ground_voxel_m: f64,
    /// What stands on the ground is kept, for verification, at one point a voxel of this edge, metres.
    pub structure_voxel_m: f64,
    /// A prior cloud is cut into overlapping discs of this radius, metres, about as far as a live cloud reaches.
    pub disc_radius_m: f64,
}

impl Default for BuildConfig {
    fn default() -> Self {
        Self {
            window_step_m: 5.0,
            short_windows_m: vec![6.0, 0.0],
            short_step_m: 2.0,
            merge_overlap: 0.6,
            ground_voxel_m: 0.4,
            structure_voxel_m: 0.25,
            disc_radius_m: 30.0,
        }
    }
}

impl BuildConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field outside its range.
    pub fn check(&self) -> Result<(), Error> {
        require(self.window_step_m >= 0.0, "map.window_step_m", self.window_step_m, "0 m or more")?;
        let short = |m: &f64| (0.0..=1000.0).contains(m);
        let list = format!("{:?}", self.short_windows_m);
        let few = self.short_windows_m.len() <= MOST_WINDOWS && self.short_windows_m.iter().all(short);
        require(few, "map.short_windows_m", list, "up to 8 lengths of 0 to 1000 m")?;
        require(self.short_step_m >= 0.0, "map.short_step_m", self.short_step_m, "0 m or more")?;
        require(self.merge_overlap > 0.0, "map.merge_overlap", self.merge_overlap, "more than 0")?;
        require(
            (0.05..=10.0).contains(&self.ground_voxel_m),
            "map.ground_voxel_m",
            self.ground_voxel_m,
            "0.05 to 10 m",
        )?;
        require(
            (0.05..=10.0).contains(&self.structure_voxel_m),
            "map.structure_voxel_m",
            self.structure_voxel_m,
            "0.05 to 10 m",
        )?;
        require(
            (5.0..=1000.0).contains(&self.disc_radius_m),
            "map.disc_radius_m",
            self.disc_radius_m,
            "5 to 1000 m",
        )
    }
}

/// Lengths of windows in one map.
const MOST_WINDOWS: usize = 8;
/// Edge of the voxels that decide whether two segments overlap, metres: wider than the jumps of a good odometry are
/// large, so that one object seen twice overlaps itself.
const OVERLAP_VOXEL_M: f32 = 0.5;
/// Edge of the tiles that ground and structure are stored in, metres.
pub(crate) const TILE_M: f32 = 10.0;
/// The mapped path is kept at this spacing, metres.
const PATH_STEP_M: f64 = 0.5;

type Voxel = [i32; 3];

/// Points thinned by voxels, by tile, in the order they came.
struct Tiles {
    voxel_m: f32,
    taken: FxHashSet<Voxel>,
    points: BTreeMap<[i32; 2], Vec<[f32; 3]>>,
}

impl Tiles {
    fn new(voxel_m: f64) -> Self {
        Self { voxel_m: voxel_m as f32, taken: FxHashSet::default(), points: BTreeMap::new() }
    }

    /// The first point of a voxel stays.
    fn extend(&mut self, points: impl Iterator<Item = [f32; 3]>) {
        for p in points {
            if self.taken.insert(voxel(p, self.voxel_m)) {
                self.points.entry(tile_of(p)).or_default().push(p);
            }
        }
    }
}

/// The tile of [`MapData::ground_tiles`] and [`MapData::structure_tiles`] that a point lies in.
pub(crate) fn tile_of(p: [f32; 3]) -> [i32; 2] {
    [(p[0] / TILE_M).floor() as i32, (p[1] / TILE_M).floor() as i32]
}

/// One object of the growing map.
#[derive(Clone)]
struct Entry {
    layer: usize,
    segment: Segment,
    voxels: Vec<Voxel>,
    row: Vec<f32>,
    quality: f32,
    observations: u32,
}

/// Builds a map window by window.
pub struct MapBuilder {
    config: Config,
    descriptor: Arc<dyn Descriptor>,
    origin: Option<[f64; 3]>,
    entries: Vec<Entry>,
    by_voxel: FxHashMap<Voxel, Vec<u32>>,
    ground: Tiles,
    structure: Tiles,
    path: Vec<[f64; 3]>,
    coverage: FxHashSet<[i32; 2]>,
    accumulators: Vec<Accumulator>,
    /// Where the last window of each length was taken.
    last_windows: Vec<Option<[f64; 3]>>,
    source: String,
}

impl MapBuilder {
    /// An empty map to be.
    ///
    /// # Errors
    /// [`Error::Config`].
    pub fn new(config: &Config) -> Result<Self, Error> {
        Self::with_descriptor(config, describe::by_name(&config.descriptor)?)
    }

    /// The same with a descriptor of your own, such as [`XConv`](crate::describe::XConv) with weights you trained, in the
    /// place of the configured one.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use esm_core::segment::Segment;
    /// use esm_core::{Config, Descriptions, Descriptor, Error, Localizer, MapBuilder, PointCloud};
    ///
    /// struct Height;
    ///
    /// impl Descriptor for Height {
    ///     fn name(&self) -> &'static str {
    ///         "height"
    ///     }
    ///     fn version(&self) -> u32 {
    ///         1
    ///     }
    ///     fn dim(&self) -> usize {
    ///         1
    ///     }
    ///     fn describe(&self, segments: &[Segment]) -> Descriptions {
    ///         let values = segments.iter().map(|s| s.max[2] - s.min[2]).collect();
    ///         Descriptions { dim: 1, values, quality: vec![1.0; segments.len()], ..Default::default() }
    ///     }
    /// }
    ///
    /// let config = Config::default();
    /// let mut builder = MapBuilder::with_descriptor(&config, Arc::new(Height))?;
    /// # let floor = (0..10_000).map(|i| [(i % 100) as f32 * 0.2, (i / 100) as f32 * 0.2, 0.0]);
    /// # let column = (0..360).map(|i| [10.0 + (i % 6) as f32 * 0.2, 10.0 + (i / 6 % 6) as f32 * 0.2, (i / 36) as f32 * 0.2]);
    /// # let site = PointCloud::try_new(floor.chain(column).collect())?;
    /// builder.push_prior_cloud([0.0; 3], &site)?;
    /// let map = Arc::new(builder.finish()?);
    /// assert_eq!(map.descriptor_info().name, "height");
    /// assert!((map.descriptor(0)[0] - 1.5).abs() < 0.4);
    /// // Such a map is searched with the same descriptor, and with no other.
    /// assert!(Localizer::with_descriptor(Arc::clone(&map), &config, Arc::new(Height)).is_ok());
    /// assert!(matches!(Localizer::new(map, &config), Err(Error::DescriptorMismatch { .. })));
    /// # Ok::<(), Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Config`].
    pub fn with_descriptor(config: &Config, descriptor: Arc<dyn Descriptor>) -> Result<Self, Error> {
        config.check()?;
        Ok(Self {
            config: Config { descriptor: descriptor.name().to_owned(), ..config.clone() },
            descriptor,
            origin: None,
            entries: Vec::new(),
            by_voxel: FxHashMap::default(),
            ground: Tiles::new(config.map.ground_voxel_m),
            structure: Tiles::new(config.map.structure_voxel_m),
            path: Vec::new(),
            coverage: FxHashSet::default(),
            accumulators: accumulators(config)?,
            last_windows: vec![None; lengths(config).count()],
            source: String::new(),
        })
    }

    /// Names what the map is built from, for `map info`: a file name without its folder.
    pub fn set_source(&mut self, source: &str) {
        self.source = source.to_owned();
    }

    /// Segments so far.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there is no segment yet.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Takes the next sweep of the recording (points in the sensor frame) and where it was taken: windows of all lengths are
    /// accumulated and pushed.
    ///
    /// # Errors
    /// As [`MapBuilder::push`].
    pub fn push_sweep(
        &mut self,
        stamp: f64,
        sweep: &PointCloud,
        pose_map_sensor: &Pose,
    ) -> Result<(), Error> {
        let clouds: Vec<LiveCloud> = self
            .accumulators
            .iter_mut()
            .filter_map(|a| a.push(stamp, sweep, Some(*pose_map_sensor)))
            .collect();
        clouds.iter().try_for_each(|live| self.push(live, pose_map_sensor).map(|_| ()))
    }

    /// The next sweep does not continue the last one: another recording, or a gap.
    ///
    /// # Errors
    /// None: the configuration has been checked.
    pub fn interrupt(&mut self) -> Result<(), Error> {
        self.accumulators = accumulators(&self.config)?;
        Ok(())
    }

    /// Takes the next accumulated cloud of the recording and where it was taken. Only one every `window_step_m` (of those
    /// shorter than `accumulate.distance_m`, every `short_step_m`) is cut into segments; all count for the path. Says whether
    /// this one was. Clouds of several lengths may come in any order; what they show is merged with clouds of the same length
    /// only.
    ///
    /// # Errors
    /// None today beyond those of a damaged configuration; the result is checked in [`MapBuilder::finish`].
    pub fn push(&mut self, live: &LiveCloud, pose_map_sensor: &Pose) -> Result<bool, Error> {
        let at: [f64; 3] = pose_map_sensor.translation.vector.into();
        if self.path.last().is_none_or(|last| distance(*last, at) >= PATH_STEP_M) {
            self.path.push(at);
        }
        let Some(layer) = self.layer(live.distance_m, at) else { return Ok(false) };
        let pose_origin_sensor = self.relative(pose_map_sensor);
        let cloud = segment(&live.cloud, &self.config.segment);
        self.add(&cloud, &pose_origin_sensor, layer);
        Ok(true)
    }

    /// Takes one prior cloud whose points are relative to `origin` (metres, map frame). There is no path; the map
    /// covers the cells that hold points.
    ///
    /// # Errors
    /// As [`MapBuilder::push`].
    pub fn push_prior_cloud(&mut self, origin: [f64; 3], cloud: &PointCloud) -> Result<(), Error> {
        self.origin = Some(origin);
        self.coverage.extend(cloud.points().iter().map(|p| coverage_cell(absolute(origin, *p))));
        for disc in discs(cloud.points(), self.config.map.disc_radius_m as f32) {
            let cut = segment(&PointCloud::from_finite(disc).0, &self.config.segment);
            self.add(&cut, &Pose::identity(), 0);
        }
        Ok(())
    }

    /// The map as it stands.
    ///
    /// # Errors
    /// [`Error::EmptyMap`] without a single segment; [`Error::MapData`] where coordinates are beyond what a map holds.
    pub fn finish(&self) -> Result<Map, Error> {
        if self.entries.is_empty() {
            return Err(Error::EmptyMap {
                hint: "is the ground removed right (segment.ground), are the clouds dense enough (segment.min_points)?",
            });
        }
        let dim = self.descriptor.dim();
        let info = DescriptorInfo {
            name: self.descriptor.name().to_owned(),
            version: self.descriptor.version(),
            dim: dim as u32,
        };
        let mut data = MapData::new(self.origin.unwrap_or_default(), info);
        for entry in &self.entries {
            data.push_segment(&entry.segment, entry.observations)?;
            data.descriptors.extend_from_slice(&entry.row);
            data.quality.push(entry.quality);
        }
        if self.descriptor.standardized() {
            let mut standardizer = Standardizer::fit(&data.descriptors, dim);
            standardizer.leave_from(self.descriptor.searched());
            standardizer.apply(&mut data.descriptors);
            data.standardizer = Some(standardizer);
        }
        for tile in self.ground.points.values() {
            data.push_ground_tile(tile)?;
        }
        for tile in self.structure.points.values() {
            data.push_structure_tile(tile)?;
        }
        data.path.clone_from(&self.path);
        data.coverage = self.coverage.iter().copied().collect();
        data.coverage.sort_unstable();
        data.settings = settings(&self.config)?;
        data.source.clone_from(&self.source);
        Map::from_data(data)
    }

    /// The number of the windows' length that is nearest to this one, where the next of them is due.
    fn layer(&mut self, distance_m: f64, at: [f64; 3]) -> Option<usize> {
        let c = &self.config;
        // Clouds that others put together may hold any distance.
        let off = |length: f64| (length - distance_m).abs();
        let (layer, _) = lengths(c).enumerate().min_by(|a, b| off(a.1).total_cmp(&off(b.1)))?;
        let step = if layer == 0 { c.map.window_step_m } else { c.map.short_step_m };
        let last = &mut self.last_windows[layer];
        if last.is_some_and(|last| distance(last, at) < step) {
            return None;
        }
        *last = Some(at);
        Some(layer)
    }

    fn add(&mut self, cloud: &Segmentation, pose_origin_sensor: &Pose, layer: usize) {
        // Described as the live cloud will be: in the sensor frame, before the turn into the map.
        let described = self.descriptor.describe(&cloud.segments);
        for (i, s) in cloud.segments.iter().enumerate() {
            let points = s.points.iter().map(|p| transform_point(pose_origin_sensor, *p)).collect();
            let Some(segment) = Segment::from_points(points) else { continue };
            let row = described.values[i * described.dim..][..described.dim].to_vec();
            let voxels = voxels(&segment.points, OVERLAP_VOXEL_M);
            self.merge(Entry { layer, segment, voxels, row, quality: described.quality[i], observations: 1 });
        }
        let moved = |p: &[f32; 3]| transform_point(pose_origin_sensor, *p);
        self.ground.extend(cloud.ground.iter().map(moved));
        self.structure.extend(cloud.structure.iter().map(moved));
    }

    /// Adds an observation, or merges it with the object it overlaps most: the fuller view stays.
    fn merge(&mut self, mut new: Entry) {
        let mut common: FxHashMap<u32, usize> = FxHashMap::default();
        for v in &new.voxels {
            for &id in self.by_voxel.get(v).into_iter().flatten() {
                if self.entries[id as usize].layer == new.layer {
                    *common.entry(id).or_default() += 1;
                }
            }
        }
        let overlap = |id: u32, n: usize| {
            n as f64 / (new.voxels.len() + self.entries[id as usize].voxels.len() - n) as f64
        };
        let best = common
            .into_iter()
            .map(|(id, n)| (overlap(id, n), id))
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        match best {
            Some((share, id)) if share >= self.config.map.merge_overlap => {
                let known = &mut self.entries[id as usize];
                known.observations += 1;
                if new.segment.points.len() > known.segment.points.len() {
                    new.observations = known.observations;
                    let old = std::mem::replace(known, new);
                    self.forget(id, &old.voxels);
                    self.remember(id);
                }
            }
            _ => {
                self.entries.push(new);
                self.remember(self.entries.len() as u32 - 1);
            }
        }
    }

    fn remember(&mut self, id: u32) {
        for v in &self.entries[id as usize].voxels {
            self.by_voxel.entry(*v).or_default().push(id);
        }
    }

    fn forget(&mut self, id: u32, voxels: &[Voxel]) {
        for v in voxels {
            if let Some(ids) = self.by_voxel.get_mut(v) {
                ids.retain(|other| *other != id);
            }
        }
    }

    /// Poses relative to the map's origin, which is a round position near the first pose: f32 then loses nothing.
    fn relative(&mut self, pose_map_sensor: &Pose) -> Pose {
        const ROUND_M: f64 = 1000.0;
        let at = pose_map_sensor.translation.vector;
        let origin = *self.origin.get_or_insert_with(|| {
            let far = at.norm() > 10.0 * ROUND_M;
            [0, 1, 2].map(|a| if far { (at[a] / ROUND_M).round() * ROUND_M } else { 0.0 })
        });
        Pose::translation(-origin[0], -origin[1], -origin[2]) * pose_map_sensor
    }
}

/// One for the windows of each length. The builder chooses its windows; the path needs every sweep.
fn accumulators(config: &Config) -> Result<Vec<Accumulator>, Error> {
    let of = |distance_m| {
        Accumulator::new(AccumulateConfig { distance_m, swathes: false, ..config.accumulate.clone() })
    };
    lengths(config).map(of).collect()
}

/// Metres of travel of the windows, the whole ones first.
fn lengths(config: &Config) -> impl Iterator<Item = f64> {
    let whole = config.accumulate.distance_m;
    std::iter::once(whole).chain(config.map.short_windows_m.iter().copied().filter(move |m| *m < whole))
}

/// A prior cloud in overlapping discs about as large as a live cloud, whose objects would otherwise run together into
/// segments that no live cloud can hold. Centres lie on a square grid one radius apart, where there are points.
fn discs(points: &[[f32; 3]], radius: f32) -> impl Iterator<Item = Vec<[f32; 3]>> {
    let cell = |v: f32| (v / radius).floor() as i32;
    let mut by_cell: FxHashMap<[i32; 2], Vec<[f32; 3]>> = FxHashMap::default();
    for p in points {
        by_cell.entry([cell(p[0]), cell(p[1])]).or_default().push(*p);
    }
    let mut centres: Vec<[i32; 2]> = by_cell.keys().copied().collect();
    centres.sort_unstable();
    centres.into_iter().map(move |[x, y]| {
        let centre = [(x as f32 + 0.5) * radius, (y as f32 + 0.5) * radius];
        let near = |p: &&[f32; 3]| (p[0] - centre[0]).powi(2) + (p[1] - centre[1]).powi(2) <= radius * radius;
        (y - 1..=y + 1)
            .flat_map(|v| (x - 1..=x + 1).map(move |u| [u, v]))
            .flat_map(|k| by_cell.get(&k).into_iter().flatten().filter(near).copied().collect::<Vec<_>>())
            .collect()
    })
}

/// The cell of [`MapData::coverage`] that a position in the map frame lies in.
pub fn coverage_cell(at_map: [f64; 3]) -> [i32; 2] {
    [(at_map[0] / COVERAGE_CELL_M).floor() as i32, (at_map[1] / COVERAGE_CELL_M).floor() as i32]
}

fn settings(config: &Config) -> Result<String, Error> {
    toml::to_string(config).map_err(|e| Error::MapData {
        what: format!("the build settings cannot be written as TOML: {e}"),
        hint: "use finite numbers in the configuration",
    })
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt()
}

fn absolute(origin: [f64; 3], p: [f32; 3]) -> [f64; 3] {
    [0, 1, 2].map(|a| origin[a] + f64::from(p[a]))
}

fn voxel(p: [f32; 3], edge: f32) -> Voxel {
    p.map(|v| (v / edge).floor() as i32)
}

fn voxels(points: &[[f32; 3]], edge: f32) -> Vec<Voxel> {
    let mut all: Vec<Voxel> = points.iter().map(|p| voxel(*p, edge)).collect();
    all.sort_unstable();
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Clouds that a user has put together hold 7.1 m, 6.8 m, ...: they are windows of one length, one every few metres.
    #[test]
    fn clouds_of_odd_lengths_are_windows_of_the_nearest_one() {
        let mut builder = MapBuilder::new(&Config::default()).unwrap();
        let mut push = |distance_m: f64, x: f64| {
            let live = LiveCloud {
                stamp: x,
                cloud: PointCloud::default(),
                pose_odom_sensor: None,
                distance_m,
                travel_m: distance_m,
                sweeps: 4,
                viewpoints: Vec::new(),
                elapsed: Duration::ZERO,
            };
            builder.push(&live, &Pose::translation(x, 0.0, 0.0)).unwrap()
        };
        assert!(push(7.1, 0.0), "the first of its length");
        assert!(!push(6.8, 1.0), "map.short_step_m is 2 m");
        assert!(push(6.2, 2.5));
        assert!(push(25.0, 2.5), "the first whole one");
        assert!(!push(19.0, 5.0), "map.window_step_m is 5 m");
        assert!(push(21.0, 8.0));
    }
}
