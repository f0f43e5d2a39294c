//! Simulated worlds: recorded, mapped, found again; interrupted and resumed.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::common::{esm, folder, names, program};

const COMPLETE: [&str; 5] = ["live.mcap", "live_truth.tum", "map.mcap", "map_truth.tum", "preset.toml"];

#[test]
fn recordings_are_the_same_bytes_with_any_number_of_threads() {
    let dir = folder();
    let [one, two] = ["1", "2"].map(|threads| {
        let out = dir.path().join(threads);
        let ran = esm![
            "simulate",
            "train-forest",
            "--seed",
            "101",
            "--scale",
            "0.008",
            "--threads",
            threads,
            "-o",
            out
        ]
        .ended(0);
        assert!(ran.stdout.contains("train-forest, seed 101, scale 0.008"), "{}", ran.stdout);
        assert!(ran.stdout.contains(" M rays/s") && ran.stdout.contains(" km, "), "{}", ran.stdout);
        assert_eq!(ran.stderr, "", "no bars where nobody sees them");
        assert_eq!(names(&out), COMPLETE);
        out
    });
    for name in COMPLETE {
        assert!(fs::read(one.join(name)).unwrap() == fs::read(two.join(name)).unwrap(), "{name}");
    }
    // Once more: nothing is done. Another one there: nothing is destroyed.
    let stamp = || fs::metadata(one.join("map.mcap")).unwrap().modified().unwrap();
    let before = stamp();
    let again = |seed: &str, extra: &[&str]| {
        let mut command =
            vec!["simulate", "train-forest", "--json", "--scale", "0.008", "--seed", seed, "-o"];
        let path = one.display().to_string();
        command.push(&path);
        command.extend(extra);
        crate::common::run(command)
    };
    let report: Value = serde_json::from_str(&again("101", &[]).ended(0).stdout).unwrap();
    assert_eq!((&report["was_complete"], stamp()), (&Value::Bool(true), before));
    assert!(report["points"].as_u64().unwrap() > 100_000 && report["elapsed_s"].is_null(), "{report}");
    again("101", &["--live-changed", "0.3"])
        .failed(&["another simulation: train-forest, seed 101", "--force"]);
    again("102", &[]).failed(&["another simulation: train-forest, seed 101", "--force"]);
    assert_eq!(stamp(), before);
    let report: Value = serde_json::from_str(&again("102", &["--force"]).ended(0).stdout).unwrap();
    assert_eq!(
        (&report["was_complete"], names(&one)),
        (&Value::Bool(false), COMPLETE.map(str::to_owned).to_vec())
    );
    assert!(fs::read(one.join("map.mcap")).unwrap() != fs::read(two.join("map.mcap")).unwrap());
}

/// The demo on places of less than half the size, and what its files are good for.
#[test]
fn the_demo_finds_the_second_visit() {
    let dir = folder();
    let demo = dir.path().join("demo");
    let ran = esm!["demo", "--scale", "0.45", "-o", demo].ended(0);
    for words in
        ["place", "localizable", "median error", "segmentation", "verification", "To go on:", "demo.png"]
    {
        assert!(ran.stdout.contains(words), "'{words}' is missing in\n{}", ran.stdout);
    }
    assert_eq!(names(&demo), ["demo.png", "forest", "street"]);
    for place in ["forest", "street"] {
        let row = ran.stdout.lines().find(|l| l.starts_with(place) && !l.contains(" s "));
        let cells: Vec<&str> = row.unwrap().split_whitespace().collect();
        let count = |i: usize| cells[i].parse::<usize>().unwrap();
        // clouds, localizable, located, correct, false
        assert!(
            count(1) >= 10 && count(3) * 2 > count(1) && count(4) == count(3) && count(5) == 0,
            "{row:?}"
        );
        let file = |name: &str| demo.join(place).join(name);
        // The same as the commands that it names.
        let ran = esm![
            "localize",
            "--json",
            "--map",
            file("map.esm"),
            file("live.mcap"),
            "--truth",
            file("live_truth.tum"),
            "--config",
            file("localize.toml")
        ]
        .ended(0);
        let summary = ran.summary();
        assert_eq!(
            (&summary["located"], &summary["false"]),
            (&Value::from(count(3)), &Value::from(0)),
            "{place}"
        );
        assert!(summary["median_error_m"].as_f64().unwrap() < 0.5, "{summary}");
    }
}

