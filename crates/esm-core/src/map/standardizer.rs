//! [`Standardizer`]: brings a descriptor's dimensions, which have different units, to one scale.

/// Statistics of a map's descriptors: a row becomes `(row - mean) * inv_std`, dimension by dimension.
#[derive(Clone, Debug, PartialEq)]
pub struct Standardizer {
    /// Mean of each dimension.
    pub mean: Vec<f32>,
    /// One over the standard deviation of each dimension; 0 where the dimension is constant and so says nothing.
    pub inv_std: Vec<f32>,
}

impl Standardizer {
    /// The statistics of row-major `rows` of `dim` numbers; all zero where there are no rows.
    ///
    /// Sums run in f64 and in the order of the rows, so the result does not depend on threads.
    ///
    /// ```
    /// let statistics = esm_core::map::Standardizer::fit(&[1.0, 7.0, 3.0, 7.0], 2);
    /// let mut live = [2.0, 7.0, 4.0, 9.0];
    /// statistics.apply(&mut live);
    /// assert_eq!(live, [0.0, 0.0, 2.0, 0.0]);
    /// ```
    pub fn fit(rows: &[f32], dim: usize) -> Self {
        let count = rows.len().checked_div(dim).unwrap_or(0);
        let n = count.max(1) as f64;
        let mut mean = vec![0f64; dim];
        for row in rows.chunks_exact(dim.max(1)) {
            mean.iter_mut().zip(row).for_each(|(m, &v)| *m += v as f64);
        }
        mean.iter_mut().for_each(|m| *m /= n);
        let mut variance = vec![0f64; dim];
        for row in rows.chunks_exact(dim.max(1)) {
            for ((s, &v), m) in variance.iter_mut().zip(row).zip(&mean) {
                *s += (v as f64 - m).powi(2);
            }
        }
        let inv_std = variance.iter().zip(&mean).map(|(s, m)| {
            let std = (s / n).sqrt();
            // Below f32's resolution at the mean's size the spread is rounding, not information.
            if std > f32::EPSILON as f64 * m.abs().max(f32::MIN_POSITIVE as f64) {
                (1.0 / std) as f32
            } else {
                0.0
            }
        });
        let inv_std = inv_std.map(|v| if v.is_finite() { v } else { 0.0 }).collect();
        Self { mean: mean.iter().map(|&m| m as f32).collect(), inv_std }
    }

    /// Leaves the dimensions from `first` on as they are.
    pub(crate) fn leave_from(&mut self, first: usize) {
        self.mean.iter_mut().skip(first).for_each(|m| *m = 0.0);
        self.inv_std.iter_mut().skip(first).for_each(|s| *s = 1.0);
    }

    /// Standardises row-major `rows` of as many numbers as this has dimensions, in place.
    pub fn apply(&self, rows: &mut [f32]) {
        for row in rows.chunks_exact_mut(self.mean.len().max(1)) {
            for ((v, m), s) in row.iter_mut().zip(&self.mean).zip(&self.inv_std) {
                *v = (*v - m) * s;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_stays_as_it_is() {
        let mut statistics = Standardizer::fit(&[1.0, 7.0, 5.0, 3.0, 9.0, 5.0], 3);
        statistics.leave_from(1);
        let mut row = [3.0, 8.5, 0.25];
        statistics.apply(&mut row);
        assert_eq!(row, [1.0, 8.5, 0.25]);
    }
}
