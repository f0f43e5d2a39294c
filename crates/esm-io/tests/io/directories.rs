//! Directories of scans, single scans, and what an input is.

use std::path::Path;

use esm_io::{InputKind, OpenOptions, Recording, classify};
use tempfile::TempDir;

use crate::bytes_mcap::Mcap;
use crate::support::{TestFile, read_all};

/// A directory of ascii PCD files with one point each, whose x tells the order they were given in.
fn scans(names: &[&str]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (x, name) in names.iter().enumerate() {
        std::fs::write(dir.path().join(name), pcd(&format!("{} 0 0\n", x + 1), 1)).unwrap();
    }
    dir
}

fn pcd(body: &str, points: usize) -> String {
    format!(
        "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {points}\nHEIGHT 1\nPOINTS {points}\nDATA ascii\n{body}"
    )
}

fn with_poses(dir: &Path, name: &str, text: &str) -> OpenOptions {
    let path = dir.join(name);
    std::fs::write(&path, text).unwrap();
    OpenOptions { poses: Some(path), ..OpenOptions::default() }
}

/// What came: the x of each first point, the stamps, and the x of the poses.
fn order(dir: &Path, options: &OpenOptions) -> (Vec<f32>, Vec<f64>, Vec<Option<f64>>) {
    let all = read_all(dir, options);
    assert_eq!(all.error, None);
    let sweeps = all.sweeps.iter();
    assert!(sweeps.clone().enumerate().all(|(i, s)| s.number == i + 1));
    (
        sweeps.clone().map(|s| s.cloud.points()[0][0]).collect(),
        sweeps.clone().map(|s| s.stamp).collect(),
        sweeps.map(|s| s.pose_odom_sensor.map(|p| p.translation.x)).collect(),
    )
}

#[test]
fn natural_order_and_numbers_as_stamps() {
    let dir = scans(&["10.pcd", "9.pcd", "100.pcd"]);
    let none = vec![None; 3];
    assert_eq!(
        order(dir.path(), &OpenOptions::default()),
        (vec![2.0, 1.0, 3.0], vec![9.0, 10.0, 100.0], none.clone())
    );
    let dir = scans(&["scan_10.pcd", "scan_9.pcd", "scan_100.pcd"]);
    assert_eq!(order(dir.path(), &OpenOptions::default()), (vec![2.0, 1.0, 3.0], vec![0.0, 1.0, 2.0], none));
}

#[test]
fn times_in_names_and_poses_by_stamp() {
    let dir = scans(&["1317600335.25.pcd", "1317600335.75.pcd"]);
    let options = with_poses(
        dir.path(),
        "poses.tum",
        "1317600335 0 0 0 0 0 0 1\n1317600335.5 10 0 0 0 0 0 1\n1317600336 20 0 0 0 0 0 1\n",
    );
    let (_, stamps, poses) = order(dir.path(), &options);
    assert_eq!(stamps, [1_317_600_335.25, 1_317_600_335.75]);
    assert_eq!(poses, [Some(5.0), Some(15.0)]);
}

#[test]
fn poses_by_order_and_by_number() {
    let dir = scans(&["000003.pcd", "000001.pcd"]);
    let kitti = |n: i32| (0..n).map(|i| format!("1 0 0 {i} 0 1 0 0 0 0 1 0\n")).collect::<String>();
    let (x, stamps, poses) = order(dir.path(), &with_poses(dir.path(), "two.txt", &kitti(2)));
    assert_eq!((x, stamps, poses), (vec![2.0, 1.0], vec![1.0, 3.0], vec![Some(0.0), Some(1.0)]));
    let (_, _, poses) = order(dir.path(), &with_poses(dir.path(), "many.txt", &kitti(4)));
    assert_eq!(poses, [Some(1.0), Some(3.0)]);
    let (_, _, poses) =
        order(dir.path(), &with_poses(dir.path(), "t.tum", "5 70 0 0 0 0 0 1\n6 80 0 0 0 0 0 1\n"));
    assert_eq!(poses, [Some(70.0), Some(80.0)]);
    let (_, _, poses) = order(
        dir.path(),
        &with_poses(
            dir.path(),
            "n.tum",
            "0 7 0 0 0 0 0 1\n1 8 0 0 0 0 0 1\n2 9 0 0 0 0 0 1\n3 6 0 0 0 0 0 1\n",
        ),
    );
    assert_eq!(poses, [Some(8.0), Some(6.0)]);

    let options = with_poses(dir.path(), "short.txt", &kitti(3));
    let error = Recording::open(dir.path(), &options).unwrap_err().to_string();
    let file = dir.path().join("short.txt");
    assert_eq!(
        error,
        format!(
            "{}: line 3: the file has 3 lines for 2 scans\nhint: KITTI poses have no stamps and need one line a scan in \
             file order; TUM poses are matched by time",
            file.display()
        )
    );
}

