//! The command line as it is typed. Nothing here is checked beyond its spelling; see [`crate::settings`].

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Args, Parser, Subcommand, ValueHint};
use clap_complete::Shell;

use crate::inputs::FrameRange;

/// Find a robot in a prior map from LiDAR alone, on a CPU, and say honestly when it cannot be found.
#[derive(Debug, Parser)]
#[command(
    name = "esm-cli",
    bin_name = "esm-cli",
    version,
    max_term_width = 100,
    arg_required_else_help = true
)]
#[command(after_help = EXIT_CODES)]
pub struct Cli {
    /// More to read on stderr; twice for the time of every stage of every cloud
    #[arg(short, long, global = true, action = clap::ArgAction::Count, conflicts_with = "quiet")]
    verbose: u8,
    /// Only errors on stderr, and no progress bars
    #[arg(short, long, global = true)]
    quiet: bool,
    /// What to do
    #[command(subcommand)]
    pub command: Command,
}

const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 ran, but localized nothing; 2 error; 130 stopped by SIGINT (Ctrl-C), SIGTERM
or SIGHUP.
Data goes to stdout, logs and progress bars to stderr.";

impl Cli {
    /// How much to say on stderr: -1 only errors, 0 warnings, 1 what happens, 2 every detail.
    pub fn verbosity(&self) -> i8 {
        if self.quiet { -1 } else { self.verbose.min(2) as i8 }
    }
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Build a map, or look into one
    Map {
        /// Build or look
        #[command(subcommand)]
        command: MapCommand,
    },
    /// Say, cloud by cloud, where in a map a recording was made
    Localize(Box<LocalizeArgs>),
    /// Find loop closures inside one recording
    Loops(Box<LoopsArgs>),
    /// Simulate a world and record two visits to it, with their truth
    Simulate(SimulateArgs),
    /// The whole story on two small simulated places: simulate, map, localize; offline, in a minute
    Demo(DemoArgs),
    /// Judge several methods on several places by a plan: tables, curves and pictures
    Evaluate(EvaluateArgs),
    /// Cut recordings whose poses are known into labelled segments, for training and judging descriptors
    Segments(Box<SegmentsArgs>),
    /// Answer robots over the network: clouds in, poses out, as long as it runs
    Serve(Box<ServeArgs>),
    /// Stream a recording to a service, as a robot would
    Replay(Box<ReplayArgs>),
    /// Print the default configuration as commented TOML
    Config,
    /// Print a completion script
    Completions {
        /// Of this shell
        shell: Shell,
    },
    /// Print the manual page, or write one page for every command
    Man {
        /// Write the pages into this directory
        #[arg(short = 'o', long = "output", value_name = "DIR", value_hint = ValueHint::DirPath)]
        dir: Option<PathBuf>,
    },
}

/// `esm-cli map ...`
#[derive(Debug, Subcommand)]
pub enum MapCommand {
    /// Build a map from posed recordings, or from one prior cloud
    Build(Box<BuildArgs>),
    /// Say what a map holds
    Info(InfoArgs),
}

/// `esm-cli map build ...`
#[derive(Debug, Args)]
pub struct BuildArgs {
    /// Recordings (.mcap), directories of scans, or one prior cloud (.las .laz .pcd .ply)
    #[arg(required = true, value_name = "INPUT", value_hint = ValueHint::AnyPath)]
    pub inputs: Vec<PathBuf>,
    /// Where to write the map
    #[arg(short, long, value_name = "MAP.esm", value_hint = ValueHint::FilePath)]
    pub output: PathBuf,
    /// Metres of travel a window of the map holds; 0 makes every sweep a window of its own
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    pub accumulate: Option<f64>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub read: ReadArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub tune: TuneArgs,
}

/// `esm-cli map info ...`
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// The map
    #[arg(value_name = "MAP.esm", value_hint = ValueHint::FilePath)]
    pub map: PathBuf,
    /// Verify every byte, the points included
    #[arg(long)]
    pub check: bool,
    /// Also print the configuration the map was built with, as TOML; --json always tells it
    #[arg(long)]
    pub settings: bool,
    /// One JSON object instead of a table
    #[arg(long)]
    pub json: bool,
}

