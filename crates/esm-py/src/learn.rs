//! Labelled segments: the training sets of the learned descriptor.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use esm_core::PointCloud;
use esm_core::segment::Context;
use esm_io::PointLabel;
use esm_learn::{IdentityRule, Row, SetInfo, UNKNOWN_CLASS};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::accumulate::check_stamp;
use crate::config::{Config, or_default};
use crate::failure::Failure;
use crate::input::{bad_value, cloud, integers, position};
use crate::output::{Kept, fixed_row, rows3};
use crate::pose;
use crate::recording::Sweep;
use crate::segment::{rings_in, rings_out};
use crate::threads::Threads;
use crate::work::run;

/// A segment of a live cloud with the object it shows.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Found {
    inner: Arc<esm_learn::Found>,
    points: Kept,
}

#[pymethods]
impl Found {
    /// Points, shape (N, 3), metres about `centroid_map`, axes of the map frame.
    #[getter]
    fn points(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.points.get(py, || rows3(py, self.inner.points.clone()))
    }

    /// Mean of the points, shape (3,), metres, map frame.
    #[getter]
    fn centroid_map(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_row(py, &self.inner.centroid_map)
    }

    /// The object that a clear majority of its points lies on, where there is one and points carry labels.
    #[getter]
    fn object(&self) -> Option<u32> {
        self.inner.label.map(|l| l.object)
    }

    /// The class of that object (`CLASSES`).
    #[getter]
    fn object_class(&self) -> Option<u8> {
        self.inner.label.map(|l| l.class)
    }

    /// Height of the lowest point above the ground, metres, NaN where unknown.
    #[getter]
    fn above_ground(&self) -> f32 {
        self.inner.context.above_ground.unwrap_or(f32::NAN)
    }

    /// What stands around it in its cloud, shape (7, 4); see `Segment.rings`.
    #[getter]
    fn rings(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        rings_out(py, &self.inner.context)
    }

    fn __len__(&self) -> usize {
        self.inner.points.len()
    }

    fn __repr__(&self) -> String {
        let f = &self.inner;
        let [x, y, z] = f.centroid_map;
        let object = f.label.map_or_else(|| "None".to_owned(), |l| l.object.to_string());
        format!("Found(points={}, centroid_map=[{x:.2}, {y:.2}, {z:.2}], object={object})", f.points.len())
    }
}

/// Feeds on the sweeps of one recording; gives the segments of a live cloud every `step_m` metres of travel.
///
/// Clouds that hold less than 95 % of `accumulate.distance_m` are left out.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Surveyor {
    inner: Arc<Mutex<esm_learn::Surveyor>>,
    config: Arc<esm_core::Config>,
    step_m: f64,
    threads: Threads,
}

/// The labels of a sweep's points.
fn labels(
    points: usize,
    objects: Option<&Bound<'_, PyAny>>,
    classes: Option<&Bound<'_, PyAny>>,
) -> PyResult<Vec<PointLabel>> {
    let check = |name: &str, got: usize| match got == points {
        true => Ok(()),
        false => {
            Err(bad_value(name, format!("must have shape ({points},) as there are points, got ({got},)")))
        }
    };
    let Some(objects) = objects else {
        return match classes {
            None => Ok(Vec::new()),
            Some(_) => Err(bad_value("objects", "is missing: classes say nothing without it")),
        };
    };
    let objects: Vec<u32> = integers(objects, "objects")?;
    check("objects", objects.len())?;
    let classes: Vec<u8> = match classes {
        Some(classes) => integers(classes, "classes")?,
        None => vec![UNKNOWN_CLASS; points],
    };
    check("classes", classes.len())?;
    Ok(objects.into_iter().zip(classes).map(|(object, class)| PointLabel { object, class }).collect())
}

#[pymethods]
impl Surveyor {
    #[new]
    #[pyo3(signature = (config=None, *, step_m=1.0, threads=None))]
    fn new(config: Option<&Bound<'_, Config>>, step_m: f64, threads: Option<usize>) -> PyResult<Self> {
        let config = or_default(config);
        let inner = esm_learn::Surveyor::new(&config.accumulate, &config.segment, step_m);
        let inner = Arc::new(Mutex::new(inner.map_err(Failure::from)?));
        Ok(Self { inner, config, step_m, threads: Threads::new(threads)? })
    }

