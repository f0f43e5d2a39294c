//! A descriptor that describes each cloud once, however often it is asked for.

use std::sync::{Arc, Mutex, PoisonError};

use esm_core::describe::{Descriptions, Descriptor};
use esm_core::segment::Segment;

/// Remembers by the segments' centroids; one is as good as another's where those are the same.
pub(crate) struct Remembered {
    descriptor: Arc<dyn Descriptor>,
    known: Mutex<Vec<(Vec<[f32; 3]>, Descriptions)>>,
}

impl Remembered {
    pub(crate) fn new(descriptor: Arc<dyn Descriptor>) -> Self {
        Self { descriptor, known: Mutex::new(Vec::new()) }
    }
}

impl Descriptor for Remembered {
    fn name(&self) -> &'static str {
        self.descriptor.name()
    }

    fn version(&self) -> u32 {
        self.descriptor.version()
    }

    fn dim(&self) -> usize {
        self.descriptor.dim()
    }

    fn standardized(&self) -> bool {
        self.descriptor.standardized()
    }

    fn distance_at_rate(&self, false_positive_rate: f64) -> Option<f64> {
        self.descriptor.distance_at_rate(false_positive_rate)
    }

    fn describe(&self, segments: &[Segment]) -> Descriptions {
        let key: Vec<[f32; 3]> = segments.iter().map(|s| s.centroid).collect();
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, described)) = known.iter().find(|k| k.0 == key) {
            return described.clone();
        }
        let described = self.descriptor.describe(segments);
        known.push((key, described.clone()));
        described
    }
}
