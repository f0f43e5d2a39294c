//! The `burgess` preset beside what the ESM paper tells of Burgess Field (section V and table II).

use std::path::Path;

use esm_core::{AccumulateConfig, Accumulator, Config, MapBuilder};
use esm_io::{OpenOptions, Recording, read_tum};

use crate::figures::{Side, Table, rows};
use crate::segments::Cut;

/// The paper's: segments of a live cloud on average, map segments, kilometres.
const LIVE_SEGMENTS: f64 = 46.0;
const MAP_SEGMENTS_A_KM: f64 = 2783.0 / 2.8;

pub(crate) fn table(sim: &Path) -> Result<Table, Box<dyn std::error::Error>> {
    let preset = esm_sim::preset("burgess")?;
    let accumulate = AccumulateConfig { distance_m: preset.accumulate_m, ..AccumulateConfig::default() };
    // The paper's map is made of swathes that do not overlap, as its live clouds are.
    let mut config = Config { accumulate: accumulate.clone(), ..Config::default() };
    config.map.window_step_m = preset.accumulate_m;
    let truth = read_tum(sim.join("map_truth.tum"))?;
    let mut accumulator = Accumulator::new(accumulate.clone())?;
    let mut builder = MapBuilder::new(&config)?;
    let (mut travel_m, mut last) = (0.0, None);
    for (sweep, pose) in Recording::open(sim.join("map.mcap"), &OpenOptions::default())?.sweeps()?.zip(&truth)
    {
        let sweep = sweep?;
        let at = pose.pose.translation.vector;
        travel_m += last.map_or(0.0, |l: nalgebra::Vector3<f64>| (at - l).norm());
        last = Some(at);
        if let Some(live) = accumulator.push(sweep.stamp, &sweep.cloud, sweep.pose_odom_sensor) {
            builder.push(&live, &pose.pose)?;
        }
    }
    let swathes = AccumulateConfig { swathes: true, ..accumulate };
    let mut accumulator = Accumulator::new(swathes)?;
    let mut cut = Cut::default();
    for sweep in Recording::open(sim.join("live.mcap"), &OpenOptions::default())?.sweeps()? {
        let sweep = sweep?;
        if let Some(live) = accumulator.push(sweep.stamp, &sweep.cloud, sweep.pose_odom_sensor) {
            cut.clouds.push(esm_core::segment::segment(&live.cloud, &config.segment).segments);
        }
    }
    let (mut real, mut side) = (Side::default(), Side::default());
    let mean = cut.clouds.iter().map(Vec::len).sum::<usize>() as f64 / cut.clouds.len().max(1) as f64;
    real.put("segments of a live cloud, mean", "", LIVE_SEGMENTS);
    side.put("segments of a live cloud, mean", "", mean);
    real.put("segments of the map", "per km", MAP_SEGMENTS_A_KM);
    side.put("segments of the map", "per km", builder.len() as f64 / (travel_m * 1e-3));
    let title = "A trail: the ESM paper's figures of Burgess Field and the preset `burgess`".to_owned();
    Ok(Table { title, name: "trail", rows: rows(real, side) })
}
