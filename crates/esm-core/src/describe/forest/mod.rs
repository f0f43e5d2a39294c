//! [`Forested`]: the two peers that find candidates by hand-made features and let a random forest judge them.
//!
//! *SegMatch* (Dube et al., ICRA 2017) searches by the 7 eigenvalue features and judges by 45 numbers a pair: 35 from the
//! eigenvalue features, 10 intersections of ESF histograms. *NSM* (Tinchev et al., IROS 2018) searches by the 66 numbers of
//! Gestalt and judges by 330. Both give every segment 200 candidates. The forests are files (`weights/peers`).

mod features;
#[cfg(test)]
mod golden;
mod trees;

use std::path::Path;

use self::features::{differences, intersections};
use self::trees::Forest;
use super::eigen::{EIGEN_DIM, eigenvalues, features as eigen_features, rows};
use super::esf::{BINS, HISTOGRAMS, histograms};
use super::gestalt::{GESTALT_DIM, heights};
use super::tensors::{self, Tensors};
use super::{Descriptions, Descriptor, PairJudge};
use crate::error::Error;
use crate::segment::Segment;

/// Candidates a segment, as published.
const CANDIDATES: usize = 200;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    SegMatch,
    Nsm,
}

impl Kind {
    /// Numbers that neighbours are searched by. They come first in a row, and again after themselves: a map standardises the
    /// first ones, and a pair is judged by the numbers as they are.
    fn searched(self) -> usize {
        match self {
            Self::SegMatch => EIGEN_DIM,
            Self::Nsm => GESTALT_DIM,
        }
    }

    fn dim(self) -> usize {
        2 * self.searched() + if self == Self::SegMatch { BINS * HISTOGRAMS } else { 0 }
    }

    /// Numbers a pair.
    fn features(self) -> usize {
        5 * self.searched() + if self == Self::SegMatch { HISTOGRAMS } else { 0 }
    }
}

/// Hand-made features whose matches a random forest judges: SegMatch or NSM.
#[derive(Debug)]
pub struct Forested {
    kind: Kind,
    forest: Forest,
    least: f32,
    version: u32,
}

impl Forested {
    /// Opens a forest (`.safetensors`) that `esm-train forest` has written.
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be read; [`Error::WeightsFile`] where it is damaged or belongs to something else.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        Self::from_bytes(&tensors::read(path)?, path)
    }

    /// The same from bytes in memory; `name` stands for the file in messages.
    ///
    /// # Errors
    /// [`Error::WeightsFile`].
    pub fn from_bytes(bytes: &[u8], name: impl AsRef<Path>) -> Result<Self, Error> {
        let mut file = Tensors::parse(bytes, name.as_ref(), "pair-forest")?;
        let kind = match file.text("variant")? {
            "segmatch" => Kind::SegMatch,
            "nsm" => Kind::Nsm,
            other => return Err(file.flaw(format!("variant is `{other}`, must be segmatch or nsm"))),
        };
        file.expect("features", &kind.features().to_string())?;
        let forest = Forest::take(&mut file, kind.features())?;
        let text = file.text("least_probability")?;
        let least = text.parse().ok().filter(|p| (0.0..=1.0).contains(p));
        let least =
            least.ok_or_else(|| file.flaw(format!("least_probability is `{text}`, must be 0 to 1")))?;
        file.finish()?;
        Ok(Self { kind, forest, least, version: crc32fast::hash(bytes) })
    }

    /// What the forest is asked about a pair, from the rows of [`describe`](Descriptor::describe).
    fn pair(&self, live: &[f32], map: &[f32]) -> Vec<f32> {
        let n = self.kind.searched();
        let mut row = Vec::with_capacity(self.kind.features());
        differences(&live[n..2 * n], &map[n..2 * n], &mut row);
        if self.kind == Kind::SegMatch {
            intersections(&live[2 * n..], &map[2 * n..], &mut row);
        }
        row
    }
}

impl Descriptor for Forested {
    fn name(&self) -> &'static str {
        match self.kind {
            Kind::SegMatch => "segmatch",
            Kind::Nsm => "nsm",
        }
    }

    /// The checksum of the forest.
    fn version(&self) -> u32 {
        self.version
    }

    fn dim(&self) -> usize {
        self.kind.dim()
    }

    fn searched(&self) -> usize {
        self.kind.searched()
    }

    fn standardized(&self) -> bool {
        true
    }

    fn judge(&self) -> Option<&dyn PairJudge> {
        Some(self)
    }

    fn describe(&self, segments: &[Segment]) -> Descriptions {
        let n = self.kind.searched();
        let described = rows(self.dim(), segments, |segment, row| {
            match self.kind {
                Kind::SegMatch => {
                    row[..n].copy_from_slice(&eigen_features(eigenvalues(segment)));
                    histograms(segment, &mut row[2 * n..]);
                }
                Kind::Nsm => heights(segment, &mut row[..n]),
            }
            row.copy_within(..n, n);
        });
        Descriptions { candidates: CANDIDATES, ..described }
    }
}

impl PairJudge for Forested {
    fn probability(&self, live: &[f32], map: &[f32]) -> f32 {
        self.forest.probability(&self.pair(live, map))
    }

    fn least(&self) -> f32 {
        self.least
    }
}
