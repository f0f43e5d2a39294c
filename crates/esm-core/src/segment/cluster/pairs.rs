//! Whether any point of one cell is linked with any point of another.

/// Pairs of cells with more point pairs than this are bisected instead of compared point by point.
const MAX_BRUTE_FORCE_PAIRS: usize = 128;

#[inline]
fn distance2(p: &[f32; 3], q: &[f32; 3]) -> f32 {
    let (dx, dy, dz) = (p[0] - q[0], p[1] - q[1], p[2] - q[2]);
    (dx * dx + dy * dy) + dz * dz
}

/// Whether any point of `a` is linked with any of `b`. Reorders points within the slices.
#[inline]
pub(super) fn any_linked(a: &mut [[f32; 3]], b: &mut [[f32; 3]], tolerance2: f32) -> bool {
    if a.len() * b.len() <= MAX_BRUTE_FORCE_PAIRS {
        a.iter().any(|p| b.iter().any(|q| distance2(p, q) <= tolerance2))
    } else {
        any_linked_bisecting(a, b, tolerance2)
    }
}

/// [`any_linked`] for crowded cells: boxes decide where they can, else the larger side is halved.
fn any_linked_bisecting(a: &mut [[f32; 3]], b: &mut [[f32; 3]], tolerance2: f32) -> bool {
    let ((low_a, high_a), (low_b, high_b)) = (bounds(a), bounds(b));
    // f32 subtraction, product and sum are monotonic: what holds for the boxes holds for every pair, rounding included.
    let gap: [f32; 3] = std::array::from_fn(|i| (low_a[i] - high_b[i]).max(low_b[i] - high_a[i]).max(0.0));
    let span: [f32; 3] = std::array::from_fn(|i| (high_a[i] - low_b[i]).max(high_b[i] - low_a[i]));
    if distance2(&gap, &[0.0; 3]) > tolerance2 {
        return false;
    }
    if distance2(&span, &[0.0; 3]) <= tolerance2 {
        return true;
    }
    let (larger, other, low, high) =
        if a.len() >= b.len() { (a, b, low_a, high_a) } else { (b, a, low_b, high_b) };
    let extent: [f32; 3] = std::array::from_fn(|i| high[i] - low[i]);
    let axis = (0..3).fold(0, |best, i| if extent[i] > extent[best] { i } else { best });
    let middle = larger.len() / 2;
    larger.select_nth_unstable_by(middle, |p, q| p[axis].total_cmp(&q[axis]));
    let (left, right) = larger.split_at_mut(middle);
    any_linked(left, other, tolerance2) || any_linked(right, other, tolerance2)
}

fn bounds(points: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    points.iter().fold(([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]), |(low, high), p| {
        (std::array::from_fn(|a| low[a].min(p[a])), std::array::from_fn(|a| high[a].max(p[a])))
    })
}
