//! Single clouds and trajectories in files.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use esm_core::{PointCloud, Pose};
use esm_io::{InputKind, PoseFile, StampedPose};
use numpy::{PyArray2, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::failure::Failure;
use crate::input::{any_shape, bad_value, exactly, integers, points};
use crate::output::{Kept, fixed_row, row, rows3};
use crate::pose;
use crate::threads::Threads;
use crate::work::run;

/// One scan of a file, in its sensor's frame.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Scan {
    inner: esm_io::Scan,
    points: Kept,
}

#[pymethods]
impl Scan {
    /// Points, shape (N, 3), metres, sensor frame.
    #[getter]
    fn points(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.points.get(py, || rows3(py, self.inner.cloud.points().to_vec()))
    }

    /// Points left out: NaN, infinite, or exactly (0, 0, 0), which is how sensors write "no return".
    #[getter]
    fn dropped(&self) -> usize {
        self.inner.dropped
    }

    fn __len__(&self) -> usize {
        self.inner.cloud.len()
    }

    fn __repr__(&self) -> String {
        format!("Scan(points={}, dropped={})", self.inner.cloud.len(), self.inner.dropped)
    }
}

/// A survey somebody else made: one cloud in its own frame. A point's coordinates in the file are `origin + point`.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct PriorCloud {
    inner: esm_io::PriorCloud,
    points: Kept,
}

#[pymethods]
impl PriorCloud {
    /// What to add to every point, shape (3,), metres, a multiple of 1000 on each axis.
    #[getter]
    fn origin(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_row(py, &self.inner.origin)
    }

    /// Points relative to the origin, shape (N, 3), metres.
    #[getter]
    fn points(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.points.get(py, || rows3(py, self.inner.cloud.points().to_vec()))
    }

    /// Points left out: NaN, infinite, or exactly (0, 0, 0).
    #[getter]
    fn dropped(&self) -> usize {
        self.inner.dropped
    }

    fn __len__(&self) -> usize {
        self.inner.cloud.len()
    }

    fn __repr__(&self) -> String {
        let [x, y, z] = self.inner.origin;
        format!(
            "PriorCloud(points={}, origin=[{x:.0}, {y:.0}, {z:.0}], dropped={})",
            self.inner.cloud.len(),
            self.inner.dropped
        )
    }
}

/// Read one scan: `.las`, `.laz`, `.pcd`, `.ply` or KITTI's `.bin`, told apart by extension. It may hold no point.
#[pyfunction]
pub(crate) fn read_scan(py: Python<'_>, path: PathBuf) -> PyResult<Scan> {
    let inner = run(py, Threads::default(), move || esm_io::read_scan(path))?;
    Ok(Scan { inner, points: Kept::default() })
}

/// Read one prior cloud, of the formats of `read_scan`, projected coordinates included.
#[pyfunction]
pub(crate) fn read_prior_cloud(py: Python<'_>, path: PathBuf) -> PyResult<PriorCloud> {
    let inner = run(py, Threads::default(), move || esm_io::read_prior_cloud(path))?;
    Ok(PriorCloud { inner, points: Kept::default() })
}

/// Tell what an input is, by its name and first bytes.
#[pyfunction]
pub(crate) fn classify(path: PathBuf) -> PyResult<&'static str> {
    Ok(match esm_io::classify(path).map_err(Failure::from)? {
        InputKind::Recording => "recording",
        InputKind::ScanDirectory => "scan_directory",
        InputKind::PriorCloud => "prior_cloud",
    })
}

/// Keep the finite points, shape (N, 3), in their order, and tell how many were dropped.
#[pyfunction]
pub(crate) fn finite<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
) -> PyResult<(Bound<'py, PyArray2<f32>>, usize)> {
    let (cloud, dropped) = PointCloud::from_finite(self::points(points, "points")?);
    Ok((rows3(py, cloud.into_points())?, dropped))
}

/// Poses of a file.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Trajectory {
    stamps_ns: Option<Vec<i64>>,
    poses: Vec<Pose>,
    kept: [Kept; 3],
}

impl Trajectory {
    fn new(file: PoseFile) -> Self {
        let (stamps_ns, poses) = match file {
            PoseFile::Stamped(all) => {
                (Some(all.iter().map(|p| p.stamp_ns).collect()), all.iter().map(|p| p.pose).collect())
            }
            PoseFile::Ordered(poses) => (None, poses),
        };
        Self { stamps_ns, poses, kept: Default::default() }
    }
}

#[pymethods]
impl Trajectory {
    /// Times in nanoseconds, shape (N,); None for KITTI files, which have a pose for each sweep in order.
    #[getter]
    fn stamps_ns(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        self.stamps_ns.as_ref().map(|all| self.kept[0].get(py, || Ok(row(py, all.clone())))).transpose()
    }

    /// The same in seconds.
    #[getter]
    fn stamps(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        let seconds = |ns: &i64| StampedPose { stamp_ns: *ns, pose: Pose::identity() }.stamp();
        let make = |all: &Vec<i64>| self.kept[1].get(py, || Ok(row(py, all.iter().map(seconds).collect())));
        self.stamps_ns.as_ref().map(make).transpose()
    }

    /// Poses, shape (N, 4, 4), metres, in the frame the file is about.
    #[getter]
    fn poses(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[2].get(py, || {
            let numbers: Vec<f64> = self.poses.iter().flat_map(pose::row_major).collect();
            row(py, numbers).reshape([self.poses.len(), 4, 4])
        })
    }

