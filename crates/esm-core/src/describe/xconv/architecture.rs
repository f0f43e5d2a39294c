//! The layer table of the network (paper, section III; the channels give its 300 thousand parameters).

use super::parts::Part;

/// Points a segment is sampled to.
pub(super) const INPUT_POINTS: usize = 256;

/// Number of X-conv layers.
pub(super) const LAYERS: usize = 4;

/// One X-conv layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layer {
    /// Neighbours of a point.
    pub(super) neighbours: usize,
    /// Of the nearest points every `dilation`-th is a neighbour.
    pub(super) dilation: usize,
    /// Channels a neighbour's coordinates are lifted to.
    pub(super) lift: usize,
    /// Channels of the layer before.
    pub(super) previous: usize,
    /// Outputs a channel of the depthwise convolution.
    pub(super) multiplier: usize,
    /// Channels that leave the layer.
    pub(super) channels: usize,
}

/// The four layers.
pub(super) const LAYER_TABLE: [Layer; LAYERS] = {
    const fn layer(
        neighbours: usize,
        dilation: usize,
        lift: usize,
        previous: usize,
        multiplier: usize,
        channels: usize,
    ) -> Layer {
        Layer { neighbours, dilation, lift, previous, multiplier, channels }
    }
    [
        layer(8, 1, 16, 0, 4, 32),
        layer(12, 3, 8, 32, 2, 64),
        layer(16, 3, 16, 64, 2, 128),
        layer(16, 4, 32, 128, 2, 256),
    ]
};

/// Channels of the global branch.
pub(super) const GLOBAL: usize = 64;
/// Outputs of the first fully connected layer.
pub(super) const FC1: usize = 256;
/// Outputs of the second.
pub(super) const FC2: usize = 128;

impl Layer {
    /// Points among which the neighbours are found.
    pub(super) fn reach(&self) -> usize {
        self.neighbours * self.dilation
    }
}

/// Points that each layer keeps: the first ones of the layer before, a uniform sample because their order is random.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PointPlan(pub(super) [usize; LAYERS]);

impl PointPlan {
    /// Points a layer looks for neighbours among.
    pub(super) fn sources(&self, layer: usize) -> usize {
        if layer == 0 { INPUT_POINTS } else { self.0[layer - 1] }
    }

    /// What is wrong with it, if anything.
    pub(super) fn flaw(&self) -> Option<String> {
        for (n, layer) in LAYER_TABLE.iter().enumerate() {
            let (kept, sources) = (self.0[n], self.sources(n));
            if kept == 0 || kept > sources {
                return Some(format!("layer {} keeps {kept} of {sources} points", n + 1));
            }
            if layer.reach() > sources {
                let reach = layer.reach();
                return Some(format!("layer {} needs the {reach} nearest of {sources} points", n + 1));
            }
        }
        None
    }

    /// Multiply-adds for one segment, activations and neighbour search not counted. `measures` enter where
    /// they are joined with the shape; 0: they are not.
    pub(super) fn multiply_adds(&self, learned: usize, measures: usize) -> usize {
        Part::all().into_iter().map(|part| self.part_multiply_adds(part, learned, measures)).sum()
    }

    /// Those of one part.
    pub(super) fn part_multiply_adds(&self, part: Part, learned: usize, measures: usize) -> usize {
        let last = self.0[LAYERS - 1];
        let layer = |n: usize| (self.0[n], &LAYER_TABLE[n]);
        match part {
            Part::Sample | Part::Neighbours | Part::Local(_) => 0,
            Part::Lift(n) => {
                let (points, l) = layer(n);
                points * l.neighbours * (3 * l.lift + l.lift * l.lift)
            }
            Part::Transform(n) => {
                let (points, l) = layer(n);
                points * 5 * l.neighbours.pow(3)
            }
            Part::Mix(n) => {
                let (points, l) = layer(n);
                points * (l.lift + l.previous) * l.neighbours * (l.neighbours + l.multiplier)
            }
            Part::Pointwise(n) => {
                let (points, l) = layer(n);
                points * (l.lift + l.previous) * l.multiplier * l.channels
            }
            Part::Global => last * (3 * GLOBAL + GLOBAL * GLOBAL),
            Part::Connected => last * ((GLOBAL + LAYER_TABLE[LAYERS - 1].channels) * FC1 + FC1 * FC2),
            Part::Head => FC2 * learned + if measures > 0 { (FC2 + measures) * FC2 } else { 0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The figures the reference calculates for the full network and for inner down-sampling.
    #[test]
    fn multiply_adds_are_those_of_the_reference() {
        let millions = |plan| (PointPlan(plan).multiply_adds(16, 0) as f64 / 1e4).round() / 100.0;
        assert_eq!(millions([256; 4]), 98.40);
        assert_eq!((millions([256, 256, 120, 120]) * 10.0).round() / 10.0, 50.2);
        assert_eq!((millions([256, 128, 64, 64]) * 10.0).round() / 10.0, 27.6);
        assert_eq!((millions([256, 96, 64, 48]) * 10.0).round() / 10.0, 22.4);
        assert_eq!((millions([128, 64, 64, 48]) * 10.0).round() / 10.0, 20.6);
    }

    #[test]
    fn plans_without_enough_points_have_a_flaw() {
        assert_eq!(PointPlan([256, 96, 64, 48]).flaw(), None);
        assert!(PointPlan([256, 96, 32, 32]).flaw().is_some_and(|f| f.contains("layer 4")));
        assert!(PointPlan([256, 300, 64, 64]).flaw().is_some_and(|f| f.contains("layer 2")));
        assert!(PointPlan([256, 128, 64, 0]).flaw().is_some());
    }
}
