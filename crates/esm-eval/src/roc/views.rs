//! [`Views`]: segments as one visit saw them, with the names of what they show.

use esm_core::describe::{Descriptor, Shape};
use esm_core::segment::Segment;
use esm_core::{AccumulateConfig, Config};
use esm_io::Recording;
use esm_learn::{Found, Identities, IdentityRule, Surveyor};

use crate::error::Error;
use crate::objects::object_of;
use crate::plan::RocPlan;
use crate::site::Site;
use crate::truth::{self, Trajectory};
use crate::watch::Teller;

/// Where `shape` has the logs of height and both extents, and what it adds to them before, metres.
const SIZES: std::ops::Range<usize> = 10..13;
const SHAPE_FLOOR_M: f64 = 0.1;

/// Segments of one visit.
pub(super) struct Views {
    /// Points about their centroid.
    pub(super) segments: Vec<Segment>,
    /// Map frame, metres.
    pub(super) centroids: Vec<[f64; 3]>,
    /// What they show, as [`Identities`] name it over both visits; negative where that cannot be said.
    pub(super) objects: Vec<i64>,
    /// Height and both horizontal extents, metres.
    pub(super) sizes: Vec<[f64; 3]>,
}

/// Of the map visit and of the live one.
pub(super) fn both(
    site: &Site,
    plan: &RocPlan,
    config: &Config,
    words: &str,
    teller: &mut Teller<'_, '_>,
) -> Result<[Views; 2], Error> {
    let truth = truth::read(&site.files.truth)?;
    let accumulate = AccumulateConfig { swathes: false, ..config.accumulate.clone() };
    let mut names = None;
    let mut visit = |recording: &Recording, truth: Option<&Trajectory>, what: &str| {
        let mut surveyor = Surveyor::new(&accumulate, &config.segment, plan.step_m)?;
        teller.begins(format!("cutting {words}, {what} visit"), recording.sweep_count_hint())?;
        let mut views =
            Views { segments: Vec::new(), centroids: Vec::new(), objects: Vec::new(), sizes: Vec::new() };
        for sweep in recording.sweeps()? {
            let sweep = sweep?;
            teller.step()?;
            let Some(pose) = sweep.pose_odom_sensor else { continue };
            let at = match truth {
                Some(truth) => truth.at(sweep.stamp),
                None => Some(pose),
            };
            let numbered = !sweep.labels.is_empty();
            let rule = if numbered { IdentityRule::NUMBERED } else { IdentityRule::PAPER };
            let names = names.get_or_insert_with(|| Identities::new(rule));
            let found = surveyor.push(sweep.stamp, &sweep.cloud, &sweep.labels, pose, at);
            found.into_iter().flatten().for_each(|f| views.push(f, numbered, names));
        }
        views.measure();
        Ok::<_, Error>(views)
    };
    let map = visit(&site.open_map(true)?, None, "map")?;
    let live = site.open_live(true, false)?;
    if !live.has_motion() {
        let what = "nothing tells how the sensor moved, so no segments can be cut for curves";
        return Err(Error::input(
            &site.files.live,
            what,
            "give `live_poses`, or leave it out of [roc] datasets",
        ));
    }
    Ok([map, visit(&live, Some(&truth), "live")?])
}

impl Views {
    fn push(&mut self, found: Found, numbered: bool, names: &mut Identities) {
        let object = object_of(&found, numbered, names);
        let Some(segment) = Segment::from_points(found.points) else { return };
        self.segments.push(Segment { context: found.context, ..segment });
        self.centroids.push(found.centroid_map);
        self.objects.push(object);
    }

    fn measure(&mut self) {
        let shape = Shape.describe(&self.segments);
        let metres = |log: f32| f64::from(log).exp() - SHAPE_FLOOR_M;
        self.sizes = shape
            .values
            .chunks_exact(shape.dim)
            .map(|row| {
                let sizes = &row[SIZES];
                [metres(sizes[0]), metres(sizes[1]), metres(sizes[2])]
            })
            .collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_metres() {
        let points =
            (0..1000).map(|i| [(i % 10) as f32 * 0.2, (i / 10 % 10) as f32 * 0.1, (i / 100) as f32 * 0.4]);
        let segment = Segment::from_points(points.collect()).unwrap();
        let mut views =
            Views { segments: vec![segment], centroids: Vec::new(), objects: Vec::new(), sizes: Vec::new() };
        views.measure();
        for (got, want) in views.sizes[0].iter().zip([3.6, 1.8, 0.9]) {
            assert!((got - want).abs() < 1e-3, "{:?}", views.sizes);
        }
    }
}
