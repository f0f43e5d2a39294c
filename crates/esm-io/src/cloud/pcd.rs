//! PCD, the Point Cloud Library's format: ascii, binary and binary_compressed.
//!
//! An own reader: `pcd-rs` 0.13 allocates what a header asks for (up to 4 GB twice), indexes out of bounds where a
//! compressed block is shorter than `POINTS` says, refuses headers without `VERSION` or `POINTS`, and builds a record of
//! allocated fields for every point. This one needs x, y and z wherever they stand and whatever their number type is,
//! and skips the rest.
//!
//! `POINTS` counts; where it is missing or 0, `WIDTH` x `HEIGHT` does (files with `WIDTH 0 HEIGHT 0 POINTS n` exist).
//! `VIEWPOINT` is not applied, as in PCL: points stay in the frame they are stored in.

use std::io::Read;

use super::lzf;
use super::sink::PointSink;
use crate::error::{Error, HINT_INCOMPLETE};
use crate::input::{Input, text, tokens};
use crate::scalar::{Scalar, XyzLayout};

const HINT_HEADER: &str = "a PCD header has the lines FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, POINTS, DATA";

/// Most lines a header may have; real ones have about eleven.
const HEADER_LINES: u64 = 1000;

/// Longest point record accepted, bytes.
const RECORD_LIMIT: u64 = 1 << 20;

#[derive(Clone, Copy, PartialEq)]
enum Data {
    Ascii,
    Binary,
    Compressed,
}

struct Header {
    layout: XyzLayout,
    /// Where x, y, z stand among a line's words, and how many words there are.
    columns: [usize; 3],
    words: usize,
    /// Bytes of one binary record.
    record: usize,
    points: u64,
    /// What said so: for messages.
    points_from: &'static str,
    data: Data,
}

pub(super) fn read<R: Read>(mut input: Input<R>, sink: &mut PointSink) -> Result<(), Error> {
    input.refuse_empty()?;
    let header = read_header(&mut input)?;
    match header.data {
        Data::Ascii => read_ascii(input, &header, sink),
        Data::Binary => read_binary(input, &header, sink),
        Data::Compressed => read_compressed(input, &header, sink),
    }
}

