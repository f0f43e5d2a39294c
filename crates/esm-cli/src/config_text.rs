//! `esm-cli config`: the default configuration as commented TOML.

use esm_core::Config;
use toml::{Table, Value};

use crate::outcome::Outcome;
use crate::output;

pub(crate) fn run() -> anyhow::Result<Outcome> {
    output::data(commented_defaults()?.as_bytes())?;
    Ok(Outcome::Done)
}

const HEAD: &str = "\
# Configuration of esm-cli: `esm-cli localize --config FILE ...`.
# Every key is optional, these are the defaults. Unknown keys are refused; flags win over the file.
";

/// What every key means, with its unit. Tables have an entry too.
const MEANINGS: &[(&str, &str)] = &[
    (
        "descriptor",
        "How segments are described: by \"shape\" (eigenvalue features and metric size) or \"eigen\" (the features alone), by \
         the networks \"esm-swift\", \"esm\" (all points in every layer) or \"esm-paper\" (the paper's, shape alone), by the peers' \"esf\" (shape \
         distributions) or \"gestalt\" (heights about a key pose), or by a weights file (*.safetensors): one of your own, or a peer's (SegMap, \
         SegMatch, NSM).",
    ),
    ("seed", "Seed of everything random: the same seed gives the same bits, with any number of threads."),
    ("accumulate", "From sweeps to live clouds."),
    (
        "accumulate.distance_m",
        "Metres of travel a live cloud holds; 0 makes every sweep a cloud of its own. (--accumulate)",
    ),
    (
        "accumulate.swathes",
        "Clouds that do not overlap, one every distance_m, instead of one for every sweep. (--swathes)",
    ),
    ("accumulate.max_range_m", "Points farther than this from the sensor are dropped, metres."),
    (
        "accumulate.min_range_m",
        "Points nearer than this to the sensor are dropped, metres: they lie on the robot itself.",
    ),
    (
        "accumulate.sweep_voxel_m",
        "Each sweep is thinned to one point a voxel of this edge, metres; 0 keeps all.",
    ),
    (
        "accumulate.min_step_m",
        "A sweep is kept for later clouds only this far after the last kept one, metres.",
    ),
    (
        "accumulate.max_step_m",
        "A longer step between two sweeps is a gap or a jump and breaks the accumulation, metres.",
    ),
    (
        "odometry",
        "How far the motion between the sweeps of a live cloud is off, as standard deviations: what the covariance of a pose \
         adds to what the points tell.",
    ),
    ("odometry.drift", "Error along the travel, metres a metre; across it three tenths of that."),
    ("odometry.turn_deg_per_m", "Error of the heading, degrees a metre."),
    ("odometry.jitter_m", "Error of every pose that does not add up, metres along each axis."),
    ("odometry.jitter_deg", "The same about each axis, degrees."),
    ("odometry.jitter_heading_deg", "The same of the heading, which gravity does not hold, degrees."),
    (
        "odometry.distortion_m",
        "What the motion during a sweep does to it, metres; 0 where the driver puts its points right. Many sweeps average over it.",
    ),
    ("odometry.distortion_deg", "The same about each axis, degrees."),
    ("segment", "From clouds to segments."),
    ("segment.voxel", "The cloud is thinned to one point a voxel of this edge, metres."),
    ("segment.tolerance", "Points nearer than this to each other belong to one segment, metres."),
    ("segment.min_points", "Fewest points of a segment, after thinning."),
    ("segment.max_points", "Most points of a segment, after thinning."),
    ("segment.sparse", "What holds instead for sparse clouds, such as single sweeps."),
    (
        "segment.sparse.below",
        "A cloud is sparse when it holds fewer points than this in each cubic metre that holds any above the ground; 0: never.",
    ),
    ("segment.sparse.tolerance", "Instead of tolerance, metres."),
    ("segment.sparse.min_points", "Instead of min_points."),
    ("segment.ground", "What counts as ground."),
    ("segment.ground.band", "Height above the ground surface up to which a point is ground, metres."),
    (
        "segment.ground.contact_band",
        "The same where an object stands on the ground, metres: walls and trunks keep their feet.",
    ),
    ("segment.ground.max_slope", "Steepest ground, rise over run."),
    ("match", "From descriptors to candidate matches."),
    (
        "match.k",
        "Candidates a live segment: its nearest map segments in descriptor space; 0: 25 for networks, 60 for \"shape\" and \"eigen\".",
    ),
    (
        "match.max_candidates",
        "Most candidates of a cloud: clouds of very many segments take fewer than k a segment.",
    ),
    (
        "match.search",
        "How they are searched: \"tree\" (k-d tree), \"product\" (matrix product) or \"auto\"; the answers are the same.",
    ),
    (
        "match.min_quality",
        "Live segments less likely than this to be good for matching are left out, 0 to 1.",
    ),
    ("match.max_distance", "Candidates farther than this in descriptor space are dropped; 0 keeps all."),
    (
        "match.max_false_positive_rate",
        "The same by the distance that this share of the pairs of different objects keeps under: 0.1 or 0.2 with a network; 0 keeps all.",
    ),
    ("pose", "From candidate matches to places."),
    (
        "pose.method",
        "How the best group of consistent matches is found: \"clique\", \"prosac\", \"ransac\" or \"plain\" (greedy groups).",
    ),
    (
        "pose.order",
        "Which matches are tried first: \"quality\" (likely to be good for matching) or \"distance\" (of the descriptors). (prosac and plain)",
    ),
    (
        "pose.resolution_m",
        "Two matches agree when their lengths in cloud and map differ by at most this, metres.",
    ),
    ("pose.inlier_m", "A match supports a pose when its centroids lie this near, metres."),
    (
        "pose.gravity",
        "Whether the sensor's z axis points up but for max_tilt_deg: two matches then fix a pose, instead of three.",
    ),
    ("pose.max_tilt_deg", "Largest tilt of the sensor's z axis against the map's, degrees. (with gravity)"),
    (
        "pose.max_extent_change",
        "How much of its length, width or height a segment may have lost or gained against the one it is matched with, turned \
         as the two lie: a share of the larger, 0 to 1, besides resolution_m; 1 compares nothing. (with gravity)",
    ),
    ("pose.min_inliers", "Matches a place must have to be considered at all."),
    ("pose.hypotheses", "Places that are passed on to verification."),
    (
        "pose.prune",
        "Whether matches that agree with too few others are left out first. (false: PROSAC and RANSAC draw from all)",
    ),
    ("pose.distinct_m", "Places nearer than this to each other are one place, metres."),
    (
        "pose.beta",
        "Chance that a candidate agrees with a wrong pose, 0 to 1; 0: measured on each cloud. (PROSAC)",
    ),
    ("pose.max_draws", "Most samples drawn for one place. (PROSAC and RANSAC)"),
    ("pose.max_branches", "Most branches visited for one place. (clique)"),
    ("verify", "From places to a verdict."),
    ("verify.structure_points", "Points of what stands on the ground used for refinement and overlap."),
    ("verify.ground_points", "Points of the ground used for refinement."),
    (
        "verify.min_seen",
        "Share of the cloud's points above the ground that must lie where the map has been seen, 0 to 1.",
    ),
    (
        "verify.max_false_per_thousand",
        "Expected false localizations in a thousand clouds: a place is believed only when its evidence makes it that rare.",
    ),
    ("verify.rays", "Live rays that are looked at for free space."),
    (
        "verify.max_free_space_violated",
        "Share of them that may pass through what the map holds as solid, 0 to 1; 1 lets free space decide nothing. Right places \
         have 0.06 at most.",
    ),
    (
        "verify.max_runner_up",
        "A second place with more than this share of the best score makes the cloud ambiguous, 0 to 1.",
    ),
    ("budget", "How long a cloud may take."),
    (
        "budget.ms",
        "Milliseconds from the newest sweep to the answer; 0: as long as it takes. Where they would not do, the segments of \
         fewest points are left out. The one setting with which the same input does not give the same bits. (--budget-ms)",
    ),
    ("sequence", "From clouds to the way of one robot, where its motion is known. (not with --single)"),
    ("sequence.drift", "Error of the odometry, metres a metre of travel."),
    (
        "sequence.reach_m",
        "A place agrees with the motion when it lies this near to where an earlier one says, metres, besides the drift.",
    ),
    ("sequence.reach_deg", "And when it is turned by no more than this, degrees."),
    (
        "sequence.doubt_m",
        "Travel over which a place that no cloud confirms becomes ten times less likely, metres.",
    ),
    ("map", "How maps are built."),
    (
        "map.window_step_m",
        "Metres of travel from one window to the next; each window is an accumulated cloud.",
    ),
    (
        "map.short_windows_m",
        "Besides those of accumulate.distance_m, windows of these shorter lengths, metres; 0: single sweeps. Clouds that hold \
         less travel are found in them.",
    ),
    ("map.short_step_m", "Metres of travel from one of those to the next."),
    (
        "map.merge_overlap",
        "Two segments are one object when their voxels overlap by at least this, intersection over union; above 1 nothing is merged.",
    ),
    ("map.ground_voxel_m", "The ground is kept at one point a voxel of this edge, metres."),
    (
        "map.structure_voxel_m",
        "What stands on the ground is kept, for verification, at one point a voxel of this edge, metres.",
    ),
    (
        "map.disc_radius_m",
        "A prior cloud is cut into overlapping discs of this radius, metres, about as far as a live cloud reaches.",
    ),
];

