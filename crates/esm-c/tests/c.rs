//! The library as a C program meets it: the header, the example, a torn and a hostile caller.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;
use std::thread;

use esm_core::{Accumulator, Config, Localizer, Map, MapBuilder, PointCloud, Pose, SequenceLocalizer};
use esm_core::{Verdict, transform_point};

const HERE: &str = env!("CARGO_MANIFEST_DIR");

/// Boxes of different sizes on a plain.
fn site() -> Vec<[f32; 3]> {
    let mut state = 7u32;
    let mut random = move |most: f32| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1u32 << 24) as f32 * most
    };
    let mut site = Vec::new();
    for b in 0..30 {
        let x = (b % 6) as f32 * 12.0 - 20.0 + random(5.0);
        let y = (b / 6) as f32 * 12.0 - 24.0 + random(5.0);
        let size = [1.0 + random(3.0), 1.0 + random(3.0), 1.0 + random(2.0)].map(|s| (s / 0.2) as i32);
        for i in 0..=size[0] {
            for j in 0..=size[1] {
                for k in 0..=size[2] {
                    if i == 0 || j == 0 || i == size[0] || j == size[1] {
                        site.push([x + i as f32 * 0.2, y + j as f32 * 0.2, k as f32 * 0.2]);
                    }
                }
            }
        }
    }
    site.extend((-120..120).flat_map(|i| (-120..120).map(move |j| [i as f32 * 0.4, j as f32 * 0.4, 0.0])));
    site
}

fn sweep_at(site: &[[f32; 3]], pose_map_sensor: &Pose) -> PointCloud {
    let to_sensor = pose_map_sensor.inverse();
    PointCloud::try_new(site.iter().map(|p| transform_point(&to_sensor, *p)).collect()).unwrap()
}

fn map_file(site: &[[f32; 3]], config: &Config, folder: &Path) -> PathBuf {
    let mut builder = MapBuilder::new(config).unwrap();
    for step in 0..4 {
        let pose_map_sensor = Pose::translation(f64::from(step) * 2.0, 0.0, 1.7);
        builder.push_sweep(f64::from(step), &sweep_at(site, &pose_map_sensor), &pose_map_sensor).unwrap();
    }
    let file = folder.join("site.esm");
    builder.finish().unwrap().write(&file).unwrap();
    file
}

/// Where cargo has put libesm.a: beside this test.
fn library() -> PathBuf {
    let file = std::env::current_exe().unwrap().with_file_name("libesm.a");
    assert!(file.exists(), "{}", file.display());
    file
}

fn compiled(source: &Path, folder: &Path) -> PathBuf {
    let program = folder.join(source.file_stem().unwrap());
    let done = Command::new("cc")
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-O1", "-I"])
        .arg(Path::new(HERE).join("include"))
        .arg(source)
        .arg(library())
        .args(["-lpthread", "-ldl", "-lm", "-o"])
        .arg(&program)
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    program
}

/// A sweep as the example reads it.
fn bytes(stamp: f64, pose_odom_sensor: &Pose, points: &[[f32; 3]]) -> Vec<u8> {
    let mut out = stamp.to_ne_bytes().to_vec();
    let pose = pose_odom_sensor.translation.vector.iter().chain(pose_odom_sensor.rotation.coords.iter());
    pose.for_each(|v| out.extend(v.to_ne_bytes()));
    out.extend((points.len() as u64).to_ne_bytes());
    points.iter().flatten().for_each(|v| out.extend(v.to_ne_bytes()));
    out
}

fn run(program: &Path, arguments: &[&Path], input: Vec<u8>) -> Output {
    let mut child = Command::new(program)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    // A program that refuses early does not read on: that is not this side's failure.
    let writer = thread::spawn(move || drop(std::io::Write::write_all(&mut stdin, &input)));
    let done = child.wait_with_output().unwrap();
    writer.join().unwrap();
    done
}

#[test]
fn the_header_is_what_cbindgen_makes() {
    let file = Path::new(HERE).join("include/esm.h");
    let config = cbindgen::Config::from_file(Path::new(HERE).join("cbindgen.toml")).unwrap();
    let mut made = Vec::new();
    let sources = cbindgen::Builder::new().with_config(config).with_src(Path::new(HERE).join("src/ffi.rs"));
    sources.generate().unwrap().write(&mut made);
    let made = String::from_utf8(made).unwrap();
    if std::env::var_os("ESM_UPDATE").is_some() {
        std::fs::write(&file, &made).unwrap();
    }
    let kept = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(kept == made, "include/esm.h is out of date\nhint: ESM_UPDATE=1 cargo test -p esm-c");
}

