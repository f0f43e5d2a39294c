//! The sensors, with the geometry their makers publish.
//!
//! Each sensor's doc says where its figures are from. *Manual*: read in the maker's manual or data sheet that is named.
//! *Maker*: the maker's nominal figure, not seen again in the document itself. *Measured*: found in recordings. *Estimate*:
//! nobody publishes it. All directions are the nominal ones: real units are calibrated one by one and differ by some tenths
//! of a degree. Offsets between the lasers of a unit remain after calibration, part of the accuracy that makers tell: in
//! KITTI's scans the walls that 64 lasers see are half as thick again as one laser's noise makes them (measured).

use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use crate::hash::Key;

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
    /// From the frame of [`Scan`] to that in which points are told: identity but for [`turned`](Self::turned) sensors.
    pub turn: Rotation3<f64>,
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
    /// Standard deviation over the lasers of a unit of the offset that calibration leaves on a laser's ranges, metres.
    pub offset_m: f32,
    /// Which unit of its make it is: units differ in the offsets of their lasers.
    pub unit: u64,
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

/// Lower block 32 lasers from -24.33 to -8.83 degrees, 0.5 apart; upper block 32 from -8.33 to +2, 1/3 apart (maker). The
/// rings of KITTI's scans lie 0.334 degrees apart in the upper block (measured). A calibrated S2.1
/// (ros-drivers/velodyne, `params/64e_s2.1-sztaki.yaml`) spans 29.8 degrees, from -24.8 to +5.0: units differ that much.
fn hdl64e(n: usize) -> f64 {
    let degrees = if n < 32 { -24.33 + 0.5 * n as f64 } else { -8.33 + (n - 32) as f64 / 3.0 };
    degrees.to_radians()
}

/// -30.67 to +10.67 degrees, 4/3 apart: HDL-32E user's manual, section "Laser Firing Sequence", page 10; the same in
/// ros-drivers/velodyne, `params/32db.yaml`.
fn hdl32e(n: usize) -> f64 {
    (-30.67 + 4.0 / 3.0 * n as f64).to_radians()
}

/// -15 to +15 degrees, 2 apart: ros-drivers/velodyne, `params/VLP16db.yaml`, which are the manual's.
fn vlp16(n: usize) -> f64 {
    (-15.0 + 2.0 * n as f64).to_radians()
}

