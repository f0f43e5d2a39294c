//! How often a false place looks as good as this one: what the verdict's threshold means.

/// Weight of the matches against the overlap in the evidence: s = logit(overlap) + MATCHES * ln(inliers).
const MATCHES: f64 = 0.5;
/// Evidence above which one in `SHARE` of the best false places lies.
const ANCHOR: f64 = 0.43;
/// Share of the best false places with more evidence than `ANCHOR`.
const SHARE: f64 = 0.2;
/// Evidence over which false places become e times rarer, in the world where they do so slowest.
const FOLD: f64 = 0.36;

/// Chance that the best place of a cloud that is nowhere in the map has this evidence or more, 0 to 1.
///
/// The evidence joins the share of points found in the map with the number of matches. Among clouds of simulated tuning
/// worlds in maps of other places it falls off exponentially; the constants are those of the slowest fall seen, made by
/// `python/eval/calibrate_verdict.py`. A place that looks just like the right one is another matter: the verdict
/// `ambiguous` is for that.
///
/// ```
/// use esm_core::verify::chance_false;
/// assert!(1000.0 * chance_false(20, 0.95) < 0.1, "sure");
/// assert!(1000.0 * chance_false(5, 0.5) > 10.0, "one in fourteen false ones is no worse");
/// ```
pub fn chance_false(inliers: usize, overlap: f64) -> f64 {
    if inliers == 0 || overlap <= 0.0 {
        return 1.0;
    }
    let overlap = overlap.min(0.999);
    let evidence = (overlap / (1.0 - overlap)).ln() + MATCHES * (inliers as f64).ln();
    (SHARE * (-(evidence - ANCHOR) / FOLD).exp()).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_evidence_is_never_worse() {
        for n in 0..60 {
            for o in 0..100 {
                let (o, here) = (f64::from(o) / 100.0, chance_false(n, f64::from(o) / 100.0));
                assert!((0.0..=1.0).contains(&here));
                assert!(chance_false(n + 1, o) <= here && chance_false(n, o + 0.01) <= here, "{n} {o}");
            }
        }
    }
}