    fn __len__(&self) -> usize {
        self.poses.len()
    }

    fn __repr__(&self) -> String {
        let stamped = if self.stamps_ns.is_some() { "True" } else { "False" };
        format!("Trajectory(poses={}, stamped={stamped})", self.poses.len())
    }
}

/// Read a TUM trajectory: `stamp x y z qx qy qz qw` a line.
#[pyfunction]
pub(crate) fn read_tum(py: Python<'_>, path: PathBuf) -> PyResult<Trajectory> {
    run(py, Threads::default(), move || esm_io::read_tum(path)).map(|p| Trajectory::new(PoseFile::Stamped(p)))
}

/// Read a KITTI trajectory: the upper 3 x 4 numbers of a pose a line.
#[pyfunction]
pub(crate) fn read_kitti_poses(py: Python<'_>, path: PathBuf) -> PyResult<Trajectory> {
    run(py, Threads::default(), move || esm_io::read_kitti_poses(path))
        .map(|p| Trajectory::new(PoseFile::Ordered(p)))
}

/// Read a TUM or KITTI trajectory, told apart by its first line.
#[pyfunction]
pub(crate) fn read_poses(py: Python<'_>, path: PathBuf) -> PyResult<Trajectory> {
    run(py, Threads::default(), move || esm_io::read_poses(path)).map(Trajectory::new)
}

/// Write a TUM trajectory, whole or not at all.
///
/// `stamps_ns`: nanoseconds, integers of shape (N,). `poses`: shape (N, 4, 4).
#[pyfunction]
pub(crate) fn write_tum(
    py: Python<'_>,
    path: PathBuf,
    stamps_ns: &Bound<'_, PyAny>,
    poses: &Bound<'_, PyAny>,
) -> PyResult<()> {
    let stamps: Vec<i64> = integers(stamps_ns, "stamps_ns")?;
    let (numbers, shape) = any_shape(poses, "poses")?;
    if shape != [stamps.len(), 4, 4] {
        let n = stamps.len();
        return Err(bad_value(
            "poses",
            format!("must have shape ({n}, 4, 4) as stamps_ns has {n}, got {shape:?}"),
        ));
    }
    let mut all = Vec::with_capacity(stamps.len());
    for (n, (stamp_ns, m)) in stamps.into_iter().zip(numbers.as_chunks::<16>().0).enumerate() {
        let pose = pose::from_row_major(m).map_err(|what| bad_value(&format!("poses[{n}]"), what))?;
        all.push(StampedPose { stamp_ns, pose });
    }
    run(py, Threads::default(), move || esm_io::write_tum(path, all))
}

/// Writes poses to an MCAP file (`PoseWithCovarianceStamped`) that appears when it is finished, and not before.
///
/// As a context manager it finishes at the end, and gives the file up after an exception.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct PoseWriter {
    path: PathBuf,
    writer: Mutex<Option<esm_io::PoseWriter>>,
}

impl PoseWriter {
    fn with<T>(
        &self,
        py: Python<'_>,
        f: impl FnOnce(&mut Option<esm_io::PoseWriter>) -> PyResult<T> + Send,
    ) -> PyResult<T>
    where
        T: Send,
    {
        py.detach(|| f(&mut self.writer.lock().unwrap_or_else(PoisonError::into_inner)))
    }
}

fn finished() -> PyErr {
    PyValueError::new_err("the file is finished or was given up: nothing more can be written to it")
}

#[pymethods]
impl PoseWriter {
    #[new]
    #[pyo3(signature = (path, topic="/localization", frame_id="map"))]
    fn new(path: PathBuf, topic: &str, frame_id: &str) -> PyResult<Self> {
        let writer = esm_io::PoseWriter::create(&path, topic, frame_id).map_err(Failure::from)?;
        Ok(Self { path, writer: Mutex::new(Some(writer)) })
    }

    /// Write one pose, shape (4, 4), and its covariance, shape (6, 6), as `Localization` gives them.
    #[pyo3(signature = (stamp_ns, pose_map_sensor, covariance=None))]
    fn write(
        &self,
        py: Python<'_>,
        stamp_ns: i64,
        pose_map_sensor: &Bound<'_, PyAny>,
        covariance: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let pose = pose::read(pose_map_sensor, "pose_map_sensor")?;
        let covariance = covariance.map(|c| exactly(c, "covariance", &[6, 6])).transpose()?;
        let covariance: Option<[f64; 36]> = covariance.and_then(|c| c.try_into().ok());
        if covariance.is_some_and(|c| !c.iter().all(|v| v.is_finite())) {
            return Err(bad_value("covariance", "must be finite"));
        }
        self.with(py, |writer| {
            let writer = writer.as_mut().ok_or_else(finished)?;
            Ok(writer.write(stamp_ns, &pose, covariance.as_ref()).map_err(Failure::from)?)
        })
    }

    /// Complete the file and move it into place.
    fn finish(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |writer| {
            let writer = writer.take().ok_or_else(finished)?;
            Ok(writer.finish().map_err(Failure::from)?)
        })
    }

    fn __enter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    /// Finishes the file, or gives it up after an exception.
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
        self.with(py, |writer| match (writer.take(), failed) {
            (Some(writer), false) => Ok(writer.finish().map_err(Failure::from)?),
            _ => Ok(()),
        })
    }

    fn __repr__(&self) -> String {
        format!("PoseWriter({:?})", self.path.display().to_string())
    }
}
