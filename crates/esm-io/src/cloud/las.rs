//! LAS and LAZ by the `las` crate, behind checks of what a header may ask for.
//!
//! `las` 0.11 multiplies the point count by the record length and allocates an extended record's declared length without
//! looking at the file's size, so both are compared with it first. Coordinates are scaled and shifted in f64.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use las::raw;

use super::laz_guard;
use super::sink::PointSink;
use crate::error::{Error, HINT_INCOMPLETE};
use crate::input::Input;

/// Points decoded at once.
const BATCH: u64 = 4096;

/// Bytes of an extended variable length record before its data; its length stands at byte 20.
const EVLR_HEADER: u64 = 60;

/// Bytes of a variable length record before its data.
const VLR_HEADER: u64 = 54;

const HINT_LAS: &str = "check that this is a LAS or LAZ file of version 1.0 to 1.4";

pub(super) fn read(mut input: Input, sink: &mut PointSink) -> Result<(), Error> {
    let path = input.path.clone();
    let declared = check_header(&mut input)?;
    // What the checks let through can still be a damaged stream that trips an assertion of the decoder.
    let decoded = catch_unwind(AssertUnwindSafe(|| decode(&path, input.reader, declared, sink)));
    decoded.unwrap_or_else(|_| {
        let what = "the compressed points are damaged: the decoder gave up";
        Err(Error::malformed(&path, "points", what, HINT_INCOMPLETE))
    })
}

fn decode(path: &Path, file: BufReader<File>, declared: u64, sink: &mut PointSink) -> Result<(), Error> {
    let mut reader = las::Reader::new(file).map_err(|e| las_error(path, "header", &e))?;
    sink.reserve(declared);
    let mut batch = las::PointDataBuilder::new().for_header(reader.header()).build();
    let mut done = 0;
    while done < declared {
        let n = reader.fill_points(BATCH.min(declared - done), &mut batch).map_err(|e| {
            let what = format!(
                "the header says {declared} points, the file ends or is damaged soon after {done} ({e})"
            );
            Error::malformed(path, format!("point {}", done + 1), what, HINT_INCOMPLETE)
        })?;
        if n == 0 {
            let what = format!("the header says {declared} points, the file holds {done}");
            return Err(Error::malformed(path, format!("point {}", done + 1), what, HINT_INCOMPLETE));
        }
        for ((x, y), z) in batch.x().zip(batch.y()).zip(batch.z()) {
            sink.push([x, y, z]);
        }
        done += n;
    }
    Ok(())
}

fn las_error(path: &Path, place: &str, error: &las::Error) -> Error {
    let ends = match error {
        las::Error::Io(e) => e.kind() == std::io::ErrorKind::UnexpectedEof,
        // `laz` wraps the same error in a type that `las` does not pass on, and that gives no source: its text is left.
        las::Error::LasZipError(e) => e.to_string().ends_with("failed to fill whole buffer"),
        _ => false,
    };
    if ends {
        let what = "the file is cut short: it ends inside its header, its variable length records or its chunk table";
        return Error::malformed(path, place, what, HINT_INCOMPLETE);
    }
    Error::malformed(path, place, error.to_string(), HINT_LAS)
}

/// Reads the header for itself, compares it with the file's length, and rewinds. Returns the number of points.
fn check_header(input: &mut Input) -> Result<u64, Error> {
    let path = input.path.clone();
    let bad = |what: String, hint: &str| Error::malformed(&path, "header", what, hint);
    input.refuse_empty()?;
    let header = match raw::Header::read_from(&mut input.reader) {
        Ok(header) => header,
        Err(las::Error::Io(e)) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            let what = format!("the file ends inside the header, after {} bytes", input.len);
            return Err(bad(what, HINT_INCOMPLETE));
        }
        Err(las::Error::Io(e)) => return Err(Error::io(&path, "reading", e)),
        Err(e) => return Err(las_error(&path, "header", &e)),
    };
    let start = u64::from(header.offset_to_point_data);
    if start > input.len {
        let what = format!("the points start at byte {start}, the file has {}", input.len);
        return Err(bad(what, HINT_INCOMPLETE));
    }
    // Records may be less tightly packed, never more.
    let (records, size) = (header.number_of_variable_length_records, u64::from(header.header_size));
    if u64::from(records) * VLR_HEADER > start.saturating_sub(size) {
        let what = format!(
            "the header says {records} variable length records, the {} bytes before the points cannot hold them",
            start.saturating_sub(size)
        );
        return Err(bad(what, HINT_INCOMPLETE));
    }
    let points = match (header.number_of_point_records, header.large_file) {
        (0, Some(large)) => large.number_of_point_records,
        (n, _) => u64::from(n),
    };
    let record = u64::from(header.point_data_record_length);
    let compressed = header.point_data_record_format & 0x80 != 0;
    let bytes = points.checked_mul(record);
    let holds = (input.len - start) / record.max(1);
    if record == 0 || bytes.is_none() || (!compressed && holds < points) {
        return Err(bad(format!("the header says {points} points, the file holds {holds}"), HINT_INCOMPLETE));
    }
    let scales = [header.x_scale_factor, header.y_scale_factor, header.z_scale_factor];
    let offsets = [header.x_offset, header.y_offset, header.z_offset];
    if !scales.iter().chain(&offsets).all(|v| v.is_finite()) || scales.contains(&0.0) {
        return Err(bad(format!("scales {scales:?} and offsets {offsets:?} give no coordinates"), HINT_LAS));
    }
    if let Some(evlr) = header.evlr {
        let from = evlr.start_of_first_evlr;
        let data = from
            .checked_add(EVLR_HEADER)
            .filter(|&end| end <= input.len)
            .map(|_| evlr_length(input, from))
            .transpose()?;
        let inside = data.and_then(|d| d.checked_add(from + EVLR_HEADER)).is_some_and(|end| end <= input.len);
        if !inside {
            let what =
                format!("the extended record at byte {from} reaches beyond the file's {} bytes", input.len);
            return Err(bad(what, HINT_INCOMPLETE));
        }
    }
    rewind(input)?;
    if compressed {
        let record_length = header.point_data_record_length;
        // Also reads the extended records, whose lengths are known to be good by now.
        let header = las::Header::new(&mut input.reader).map_err(|e| las_error(&path, "header", &e))?;
        let Some(laszip) = header.vlrs().iter().find(|v| las::laz::is_laszip_vlr(v)) else {
            return Err(bad(
                "the points are compressed and the laszip record is missing".to_owned(),
                HINT_LAS,
            ));
        };
        laz_guard::check(input, &laszip.data, start, record_length, points)
            .map_err(|e| Error::io(&path, "reading", e))?
            .map_err(|what| Error::malformed(&path, "compressed points", what, HINT_INCOMPLETE))?;
        rewind(input)?;
    }
    Ok(points)
}

fn rewind(input: &mut Input) -> Result<(), Error> {
    input.reader.seek(SeekFrom::Start(0)).map_err(|e| Error::io(&input.path, "reading", e))?;
    Ok(())
}

fn evlr_length(input: &mut Input, from: u64) -> Result<u64, Error> {
    let mut header = [0; EVLR_HEADER as usize];
    let read = input.reader.seek(SeekFrom::Start(from)).and_then(|_| input.reader.read_exact(&mut header));
    read.map_err(|e| Error::io(&input.path, "reading", e))?;
    let mut length = [0; 8];
    length.copy_from_slice(&header[20..28]);
    Ok(u64::from_le_bytes(length))
}