#[test]
fn a_robot_in_c_answers_as_the_core_does() {
    let folder = tempfile::tempdir().unwrap();
    let (site, config) = (site(), Config::default());
    let map = map_file(&site, &config, folder.path());
    let program = compiled(&Path::new(HERE).join("examples/robot.c"), folder.path());

    // The odometry's frame is another than the map's; the last sweep has points that are none.
    let pose_map_odom = Pose::new([5.0, -3.0, 0.0].into(), [0.0, 0.0, 2.0].into());
    let mut accumulator = Accumulator::new(config.accumulate.clone()).unwrap();
    let localizer = Localizer::new(Arc::new(Map::open(&map).unwrap()), &config).unwrap();
    let mut robot = SequenceLocalizer::new(localizer);
    let (mut input, mut want) = (Vec::new(), Vec::new());
    for step in 0..4 {
        let pose_odom_sensor = Pose::translation(f64::from(step), 0.2, 1.7);
        let mut points = sweep_at(&site, &(pose_map_odom * pose_odom_sensor)).into_points();
        let stamp = 100.0 + f64::from(step);
        let live =
            accumulator.push(stamp, &PointCloud::try_new(points.clone()).unwrap(), Some(pose_odom_sensor));
        let answer = robot.localize(&live.unwrap()).unwrap();
        assert_eq!(answer.verdict, Verdict::Located);
        want.push((stamp, answer));
        if step == 3 {
            points.insert(5, [f32::NAN, 0.0, 0.0]);
        }
        input.extend(bytes(stamp, &pose_odom_sensor, &points));
    }
    let done = run(&program, &[&map], input);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let lines: Vec<String> = String::from_utf8(done.stdout).unwrap().lines().map(str::to_owned).collect();
    assert_eq!(lines.len(), want.len());
    for (line, (stamp, answer)) in lines.iter().zip(&want) {
        let words: Vec<&str> = line.split(' ').collect();
        assert_eq!(words[0].parse::<f64>().unwrap(), *stamp);
        assert_eq!(words[1], "located");
        let pose = answer.pose_map_sensor.unwrap();
        let numbers: Vec<f64> = words[2..9].iter().map(|w| w.parse().unwrap()).collect();
        let same: Vec<f64> =
            pose.translation.vector.iter().chain(pose.rotation.coords.iter()).copied().collect();
        assert_eq!(numbers, same, "the same bits");
        assert_eq!(words[9].parse::<usize>().unwrap(), answer.inliers);
    }
}

#[test]
fn what_cannot_be_is_refused_with_words() {
    let folder = tempfile::tempdir().unwrap();
    let map = map_file(&site(), &Config::default(), folder.path());
    let program = compiled(&Path::new(HERE).join("examples/robot.c"), folder.path());
    let settings = |text: &str| {
        let file = folder.path().join(format!("settings-{}.toml", text.len()));
        std::fs::write(&file, text).unwrap();
        file
    };
    let damaged = folder.path().join("damaged.esm");
    std::fs::write(&damaged, &std::fs::read(&map).unwrap()[..1000]).unwrap();
    let here = Pose::identity();
    let crooked = {
        let mut sweep = bytes(1.0, &here, &[[1.0, 2.0, 3.0]]);
        sweep[56..64].copy_from_slice(&7.0f64.to_ne_bytes());
        sweep
    };
    for (arguments, input, words) in [
        (vec![PathBuf::from("/no/such.esm")], Vec::new(), "/no/such.esm"),
        (vec![damaged], Vec::new(), "damaged.esm"),
        (vec![map.clone(), settings("accumulate = 3\n")], Vec::new(), "settings"),
        (vec![map.clone(), settings("descriptor = \"eigen\"\n")], Vec::new(), "eigen"),
        (vec![map.clone()], bytes(f64::NAN, &here, &[[1.0, 2.0, 3.0]]), "stamp is NaN"),
        (vec![map.clone()], crooked, "unit quaternion"),
        (vec![map.clone()], bytes(1.0, &here, &[[1.0; 3]; 9])[..100].to_vec(), "torn"),
    ] {
        let arguments: Vec<PathBuf> = arguments;
        let done = run(&program, &arguments.iter().map(PathBuf::as_path).collect::<Vec<_>>(), input);
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(2), "{said}");
        assert!(said.contains(words), "{words}: {said}");
    }
    // A cloud of nothing is an answer, not an error.
    let done = run(&program, &[&map], bytes(1.0, &here, &[]));
    assert_eq!(done.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&done.stdout).contains("not_found"));
}

#[test]
fn a_hostile_caller_harms_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let map = map_file(&site(), &Config::default(), folder.path());
    let program = compiled(&Path::new(HERE).join("tests/hostile.c"), folder.path());
    let done = run(&program, &[&map], Vec::new());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert_eq!(String::from_utf8_lossy(&done.stdout), "one thread\nall refused\n");
}
