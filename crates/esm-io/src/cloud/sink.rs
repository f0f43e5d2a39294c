//! Where the cloud readers put their points.

use esm_core::PointCloud;

/// Coordinates beyond this, metres, get an origin of their own: at 8 km and more an f32 is coarser than half a
/// millimetre, and UTM's millions would leave steps of half a metre.
const FAR: f64 = 10_000.0;

/// Origins are multiples of this, metres: easy to read, exact in f64.
const ORIGIN_STEP: f64 = 1_000.0;

/// Most points reserved ahead of reading them; more grow as they come.
const RESERVE_LIMIT: u64 = 1 << 20;

/// Collects finite points, relative to an origin in f64.
pub(crate) struct PointSink {
    origin: Option<[f64; 3]>,
    points: Vec<[f32; 3]>,
    dropped: usize,
}

impl PointSink {
    /// Points stay as they are: a scan in its sensor's frame.
    pub(crate) fn sensor_frame() -> Self {
        Self { origin: Some([0.0; 3]), points: Vec::new(), dropped: 0 }
    }

    /// The first point decides about the origin: a survey in any frame.
    pub(crate) fn with_origin() -> Self {
        Self { origin: None, points: Vec::new(), dropped: 0 }
    }

    pub(crate) fn reserve(&mut self, points: u64) {
        self.points.reserve(points.min(RESERVE_LIMIT) as usize);
    }

    /// Takes one point; NaN, infinities and the exact zero that sensors send for "no return" are counted and left out.
    /// Returns whether it was taken.
    #[inline]
    pub(crate) fn push(&mut self, p: [f64; 3]) -> bool {
        if p == [0.0; 3] || !p.iter().all(|v| v.is_finite()) {
            self.dropped += 1;
            return false;
        }
        let origin = *self.origin.get_or_insert_with(|| {
            p.map(|v| if v.abs() > FAR { (v / ORIGIN_STEP).floor() * ORIGIN_STEP } else { 0.0 })
        });
        let q = [(p[0] - origin[0]) as f32, (p[1] - origin[1]) as f32, (p[2] - origin[2]) as f32];
        let taken = q.iter().all(|v| v.is_finite());
        if taken {
            self.points.push(q);
        } else {
            self.dropped += 1;
        }
        taken
    }

    pub(crate) fn finish(self) -> ([f64; 3], PointCloud, usize) {
        let (cloud, late) = PointCloud::from_finite(self.points);
        (self.origin.unwrap_or_default(), cloud, self.dropped + late)
    }
}
