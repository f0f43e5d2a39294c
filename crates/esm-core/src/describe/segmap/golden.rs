//! The pass against PyTorch's answers on the same weights and segments, and against plain loops.

use std::path::Path;

use safetensors::SafeTensors;

use super::grid::{Columns, GRID};
use super::*;

fn weights() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../weights/peers/segmap.safetensors")
}

fn bytes<'a>(file: &SafeTensors<'a>, name: &str) -> Vec<[u8; 4]> {
    file.tensor(name).unwrap().data().as_chunks::<4>().0.to_vec()
}

fn floats(file: &SafeTensors<'_>, name: &str) -> Vec<f32> {
    bytes(file, name).into_iter().map(f32::from_le_bytes).collect()
}

fn integers(file: &SafeTensors<'_>, name: &str) -> Vec<i32> {
    bytes(file, name).into_iter().map(i32::from_le_bytes).collect()
}

#[test]
fn golden_answers_of_pytorch() {
    let segmap = SegMap::open(weights()).unwrap();
    let golden = std::fs::read(weights().with_file_name("golden-segmap.safetensors")).unwrap();
    let file = SafeTensors::deserialize(&golden).unwrap();
    let (points, offsets) = (floats(&file, "points"), integers(&file, "offsets"));
    let (columns, extents) = (integers(&file, "columns"), floats(&file, "extents"));
    let points = points.as_chunks::<3>().0;
    let segments: Vec<Segment> = offsets
        .windows(2)
        .map(|o| Segment::from_points(points[o[0] as usize..o[1] as usize].to_vec()).unwrap())
        .collect();
    for (n, segment) in segments.iter().enumerate() {
        let mut found: Columns = [0; GRID[0] * GRID[1]];
        let sizes = grid::fit(segment, &mut found);
        let want = &columns[n * found.len()..][..found.len()];
        assert!(found.iter().zip(want).all(|(a, b)| i32::from(*a) == *b), "grid of segment {n}");
        assert!(sizes.iter().zip(&extents[3 * n..]).all(|(a, b)| (a - b).abs() < 1e-5));
    }
    let found = segmap.describe(&segments);
    let off = found.values.iter().zip(floats(&file, "descriptor")).map(|(a, b)| (a - b).abs());
    let off = off.fold(0.0, f32::max);
    assert_eq!(found.values.len(), file.tensor("descriptor").unwrap().shape().iter().product::<usize>());
    assert!(off < 1e-4, "off by {off}");
}

/// Blobs of points of many sizes.
fn segments(count: u32) -> Vec<Segment> {
    let of = |n: u32| {
        let at = |i: u32, step: u32| (i * step % 97) as f32 / 97.0;
        let points = (0..60 + 40 * n).map(|i| [at(i, 31) * (1 + n) as f32, at(i, 57), at(i, 83) * 2.0]);
        Segment::from_points(points.collect()).unwrap()
    };
    (0..count).map(of).collect()
}

#[test]
fn neither_neighbours_nor_threads_change_a_row() {
    let segmap = SegMap::open(weights()).unwrap();
    let segments = segments(BLOCK as u32 + 5);
    let all = segmap.describe(&segments).values;
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(one.install(|| segmap.describe(&segments)).values, all);
    for n in [0, 7, BLOCK + 4] {
        assert_eq!(segmap.describe(&segments[n..=n]).values, all[n * DIM..][..DIM]);
    }
    assert!(segmap.describe(&[]).values.is_empty());
}

/// Convolution as it is defined, over a grid [x][y][z][channel], and ReLU.
fn plain(input: &[f32], cells: [usize; 3], weights: &[f32], bias: &[f32]) -> Vec<f32> {
    let (inputs, outputs) = (input.len() / cells.iter().product::<usize>(), bias.len());
    let mut out = bias.repeat(cells.iter().product());
    let at = |c: [usize; 3]| (c[0] * cells[1] + c[1]) * cells[2] + c[2];
    for cell in 0..cells.iter().product() {
        let here = [cell / (cells[1] * cells[2]), cell / cells[2] % cells[1], cell % cells[2]];
        for tap in 0..27 {
            let d = [tap / 9, tap / 3 % 3, tap % 3];
            let from = [0, 1, 2].map(|a| (here[a] + d[a]).wrapping_sub(1));
            if (0..3).any(|a| from[a] >= cells[a]) {
                continue;
            }
            for i in 0..inputs {
                let x = input[at(from) * inputs + i];
                for o in 0..outputs {
                    out[cell * outputs + o] += x * weights[(tap * inputs + i) * outputs + o];
                }
            }
        }
    }
    out.iter().map(|v| v.max(0.0)).collect()
}

fn pooled(input: &[f32], cells: [usize; 3], channels: usize) -> Vec<f32> {
    let half = cells.map(|n| n / 2);
    let mut out = vec![0f32; input.len() / 8];
    for (n, v) in input.iter().enumerate() {
        let (cell, channel) = (n / channels, n % channels);
        let [x, y, z] =
            [cell / (cells[1] * cells[2]), cell / cells[2] % cells[1], cell % cells[2]].map(|n| n / 2);
        let out = &mut out[((x * half[1] + y) * half[2] + z) * channels + channel];
        *out = out.max(*v);
    }
    out
}

#[test]
fn the_convolutions_equal_plain_loops() {
    let bytes = std::fs::read(weights()).unwrap();
    let path = weights();
    let mut file = tensors::Tensors::parse(&bytes, &path, "segmap-cnn").unwrap();
    let mut take = |name: &str, shape: &[usize]| file.take(name, shape).unwrap();
    let layers = [
        (take("conv1.weight", &[3, 3, 3, 1, 32]), take("conv1.bias", &[32])),
        (take("conv2.weight", &[3, 3, 3, 32, 64]), take("conv2.bias", &[64])),
        (take("conv3.weight", &[3, 3, 3, 64, 64]), take("conv3.bias", &[64])),
    ];
    // A grid with cells on its border, a full column, and much that is empty.
    let mut columns: Columns = [0; GRID[0] * GRID[1]];
    for (n, bits) in [(0, 0x8001), (5 * 32 + 31, 0xffff), (600, 0x0ff0), (601, 0x00f1), (1023, 0x4000)] {
        columns[n] = bits;
    }
    let cells: Vec<f32> = columns.iter().flat_map(|c| (0..16).map(move |z| f32::from(c >> z & 1))).collect();
    let one = plain(&cells, GRID, &layers[0].0, &layers[0].1);
    let two = plain(&pooled(&one, GRID, 32), [16, 16, 8], &layers[1].0, &layers[1].1);
    let want = plain(&pooled(&two, [16, 16, 8], 64), [8, 8, 4], &layers[2].0, &layers[2].1);
    let network = Network::load(&bytes, &path, Arch::new()).unwrap();
    let mut workspace = network.workspace();
    let mut found = vec![0.0; FLAT];
    // What a fuller grid left behind must not show.
    workspace.columns.fill(0xffff);
    network.convolve(&mut workspace, [1.0; 3], &mut found);
    workspace.columns = columns;
    network.convolve(&mut workspace, [1.0, 2.0, 3.0], &mut found);
    assert_eq!(found[FLAT - 3..], [1.0, 2.0, 3.0]);
    let size = want.iter().fold(0f32, |a, b| a.max(b.abs()));
    let off = want.iter().zip(&found).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(size > 0.1 && off < 1e-4 * size.max(1.0), "off by {off} of {size}");
}
