//! Raw flags to one checked configuration.

use std::path::Path;

use esm_core::{Config, describe};

use crate::args::{LiveArgs, TuneArgs};
use crate::inputs::read_text;
use crate::outcome::Failure;

/// Most worker threads that can be asked for.
const MAX_THREADS: usize = 1024;
/// Most bytes of a configuration file: a complete one has a few thousand.
const MAX_CONFIG_BYTES: u64 = 1 << 20;

/// A checked configuration.
#[derive(Debug)]
pub(crate) struct Settings {
    /// All of it.
    pub(crate) config: Config,
    /// Whether the descriptor was asked for, by the flag or the file, and is not just the default.
    pub(crate) descriptor_given: bool,
}

/// The configuration file, if any, with the flags on top; checked. Also starts the worker threads.
pub(crate) fn configure(tune: &TuneArgs, live: &LiveArgs) -> anyhow::Result<Settings> {
    let (mut config, in_file) = match &tune.config {
        Some(path) => read(path)?,
        None => (Config::default(), false),
    };
    if let Some(name) = &tune.descriptor {
        describe::by_name(name).map_err(|e| match e {
            esm_core::Error::Config { .. } => Failure::new(
                format!("--descriptor {name}: there is no such descriptor"),
                format!("there are {}, and weights files (*.safetensors)", describe::NAMES.join(", ")),
            )
            .into(),
            e => anyhow::Error::from(e),
        })?;
        config.descriptor.clone_from(name);
    }
    if let Some(seed) = tune.seed {
        config.seed = seed;
    }
    if let Some(metres) = live.accumulate {
        config.accumulate.distance_m = metres;
    }
    if live.swathes {
        config.accumulate.swathes = true;
    }
    config.check().map_err(|e| {
        Failure::new(
            format!("{}: {e}", origin(tune)),
            "`esm-cli config` prints the defaults and what they mean",
        )
    })?;
    start_threads(tune.threads)?;
    Ok(Settings { config, descriptor_given: in_file || tune.descriptor.is_some() })
}

impl Settings {
    /// With what a cloud may take, where the flag was given.
    pub(crate) fn within(mut self, budget_ms: Option<f64>) -> anyhow::Result<Self> {
        if let Some(ms) = budget_ms {
            self.config.budget.ms = ms;
            self.config.check().map_err(|_| {
                let what = format!("--budget-ms {ms}: that is no time a cloud may take");
                Failure::new(what, "give milliseconds, or 0 for as long as it takes")
            })?;
        }
        Ok(self)
    }
}

/// What a bad value is to be blamed on.
fn origin(tune: &TuneArgs) -> String {
    match &tune.config {
        Some(path) => format!("{} with the flags on top", path.display()),
        None => "the flags".to_owned(),
    }
}

/// Reads a configuration, and whether it names a descriptor; keys that do not exist are refused.
fn read(path: &Path) -> anyhow::Result<(Config, bool)> {
    let hint = "`esm-cli config > FILE` writes a complete one";
    let text = read_text(path, MAX_CONFIG_BYTES, "this is larger than a configuration can be (1 MiB)", hint)?;
    let refuse = |e: toml::de::Error| {
        let line = e.span().map(|span| 1 + text[..span.start.min(text.len())].matches('\n').count());
        let place = line.map(|n| format!(":{n}")).unwrap_or_default();
        let what = e.message().trim_end().replace('\n', " ");
        Failure::new(
            format!("{}{place}: {what}", path.display()),
            "`esm-cli config` prints every key there is",
        )
    };
    let config = toml::from_str(&text).map_err(refuse)?;
    let keys: toml::Table = toml::from_str(&text).map_err(refuse)?;
    Ok((config, keys.contains_key("descriptor")))
}

/// Starts the worker threads, as many as asked for.
pub(crate) fn start_threads(threads: Option<usize>) -> anyhow::Result<()> {
    let Some(threads) = threads else { return Ok(()) };
    if !(1..=MAX_THREADS).contains(&threads) {
        let what = format!("--threads {threads}: that many cannot work");
        return Err(Failure::new(what, format!("give 1 to {MAX_THREADS}")).into());
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|e| Failure::new(format!("--threads {threads}: {e}"), "give fewer threads").into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(text: &str, tune: TuneArgs, live: LiveArgs) -> Result<Config, String> {
        all(text, tune, live).map(|s| s.config)
    }

    fn all(text: &str, tune: TuneArgs, live: LiveArgs) -> Result<Settings, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("esm.toml");
        std::fs::write(&path, text).unwrap();
        configure(&TuneArgs { config: Some(path.clone()), ..tune }, &live)
            .map_err(|e| format!("{e:#}").replace(&path.display().to_string(), "esm.toml"))
    }

    #[test]
    fn flags_win_over_the_file() {
        let text = "seed = 1\ndescriptor = \"eigen\"\n[accumulate]\ndistance_m = 5.0\nmax_range_m = 30.0\n";
        let tune = TuneArgs { seed: Some(2), ..Default::default() };
        let live = LiveArgs { accumulate: Some(9.0), swathes: true };
        let config = with(text, tune, live).unwrap();
        assert_eq!((config.seed, config.descriptor.as_str()), (2, "eigen"));
        assert_eq!((config.accumulate.distance_m, config.accumulate.max_range_m), (9.0, 30.0));
        assert!(config.accumulate.swathes);
    }

    #[test]
    fn a_descriptor_is_given_by_flag_or_key() {
        let given = |text: &str, tune: TuneArgs| {
            all(text, tune, LiveArgs::default()).map(|s| s.descriptor_given).unwrap()
        };
        assert!(!given("seed = 1\n", TuneArgs::default()));
        assert!(given("descriptor = \"shape\"\n", TuneArgs::default()));
        assert!(given("", TuneArgs { descriptor: Some("shape".into()), ..Default::default() }));
    }

    #[test]
    fn unknown_keys_are_named_with_their_line() {
        let error =
            with("seed = 1\n[accumulate]\ndistance = 5.0\n", TuneArgs::default(), LiveArgs::default());
        let error = error.unwrap_err();
        assert!(error.starts_with("esm.toml:3: unknown field `distance`, expected"), "{error}");
        assert!(error.ends_with("hint: `esm-cli config` prints every key there is"), "{error}");
    }

    #[test]
    fn values_out_of_range_are_named() {
        for (text, words) in [
            ("[accumulate]\ndistance_m = -1.0\n", "accumulate.distance_m = -1"),
            ("[accumulate]\ndistance_m = nan\n", "accumulate.distance_m = NaN"),
            ("descriptor = \"magic\"\n", "magic"),
            ("seed = \"x\"\n", "esm.toml:1: invalid type"),
            ("seed = \n", "esm.toml:1: "),
        ] {
            let error = with(text, TuneArgs::default(), LiveArgs::default()).unwrap_err();
            assert!(error.contains(words), "{error}");
        }
        let tune = TuneArgs { descriptor: Some("magic".into()), ..Default::default() };
        let error = configure(&tune, &LiveArgs::default()).unwrap_err().to_string();
        assert_eq!(
            error,
            "--descriptor magic: there is no such descriptor\nhint: there are esm-swift, esm, esm-paper, shape, eigen, esf, gestalt, and weights files (*.safetensors)"
        );
        let tune = TuneArgs { threads: Some(0), ..Default::default() };
        assert!(configure(&tune, &LiveArgs::default()).unwrap_err().to_string().starts_with("--threads 0"));
    }
}
