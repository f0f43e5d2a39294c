//! The pass against PyTorch's activations on the same weights and points.

use std::path::Path;

use safetensors::SafeTensors;

use super::*;

/// A tensor of a golden file: shape and numbers.
fn tensor(file: &SafeTensors<'_>, name: &str) -> (Vec<usize>, Vec<f32>) {
    let view = file.tensor(name).unwrap();
    let numbers = view.data().as_chunks::<4>().0.iter().map(|b| match view.dtype() {
        safetensors::Dtype::I32 => i32::from_le_bytes(*b) as f32,
        _ => f32::from_le_bytes(*b),
    });
    (view.shape().to_vec(), numbers.collect())
}

fn worst(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Layer by layer, so that what is wrong shows where it goes wrong.
fn compare(weights: &Path, golden: &Path) {
    let descriptor = XConv::open(weights).unwrap();
    let bytes = std::fs::read(golden).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let (shape, points) = tensor(&file, "points");
    let points = points.as_chunks::<3>().0;
    let each = descriptor.network.header.measures();
    let measures = if each > 0 { tensor(&file, "measures").1 } else { Vec::new() };
    let measures: Vec<f64> = measures.into_iter().map(f64::from).collect();
    let (dim, want) = tensor(&file, "descriptor");
    let (_, quality) = tensor(&file, "quality");
    let mut workspace = descriptor.network.workspace();
    let mut row = vec![0.0; dim[1]];
    let mut off = [0f32; 2];
    for n in 0..shape[0] {
        workspace.points = points[n * INPUT_POINTS..][..INPUT_POINTS].to_vec();
        let q = descriptor.network.describe(&mut workspace, &measures[n * each..][..each], &mut row, &mut ());
        for (l, layer) in architecture::LAYER_TABLE.iter().enumerate() {
            let (shape, want) = tensor(&file, &format!("xconv{}.neighbours", l + 1));
            let each = shape[1] * shape[2];
            let found: Vec<f32> = workspace.lists[l][..each].iter().map(|n| f32::from(*n)).collect();
            assert_eq!(found, want[n * each..][..each], "neighbours of layer {} of segment {n}", l + 1);
            let (_, want) = tensor(&file, &format!("xconv{}.out", l + 1));
            let each = shape[1] * layer.channels;
            let last = l + 1 == architecture::LAYERS;
            let (pitch, start) = if last { (network::HEAD, 64) } else { (layer.channels, 0) };
            let rows = workspace.features[l].chunks_exact(pitch).take(shape[1]);
            let found: Vec<f32> = rows.flat_map(|row| row[start..].to_vec()).collect();
            let off = worst(&found, &want[n * each..][..each]);
            assert!(off < 1e-4, "layer {} of segment {n} is off by {off}", l + 1);
        }
        off[0] = off[0].max(worst(&row, &want[n * dim[1]..][..dim[1]]));
        off[1] = off[1].max((q - quality[n]).abs());
    }
    assert!(off[0] < 1e-4 && off[1] < 1e-4, "{off:?}");
}

#[test]
fn golden_activations_of_pytorch() {
    let weights = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../weights");
    for name in ["esm-paper", "esm", "esm-swift"] {
        let file = format!("{name}.safetensors");
        compare(&weights.join(&file), &weights.join("golden").join(&file));
    }
}
