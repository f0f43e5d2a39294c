//! Describing the 46 segments of a live cloud: the three networks by criterion, on one thread and on all; then, for each, where
//! the time goes, beside what the machine can do at most.
//!
//! The table gives the best of many repeats of every segment, so that other work on the machine does not count. Its last column
//! is the network's own multiply-adds over the measured peak of fused multiply-adds; activations, neighbours and padding count
//! as nothing.

#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout)] // Criterion's macros; a benchmark may stop at the first error.

use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use esm_benches::{above_and_ground, bandwidth, peak_flops, simulated_cloud, simulated_segments};
use esm_core::Descriptor;
use esm_core::describe::{Part, XConv};
use esm_core::segment::{Segment, SegmentConfig, euclidean_clusters, segments_of};

const NETWORKS: [(&str, &[u8]); 3] =
    [("esm-paper", esm_weights::ESM_PAPER), ("esm", esm_weights::ESM), ("esm-swift", esm_weights::ESM_SWIFT)];

/// Repeats of a segment in the table.
const REPEATS: usize = 40;

fn networks() -> Vec<XConv> {
    NETWORKS.iter().map(|(name, bytes)| XConv::from_bytes(bytes, name).unwrap()).collect()
}

fn forward(c: &mut Criterion) {
    let cloud = simulated_cloud().unwrap();
    let segments = simulated_segments(&cloud).unwrap();
    let pools = [1, 0].map(|n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap());
    let mut group = c.benchmark_group(format!("forward, {} segments", segments.len()));
    group.sample_size(30).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    for network in networks() {
        for pool in &pools {
            let title = format!("{}, {} thread(s)", network.name(), pool.current_num_threads());
            group.bench_function(title, |b| b.iter(|| pool.install(|| network.describe(&segments))));
        }
    }
    let config = SegmentConfig::default();
    let [above, ground] = above_and_ground(&cloud, &config);
    let clusters = euclidean_clusters(&above, config.tolerance, config.min_points, config.max_points);
    let context = || pools[0].install(|| segments_of(&above, &ground, &clusters));
    let title = format!("context of {} segments among {} points", clusters.len(), above.len());
    group.bench_function(title, |b| b.iter(context));
    group.finish();

    let (peak, bytes) = (peak_flops(), bandwidth());
    println!(
        "\none thread: {:.0} GFLOP/s of fused multiply-adds, {:.1} GB/s from memory",
        peak / 1e9,
        bytes / 1e9
    );
    let context = (0..REPEATS).map(|_| timed(context)).fold(f64::INFINITY, f64::min);
    println!("context of {} segments among {} points: {:.2} ms", clusters.len(), above.len(), context * 1e3);
    for network in networks() {
        pools[0].install(|| table(&network, &segments, peak));
    }
}

fn timed<T>(call: impl Fn() -> T) -> f64 {
    let start = Instant::now();
    std::hint::black_box(call());
    start.elapsed().as_secs_f64()
}

/// Seconds that describing takes at best, segment by segment.
fn best(network: &XConv, segments: &[Segment]) -> f64 {
    let one = |segment| {
        let call = || timed(|| network.describe(std::slice::from_ref(segment)));
        (0..REPEATS).map(|_| call()).fold(f64::INFINITY, f64::min)
    };
    segments.iter().map(one).sum()
}

fn table(network: &XConv, segments: &[Segment], peak: f64) {
    println!("\n| {} | ms | GFLOP/s | of the peak |\n|---|--:|--:|--:|", network.name());
    let line = |name: &str, seconds: f64, multiply_adds: usize| {
        let flops = 2.0 * multiply_adds as f64 / seconds;
        if multiply_adds == 0 {
            println!("| {name} | {:.2} | | |", seconds * 1e3);
        } else {
            println!(
                "| {name} | {:.2} | {:.0} | {:.0} % |",
                seconds * 1e3,
                flops / 1e9,
                100.0 * flops / peak
            );
        }
    };
    let mut rows: Vec<(&str, f64, usize)> = Vec::new();
    for time in network.time_parts(segments, REPEATS) {
        let (name, seconds) = (name(time.part), time.time.as_secs_f64());
        match rows.iter_mut().find(|row| row.0 == name) {
            Some(row) => (row.1, row.2) = (row.1 + seconds, row.2 + time.multiply_adds),
            None => rows.push((name, seconds, time.multiply_adds)),
        }
    }
    for (name, seconds, multiply_adds) in rows {
        line(name, seconds, multiply_adds);
    }
    line("all", best(network, segments), segments.len() * network.multiply_adds());
}

/// A row of the table; the layers stand together.
fn name(part: Part) -> &'static str {
    match part {
        Part::Sample => "sampling, normalising, sizes",
        Part::Neighbours => "neighbours",
        Part::Local(_) => "local coordinates",
        Part::Lift(_) => "lifting",
        Part::Transform(_) => "X-transform",
        Part::Mix(_) => "transform times features, depthwise",
        Part::Pointwise(_) => "pointwise",
        Part::Global => "global branch",
        Part::Connected => "fully connected",
        Part::Head => "mean, context, last layer, quality",
    }
}

criterion_group!(benches, forward);
criterion_main!(benches);
