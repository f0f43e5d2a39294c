//! PCD files written by hand, whole and broken; KITTI .bin.

use esm_io::{read_prior_cloud, read_scan};
use proptest::prelude::*;

use crate::support::TestFile;

const POINTS: [[f32; 3]; 4] = [[1.0, 2.0, 3.0], [-4.5, 5.0, 0.25], [0.0, 0.0, 7.0], [8.0, -9.0, 10.0]];

fn plain_header(points: usize, data: &str) -> String {
    format!(
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {points}\nHEIGHT 1\n\
         VIEWPOINT 1 2 3 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    )
}

fn binary(points: &[[f32; 3]]) -> Vec<u8> {
    points.iter().flatten().flat_map(|v| v.to_le_bytes()).collect()
}

/// One LZF block of literal runs only.
fn lzf_literals(data: &[u8]) -> Vec<u8> {
    data.chunks(32).flat_map(|run| [&[run.len() as u8 - 1], run].concat()).collect()
}

fn compressed(header: &str, columns: &[u8]) -> Vec<u8> {
    let packed = lzf_literals(columns);
    let sizes = [(packed.len() as u32).to_le_bytes(), (columns.len() as u32).to_le_bytes()].concat();
    [header.as_bytes(), &sizes, &packed].concat()
}

#[track_caller]
fn reads(bytes: impl AsRef<[u8]>, points: &[[f32; 3]], dropped: usize) {
    let file = TestFile::new("scan.pcd", bytes);
    let scan = read_scan(&file.path).unwrap();
    assert_eq!((scan.cloud.points(), scan.dropped), (points, dropped));
}

#[track_caller]
fn fails(bytes: impl AsRef<[u8]>, message: &str) {
    let file = TestFile::new("scan.pcd", bytes);
    assert_eq!(file.message(&read_scan(&file.path).unwrap_err()), message);
}

#[test]
fn ascii_with_nan_zero_and_further_columns() {
    reads(
        "VERSION .7\r\nFIELDS intensity z x _ y\r\nSIZE 4 4 8 1 4\r\nTYPE F F F U F\r\nCOUNT 1 1 1 3 1\r\nWIDTH 2\r\n\
         HEIGHT 2\r\nPOINTS 4\r\nDATA ascii\r\n0.5 3 1.0 9 9 9 2\r\n\r\nnan nan nan 0 0 0 nan\r\n\
         7 0 0 0 0 0 0\r\n1 -6e0 -4 0 0 0 +5.\r\nwhat follows the last point is ignored",
        &[[1.0, 2.0, 3.0], [-4.0, 5.0, -6.0]],
        2,
    );
}

#[test]
fn binary_with_zero_width_and_trailing_bytes() {
    let header = plain_header(4, "binary").replace("WIDTH 4\nHEIGHT 1", "WIDTH 0\nHEIGHT 0");
    reads([header.as_bytes(), &binary(&POINTS), &[0xFF; 37]].concat(), &POINTS, 0);
}

#[test]
fn points_may_be_missing_or_zero_where_width_and_height_tell() {
    for points_line in ["", "POINTS 0\n"] {
        let header = plain_header(4, "binary").replace("POINTS 4\n", points_line);
        reads([header.as_bytes(), &binary(&POINTS)].concat(), &POINTS, 0);
    }
    reads(plain_header(0, "binary"), &[], 0);
}

#[test]
fn binary_of_any_type_and_order() {
    let header = "FIELDS rgb z t x y\nSIZE 4 8 8 2 1\nTYPE U F U I U\nCOUNT 2 1 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA binary\n";
    let mut body = Vec::new();
    for (x, y, z) in [(-300i16, 200u8, 1.5f64), (7, 0, -1e300)] {
        body.extend([9; 8]);
        body.extend(z.to_le_bytes());
        body.extend([8; 8]);
        body.extend(x.to_le_bytes());
        body.push(y);
    }
    // The second z is finite in f64 and not in f32.
    reads([header.as_bytes(), &body].concat(), &[[-300.0, 200.0, 1.5]], 1);
}

#[test]
fn compressed_is_column_by_column() {
    let header =
        "FIELDS x n y z\nSIZE 4 2 4 4\nTYPE F U F F\nCOUNT 1 3 1 1\nPOINTS 4\nDATA binary_compressed\n";
    let column = |axis: usize| POINTS.iter().flat_map(move |p| p[axis].to_le_bytes()).collect::<Vec<_>>();
    let columns = [column(0), vec![5; 24], column(1), column(2)].concat();
    reads(compressed(header, &columns), &POINTS, 0);
}

