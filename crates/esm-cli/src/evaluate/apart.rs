//! Trials in processes of their own: the memory that is measured there is what localizing takes, not what mapping has left behind.

use std::io::{self, Read};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use esm_eval::{Error, Job, Options};

use crate::args::EvaluateArgs;
use crate::{console, signals};

/// Between two looks at whether it is done.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Runs jobs of a plan by calling this very program.
pub(super) fn runner<'a>(
    args: &'a EvaluateArgs,
    options: &'a Options,
) -> impl Fn(&Job<'_>, &mut dyn FnMut() -> bool) -> Result<(), Error> + 'a {
    move |job, goes_on| {
        let mut child =
            start(args, options, job).map_err(|e| failed(format!("starting a process: {e}"), None))?;
        let mut pipe = child.stderr.take();
        // Read beside the waiting: a full pipe would stop the process.
        let said = std::thread::spawn(move || {
            let mut text = String::new();
            if let Some(pipe) = &mut pipe {
                // What cannot be read is not said.
                let _ = pipe.read_to_string(&mut text);
            }
            text
        });
        let status = wait(&mut child, goes_on)?;
        let said = said.join().unwrap_or_default();
        said.lines().filter(|l| l.starts_with("warning: ")).for_each(console::say);
        match status.code() {
            Some(0) => Ok(()),
            Some(code) if code == i32::from(signals::CODE_INTERRUPTED) => Err(Error::Interrupted),
            _ => {
                let error = said.lines().find_map(|l| l.strip_prefix("error: "));
                let what = error.map_or_else(|| format!("a process has ended with {status}"), str::to_owned);
                Err(failed(what, said.lines().find_map(|l| l.strip_prefix("hint: "))))
            }
        }
    }
}

fn start(args: &EvaluateArgs, options: &Options, job: &Job<'_>) -> io::Result<Child> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["evaluate"]).arg(&args.plan).arg("--output").arg(&args.output);
    command.arg("--work").arg::<&Path>(&options.work);
    command.arg(format!("--dataset={}", job.dataset)).arg(format!("--mode={}", job.mode));
    command.arg(format!("--method={}", job.method));
    command.arg(format!("--alone={}", job.seed.map_or_else(|| "-".to_owned(), |seed| seed.to_string())));
    command.args(args.threads.map(|n| format!("--threads={n}")));
    command.args(args.reuse_older.then_some("--reuse-older"));
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()
}

/// Waits until it has ended, or ends it where that is asked for.
fn wait(child: &mut Child, goes_on: &mut dyn FnMut() -> bool) -> Result<ExitStatus, Error> {
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return Ok(status),
            Ok(None) if goes_on() => std::thread::sleep(LOOK_EVERY),
            Ok(None) => {
                // It may have ended meanwhile; what it has not finished is not there.
                let _ = child.kill();
                let _ = child.wait();
                return Err(Error::Interrupted);
            }
            Err(e) => return Err(failed(format!("waiting for a process: {e}"), None)),
        }
    }
}

fn failed(what: String, hint: Option<&str>) -> Error {
    let hint = hint.unwrap_or("the same command goes on where it was").to_owned();
    Error::Apart { what, hint }
}
