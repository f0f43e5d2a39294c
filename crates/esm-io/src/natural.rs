//! Natural file order: `scan_9` before `scan_10`.

use std::cmp::Ordering;

/// Compares two names with their runs of digits taken as numbers; equal numbers with more leading zeros come later.
///
/// ```
/// use esm_io::natural_order;
/// let mut names = ["scan10.pcd", "scan9.pcd", "scan009.pcd"];
/// names.sort_by(|a, b| natural_order(a, b));
/// assert_eq!(names, ["scan9.pcd", "scan009.pcd", "scan10.pcd"]);
/// ```
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    loop {
        let (Some(&p), Some(&q)) = (x.first(), y.first()) else {
            // What decides last is the plain text, so that only equal names are equal.
            return x.len().cmp(&y.len()).then_with(|| a.len().cmp(&b.len())).then_with(|| a.cmp(b));
        };
        if p.is_ascii_digit() && q.is_ascii_digit() {
            let (m, x_rest) = split_number(x);
            let (n, y_rest) = split_number(y);
            match m.len().cmp(&n.len()).then_with(|| m.cmp(n)) {
                Ordering::Equal => (x, y) = (x_rest, y_rest),
                other => return other,
            }
        } else if p != q {
            return p.cmp(&q);
        } else {
            (x, y) = (&x[1..], &y[1..]);
        }
    }
}

/// The leading run of digits without its zeros, and what follows it.
fn split_number(s: &[u8]) -> (&[u8], &[u8]) {
    let end = s.iter().position(|c| !c.is_ascii_digit()).unwrap_or(s.len());
    let zeros = s[..end].iter().position(|&c| c != b'0').unwrap_or(end);
    (&s[zeros..end], &s[end..])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_count_as_numbers() {
        let mut v =
            vec!["b1", "a10", "a2", "a02", "a", "a1.5", "a1.10", "2", "10", "00000000000000000000003"];
        v.sort_by(|a, b| natural_order(a, b));
        assert_eq!(v, ["2", "00000000000000000000003", "10", "a", "a1.5", "a1.10", "a2", "a02", "a10", "b1"]);
    }

    proptest! {
        #[test]
        fn is_a_total_order(mut v in proptest::collection::vec("[ab0-2.]{0,5}", 0..12)) {
            v.sort_by(|a, b| natural_order(a, b));
            for i in 0..v.len() {
                for j in i..v.len() {
                    prop_assert_ne!(natural_order(&v[i], &v[j]), Ordering::Greater);
                    prop_assert_eq!(natural_order(&v[i], &v[j]), natural_order(&v[j], &v[i]).reverse());
                    prop_assert_eq!(natural_order(&v[i], &v[j]) == Ordering::Equal, v[i] == v[j]);
                }
            }
        }
    }
}