/// The defaults, every key with its meaning above it.
///
/// # Errors
/// Where a default cannot be written as TOML.
pub fn commented_defaults() -> anyhow::Result<String> {
    let mut text = String::from(HEAD);
    write_table(&Table::try_from(Config::default())?, "", &mut text);
    Ok(text)
}

fn write_table(table: &Table, prefix: &str, text: &mut String) {
    // TOML wants a table's own values before its tables.
    for (key, value) in table.iter().filter(|(_, v)| !v.is_table()) {
        comment(&format!("{prefix}{key}"), text);
        text.push_str(&format!("{key} = {}\n", written(value)));
    }
    for (key, value) in table {
        let Value::Table(inner) = value else { continue };
        let name = format!("{prefix}{key}");
        text.push('\n');
        comment(&name, text);
        text.push_str(&format!("[{name}]\n"));
        write_table(inner, &format!("{name}."), text);
    }
}

fn comment(key: &str, text: &mut String) {
    if let Some((_, meaning)) = MEANINGS.iter().find(|(k, _)| *k == key) {
        text.push_str(&format!("# {meaning}\n"));
    }
}

/// As a person would write it: 0.2 for a single precision 0.2.
fn written(value: &Value) -> String {
    match value {
        Value::Float(v) if f64::from(*v as f32) == *v => Value::Float(shortest(*v as f32)).to_string(),
        other => other.to_string(),
    }
}