fn read_header<R: Read>(input: &mut Input<R>) -> Result<Header, Error> {
    let mut line = Vec::new();
    let mut fields: Vec<String> = Vec::new();
    let (mut sizes, mut types, mut counts) = (Vec::new(), Vec::new(), None);
    let (mut width, mut height, mut points) = (None, None, None);
    let data = loop {
        if input.line >= HEADER_LINES || !input.next_line(&mut line)? {
            return Err(Error::malformed(&input.path, "header", "no DATA line was found", HINT_HEADER));
        }
        let mut words = tokens(&line).map(text);
        let Some(key) = words.next() else { continue };
        match key.as_ref() {
            "FIELDS" | "COLUMNS" => fields = words.map(|w| w.to_ascii_lowercase()).collect(),
            "SIZE" => sizes = numbers(input, "SIZE", words)?,
            "TYPE" => types = words.map(|w| w.into_owned()).collect(),
            "COUNT" => counts = Some(numbers(input, "COUNT", words)?),
            "WIDTH" => width = numbers(input, "WIDTH", words)?.first().copied(),
            "HEIGHT" => height = numbers(input, "HEIGHT", words)?.first().copied(),
            "POINTS" => points = numbers(input, "POINTS", words)?.first().copied(),
            "DATA" => match words.next().as_deref() {
                Some("ascii") => break Data::Ascii,
                Some("binary") => break Data::Binary,
                Some("binary_compressed") => break Data::Compressed,
                other => {
                    let what = format!("DATA {} is not known", other.unwrap_or_default());
                    return Err(input.line_error(what, "known are ascii, binary and binary_compressed"));
                }
            },
            // Comments, VERSION, VIEWPOINT and keys of other writers change nothing here.
            _ => {}
        }
    };
    if fields.is_empty() {
        return Err(Error::malformed(&input.path, "header", "the FIELDS line is missing", HINT_HEADER));
    }
    let counts = counts.unwrap_or_else(|| vec![1; fields.len()]);
    for (name, n) in [("SIZE", sizes.len()), ("TYPE", types.len()), ("COUNT", counts.len())] {
        if n != fields.len() {
            let what = format!("FIELDS names {} fields, {name} has {n} entries", fields.len());
            return Err(Error::malformed(&input.path, "header", what, HINT_HEADER));
        }
    }

    let (mut offset, mut column) = (0u64, 0u64);
    let mut places: [Option<(usize, Scalar, usize)>; 3] = [None; 3];
    for (i, name) in fields.iter().enumerate() {
        if let Some(axis) = ["x", "y", "z"].iter().position(|a| a == name)
            && places[axis].is_none()
        {
            if counts[i] != 1 {
                let what = format!("field {name} has COUNT {}, a coordinate is one number", counts[i]);
                return Err(Error::malformed(&input.path, "header", what, HINT_HEADER));
            }
            let scalar = scalar(&types[i], sizes[i]).ok_or_else(|| {
                let what =
                    format!("field {name} has TYPE {} SIZE {}, which is no number", types[i], sizes[i]);
                Error::malformed(
                    &input.path,
                    "header",
                    what,
                    "known are I and U of 1, 2, 4, 8 and F of 4, 8 bytes",
                )
            })?;
            places[axis] = Some((offset as usize, scalar, column as usize));
        }
        let width = sizes[i].checked_mul(counts[i]).filter(|&w| w > 0 && w <= RECORD_LIMIT);
        let total = width.map(|w| offset + w).filter(|&t| t <= RECORD_LIMIT);
        offset = total.ok_or_else(|| {
            let what = format!("field {name} has SIZE {} COUNT {}, which cannot be", sizes[i], counts[i]);
            Error::malformed(&input.path, "header", what, HINT_HEADER)
        })?;
        column += counts[i];
    }
    let [Some(x), Some(y), Some(z)] = places else {
        let what = format!("the fields are {}: x, y and z are needed", fields.join(" "));
        return Err(Error::malformed(&input.path, "header", what, "export the cloud with its coordinates"));
    };
    let (points, points_from) = match (points, width, height) {
        (Some(n), _, _) if n > 0 => (n, "POINTS says"),
        (_, Some(w), Some(h)) => (w.saturating_mul(h), "WIDTH x HEIGHT says"),
        (Some(n), _, _) => (n, "POINTS says"),
        _ => {
            let what = "neither POINTS nor WIDTH and HEIGHT say how many points there are";
            return Err(Error::malformed(&input.path, "header", what, HINT_HEADER));
        }
    };
    Ok(Header {
        layout: XyzLayout { fields: [(x.0, x.1), (y.0, y.1), (z.0, z.1)], big_endian: false },
        columns: [x.2, y.2, z.2],
        words: column as usize,
        record: offset as usize,
        points,
        points_from,
        data,
    })
}

fn numbers<'a, R: Read>(
    input: &Input<R>,
    key: &str,
    words: impl Iterator<Item = std::borrow::Cow<'a, str>>,
) -> Result<Vec<u64>, Error> {
    words
        .map(|w| {
            let what = || format!("{key} has '{w}' where a whole number is expected");
            w.parse().map_err(|_| input.line_error(what(), HINT_HEADER))
        })
        .collect()
}

fn scalar(kind: &str, size: u64) -> Option<Scalar> {
    Some(match (kind, size) {
        ("I", 1) => Scalar::I8,
        ("I", 2) => Scalar::I16,
        ("I", 4) => Scalar::I32,
        ("I", 8) => Scalar::I64,
        ("U", 1) => Scalar::U8,
        ("U", 2) => Scalar::U16,
        ("U", 4) => Scalar::U32,
        ("U", 8) => Scalar::U64,
        ("F", 4) => Scalar::F32,
        ("F", 8) => Scalar::F64,
        _ => return None,
    })
}

fn too_few<R: Read>(input: &Input<R>, header: &Header, place: String, holds: u64) -> Error {
    let what = format!("{} {}, the file holds {holds}", header.points_from, header.points);
    Error::malformed(&input.path, place, what, HINT_INCOMPLETE)
}

