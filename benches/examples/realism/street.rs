//! The `kitti` preset beside the KITTI recordings, both through the recordings' filter.

use std::path::Path;

use esm_core::PointCloud;
use esm_core::segment::voxel_filter;

use crate::dump;
use crate::figures::{Side, Table, range, rows, spacing};
use crate::segments::{Drive, Visit};

/// The filter that the recordings went through, found by holding them against full-density scans of the same sequence: the
/// centroid of each voxel of 0.5 m, of points 3 to 80 m away. (Nothing lies above +3 m because the topmost laser looks 2
/// degrees up.)
const FILTER_VOXEL_M: f32 = 0.5;
const FILTER_RANGE_M: std::ops::Range<f64> = 3.0..80.0;

/// A sweep as the recordings have it.
pub(crate) fn thinned(sweep: &PointCloud) -> PointCloud {
    let near: Vec<[f32; 3]> =
        sweep.points().iter().filter(|p| FILTER_RANGE_M.contains(&range(p))).copied().collect();
    PointCloud::from_finite(voxel_filter(&near, FILTER_VOXEL_M)).0
}

/// Sweeps, segments and what re-appears of them.
pub(crate) fn table(shared: &Path, sim: &Path, work: &Path) -> Result<Table, Box<dyn std::error::Error>> {
    let kitti = shared.join("kitti00");
    let real = Drive {
        map: Visit { recording: kitti.join("map.mcap"), truth: None },
        live: Visit { recording: kitti.join("query.mcap"), truth: Some(kitti.join("query_truth.tum")) },
        filter: Clone::clone,
    };
    let visit = |name: &str| Visit {
        recording: sim.join(format!("{name}.mcap")),
        truth: Some(sim.join(format!("{name}_truth.tum"))),
    };
    let made = Drive { map: visit("map"), live: visit("live"), filter: thinned };
    let (real, real_segments) = side(&real)?;
    let (sim, sim_segments) = side(&made)?;
    dump::segments(&work.join("street_real.bin"), &real_segments)?;
    dump::segments(&work.join("street_sim.bin"), &sim_segments)?;
    Ok(Table {
        title: "Streets: KITTI 00 (`map.mcap`; `query.mcap` as the second visit) and the preset `kitti`, both through \
                the same filter"
            .to_owned(),
        name: "street",
        rows: rows(real, sim),
    })
}

/// Points of each of some segments.
type Shapes = Vec<Vec<[f32; 3]>>;

fn side(drive: &Drive) -> Result<(Side, Shapes), Box<dyn std::error::Error>> {
    let mut side = Side::default();
    let map = drive.map.segments(drive.filter)?;
    let sweeps = &map.sweeps;
    side.quantiles(
        "points of a sweep",
        "",
        sweeps.iter().map(|s| s.len() as f64).collect(),
        &[0.1, 0.5, 0.9],
    );
    let ranges: Vec<f64> = sweeps.iter().step_by(5).flat_map(|s| s.points().iter().map(range)).collect();
    side.shares("range", &ranges, &[0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0]);
    side.quantiles("range", "m", ranges, &[0.25, 0.5, 0.75]);
    let gaps = sweeps.iter().step_by(25).flat_map(|s| spacing(s.points(), 3)).collect();
    side.quantiles("spacing", "m", gaps, &[0.1, 0.5, 0.9]);
    map.shapes(&mut side);
    let live = drive.live.segments(drive.filter)?;
    side.put("live segments that re-appear within 0.5 m", "%", 100.0 * live.found_in(&map));
    side.put("the same in one map cloud every 20 m", "%", 100.0 * live.found_in(&map.every(4)));
    side.put("of those with 100 points or more", "%", 100.0 * live.larger(100).found_in(&map));
    let segments = map.clouds.into_iter().step_by(3).flatten().map(|s| s.points).collect();
    Ok((side, segments))
}
