//! `esm-cli completions` and `esm-cli man`.

use std::path::Path;

use clap::CommandFactory;
use clap_complete::Shell;

use crate::args::Cli;
use crate::outcome::{Failure, Outcome};
use crate::output::{self, Target};

pub(crate) fn shell(shell: Shell) -> anyhow::Result<Outcome> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "esm-cli", &mut text);
    output::data(&text)?;
    Ok(Outcome::Done)
}

/// The main page on stdout, or a page for every command into a directory.
pub(crate) fn man(dir: Option<&Path>) -> anyhow::Result<Outcome> {
    let mut command = Cli::command();
    command.build();
    let Some(dir) = dir else {
        output::data(&page(command)?)?;
        return Ok(Outcome::Done);
    };
    if !dir.is_dir() {
        let what = format!("{}: this is not a directory", dir.display());
        return Err(Failure::new(what, "create it first").into());
    }
    let mut commands = vec![command];
    while let Some(command) = commands.pop() {
        // `esm-cli help` repeats what the pages say.
        commands.extend(command.get_subcommands().filter(|c| c.get_name() != "help").cloned());
        let name = command.get_display_name().unwrap_or_else(|| command.get_name()).to_owned();
        let mut target = Target::create(&dir.join(format!("{name}.1")))?;
        std::io::Write::write_all(&mut target, &page(command)?)?;
        target.finish()?;
    }
    Ok(Outcome::Done)
}

fn page(command: clap::Command) -> anyhow::Result<Vec<u8>> {
    let mut text = Vec::new();
    let name = command.get_display_name().unwrap_or_else(|| command.get_name()).to_owned();
    // Only the main command has a version of its own.
    let source = concat!("esm-cli ", env!("CARGO_PKG_VERSION"));
    clap_mangen::Man::new(command).title(name).source(source).manual("esm-cli manual").render(&mut text)?;
    Ok(text)
}
