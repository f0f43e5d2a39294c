//! Heights from layers of noise.

use crate::hash::Key;
use crate::noise::value;

/// Layers of noise: wavelength and amplitude, metres.
pub(super) struct Terrain {
    pub(super) key: Key,
    pub(super) layers: &'static [(f64, f64)],
}

impl Terrain {
    /// The sum of the layers; those shorter than `smooth_m` count by `rough` (0 to 1).
    pub(super) fn height(&self, x: f64, y: f64, smooth_m: f64, rough: f64) -> f64 {
        self.layers
            .iter()
            .enumerate()
            .map(|(n, (wavelength, amplitude))| {
                let share = if *wavelength < smooth_m { rough } else { 1.0 };
                if share == 0.0 {
                    return 0.0;
                }
                // Turned against each other, so that the lattices of the layers do not show.
                let (s, c) = (0.7 * n as f64 + 0.3).sin_cos();
                let (u, v) = (c * x - s * y, s * x + c * y);
                share * amplitude * value(self.key.with(n as u64), u / wavelength, v / wavelength)
            })
            .sum()
    }
}