fn shortest(v: f32) -> f64 {
    v.to_string().parse().unwrap_or(f64::from(v))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(table: &Table, prefix: &str, all: &mut Vec<String>) {
        for (key, value) in table {
            all.push(format!("{prefix}{key}"));
            if let Value::Table(inner) = value {
                keys(inner, &format!("{prefix}{key}."), all);
            }
        }
    }

    #[test]
    fn the_text_parses_back_to_the_defaults() {
        let text = commented_defaults().unwrap();
        assert_eq!(toml::from_str::<Config>(&text).unwrap(), Config::default());
    }

    #[test]
    fn every_key_is_there_and_explained_and_nothing_else_is() {
        let mut all = Vec::new();
        keys(&Table::try_from(Config::default()).unwrap(), "", &mut all);
        let mut explained: Vec<String> = MEANINGS.iter().map(|(k, _)| (*k).to_owned()).collect();
        all.sort();
        explained.sort();
        assert_eq!(explained, all);
        let text = commented_defaults().unwrap();
        let lines: Vec<&str> = text.lines().collect();
        for (i, line) in lines.iter().enumerate() {
            if line.contains(" = ") && !line.starts_with('#') || line.starts_with('[') {
                assert!(lines[i - 1].starts_with("# "), "{line} has no comment");
            }
        }
    }

    #[test]
    fn single_precision_values_are_written_as_typed() {
        assert!(!commented_defaults().unwrap().contains("0000000"));
    }
}
