//! From metres in the map to pixels in the picture.

use super::style::{AREA_HEIGHT, MARGIN, WIDTH};

/// Empty border around what is shown, as a share of its size, and at least this many metres.
const BORDER: (f64, f64) = (0.04, 10.0);

/// What part of the map is shown, and how large. y points up, as in the map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View {
    /// Lower left corner, metres.
    pub(crate) min: [f64; 2],
    /// Upper right corner, metres.
    pub(crate) max: [f64; 2],
    /// Pixels a metre.
    pub(crate) scale: f64,
    /// Size of the drawing area, pixels.
    pub(crate) area: [f64; 2],
}

impl View {
    /// Shows the box from `min` to `max`, metres.
    pub(crate) fn of(min: [f64; 2], max: [f64; 2]) -> Self {
        Self::within(min, max, AREA_HEIGHT)
    }

    /// The same, with the lowest and highest drawing area in pixels.
    pub(crate) fn within(min: [f64; 2], max: [f64; 2], heights: (f64, f64)) -> Self {
        let border = |i: usize| (BORDER.0 * (max[i] - min[i])).max(BORDER.1);
        let (mut min, mut max) = ([0, 1].map(|i| min[i] - border(i)), [0, 1].map(|i| max[i] + border(i)));
        let width = WIDTH - MARGIN[0] - MARGIN[2];
        let fit = width / (max[0] - min[0]);
        let height = (fit * (max[1] - min[1])).clamp(heights.0, heights.1);
        let scale = fit.min(height / (max[1] - min[1]));
        // What is narrower than the area stands in its middle.
        for (i, pixels) in [width, height].into_iter().enumerate() {
            let spare = pixels / scale - (max[i] - min[i]);
            min[i] -= 0.5 * spare;
            max[i] += 0.5 * spare;
        }
        Self { min, max, scale, area: [width, height] }
    }

    /// The pixel of a place.
    pub(crate) fn pixel(&self, at: [f64; 2]) -> [f64; 2] {
        [MARGIN[0] + (at[0] - self.min[0]) * self.scale, MARGIN[1] + (self.max[1] - at[1]) * self.scale]
    }

    /// Height of the whole picture, pixels.
    pub(crate) fn height(&self) -> f64 {
        self.area[1] + MARGIN[1] + MARGIN[3]
    }

    /// Round numbers of metres along an axis (0 is x), about `pixels` apart.
    pub(crate) fn ticks(&self, axis: usize, pixels: f64) -> Vec<f64> {
        let step = round_length(pixels / self.scale);
        let first = (self.min[axis] / step).ceil() as i64;
        let last = (self.max[axis] / step).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

/// The largest of 1, 2, 5, 10, ... that is not longer, metres.
pub(crate) fn round_length(metres: f64) -> f64 {
    let decade = 10f64.powf(metres.log10().floor());
    [5.0, 2.0].into_iter().find(|m| m * decade <= metres * (1.0 + 1e-9)).map_or(decade, |m| m * decade)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn north_is_up_and_the_scale_is_the_same_both_ways() {
        let view = View::of([0.0, 0.0], [100.0, 50.0]);
        let (a, b) = (view.pixel([10.0, 10.0]), view.pixel([20.0, 20.0]));
        assert!((b[0] - a[0] - 10.0 * view.scale).abs() < 1e-9);
        assert!((a[1] - b[1] - 10.0 * view.scale).abs() < 1e-9);
    }

    #[test]
    fn all_that_is_shown_is_inside_whatever_its_shape() {
        for max in [[1000.0, 1.0], [1.0, 1000.0], [0.0, 0.0]] {
            let view = View::of([0.0, 0.0], max);
            for corner in [[0.0, 0.0], max] {
                let [x, y] = view.pixel(corner);
                assert!((MARGIN[0]..=WIDTH - MARGIN[2]).contains(&x), "{max:?}: x {x}");
                assert!((MARGIN[1]..=view.height() - MARGIN[3]).contains(&y), "{max:?}: y {y}");
            }
        }
    }

    #[test]
    fn lengths_are_round() {
        for (metres, round) in [(1.0, 1.0), (1.9, 1.0), (2.0, 2.0), (4.9, 2.0), (73.0, 50.0), (0.03, 0.02)] {
            assert!((round_length(metres) - round).abs() < 1e-12, "{metres}");
        }
    }

    #[test]
    fn ticks_are_on_round_numbers_inside() {
        let view = View::of([-103.0, 0.0], [97.0, 80.0]);
        let ticks = view.ticks(0, 160.0);
        assert!(ticks.len() >= 5 && ticks.contains(&0.0), "{ticks:?}");
    }
}
