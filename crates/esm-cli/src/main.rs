//! `esm-cli`: find a robot in a prior map from LiDAR recordings.

use std::process::ExitCode;

fn main() -> ExitCode {
    esm_cli::main(std::env::args_os())
}
