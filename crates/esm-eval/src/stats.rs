//! Shares with their confidence, and medians.

use serde::{Deserialize, Serialize};

/// Two-sided 95 % quantile of the normal distribution.
const Z_95: f64 = 1.959_963_984_540_054;

/// The same of Student's distribution with 1, 2, ... 30 degrees of freedom (Abramowitz and Stegun, table 26.10).
const T_95: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
    2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
];

/// A share with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// The share, 0 to 1.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Share {
    /// `hits` of `all`, with Wilson's score interval (1927), which holds for few and for extreme counts too; `None` of
    /// nothing. It takes the clouds for independent, which neighbours of one drive are not: over several worlds
    /// [`over`](Self::over) is the honest one.
    ///
    /// ```
    /// let share = esm_eval::Share::wilson(30, 30).unwrap();
    /// assert!(share.value == 1.0 && share.high == 1.0 && (share.low - 0.8865).abs() < 1e-4);
    /// ```
    pub fn wilson(hits: usize, all: usize) -> Option<Self> {
        if all == 0 {
            return None;
        }
        let (n, p, z2) = (all as f64, hits as f64 / all as f64, Z_95 * Z_95);
        let middle = (p + z2 / (2.0 * n)) / (1.0 + z2 / n);
        let half = Z_95 / (1.0 + z2 / n) * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt();
        // Rounding must not put the ends inside the share.
        Some(Self { value: p, low: (middle - half).clamp(0.0, p), high: (middle + half).clamp(p, 1.0) })
    }

    /// The mean of the shares of several worlds with Student's interval, cut at 0 and 1; `None` of fewer than two.
    ///
    /// ```
    /// let share = esm_eval::Share::over(&[0.90, 0.94, 0.98]).unwrap();
    /// assert!((share.value - 0.94).abs() < 1e-12 && (share.low - 0.8406).abs() < 1e-4 && share.high == 1.0);
    /// ```
    pub fn over(shares: &[f64]) -> Option<Self> {
        let n = shares.len();
        if n < 2 {
            return None;
        }
        let mean = shares.iter().sum::<f64>() / n as f64;
        let variance = shares.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1) as f64;
        let half = T_95.get(n - 2).unwrap_or(&Z_95) * (variance / n as f64).sqrt();
        Some(Self { value: mean, low: (mean - half).max(0.0), high: (mean + half).min(1.0) })
    }
}

/// The middle value, the mean of the two where they are even; `None` of nothing. Values must not be NaN.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        n if n % 2 == 1 => Some(values[middle]),
        _ => Some(0.5 * (values[middle - 1] + values[middle])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_is_the_published_one() {
        // Newcombe (1998), table I: 81 of 263, 0 of 20, 1 of 29.
        for (hits, all, low, high) in
            [(81, 263, 0.2553, 0.3662), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)]
        {
            let share = Share::wilson(hits, all).unwrap();
            assert!((share.low - low).abs() < 5e-5 && (share.high - high).abs() < 5e-5, "{share:?}");
        }
        assert_eq!(Share::wilson(0, 0), None);
    }

    #[test]
    fn one_world_has_no_spread() {
        assert_eq!(Share::over(&[0.9]), None);
        let same = Share::over(&[0.9; 4]).unwrap();
        assert!((same.high - same.low).abs() < 1e-12);
    }

    #[test]
    fn medians() {
        assert_eq!(median(vec![]), None);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), Some(2.5));
    }
}
