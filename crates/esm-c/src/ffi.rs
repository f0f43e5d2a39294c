//! The door to C.
//!
//! `unsafe` is needed for what C hands over: pointers. Each is checked for null, and what cannot be checked (that it points to as
//! much as is said, and is not in use elsewhere) is the caller's promise, written in the header. A panic never crosses the border.
#![allow(unsafe_code)]

use std::cell::RefCell;
use std::ffi::{CStr, CString, OsStr, c_char};
use std::os::unix::ffi::OsStrExt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use esm_core::map::Map;
use esm_core::{Localization, Pose, Verdict};
use nalgebra::{Quaternion, Translation3, UnitQuaternion};

use crate::robot::{Failure, Robot, open};

/// Points of one sweep at most.
const MAX_POINTS: usize = 50_000_000;

/// A prior map.
pub struct EsmMap(Arc<Map>);

/// A robot in a map: it keeps the last metres of travel, and what it believes of its place.
pub struct EsmRobot(Robot);

/// Whether a call did what it was asked for; where it did not, `esm_last_error` tells why.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EsmStatus {
    /// Done.
    Ok = 0,
    /// Not done.
    Failed = 1,
}

/// What is said about a cloud.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EsmVerdict {
    /// The pose is trusted.
    Located = 0,
    /// Two places explain the cloud nearly as well: the pose is a guess.
    Ambiguous = 1,
    /// No place explains the cloud well enough: there is no pose.
    NotFound = 2,
    /// The sweep was taken, a cloud is not complete yet (with `accumulate.swathes`).
    NoCloud = 3,
}

/// A pose: position in metres, orientation as a unit quaternion in the order of ROS.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EsmPose {
    /// x, y, z in metres.
    pub position: [f64; 3],
    /// x, y, z, w.
    pub orientation: [f64; 4],
}

/// The answer to one sweep.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EsmAnswer {
    /// Seconds, of the sweep.
    pub stamp: f64,
    /// Whether the pose is to be trusted.
    pub verdict: EsmVerdict,
    /// Whether `pose_map_sensor` and `covariance` hold something: with `located` and `ambiguous`.
    pub has_pose: bool,
    /// Pose of the sensor in the map.
    pub pose_map_sensor: EsmPose,
    /// Row-major 6 x 6, order x y z rx ry rz in m and rad: of a right perturbation in the sensor frame.
    pub covariance: [f64; 36],
    /// Metres of travel the cloud holds.
    pub travel_m: f64,
    /// Segments cut from the cloud.
    pub segments: u32,
    /// Matched segments that agree with the pose.
    pub inliers: u32,
    /// Share of the points above the ground, where the map has been seen, that lie on what stands there in the map.
    pub overlap: f64,
    /// How well the best place explains the cloud.
    pub score: f64,
    /// The same of the best other place, 0 where there is none.
    pub runner_up: f64,
    /// Seconds spent.
    pub seconds: f64,
    /// Points of the sweep that were not finite and were dropped.
    pub dropped_points: u64,
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

fn fail(why: &str) {
    let text = CString::new(why.replace('\0', " ")).unwrap_or_default();
    LAST_ERROR.with(|last| last.replace(text));
}

/// Runs it; a failure or a panic is kept for `esm_last_error`.
fn guarded<T>(work: impl FnOnce() -> Result<T, Failure>) -> Option<T> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(done)) => Some(done),
        Ok(Err(why)) => {
            fail(&why);
            None
        }
        Err(_) => {
            fail("internal error: a panic\nhint: please report it with the map and the cloud");
            None
        }
    }
}

/// The version of this library, such as `0.1.0`.
#[unsafe(no_mangle)]
pub extern "C" fn esm_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// Why the last call on this thread failed: what, where and a hint. Valid until the next call on this thread.
#[unsafe(no_mangle)]
pub extern "C" fn esm_last_error() -> *const c_char {
    LAST_ERROR.with(|last| last.borrow().as_ptr())
}

