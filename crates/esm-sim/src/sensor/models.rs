//! The sensors, with the geometry their makers publish.

/// Which directions a sensor measures, in its own frame (x forward, y left, z up).
#[derive(Clone, Copy, Debug)]
pub enum Scan {
    /// Turns about z, all lasers at every step.
    Spinning {
        /// Elevations from the lowest laser up, radians: the ring's number is the place in this list.
        elevations: fn(usize) -> f64,
        /// Number of lasers.
        lasers: usize,
        /// Steps of a turn.
        steps: usize,
    },
    /// Sweeps a line in the sensor's x-y plane, from `-field/2` to `field/2`, x forward.
    Line {
        /// Field of view, radians.
        field: f64,
        /// Beams of a line.
        beams: usize,
    },
}

/// A LiDAR as published.
#[derive(Clone, Copy, Debug)]
pub struct Sensor {
    /// Its name.
    pub name: &'static str,
    /// Where it looks.
    pub scan: Scan,
    /// Seconds a turn or line takes.
    pub period_s: f64,
    /// Seconds of the period in which it measures.
    pub active_s: f64,
    /// Nearest range, metres.
    pub min_range_m: f32,
    /// Farthest range that is given out, metres.
    pub max_range_m: f32,
    /// Range to a surface of 10 % reflectivity met head-on, metres.
    pub range_10_percent_m: f32,
    /// Standard deviation of a range, metres.
    pub noise_m: f32,
    /// Full divergence of a beam, radians.
    pub divergence_rad: f32,
    /// Where the figures are from.
    pub source: &'static str,
}

/// The sensors there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[allow(missing_docs)] // The names say it.
pub enum SensorModel {
    #[serde(rename = "HDL-64E")]
    Hdl64e,
    #[serde(rename = "HDL-32E")]
    Hdl32e,
    #[serde(rename = "VLP-16")]
    Vlp16,
    #[serde(rename = "OS1-64")]
    Os1_64,
    #[serde(rename = "LMS151")]
    Lms151,
    #[serde(rename = "LMS511")]
    Lms511,
}

/// Lower block 32 lasers from -24.33 to -8.83 degrees, 0.5 apart; upper block 32 from -8.33 to +2, 1/3 apart.
fn hdl64e(n: usize) -> f64 {
    let degrees = if n < 32 { -24.33 + 0.5 * n as f64 } else { -8.33 + (n - 32) as f64 / 3.0 };
    degrees.to_radians()
}

/// -30.67 to +10.67 degrees, 4/3 apart.
fn hdl32e(n: usize) -> f64 {
    (-30.67 + 4.0 / 3.0 * n as f64).to_radians()
}

/// -15 to +15 degrees, 2 apart.
fn vlp16(n: usize) -> f64 {
    (-15.0 + 2.0 * n as f64).to_radians()
}

/// 33.2 degrees in 64 even steps about the horizon.
fn os1_64(n: usize) -> f64 {
    (-16.6 + 33.2 / 63.0 * n as f64).to_radians()
}

