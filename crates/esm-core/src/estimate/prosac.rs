//! The arithmetic of PROSAC (Chum and Matas, CVPR 2005): when the pool of candidates grows and when to stop.

/// Draws after which PROSAC has become RANSAC (section 2.1, T_N).
pub const T_N: f64 = 200_000.0;

/// Chance accepted that the support of a pose is an accident, and that a better one was missed (section 2.2).
const SIGNIFICANCE: f64 = 0.05;

/// T'_n for n = 0..=total: the last draw at which the pool holds the n best candidates. Entries below `m` are 0.
pub fn growth(total: usize, m: usize) -> Vec<f64> {
    let mut table = vec![0.0; total + 1];
    if total < m {
        return table;
    }
    let mut t = T_N;
    for i in 0..m {
        t *= (m - i) as f64 / (total - i) as f64;
    }
    let mut prime = 1.0;
    table[m] = prime;
    for n in m..total {
        let next = t * (n + 1) as f64 / (n + 1 - m) as f64;
        prime += (next - t).ceil();
        t = next;
        table[n + 1] = prime;
    }
    table
}

/// I^min_n for n = 0..=total: support among the n best that a wrong pose reaches with a chance below 5 %. Under a
/// wrong pose the support beyond the m sampled is binomial: inliers - m ~ Bin(n - m, beta).
///
/// The entry is the smallest such j; where n < m it is `usize::MAX`.
pub fn non_random_support(total: usize, m: usize, beta: f64) -> Vec<usize> {
    let mut table = vec![usize::MAX; total + 1];
    for (n, entry) in table.iter_mut().enumerate().skip(m) {
        *entry = m + smallest_rare_count(n - m, beta);
    }
    table
}

/// Smallest x with P(Bin(n, p) >= x) below the significance.
fn smallest_rare_count(n: usize, p: f64) -> usize {
    // ln P(X = 0) first, then the ratio of neighbouring terms: no factorials, no underflow for the n used here.
    let mut ln_term = n as f64 * (1.0 - p).ln();
    let mut below = 0.0;
    let mut x = 0;
    loop {
        if 1.0 - below < SIGNIFICANCE {
            return x;
        }
        if x > n {
            return n + 1;
        }
        below += ln_term.exp();
        ln_term += ((n - x) as f64 / (x + 1) as f64).ln() + (p / (1.0 - p)).ln();
        x += 1;
    }
}

/// Draws after which a better pose would have been found with 95 %, given `inliers` among the `n` best.
pub fn maximality_draws(inliers: usize, n: usize, m: usize) -> f64 {
    if n == 0 || inliers < m {
        return f64::INFINITY;
    }
    let all_inliers = (inliers as f64 / n as f64).powi(m as i32);
    if all_inliers >= 1.0 { 0.0 } else { SIGNIFICANCE.ln() / (-all_inliers).ln_1p() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn non_random_support_equals_the_published_table() {
        let n = [10, 20, 50, 100, 200, 500, 1150];
        for (beta, want) in [
            (0.01, [5, 5, 6, 7, 8, 13, 21]),
            (0.001, [4, 4, 4, 5, 5, 6, 7]),
            (0.1, [6, 8, 12, 19, 31, 65, 136]),
        ] {
            let table = non_random_support(1150, 3, beta);
            assert_eq!(n.map(|n| table[n]), want, "beta {beta}");
        }
    }

    #[test]
    fn growth_equals_the_published_table() {
        let table = growth(1150, 3);
        let n = [10, 20, 50, 100, 200, 400, 800, 1150];
        assert_eq!(n.map(|n| table[n] as u64), [8, 18, 48, 187, 1149, 8587, 67660, 200583]);
    }

    #[test]
    fn plain_ransac_needs_46807_samples_at_four_percent() {
        assert_eq!(maximality_draws(4, 100, 3).ceil() as u64, 46_807);
    }

    #[test]
    fn few_candidates_make_no_table() {
        assert_eq!(growth(2, 3), vec![0.0; 3]);
        assert_eq!(non_random_support(2, 3, 0.01), vec![usize::MAX; 3]);
    }
}
