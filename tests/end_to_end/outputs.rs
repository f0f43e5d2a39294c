//! What is written, and how runs end that are not let finish.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::LazyLock;

use crate::common::{Ran, TOWN, esm, folder, lasting_folder, names, program};

#[test]
fn located_poses_are_written_as_tum() {
    let town = &*TOWN;
    let dir = folder();
    let poses = dir.path().join("poses.tum");
    let ran = esm!["localize", "--json", "--map", town.path("map.esm"), town.path("live.mcap"), "-o", poses]
        .ended(0);
    let located: Vec<_> = ran.json().into_iter().filter(|l| l["verdict"] == "located").collect();
    let written = esm_io::read_tum(&poses).unwrap();
    assert_eq!(written.len(), located.len());
    for (pose, line) in written.iter().zip(&located) {
        assert_eq!(pose.stamp(), line["stamp"].as_f64().unwrap());
        assert!((pose.pose.translation.x - line["pose"]["t"][0].as_f64().unwrap()).abs() < 1e-8);
        assert!((pose.pose.rotation.i - line["pose"]["q"][0].as_f64().unwrap()).abs() < 1e-8);
    }
    assert_eq!(names(dir.path()), ["poses.tum"]);
}

#[test]
fn located_poses_are_written_as_mcap() {
    let town = &*TOWN;
    let dir = folder();
    let poses = dir.path().join("poses.mcap");
    let ran = esm!["localize", "--json", "--map", town.path("map.esm"), town.path("live.mcap"), "-o", poses]
        .ended(0);
    let bytes = fs::read(&poses).unwrap();
    let messages: Vec<_> = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).collect();
    assert_eq!(messages.len() as u64, ran.summary()["located"].as_u64().unwrap());
    let schema = messages[0].channel.schema.as_ref().unwrap();
    assert_eq!(schema.name, "geometry_msgs/msg/PoseWithCovarianceStamped");
    let first = ran.json().into_iter().find(|l| l["verdict"] == "located").unwrap();
    assert_eq!(messages[0].log_time as f64 * 1e-9, first["stamp"].as_f64().unwrap());
    assert_eq!(names(dir.path()), ["poses.mcap"]);
}

#[test]
fn the_picture_shows_every_cloud() {
    let town = &*TOWN;
    let dir = folder();
    let run = |name: &str| {
        let plot = dir.path().join(name);
        let ran = esm![
            "localize",
            "--json",
            "--map",
            town.path("map.esm"),
            town.path("live.mcap"),
            "--truth",
            town.path("live_truth.tum"),
            "--plot",
            plot
        ];
        (ran.ended(0).summary(), fs::read(plot).unwrap())
    };
    let (summary, svg) = run("run.svg");
    let svg = String::from_utf8(svg).unwrap();
    assert!(svg.starts_with("<svg"));
    let located = format!("located ({})", summary["located"]);
    for words in ["live.mcap in map.esm", &located, "0 false", "mapped path", "x in the map [m]"] {
        assert!(svg.contains(words), "'{words}' is missing");
    }
    let markers = svg.matches("fill=\"#009e73\"").count();
    assert_eq!(
        markers as u64,
        summary["located"].as_u64().unwrap() + 1,
        "one for each cloud and one in the legend"
    );
    let (_, png) = run("run.png");
    assert_eq!(&png[..8], b"\x89PNG\r\n\x1a\n");
    let width = u32::from_be_bytes(png[16..20].try_into().unwrap());
    let height = u32::from_be_bytes(png[20..24].try_into().unwrap());
    assert_eq!(width, 1600);
    assert!((700..2000).contains(&height), "{height}");
    assert!(png.len() > 50_000, "there is something in it");
}

