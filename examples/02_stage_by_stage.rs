//! Stage by stage: what `Localizer::localize` does, by hand, with a look at what every stage gives.
//!
//! `cargo run --release -p esm-examples --example 02_stage_by_stage`

#![allow(clippy::print_stdout)] // An example for people.

use std::sync::Arc;

use esm_core::estimate::{ConsistencyGraph, search_in};
use esm_core::index::Index;
use esm_core::segment::{euclidean_clusters, ground_flags, segment, segments_of, voxel_filter};
use esm_core::verify::{LivePoints, Surroundings, chance_false, verify};
use esm_core::{Accumulator, Config, MapBuilder, Pose, describe, matching};
use esm_examples::{Error, off, street};

pub(crate) fn main() -> Result<(), Error> {
    let street = street()?;
    let mut config = Config::default();
    config.accumulate.distance_m = 10.0;
    let mut builder = MapBuilder::new(&config)?;
    for sweep in &street.first {
        builder.push_sweep(sweep.stamp, &sweep.cloud, &sweep.pose_map_sensor)?;
    }
    let map = Arc::new(builder.finish()?);
    println!("map          {} segments along {} places", map.len(), map.path().len());

    // Sweeps to a live cloud, in the newest sensor frame.
    let mut accumulator = Accumulator::new(config.accumulate.clone())?;
    let half = &street.second[..street.second.len() / 2];
    let clouds = half.iter().filter_map(|s| accumulator.push(s.stamp, &s.cloud, s.pose_odom_sensor));
    let live = clouds.last().ok_or("no cloud")?;
    println!("cloud        {} points of {:.1} m of travel", live.cloud.len(), live.travel_m);

    // Ground and segments, step by step; `segment` does the same, and takes sparse clouds into account.
    let points = voxel_filter(live.cloud.points(), config.segment.voxel);
    let flags = ground_flags(&points, &config.segment.ground);
    let (ground, objects): (Vec<_>, Vec<_>) =
        points.iter().zip(&flags).partition(|(_, is_ground)| **is_ground);
    let [ground, objects] =
        [ground, objects].map(|part| part.into_iter().map(|(p, _)| *p).collect::<Vec<_>>());
    let c = &config.segment;
    let clusters = euclidean_clusters(&objects, c.tolerance, c.min_points, c.max_points);
    let by_hand = segments_of(&objects, &ground, &clusters);
    let cut = segment(&live.cloud, &config.segment);
    assert_eq!(by_hand, cut.segments);
    println!(
        "segments     {} voxels, {} of them ground, {} segments",
        points.len(),
        ground.len(),
        by_hand.len()
    );

    // A row of numbers and a quality for each, on the map's scale.
    let descriptor = describe::by_name(&config.descriptor)?;
    let mut described = descriptor.describe(&cut.segments);
    if let Some(standardizer) = map.standardizer() {
        standardizer.apply(&mut described.values);
    }
    println!("descriptors  {} numbers each by {}", described.dim, descriptor.name());

    // The nearest map segments of each.
    let index = Index::new(map.descriptors(), descriptor.dim(), config.matching.search);
    let candidates = matching::candidates(&cut.segments, &described, &map, &index, &config.matching);
    println!("matching     {} candidate matches", candidates.len());

    // Which of them can be true together, and the places that most of them speak for.
    let graph = ConsistencyGraph::new(&candidates, config.pose.agreement());
    println!("consistency  {} of {} tested pairs agree", graph.edges(), graph.pair_tests());
    let found = search_in(&graph, &candidates, &config.pose, config.seed);
    for place in &found.places {
        println!("place        {} matches", place.support.inliers.len());
    }

    // Refined on the points of the map around it, and weighed by what both see.
    let best = found.places.first().ok_or("no place")?;
    let surroundings = Surroundings::new(Arc::clone(&map), config.accumulate.max_range_m);
    let at = best.pose_map_sensor.translation.vector.map(|v| v as f32);
    let surface = surroundings.surface([at.x, at.y, at.z])?;
    let verified = verify(&surface, &LivePoints::new(&cut, &config.verify), &best.pose_map_sensor);
    let per_thousand = 1000.0 * chance_false(best.support.inliers.len(), verified.overlap);
    println!(
        "verified     {:.0} % of the points fit, {:.0} % lie where the map was seen; {per_thousand:.1e} false in a thousand",
        100.0 * verified.overlap,
        100.0 * verified.seen
    );
    assert!(per_thousand <= config.verify.max_false_per_thousand, "believed");

    // Places are relative to the map's origin.
    let [x, y, z] = map.origin();
    let pose_map_sensor = Pose::translation(x, y, z) * verified.refined.pose_map_sensor;
    let truth = half.iter().find(|s| s.stamp == live.stamp).ok_or("no truth")?;
    let (metres, degrees) = off(&pose_map_sensor, &truth.pose_map_sensor);
    println!("pose         off by {metres:.2} m and {degrees:.2}°");
    assert!(metres < 2.0 && degrees < 5.0);
    Ok(())
}
