//! [`Curve`]: a receiver operating characteristic and its area.

use serde::{Deserialize, Serialize};

/// False positive rates at which a curve is kept: 0, 0.005, ... 1.
const STEPS: usize = 200;

/// True against false positive rate over all thresholds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    /// Area under it, of all pairs; ties count half. The chance that a positive scores higher than a negative.
    pub auc: f64,
    /// True positive rates at the false positive rates 0, 0.005, ... 1: the highest that is reached there.
    pub true_positive: Vec<f64>,
}

impl Curve {
    /// From the scores of positives and negatives, higher is more alike; `None` where one of them is missing.
    ///
    /// ```
    /// let curve = esm_eval::Curve::of(&[0.9, 0.8, 0.3], &[0.5, 0.1]).unwrap();
    /// assert!((curve.auc - 5.0 / 6.0).abs() < 1e-12);
    /// assert_eq!((curve.true_positive[0], curve.true_positive[200]), (2.0 / 3.0, 1.0));
    /// ```
    pub fn of(positive: &[f64], negative: &[f64]) -> Option<Self> {
        if positive.is_empty() || negative.is_empty() {
            return None;
        }
        let mut scores: Vec<(f64, bool)> =
            positive.iter().map(|s| (*s, true)).chain(negative.iter().map(|s| (*s, false))).collect();
        scores.sort_by(|a, b| b.0.total_cmp(&a.0));
        // One corner a threshold: equal scores pass together.
        let (mut corners, mut at) = (vec![[0.0, 0.0]], [0usize, 0]);
        for tied in scores.chunk_by(|a, b| a.0 == b.0) {
            let right = tied.iter().filter(|s| s.1).count();
            at = [at[0] + tied.len() - right, at[1] + right];
            corners.push([at[0] as f64 / negative.len() as f64, at[1] as f64 / positive.len() as f64]);
        }
        let area = |pair: &[[f64; 2]]| 0.5 * (pair[1][0] - pair[0][0]) * (pair[0][1] + pair[1][1]);
        let auc = corners.windows(2).map(area).sum();
        let true_positive = (0..=STEPS).map(|i| height(&corners, i as f64 / STEPS as f64)).collect();
        Some(Self { auc, true_positive })
    }

    /// Its points, false and true positive rate.
    pub fn points(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        let last = (self.true_positive.len().max(2) - 1) as f64;
        self.true_positive.iter().enumerate().map(move |(i, t)| [i as f64 / last, *t])
    }
}

/// The highest point of the corners' polygon at a false positive rate.
fn height(corners: &[[f64; 2]], x: f64) -> f64 {
    let after = corners.partition_point(|c| c[0] <= x);
    let [x0, y0] = corners[after - 1];
    match corners.get(after) {
        Some([x1, y1]) => y0 + (x - x0) / (x1 - x0) * (y1 - y0),
        None => y0,
    }
}

/// The curve of the pairs, positives and negatives together, that are left without the third of lowest quality; `None` where
/// all have one quality. Each side is its scores and its qualities.
pub(super) fn without_worst_third(positive: (&[f64], &[f64]), negative: (&[f64], &[f64])) -> Option<Curve> {
    let mut all: Vec<f64> = positive.1.iter().chain(negative.1).copied().collect();
    all.sort_by(f64::total_cmp);
    if all.first() == all.last() {
        return None;
    }
    let least = all[all.len() / 3];
    let kept = |(scores, quality): (&[f64], &[f64])| -> Vec<f64> {
        scores.iter().zip(quality).filter(|(_, q)| **q >= least).map(|(s, _)| *s).collect()
    };
    Curve::of(&kept(positive), &kept(negative))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_area_is_the_chance_of_the_right_order() {
        let positive = [5.0, 3.0, 3.0, 1.0, 8.0];
        let negative = [3.0, 0.5, 4.0, 1.0];
        let mut chance = 0.0;
        for p in positive {
            for n in negative {
                chance += if p > n {
                    1.0
                } else if p == n {
                    0.5
                } else {
                    0.0
                };
            }
        }
        let curve = Curve::of(&positive, &negative).unwrap();
        assert!((curve.auc - chance / 20.0).abs() < 1e-12);
        assert!(curve.true_positive.windows(2).all(|p| p[0] <= p[1]));
        assert_eq!(curve.points().last(), Some([1.0, 1.0]));
    }

    #[test]
    fn extremes() {
        assert_eq!(Curve::of(&[2.0], &[1.0]).unwrap().auc, 1.0);
        assert_eq!(Curve::of(&[1.0], &[2.0]).unwrap().auc, 0.0);
        assert_eq!(Curve::of(&[1.0, 1.0], &[1.0]).unwrap().auc, 0.5);
        assert!(Curve::of(&[], &[1.0]).is_none() && Curve::of(&[1.0], &[]).is_none());
    }

    #[test]
    fn the_worst_third_is_left_out() {
        // The one positive that is unlike has the lowest quality.
        let (positive, good) = ([3.0, 3.0, 0.0], [0.9, 0.8, 0.1]);
        let (negative, bad) = ([1.0, 1.0, 5.0], [0.9, 0.9, 0.2]);
        let all = Curve::of(&positive, &negative).unwrap().auc;
        let best = without_worst_third((&positive, &good), (&negative, &bad)).unwrap().auc;
        assert!(best == 1.0 && all < 0.6, "{all} {best}");
        assert!(without_worst_third((&positive, &[0.5; 3]), (&negative, &[0.5; 3])).is_none());
    }
}