#[test]
fn outputs_that_cannot_be_written_are_refused_before_the_work() {
    let town = &*TOWN;
    let dir = folder();
    let (map, live) = (town.path("map.esm"), town.path("live.mcap"));
    fs::write(dir.path().join("file"), "").unwrap();
    for (flag, path, words) in [
        ("-o", "poses.txt", "end the name in .tum or .mcap"),
        ("-o", "none/poses.tum", "create the directory"),
        ("-o", "file/poses.tum", "cannot be written"),
        ("--plot", "plot.jpg", "end the name in .png or .svg"),
        ("--plot", "none/plot.png", "create the directory"),
    ] {
        let path = dir.path().join(path);
        let ran = esm!["localize", "--map", map, live, flag, path];
        assert_eq!(ran.stdout, "", "nothing was done yet");
        ran.failed(&[words, &path.display().to_string()]);
    }
    esm!["map", "build", town.path("map.mcap"), "-o", dir.path().join("map.txt")]
        .failed(&["end the name in .esm"]);
    esm!["map", "build", town.path("map.mcap"), "-o", dir.path()].failed(&["extension"]);
    esm!["loops", town.path("map.mcap"), "-o", dir.path().join("graph.txt")]
        .failed(&["end the name in .g2o"]);
    esm!["man", "-o", dir.path().join("none")].failed(&["not a directory"]);
    assert_eq!(names(dir.path()), ["file"]);
}

#[cfg(target_os = "linux")]
#[test]
fn places_without_files_are_told_apart_from_missing_ones() {
    let town = &*TOWN;
    let (map, live) = (town.path("map.esm"), town.path("live.mcap"));
    esm!["localize", "--map", map, live, "-o", "/proc/x.tum"]
        .failed(&["error: /proc/x.tum: it cannot be written", "hint: no files can be created in /proc"]);
    let dir = folder();
    let gone = "rmdir \"$3\" && exec \"$0\" localize --map \"$1\" \"$2\" -o x.tum";
    let mut shell = Command::new("sh");
    let inside = dir.path().join("inside");
    fs::create_dir(&inside).unwrap();
    shell.args(["-c", gone]).arg(program().get_program()).args([&map, &live, &inside]);
    let output = shell.current_dir(&inside).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(stderr.contains("hint: the working directory is gone"), "{stderr}");
}

