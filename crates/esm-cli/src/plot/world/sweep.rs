//! One sweep in perspective, seen from behind and above the sensor.

use esm_core::Pose;
use esm_sim::{Plan, Scan, Tiles};
use nalgebra::Vector3;

use super::kinds::{KINDS, kind_of};
use super::raster::Raster;

/// Pixels a side that are averaged into one.
const FINER: usize = 2;
/// The camera: metres behind and above the sensor, and how far ahead of it it looks.
const BEHIND_M: f64 = 15.0;
const ABOVE_M: f64 = 10.0;
const AHEAD_M: f64 = 12.0;
/// Half its field of view across, as a tangent.
const HALF_FIELD: f64 = 0.72;
/// Nothing nearer to the camera is drawn, metres.
const NEAR_M: f64 = 4.0;
/// Edge of a point, metres, and its limits in pixels.
const POINT_M: f64 = 0.11;
const POINT_PX: (f64, f64) = (1.0, 3.4);
/// Distance over which colours fade into the dark by 1/e, metres.
const FADE_M: f64 = 75.0;
/// Push-broom lines of so many metres of travel stand in for a sweep.
const SWATH_M: f64 = 30.0;
/// Top and bottom of the background.
const NIGHT: [[f32; 3]; 2] = [[16.0, 20.0, 28.0], [30.0, 36.0, 46.0]];

/// Where the camera is.
pub(super) struct Camera {
    at: Vector3<f64>,
    /// Right, up, forward in the map frame.
    axes: [Vector3<f64>; 3],
    focal_px: f64,
    size: [f64; 2],
}

impl Camera {
    /// Behind a sensor that moves towards a heading (radians).
    fn behind(position: Vector3<f64>, heading: f64, size: [f64; 2]) -> Self {
        let ahead = Vector3::new(heading.cos(), heading.sin(), 0.0);
        let at = position - ahead * BEHIND_M + Vector3::z() * ABOVE_M;
        let forward = (position + ahead * AHEAD_M - at).normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        let focal_px = 0.5 * size[0] / HALF_FIELD;
        Self { at, axes: [right, right.cross(&forward), forward], focal_px, size }
    }

    /// The pixel of a point, and its distance; `None` behind the camera.
    pub(super) fn pixel(&self, point: Vector3<f64>) -> Option<([f64; 2], f64)> {
        let [x, y, depth] = self.axes.map(|axis| axis.dot(&(point - self.at)));
        let (u, v) = (self.focal_px * x / depth, self.focal_px * y / depth);
        (depth > NEAR_M).then(|| ([0.5 * self.size[0] + u, 0.5 * self.size[1] - v], depth))
    }
}

/// The picture of a sweep.
pub(super) struct View3 {
    pub(super) raster: Raster,
    pub(super) camera: Camera,
    pub(super) points: usize,
    pub(super) counts: [u64; KINDS.len()],
    /// Metres of travel, where it is more than one sweep.
    pub(super) swath_m: Option<f64>,
    /// The middle of what is shown on the way.
    pub(super) sweep: usize,
}

/// Draws a sweep in the middle of a visit.
pub(super) fn draw(plan: &Plan<'_>, tiles: &mut Tiles<'_>, size: [f64; 2]) -> View3 {
    let middle = plan.truth.len() / 2;
    let at = plan.truth[middle].translation.vector;
    let spinning = matches!(plan.sensor.scan, Scan::Spinning { .. });
    let near = |n: &usize| (plan.truth[*n].translation.vector - at).norm() <= 0.5 * SWATH_M;
    let sweeps: Vec<usize> =
        if spinning { vec![middle] } else { (0..plan.truth.len()).filter(near).collect() };
    // A little before and after: the way the sensor goes, whichever way it is mounted.
    let (a, b) = (middle.saturating_sub(3), (middle + 3).min(plan.truth.len() - 1));
    let along = plan.truth[b].translation.vector - plan.truth[a].translation.vector;
    let fine = size.map(|px| px * FINER as f64);
    let camera = Camera::behind(at, along.y.atan2(along.x), fine);
    let mut canvas = Canvas::new(fine);
    let (mut points, mut counts) = (0, [0; KINDS.len()]);
    for batch in sweeps.chunk_by(|a, b| plan.batch(*a) == plan.batch(*b)) {
        let scene = plan.scene(tiles, batch[0]);
        for &n in batch {
            for point in plan.sweep(n, &scene) {
                let xyz = nalgebra::Point3::from(point.xyz.map(f64::from));
                let pose: Pose = match plan.is_undistorted() {
                    true => plan.truth[n],
                    false => plan.pose(plan.stamps_ns[n] as f64 * 1e-9 + f64::from(point.time)),
                };
                let place = (pose * xyz).coords;
                let kind = kind_of(point.class);
                points += 1;
                counts[kind] += 1;
                let Some((pixel, depth)) = camera.pixel(place) else { continue };
                canvas.point(pixel, depth, colour(kind, place.z - at.z, depth), fine[0] / (2.0 * HALF_FIELD));
            }
        }
    }
    let raster = Raster { width: canvas.width, height: canvas.height, rgb: canvas.rgb }.shrunk(FINER);
    let swath_m = (!spinning).then_some(SWATH_M);
    View3 {
        raster,
        camera: Camera { size, focal_px: camera.focal_px / FINER as f64, ..camera },
        points,
        counts,
        swath_m,
        sweep: middle,
    }
}

/// Brighter than on the map, brighter still higher up; the ground faint.
fn colour(kind: usize, above: f64, depth: f64) -> [f32; 3] {
    let fade = (-(depth - BEHIND_M).max(0.0) / FADE_M).exp().max(0.16) as f32;
    let (light, white) = match KINDS[kind].ground {
        true => (0.42, 0.0),
        false => (1.0, (0.12 + 0.05 * above.clamp(0.0, 9.0)) as f32),
    };
    let lit = KINDS[kind].rgb.map(|v| (f32::from(v) * 1.12 * (1.0 - white) + 255.0 * white) * light);
    [0, 1, 2].map(|c| lit[c] * fade + NIGHT[1][c] * (1.0 - fade))
}

struct Canvas {
    width: usize,
    height: usize,
    rgb: Vec<[f32; 3]>,
    depth: Vec<f32>,
}

impl Canvas {
    fn new(size: [f64; 2]) -> Self {
        let [width, height] = size.map(|px| px as usize);
        let sky = |i: usize| {
            let t = (i / width) as f32 / height as f32;
            [0, 1, 2].map(|c| NIGHT[0][c] + t * (NIGHT[1][c] - NIGHT[0][c]))
        };
        Self {
            width,
            height,
            rgb: (0..width * height).map(sky).collect(),
            depth: vec![f32::INFINITY; width * height],
        }
    }

    /// A square about a pixel, nearer ones in front.
    fn point(&mut self, [x, y]: [f64; 2], depth: f64, rgb: [f32; 3], px_per_tangent: f64) {
        let limits = (POINT_PX.0 * FINER as f64, POINT_PX.1 * FINER as f64);
        let half = 0.5 * (POINT_M * px_per_tangent / depth).clamp(limits.0, limits.1);
        let range = |v: f64, size: usize| {
            let clamp = |v: f64| v.round().clamp(0.0, size as f64) as usize;
            clamp(v - half)..clamp(v + half)
        };
        for row in range(y, self.height) {
            for column in range(x, self.width) {
                let i = row * self.width + column;
                if (depth as f32) < self.depth[i] {
                    (self.depth[i], self.rgb[i]) = (depth as f32, rgb);
                }
            }
        }
    }
}
