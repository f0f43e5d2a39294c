//! LAS files written by hand after the specification; LAZ by way of the `las` crate's own writer, then broken.

use esm_io::{read_prior_cloud, read_scan};

use crate::support::{TestFile, shared_data};

const INCOMPLETE: &str = "hint: the copy may be incomplete; compare the file's size with the original's";

/// LAS 1.2, point format 0: raw integers with scale 0.01 and an offset in UTM.
fn las_1_2(points: &[[i32; 3]]) -> Vec<u8> {
    let mut b = b"LASF".to_vec();
    b.resize(24, 0);
    b.extend([1, 2]);
    b.resize(94, 0);
    b.extend(227u16.to_le_bytes());
    b.extend(227u32.to_le_bytes());
    b.extend(0u32.to_le_bytes());
    b.push(0);
    b.extend(20u16.to_le_bytes());
    b.extend((points.len() as u32).to_le_bytes());
    b.resize(131, 0);
    for v in [0.01, 0.01, 0.01, 448_000.0, 5_428_000.0, 100.0] {
        b.extend(f64::to_le_bytes(v));
    }
    b.resize(227, 0);
    for p in points {
        b.extend(p.iter().flat_map(|v| v.to_le_bytes()));
        b.extend([0; 8]);
    }
    b
}