#[test]
fn the_world_is_drawn() {
    let dir = folder();
    let out = dir.path().join("out");
    for name in ["world.png", "world.svg"] {
        let plot = out.join(name);
        esm!["simulate", "george-square", "--scale", "0.006", "-o", out, "--plot", plot].ended(0);
    }
    let svg = fs::read_to_string(out.join("world.svg")).unwrap();
    for words in
        ["george-square, seed 0", "LMS151", "path of the live visit", "grass", "data:image/png;base64,"]
    {
        assert!(svg.contains(words), "'{words}' is missing");
    }
    let png = fs::read(out.join("world.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 100_000, "{} bytes", png.len());
}

#[test]
fn what_cannot_be_simulated_is_told() {
    let dir = folder();
    let out = dir.path().join("out");
    let ran = esm!["simulate", "mars", "-o", out].ended(2);
    assert!(ran.stderr.contains("george-square") && ran.stderr.contains("hint: "), "{}", ran.stderr);
    for scale in ["0", "-1", "nan", "5"] {
        esm!["simulate", "kitti", "--scale", scale, "-o", out].failed(&["scale", "0.005 to 4"]);
    }
    esm!["simulate", "kitti", "-o", out, "--live-offset", "30"].failed(&["30 m beside", "-20 to 20"]);
    esm!["simulate", "kitti", "-o", out, "--live-changed", "1.5"].failed(&["share 1.5", "0 to 1"]);
    esm!["simulate", "kitti", "-o", out, "--threads", "0"].failed(&["--threads 0"]);
    esm!["simulate", "kitti", "-o", out, "--plot", out.join("x.jpg")]
        .failed(&["end the name in .png or .svg"]);
    assert!(!out.exists(), "nothing was made");
    let file = dir.path().join("file");
    fs::write(&file, "").unwrap();
    for command in ["simulate kitti", "demo"] {
        let arguments = command.split(' ').chain(["-o"]).map(str::to_owned);
        let path = file.join("sub").display().to_string();
        crate::common::run(arguments.chain([path])).failed(&["file/sub: creating the directory"]);
    }
}

/// Files may not be larger than some blocks here, which is what a full disk is like.
#[cfg(unix)]
#[test]
fn a_full_disk_is_told_and_what_there_is_can_be_gone_on_with() {
    let dir = folder();
    let mut shell = Command::new("sh");
    shell.args(["-c", "trap '' XFSZ; ulimit -f 400; exec \"$0\" \"$@\""]).arg(program().get_program());
    shell.args(["simulate", "train-forest", "--scale", "0.01", "-o"]).arg(dir.path());
    let output = shell.output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.starts_with("error: ") && stderr.contains("map.mcap: writing: "), "{stderr}");
    assert!(stderr.contains("\nhint: ") && !stderr.contains(".part"), "{stderr}");
    assert_eq!(names(dir.path()), [".map.mcap.part", "unfinished.toml"]);
    esm!["simulate", "train-forest", "--scale", "0.01", "-o", dir.path()].ended(0);
    assert_eq!(names(dir.path()), COMPLETE);
}

#[cfg(unix)]
#[test]
fn an_interrupted_simulation_goes_on_where_it_was() {
    let dir = folder();
    let [whole, torn] = ["whole", "torn"].map(|n| dir.path().join(n));
    let simulate = |out: &Path| {
        let mut command = program();
        command.args(["simulate", "train-forest", "--scale", "0.03", "--json", "-o"]).arg(out);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    };
    let mut child = simulate(&torn).spawn().unwrap();
    let started = Instant::now();
    // The first batch is in the file.
    let written = || fs::metadata(torn.join(".map.mcap.part")).map_or(0, |m| m.len());
    while written() < 1000 && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(child.try_wait().unwrap().is_none());
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{stderr}");
    assert_eq!(stderr, "interrupted\nhint: the same command goes on where it was\n");
    assert!(names(&torn).contains(&"unfinished.toml".to_owned()));
    let output = simulate(&torn).output().unwrap();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(report["sweeps_kept"].as_u64().unwrap() > 0, "{report}");
    assert!(simulate(&whole).output().unwrap().status.success());
    for name in COMPLETE {
        assert!(fs::read(whole.join(name)).unwrap() == fs::read(torn.join(name)).unwrap(), "{name}");
    }
    assert_eq!(names(&torn), COMPLETE);
}

/// What no simulation has made is not replaced; what is cut is made again; what is begun is not thrown away.
#[test]
fn nothing_is_lost_and_nothing_torn_is_called_complete() {
    let dir = folder();
    let simulate = |seed: &str, out: &Path, extra: &[&str]| {
        let out = out.display().to_string();
        let mut command = vec!["simulate", "train-forest", "--scale", "0.008", "--seed", seed, "-o", &out];
        command.extend(extra);
        crate::common::run(command)
    };
    let mine = dir.path().join("mine");
    fs::create_dir(&mine).unwrap();
    fs::write(mine.join("map.mcap"), "precious").unwrap();
    simulate("101", &mine, &[]).failed(&["map.mcap", "no simulation has made it", "--force"]);
    assert_eq!(fs::read(mine.join("map.mcap")).unwrap(), b"precious");

    let out = dir.path().join("out");
    simulate("101", &out, &[]).ended(0);
    let whole = fs::read(out.join("live.mcap")).unwrap();
    fs::write(out.join("live.mcap"), &whole[..1000]).unwrap();
    simulate("101", &out, &[]).ended(0);
    assert!(fs::read(out.join("live.mcap")).unwrap() == whole, "what was cut is whole again");

    fs::rename(out.join("preset.toml"), out.join("unfinished.toml")).unwrap();
    simulate("102", &out, &[]).failed(&["a part of another simulation: train-forest, seed 101", "--force"]);
    assert!(fs::read(out.join("live.mcap")).unwrap() == whole);
}