#[test]
fn utm_coordinates_keep_their_millimetres() {
    let file = TestFile::new(
        "utm.pcd",
        "FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nDATA ascii\n\
         448262.251 5428123.502 112.125\n448262.252 5428123.503 112.126\n",
    );
    let prior = read_prior_cloud(&file.path).unwrap();
    assert_eq!(prior.origin, [448_000.0, 5_428_000.0, 0.0]);
    let [a, b] = [0, 1].map(|i| prior.cloud.points()[i].map(f64::from));
    for axis in 0..3 {
        assert!((b[axis] - a[axis] - 0.001).abs() < 2e-5);
    }
}

#[test]
fn fewer_points_than_declared() {
    let hint = "hint: the copy may be incomplete; compare the file's size with the original's";
    let ascii = format!("{}1 2 3\n4 5 6\n", plain_header(100, "ascii"));
    fails(ascii, &format!("scan.pcd: line 14: POINTS says 100, the file holds 2\n{hint}"));
    let whole = [plain_header(4, "binary").as_bytes(), &binary(&POINTS)].concat();
    fails(&whole[..whole.len() - 1], &format!("scan.pcd: byte 180: POINTS says 4, the file holds 3\n{hint}"));
    fails(
        plain_header(4, "ascii") + "1 2 3\n4 5\n",
        &format!("scan.pcd: line 13: the line has 2 of 3 values\n{hint}"),
    );
    let columns = vec![0; 36];
    fails(
        compressed(&plain_header(4, "binary_compressed"), &columns),
        &format!("scan.pcd: byte 144: POINTS says 4, the compressed block holds 3\n{hint}"),
    );
    let mut cut = compressed(&plain_header(4, "binary_compressed"), &[1; 48]);
    cut.pop();
    fails(&cut, &format!("scan.pcd: byte 144: the compressed block has 50 bytes, the file holds 49\n{hint}"));
}

#[test]
fn hostile_counts_allocate_nothing() {
    let hint = "hint: the copy may be incomplete; compare the file's size with the original's";
    let header = plain_header(4, "binary").replace("POINTS 4", "POINTS 18446744073709551615");
    fails(
        [header.as_bytes(), &binary(&POINTS)].concat(),
        &format!("scan.pcd: byte 200: POINTS says 18446744073709551615, the file holds 4\n{hint}"),
    );
    let header = plain_header(1 << 28, "binary_compressed");
    let body = [&8u32.to_le_bytes()[..], &0xC000_0000u32.to_le_bytes(), &[7; 8]].concat();
    fails(
        [header.as_bytes(), &body].concat(),
        &format!(
            "scan.pcd: byte {}: 8 compressed bytes cannot hold the 3221225472 bytes declared\n{hint}",
            header.len()
        ),
    );
    fails(
        "FIELDS x y z big\nSIZE 4 4 4 8\nTYPE F F F F\nCOUNT 1 1 1 18446744073709551615\nPOINTS 1\nDATA binary\n",
        "scan.pcd: header: field big has SIZE 8 COUNT 18446744073709551615, which cannot be\nhint: a PCD header has the \
         lines FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, POINTS, DATA",
    );
}

#[test]
fn broken_headers() {
    let hint = "hint: a PCD header has the lines FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, POINTS, DATA";
    fails("\n", &format!("scan.pcd: header: no DATA line was found\n{hint}"));
    fails(
        "",
        "scan.pcd: the file is empty (0 bytes)\nhint: the copy may be incomplete; compare the file's size with the \
         original's",
    );
    fails("just text\n", &format!("scan.pcd: header: no DATA line was found\n{hint}"));
    fails("DATA ascii\n", &format!("scan.pcd: header: the FIELDS line is missing\n{hint}"));
    fails(
        plain_header(1, "zip"),
        "scan.pcd: line 11: DATA zip is not known\nhint: known are ascii, binary and binary_compressed",
    );
    fails(
        plain_header(1, "ascii").replace("POINTS 1", "POINTS one"),
        &format!("scan.pcd: line 10: POINTS has 'one' where a whole number is expected\n{hint}"),
    );
    fails(
        plain_header(1, "ascii").replace("SIZE 4 4 4", "SIZE 4 4"),
        &format!("scan.pcd: header: FIELDS names 3 fields, SIZE has 2 entries\n{hint}"),
    );
    fails(
        plain_header(1, "ascii").replace("FIELDS x y z", "FIELDS x y q"),
        "scan.pcd: header: the fields are x y q: x, y and z are needed\nhint: export the cloud with its coordinates",
    );
    fails(
        plain_header(1, "ascii").replace("TYPE F F F", "TYPE F F G"),
        "scan.pcd: header: field z has TYPE G SIZE 4, which is no number\nhint: known are I and U of 1, 2, 4, 8 and F \
         of 4, 8 bytes",
    );
    fails(
        plain_header(1, "ascii").replace("WIDTH 1\nHEIGHT 1", "").replace("POINTS 1\n", ""),
        &format!(
            "scan.pcd: header: neither POINTS nor WIDTH and HEIGHT say how many points there are\n{hint}"
        ),
    );
    fails(
        plain_header(1, "ascii") + "1 two 3\n",
        "scan.pcd: line 12: 'two' stands where the number y is expected\nhint: the header says DATA ascii; check that \
         the body is text",
    );
    fails(
        [plain_header(1, "ascii").as_bytes(), &[b'7'; 70_000]].concat(),
        "scan.pcd: line 12: the line is longer than 65536 bytes\nhint: this does not look like text; check the file's \
         format",
    );
}