fn read_ascii<R: Read>(mut input: Input<R>, header: &Header, sink: &mut PointSink) -> Result<(), Error> {
    sink.reserve(header.points.min(input.remaining() / 6 + 1));
    let mut line = Vec::new();
    let mut done = 0;
    while done < header.points {
        if !input.next_line(&mut line)? {
            return Err(too_few(&input, header, format!("line {}", input.line + 1), done));
        }
        let mut words = 0;
        let mut point = [f64::NAN; 3];
        for (column, word) in tokens(&line).enumerate() {
            words += 1;
            let Some(axis) = header.columns.iter().position(|&c| c == column) else { continue };
            point[axis] = text(word).parse().map_err(|_| {
                let what =
                    format!("'{}' stands where the number {} is expected", text(word), ["x", "y", "z"][axis]);
                input.line_error(what, "the header says DATA ascii; check that the body is text")
            })?;
        }
        if words == 0 {
            continue;
        }
        if words < header.words {
            let what = format!("the line has {words} of {} values", header.words);
            return Err(input.line_error(what, HINT_INCOMPLETE));
        }
        sink.push(point);
        done += 1;
    }
    Ok(())
}

fn read_binary<R: Read>(mut input: Input<R>, header: &Header, sink: &mut PointSink) -> Result<(), Error> {
    let holds = input.remaining() / header.record as u64;
    if holds < header.points {
        let place = format!("byte {}", input.len);
        return Err(too_few(&input, header, place, holds));
    }
    sink.reserve(header.points);
    let mut record = vec![0; header.record];
    for done in 0..header.points {
        if !input.fill(&mut record)? {
            let place = format!("byte {}", input.taken);
            return Err(too_few(&input, header, place, done));
        }
        sink.push(header.layout.read(&record));
    }
    Ok(())
}

/// The body is two little-endian u32 (compressed size, size) and one LZF block that holds the fields one after the
/// other, each for all points.
fn read_compressed<R: Read>(mut input: Input<R>, header: &Header, sink: &mut PointSink) -> Result<(), Error> {
    let start = input.taken;
    let mut sizes = [0; 8];
    if !input.fill(&mut sizes)? {
        return Err(too_few(&input, header, format!("byte {start}"), 0));
    }
    let size_at =
        |i: usize| u64::from(u32::from_le_bytes([sizes[i], sizes[i + 1], sizes[i + 2], sizes[i + 3]]));
    let (packed_len, len) = (size_at(0), size_at(4));
    let bad = |what: String| Error::malformed(&input.path, format!("byte {start}"), what, HINT_INCOMPLETE);
    if packed_len > input.remaining() {
        let what =
            format!("the compressed block has {packed_len} bytes, the file holds {}", input.remaining());
        return Err(bad(what));
    }
    let needed = header.points.saturating_mul(header.record as u64);
    if len < needed {
        let holds = len / header.record as u64;
        return Err(bad(format!(
            "{} {}, the compressed block holds {holds}",
            header.points_from, header.points
        )));
    }
    if len > lzf::largest_output(packed_len) {
        return Err(bad(format!("{packed_len} compressed bytes cannot hold the {len} bytes declared")));
    }
    if len > input.unpack_limit {
        return Err(bad(format!(
            "{len} bytes are declared, more than the {} allowed here",
            input.unpack_limit
        )));
    }
    let mut packed = vec![0; packed_len as usize];
    if !input.fill(&mut packed)? {
        return Err(Error::malformed(
            &input.path,
            format!("byte {start}"),
            "the file became shorter while it was read",
            HINT_INCOMPLETE,
        ));
    }
    let body = lzf::decompress(&packed, len as usize).map_err(|what| {
        Error::malformed(&input.path, format!("byte {}", start + 8), what, HINT_INCOMPLETE)
    })?;
    sink.reserve(header.points);
    let n = header.points as usize;
    for i in 0..n {
        // Field by field: what stands at byte `offset` of a record starts at byte `offset * n` of the block.
        sink.push(
            header
                .layout
                .fields
                .map(|(offset, scalar)| scalar.read(&body, offset * n + i * scalar.size(), false)),
        );
    }
    Ok(())
}
