//! An own policy: a descriptor of your own, a region the robot is known to be in, and your own say in what is believed.
//!
//! `cargo run --release -p esm-examples --example 03_own_policy`

#![allow(clippy::print_stdout)] // An example for people.

use std::sync::Arc;

use esm_core::describe::{Descriptions, Descriptor};
use esm_core::estimate::{Found, Hypothesis, search};
use esm_core::index::{Index, Search};
use esm_core::segment::{Segment, segment};
use esm_core::{Accumulator, Config, MapBuilder, Pose, matching};
use esm_examples::{Error, off, street};

/// Height, the two spreads seen from above, and how high the points lie: four numbers, hand-made.
struct Sizes;

impl Descriptor for Sizes {
    fn name(&self) -> &'static str {
        "my-sizes"
    }

    fn version(&self) -> u32 {
        1
    }

    fn dim(&self) -> usize {
        4
    }

    // Of mixed units: the map brings each to zero mean and unit variance.
    fn standardized(&self) -> bool {
        true
    }

    fn describe(&self, segments: &[Segment]) -> Descriptions {
        let values = segments.iter().flat_map(sizes).collect();
        Descriptions {
            dim: 4,
            values,
            quality: vec![1.0; segments.len()],
            candidates: 40,
            ..Default::default()
        }
    }
}

fn sizes(s: &Segment) -> [f32; 4] {
    let n = s.points.len() as f32;
    let [mut xx, mut xy, mut yy] = [0.0f32; 3];
    for p in &s.points {
        let (x, y) = (p[0] - s.centroid[0], p[1] - s.centroid[1]);
        (xx, xy, yy) = (xx + x * x / n, xy + x * y / n, yy + y * y / n);
    }
    // Eigenvalues of the horizontal covariance: the same however the segment is turned.
    let (middle, apart) = ((xx + yy) / 2.0, ((xx - yy) * (xx - yy) / 4.0 + xy * xy).sqrt());
    let spread = |v: f32| v.max(1e-4).ln() / 2.0;
    let height = (s.max[2] - s.min[2]).max(0.1);
    [height.ln(), spread(middle + apart), spread(middle - apart), (s.centroid[2] - s.min[2]) / height]
}

/// Believes a place that eight matches speak for, and twice as many as for any other.
fn believed(found: &Found) -> Option<&Hypothesis> {
    let best = found.places.first()?;
    let support = |place: &Hypothesis| place.support.inliers.len();
    let rival = found.places.get(1).map_or(0, support);
    (support(best) >= 8 && support(best) >= 2 * rival).then_some(best)
}

pub(crate) fn main() -> Result<(), Error> {
    let street = street()?;
    let mut config = Config::default();
    config.accumulate.distance_m = 10.0;
    let descriptor = Arc::new(Sizes);
    // `Localizer::with_descriptor(map, &config, descriptor)` would do the rest; here the policy is ours.
    let mut builder = MapBuilder::with_descriptor(&config, Arc::clone(&descriptor) as Arc<dyn Descriptor>)?;
    for sweep in &street.first {
        builder.push_sweep(sweep.stamp, &sweep.cloud, &sweep.pose_map_sensor)?;
    }
    let map = builder.finish()?;
    let index = Index::new(map.descriptors(), descriptor.dim(), Search::Auto);
    let [x, y, z] = map.origin();

    let mut accumulator = Accumulator::new(config.accumulate.clone())?;
    let (mut right, mut asked) = (0, 0);
    for sweep in street.second.iter().step_by(4) {
        let Some(live) = accumulator.push(sweep.stamp, &sweep.cloud, sweep.pose_odom_sensor) else {
            continue;
        };
        let segments = segment(&live.cloud, &config.segment).segments;
        let mut described = descriptor.describe(&segments);
        if let Some(standardizer) = map.standardizer() {
            standardizer.apply(&mut described.values);
        }
        let mut candidates = matching::candidates(&segments, &described, &map, &index, &config.matching);
        let all = candidates.len();
        // A poor GNSS, 15 m off, says where to look: within 40 m of that.
        let gnss = sweep.pose_map_sensor.translation.vector;
        let (east, north) = (gnss.x + 15.0 - x, gnss.y - y);
        candidates.retain(|c| {
            let m = c.pair.map;
            (f64::from(m[0]) - east).hypot(f64::from(m[1]) - north) < 40.0
        });
        let found = search(&candidates, &config.pose, config.seed);
        asked += 1;
        let Some(place) = believed(&found) else {
            println!("{:8.2} s  {} of {all} matches, nothing believed", live.stamp, candidates.len());
            continue;
        };
        let pose_map_sensor = Pose::translation(x, y, z) * place.pose_map_sensor;
        let (metres, degrees) = off(&pose_map_sensor, &sweep.pose_map_sensor);
        let support = place.support.inliers.len();
        println!(
            "{:8.2} s  {} of {all} matches, {support} agree, off by {metres:.2} m and {degrees:.2}°",
            live.stamp,
            candidates.len()
        );
        assert!(metres < 2.0 && degrees < 5.0, "a false pose");
        right += 1;
    }
    println!("{right} of {asked} clouds believed, all of them right");
    assert!(right > 0);
    Ok(())
}
