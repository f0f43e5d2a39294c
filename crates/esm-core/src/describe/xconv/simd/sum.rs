//! Sums over points.

use pulp::{Simd, WithSimd};

/// Adds rows of as many numbers as there are sums to these.
pub(crate) struct Sum<'a> {
    pub(crate) rows: &'a [f32],
    pub(crate) sums: &'a mut [f64],
}

impl WithSimd for Sum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        // Vectorised by the compiler.
        let width = self.sums.len();
        let mut first = 0;
        while first + width <= self.rows.len() {
            let row = &self.rows[first..first + width];
            for n in 0..width {
                self.sums[n] += f64::from(row[n]);
            }
            first += width;
        }
    }
}
