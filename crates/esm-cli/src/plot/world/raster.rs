//! A picture of pixels inside the drawing.

use anyhow::{Context, anyhow};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use resvg::tiny_skia::{Pixmap, PremultipliedColorU8};
use svg::node::element::Image;

/// Opaque colours, row by row from the top.
pub(super) struct Raster {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) rgb: Vec<[f32; 3]>,
}

impl Raster {
    /// The mean of every `n` x `n` pixels.
    pub(super) fn shrunk(&self, n: usize) -> Self {
        let (width, height) = (self.width / n, self.height / n);
        let mean = |i: usize| {
            let (x, y) = (i % width * n, i / width * n);
            let mut sum = [0.0; 3];
            for (dy, dx) in (0..n * n).map(|k| (k / n, k % n)) {
                let rgb = self.rgb[(y + dy) * self.width + x + dx];
                sum = [0, 1, 2].map(|c| sum[c] + rgb[c]);
            }
            sum.map(|v| v / (n * n) as f32)
        };
        Self { width, height, rgb: (0..width * height).map(mean).collect() }
    }

    /// As an element of the drawing with its upper left corner at a pixel.
    pub(super) fn image(&self, [x, y]: [f64; 2]) -> anyhow::Result<Image> {
        let mut pixels = Pixmap::new(self.width as u32, self.height as u32)
            .ok_or_else(|| anyhow!("no room for a picture of {} x {}", self.width, self.height))?;
        for (pixel, rgb) in pixels.pixels_mut().iter_mut().zip(&self.rgb) {
            let [r, g, b] = rgb.map(|v| v.round().clamp(0.0, 255.0) as u8);
            if let Some(opaque) = PremultipliedColorU8::from_rgba(r, g, b, 255) {
                *pixel = opaque;
            }
        }
        let png = pixels.encode_png().context("encoding the picture")?;
        Ok(Image::new()
            .set("x", x)
            .set("y", y)
            .set("width", self.width)
            .set("height", self.height)
            .set("href", format!("data:image/png;base64,{}", STANDARD.encode(png))))
    }
}