    /// Take the next sweep; give the segments of the live cloud that ends with it, where one is due.
    ///
    /// `stamp`: seconds. `points`: shape (N, 3), metres, sensor frame. `pose_odom_sensor`: the odometry, shape (4, 4).
    /// `pose_map_sensor`: the truth, shape (4, 4), None where it is not known. `objects`, `classes`: labels, shape (N,).
    #[pyo3(signature = (stamp, points, pose_odom_sensor, pose_map_sensor, *, objects=None, classes=None))]
    #[allow(clippy::too_many_arguments)] // Python has names for them.
    fn push(
        &self,
        py: Python<'_>,
        stamp: f64,
        points: &Bound<'_, PyAny>,
        pose_odom_sensor: &Bound<'_, PyAny>,
        pose_map_sensor: Option<&Bound<'_, PyAny>>,
        objects: Option<&Bound<'_, PyAny>>,
        classes: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Option<Vec<Found>>> {
        check_stamp(stamp)?;
        let sweep: PointCloud = cloud(points, "points")?;
        let labels = labels(sweep.len(), objects, classes)?;
        let odom = pose::read(pose_odom_sensor, "pose_odom_sensor")?;
        let map = pose::read_option(pose_map_sensor, "pose_map_sensor")?;
        self.with(py, move |surveyor| surveyor.push(stamp, &sweep, &labels, odom, map))
    }

    /// Take the next sweep of a recording, with its labels, and the truth, None where it is not known.
    fn push_sweep(
        &self,
        py: Python<'_>,
        sweep: &Bound<'_, Sweep>,
        pose_map_sensor: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Option<Vec<Found>>> {
        let sweep = Arc::clone(&sweep.get().inner);
        let odom = sweep.pose_odom_sensor.ok_or_else(|| {
            bad_value("sweep", "has no pose_odom_sensor: nothing tells how the sensor moved")
        })?;
        let map = pose::read_option(pose_map_sensor, "pose_map_sensor")?;
        self.with(py, move |surveyor| surveyor.push(sweep.stamp, &sweep.cloud, &sweep.labels, odom, map))
    }

    fn __repr__(&self) -> String {
        format!("Surveyor(distance_m={}, step_m={})", self.config.accumulate.distance_m, self.step_m)
    }
}

impl Surveyor {
    fn with(
        &self,
        py: Python<'_>,
        push: impl FnOnce(&mut esm_learn::Surveyor) -> Option<Vec<esm_learn::Found>> + Send + 'static,
    ) -> PyResult<Option<Vec<Found>>> {
        let inner = Arc::clone(&self.inner);
        let found = run(py, self.threads, move || {
            Ok::<_, Failure>(push(&mut inner.lock().unwrap_or_else(PoisonError::into_inner)))
        })?;
        let wrap = |f| Found { inner: Arc::new(f), points: Kept::default() };
        Ok(found.map(|all| all.into_iter().map(wrap).collect()))
    }
}

/// Gives segments of one place their identities, in the order in which they come, over all visits.
///
/// Centroids up to `same_m` metres apart are one object, beyond `different_m` different ones, between neither: the paper's
/// rule by default. Its length is the number of identities so far.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Identities {
    inner: Mutex<esm_learn::Identities>,
    rule: IdentityRule,
}

#[pymethods]
impl Identities {
    #[new]
    #[pyo3(signature = (same_m=0.5, different_m=4.0))] // IdentityRule::PAPER
    fn new(same_m: f64, different_m: f64) -> PyResult<Self> {
        // Cells of 5 m are searched, and their neighbours.
        if !(same_m >= 0.0 && same_m <= different_m && different_m <= 5.0) {
            let what = format!("0 <= same_m <= different_m <= 5 m must hold, got {same_m} and {different_m}");
            return Err(PyValueError::new_err(what));
        }
        let rule = IdentityRule { same_m, different_m };
        Ok(Self { inner: Mutex::new(esm_learn::Identities::new(rule)), rule })
    }

    /// Make one for objects with numbers, whose parts are told apart by 1 m and 3 m.
    #[staticmethod]
    fn numbered() -> Self {
        let rule = IdentityRule::NUMBERED;
        Self { inner: Mutex::new(esm_learn::Identities::new(rule)), rule }
    }

    /// Give the identity of a segment of an object (0 for all where objects have no numbers), -1 for neither.
    ///
    /// `centroid_map`: shape (3,), metres.
    fn of(&self, object: u32, centroid_map: &Bound<'_, PyAny>) -> PyResult<i64> {
        let at = position(centroid_map, "centroid_map")?;
        Ok(self.inner.lock().unwrap_or_else(PoisonError::into_inner).of(object, at))
    }

