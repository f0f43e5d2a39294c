//! SVG to PNG, the same on every machine: the only font is the one inside the program.

use std::sync::Arc;

use anyhow::{Context, anyhow};
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

pub(crate) fn render(svg: &str) -> anyhow::Result<Vec<u8>> {
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.load_font_data(dejavu::sans::bold().to_vec());
    let options = Options { fontdb: Arc::new(fonts), ..Options::default() };
    let tree = Tree::from_str(svg, &options).context("rendering the picture")?;
    let size = tree.size().to_int_size();
    let mut pixels = Pixmap::new(size.width(), size.height())
        .ok_or_else(|| anyhow!("rendering the picture: no room for {} x {}", size.width(), size.height()))?;
    resvg::render(&tree, Transform::identity(), &mut pixels.as_mut());
    pixels.encode_png().map_err(|e| anyhow!("rendering the picture: {e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_drawn_without_any_font_of_the_system() {
        let with = |text: &str| {
            let font = super::super::style::FONT;
            let svg = format!(
                r#"<svg xmlns="http://www.w3.org/2000/svg" width="80" height="40"><text x="5" y="30" font-family="{font}" font-size="20">{text}</text></svg>"#
            );
            let png = render(&svg).unwrap();
            assert!(png.starts_with(b"\x89PNG"));
            Pixmap::decode_png(&png).unwrap().pixels().iter().filter(|p| p.alpha() > 0).count()
        };
        assert!(with("a°") > with("a"), "every character of the labels has a glyph");
        assert!(with("a") > 20);
        assert_eq!(with(""), 0);
    }
}
