//! ROS 2 messages written by hand, in either byte order.

/// A CDR message that grows.
pub(crate) struct Cdr {
    big: bool,
    bytes: Vec<u8>,
}

impl Cdr {
    pub(crate) fn new(big: bool) -> Self {
        Self { big, bytes: vec![0, u8::from(!big), 0, 0] }
    }

    fn number<const N: usize>(mut self, little: [u8; N]) -> Self {
        while !(self.bytes.len() - 4).is_multiple_of(N) {
            self.bytes.push(0xAA);
        }
        let mut v = little;
        if self.big {
            v.reverse();
        }
        self.bytes.extend(v);
        self
    }

    pub(crate) fn u8(self, v: u8) -> Self {
        self.number([v])
    }

    pub(crate) fn u32(self, v: u32) -> Self {
        self.number(v.to_le_bytes())
    }

    pub(crate) fn f64(self, v: f64) -> Self {
        self.number(v.to_le_bytes())
    }

    pub(crate) fn f64s(self, v: &[f64]) -> Self {
        v.iter().fold(self, |cdr, v| cdr.f64(*v))
    }

    pub(crate) fn string(self, v: &str) -> Self {
        let mut cdr = self.u32(v.len() as u32 + 1);
        cdr.bytes.extend(v.as_bytes());
        cdr.bytes.push(0);
        cdr
    }

    pub(crate) fn sequence(self, v: &[u8]) -> Self {
        let mut cdr = self.u32(v.len() as u32);
        cdr.bytes.extend(v);
        cdr
    }

    pub(crate) fn header(self, stamp_ns: i64, frame: &str) -> Self {
        let (s, ns) = (stamp_ns.div_euclid(1_000_000_000), stamp_ns.rem_euclid(1_000_000_000));
        self.u32(s as i32 as u32).u32(ns as u32).string(frame)
    }

    pub(crate) fn done(self) -> Vec<u8> {
        self.bytes
    }
}

/// A PointCloud2 with every part at choice.
#[derive(Clone, Debug)]
pub(crate) struct CloudMessage {
    pub(crate) big_cdr: bool,
    pub(crate) stamp_ns: i64,
    pub(crate) frame: String,
    pub(crate) height: u32,
    pub(crate) width: u32,
    /// Name, offset, datatype, count.
    pub(crate) fields: Vec<(String, u32, u8, u32)>,
    pub(crate) big_data: bool,
    pub(crate) point_step: u32,
    pub(crate) row_step: u32,
    pub(crate) data: Vec<u8>,
}

impl CloudMessage {
    /// The plain layout: x, y, z as little-endian float32, 12 bytes a point.
    pub(crate) fn plain(stamp_ns: i64, frame: &str, points: &[[f32; 3]]) -> Self {
        let fields = ["x", "y", "z"].iter().zip(0..).map(|(n, i)| ((*n).to_owned(), 4 * i, 7, 1)).collect();
        Self {
            big_cdr: false,
            stamp_ns,
            frame: frame.to_owned(),
            height: 1,
            width: points.len() as u32,
            fields,
            big_data: false,
            point_step: 12,
            row_step: 12 * points.len() as u32,
            data: points.iter().flatten().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }

    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut cdr = Cdr::new(self.big_cdr).header(self.stamp_ns, &self.frame);
        cdr = cdr.u32(self.height).u32(self.width).u32(self.fields.len() as u32);
        for (name, offset, datatype, count) in &self.fields {
            cdr = cdr.string(name).u32(*offset).u8(*datatype).u32(*count);
        }
        cdr = cdr.u8(u8::from(self.big_data)).u32(self.point_step).u32(self.row_step);
        cdr.sequence(&self.data).u8(1).done()
    }
}

/// nav_msgs/msg/Odometry, complete with covariances and twist.
pub(crate) fn odometry(stamp_ns: i64, frame: &str, child: &str, t: [f64; 3], q: [f64; 4]) -> Vec<u8> {
    Cdr::new(false)
        .header(stamp_ns, frame)
        .string(child)
        .f64s(&t)
        .f64s(&q)
        .f64s(&[0.5; 36])
        .f64s(&[9.0; 6])
        .f64s(&[0.25; 36])
        .done()
}

/// geometry_msgs/msg/PoseStamped.
pub(crate) fn pose_stamped(stamp_ns: i64, frame: &str, t: [f64; 3], q: [f64; 4]) -> Vec<u8> {
    Cdr::new(true).header(stamp_ns, frame).f64s(&t).f64s(&q).done()
}

/// One transform: stamp, parent, child, translation, rotation.
pub(crate) type Transform<'a> = (i64, &'a str, &'a str, [f64; 3], [f64; 4]);

/// tf2_msgs/msg/TFMessage.
pub(crate) fn tf(transforms: &[Transform<'_>]) -> Vec<u8> {
    let start = Cdr::new(false).u32(transforms.len() as u32);
    let each = |cdr: Cdr, (stamp, parent, child, t, q): &Transform<'_>| {
        cdr.header(*stamp, parent).string(child).f64s(t).f64s(q)
    };
    transforms.iter().fold(start, each).done()
}

/// The quaternion x y z w of a turn about z.
pub(crate) fn yaw(angle: f64) -> [f64; 4] {
    [0.0, 0.0, (angle / 2.0).sin(), (angle / 2.0).cos()]
}
