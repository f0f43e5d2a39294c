//! KITTI `.bin`: x, y, z, reflectance as little-endian f32, sixteen bytes a point, nothing else.

use std::io::Read;

use super::sink::PointSink;
use crate::error::{Error, HINT_INCOMPLETE};
use crate::input::Input;
use crate::scalar::{Scalar, XyzLayout};

const POINT: u64 = 16;

pub(super) fn read<R: Read>(mut input: Input<R>, sink: &mut PointSink) -> Result<(), Error> {
    input.refuse_empty()?;
    if !input.len.is_multiple_of(POINT) {
        return Err(Error::malformed(
            &input.path,
            format!("byte {}", input.len - input.len % POINT),
            format!(
                "a KITTI .bin holds 16 bytes a point, the file's {} bytes are no multiple of that",
                input.len
            ),
            HINT_INCOMPLETE,
        ));
    }
    let points = input.len / POINT;
    sink.reserve(points);
    let layout =
        XyzLayout { fields: [(0, Scalar::F32), (4, Scalar::F32), (8, Scalar::F32)], big_endian: false };
    let mut record = [0; POINT as usize];
    for i in 0..points {
        if !input.fill(&mut record)? {
            return Err(Error::malformed(
                &input.path,
                format!("byte {}", i * POINT),
                "the file became shorter while it was read",
                HINT_INCOMPLETE,
            ));
        }
        sink.push(layout.read(&record));
    }
    Ok(())
}
