//! The program under test: `esm-cli`, as `cargo test` has just built it.

use std::process::ExitCode;

fn main() -> ExitCode {
    esm_cli::main(std::env::args_os())
}
