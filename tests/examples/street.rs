//! Writes the end-to-end tests' synthetic street into a directory, to try the command line without any recording:
//! `map.mcap` and `live.mcap` (two drives, each with an odometry of its own) and their true poses as TUM.

use std::path::PathBuf;
use std::process::ExitCode;

use esm_core::Pose;
use esm_tests::recording::{write_drive, write_truth};
use esm_tests::street::Street;
use nalgebra::Vector3;

fn main() -> ExitCode {
    let Some(dir) = std::env::args_os().nth(1).map(PathBuf::from) else {
        return fail("usage: street DIR");
    };
    let street = Street::new(7);
    let drives = [("map", street.drive(300.0, 0.4, 1000.0, 1), Pose::identity()), {
        let elsewhere = Pose::new(Vector3::new(-310.0, 42.0, 3.0), Vector3::z() * 2.2);
        ("live", street.drive(210.0, 1.6, 5000.0, 2), elsewhere)
    }];
    for (name, drive, pose_world_odom) in &drives {
        let written = std::fs::create_dir_all(&dir)
            .and_then(|()| write_drive(&dir.join(format!("{name}.mcap")), drive, Some(pose_world_odom)))
            .and_then(|()| write_truth(&dir.join(format!("{name}_truth.tum")), drive));
        if let Err(error) = written {
            return fail(&format!("{}: {error}", dir.display()));
        }
    }
    ExitCode::SUCCESS
}

#[allow(clippy::print_stderr)] // An example without the program's console.
fn fail(words: &str) -> ExitCode {
    eprintln!("{words}");
    ExitCode::from(2)
}