/// Has all work done on the thread that calls; else there is one thread a core. Call it once, before anything else, on the thread
/// that will push sweeps. The answers are the same bits either way.
#[unsafe(no_mangle)]
pub extern "C" fn esm_use_one_thread() -> EsmStatus {
    let one = guarded(|| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
        pool.build_global().map_err(|e| format!("{e}\nhint: call esm_use_one_thread first and once"))
    });
    status(one)
}

/// Opens a map file. NULL where it cannot be opened.
///
/// # Safety
/// `file` is a string that ends with a NUL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn esm_map_open(file: *const c_char) -> *mut EsmMap {
    // SAFETY: the caller's promise.
    let file = unsafe { text(file) };
    handle(guarded(|| {
        Ok(EsmMap(open(Path::new(OsStr::from_bytes(file.ok_or("file is NULL")?.to_bytes())))?))
    }))
}

/// Closes a map. Robots in it keep what they need. NULL is allowed.
///
/// # Safety
/// `map` comes from `esm_map_open` and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn esm_map_close(map: *mut EsmMap) {
    if !map.is_null() {
        // SAFETY: made by Box::into_raw in `handle`, and given back once.
        drop(unsafe { Box::from_raw(map) });
    }
}

/// A robot that may be anywhere in the map. `settings` is TOML as `esm-cli config` prints it, or NULL for the defaults. NULL where
/// the settings are refused.
///
/// # Safety
/// `map` comes from `esm_map_open`; `settings` is NULL or a string that ends with a NUL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn esm_robot_new(map: *const EsmMap, settings: *const c_char) -> *mut EsmRobot {
    // SAFETY: the caller's promise; null is None.
    let (map, settings) = unsafe { (map.as_ref(), text(settings)) };
    handle(guarded(|| {
        let settings = settings.map_or(Ok(""), CStr::to_str).map_err(|e| format!("settings: {e}"))?;
        Ok(EsmRobot(Robot::new(Arc::clone(&map.ok_or("map is NULL")?.0), settings)?))
    }))
}

/// Frees a robot. NULL is allowed.
///
/// # Safety
/// `robot` comes from `esm_robot_new` and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn esm_robot_free(robot: *mut EsmRobot) {
    if !robot.is_null() {
        // SAFETY: made by Box::into_raw in `handle`, and given back once.
        drop(unsafe { Box::from_raw(robot) });
    }
}

/// Takes the next sweep and finds the cloud that ends with it.
///
/// `points`: `count` points in the sensor frame, metres, each three floats x y z, `stride` bytes from one to the next (12 for packed
/// ones, 16 for PCL's PointXYZ, `point_step` of a PointCloud2 whose x is at offset 0); alignment does not matter. `pose_odom_sensor`:
/// where the sensor is by the robot's odometry, or NULL for a cloud by itself. Only its changes matter.
///
/// # Safety
/// `robot` comes from `esm_robot_new` and is not in use on another thread; `points` points to what is said; `pose_odom_sensor` is
/// NULL or points to a pose; `answer` points to room for an answer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn esm_robot_push(
    robot: *mut EsmRobot,
    stamp: f64,
    points: *const f32,
    count: usize,
    stride: usize,
    pose_odom_sensor: *const EsmPose,
    answer: *mut EsmAnswer,
) -> EsmStatus {
    let done = guarded(|| {
        // SAFETY: the caller's promise; null is None.
        let robot = unsafe { robot.as_mut() }.ok_or("robot is NULL")?;
        if answer.is_null() {
            return Err("answer is NULL".into());
        }
        if !stamp.is_finite() {
            return Err(format!("stamp is {stamp}\nhint: seconds, as a finite number"));
        }
        // SAFETY: the caller's promise.
        let points_sensor = unsafe { gather(points, count, stride) }?;
        // SAFETY: the caller's promise; null is None.
        let pose = unsafe { pose_odom_sensor.as_ref() }.map(to_pose).transpose()?;
        let (localization, dropped) = robot.0.push(stamp, points_sensor, pose)?;
        // SAFETY: not null, and the caller's promise. What stood there is not read.
        unsafe { answer.write(to_answer(stamp, localization.as_ref(), dropped)) };
        Ok(())
    });
    status(done)
}

