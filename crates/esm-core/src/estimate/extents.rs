//! Agreement of extents: on which turns about the up axis a live segment is as long, wide and high as a map segment.
//!
//! A match allows few turns where its segment is long and thin, a wall or a hedge; a pole allows all. Two matches that agree
//! must have a turn in common, besides the one that their places fix.

use super::agreement::TURNS;
use super::candidate::{ANY_TURN, Candidate};
use super::config::PoseConfig;
use crate::segment::Segment;

/// Directions of half a circle: opposite ones give one width.
const DIRECTIONS: usize = TURNS as usize / 2;

/// How far a segment extends in every horizontal direction, and upwards, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Widths {
    /// By direction, clockwise from the x axis; each is the middle of its bin of turns.
    across: [f32; DIRECTIONS],
    height: f32,
}

impl Widths {
    /// Of points in a frame with z up.
    pub fn of(points: &[[f32; 3]]) -> Self {
        let directions: [[f32; 2]; DIRECTIONS] = std::array::from_fn(|k| {
            let angle = -(k as f32 + 0.5) / TURNS * std::f32::consts::TAU;
            [angle.cos(), angle.sin()]
        });
        let (mut low, mut high) = ([f32::INFINITY; DIRECTIONS], [f32::NEG_INFINITY; DIRECTIONS]);
        let (mut lowest, mut highest) = (f32::INFINITY, f32::NEG_INFINITY);
        for p in points {
            for (k, d) in directions.iter().enumerate() {
                let along = p[0] * d[0] + p[1] * d[1];
                // Written out: the library's minimum takes care of NaN, and costs several instructions for it.
                low[k] = if along < low[k] { along } else { low[k] };
                high[k] = if along > high[k] { along } else { high[k] };
            }
            (lowest, highest) = (lowest.min(p[2]), highest.max(p[2]));
        }
        let across = std::array::from_fn(|k| (high[k] - low[k]).max(0.0));
        Self { across, height: (highest - lowest).max(0.0) }
    }

    /// The turns on which the segment's extents along the map's axes are those of `extent_map`, as [`Candidate::turns`].
    /// They may differ by `resolution_m` and a share of the larger.
    ///
    /// ```
    /// use esm_core::estimate::{ANY_TURN, Widths};
    /// // A wall of 8 m along the sensor's x axis; in the map it runs along y: a quarter turn, either way.
    /// let wall = Widths::of(&[[0.0, 0.0, 0.0], [8.0, 0.3, 2.0]]);
    /// let turns = wall.turns([0.3, 8.0, 2.0], 0.5, 0.2);
    /// assert!(turns & 1 << 16 != 0 && turns & 1 << 48 != 0 && turns.count_ones() < 20);
    /// assert_eq!(wall.turns([0.3, 8.0, 2.0], 0.5, 1.0), ANY_TURN);
    /// assert_eq!(wall.turns([0.3, 8.0, 9.0], 0.5, 0.2), 0); // far higher
    /// ```
    pub fn turns(&self, extent_map: [f32; 3], resolution_m: f32, share: f32) -> u64 {
        let alike = |a: f32, b: f32| (a - b).abs() <= resolution_m + share * a.max(b);
        if !alike(self.height, extent_map[2]) {
            return 0;
        }
        let mut half = 0u64;
        for k in 0..DIRECTIONS {
            // Turned by the middle of bin k, the map's x axis is direction k of the segment, and its y axis a quarter back.
            let (x, y) = (self.across[k], self.across[(k + DIRECTIONS / 2) % DIRECTIONS]);
            half |= u64::from(alike(x, extent_map[0]) & alike(y, extent_map[1])) << k;
        }
        half | half << DIRECTIONS
    }
}

/// Notes in every candidate on which turns its two segments have the same extents, by `config.max_extent_change`, and drops
/// those that have them on none; leaves all where that compares nothing. `extent_map`: the extents of a map segment along the map's axes, metres.
pub fn compare_extents(
    candidates: &mut Vec<Candidate>,
    live: &[Segment],
    extent_map: impl Fn(u32) -> [f32; 3],
    config: &PoseConfig,
) {
    if !config.gravity || config.max_extent_change >= 1.0 {
        return;
    }
    let (resolution_m, share) = (config.resolution_m as f32, config.max_extent_change as f32);
    let widths: Vec<Widths> = live.iter().map(|s| Widths::of(&s.points)).collect();
    candidates.retain_mut(|c| {
        let widths = widths.get(c.live as usize);
        c.turns = widths.map_or(ANY_TURN, |w| w.turns(extent_map(c.map), resolution_m, share));
        c.turns != 0
    });
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::cloud::{Pose, transform_point};
    use crate::estimate::{Agreement, Pair};

    proptest! {
        #[test]
        fn a_turned_segment_has_the_extents_of_the_turned_points(
            points in prop::collection::vec(prop::array::uniform3(-9.0f32..9.0), 2..30),
            yaw in -3.1f64..3.1,
        ) {
            let pose = Pose::new([40.0, -7.0, 2.0].into(), [0.0, 0.0, yaw].into());
            let turned: Vec<_> = points.iter().map(|p| transform_point(&pose, *p)).collect();
            let mapped = Segment::from_points(turned).unwrap();
            let extent = [0, 1, 2].map(|a| mapped.max[a] - mapped.min[a]);
            let centroid = Segment::from_points(points.clone()).unwrap().centroid;
            // A bin is 0.1 rad wide: half of that moves the ends of a segment of 26 m across by 1.3 m.
            let turns = Widths::of(&points).turns(extent, 1.4, 0.0);
            let pair = Pair { live: centroid, map: mapped.centroid };
            let one = Candidate { live: 0, map: 0, distance: 0.0, quality: 1.0, pair, turns };
            let far = [centroid[0] + 90.0, centroid[1], centroid[2]];
            let pair = Pair { live: far, map: transform_point(&pose, far) };
            let other = Candidate { live: 1, map: 1, pair, turns: ANY_TURN, ..one };
            let agreement = Agreement { resolution_m: 0.5, max_tilt_rad: Some(0.02) };
            prop_assert!(agreement.holds(&one, &other), "{turns:064b}");
        }
    }

    #[test]
    fn two_walls_agree_on_the_turn_of_their_places_only() {
        let wall = |turns| {
            let pair = Pair { live: [0.0; 3], map: [100.0, 0.0, 0.0] };
            Candidate { live: 0, map: 0, distance: 0.0, quality: 1.0, pair, turns }
        };
        // The places say: turned by a quarter, anticlockwise.
        let pair = Pair { live: [30.0, 0.0, 0.0], map: [100.0, 30.0, 0.0] };
        let other = Candidate { live: 1, map: 1, pair, ..wall(ANY_TURN) };
        let agreement = Agreement { resolution_m: 0.5, max_tilt_rad: Some(0.05) };
        let along_x = Widths::of(&[[-4.0, 0.0, 0.0], [4.0, 0.2, 2.0]]);
        assert!(agreement.holds(&wall(along_x.turns([0.2, 8.0, 2.0], 0.5, 0.1)), &other));
        assert!(!agreement.holds(&wall(along_x.turns([8.0, 0.2, 2.0], 0.5, 0.1)), &other));
        // Without gravity extents along the map's axes mean nothing.
        let tilted = Agreement { max_tilt_rad: None, ..agreement };
        assert!(tilted.holds(&wall(along_x.turns([8.0, 0.2, 2.0], 0.5, 0.1)), &other));
    }
}