/// Files may not be larger than a block here, which is what a full disk is like.
#[cfg(unix)]
#[test]
fn what_cannot_be_written_to_its_end_is_told_with_its_name() {
    let town = &*TOWN;
    let dir = folder();
    let limited = |blocks: usize, arguments: &[&std::ffi::OsStr]| {
        let limit = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
        let mut shell = Command::new("sh");
        let output =
            shell.args(["-c", &limit]).arg(program().get_program()).args(arguments).output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        Ran {
            code: output.status.code().unwrap_or(-1),
            stdout: text(output.stdout),
            stderr: text(output.stderr),
        }
    };
    // Nobody typed the temporary name.
    let unnamed = |ran: &Ran| !ran.stderr.contains(" at path ");
    let path = |name: &str| dir.path().join(name);
    let (map, live) = (town.path("map.esm"), town.path("live.mcap"));
    let localize = ["localize".as_ref(), "--map".as_ref(), map.as_os_str(), live.as_os_str()];
    for (name, flag) in [("x.tum", "-o"), ("x.mcap", "-o"), ("x.png", "--plot"), ("x.svg", "--plot")] {
        let target = path(name);
        let mut arguments = localize.to_vec();
        arguments.extend([flag.as_ref(), target.as_os_str()]);
        let ran = limited(1, &arguments);
        assert!(unnamed(&ran), "{}", ran.stderr);
        ran.failed(&[&format!("error: {}: ", target.display())]);
    }
    let ran = limited(
        64,
        &[
            "map".as_ref(),
            "build".as_ref(),
            town.path("map.mcap").as_os_str(),
            "-o".as_ref(),
            path("x.esm").as_os_str(),
        ],
    );
    assert!(unnamed(&ran), "{}", ran.stderr);
    ran.failed(&[&format!("error: {}: ", path("x.esm").display())]);
    limited(0, &["man".as_ref(), "-o".as_ref(), dir.path().as_os_str()]).failed(&[".1: writing it: "]);
    assert_eq!(names(dir.path()), [""; 0], "nothing is left behind");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_under_stdout_is_told() {
    let full = fs::File::options().write(true).open("/dev/full").unwrap();
    let output = program().arg("config").stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(stderr.starts_with("error: writing to stdout: "), "{stderr}");
    assert!(stderr.ends_with("\nhint: free space or choose another place\n"), "{stderr}");
}

#[test]
fn inputs_are_never_overwritten() {
    let town = &*TOWN;
    let dir = folder();
    let (map, live) = (dir.path().join("map.esm"), dir.path().join("live.mcap"));
    fs::copy(town.path("map.esm"), &map).unwrap();
    fs::copy(town.path("live.mcap"), &live).unwrap();
    let before = fs::read(&live).unwrap();
    esm!["localize", "--map", map, live, "-o", live].failed(&["would be overwritten"]);
    assert!(fs::read(&live).unwrap() == before);
}

#[test]
fn a_failed_build_leaves_the_old_map() {
    let town = &*TOWN;
    let dir = folder();
    let map = dir.path().join("map.esm");
    fs::copy(town.path("map.esm"), &map).unwrap();
    let stump = dir.path().join("stump.mcap");
    fs::write(&stump, &fs::read(town.path("map.mcap")).unwrap()[..2000]).unwrap();
    esm!["map", "build", stump, "-o", map].failed(&["stump.mcap"]);
    assert!(fs::read(&map).unwrap() == fs::read(town.path("map.esm")).unwrap());
    assert_eq!(names(dir.path()), ["map.esm", "stump.mcap"]);
}

#[test]
fn the_table_is_for_people() {
    let town = &*TOWN;
    let ran = esm![
        "localize",
        "--map",
        town.path("map.esm"),
        town.path("live.mcap"),
        "--truth",
        town.path("live_truth.tum")
    ]
    .ended(0);
    let lines: Vec<&str> = ran.stdout.lines().collect();
    assert!(lines[0].trim_start().starts_with("stamp [s] verdict"), "{}", lines[0]);
    assert_eq!(lines[1..].iter().take_while(|l| !l.is_empty()).count(), town.live_drive.len());
    for words in ["recall ", "false 0", "median error ", "segmentation", "total", "peak memory ", "p95"] {
        assert!(ran.stdout.contains(words), "'{words}' is missing in\n{}", ran.stdout);
    }
    assert_eq!(ran.stderr, "", "nothing to warn of, and no bars where nobody sees them");
}

#[test]
fn twice_verbose_tells_the_stages_of_every_cloud() {
    let town = &*TOWN;
    let run = |flag: &str| {
        let (map, live) = (town.path("map.esm"), town.path("live.mcap"));
        esm!["localize", flag, "--map", map, live, "--frames", "1-3"].stderr
    };
    assert!(!run("-v").contains("debug: "));
    let stderr = run("-vv");
    let lines: Vec<&str> = stderr.lines().filter(|l| l.starts_with("debug: 500")).collect();
    assert_eq!(lines.len(), 3, "{stderr}");
    assert!(lines.iter().all(|l| l.contains(": accumulation ") && l.contains(", total ")), "{stderr}");
}

#[test]
fn an_error_before_the_first_row_stands_alone() {
    let dir = folder();
    let path = dir.path().join("stump.mcap");
    fs::write(&path, &fs::read(TOWN.path("live.mcap")).unwrap()[..2000]).unwrap();
    let ran = esm!["localize", "--map", TOWN.path("map.esm"), path];
    assert_eq!(ran.stdout, "");
    ran.failed(&["stump.mcap"]);
}

/// The live drive under many names: no input may be given twice.
static MANY: LazyLock<Vec<PathBuf>> = LazyLock::new(|| {
    let dir = lasting_folder("many");
    let link = |i: usize| {
        let path = dir.join(format!("{i}.mcap"));
        fs::hard_link(TOWN.path("live.mcap"), &path).expect("a second name of live.mcap");
        path
    };
    (0..40).map(link).collect()
});

/// Starts a run that takes a while and waits for its first line.
fn start(extra: &[&std::ffi::OsStr]) -> (std::process::Child, BufReader<std::process::ChildStdout>) {
    let town = &*TOWN;
    let mut command = program();
    command.args(["localize", "--json", "--map"]).arg(town.path("map.esm"));
    command.args(&*MANY).args(extra);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap());
    let mut first = String::new();
    lines.read_line(&mut first).unwrap();
    assert!(first.starts_with("{\"stamp\":5000.0"), "{first}");
    (child, lines)
}

#[test]
fn a_reader_that_leaves_is_no_error() {
    let (child, lines) = start(&[]);
    drop(lines);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_leaves_nothing_half_written() {
    for (name, signal) in [("poses.tum", "INT"), ("poses.mcap", "TERM")] {
        let dir = folder();
        let path = dir.path().join(name);
        let (child, lines) = start(&["-o".as_ref(), path.as_os_str()]);
        let kill =
            Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status().unwrap();
        assert!(kill.success());
        drop(lines);
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(names(dir.path()), [""; 0], "{name}");
    }
}