#[test]
fn every_cut_of_a_file_is_an_error_or_complete() {
    let header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 4\nDATA binary_compressed\n";
    let column = |axis: usize| POINTS.iter().flat_map(move |p| p[axis].to_le_bytes()).collect::<Vec<_>>();
    let files = [
        compressed(header, &[column(0), column(1), column(2)].concat()),
        [plain_header(4, "binary").as_bytes(), &binary(&POINTS)].concat(),
        (plain_header(4, "ascii") + "1 2 3\n-4.5 5 0.25\n0 0 7\n8 -9 10\n").into_bytes(),
    ];
    for (i, bytes) in files.iter().enumerate() {
        // The ascii file is complete without its last line break, and says something else without its last digit.
        let complete = if i == 2 { bytes.len() - 2 } else { bytes.len() };
        for cut in 0..complete {
            let file = TestFile::new("cut.pcd", &bytes[..cut]);
            let error = read_scan(&file.path).unwrap_err();
            assert!(file.message(&error).starts_with("cut.pcd: "), "{error}");
        }
        reads(bytes, &POINTS, 0);
    }
}

proptest! {
    #[test]
    fn noise_never_panics(body in proptest::collection::vec(any::<u8>(), 0..300), kind in 0..3usize, points in 0..20usize) {
        let header = plain_header(points, ["ascii", "binary", "binary_compressed"][kind]);
        let file = TestFile::new("noise.pcd", [header.as_bytes(), &body].concat());
        if let Ok(scan) = read_scan(&file.path) {
            prop_assert_eq!(scan.cloud.len() + scan.dropped, points);
        }
    }

    #[test]
    fn noise_in_headers_never_panics(text in "(FIELDS|SIZE|TYPE|COUNT|WIDTH|POINTS|DATA| x y z| 4| 0| F|\n|-1|binary|ascii|99999999999){0,40}") {
        let file = TestFile::new("noise.pcd", text);
        let _ = read_scan(&file.path);
    }
}

#[test]
fn kitti_bin() {
    let record = |p: [f32; 4]| p.map(f32::to_le_bytes).concat();
    let whole = [record([1.0, 2.0, 3.0, 0.5]), record([f32::NAN, 0.0, 1.0, 0.0]), record([0.0; 4])].concat();
    let file = TestFile::new("0.bin", &whole);
    let scan = read_scan(&file.path).unwrap();
    assert_eq!((scan.cloud.points(), scan.dropped), ([[1.0, 2.0, 3.0]].as_slice(), 2));

    let file = TestFile::new("0.bin", &whole[..47]);
    assert_eq!(
        file.message(&read_scan(&file.path).unwrap_err()),
        "0.bin: byte 32: a KITTI .bin holds 16 bytes a point, the file's 47 bytes are no multiple of that\n\
         hint: the copy may be incomplete; compare the file's size with the original's"
    );
    let file = TestFile::new("0.bin", "");
    assert_eq!(
        file.message(&read_scan(&file.path).unwrap_err()),
        "0.bin: the file is empty (0 bytes)\n\
         hint: the copy may be incomplete; compare the file's size with the original's"
    );
    let file = TestFile::new("0.bin", &whole[16..]);
    assert_eq!(
        file.message(&read_prior_cloud(&file.path).unwrap_err()),
        "0.bin: the cloud holds no usable point (2 invalid ones)\n\
         hint: check the file in a viewer, or export it again"
    );
}

#[test]
fn unknown_and_missing_files() {
    let file = TestFile::new("cloud.xyz", "1 2 3\n");
    assert_eq!(
        file.message(&read_scan(&file.path).unwrap_err()),
        "cloud.xyz: '.xyz' is no known kind of cloud\nhint: clouds are .las, .laz, .pcd, .ply and KITTI's .bin"
    );
    let error = read_scan(file.path.with_file_name("no.pcd")).unwrap_err();
    assert_eq!(
        file.message(&error),
        "no.pcd: opening: No such file or directory (os error 2)\n\
         hint: check the spelling; relative paths start at the working directory"
    );
}
