//! What people read while it runs: logs and progress bars, both on stderr and never in each other's way.

use std::io::{self, Write};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::fmt::MakeWriter;
use tracing_subscriber::fmt::format::Writer;

static BARS: LazyLock<MultiProgress> = LazyLock::new(MultiProgress::new);
static QUIET: AtomicBool = AtomicBool::new(false);

/// How log lines look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Style {
    /// For people.
    #[default]
    Text,
    /// One JSON object a line, with its time.
    Json,
}

/// Sets up logging; `verbosity` as [`Cli::verbosity`](crate::args::Cli::verbosity) gives it. Later calls do nothing.
pub fn init(verbosity: i8, style: Style) {
    QUIET.store(verbosity < 0, Ordering::Relaxed);
    let level = match verbosity {
        ..0 => LevelFilter::ERROR,
        0 => LevelFilter::WARN,
        1 => LevelFilter::INFO,
        2.. => LevelFilter::DEBUG,
    };
    let subscriber = tracing_subscriber::fmt().with_max_level(level).with_writer(AboveBars).with_ansi(false);
    // Fails only where a subscriber is set already, as in tests that call the program twice in one process.
    let _ = match style {
        Style::Text => tracing::subscriber::set_global_default(subscriber.event_format(Plain).finish()),
        Style::Json => tracing::subscriber::set_global_default(
            subscriber.json().flatten_event(true).with_current_span(false).with_span_list(false).finish(),
        ),
    };
}

/// Prints a line on stderr, above the bars.
pub fn say(line: &str) {
    BARS.suspend(|| {
        // A closed stderr leaves nobody to tell.
        let _ = writeln!(io::stderr(), "{line}");
    });
}

/// Runs something that writes to a terminal, with the bars out of the way.
pub fn without_bars<R>(write: impl FnOnce() -> R) -> R {
    BARS.suspend(write)
}

/// A bar that counts to `length`, or a spinner where that is not known. Hidden where stderr is no terminal.
pub fn bar(what: &'static str, length: Option<u64>) -> ProgressBar {
    if QUIET.load(Ordering::Relaxed) {
        return ProgressBar::hidden();
    }
    let (bar, template) = match length {
        Some(length) => {
            (ProgressBar::new(length), "{msg} {wide_bar:.cyan/dim} {percent:>3} % {elapsed} (eta {eta})")
        }
        None => (ProgressBar::new_spinner(), "{spinner} {msg} {pos} {elapsed}"),
    };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    let bar = BARS.add(bar.with_message(what));
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// Lines such as `warning: ...`, as compilers print them.
struct Plain;

impl<S, N> tracing_subscriber::fmt::FormatEvent<S, N> for Plain
where
    S: tracing::Subscriber + for<'a> tracing_subscriber::registry::LookupSpan<'a>,
    N: for<'a> tracing_subscriber::fmt::FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &tracing_subscriber::fmt::FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &tracing::Event<'_>,
    ) -> std::fmt::Result {
        let word = match *event.metadata().level() {
            tracing::Level::ERROR => "error: ",
            tracing::Level::WARN => "warning: ",
            tracing::Level::INFO => "",
            _ => "debug: ",
        };
        writer.write_str(word)?;
        context.field_format().format_fields(writer.by_ref(), event)?;
        writeln!(writer)
    }
}

struct AboveBars;

impl<'a> MakeWriter<'a> for AboveBars {
    type Writer = Line;

    fn make_writer(&'a self) -> Line {
        Line(Vec::new())
    }
}

/// Gathers one event and prints it whole.
struct Line(Vec<u8>);

impl Write for Line {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        if !self.0.is_empty() {
            say(String::from_utf8_lossy(&self.0).trim_end());
        }
    }
}
