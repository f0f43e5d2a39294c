use proptest::prelude::*;

use super::*;

/// All pairs, flood fill.
fn naive(points: &[[f32; 3]], tolerance: f32, min: usize, max: usize) -> Vec<Vec<u32>> {
    let tolerance2 = tolerance * tolerance;
    let mut seen = vec![false; points.len()];
    let mut clusters = Vec::new();
    for start in 0..points.len() {
        if std::mem::replace(&mut seen[start], true) {
            continue;
        }
        let mut members = vec![start as u32];
        let mut next = 0;
        while let Some(&i) = members.get(next) {
            next += 1;
            for j in 0..points.len() {
                let (p, q) = (points[i as usize], points[j]);
                let (dx, dy, dz) = (p[0] - q[0], p[1] - q[1], p[2] - q[2]);
                if !seen[j] && (dx * dx + dy * dy) + dz * dz <= tolerance2 {
                    seen[j] = true;
                    members.push(j as u32);
                }
            }
        }
        members.sort_unstable();
        if (min..=max).contains(&members.len()) {
            clusters.push(members);
        }
    }
    clusters
}

/// Coordinates that hit what can go wrong: exact multiples of the tolerance, near misses, duplicates, extremes.
fn coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => -1.5f32..1.5,
        4 => (-4i32..5).prop_map(|i| i as f32 * 0.5),
        2 => (-4i32..5).prop_map(|i| (i as f32 * 0.5).next_up()),
        2 => (-4i32..5).prop_map(|i| (i as f32 * 0.5).next_down()),
        1 => (-3i32..4).prop_map(|i| 1e6 + i as f32 * 0.25),
        1 => (-3i32..4).prop_map(|i| -1e7 + i as f32),
        1 => prop_oneof![Just(f32::MAX), Just(f32::MIN), Just(1e30f32), Just(3e11f32), Just(3.1e11f32.next_up())],
        1 => Just(f32::MIN_POSITIVE),
    ]
}

/// Rarely off the line: collinear clouds and planes come up often.
fn cloud(max: usize) -> impl Strategy<Value = Vec<[f32; 3]>> {
    let point = prop_oneof![
        4 => [coordinate(), coordinate(), coordinate()],
        2 => coordinate().prop_map(|x| [x, 0.0, 0.0]),
        2 => coordinate().prop_map(|x| [x, x, x]),
        1 => (coordinate(), coordinate()).prop_map(|(y, z)| [0.25, y, z]),
    ];
    prop::collection::vec(point, 0..max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    #[test]
    fn equals_all_pairs(
        points in cloud(120),
        tolerance in prop_oneof![4 => Just(0.5f32), 2 => 0.05f32..2.0, 1 => Just(0.1f32), 1 => Just(1e4f32)],
        min in 1usize..4,
        max in prop_oneof![Just(usize::MAX), 1usize..30],
    ) {
        prop_assert_eq!(euclidean_clusters(&points, tolerance, min, max), naive(&points, tolerance, min, max));
    }

    #[test]
    fn crowded_cells_equal_all_pairs(
        points in prop::collection::vec([-0.6f32..0.6, -0.05f32..0.05, -0.6f32..0.6], 100..400),
        gap in 0.3f32..0.6,
    ) {
        // Two crowds with a gap about as wide as the tolerance: bisection has to find the one pair in reach.
        let points: Vec<_> = points.into_iter().map(|[x, y, z]| [x + gap.copysign(x), y, z]).collect();
        prop_assert_eq!(euclidean_clusters(&points, 0.9, 1, usize::MAX), naive(&points, 0.9, 1, usize::MAX));
    }

    #[test]
    fn a_permutation_only_renames(points in cloud(80), order in Just((0..80usize).collect::<Vec<_>>()).prop_shuffle()) {
        let order: Vec<usize> = order.into_iter().filter(|&i| i < points.len()).collect();
        let shuffled: Vec<_> = order.iter().map(|&i| points[i]).collect();
        let mut back: Vec<Vec<u32>> = euclidean_clusters(&shuffled, 0.5, 1, usize::MAX)
            .into_iter()
            .map(|c| {
                let mut c: Vec<u32> = c.into_iter().map(|i| order[i as usize] as u32).collect();
                c.sort_unstable();
                c
            })
            .collect();
        back.sort();
        prop_assert_eq!(back, euclidean_clusters(&points, 0.5, 1, usize::MAX));
    }
}

#[test]
fn exactly_at_the_tolerance_is_linked() {
    let at = [[0.0, 0.0, 0.0], [0.3, 0.4, 0.0], [0.3, 0.4, 0.5]];
    assert_eq!(euclidean_clusters(&at, 0.5, 1, 9), naive(&at, 0.5, 1, 9));
    assert_eq!(euclidean_clusters(&[[0.0; 3], [0.5, 0.0, 0.0]], 0.5, 1, 9), [[0, 1]]);
    let beyond = euclidean_clusters(&[[0.0; 3], [0.5f32.next_up(), 0.0, 0.0]], 0.5, 1, 9);
    assert_eq!(beyond, [[0], [1]]);
}

#[test]
fn two_crowds_just_out_of_reach_do_not_take_quadratic_time() {
    // Pair by pair this would be 10^11 distances, and no end to wait for.
    let n = 300_000;
    let points: Vec<[f32; 3]> = (0..n)
        .flat_map(|i| {
            let t = i as f32 / n as f32 * 0.2;
            [[0.0, t, 0.2 - t], [0.51, t, 0.2 - t]]
        })
        .collect();
    assert_eq!(euclidean_clusters(&points, 0.5, 1, usize::MAX).len(), 2);
}

#[test]
fn scattered_far_apart_needs_no_memory_in_between() {
    let points: Vec<[f32; 3]> =
        (0..20_000).map(|i| [i as f32 * 1e5, (i * 7919 % 20_011) as f32 * 1e6, i as f32 * -1e30]).collect();
    assert_eq!(euclidean_clusters(&points, 0.5, 1, usize::MAX).len(), points.len());
}

#[test]
fn empty_and_size_bounds() {
    assert!(euclidean_clusters(&[], 0.5, 1, 9).is_empty());
    let same = vec![[1.0, 2.0, 3.0]; 10];
    assert_eq!(euclidean_clusters(&same, 0.5, 10, 10).len(), 1);
    assert!(euclidean_clusters(&same, 0.5, 11, 20).is_empty());
    assert!(euclidean_clusters(&same, 0.5, 1, 9).is_empty());
}