#[test]
fn mixed_formats_say_what_is_ignored() {
    let dir = scans(&["1.pcd", "2.pcd"]);
    for name in ["0.bin", "poses.txt", "1.label", ".hidden.pcd"] {
        std::fs::write(dir.path().join(name), "x").unwrap();
    }
    std::fs::create_dir(dir.path().join("3.pcd")).unwrap();
    let all = read_all(dir.path(), &OpenOptions::default());
    assert_eq!((all.error, all.sweeps.len()), (None, 2));
    let name = dir.path().file_name().unwrap().to_string_lossy();
    assert_eq!(all.warnings, [format!("{name}: read the .pcd files, ignored 1 .bin")]);
}

#[test]
fn empty_directories_and_empty_scans() {
    let dir = tempfile::tempdir().unwrap();
    let name = dir.path().file_name().unwrap().to_string_lossy().into_owned();
    let error = || read_all(dir.path(), &OpenOptions::default()).error.unwrap();
    assert_eq!(
        error(),
        format!(
            "{name}: the directory holds no scan\nhint: a directory of scans holds .bin, .pcd, .ply, .las or .laz files, \
             not in further directories"
        )
    );
    std::fs::write(dir.path().join("a_0.mcap"), "").unwrap();
    assert_eq!(
        error(),
        format!(
            "{name}: the directory holds no scan\nhint: it holds .mcap files: name them instead of the directory"
        )
    );
    std::fs::write(dir.path().join("1.pcd"), pcd("", 0)).unwrap();
    std::fs::write(dir.path().join("2.pcd"), pcd("nan 0 0\n", 1)).unwrap();
    let all = read_all(dir.path(), &OpenOptions::default());
    assert_eq!(all.sweeps.len(), 2);
    assert_eq!(
        all.error.unwrap(),
        format!(
            "{name}: the 2 clouds hold no usable point (1 invalid ones)\nhint: check the recording in a viewer"
        )
    );
}

#[test]
fn a_broken_scan_ends_the_recording_with_its_name() {
    let dir = scans(&["1.pcd", "3.pcd"]);
    std::fs::write(dir.path().join("2.pcd"), pcd("", 7)).unwrap();
    let all = read_all(dir.path(), &OpenOptions::default());
    assert_eq!(all.sweeps.len(), 1);
    let name = dir.path().file_name().unwrap().to_string_lossy();
    assert_eq!(
        all.error.unwrap(),
        format!(
            "{name}/2.pcd: line 8: POINTS says 7, the file holds 0\nhint: the copy may be incomplete; compare the file's \
             size with the original's"
        )
    );
}

#[test]
fn one_scan_is_a_recording() {
    let dir = scans(&["7.pcd"]);
    let (x, stamps, _) = order(&dir.path().join("7.pcd"), &OpenOptions::default());
    assert_eq!((x, stamps), (vec![1.0], vec![7.0]));
}

#[test]
fn inputs_are_told_apart() {
    let dir = scans(&["7.pcd"]);
    assert_eq!(classify(dir.path()).unwrap(), InputKind::ScanDirectory);
    assert_eq!(classify(dir.path().join("7.pcd")).unwrap(), InputKind::PriorCloud);
    for name in ["A.LAZ", "a.las", "a.ply", "a.bin"] {
        assert_eq!(classify(&TestFile::new(name, "").path).unwrap(), InputKind::PriorCloud);
    }
    assert_eq!(classify(&TestFile::new("r.mcap", "").path).unwrap(), InputKind::Recording);
    assert_eq!(classify(&TestFile::new("r", Mcap::new().unfinished()).path).unwrap(), InputKind::Recording);
    let file = TestFile::new("x.db3", "SQLite format 3\0");
    assert_eq!(
        file.message(&classify(&file.path).unwrap_err()),
        "x.db3: is no kind of input that is known\nhint: inputs are .mcap, a directory of scans, or one cloud (.las .laz \
         .pcd .ply .bin); ROS bags of other kinds can be converted with 'ros2 bag convert' or 'mcap convert'"
    );
    let missing = file.path.with_file_name("no");
    assert_eq!(
        file.message(&classify(missing).unwrap_err()),
        "no: opening: No such file or directory (os error 2)\nhint: check the spelling; relative paths start at the \
         working directory"
    );
}