impl SensorModel {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Hdl64e, Self::Hdl32e, Self::Vlp16, Self::Os1_64, Self::Lms151, Self::Lms511];

    /// Its figures.
    ///
    /// ```
    /// use esm_sim::{Scan, SensorModel};
    /// let Scan::Spinning { lasers, elevations, .. } = SensorModel::Vlp16.sensor().scan else { unreachable!() };
    /// assert_eq!(lasers, 16);
    /// assert_eq!(elevations(15).to_degrees().round(), 15.0);
    /// ```
    pub fn sensor(self) -> Sensor {
        let spinning = |elevations, lasers, steps| Scan::Spinning { elevations, lasers, steps };
        match self {
            Self::Hdl64e => Sensor {
                name: "HDL-64E",
                scan: spinning(hdl64e, 64, 2083),
                period_s: 0.1,
                active_s: 0.1,
                min_range_m: 0.9,
                max_range_m: 120.0,
                range_10_percent_m: 50.0,
                noise_m: 0.015,
                divergence_rad: 0.002,
                source: "Velodyne, HDL-64E S2 and S2.1 user's manual, rev. 4.07 (63-HDL64ES2): 1.333 M points/s, \
                         +2 to -8.33 deg at 1/3 and -8.83 to -24.33 deg at 1/2 deg, 50 m at 10 % and 120 m at 80 % \
                         reflectivity, accuracy below 2 cm, divergence 2 mrad, spin rate 10 Hz",
            },
            Self::Hdl32e => Sensor {
                name: "HDL-32E",
                scan: spinning(hdl32e, 32, 2170),
                period_s: 0.1,
                active_s: 0.1,
                min_range_m: 1.0,
                max_range_m: 80.0,
                range_10_percent_m: 35.0,
                noise_m: 0.02,
                divergence_rad: 0.0028,
                source: "Velodyne, HDL-32E user's manual 63-9113: 46.08 us a firing, +10.67 to -30.67 deg at 1.33 deg, 1 to \
                         80-100 m, accuracy 2 cm (one sigma at 25 m), divergence 2.79 mrad; its range at 10 % is not \
                         published: scaled from the HDL-64E",
            },
            Self::Vlp16 => Sensor {
                name: "VLP-16",
                scan: spinning(vlp16, 16, 1808),
                period_s: 0.1,
                active_s: 0.1,
                min_range_m: 0.5,
                max_range_m: 100.0,
                range_10_percent_m: 40.0,
                noise_m: 0.02,
                divergence_rad: 0.003,
                source: "Velodyne, VLP-16 user manual 63-9243 rev. E: 55.296 us a firing, 16 lasers 2 deg apart, range 100 m, \
                         accuracy typically 3 cm, divergence 3.0 mrad horizontally; its range at 10 % is not published: \
                         scaled from the HDL-64E",
            },
            Self::Os1_64 => Sensor {
                name: "OS1-64",
                scan: spinning(os1_64, 64, 1024),
                period_s: 0.1,
                active_s: 0.1,
                min_range_m: 0.8,
                max_range_m: 120.0,
                range_10_percent_m: 40.0,
                noise_m: 0.012,
                divergence_rad: 0.00227,
                source: "Ouster, OS1 gen 1 datasheet v1.6 (2019): 33.2 deg, 64 channels, 1024 x 10, 40 m at 10 % and 105 m at \
                         80 % reflectivity with a detection probability above 90 %, precision 1.2 cm (20-50 m), divergence \
                         0.13 deg FWHM",
            },
            Self::Lms151 => Sensor {
                name: "LMS151",
                scan: Scan::Line { field: 270f64.to_radians(), beams: 541 },
                period_s: 0.02,
                active_s: 0.015,
                min_range_m: 0.5,
                max_range_m: 50.0,
                range_10_percent_m: 18.0,
                noise_m: 0.012,
                divergence_rad: 0.015,
                source: "SICK, LMS1xx operating instructions 8012471 (ZN27, 2017): 270 deg at 0.5 deg and 50 Hz, 0.5-50 m, 18 m \
                         at 10 % remission, statistical error 12 mm, beam 8 mm + 15 mrad",
            },
            Self::Lms511 => Sensor {
                name: "LMS511",
                scan: Scan::Line { field: 190f64.to_radians(), beams: 571 },
                period_s: 0.02,
                active_s: 0.02 * 190.0 / 360.0,
                min_range_m: 0.7,
                max_range_m: 80.0,
                range_10_percent_m: 40.0,
                noise_m: 0.007,
                divergence_rad: 0.0119,
                source: "SICK, LMS5xx operating instructions 8013796 (ZM63, 2017): 190 deg at 0.333 deg and 50 Hz, to 80 m, 40 m \
                         at 10 % remission, statistical error 7 mm (1-10 m, standard resolution), beam of about 342 mm at \
                         30 m (standard resolution)",
            },
        }
    }
}

impl Sensor {
    /// Rays of one turn or line.
    pub fn rays(&self) -> usize {
        match self.scan {
            Scan::Spinning { lasers, steps, .. } => lasers * steps,
            Scan::Line { beams, .. } => beams,
        }
    }

    /// The directions, firing by firing: all beams of a firing leave at the same time.
    pub fn firings(&self) -> impl Iterator<Item = Firing> + use<> {
        let scan = self.scan;
        let elevations: Vec<(f64, f64)> = match scan {
            Scan::Spinning { elevations, lasers, .. } => {
                (0..lasers).map(|n| elevations(n).sin_cos()).collect()
            }
            Scan::Line { .. } => Vec::new(),
        };
        let firings = match scan {
            Scan::Spinning { steps, .. } => steps,
            Scan::Line { beams, .. } => beams,
        };
        (0..firings).map(move |n| match scan {
            Scan::Spinning { steps, .. } => {
                // Velodynes turn clockwise seen from above; a sweep starts and ends behind.
                let share = n as f64 / steps as f64;
                let (s, c) = (std::f64::consts::PI - std::f64::consts::TAU * share).sin_cos();
                let dirs = elevations.iter().map(|(se, ce)| [ce * c, ce * s, *se]).collect();
                Firing { share, dirs }
            }
            Scan::Line { field, beams } => {
                let share = n as f64 / (beams - 1) as f64;
                let (s, c) = (field * (share - 0.5)).sin_cos();
                Firing { share, dirs: vec![[c, s, 0.0]] }
            }
        })
    }
}

/// Beams that leave together.
#[derive(Clone, Debug)]
pub struct Firing {
    /// When, as a share (0 to 1) of the active time.
    pub share: f64,
    /// Unit directions in the sensor frame; the place in the list is the ring.
    pub dirs: Vec<[f64; 3]>,
}
