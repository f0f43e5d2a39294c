//! Whether a map's contents make sense: asked of every map, gathered or read. A checksum shows damage; it cannot show
//! a program that wrote nonsense, and nothing that uses a map should have to.

use super::container::Map;
use super::problem::Problem;
use super::quantise::{MAX_COORDINATE_M, MAX_QUANTUM_M};
use super::records::{PointRun, SegmentRecord};

pub(super) const MAX_DIM: u32 = 4096;
pub(super) const MAX_NAME: usize = 64;
pub(super) const MAX_FRAME: usize = 256;
pub(super) const MAX_SOURCE: usize = 4096;
pub(super) const MAX_SETTINGS: usize = 1 << 20;
/// Segments are numbered in 32 bits elsewhere (neighbour lists, matches).
const MAX_SEGMENTS: usize = u32::MAX as usize;
/// Farthest a map-frame coordinate may lie from zero, metres: beyond every projected and earth-centred system.
const MAX_MAP_COORDINATE_M: f64 = 1.0e9;

type Check = Result<(), Problem>;

pub(super) fn check(map: &Map) -> Check {
    let n = map.segments().len();
    if n == 0 || n > MAX_SEGMENTS {
        return bad(format!("it holds {n} segments, 1 to {MAX_SEGMENTS} are possible"));
    }
    texts(map)?;
    frame(map)?;
    descriptors(map, n)?;
    first_bad("segment", map.segments(), segment_is_sound)?;
    runs(map, n)?;
    first_bad("path position", map.path(), is_map_position)?;
    let unsorted = |pair: &[[i32; 2]]| pair[0] >= pair[1];
    match map.coverage().windows(2).position(unsorted) {
        Some(i) => bad(format!("covered cell {} is not greater than the one before it", i + 1)),
        None => Ok(()),
    }
}

fn texts(map: &Map) -> Check {
    let line = |what: &str, text: &str, least: usize, most: usize| {
        if text.len() < least || text.len() > most {
            return bad(format!("the {what} has {} bytes, {least} to {most} are possible", text.len()));
        }
        match text.chars().any(char::is_control) {
            true => bad(format!("the {what} holds a control character")),
            false => Ok(()),
        }
    };
    line("frame name", map.frame_id(), 0, MAX_FRAME)?;
    line("descriptor name", &map.descriptor_info().name, 1, MAX_NAME)?;
    line("source name", map.source(), 0, MAX_SOURCE)?;
    match map.settings().len() {
        0..=MAX_SETTINGS => Ok(()),
        len => bad(format!("the build settings have {len} bytes, at most {MAX_SETTINGS} are possible")),
    }
}

fn frame(map: &Map) -> Check {
    let (low, high) = map.bounds();
    first_bad("corner (origin, lower and upper bound)", &[map.origin(), low, high], is_map_position)?;
    match (0..3).find(|&a| low[a] > high[a]) {
        Some(a) => bad(format!("the bounds are upside down on axis {a}: {} > {}", low[a], high[a])),
        None => Ok(()),
    }
}

fn descriptors(map: &Map, n: usize) -> Check {
    let dim = map.descriptor_info().dim;
    if dim == 0 || dim > MAX_DIM {
        return bad(format!("its descriptors have {dim} numbers a row, 1 to {MAX_DIM} are possible"));
    }
    let dim = dim as usize;
    if n.checked_mul(dim) != Some(map.descriptors().len()) {
        let found = map.descriptors().len();
        return bad(format!("it holds {found} descriptor numbers, {n} segments of {dim} need another count"));
    }
    if map.quality().len() != n {
        return bad(format!("it holds {} qualities for {n} segments", map.quality().len()));
    }
    first_bad("descriptor number", map.descriptors(), |v| v.is_finite())?;
    first_bad("quality", map.quality(), |v| (0.0..=1.0).contains(v))?;
    let Some(s) = map.standardizer() else { return Ok(()) };
    if s.mean.len() != dim || s.inv_std.len() != dim {
        let (m, i) = (s.mean.len(), s.inv_std.len());
        return bad(format!("the descriptor statistics hold {m} means and {i} spreads for {dim} dimensions"));
    }
    first_bad("descriptor mean", &s.mean, |v| v.is_finite())?;
    first_bad("descriptor spread", &s.inv_std, |v| v.is_finite() && *v >= 0.0)
}

fn segment_is_sound(s: &SegmentRecord) -> bool {
    s.centroid.iter().all(|v| v.abs() <= MAX_COORDINATE_M)
        && s.extent.iter().all(|v| (0.0..=2.0 * MAX_COORDINATE_M).contains(v))
}

fn runs(map: &Map, n: usize) -> Check {
    if map.runs().len() != n {
        return bad(format!("it holds {} point runs for {n} segments", map.runs().len()));
    }
    let points = map.point_count() as u64;
    let is_sound = |r: &PointRun| {
        r.len > 0
            && r.start.checked_add(r.len as u64).is_some_and(|end| end <= points)
            && r.quantum > 0.0
            && r.quantum <= MAX_QUANTUM_M
            && r.min.iter().all(|v| v.abs() <= MAX_COORDINATE_M)
            && r.reserved == 0
    };
    first_bad("segment's point run", map.runs(), is_sound)?;
    first_bad("ground tile's point run", map.ground_tiles(), is_sound)?;
    first_bad("structure tile's point run", map.structure_tiles(), is_sound)?;
    // Runs that share points would let a small file stand for any amount of work.
    let runs = map.runs().iter().chain(map.ground_tiles()).chain(map.structure_tiles());
    let listed: u64 = runs.map(|r| r.len as u64).fold(0, u64::saturating_add);
    match listed > points {
        true => bad(format!("the point runs list {listed} points, the map holds {points}")),
        false => Ok(()),
    }
}

fn is_map_position(p: &[f64; 3]) -> bool {
    // NaN compares false.
    p.iter().all(|v| v.abs() <= MAX_MAP_COORDINATE_M)
}

fn first_bad<T: std::fmt::Debug>(what: &str, rows: &[T], is_sound: impl Fn(&T) -> bool) -> Check {
    match rows.iter().position(|row| !is_sound(row)) {
        Some(i) => bad(format!("{what} {i} is out of range: {:?}", rows[i])),
        None => Ok(()),
    }
}

fn bad(what: String) -> Check {
    Err(Problem::invalid(what))
}