/// Opening a pipe that nobody writes to would wait for ever.
#[cfg(unix)]
#[test]
fn pipes_and_devices_are_refused_before_they_are_opened() {
    let dir = tempfile::tempdir().unwrap();
    let says = |path: &Path, error: esm_io::Error| {
        assert_eq!(
            error.to_string(),
            format!(
                "{}: this is not a regular file\nhint: pipes, sockets and devices cannot be read: write the data to a \
                 file first",
                path.display()
            )
        );
    };
    let scan = dir.path().join("1.bin");
    std::fs::write(&scan, [0; 16]).unwrap();
    for name in ["a.pcd", "a.ply", "a.las", "a.laz", "a.bin", "a.mcap", "a.txt", "a"] {
        let pipe = dir.path().join(name);
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
        assert!(made.success());
        says(
            &pipe,
            Recording::open(&pipe, &OpenOptions::default())
                .and_then(|r| r.sweeps()?.next().unwrap())
                .unwrap_err(),
        );
        if extension_is_cloud(name) {
            says(&pipe, esm_io::read_scan(&pipe).unwrap_err());
            says(&pipe, esm_io::read_prior_cloud(&pipe).unwrap_err());
        }
        says(&pipe, esm_io::read_tum(&pipe).unwrap_err());
        says(&pipe, esm_io::read_kitti_poses(&pipe).unwrap_err());
        says(&pipe, esm_io::read_poses(&pipe).unwrap_err());
        let options = OpenOptions { poses: Some(pipe.clone()), ..OpenOptions::default() };
        says(&pipe, Recording::open(&scan, &options).unwrap_err());
    }
    let device = Path::new("/dev/null");
    says(device, esm_io::read_poses(device).unwrap_err());
    says(device, classify(device).unwrap_err());
}

#[cfg(unix)]
fn extension_is_cloud(name: &str) -> bool {
    [".pcd", ".ply", ".las", ".laz", ".bin"].iter().any(|e| name.ends_with(e))
}

/// Files that count from 0 or 1 are a whole drive; what begins later or has gaps is a part of one.
#[test]
fn kitti_lines_must_be_as_many_as_scans() {
    let names = |from: i32, n: i32| (from..from + n).map(|i| format!("{i:06}.pcd")).collect::<Vec<_>>();
    let lines = |n: i32| (0..n).map(|i| format!("1 0 0 {i} 0 1 0 0 0 0 1 0\n")).collect::<String>();
    for (from, n, told) in [
        (0, 7, "line 7: the file has 7 lines for 6 scans"),
        (1, 7, "line 7: the file has 7 lines for 6 scans"),
        (0, 5, "line 6: the file has 5 lines for 6 scans"),
        (3, 8, "line 7: the file has 8 lines for 6 scans"),
    ] {
        let names = names(from, 6);
        let dir = scans(&names.iter().map(String::as_str).collect::<Vec<_>>());
        let options = with_poses(dir.path(), "poses.txt", &lines(n));
        let error = Recording::open(dir.path(), &options).unwrap_err().to_string();
        let hint = "hint: KITTI poses have no stamps and need one line a scan in file order; TUM poses are matched by time";
        assert_eq!(error, format!("{}: {told}\n{hint}", dir.path().join("poses.txt").display()));
    }
    let names = names(3, 6);
    let dir = scans(&names.iter().map(String::as_str).collect::<Vec<_>>());
    let (_, _, poses) = order(dir.path(), &with_poses(dir.path(), "poses.txt", &lines(9)));
    assert_eq!(poses, (3..9).map(|i| Some(f64::from(i))).collect::<Vec<_>>());
}
