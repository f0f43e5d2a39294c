//! Describing segments: a row of numbers for each, and the chance that it is good for matching.

use std::sync::Arc;
use std::time::Duration;

use crate::error::Error;
use crate::segment::Segment;

/// Descriptors of a batch of segments.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Descriptions {
    /// Numbers a segment.
    pub dim: usize,
    /// Row-major, one row of `dim` numbers a segment, in the order of the segments.
    pub values: Vec<f32>,
    /// One a segment: the probability, 0 to 1, that the descriptor is good for matching.
    pub quality: Vec<f32>,
    /// Candidates in a map that a segment should be given for its counterpart to be among them; 0 leaves it to
    /// [`candidates`](crate::matching::candidates).
    pub candidates: usize,
    /// Time spent on preparing the input (sampling and normalisation), where the descriptor has such a step.
    pub preprocessing: Duration,
}

/// Turns segments into descriptors, a batch at a time.
///
/// Rows must depend on their own segment only, its points and its context, never on the other segments of the batch, and be the same
/// bits whatever the number of threads.
pub trait Descriptor: Send + Sync {
    /// Name, as in `--descriptor NAME`; networks of any weights have the name of their variant.
    fn name(&self) -> &'static str;
    /// Raised whenever the numbers change, so that maps of an older version are refused.
    fn version(&self) -> u32;
    /// Numbers a segment.
    fn dim(&self) -> usize;
    /// Whether a map brings each dimension to zero mean and unit variance over its segments: for hand-made features in
    /// mixed units.
    fn standardized(&self) -> bool {
        false
    }
    /// L2 distance under which that share of the pairs of different objects falls, where the descriptor's ROC was
    /// measured there (networks: at 0.1 and 0.2, paper section IV).
    fn distance_at_rate(&self, false_positive_rate: f64) -> Option<f64> {
        let _ = false_positive_rate;
        None
    }
    /// The leading numbers of a row, those that neighbours are searched by; what follows is for [`judge`](Self::judge) alone
    /// and never standardised.
    fn searched(&self) -> usize {
        self.dim()
    }
    /// Who judges the candidates that the search has found, where the descriptor has such a stage.
    fn judge(&self) -> Option<&dyn PairJudge> {
        None
    }
    /// Describes a batch.
    fn describe(&self, segments: &[Segment]) -> Descriptions;
}

/// Judges candidate pairs by more than their distance (SegMatch's and NSM's random forest).
pub trait PairJudge: Send + Sync {
    /// The probability, 0 to 1, that two rows are of one object.
    fn probability(&self, live: &[f32], map: &[f32]) -> f32;
    /// Candidates less probable than this are dropped.
    fn least(&self) -> f32;
}

mod eigen;
mod esf;
mod forest;
mod gestalt;
mod segmap;
mod shape;
mod tensors;
mod xconv;

use std::path::Path;

pub use eigen::Eigen;
pub use esf::Esf;
pub use forest::Forested;
pub use gestalt::Gestalt;
pub use segmap::SegMap;
pub use shape::Shape;
pub use xconv::{Part, PartTime, XConv};

/// The descriptors by name, the default first.
pub const NAMES: [&str; 7] = ["esm-swift", "esm", "esm-paper", "shape", "eigen", "esf", "gestalt"];

/// Ending of the name of a weights file.
const WEIGHTS: &str = ".safetensors";

/// Descriptors whose weights are no part of the program: a file of `weights/peers` or one of your own stands for the name.
pub(crate) const PEERS: [&str; 3] = ["segmap", "segmatch", "nsm"];

/// The descriptor called `name`, as in `--descriptor NAME`: one of [`NAMES`], or the path of a weights file
/// (`*.safetensors`) that `esm-train` has written, of our networks or of a peer ([`SegMap`],
/// [`Forested`]).
///
/// # Errors
/// [`Error::Config`] for a name that is neither; as [`XConv::open`] for a file.
///
/// ```
/// let network = esm_core::describe::by_name("esm-swift")?;
/// assert_eq!((network.name(), network.dim()), ("esm-swift", 24));
/// # Ok::<(), esm_core::Error>(())
/// ```
pub fn by_name(name: &str) -> Result<Arc<dyn Descriptor>, Error> {
    check_name(name)?;
    let network = |bytes| XConv::from_bytes(bytes, name);
    Ok(match name {
        "shape" => Arc::new(Shape),
        "eigen" => Arc::new(Eigen),
        "esf" => Arc::new(Esf),
        "gestalt" => Arc::new(Gestalt),
        "esm-paper" => Arc::new(network(esm_weights::ESM_PAPER)?),
        "esm" => Arc::new(network(esm_weights::ESM)?),
        "esm-swift" => Arc::new(network(esm_weights::ESM_SWIFT)?),
        path => opened(Path::new(path))?,
    })
}

/// The descriptor that a weights file belongs to, by its header.
fn opened(path: &Path) -> Result<Arc<dyn Descriptor>, Error> {
    let bytes = tensors::read(path)?;
    Ok(match tensors::architecture(&bytes).as_deref() {
        Some("segmap-cnn") => Arc::new(SegMap::from_bytes(&bytes, path)?),
        Some("pair-forest") => Arc::new(Forested::from_bytes(&bytes, path)?),
        _ => Arc::new(XConv::from_bytes(&bytes, path)?),
    })
}

/// Checks a name without opening anything.
pub(crate) fn check_name(name: &str) -> Result<(), Error> {
    if NAMES.contains(&name) || name.ends_with(WEIGHTS) {
        return Ok(());
    }
    let allowed = match PEERS.contains(&name) {
        true => "its weights file, such as weights/peers/segmap.safetensors",
        false => {
            "one of esm-swift, esm, esm-paper, shape, eigen, esf, gestalt, or a weights file (*.safetensors)"
        }
    };
    Err(Error::Config { field: "descriptor", value: name.to_owned(), allowed })
}
