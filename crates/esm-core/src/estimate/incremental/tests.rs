use proptest::prelude::*;

use super::*;
use crate::estimate::{ANY_TURN, Method, Pair, sort_by_quality};

/// A live segment of the made-up robot.
#[derive(Clone, Debug)]
struct Thing {
    identity: u64,
    at: [f32; 3],
    /// Map segments it may be, and the turns allowed.
    matches: Vec<(u32, u64)>,
}

#[derive(Clone, Debug)]
enum Change {
    Appears(Thing),
    Disappears(usize),
    Moves(usize, [f32; 3]),
    Matches(usize, Vec<(u32, u64)>),
    Swaps(usize, usize),
    Identity(usize, u64),
}

/// Where a map segment is: on a lattice that is not quite one, so that many pairs nearly agree.
fn mapped(map: u32) -> [f32; 3] {
    let (x, y) = ((map % 23) as f32, (map / 23) as f32);
    [x * 6.0 + (map % 7) as f32 * 0.31, y * 6.0 + (map % 5) as f32 * 0.27, (map % 3) as f32 * 0.4]
}

fn matches() -> impl Strategy<Value = Vec<(u32, u64)>> {
    let turns =
        prop_oneof![Just(ANY_TURN), Just(ANY_TURN), (0u32..64).prop_map(|b| 0xff_ffff_u64.rotate_left(b))];
    prop::collection::vec((0u32..400, turns), 1..12)
}

fn thing() -> impl Strategy<Value = Thing> {
    let at = (-40.0f32..40.0, -40.0f32..40.0, 0.0f32..2.0);
    (0u64..60, at, matches()).prop_map(|(identity, at, matches)| Thing { identity, at: at.into(), matches })
}

fn change() -> impl Strategy<Value = Change> {
    let small = prop::array::uniform3(-0.06f32..0.06);
    let large = prop::array::uniform3(-3.0f32..3.0);
    prop_oneof![
        3 => thing().prop_map(Change::Appears),
        2 => (0usize..40).prop_map(Change::Disappears),
        4 => (0usize..40, small).prop_map(|(i, d)| Change::Moves(i, d)),
        1 => (0usize..40, large).prop_map(|(i, d)| Change::Moves(i, d)),
        2 => (0usize..40, matches()).prop_map(|(i, m)| Change::Matches(i, m)),
        1 => (0usize..40, 0usize..40).prop_map(|(i, j)| Change::Swaps(i, j)),
        1 => (0usize..40, 0u64..60).prop_map(|(i, n)| Change::Identity(i, n)),
    ]
}

fn apply(things: &mut Vec<Thing>, change: Change) {
    let n = things.len();
    match change {
        Change::Appears(thing) => things.push(thing),
        _ if n == 0 => {}
        Change::Disappears(i) => drop(things.remove(i % n)),
        Change::Moves(i, d) => (0..3).for_each(|a| things[i % n].at[a] += d[a]),
        Change::Matches(i, matches) => things[i % n].matches = matches,
        Change::Swaps(i, j) => things.swap(i % n, j % n),
        Change::Identity(i, identity) => things[i % n].identity = identity,
    }
}

/// Candidates, best first, and identities. Matches are repeated as they come: one segment may be matched twice with one.
fn cloud(things: &[Thing]) -> (Vec<Candidate>, Vec<u64>) {
    let mut all = Vec::new();
    for (live, thing) in things.iter().enumerate() {
        for (k, (map, turns)) in thing.matches.iter().enumerate() {
            let pair = Pair { live: thing.at, map: mapped(*map) };
            let distance = k as f32;
            all.push(Candidate { live: live as u32, map: *map, distance, quality: 1.0, pair, turns: *turns });
        }
    }
    sort_by_quality(&mut all);
    (all, things.iter().map(|t| t.identity).collect())
}

/// Checks one cloud: the same graph, the same places, the same effort but for the pair tests.
fn check(
    robot: &mut IncrementalRecognizer,
    things: &[Thing],
    config: &PoseConfig,
) -> Result<(), TestCaseError> {
    let (candidates, identities) = cloud(things);
    let batch = ConsistencyGraph::new(&candidates, config.agreement());
    let graph = robot.clone().graph(&candidates, &identities);
    prop_assert!(graph.same_as(&batch));
    let mut found = robot.search(&candidates, &identities);
    let want = search(&candidates, config, 5);
    found.stats.pair_tests = want.stats.pair_tests;
    prop_assert_eq!(found, want);
    prop_assert_eq!(robot.known.len(), candidates.len());
    Ok(())
}

