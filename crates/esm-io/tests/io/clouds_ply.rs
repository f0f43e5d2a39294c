//! PLY files written by hand, whole and broken.

use esm_io::read_scan;
use proptest::prelude::*;

use crate::support::TestFile;

const HINT: &str =
    "hint: a PLY header has a format line, 'element vertex N', 'property float x' ... and end_header";
const INCOMPLETE: &str = "hint: the copy may be incomplete; compare the file's size with the original's";

fn header(format: &str, vertices: usize) -> String {
    format!(
        "ply\nformat {format} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         end_header\n"
    )
}

#[track_caller]
fn reads(bytes: impl AsRef<[u8]>, points: &[[f32; 3]], dropped: usize) {
    let file = TestFile::new("scan.ply", bytes);
    let scan = read_scan(&file.path).unwrap();
    assert_eq!((scan.cloud.points(), scan.dropped), (points, dropped));
}

#[track_caller]
fn fails(bytes: impl AsRef<[u8]>, message: &str) {
    let file = TestFile::new("scan.ply", bytes);
    assert_eq!(file.message(&read_scan(&file.path).unwrap_err()), message);
}

#[test]
fn ascii_as_programs_write_it() {
    // CRLF, a comment that is not UTF-8, names with blanks and brackets, nan, `1.`, faces after the vertices.
    let text: &[u8] = b"ply\r\nformat ascii 1.0\r\ncomment Gr\xf6\xdfe\r\nobj_info made by hand\r\nelement vertex 4\r\n\
        property uchar red\r\nproperty double z\r\nproperty float x\r\nproperty float scalar_distance[<0.1]\r\n\
        property float y\r\nelement face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n\
        255 3. 1 0 2\r\n0 nan nan 0 nan\r\n0 0 0 1 0\r\n\r\n7 inf 1 2 3\r\n3 0 1\r\n";
    reads(text, &[[1.0, 2.0, 3.0]], 3);
}

#[test]
fn binary_of_both_orders_with_elements_before_and_lists_inside() {
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement camera 1\nproperty list ushort double view\nproperty char c\n\
             element vertex 2\nproperty short x\nproperty list uchar int n\nproperty double y\nproperty uint z\nend_header\n"
        )
    };
    let mut little = head("binary_little_endian").into_bytes();
    let mut big = head("binary_big_endian").into_bytes();
    fn put<const N: usize>(little: &mut Vec<u8>, big: &mut Vec<u8>, v: [u8; N]) {
        little.extend(v);
        big.extend(v.iter().rev());
    }
    put(&mut little, &mut big, 2u16.to_le_bytes());
    put(&mut little, &mut big, 1.0f64.to_le_bytes());
    put(&mut little, &mut big, 2.0f64.to_le_bytes());
    put(&mut little, &mut big, [3]);
    for (x, list, y, z) in [(-2i16, vec![5i32, 6], 2.5f64, 70_000u32), (3, vec![], -1.0, 1)] {
        put(&mut little, &mut big, x.to_le_bytes());
        put(&mut little, &mut big, [list.len() as u8]);
        for v in list {
            put(&mut little, &mut big, v.to_le_bytes());
        }
        put(&mut little, &mut big, y.to_le_bytes());
        put(&mut little, &mut big, z.to_le_bytes());
    }
    for bytes in [&little, &big] {
        reads(bytes, &[[-2.0, 2.5, 70_000.0], [3.0, -1.0, 1.0]], 0);
        let start = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        for cut in 0..bytes.len() {
            let file = TestFile::new("cut.ply", &bytes[..cut]);
            let message = file.message(&read_scan(&file.path).unwrap_err());
            let of_body = message.contains("the file holds");
            assert!(message.starts_with("cut.ply: ") && of_body == (cut + 1 >= start), "{cut}: {message}");
        }
    }
}

#[test]
fn fixed_records_and_trailing_bytes() {
    let points = [[1.0f32, 2.0, 3.0], [4.0, 5.0, 6.0]];
    let little: Vec<u8> = points.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    let big: Vec<u8> = points.iter().flatten().flat_map(|v| v.to_be_bytes()).collect();
    for (format, body) in [("binary_little_endian", little), ("binary_big_endian", big)] {
        let whole = [header(format, 2).as_bytes(), &body].concat();
        reads([&whole[..], b"trailing"].concat(), &points, 0);
        fails(
            &whole[..whole.len() - 1],
            &format!(
                "scan.ply: byte {}: element vertex says 2, the file holds 1\n{INCOMPLETE}",
                whole.len() - 1
            ),
        );
    }
}

