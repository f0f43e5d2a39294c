//! The forests against scikit-learn's answers on the same pairs of segments.

use std::path::Path;

use safetensors::SafeTensors;

use super::*;

fn floats(file: &SafeTensors<'_>, name: &str) -> Vec<f32> {
    let view = file.tensor(name).unwrap();
    view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
}

#[test]
fn golden_answers_of_scikit_learn() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../weights/peers");
    for name in ["segmatch", "nsm"] {
        let forested = Forested::open(folder.join(format!("{name}.safetensors"))).unwrap();
        let bytes = std::fs::read(folder.join(format!("golden-{name}.safetensors"))).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let (live, map) = (floats(&file, "live"), floats(&file, "map"));
        let (features, want) = (floats(&file, "features"), floats(&file, "probability"));
        let n = forested.kind.searched();
        // The file holds the rows without the part that is searched by.
        let whole = |part: &[f32]| [&vec![0.0; n][..], part].concat();
        let (each, pairs) = (forested.dim() - n, want.len());
        assert!(pairs >= 50 && live.len() == pairs * each);
        for p in 0..pairs {
            let [live, map] = [&live, &map].map(|rows| whole(&rows[p * each..][..each]));
            let row = forested.pair(&live, &map);
            let asked = &features[p * row.len()..][..row.len()];
            assert!(row.iter().zip(asked).all(|(a, b)| (a - b).abs() <= 1e-5 * b.abs().max(1.0)), "pair {p}");
            // By scikit-learn's own numbers, so that no rounding decides at a split.
            let off = (forested.forest.probability(asked) - want[p]).abs();
            assert!(off < 1e-6, "{name}, pair {p}: off by {off}");
        }
        let wide = want.iter().fold((1f32, 0f32), |(low, high), p| (low.min(*p), high.max(*p)));
        assert!(wide.0 < 0.2 && wide.1 > 0.8, "the pairs say nothing: {wide:?}");
    }
}

#[test]
fn a_forest_that_leads_in_circles_is_refused() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../weights/peers");
    let bytes = std::fs::read(folder.join("nsm.safetensors")).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let left = file.tensor("left").unwrap().data();
    let start = left.as_ptr() as usize - bytes.as_ptr() as usize;
    let mut damaged = bytes.clone();
    damaged[start..start + 4].copy_from_slice(&0f32.to_le_bytes());
    let error = Forested::from_bytes(&damaged, "damaged").unwrap_err().to_string();
    assert!(error.contains("node 0 of the forest makes no sense"), "{error}");
}