/// `esm-cli localize ...`
#[derive(Debug, Args)]
pub struct LocalizeArgs {
    /// Recordings (.mcap), directories of scans, or single scans
    #[arg(required = true, value_name = "INPUT", value_hint = ValueHint::AnyPath)]
    pub inputs: Vec<PathBuf>,
    /// The map to search
    #[arg(short, long, value_name = "MAP.esm", value_hint = ValueHint::FilePath)]
    pub map: PathBuf,
    /// Every cloud for itself: no motion prior, no result or descriptor kept from earlier clouds. Without it, a
    /// place that was believed is followed by the odometry
    #[arg(long)]
    pub single: bool,
    /// Milliseconds a cloud may take: where they would not do, the smallest segments are left out, and the results depend on
    /// the machine [default: as long as it takes]
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    pub budget_ms: Option<f64>,
    /// Where the sensor truly was, in the map frame: a TUM file, or an .mcap with odometry
    #[arg(long, value_name = "FILE.tum", value_hint = ValueHint::FilePath)]
    pub truth: Option<PathBuf>,
    /// One JSON object a line and cloud, and a summary
    #[arg(long)]
    pub json: bool,
    /// Write the located poses: .tum (text) or .mcap (geometry_msgs/PoseWithCovarianceStamped)
    #[arg(short, long, value_name = "FILE.tum|FILE.mcap", value_hint = ValueHint::FilePath)]
    pub output: Option<PathBuf>,
    /// Draw the map from above with the drive and its matches
    #[arg(long, value_name = "FILE.png|FILE.svg", value_hint = ValueHint::FilePath)]
    pub plot: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub live: LiveArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub read: ReadArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub tune: TuneArgs,
}

/// `esm-cli loops ...`
#[derive(Debug, Args)]
pub struct LoopsArgs {
    /// One recording (.mcap, possibly in several files) or a directory of scans, with its motion
    #[arg(required = true, value_name = "INPUT", value_hint = ValueHint::AnyPath)]
    pub inputs: Vec<PathBuf>,
    /// Where the sensor truly was, in any one frame: a TUM file, or an .mcap with odometry
    #[arg(long, value_name = "FILE.tum", value_hint = ValueHint::FilePath)]
    pub truth: Option<PathBuf>,
    /// One JSON object a line and closure, and a summary
    #[arg(long)]
    pub json: bool,
    /// Write the pose graph: odometry and loop edges
    #[arg(short, long, value_name = "FILE.g2o", value_hint = ValueHint::FilePath)]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub live: LiveArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub read: ReadArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub tune: TuneArgs,
}

/// `esm-cli simulate ...`
#[derive(Debug, Args)]
#[command(after_help = SIMULATE_FILES)]
pub struct SimulateArgs {
    /// What to simulate
    #[arg(value_name = "PRESET", value_parser = presets())]
    pub preset: String,
    /// Seed of the world: 0-99 for training, 100-199 for tuning, 200 and up for judging only
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Length of the route, as a factor of the preset's own: 0.005 to 4
    #[arg(long, value_name = "F", default_value_t = 1.0, allow_negative_numbers = true)]
    pub scale: f64,
    /// Directory for the recordings; made where it is missing
    #[arg(short, long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub output: PathBuf,
    /// Drive the live visit the other way round, in the other lane where there are lanes
    #[arg(long)]
    pub live_reversed: bool,
    /// Drive the live visit M metres beside the mapped way, to its left as it is driven (-20 to 20), or as far as the
    /// ground allows: on the carriageway, and clear of what stands
    #[arg(long, value_name = "M", default_value_t = 0.0, allow_negative_numbers = true)]
    pub live_offset: f64,
    /// Share (0 to 1) of what can change that is gone, new or moved at the live visit: trees, bushes, street
    /// furniture, cars, bins [default: as the preset has it]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    pub live_changed: Option<f64>,
    /// Draw the world from above, and a sweep in perspective
    #[arg(long, value_name = "FILE.png|FILE.svg", value_hint = ValueHint::FilePath)]
    pub plot: Option<PathBuf>,
    /// Worker threads; the recordings do not depend on it [default: one a core]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Replace what a finished simulation has left in the directory
    #[arg(long)]
    pub force: bool,
    /// One JSON object instead of a table
    #[arg(long)]
    pub json: bool,
}

