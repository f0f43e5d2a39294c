//! `sensor_msgs/msg/PointCloud2`.

use std::path::Path;

use esm_core::PointCloud;

use super::cdr::{CdrReader, Header};
use crate::cloud::Scan;
use crate::cloud::sink::PointSink;
use crate::error::Error;
use crate::pose::seconds;
use crate::scalar::{Scalar, XyzLayout};

/// Most fields a cloud may declare.
const FIELD_LIMIT: u32 = 1024;

/// One cloud as recorded.
#[derive(Debug)]
pub(crate) struct RosCloud {
    pub(crate) header: Header,
    pub(crate) cloud: PointCloud,
    pub(crate) dropped: usize,
    /// One a point, where they were asked for and the cloud has a field `object_id`.
    pub(crate) labels: Vec<PointLabel>,
    /// One a point, where they were asked for and the cloud has a field `ring`.
    pub(crate) rings: Vec<u16>,
}

/// What to read of a cloud besides its points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Extras {
    pub(crate) labels: bool,
    pub(crate) rings: bool,
}

/// A `sensor_msgs/msg/PointCloud2` that comes as bytes, over a network, instead of in a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct CloudMessage {
    /// `header.stamp`, nanoseconds.
    pub stamp_ns: i64,
    /// `header.frame_id`.
    pub frame_id: String,
    /// The points.
    pub scan: Scan,
}

impl CloudMessage {
    /// Decodes the message from CDR; `name` stands for it in messages.
    ///
    /// # Errors
    /// [`Error::Malformed`] where it is cut short or contradicts itself.
    pub fn from_cdr(message: &[u8], name: &str) -> Result<Self, Error> {
        let RosCloud { header, cloud, dropped, .. } = decode(message, Extras::default()).map_err(|what| {
            let hint = "send one sensor_msgs/msg/PointCloud2 in CDR with its four bytes of encapsulation";
            Error::malformed(Path::new(name), "PointCloud2", what, hint)
        })?;
        let scan = Scan { cloud, dropped };
        Ok(Self { stamp_ns: header.stamp_ns, frame_id: header.frame_id, scan })
    }

    /// The time in seconds.
    pub fn stamp(&self) -> f64 {
        seconds(self.stamp_ns)
    }
}

/// What a point was hit on, as simulators tell it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointLabel {
    /// The object's number, 0 for the ground: the field `object_id`.
    pub object: u32,
    /// Its class: the field `class`, 255 where there is none.
    pub class: u8,
}

/// Where the fields stand that are read.
struct Fields {
    xyz: [(usize, Scalar); 3],
    object_id: Option<(usize, Scalar)>,
    class: Option<(usize, Scalar)>,
    ring: Option<(usize, Scalar)>,
}

