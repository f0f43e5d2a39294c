//! Colours and sizes. The hues are Okabe and Ito's, told apart by every kind of colour vision; every state has its own
//! shape as well.

/// Width of the picture, pixels.
pub(crate) const WIDTH: f64 = 1600.0;
/// Highest and lowest drawing area, pixels.
pub(crate) const AREA_HEIGHT: (f64, f64) = (520.0, 1500.0);
/// Around the drawing area: left, top, right, bottom, pixels.
pub(crate) const MARGIN: [f64; 4] = [104.0, 122.0, 36.0, 134.0];

pub(crate) const FONT: &str = "DejaVu Sans, Verdana, sans-serif";
pub(crate) const TITLE_PX: f64 = 30.0;
pub(crate) const TEXT_PX: f64 = 20.0;
pub(crate) const TICK_PX: f64 = 18.0;

pub(crate) const PAPER: &str = "#ffffff";
pub(crate) const INK: &str = "#1b1f24";
pub(crate) const FAINT_INK: &str = "#5c6670";
pub(crate) const FRAME: &str = "#9aa4ae";
pub(crate) const GRID: &str = "#eceff2";
/// Ground, then structures from few to many points.
pub(crate) const GROUND: &str = "#ebe8e2";
pub(crate) const STRUCTURE: [&str; 3] = ["#c9ced3", "#a7aeb5", "#7d858d"];
pub(crate) const MAPPED_PATH: &str = "#9fcbea";
pub(crate) const MAPPED_PATH_PX: f64 = 9.0;
pub(crate) const DRIVE: &str = "#3c434a";
pub(crate) const LOCATED: &str = "#009e73";
pub(crate) const AMBIGUOUS: &str = "#e69f00";
pub(crate) const NOT_LOCATED: &str = "#56606a";
pub(crate) const FALSE: &str = "#d55e00";
/// Match lines.
pub(crate) const MATCH: &str = "#007a59";
