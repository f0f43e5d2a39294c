//! Where the time of a pass goes: [`PartTime`], and the probe that takes it.

use std::time::{Duration, Instant};

use super::architecture::LAYERS;

/// A part of describing a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Part {
    /// 256 points are drawn and normalised, sizes and context are read.
    Sample,
    /// The nearest points of every point, for all layers.
    Neighbours,
    /// Local coordinates of the neighbours in one X-conv layer, from 0.
    Local(usize),
    /// Their lifting to features.
    Lift(usize),
    /// The X-transform made from them.
    Transform(usize),
    /// The transform times the features, and the depthwise convolution.
    Mix(usize),
    /// The pointwise convolution.
    Pointwise(usize),
    /// The global branch.
    Global,
    /// The first two fully connected layers.
    Connected,
    /// The mean over the points, sizes and context, the last layer, the quality.
    Head,
}

impl Part {
    /// How many there are.
    pub(super) const NUMBER: usize = 5 + 5 * LAYERS;

    /// All parts, in the order of the pass.
    pub fn all() -> Vec<Part> {
        let layer = |n| [Part::Local(n), Part::Lift(n), Part::Transform(n), Part::Mix(n), Part::Pointwise(n)];
        let mut all = vec![Part::Sample, Part::Neighbours];
        all.extend((0..LAYERS).flat_map(layer));
        all.extend([Part::Global, Part::Connected, Part::Head]);
        all
    }

    /// Its place in [`Part::all`].
    fn place(self) -> usize {
        match self {
            Part::Sample => 0,
            Part::Neighbours => 1,
            Part::Local(n) => 2 + 5 * n,
            Part::Lift(n) => 3 + 5 * n,
            Part::Transform(n) => 4 + 5 * n,
            Part::Mix(n) => 5 + 5 * n,
            Part::Pointwise(n) => 6 + 5 * n,
            Part::Global => 2 + 5 * LAYERS,
            Part::Connected => 3 + 5 * LAYERS,
            Part::Head => 4 + 5 * LAYERS,
        }
    }
}

/// What one part of a pass took.
#[derive(Clone, Copy, Debug)]
pub struct PartTime {
    /// Which one.
    pub part: Part,
    /// Time in it.
    pub time: Duration,
    /// Multiply-adds of the network in it, as the architecture has them.
    pub multiply_adds: usize,
}

/// Is told where one part ends and the next begins.
pub(super) trait Probe {
    /// The part that has just ended.
    fn ended(&mut self, part: Part);
}

/// Nobody looks: compiled away.
impl Probe for () {
    #[inline(always)]
    fn ended(&mut self, _: Part) {}
}

/// Adds up the time of each part.
pub(super) struct Stopwatch {
    last: Instant,
    pub(super) spent: [Duration; Part::NUMBER],
}

impl Stopwatch {
    pub(super) fn new() -> Self {
        Self { last: Instant::now(), spent: Default::default() }
    }
}

impl Probe for Stopwatch {
    fn ended(&mut self, part: Part) {
        let now = Instant::now();
        self.spent[part.place()] += now - self.last;
        self.last = now;
    }
}