    fn __len__(&self) -> usize {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    fn __bool__(&self) -> bool {
        true
    }

    fn __repr__(&self) -> String {
        let IdentityRule { same_m, different_m } = self.rule;
        format!("Identities(same_m={same_m}, different_m={different_m}, identities={})", self.__len__())
    }
}

/// Writes labelled segments to a directory that NumPy maps into memory (`python/train/DATA.md`), whole or not at all.
///
/// As a context manager it finishes at the end, and gives the set up after an exception.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct SegmentSetWriter {
    target: PathBuf,
    places: usize,
    writer: Arc<Mutex<Option<esm_learn::SegmentSetWriter>>>,
}

impl SegmentSetWriter {
    fn with<T: Send + 'static>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Option<esm_learn::SegmentSetWriter>) -> Result<T, Failure> + Send + 'static,
    ) -> PyResult<T> {
        let writer = Arc::clone(&self.writer);
        run(py, Threads::default(), move || work(&mut writer.lock().unwrap_or_else(PoisonError::into_inner)))
    }
}

fn finished() -> Failure {
    let what = "the set is finished or was given up: nothing more can be written to it";
    Failure::Python(PyValueError::new_err(what))
}

#[pymethods]
impl SegmentSetWriter {
    #[new]
    #[pyo3(signature = (target, *, places, classes, voxel_m, source=""))]
    fn new(
        target: PathBuf,
        places: Vec<String>,
        classes: Vec<String>,
        voxel_m: f32,
        source: &str,
    ) -> PyResult<Self> {
        let count = places.len();
        if !(voxel_m >= 0.0 && voxel_m.is_finite()) {
            return Err(bad_value("voxel_m", format!("must be 0 m or more, got {voxel_m}")));
        }
        let info = SetInfo { places, classes, voxel_m, source: source.to_owned() };
        let writer = esm_learn::SegmentSetWriter::create(&target, info).map_err(Failure::from)?;
        Ok(Self { target, places: count, writer: Arc::new(Mutex::new(Some(writer))) })
    }

    /// Append a segment.
    ///
    /// `points`: shape (N, 3), metres about `centroid_map`, shape (3,), metres, map frame. `object`: its identity, unique in
    /// its place, -1 where unknown. `observation`: the live cloud's number in the set. `above_ground`: metres. `rings`:
    /// shape (7, 4), as `Segment.rings`; without them it is alone.
    #[pyo3(signature = (
        points, centroid_map, *, object, observation, visit=0, place=0, object_class=255, above_ground=None, rings=None
    ))]
    #[allow(clippy::too_many_arguments)] // Python has names for them.
    fn push(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        centroid_map: &Bound<'_, PyAny>,
        object: i64,
        observation: u32,
        visit: u16,
        place: u16,
        object_class: u8,
        above_ground: Option<f32>,
        rings: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let points = cloud(points, "points")?.into_points();
        if points.is_empty() {
            return Err(bad_value("points", "must hold at least one point"));
        }
        if usize::from(place) >= self.places {
            return Err(bad_value(
                "place",
                format!("must be one of the {} places, got {place}", self.places),
            ));
        }
        let centroid_map = position(centroid_map, "centroid_map")?;
        let rings = rings.map(|r| rings_in(r, "rings")).transpose()?.unwrap_or_default();
        let context = Context { above_ground: above_ground.filter(|h| !h.is_nan()), rings };
        let row =
            Row { points, centroid_map, object, observation, visit, place, class: object_class, context };
        self.with(py, move |writer| Ok(writer.as_mut().ok_or_else(finished)?.push(&row)?))
    }

    /// See everything on the disk, give the set its name, and tell the number of segments.
    fn finish(&self, py: Python<'_>) -> PyResult<u64> {
        self.with(py, |writer| Ok(writer.take().ok_or_else(finished)?.finish()?))
    }

    fn __enter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    /// Finishes the set, or gives it up after an exception.
    #[pyo3(signature = (kind, value, traceback, /))]
    fn __exit__(
        &self,
        py: Python<'_>,
        kind: Option<&Bound<'_, PyAny>>,
        value: Option<&Bound<'_, PyAny>>,
        traceback: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let _ = (value, traceback);
        let failed = kind.is_some();
        self.with(py, move |writer| match writer.take() {
            Some(writer) if !failed => Ok(writer.finish().map(|_| ())?),
            _ => Ok(()),
        })
    }

    fn __repr__(&self) -> String {
        format!("SegmentSetWriter({:?})", self.target.display().to_string())
    }
}
