//! Counter-based random numbers: every number is a function of a key, never of the order in which it was asked for.
//!
//! SplitMix64's finaliser (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014) mixes the
//! words. What a ray draws depends on its key and on what it meets, so any number of threads gives the same bits.

/// A point in the tree of random streams; [`with`](Self::with) goes down to a child.
///
/// ```
/// use esm_sim::Key;
/// let tile = Key::new(7).with(3);
/// assert_eq!(tile.unit(), Key::new(7).with(3).unit());
/// assert_ne!(tile.unit(), Key::new(7).with(4).unit());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key(u64);

const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

#[inline]
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

impl Key {
    /// The root of a seed.
    pub fn new(seed: u64) -> Self {
        Self(mix(seed.wrapping_add(GOLDEN)))
    }

    /// The child of a number.
    #[inline]
    pub fn with(self, n: u64) -> Self {
        Self(mix(self.0.wrapping_add(GOLDEN.wrapping_mul(n.wrapping_add(1)))))
    }

    /// The child of a cell of a grid.
    pub fn cell(self, x: i64, y: i64) -> Self {
        self.with(x.cast_unsigned()).with(y.cast_unsigned())
    }

    /// A uniform number in (0, 1): never 0, so that its logarithm is finite.
    #[inline]
    pub fn unit(self) -> f32 {
        ((self.0 >> 41) as f32 + 0.5) * (1.0 / (1u32 << 23) as f32)
    }

    /// The numbers of this key, one after the other.
    pub fn draw(self) -> Draw {
        Draw { key: self, n: 0 }
    }
}

/// Numbers drawn from one key in a row.
#[derive(Clone, Debug)]
pub struct Draw {
    key: Key,
    n: u64,
}

impl Draw {
    /// Uniform in (0, 1).
    pub fn unit(&mut self) -> f32 {
        self.n += 1;
        self.key.with(self.n).unit()
    }

    /// Uniform in (a, b).
    pub fn range(&mut self, a: f32, b: f32) -> f32 {
        a + (b - a) * self.unit()
    }

    /// One of 0..n; 0 for n = 0.
    pub fn index(&mut self, n: usize) -> usize {
        ((self.unit() * n as f32) as usize).min(n.saturating_sub(1))
    }

    /// A whole number in a..=b.
    pub fn count(&mut self, a: usize, b: usize) -> usize {
        a + self.index(b + 1 - a)
    }

    /// True with probability `p`.
    pub fn chance(&mut self, p: f32) -> bool {
        self.unit() < p
    }

    /// Standard normal (Box and Muller).
    pub fn normal(&mut self) -> f32 {
        let (u, v) = (self.unit(), self.unit());
        (-2.0 * u.ln()).sqrt() * (std::f32::consts::TAU * v).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_and_normal_have_their_moments() {
        let n = 100_000;
        let mut draw = Key::new(1).draw();
        let mean = (0..n).map(|_| f64::from(draw.unit())).sum::<f64>() / f64::from(n);
        assert!((mean - 0.5).abs() < 0.005, "{mean}");
        let squares = (0..n).map(|_| f64::from(draw.normal()).powi(2)).sum::<f64>() / f64::from(n);
        assert!((squares - 1.0).abs() < 0.02, "{squares}");
    }

    #[test]
    fn units_stay_inside_their_ends() {
        for n in 0..100_000 {
            let u = Key::new(2).with(n).unit();
            assert!(u > 0.0 && u < 1.0, "{u}");
        }
    }
}
