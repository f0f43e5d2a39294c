//! The `esm-cli` program: arguments in, results out, no algorithm of its own.
//!
//! Raw flags ([`args`]) become one checked configuration ([`settings`]); one module a subcommand does the work; data
//! goes to stdout ([`output`]), logs and bars to stderr ([`console`]). The exit codes are in [`outcome`].

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;

pub mod args;
mod build;
mod completions;
pub mod config_text;
pub mod console;
mod demo;
mod evaluate;
mod info;
pub mod inputs;
mod localize;
mod loops;
pub(crate) use esm_eval::memory;
pub mod outcome;
pub mod output;
mod plot;
mod replay;
mod segments;
mod serve;
pub mod settings;
mod signals;
mod simulate;
pub use esm_eval::truth;

use args::{Cli, Command, MapCommand};
use outcome::Outcome;

/// Runs the program on its arguments, the program's name first, and gives its exit code.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let cli = match Cli::try_parse_from(&arguments) {
        Ok(cli) => cli,
        Err(refusal) => return outcome::usage(&refusal, &arguments),
    };
    let (verbosity, style) = match &cli.command {
        // A service tells what happens without being asked.
        Command::Serve(args) => (cli.verbosity() + i8::from(cli.verbosity() >= 0), args.log),
        _ => (cli.verbosity(), console::Style::Text),
    };
    console::init(verbosity, style);
    signals::install();
    outcome::exit(run(cli.command))
}

fn run(command: Command) -> anyhow::Result<Outcome> {
    match command {
        Command::Map { command: MapCommand::Build(args) } => build::run(&args),
        Command::Map { command: MapCommand::Info(args) } => info::run(&args),
        Command::Localize(args) => localize::run(&args),
        Command::Loops(args) => loops::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        Command::Segments(args) => segments::run(&args),
        Command::Serve(args) => serve::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Config => config_text::run(),
        Command::Completions { shell } => completions::shell(shell),
        Command::Man { dir } => completions::man(dir.as_deref()),
    }
}