const SIMULATE_FILES: &str = "\
DIR holds map.mcap and live.mcap, the two visits; map_truth.tum and live_truth.tum, where the sensor
truly was, both in the map frame; preset.toml, how they were made. Build the map with
`map build DIR/map.mcap --poses DIR/map_truth.tum` to have it in the frame of the truth.
A simulation that was stopped goes on where it was when the same command is given again.
The map visit is the same to the byte whatever --live-... says: one map serves all drives of a seed.

Points have x y z (m, in the sensor frame), intensity (0-255), time (s, 0 or before: the stamp is the
end of a sweep), ring (0 is the lowest laser), object_id (0 is the ground; the same thing has the same
number at both visits) and class: 1 grass, 2 litter, 3 track, 4 road, 5 pavement, 10 tree, 11 bush,
12 log, 13 stump, 14 undergrowth, 15 rock, 16 hedge, 20 building, 21 window, 22 wall, 23 fence, 30 pole,
31 sign, 32 bin, 33 bench, 34 statue, 40 car, 41 van, 42 person, and what moves: 50 car, 51 van,
52 cyclist, 53 walker, 54 dog. Odometry tells no covariance.";

/// The presets, with what they mirror.
fn presets() -> PossibleValuesParser {
    esm_sim::PRESETS.map(|p| PossibleValue::new(p.name).help(p.about)).into()
}

/// `esm-cli demo ...`
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Directory for recordings, maps, results and the picture; made where it is missing
    #[arg(short, long, value_name = "DIR", default_value = "esm-demo", value_hint = ValueHint::DirPath)]
    pub output: PathBuf,
    /// Worker threads; the results do not depend on it [default: one a core]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Length of the places, as a factor of the demo's own
    #[arg(long, value_name = "F", default_value_t = 1.0, hide = true)]
    pub scale: f64,
}

/// `esm-cli evaluate ...`
#[derive(Debug, Args)]
#[command(after_help = EVALUATE_WORDS)]
pub struct EvaluateArgs {
    /// The plan: datasets, methods and modes
    #[arg(value_name = "PLAN.toml", value_hint = ValueHint::FilePath)]
    pub plan: PathBuf,
    /// Directory for the report; made where it is missing
    #[arg(short, long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub output: PathBuf,
    /// Directory for simulated recordings, maps and results, which later runs take up [default: DIR/work]
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub work: Option<PathBuf>,
    /// Only this dataset of the plan; several times for several
    #[arg(long, value_name = "NAME")]
    pub dataset: Vec<String>,
    /// Only this method; several times for several
    #[arg(long, value_name = "NAME")]
    pub method: Vec<String>,
    /// Only this mode; several times for several
    #[arg(long, value_name = "NAME")]
    pub mode: Vec<String>,
    /// Only the trials of this simulated world, or `-` for recordings, and no report: how the program calls itself
    #[arg(long, value_name = "SEED", hide = true, allow_hyphen_values = true)]
    pub alone: Option<String>,
    /// Take results of other builds of this program too; without it they are computed again
    #[arg(long)]
    pub reuse_older: bool,
    /// Worker threads for simulating, mapping and curves; localization is timed in one [default: one a core]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// results.json on stdout instead of a table
    #[arg(long)]
    pub json: bool,
}

const EVALUATE_WORDS: &str = "\
DIR gets report.md (tables and pictures), results.json, results.csv and the pictures. Every result is
kept under the digest of all that goes into it: inputs, weights, settings, program. What is there is not
computed again, and an evaluation that was stopped goes on when the same command is given again.
evaluation/ in the source holds plans, docs/evaluation.md says what may stand in one.";