/// 33.2 degrees (data sheet) in 64 even steps about the horizon. The even steps are an estimate: real units say theirs in
/// their metadata, and every column of four beams is fanned out by some 6 degrees of azimuth, which is left out here.
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
            // Manual (HDL-64E S2 and S2.1, firmware 4.07): two blocks of 32 lasers, 10 Hz as delivered. Maker: points a second, range,
            // accuracy below 2 cm (one sigma), divergence. 64 x 2083 = 133,312 a turn. Estimate: noise, three quarters of the
            // accuracy; least range, the drivers' default.
            Self::Hdl64e => Sensor {
                name: "HDL-64E",
                scan: spinning(hdl64e, 64, 2083),
                turn: Rotation3::identity(),
                period_s: 0.1,
                active_s: 0.1,
                min_range_m: 0.9,
                max_range_m: 120.0,
                range_10_percent_m: 50.0,
                noise_m: 0.02,
                offset_m: 0.02,
                unit: 0,
                divergence_rad: 0.002,
                source: "Velodyne, HDL-64E S2 and S2.1 user's manual, firmware 4.07: 1.333 M points/s, +2 to -8.33 deg at 1/3 and \
                         -8.83 to -24.33 deg at 1/2 deg, 50 m at 10 % and 120 m at 80 % reflectivity, accuracy below 2 cm, \
                         divergence 2 mrad, 10 Hz; noise and least range are estimates",
            },
            // Manual (HDL-32E user's manual, Velodyne Acoustics): elevations, page 10; returns up to 100 m, figure 1; a spot 4 in wide and
            // 2 in tall at 100 ft, appendix D, page 23: 102 mm at 30.5 m less some 13 mm at the lens is 2.9 mrad. Maker: a turn of
            // all lasers every 46.08 us, accuracy 2 cm. Estimate: range at 10 %, scaled from the HDL-64E's by the farthest
            // ranges; least range: the manual says 5 cm, where carriers would be hit.
            Self::Hdl32e => Sensor {
                name: "HDL-32E",
                scan: spinning(hdl32e, 32, 2170),
                turn: Rotation3::identity(),
                period_s: 0.1,
                active_s: 0.1,
                min_range_m: 1.0,
                max_range_m: 100.0,
                range_10_percent_m: 35.0,
                noise_m: 0.02,
                offset_m: 0.015,
                unit: 0,
                divergence_rad: 0.0029,
                source: "Velodyne, HDL-32E user's manual: +10.67 to -30.67 deg at 1.33 deg (p. 10), to 100 m (fig. 1), spot of 4 x 2 in \
                         at 100 ft (app. D); 46.08 us a firing, accuracy 2 cm (one sigma at 25 m); its range at 10 % is not \
                         published: scaled from the HDL-64E",
            },
            // Manual (VLP-16 user manual 63-9243 rev. D): 55.296 us for all lasers, section 9.4, page 62: 1808.4 a turn of 0.1 s. Maker:
            // 100 m, accuracy typically 3 cm; divergence 3.0 mrad, the figure its manuals tell of this laser (table F-1 of the
            // VLS-128's). Estimates: range at 10 %, scaled from the HDL-64E's; noise, two thirds of the accuracy; least range.
            Self::Vlp16 => Sensor {
                name: "VLP-16",
                scan: spinning(vlp16, 16, 1808),
                turn: Rotation3::identity(),
                period_s: 0.1,
                active_s: 0.1,
                min_range_m: 0.5,
                max_range_m: 100.0,
                range_10_percent_m: 40.0,
                noise_m: 0.02,
                offset_m: 0.015,
                unit: 0,
                divergence_rad: 0.003,
                source: "Velodyne, VLP-16 user manual 63-9243: 55.296 us a firing (section 9.4), 16 lasers 2 deg apart, range 100 m, \
                         accuracy typically 3 cm, divergence 3.0 mrad horizontally; its range at 10 % is not published: \
                         scaled from the HDL-64E",
            },
            // Manual (OS1 data sheet, 2019): all but the turn of 1024 columns, one of the three it offers.
            Self::Os1_64 => Sensor {
                name: "OS1-64",
                scan: spinning(os1_64, 64, 1024),
                turn: Rotation3::identity(),
                period_s: 0.1,
                active_s: 0.1,
                min_range_m: 0.8,
                max_range_m: 120.0,
                range_10_percent_m: 40.0,
                noise_m: 0.015,
                offset_m: 0.01,
                unit: 0,
                divergence_rad: 0.00227,
                source: "Ouster, OS1 data sheet (2019): +16.6 to -16.6 deg, 64 channels, 1024 columns at 10 Hz, 0.8 to 40 m at 10 % and \
                         to 120 m at 80 % reflectivity, repeatability 1.5 cm (one sigma, SNR above 250), divergence 0.13 deg \
                         FWHM; even steps of elevation are an estimate",
            },
            // Manual (LMS1xx operating instructions 8012471): field, step, rate, ranges; beam of 0.015 rad and 8 mm, section 3.6.2, page
            // 28. SICK's support portal, "Measurement Errors LMSxxx": statistical error typically 12 mm. The mirror turns once a
            // line: 270 of 360 degrees are 15 of 20 ms.
            Self::Lms151 => Sensor {
                name: "LMS151",
                scan: Scan::Line { field: 270f64.to_radians(), beams: 541 },
                turn: Rotation3::identity(),
                period_s: 0.02,
                active_s: 0.015,
                min_range_m: 0.5,
                max_range_m: 50.0,
                range_10_percent_m: 18.0,
                noise_m: 0.012,
                offset_m: 0.0,
                unit: 0,
                divergence_rad: 0.015,
                source: "SICK, LMS1xx operating instructions 8012471 (ZN27, 2017): 270 deg at 0.5 deg and 50 Hz, 0.5-50 m, 18 m \
                         at 10 % remission, beam 8 mm + 15 mrad (section 3.6.2); statistical error 12 mm (SICK support portal)",
            },
            // Manual (LMS5xx operating instructions 8013796): steps and rates, section 3.6.3; beam of 0.011 rad and 13 mm at standard
            // resolution, section 3.5.2 of UL20 (342 mm at 30 m in ZM63, figure 15); field and ranges. SICK's support portal:
            // statistical error at standard resolution 6 mm to 10 m, 8 mm to 20 m, 14 mm to 30 m.
            Self::Lms511 => Sensor {
                name: "LMS511",
                scan: Scan::Line { field: 190f64.to_radians(), beams: 571 },
                turn: Rotation3::identity(),
                period_s: 0.02,
                active_s: 0.02 * 190.0 / 360.0,
                min_range_m: 0.7,
                max_range_m: 80.0,
                range_10_percent_m: 40.0,
                noise_m: 0.008,
                offset_m: 0.0,
                unit: 0,
                divergence_rad: 0.011,
                source: "SICK, LMS5xx operating instructions 8013796: 190 deg at 0.333 deg and 50 Hz, to 80 m, 40 m at 10 % remission, \
                         beam 13 mm + 11 mrad (standard resolution); statistical error 8 mm (10-20 m, SICK support portal)",
            },
        }
    }
}

impl Sensor {
    /// The same sensor turned in the frame its points are told in. A push-broom scanner stands upright, its plane across the
    /// way; its points are told x forward, z up all the same, as its drivers and carriers tell them.
    ///
    /// ```
    /// use esm_sim::SensorModel;
    /// use nalgebra::UnitQuaternion;
    /// let upright = UnitQuaternion::from_euler_angles(0.0, -std::f64::consts::FRAC_PI_2, 0.0);
    /// let scanner = SensorModel::Lms151.sensor().turned(upright);
    /// let middle = scanner.firings().nth(270).ok_or("no beam")?;
    /// assert!((middle.dirs[0][2] - 1.0).abs() < 1e-9, "the middle beam looks up");
    /// # Ok::<(), &str>(())
    /// ```
    pub fn turned(self, rotation: UnitQuaternion<f64>) -> Self {
        Self { turn: rotation.to_rotation_matrix() * self.turn, ..self }
    }