/// Decodes a message. Points stand in `width` x `height` records of `point_step` bytes, rows `row_step` apart; x, y and z
/// may have any place and number type, other fields are skipped.
pub(crate) fn decode(message: &[u8], extras: Extras) -> Result<RosCloud, String> {
    let mut cdr = CdrReader::new(message)?;
    let header = Header::read(&mut cdr)?;
    let height = u64::from(cdr.u32()?);
    let width = u64::from(cdr.u32()?);
    let places = read_fields(&mut cdr)?;
    let big_endian = cdr.u8()? != 0;
    let point_step = u64::from(cdr.u32()?);
    let row_step = u64::from(cdr.u32()?);
    let data = cdr.byte_sequence()?;
    // is_dense follows; points are checked one by one instead of believing it.

    let points = width.saturating_mul(height);
    if points == 0 {
        let cloud = PointCloud::default();
        return Ok(RosCloud { header, cloud, dropped: 0, labels: Vec::new(), rings: Vec::new() });
    }
    let Fields { xyz, object_id, class, ring } = places?;
    let layout = XyzLayout { fields: xyz, big_endian };
    // Fields that do not lie inside the records are as good as missing.
    let inside = |field: Option<(usize, Scalar)>| {
        field.filter(|(at, kind)| at.checked_add(kind.size()).is_some_and(|end| end as u64 <= point_step))
    };
    let object_id = inside(object_id).filter(|_| extras.labels);
    let class = inside(class);
    let ring = inside(ring).filter(|_| extras.rings);
    let extent = layout.extent().ok_or("a field's offset is out of range")? as u64;
    if point_step < extent {
        return Err(format!("point_step is {point_step}, the coordinates reach to byte {extent}"));
    }
    let row = width * point_step;
    let row_step = match row_step {
        // Some drivers leave it empty; with one row it says nothing.
        0 => row,
        _ if height == 1 => row,
        step if step < row => {
            return Err(format!("row_step is {step}, {width} points of {point_step} bytes need {row}"));
        }
        step => step,
    };
    let needed = (height - 1).saturating_mul(row_step).saturating_add(row);
    if needed > data.len() as u64 {
        return Err(format!(
            "{width} x {height} points of {point_step} bytes need {needed} bytes of data, {} are there",
            data.len()
        ));
    }
    // All sizes are below data.len() from here on.
    let mut sink = PointSink::sensor_frame();
    sink.reserve(points);
    let (mut labels, mut rings) = (Vec::new(), Vec::new());
    for row_data in data.chunks(row_step as usize).take(height as usize) {
        for record in row_data[..row as usize].chunks_exact(point_step as usize) {
            let taken = sink.push(layout.read(record));
            if taken && let Some((at, kind)) = object_id {
                let object = kind.read(record, at, big_endian) as u32;
                let class = class.map_or(255, |(at, kind)| kind.read(record, at, big_endian) as u8);
                labels.push(PointLabel { object, class });
            }
            if taken && let Some((at, kind)) = ring {
                rings.push(kind.read(record, at, big_endian) as u16);
            }
        }
    }
    let (_, cloud, dropped) = sink.finish();
    Ok(RosCloud { header, cloud, dropped, labels, rings })
}

/// The point records of a message, one after the other, whatever their fields are.
pub(crate) fn records(message: &[u8]) -> Result<&[u8], String> {
    let mut cdr = CdrReader::new(message)?;
    Header::read(&mut cdr)?;
    let (_height, _width) = (cdr.u32()?, cdr.u32()?);
    // Whether there are x, y and z is no matter here.
    let _ = read_fields(&mut cdr)?;
    let _big_endian = cdr.u8()?;
    let (_point_step, _row_step) = (cdr.u32()?, cdr.u32()?);
    cdr.byte_sequence()
}

/// Reads the field list; the inner error says that x, y or z is missing, which an empty cloud may do without.
fn read_fields(cdr: &mut CdrReader<'_>) -> Result<Result<Fields, String>, String> {
    let n = cdr.u32()?;
    if n > FIELD_LIMIT {
        return Err(format!("{n} fields are declared, more than {FIELD_LIMIT}"));
    }
    let mut places: [Option<(usize, Scalar)>; 3] = [None; 3];
    let (mut object_id, mut class, mut ring) = (None, None, None);
    let mut names = Vec::new();
    for _ in 0..n {
        let name = cdr.string()?;
        let offset = cdr.u32()?;
        let datatype = cdr.u8()?;
        let _count = cdr.u32()?;
        if let Some(axis) = ["x", "y", "z"].iter().position(|a| *a == name)
            && places[axis].is_none()
        {
            let scalar = scalar(datatype)
                .ok_or_else(|| format!("field {name} has the datatype {datatype}, which is not known"))?;
            places[axis] = Some((offset as usize, scalar));
        }
        let place = || scalar(datatype).map(|scalar| (offset as usize, scalar));
        match name.as_str() {
            "object_id" if object_id.is_none() => object_id = place(),
            "class" if class.is_none() => class = place(),
            "ring" if ring.is_none() => ring = place(),
            _ => {}
        }
        names.push(name);
    }
    Ok(match places {
        [Some(x), Some(y), Some(z)] => Ok(Fields { xyz: [x, y, z], object_id, class, ring }),
        _ => Err(format!("the fields are [{}]: x, y and z are needed", names.join(", "))),
    })
}

/// The constants of `sensor_msgs/msg/PointField`.
fn scalar(datatype: u8) -> Option<Scalar> {
    Some(match datatype {
        1 => Scalar::I8,
        2 => Scalar::U8,
        3 => Scalar::I16,
        4 => Scalar::U16,
        5 => Scalar::I32,
        6 => Scalar::U32,
        7 => Scalar::F32,
        8 => Scalar::F64,
        _ => return None,
    })
}