/// LAZ of `n` points on a rough surface.
fn laz(n: i32) -> Vec<u8> {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(6).unwrap();
    builder.point_format.is_compressed = true;
    let mut writer =
        las::Writer::new(std::io::Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
    for i in 0..n {
        let t = f64::from(i);
        let point = las::Point {
            x: (t * 0.01).round(),
            y: (t * 0.7).sin().round(),
            z: 5.0 + f64::from(i % 7),
            gps_time: Some(0.0),
            ..Default::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
    writer.into_inner().unwrap().into_inner()
}

#[track_caller]
fn fails(bytes: &[u8], message: &str) {
    let file = TestFile::new("survey.las", bytes);
    assert_eq!(file.message(&read_prior_cloud(&file.path).unwrap_err()), message);
}

#[test]
fn scale_and_offset_in_f64() {
    let mut bytes = las_1_2(&[[26_225, 12_350, 1_213], [26_226, 12_351, 1_214]]);
    bytes.extend(b"trailing");
    let file = TestFile::new("survey.las", &bytes);
    let prior = read_prior_cloud(&file.path).unwrap();
    assert_eq!(prior.origin, [448_000.0, 5_428_000.0, 0.0]);
    let expected = [[262.25, 123.5, 112.13], [262.26, 123.51, 112.14]];
    for (p, e) in prior.cloud.points().iter().zip(expected) {
        for axis in 0..3 {
            assert!((f64::from(p[axis]) - e[axis]).abs() < 2e-5, "{p:?} {e:?}");
        }
    }
}

#[test]
fn laz_reads_what_was_written() {
    let file = TestFile::new("survey.laz", laz(20_000));
    let scan = read_scan(&file.path).unwrap();
    assert_eq!(scan.cloud.len(), 20_000);
    for (i, p) in scan.cloud.points().iter().enumerate() {
        assert_eq!(p[0], (i as f32 * 0.01).round());
        assert_eq!(p[2], 5.0 + (i % 7) as f32);
    }
}

#[test]
fn broken_headers() {
    let whole = las_1_2(&[[1, 2, 3]; 10]);
    fails(&[], &format!("survey.las: the file is empty (0 bytes)\n{INCOMPLETE}"));
    fails(
        &whole[..100],
        &format!("survey.las: header: the file ends inside the header, after 100 bytes\n{INCOMPLETE}"),
    );
    fails(
        &whole[..whole.len() - 1],
        &format!("survey.las: header: the header says 10 points, the file holds 9\n{INCOMPLETE}"),
    );
    fails(
        b"LASX and more of it",
        "survey.las: header: the file signature is not 'LASF': [76, 65, 83, 88]\n\
         hint: check that this is a LAS or LAZ file of version 1.0 to 1.4",
    );
    let mut far = whole.clone();
    far[96..100].copy_from_slice(&0xFFFF_FFFFu32.to_le_bytes());
    fails(
        &far,
        &format!("survey.las: header: the points start at byte 4294967295, the file has 427\n{INCOMPLETE}"),
    );
    let mut flat = whole.clone();
    flat[131..139].copy_from_slice(&f64::NAN.to_le_bytes());
    fails(
        &flat,
        "survey.las: header: scales [NaN, 0.01, 0.01] and offsets [448000.0, 5428000.0, 100.0] give no coordinates\n\
         hint: check that this is a LAS or LAZ file of version 1.0 to 1.4",
    );
    let mut empty = las_1_2(&[]);
    fails(
        &empty,
        "survey.las: the cloud holds no usable point (0 invalid ones)\n\
         hint: check the file in a viewer, or export it again",
    );
    empty[107..111].copy_from_slice(&u32::MAX.to_le_bytes());
    fails(
        &empty,
        &format!("survey.las: header: the header says 4294967295 points, the file holds 0\n{INCOMPLETE}"),
    );
}

/// A version 1.4 header may ask for 2^64 points and for extended records of 2^64 bytes.
#[test]
fn hostile_lengths_of_version_1_4() {
    let mut bytes = las_1_2(&[[1, 2, 3]; 10]);
    bytes[25] = 4;
    bytes[94..96].copy_from_slice(&375u16.to_le_bytes());
    bytes[96..100].copy_from_slice(&375u32.to_le_bytes());
    bytes[107..111].copy_from_slice(&0u32.to_le_bytes());
    let points = bytes.split_off(227);
    bytes.resize(375, 0);
    bytes[247..255].copy_from_slice(&u64::MAX.to_le_bytes());
    bytes.extend(points);
    fails(
        &bytes,
        &format!(
            "survey.las: header: the header says 18446744073709551615 points, the file holds 10\n{INCOMPLETE}"
        ),
    );
    bytes[247..255].copy_from_slice(&10u64.to_le_bytes());
    let file = TestFile::new("survey.las", &bytes);
    assert_eq!(read_prior_cloud(&file.path).unwrap().cloud.len(), 10);

    let evlr = bytes.len() as u64;
    bytes[235..243].copy_from_slice(&evlr.to_le_bytes());
    bytes[243..247].copy_from_slice(&1u32.to_le_bytes());
    let what = format!("the extended record at byte {evlr} reaches beyond the file's {evlr} bytes");
    fails(&bytes, &format!("survey.las: header: {what}\n{INCOMPLETE}"));
    let mut record = vec![0; 60];
    record[20..28].copy_from_slice(&(1u64 << 62).to_le_bytes());
    bytes.extend(record);
    let what = format!("the extended record at byte {evlr} reaches beyond the file's {} bytes", evlr + 60);
    fails(&bytes, &format!("survey.las: header: {what}\n{INCOMPLETE}"));
}

/// Tables of a LAZ file that ask for gigabytes.
#[test]
fn hostile_tables_of_laz() {
    let fails = |alter: &dyn Fn(&mut Vec<u8>), message: &str| {
        let mut bytes = laz(500);
        alter(&mut bytes);
        let file = TestFile::new("survey.laz", &bytes);
        let error = file.message(&read_prior_cloud(&file.path).unwrap_err());
        assert_eq!(error, format!("survey.laz: compressed points: {message}\n{INCOMPLETE}"));
    };
    let whole = laz(500);
    let start = u32::from_le_bytes(whole[96..100].try_into().unwrap()) as usize;
    let table = u64::from_le_bytes(whole[start..start + 8].try_into().unwrap()) as usize;
    fails(
        &|b| b[table + 4..table + 8].fill(0xFF),
        &format!("the chunk table at byte {table} says 4294967295 chunks, the file cannot hold them"),
    );
    // After the first point of 30 bytes: number of points, lengths of nine layers.
    let chunk = start + 8;
    let is = |what: &str| format!("the chunk at byte {chunk} says {what}");
    let there = table - chunk - 30 - 4 - 36;
    fails(
        &|b| b[chunk + 34..chunk + 70].fill(0xFF),
        &is(&format!("500 points in 38654705655 bytes, {there} are there")),
    );
    fails(
        &|b| b[chunk + 30..chunk + 34].fill(0),
        &is(&format!("0 points in {there} bytes, {there} are there")),
    );
    fails(
        &|b| {
            b[107..111].fill(0);
            b[247..255].copy_from_slice(&600u64.to_le_bytes());
        },
        &format!("the header says 600 points, the chunks before byte {table} hold 500"),
    );
    fails(
        &|b| b.truncate(table + 7),
        &format!("the chunk table is to follow at byte {table}, the file ends at byte {}", table + 7),
    );
    let record = whole.windows(14).position(|w| w == b"laszip encoded").unwrap() + 52;
    fails(&|b| b[record + 34] = 99, "the laszip record lists fields that are not known");
    fails(&|b| b[record] = 2, "the laszip record mixes layered and plain fields");
    fails(&|b| b[105] = 40, "the laszip record lists 30 bytes a point, the header 40");

    let file = TestFile::new(
        "survey.laz",
        whole.iter().map(|&c| if c == b'z' { b'y' } else { c }).collect::<Vec<_>>(),
    );
    assert_eq!(
        file.message(&read_prior_cloud(&file.path).unwrap_err()),
        "survey.laz: header: the points are compressed and the laszip record is missing\n\
         hint: check that this is a LAS or LAZ file of version 1.0 to 1.4"
    );
}

#[test]
fn every_cut_of_a_las_file_is_an_error() {
    let whole = las_1_2(&[[1, 2, 3]; 4]);
    for cut in 0..whole.len() {
        let file = TestFile::new("cut.las", &whole[..cut]);
        let error = read_prior_cloud(&file.path).unwrap_err();
        assert!(file.message(&error).starts_with("cut.las: "), "{error}");
    }
}

#[test]
fn cut_laz_files_are_errors() {
    let whole = laz(3000);
    for cut in (0..whole.len()).step_by(whole.len() / 150) {
        let file = TestFile::new("cut.laz", &whole[..cut]);
        let error = read_prior_cloud(&file.path).unwrap_err();
        assert!(file.message(&error).starts_with("cut.laz: "), "{error}");
    }
    for cut in [whole.len() - 1, whole.len() - 3] {
        let file = TestFile::new("cut.laz", &whole[..cut]);
        let what = "the file is cut short: it ends inside its header, its variable length records or its chunk table";
        let error = read_prior_cloud(&file.path).unwrap_err();
        assert_eq!(file.message(&error), format!("cut.laz: header: {what}\n{INCOMPLETE}"));
    }
}

/// More variable length records than stand before the points.
#[test]
fn hostile_numbers_of_records() {
    let las = las_1_2(&[[1, 2, 3]; 10]);
    for (mut bytes, before) in [(las, 0), (laz(500), 94)] {
        bytes[100..104].copy_from_slice(&4_000_000_000u32.to_le_bytes());
        let what = format!(
            "the header says 4000000000 variable length records, the {before} bytes before the points cannot hold them"
        );
        fails(&bytes, &format!("survey.las: header: {what}\n{INCOMPLETE}"));
    }
    // Few enough by number, and their lengths lead beyond the end.
    let mut bytes = laz(500);
    bytes[375 + 20..375 + 22].fill(0xFF);
    bytes.truncate(2000);
    let file = TestFile::new("survey.laz", &bytes);
    let error = file.message(&read_prior_cloud(&file.path).unwrap_err());
    let what =
        "the file is cut short: it ends inside its header, its variable length records or its chunk table";
    assert_eq!(error, format!("survey.laz: header: {what}\n{INCOMPLETE}"));
}

/// Bytes of a LAZ file altered one at a time: errors or other points, never a panic.
#[test]
fn altered_laz_files_never_panic() {
    let mut files = vec![laz(500)];
    if let Some(data) = shared_data() {
        files.push(std::fs::read(data.join("forest/plot_als.laz")).unwrap());
        files.push(std::fs::read(data.join("forest/pine_tls.laz")).unwrap());
    }
    let mut state = 1u64;
    for whole in files {
        let every = if whole.len() < 10_000 { 4 } else { 100 };
        for i in 0..2000 {
            // A linear congruence picks the place and the value; the first kilobyte holds header and item list.
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            if i % every != 0 {
                continue;
            }
            let mut bytes = whole.clone();
            let range = if i % 3 == 0 { bytes.len() } else { bytes.len().min(1000) };
            bytes[(state >> 33) as usize % range] = (state >> 20) as u8;
            let file = TestFile::new("altered.laz", &bytes);
            let _ = read_prior_cloud(&file.path);
        }
    }
}