    /// The offset on the ranges of each of its lasers, metres; the place in the list is the ring.
    pub fn offsets(&self) -> Vec<f32> {
        let lasers = match self.scan {
            Scan::Spinning { lasers, .. } => lasers,
            Scan::Line { .. } => 1,
        };
        let key = Key::new(self.unit).with(0x1A5E);
        (0..lasers).map(|n| self.offset_m * key.with(n as u64).draw().normal()).collect()
    }

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
        let turn = self.turn;
        let turned = move |dir: [f64; 3]| (turn * Vector3::from(dir)).into();
        (0..firings).map(move |n| match scan {
            Scan::Spinning { steps, .. } => {
                // Velodynes turn clockwise seen from above; a sweep starts and ends behind.
                let share = n as f64 / steps as f64;
                let (s, c) = (std::f64::consts::PI - std::f64::consts::TAU * share).sin_cos();
                let dirs = elevations.iter().map(|(se, ce)| turned([ce * c, ce * s, *se])).collect();
                Firing { share, dirs }
            }
            Scan::Line { field, beams } => {
                let share = n as f64 / (beams - 1) as f64;
                let (s, c) = (field * (share - 0.5)).sin_cos();
                Firing { share, dirs: vec![turned([c, s, 0.0])] }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn elevations(model: SensorModel) -> Vec<f64> {
        match model.sensor().scan {
            Scan::Spinning { elevations, lasers, .. } => {
                (0..lasers).map(|n| elevations(n).to_degrees()).collect()
            }
            Scan::Line { .. } => Vec::new(),
        }
    }

    /// The angles that makers print, rounded as they print them, from the lowest laser up.
    #[test]
    fn elevations_are_the_published_ones() {
        let hdl32e = [
            -30.67, -29.33, -28.0, -26.66, -25.33, -24.0, -22.67, -21.33, -20.0, -18.67, -17.33, -16.0,
            -14.67, -13.33, -12.0, -10.67, -9.33, -8.0, -6.66, -5.33, -4.0, -2.67, -1.33, 0.0, 1.33, 2.67,
            4.0, 5.33, 6.67, 8.0, 9.33, 10.67,
        ];
        for (ours, printed) in elevations(SensorModel::Hdl32e).iter().zip(hdl32e) {
            assert!((ours - printed).abs() < 0.015, "{ours} {printed}");
        }
        let vlp16 = [-15, -13, -11, -9, -7, -5, -3, -1, 1, 3, 5, 7, 9, 11, 13, 15];
        for (ours, printed) in elevations(SensorModel::Vlp16).iter().zip(vlp16) {
            assert!((ours - f64::from(printed)).abs() < 1e-9);
        }
        let hdl64e = elevations(SensorModel::Hdl64e);
        for (laser, printed) in [(0, -24.33), (31, -8.83), (32, -8.33), (63, 2.0)] {
            assert!((hdl64e[laser] - printed).abs() < 0.005, "{laser}: {}", hdl64e[laser]);
        }
        for model in SensorModel::ALL {
            assert!(elevations(model).windows(2).all(|w| w[0] < w[1]), "{model:?} goes up");
        }
    }

    /// A unit's lasers are off as much as they are said to be, each for good and every unit in its own way.
    #[test]
    fn lasers_have_offsets() {
        let unit = |unit| Sensor { unit, ..SensorModel::Hdl64e.sensor() };
        let offsets: Vec<f32> = (0..50).flat_map(|n| unit(n).offsets()).collect();
        let rms = (offsets.iter().map(|o| o * o).sum::<f32>() / offsets.len() as f32).sqrt();
        assert!((rms / unit(0).offset_m - 1.0).abs() < 0.05, "{rms} m");
        assert_eq!(unit(3).offsets(), unit(3).offsets());
        assert_ne!(unit(3).offsets(), unit(4).offsets());
    }

    /// Points a second without losses, as published: 1.333 M, 700 k (rounded), 300 k (rounded), 655,360, and 541 and 571 beams
    /// at 50 Hz.
    #[test]
    fn rates_are_the_published_ones() {
        for (model, rate) in [
            (SensorModel::Hdl64e, 1.333e6),
            (SensorModel::Hdl32e, 0.695e6),
            (SensorModel::Vlp16, 0.29e6),
            (SensorModel::Os1_64, 655_360.0),
            (SensorModel::Lms151, 27_050.0),
            (SensorModel::Lms511, 28_550.0),
        ] {
            let sensor = model.sensor();
            let ours = sensor.rays() as f64 / sensor.period_s;
            assert!((ours / rate - 1.0).abs() < 0.005, "{model:?}: {ours}");
            assert_eq!(sensor.firings().map(|f| f.dirs.len()).sum::<usize>(), sensor.rays());
        }
    }
}