#[test]
fn fewer_than_declared() {
    fails(
        header("ascii", 100) + "1 2 3\n4 5 6\n",
        &format!("scan.ply: line 10: element vertex says 100, the file holds 2\n{INCOMPLETE}"),
    );
    fails(
        header("ascii", 1) + "1 2\n",
        &format!("scan.ply: line 8: the line has 2 of 3 properties\n{INCOMPLETE}"),
    );
    fails(
        header("binary_little_endian", usize::MAX),
        &format!(
            "scan.ply: byte 134: element vertex says 18446744073709551615, the file holds 0\n{INCOMPLETE}"
        ),
    );
}

#[test]
fn broken_headers() {
    fails(
        "",
        "scan.ply: the file is empty (0 bytes)\nhint: the copy may be incomplete; compare the file's size with the \
         original's",
    );
    fails(
        "plyx\n",
        "scan.ply: line 1: the file does not start with the line 'ply'\nhint: check that this is a PLY file",
    );
    fails("ply\nformat ascii 1.0\n", &format!("scan.ply: header: no end_header line was found\n{HINT}"));
    fails("ply\nend_header\n", &format!("scan.ply: header: the format line is missing\n{HINT}"));
    fails(
        "ply\nformat ascii 1.0\nend_header\n",
        &format!("scan.ply: header: there is no element 'vertex'\n{HINT}"),
    );
    fails(
        header("ebcdic", 1),
        "scan.ply: line 2: format ebcdic 1.0 is not known\nhint: known are ascii, binary_little_endian and \
         binary_big_endian",
    );
    fails(
        header("ascii", 1).replace("vertex 1", "vertex some"),
        &format!("scan.ply: line 3: 'some' is no number of entries for the element vertex\n{HINT}"),
    );
    fails(
        header("ascii", 1).replace("float y", "half y"),
        &format!("scan.ply: line 5: the type 'half' is not known\n{HINT}"),
    );
    fails(
        header("ascii", 1).replace("property float y", "property float"),
        &format!("scan.ply: line 5: the line is not complete\n{HINT}"),
    );
    fails(
        header("ascii", 1).replace("float y", "list float int y"),
        &format!("scan.ply: line 5: the list has types that are not known\n{HINT}"),
    );
    fails(
        header("ascii", 1).replace("element vertex 1\n", ""),
        &format!("scan.ply: line 3: a property stands before the first element\n{HINT}"),
    );
    fails(
        header("ascii", 1).replace("float y", "float w"),
        "scan.ply: header: the vertices have no properties x, y and z\nhint: export the cloud with its coordinates",
    );
    fails(
        "ply\nformat binary_little_endian 1.0\nelement nothing 18446744073709551615\nelement vertex 0\nend_header\n",
        &format!(
            "scan.ply: header: the element nothing has 18446744073709551615 entries without properties\n{HINT}"
        ),
    );
    fails(
        header("ascii", 1) + "1 2 three\n",
        &format!("scan.ply: line 8: 'three' stands where a number is expected\n{HINT}"),
    );
}

proptest! {
    #[test]
    fn noise_never_panics(body in proptest::collection::vec(any::<u8>(), 0..300), kind in 0..3usize, list in any::<bool>(), n in 0..20usize) {
        let mut head = header(["ascii", "binary_little_endian", "binary_big_endian"][kind], n);
        if list {
            head = head.replace("property float y\n", "property list int64 short l\nproperty float y\n");
        }
        let file = TestFile::new("noise.ply", [head.as_bytes(), &body].concat());
        if let Ok(scan) = read_scan(&file.path) {
            prop_assert_eq!(scan.cloud.len() + scan.dropped, n);
        }
    }

    #[test]
    fn noise_in_headers_never_panics(text in "ply\n(format|element|property|vertex| 3| x|ascii 1.0|\n| list| uchar| float|end_header){0,40}") {
        let file = TestFile::new("noise.ply", text);
        let _ = read_scan(&file.path);
    }
}