/// `esm-cli segments ...`
#[derive(Debug, Args)]
#[command(after_help = SEGMENTS_WORDS)]
pub struct SegmentsArgs {
    /// Directories that `simulate` has made, each a place of its own; or recordings of one place
    #[arg(required = true, value_name = "INPUT", value_hint = ValueHint::AnyPath)]
    pub inputs: Vec<PathBuf>,
    /// Directory for the set, which must not exist yet
    #[arg(short, long, value_name = "SET", value_hint = ValueHint::DirPath)]
    pub output: PathBuf,
    /// Where the sensor truly was, one file a recording and all in one frame [default: the odometry]
    #[arg(long, value_name = "FILE.tum", value_hint = ValueHint::FilePath)]
    pub truth: Vec<PathBuf>,
    /// Name of the place [default: that of the first recording; simulated ones are named preset:seed:scale]
    #[arg(long, value_name = "NAME")]
    pub place: Option<String>,
    /// Metres of travel a cloud holds; several lengths give clouds of each
    #[arg(
        long,
        value_name = "D[,D]",
        value_delimiter = ',',
        default_value = "20",
        allow_negative_numbers = true
    )]
    pub accumulate: Vec<f64>,
    /// Metres of travel between two clouds that are cut
    #[arg(long, value_name = "M", default_value_t = 5.0, allow_negative_numbers = true)]
    pub step: f64,
    /// One JSON object instead of a line
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub read: ReadArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub tune: TuneArgs,
}

const SEGMENTS_WORDS: &str = "\
Where points carry the field object_id, as the simulator's do, a segment is named after the object
that has most of its points. Elsewhere segments within 0.5 m of each other are one object, those more
than 4 m apart are different ones, and the others have no name. The set is a directory of NumPy
arrays; python/train/DATA.md describes it.";

/// `esm-cli serve ...`
#[derive(Debug, Args)]
#[command(after_help = SERVE_WORDS)]
pub struct ServeArgs {
    /// A map, and its name where that is not the file's; several times for several maps
    #[arg(short, long, required = true, value_name = "[NAME=]MAP.esm", value_hint = ValueHint::FilePath)]
    pub map: Vec<String>,
    /// Where to listen; port 0 takes any free one
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:8080")]
    pub listen: String,
    /// Metres of travel a cloud of a session holds, where the session does not say; 0 takes each sweep by itself
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    pub accumulate: Option<f64>,
    /// Milliseconds a cloud may take: where they would not do, the smallest segments are left out, and the answers depend on
    /// the machine [default: as long as it takes]
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    pub budget_ms: Option<f64>,
    /// Maps may be loaded from here too, while it runs; otherwise from the folders of the given maps only
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub map_root: Vec<PathBuf>,
    /// How lines of the log look
    #[arg(long, value_enum, default_value_t = crate::console::Style::Text, value_name = "STYLE")]
    pub log: crate::console::Style,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub safety: SafetyArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub limits: LimitArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub tune: TuneArgs,
}

const SERVE_WORDS: &str = "\
POST /v1/localize finds one cloud; GET /v1/session streams (WebSocket); GET, PUT, DELETE /v1/maps load
and swap maps; GET /healthz, /readyz, /metrics and /openapi.json, which describes it all;
GET / is a page for people.
Its address is printed on stdout once it can answer. The first SIGINT (Ctrl-C), SIGTERM or SIGHUP
finishes what is in flight and ends with 0, the second one ends at once with 130.";

/// Who may ask.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Safety")]
pub struct SafetyArgs {
    /// Requests must carry the token in this file (Authorization: Bearer TOKEN)
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub token_file: Option<PathBuf>,
    /// Certificate chain for TLS
    #[arg(long, value_name = "FILE.pem", requires = "tls_key", value_hint = ValueHint::FilePath)]
    pub tls_cert: Option<PathBuf>,
    /// Its private key
    #[arg(long, value_name = "FILE.pem", requires = "tls_cert", value_hint = ValueHint::FilePath)]
    pub tls_key: Option<PathBuf>,
    /// Listen on an address that others can reach, without token and TLS
    #[arg(long)]
    pub insecure_public: bool,
}

/// How much is taken on.
#[derive(Debug, Args)]
#[command(next_help_heading = "Limits")]
pub struct LimitArgs {
    /// Largest request body or message, MiB
    #[arg(long, value_name = "MB", default_value_t = 64)]
    pub max_body_mb: usize,
    /// What all bodies may take of the memory together, MiB
    #[arg(long, value_name = "MB", default_value_t = 512)]
    pub max_held_mb: usize,
    /// Largest map file, MiB: maps are held in memory
    #[arg(long, value_name = "MB", default_value_t = 8192)]
    pub max_map_mb: u64,
    /// Clouds localized at the same time [default: one a core]
    #[arg(long, value_name = "N")]
    pub workers: Option<usize>,
    /// Requests that may wait for a worker; more are told to come again
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub queue: usize,
    /// Seconds a request may take
    #[arg(long, value_name = "S", default_value_t = 30.0, allow_negative_numbers = true)]
    pub timeout: f64,
    /// Connections at the same time
    #[arg(long, value_name = "N", default_value_t = 256)]
    pub max_connections: usize,
    /// Streaming sessions at the same time
    #[arg(long, value_name = "N", default_value_t = 16)]
    pub max_sessions: usize,
}

