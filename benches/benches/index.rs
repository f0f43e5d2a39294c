//! The K nearest map descriptors of the 50 of one scan, by k-d tree and by matrix product: which is faster for which
//! dimension and map size decides `Search::Auto`. Measured with `RAYON_NUM_THREADS=1`; both share their work out alike.
//!
//! Two kinds of descriptors, of unit variance in every dimension: `low`, 6 latent numbers mixed into all dimensions and
//! some noise, as descriptors of segments are taken to be; `full`, independent in every dimension, the worst for a tree.

#![allow(missing_docs)] // Criterion's macros.

use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, BenchmarkId, Criterion, criterion_group, criterion_main};
use esm_core::index::{Product, Tree};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

const QUERIES: usize = 50;
const LATENT: usize = 6;
const NOISE: f32 = 0.15;

/// About normal, mean 0, variance 1: a sum of 12 uniform numbers.
fn normal(random: &mut ChaCha8Rng) -> f32 {
    (0..12).map(|_| random.next_u32() as f32 / u32::MAX as f32).sum::<f32>() - 6.0
}

/// `rows` descriptors of `dim` numbers.
fn descriptors(rows: usize, dim: usize, low: bool, random: &mut ChaCha8Rng) -> Vec<f32> {
    if !low {
        return (0..rows * dim).map(|_| normal(random)).collect();
    }
    // The same mixture for every call with the same `dim`: map and queries come from one distribution.
    let mut mixer = ChaCha8Rng::seed_from_u64(dim as u64);
    let mixture: Vec<[f32; LATENT]> = (0..dim)
        .map(|_| {
            let weights: [f32; LATENT] = std::array::from_fn(|_| normal(&mut mixer));
            let length = weights.iter().map(|w| w * w).sum::<f32>().sqrt();
            weights.map(|w| w / length)
        })
        .collect();
    let mut values = Vec::with_capacity(rows * dim);
    for _ in 0..rows {
        let latent: [f32; LATENT] = std::array::from_fn(|_| normal(random));
        for weights in &mixture {
            let mixed: f32 = weights.iter().zip(latent).map(|(w, l)| w * l).sum();
            values.push(mixed + NOISE * normal(random));
        }
    }
    values
}

/// The paper's timing case with the descriptors of `esm-swift`: 46 segments of 24 numbers, 2,783 in the map, K = 25.
fn paper(c: &mut Criterion) {
    let mut random = ChaCha8Rng::seed_from_u64(46);
    let (map, queries) = (descriptors(2783, 24, true, &mut random), descriptors(46, 24, true, &mut random));
    let product = Product::new(&map, 24);
    let mut group = c.benchmark_group("index, the paper's case");
    group.warm_up_time(Duration::from_millis(100)).measurement_time(Duration::from_millis(500));
    group.bench_function("product, 46 of 24 numbers among 2783, k 25", |b| {
        b.iter(|| product.nearest(&queries, 25))
    });
    group.finish();
}

fn index(c: &mut Criterion) {
    for (kind, low) in [("low", true), ("full", false)] {
        for dim in [7, 13, 16] {
            let mut group = c.benchmark_group(format!("index, {kind}, {dim} numbers"));
            group.sample_size(10);
            group.warm_up_time(Duration::from_millis(100)).measurement_time(Duration::from_millis(400));
            for rows in [1_000, 3_000, 10_000, 30_000, 100_000] {
                one_size(&mut group, rows, dim, low);
            }
            group.finish();
        }
    }
}

fn one_size(group: &mut BenchmarkGroup<'_, WallTime>, rows: usize, dim: usize, low: bool) {
    let mut random = ChaCha8Rng::seed_from_u64(rows as u64);
    let map = descriptors(rows, dim, low, &mut random);
    let queries = descriptors(QUERIES, dim, low, &mut random);
    let product = Product::new(&map, dim);
    let Some(tree) = Tree::try_new(&map, dim) else { return };
    for k in [25, 60] {
        group.bench_function(BenchmarkId::new(format!("tree, k {k}"), rows), |b| {
            b.iter(|| tree.nearest(&queries, k))
        });
        group.bench_function(BenchmarkId::new(format!("product, k {k}"), rows), |b| {
            b.iter(|| product.nearest(&queries, k))
        });
    }
}

criterion_group!(benches, paper, index);
criterion_main!(benches);
