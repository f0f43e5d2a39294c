//! How a run ends: exit codes, and errors as people read them.

use std::ffi::OsString;
use std::process::ExitCode;
use std::{fmt, io};

use clap::CommandFactory;

use crate::args::Cli;
use crate::console;
use crate::signals::{self, Interrupted};

/// How a run ended that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Exit code 0.
    Done,
    /// It ran, but localized nothing: exit code 1.
    NothingLocalized,
}

const CODE_NOTHING: u8 = 1;
const CODE_ERROR: u8 = 2;

/// An error of the command line's own, with what to do about it.
#[derive(Debug)]
pub struct Failure {
    what: String,
    hint: String,
}

impl Failure {
    /// `what` names the file or flag and the place; `hint` what to do.
    pub fn new(what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { what: what.into(), hint: hint.into() }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}\nhint: {}", self.what, self.hint)
    }
}

impl std::error::Error for Failure {}

/// The exit code of a run; an error is told on stderr first.
pub fn exit(result: anyhow::Result<Outcome>) -> ExitCode {
    match result {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::NothingLocalized) => ExitCode::from(CODE_NOTHING),
        // Whoever read our output has seen enough.
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) if error.is::<Interrupted>() => {
            // The context, where there is one, says how to go on.
            console::say(&error.to_string());
            ExitCode::from(signals::CODE_INTERRUPTED)
        }
        Err(error) => {
            console::say(&message(&error));
            ExitCode::from(CODE_ERROR)
        }
    }
}

/// The exit code after the arguments, the program's name first, were refused, or after help or version were asked for.
pub fn usage(refusal: &clap::Error, arguments: &[OsString]) -> ExitCode {
    // Nothing is left to be done about an unwritable terminal here.
    let _ = refusal.print();
    if !refusal.use_stderr() {
        return ExitCode::SUCCESS;
    }
    // Whoever gave no arguments reads the help already.
    if refusal.kind() != clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        console::say(&format!("hint: {} --help lists all there is", command_of(arguments)));
    }
    ExitCode::from(CODE_ERROR)
}

/// The subcommand that was meant, as far as it was spelled right: `esm-cli map build`.
fn command_of(arguments: &[OsString]) -> String {
    let mut command = &Cli::command();
    let mut name = command.get_name().to_owned();
    for argument in arguments.iter().skip(1) {
        match command.find_subcommand(argument) {
            Some(sub) => {
                command = sub;
                name = format!("{name} {}", sub.get_name());
            }
            // The flags before a subcommand have no values.
            None if argument.as_encoded_bytes().starts_with(b"-") => {}
            None => break,
        }
    }
    name
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| cause.is::<crate::output::StdoutClosed>())
}

/// One line `error: CONTEXT: CAUSE`, and the hints after it.
fn message(error: &anyhow::Error) -> String {
    let (mut line, mut hints) = (String::from("error"), Vec::new());
    for cause in error.chain() {
        let text = cause.to_string();
        let (what, hint) = match text.split_once("\nhint: ") {
            Some((what, hint)) => (what, Some(hint.to_owned())),
            None => (text.as_str(), None),
        };
        // Some libraries put their cause into their own text as well.
        if !line.contains(what) {
            line.push_str(": ");
            line.push_str(what);
        }
        hints.extend(hint.filter(|h| !hints.contains(h)));
    }
    if hints.is_empty()
        && let Some(hint) = error.chain().find_map(|cause| cause.downcast_ref()).map(system_hint)
    {
        hints.push(hint.to_owned());
    }
    for hint in hints {
        line.push_str("\nhint: ");
        line.push_str(&hint);
    }
    line
}

/// What to do about the system's refusals that nobody has said anything about.
fn system_hint(error: &io::Error) -> &'static str {
    use io::ErrorKind::{
        FileTooLarge, NotFound, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull,
    };
    match error.kind() {
        StorageFull | QuotaExceeded => "free space or choose another place",
        FileTooLarge => "files may not be that large there: choose another place, or raise the limit",
        PermissionDenied => "check the permissions of the file and of its directory",
        ReadOnlyFilesystem => "choose a place that can be written",
        NotFound => "check the spelling; relative paths start at the working directory",
        _ => "check the disk or the network share the file lies on",
    }
}

#[cfg(test)]
mod tests {
    use anyhow::Context;

    use super::*;

    #[test]
    fn a_message_is_one_line_and_its_hints() {
        let error = anyhow::Error::new(Failure::new("a.pcd: line 3: no FIELDS", "is it a PCD file?"));
        let error = Err::<(), _>(error).context("reading the map").unwrap_err();
        assert_eq!(
            message(&error),
            "error: reading the map: a.pcd: line 3: no FIELDS\nhint: is it a PCD file?"
        );
    }

    #[test]
    fn a_cause_that_is_told_already_is_not_told_again() {
        #[derive(Debug)]
        struct Outer(std::io::Error);
        impl fmt::Display for Outer {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "m.esm: opening it: {}", self.0)
            }
        }
        impl std::error::Error for Outer {
            fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
                Some(&self.0)
            }
        }
        let error = anyhow::Error::new(Outer(std::io::Error::other("it is gone")));
        assert_eq!(
            message(&error),
            "error: m.esm: opening it: it is gone\nhint: check the disk or the network share the file lies on"
        );
    }

    #[test]
    fn a_full_disk_has_a_hint() {
        let full = io::Error::from(io::ErrorKind::StorageFull);
        let error = anyhow::Error::new(full).context("writing to stdout");
        let message = message(&error);
        assert!(message.starts_with("error: writing to stdout: "), "{message}");
        assert!(message.ends_with("\nhint: free space or choose another place"), "{message}");
    }
}