/// `esm-cli replay ...`
#[derive(Debug, Args)]
#[command(after_help = REPLAY_WORDS)]
pub struct ReplayArgs {
    /// Recordings (.mcap), directories of scans, or single scans
    #[arg(required = true, value_name = "INPUT", value_hint = ValueHint::AnyPath)]
    pub inputs: Vec<PathBuf>,
    /// The service
    #[arg(long, value_name = "URL", value_hint = ValueHint::Url)]
    pub to: String,
    /// The service's map to search [default: all it has]
    #[arg(short, long, value_name = "NAME")]
    pub map: Option<String>,
    /// Metres of travel a cloud holds [default: the service's setting]
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    pub accumulate: Option<f64>,
    /// How many times faster than recorded; 0 sends each sweep when the one before was answered
    #[arg(long, value_name = "F", default_value_t = 1.0, allow_negative_numbers = true)]
    pub speed: f64,
    /// The service's answers as they come, and a summary
    #[arg(long)]
    pub json: bool,
    /// The token in this file, where the service wants one
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub token_file: Option<PathBuf>,
    /// The certificate to trust, where the service speaks TLS
    #[arg(long, value_name = "FILE.pem", value_hint = ValueHint::FilePath)]
    pub ca: Option<PathBuf>,
    /// Poses of the scans: a TUM file (by time stamp) or a KITTI file (one line a scan)
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub poses: Option<PathBuf>,
    /// Only these scans, counted from 1 over all inputs
    #[arg(long, value_name = "A-B[,C-D]", value_delimiter = ',')]
    pub frames: Vec<FrameRange>,
    /// Topic of the point clouds
    #[arg(long, value_name = "TOPIC")]
    pub cloud_topic: Option<String>,
    /// Topic of the sensor's motion (Odometry, PoseStamped or TFMessage)
    #[arg(long, value_name = "TOPIC")]
    pub odometry_topic: Option<String>,
}

const REPLAY_WORDS: &str = "\
Sweeps that come faster than the service answers are dropped by it, all but the newest; the summary
counts them. With --speed 0 every sweep is answered, as by `localize`.";

/// How live clouds are put together.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Live clouds")]
pub struct LiveArgs {
    /// Metres of travel a live cloud holds; 0 makes every sweep a cloud of its own
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    pub accumulate: Option<f64>,
    /// Clouds that do not overlap, one every D metres
    #[arg(long)]
    pub swathes: bool,
}

/// What to read.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Reading")]
pub struct ReadArgs {
    /// Poses of the scans: a TUM file (by time stamp) or a KITTI file (one line a scan)
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub poses: Option<PathBuf>,
    /// Only these scans, counted from 1 over all inputs
    #[arg(long, value_name = "A-B[,C-D]", value_delimiter = ',')]
    pub frames: Vec<FrameRange>,
    /// Only from this many seconds after the first scan
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub from: Option<f64>,
    /// Only up to this many seconds after the first scan
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub to: Option<f64>,
    /// Topic of the point clouds
    #[arg(long, value_name = "TOPIC")]
    pub cloud_topic: Option<String>,
    /// Topic of the sensor's motion (Odometry, PoseStamped or TFMessage)
    #[arg(long, value_name = "TOPIC")]
    pub odometry_topic: Option<String>,
}

/// How to work.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Method")]
pub struct TuneArgs {
    /// Descriptor of the segments: esm-swift, esm, esm-paper, shape, eigen, esf, gestalt, or a weights file (*.safetensors), ours or a
    /// peer's [default: what the map holds, or esm-swift]
    #[arg(long, value_name = "NAME")]
    pub descriptor: Option<String>,
    /// Worker threads; the results do not depend on it [default: one a core]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Configuration; `esm-cli config` prints one with every key
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub config: Option<PathBuf>,
    /// Seed of everything random
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<u64>,
}
