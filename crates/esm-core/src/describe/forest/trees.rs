//! [`Forest`]: a random forest for pairs, as scikit-learn grew it (`esm-train forest`).

use crate::describe::tensors::Tensors;
use crate::error::Error;

/// Trees a forest may have.
const MOST_TREES: usize = 1000;
/// Nodes all its trees may have together; their numbers are f32 in the file, exact up to 2^24.
const MOST_NODES: usize = 1 << 24;

/// One node: a question with two ways on, or a leaf.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// The feature asked for; `LEAF` where the answer stands.
    feature: u32,
    /// Where the feature is at most `split` the way goes to `left`, else to `right`. A leaf's probability.
    split: f32,
    left: u32,
    right: u32,
}

const LEAF: u32 = u32::MAX;

/// A random forest: the mean of its trees' probabilities.
#[derive(Clone, Debug)]
pub(super) struct Forest {
    roots: Vec<u32>,
    nodes: Vec<Node>,
}

impl Forest {
    /// Takes the forest out of an opened file. Children come after their parents, so every walk ends.
    pub(super) fn take(file: &mut Tensors<'_>, features: usize) -> Result<Self, Error> {
        let trees = number(file, "trees", MOST_TREES)?;
        let count = number(file, "nodes", MOST_NODES)?;
        let mut column = |name: &str, n: usize| file.take(name, &[n]);
        let roots = column("roots", trees)?;
        let [feature, split, left, right] = [
            column("feature", count)?,
            column("split", count)?,
            column("left", count)?,
            column("right", count)?,
        ];
        let index = |v: f32, low: usize, high: usize| {
            (v.fract() == 0.0 && v >= low as f32 && (v as usize) < high).then_some(v as u32)
        };
        let node = |n: usize| {
            if feature[n] == -1.0 {
                let probable = (0.0..=1.0).contains(&split[n]);
                return probable.then_some(Node { feature: LEAF, split: split[n], left: 0, right: 0 });
            }
            Some(Node {
                feature: index(feature[n], 0, features)?,
                split: split[n],
                left: index(left[n], n + 1, count)?,
                right: index(right[n], n + 1, count)?,
            })
        };
        let mut nodes = Vec::with_capacity(count);
        for n in 0..count {
            nodes.push(node(n).ok_or_else(|| file.flaw(format!("node {n} of the forest makes no sense")))?);
        }
        let roots: Option<Vec<u32>> = roots.iter().map(|r| index(*r, 0, count)).collect();
        let roots = roots.ok_or_else(|| file.flaw("a root of the forest is no node"))?;
        Ok(Self { roots, nodes })
    }

    /// The probability for a row of features.
    pub(super) fn probability(&self, row: &[f32]) -> f32 {
        let walk = |root: &u32| {
            let mut node = &self.nodes[*root as usize];
            while node.feature != LEAF {
                let way = if row[node.feature as usize] <= node.split { node.left } else { node.right };
                node = &self.nodes[way as usize];
            }
            f64::from(node.split)
        };
        (self.roots.iter().map(walk).sum::<f64>() / self.roots.len() as f64) as f32
    }
}

fn number(file: &Tensors<'_>, key: &str, most: usize) -> Result<usize, Error> {
    let text = file.text(key)?;
    let found = text.parse().ok().filter(|n| (1..=most).contains(n));
    found.ok_or_else(|| file.flaw(format!("{key} is `{text}`, must be 1 to {most}")))
}