/// Forgets where the robot was and what it saw last: after a gap, or when it was carried elsewhere. NULL is allowed.
///
/// # Safety
/// `robot` comes from `esm_robot_new` and is not in use on another thread.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn esm_robot_forget(robot: *mut EsmRobot) {
    // SAFETY: the caller's promise; null is None.
    if let Some(robot) = unsafe { robot.as_mut() } {
        robot.0.forget();
    }
}

fn status(done: Option<()>) -> EsmStatus {
    if done.is_some() { EsmStatus::Ok } else { EsmStatus::Failed }
}

fn handle<T>(made: Option<T>) -> *mut T {
    made.map_or(std::ptr::null_mut(), |t| Box::into_raw(Box::new(t)))
}

/// # Safety
/// Null, or a string that ends with a NUL and outlives its use.
unsafe fn text<'a>(at: *const c_char) -> Option<&'a CStr> {
    // SAFETY: not null, and the caller's promise.
    (!at.is_null()).then(|| unsafe { CStr::from_ptr(at) })
}

/// # Safety
/// `points` points to `count` points, `stride` bytes from one to the next.
unsafe fn gather(points: *const f32, count: usize, stride: usize) -> Result<Vec<[f32; 3]>, Failure> {
    if count > MAX_POINTS {
        return Err(format!("{count} points are more than the {MAX_POINTS} of a sweep"));
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    if points.is_null() {
        return Err("points is NULL".into());
    }
    if !(12..=4096).contains(&stride) {
        return Err(format!(
            "stride is {stride}\nhint: bytes from one point to the next, 12 for packed points"
        ));
    }
    let start = points.cast::<u8>();
    // SAFETY: within the caller's points; read as they lie, whatever the alignment.
    Ok((0..count).map(|i| unsafe { start.add(i * stride).cast::<[f32; 3]>().read_unaligned() }).collect())
}

fn to_pose(pose: &EsmPose) -> Result<Pose, Failure> {
    let [x, y, z, w] = pose.orientation;
    let q = Quaternion::new(w, x, y, z);
    let finite = pose.position.iter().chain(&pose.orientation).all(|v| v.is_finite());
    if !finite || (q.norm() - 1.0).abs() > 1e-3 {
        return Err(format!(
            "pose_odom_sensor: position {:?}, orientation {:?}\nhint: finite numbers, and a unit quaternion x y z w",
            pose.position, pose.orientation
        ));
    }
    Ok(Pose::from_parts(Translation3::from(pose.position), UnitQuaternion::from_quaternion(q)))
}

fn to_answer(stamp: f64, localization: Option<&Localization>, dropped: usize) -> EsmAnswer {
    let mut answer = EsmAnswer {
        stamp,
        verdict: EsmVerdict::NoCloud,
        has_pose: false,
        pose_map_sensor: EsmPose { position: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0] },
        covariance: [0.0; 36],
        travel_m: 0.0,
        segments: 0,
        inliers: 0,
        overlap: 0.0,
        score: 0.0,
        runner_up: 0.0,
        seconds: 0.0,
        dropped_points: dropped as u64,
    };
    let Some(l) = localization else { return answer };
    answer.verdict = match l.verdict {
        Verdict::Located => EsmVerdict::Located,
        Verdict::Ambiguous => EsmVerdict::Ambiguous,
        Verdict::NotFound => EsmVerdict::NotFound,
    };
    if let Some(pose) = &l.pose_map_sensor {
        answer.has_pose = true;
        answer.pose_map_sensor =
            EsmPose { position: pose.translation.vector.into(), orientation: pose.rotation.coords.into() };
        answer.covariance = l.covariance.unwrap_or([0.0; 36]);
    }
    answer.travel_m = l.travel_m;
    (answer.segments, answer.inliers) = (l.segments as u32, l.inliers as u32);
    (answer.overlap, answer.score, answer.runner_up) = (l.overlap, l.score, l.runner_up);
    answer.seconds = l.timings.total().as_secs_f64();
    answer
}
