//! The native half of the Python package `esm_py`: the crates, one to one, with NumPy arrays in the place of clouds, poses
//! and descriptors. Nothing is computed here.
//!
//! What Python sees is described in `python/esm_py/_native.pyi`. Heavy work runs detached from the interpreter
//! (`work.rs`); the crates' errors are exceptions of classes of their own (`failure.rs`).

#![cfg_attr(not(test), warn(clippy::unwrap_used))]

mod accumulate;
mod builder;
mod config;
mod describe;
mod failure;
mod files;
mod input;
mod learn;
mod localize;
mod loops;
mod map;
mod matching;
mod output;
mod pose;
mod recording;
mod segment;
mod sequence;
mod simulate;
mod threads;
mod work;

use pyo3::prelude::*;

/// The native half of esm_py.
#[pymodule(gil_used = false)]
mod _native {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::accumulate::{Accumulator, LiveCloud};
    #[pymodule_export]
    use crate::builder::MapBuilder;
    #[pymodule_export]
    use crate::config::Config;
    #[pymodule_export]
    use crate::describe::{Descriptions, Descriptor, XConv};
    #[pymodule_export]
    use crate::files::{
        PoseWriter, PriorCloud, Scan, Trajectory, classify, finite, read_kitti_poses, read_poses,
        read_prior_cloud, read_scan, read_tum, write_tum,
    };
    #[pymodule_export]
    use crate::learn::{Found, Identities, SegmentSetWriter, Surveyor};
    #[pymodule_export]
    use crate::localize::{Localization, Localizer, MatchedSegment};
    #[pymodule_export]
    use crate::loops::{LoopAnswer, LoopClosure, LoopFinder};
    #[pymodule_export]
    use crate::map::{DescriptorInfo, Map, Standardizer};
    #[pymodule_export]
    use crate::matching::{Candidates, Hypothesis, Index, candidates, search};
    #[pymodule_export]
    use crate::recording::{Damage, Recording, Sweep, Sweeps, Topic};
    #[pymodule_export]
    use crate::segment::{
        Segment, Segmentation, euclidean_clusters, ground_flags, segment, segments_of, voxel_filter,
    };
    #[pymodule_export]
    use crate::sequence::SequenceLocalizer;
    #[pymodule_export]
    use crate::simulate::{Preset, Progress, Summary, simulate};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::threads::remember_process();
        let py = module.py();
        module.add("DESCRIPTORS", crate::describe::names(py)?)?;
        module.add("PRESETS", crate::simulate::preset_names(py)?)?;
        module.add("CLASSES", crate::simulate::class_names(py)?)?;
        module.add("UNKNOWN_CLASS", esm_learn::UNKNOWN_CLASS)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