proptest! {
    #[test]
    fn whatever_changes_it_finds_what_the_batch_finds(
        first in prop::collection::vec(thing(), 5..30),
        steps in prop::collection::vec(prop::collection::vec(change(), 0..6), 1..8),
        gravity in any::<bool>(),
        method in prop_oneof![Just(Method::Clique), Just(Method::Plain)],
    ) {
        let config = PoseConfig { gravity, method, ..Default::default() };
        let mut robot = IncrementalRecognizer::new(&config, 5);
        let mut things = first;
        check(&mut robot, &things, &config)?;
        for changes in steps {
            changes.into_iter().for_each(|c| apply(&mut things, c));
            check(&mut robot, &things, &config)?;
        }
    }

    #[test]
    fn a_creeping_segment_is_never_lost(step in prop::array::uniform3(-0.04f32..0.04), first in prop::collection::vec(thing(), 10..30)) {
        // Always within reach of the last cloud, never for long of where it was anchored.
        let config = PoseConfig::default();
        let mut robot = IncrementalRecognizer::new(&config, 5);
        let mut things = first;
        for _ in 0..12 {
            check(&mut robot, &things, &config)?;
            things.iter_mut().step_by(2).for_each(|t| (0..3).for_each(|a| t.at[a] += step[a]));
        }
    }
}

fn row(n: u64) -> Vec<Thing> {
    (0..n)
        .map(|i| Thing {
            identity: i,
            at: [i as f32 * 5.0, (i * i % 7) as f32, 0.0],
            matches: vec![(i as u32, ANY_TURN), (i as u32 + 100, ANY_TURN)],
        })
        .collect()
}

#[test]
fn what_has_not_moved_is_not_tested_again() {
    let config = PoseConfig::default();
    let mut robot = IncrementalRecognizer::new(&config, 5);
    let mut things = row(20);
    let (candidates, identities) = cloud(&things);
    let batch = search(&candidates, &config, 5).stats.pair_tests;
    let first = robot.search(&candidates, &identities).stats.pair_tests;
    assert!(first >= batch);
    assert_eq!(robot.search(&candidates, &identities).stats.pair_tests, 0);
    assert_eq!((robot.reuse().kept, robot.reuse().fresh), (40, 0));
    // One of twenty moves a little, then far.
    things[3].at[0] += 0.05;
    let (candidates, identities) = cloud(&things);
    robot.search(&candidates, &identities);
    assert_eq!((robot.reuse().kept, robot.reuse().fresh_tests), (40, 0));
    assert!(robot.reuse().repeated_tests > 0 && robot.reuse().repeated_tests < batch / 5);
    things[3].at[0] += 1.0;
    let (candidates, identities) = cloud(&things);
    robot.search(&candidates, &identities);
    assert_eq!((robot.reuse().kept, robot.reuse().fresh), (38, 2));
    robot.forget();
    robot.search(&candidates, &identities);
    assert_eq!(robot.reuse().kept, 0);
}

#[test]
fn nothing_is_kept_of_what_is_gone() {
    let config = PoseConfig::default();
    let mut robot = IncrementalRecognizer::new(&config, 5);
    let (candidates, identities) = cloud(&row(20));
    robot.search(&candidates, &identities);
    assert!(robot.reuse().pairs > 0);
    assert!(robot.search(&[], &[]).places.is_empty());
    assert_eq!((robot.known.len(), robot.near.len(), robot.keys.len()), (0, 0, 0));
}

#[test]
fn coordinates_that_are_none_agree_with_nothing_and_harm_nobody() {
    let config = PoseConfig::default();
    let mut robot = IncrementalRecognizer::new(&config, 5);
    let (mut candidates, identities) = cloud(&row(8));
    for bad in [f32::NAN, f32::INFINITY, 3e38] {
        candidates[0].pair.live[1] = bad;
        candidates[1].pair.map[0] = bad;
        for _ in 0..2 {
            let places = robot.search(&candidates, &identities).places;
            assert_eq!(places, search(&candidates, &config, 5).places);
        }
    }
}
