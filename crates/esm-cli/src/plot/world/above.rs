//! The world from above, as a camera on a cloudless afternoon sees it: rays straight down, and from what they hit to the sun.

use esm_sim::{Key, Ray, Scene, Tiles, World};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::super::view::View;
use super::kinds::{KINDS, kind_of};
use super::raster::Raster;

/// Rays a pixel and side.
const FINER: usize = 2;
/// Edge of the blocks the world is made in, metres.
const BLOCK_M: f64 = 96.0;
/// Shadows from farther away are not drawn, metres.
const SHADOW_M: f64 = 24.0;
/// Height of the camera above the ground, metres: above all that stands there.
const CAMERA_M: f64 = 120.0;
/// Where the sun stands: north-west, as map makers have it.
const SUN: [f32; 3] = [-0.52, 0.52, 0.68];
/// Light that reaches shadows.
const AMBIENT: f32 = 0.6;

/// The picture, and how many of its rays met each of [`KINDS`].
pub(super) fn draw(world: &World, view: &View) -> (Raster, [u64; KINDS.len()]) {
    let [width, height] = view.area.map(|px| px as usize * FINER);
    let step = 1.0 / (view.scale * FINER as f64);
    let mut pixels = vec![Sample::default(); width * height];
    let mut tiles = Tiles::new(world);
    let block = ((BLOCK_M / step) as usize).max(1);
    for top in (0..height).step_by(block) {
        for left in (0..width).step_by(block) {
            let at = |x: usize, y: usize| {
                [view.min[0] + (x as f64 + 0.5) * step, view.max[1] - (y as f64 + 0.5) * step]
            };
            let middle = at(left + block / 2, top + block / 2);
            let ground = world.height(middle[0], middle[1]);
            let reach = 0.71 * (block as f64 * step) + SHADOW_M;
            let scene = tiles.scene(&[Vector3::new(middle[0], middle[1], ground)], reach);
            let rows = pixels[top * width..(top + block).min(height) * width].par_chunks_mut(width);
            rows.enumerate().for_each(|(row, samples)| {
                for (x, sample) in samples.iter_mut().enumerate().skip(left).take(block) {
                    let [e, n] = at(x, top + row);
                    let key = Key::new(((top + row) * width + x) as u64);
                    *sample = look_down(&scene, Vector3::new(e, n, ground + CAMERA_M), key);
                }
            });
        }
    }
    let mut counts = [0; KINDS.len()];
    pixels.iter().filter(|s| s.seen).for_each(|s| counts[s.kind] += 1);
    let rgb = (0..pixels.len()).map(|i| shade(&pixels, width, i, step as f32)).collect();
    (Raster { width, height, rgb }.shrunk(FINER), counts)
}

#[derive(Clone, Copy, Debug, Default)]
struct Sample {
    seen: bool,
    kind: usize,
    /// Metres.
    height: f32,
    sunny: bool,
}

fn look_down(scene: &Scene, from: Vector3<f64>, key: Key) -> Sample {
    let origin = (from - scene.origin()).cast::<f32>();
    let down = Ray::try_new(origin, -Vector3::z(), key);
    let Some(hit) = down.and_then(|ray| scene.cast(&ray, 1000.0)) else { return Sample::default() };
    let at = origin - Vector3::z() * (hit.distance - 0.05);
    let to_sun = Ray::try_new(at, Vector3::from(SUN), key.with(1));
    let sunny = to_sun.is_none_or(|ray| scene.cast(&ray, SHADOW_M as f32).is_none());
    Sample { seen: true, kind: kind_of(hit.class), height: from.z as f32 - hit.distance, sunny }
}

/// Lambert's law on the slope between the neighbours.
fn shade(pixels: &[Sample], width: usize, i: usize, step: f32) -> [f32; 3] {
    let sample = pixels[i];
    if !sample.seen {
        return [255.0; 3];
    }
    let (x, row) = (i % width, i - i % width);
    let height = |j: usize| pixels.get(j).filter(|s| s.seen).map_or(sample.height, |s| s.height);
    let slope = |a: usize, b: usize| (0.25 * (height(a) - height(b)) / step).clamp(-0.9, 0.9);
    let east = slope(row + (x + 1).min(width - 1), row + x.saturating_sub(1));
    let north = slope(i.saturating_sub(width), (i + width).min(pixels.len() - 1));
    let normal = Vector3::new(-east, -north, 1.0).normalize();
    let sun = Vector3::from(SUN).normalize();
    let direct = normal.dot(&sun).max(0.0) / sun.z;
    let light =
        if sample.sunny { AMBIENT + (1.0 - AMBIENT) * direct } else { AMBIENT * (0.8 + 0.2 * direct) };
    KINDS[sample.kind].rgb.map(|v| f32::from(v) * light.min(1.25))
}
