//! Pose graphs in g2o's text format.

use std::io::{self, Write};

use esm_core::Pose;
use nalgebra::{Matrix6, Vector6};

/// Assumed growth of the odometry's error with travel, per square root of a metre: the random walk of a car's or a
/// walking robot's odometry, good to one or two per cent over 10 m. Only the weights between edges depend on it.
const ODOMETRY_SIGMA_M: f64 = 0.05;
/// The same for turns, radians.
const ODOMETRY_SIGMA_RAD: f64 = 0.005;
/// Shortest step that is told apart from standing still, metres: keeps the information finite.
const LEAST_STEP_M: f64 = 0.1;

/// Writes `VERTEX_SE3:QUAT` and `EDGE_SE3:QUAT` lines as they come.
pub(crate) struct G2o<W> {
    out: W,
    vertices: usize,
    last: Option<Pose>,
}

impl<W: Write> G2o<W> {
    pub(crate) fn new(out: W) -> Self {
        Self { out, vertices: 0, last: None }
    }

    /// The next pose of the odometry, with the edge from the one before. Gives the vertex's number.
    pub(crate) fn vertex(&mut self, pose_odom_sensor: &Pose) -> io::Result<usize> {
        let number = self.vertices;
        writeln!(self.out, "VERTEX_SE3:QUAT {number} {}", numbers(pose_odom_sensor))?;
        if number == 0 {
            writeln!(self.out, "FIX 0")?;
        }
        if let Some(last) = self.last {
            let step = last.inv_mul(pose_odom_sensor);
            let metres = step.translation.vector.norm().max(LEAST_STEP_M);
            let (m2, rad2) = (ODOMETRY_SIGMA_M.powi(2) * metres, ODOMETRY_SIGMA_RAD.powi(2) * metres);
            let covariance = Matrix6::from_diagonal(&Vector6::new(m2, m2, m2, rad2, rad2, rad2));
            self.edge(number - 1, number, &step, &covariance)?;
        }
        self.last = Some(*pose_odom_sensor);
        self.vertices += 1;
        Ok(number)
    }

    /// An edge; the covariance in m and rad, of a right perturbation of `pose_from_to`, as [`esm_core::Localization`]
    /// has it. One that cannot be inverted gives the edge no weight.
    pub(crate) fn edge(
        &mut self,
        from: usize,
        to: usize,
        pose_from_to: &Pose,
        covariance: &Matrix6<f64>,
    ) -> io::Result<()> {
        write!(self.out, "EDGE_SE3:QUAT {from} {to} {}", numbers(pose_from_to))?;
        let information = information(covariance);
        for row in 0..6 {
            for column in row..6 {
                write!(self.out, " {}", information[(row, column)])?;
            }
        }
        writeln!(self.out)
    }

    /// The file, complete.
    pub(crate) fn into_inner(self) -> W {
        self.out
    }
}

/// g2o's error of a turn is the vector part of its quaternion, half of the rotation vector we speak of.
fn information(covariance: &Matrix6<f64>) -> Matrix6<f64> {
    let half = Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, 0.5, 0.5, 0.5));
    let symmetric = 0.5 * (covariance + covariance.transpose());
    (half * symmetric * half).cholesky().map_or_else(Matrix6::zeros, |c| c.inverse())
}

fn numbers(pose: &Pose) -> String {
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    format!("{} {} {} {} {} {} {}", t.x, t.y, t.z, q.x, q.y, q.z, q.w)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph() -> String {
        let mut g = G2o::new(Vec::new());
        g.vertex(&Pose::identity()).unwrap();
        g.vertex(&Pose::translation(1.0, 0.0, 0.0)).unwrap();
        let mut covariance = Matrix6::from_diagonal(&Vector6::new(0.25, 1.0, 1.0, 0.01, 0.01, 0.04));
        covariance[(0, 5)] = 0.01;
        covariance[(5, 0)] = 0.01;
        g.edge(1, 0, &Pose::translation(-1.0, 0.0, 0.0), &covariance).unwrap();
        String::from_utf8(g.into_inner()).unwrap()
    }

    #[test]
    fn lines_have_g2os_shape() {
        let text = graph();
        let lines: Vec<Vec<&str>> = text.lines().map(|l| l.split(' ').collect()).collect();
        assert_eq!(
            lines.iter().map(|l| l[0]).collect::<Vec<_>>(),
            ["VERTEX_SE3:QUAT", "FIX", "VERTEX_SE3:QUAT", "EDGE_SE3:QUAT", "EDGE_SE3:QUAT"]
        );
        assert_eq!(lines[0].len(), 9);
        assert_eq!(lines[3].len(), 3 + 7 + 21);
        assert_eq!(lines[3][1..10], ["0", "1", "1", "0", "0", "0", "0", "0", "1"]);
    }

    #[test]
    fn information_is_of_half_the_rotation_vector() {
        let text = graph();
        let last = text.lines().last().unwrap();
        let upper: Vec<f64> = last.split(' ').skip(10).map(|v| v.parse().unwrap()).collect();
        // x and half rz: covariance [[0.25, 0.005], [0.005, 0.01]].
        let det = 0.25 * 0.01 - 0.005 * 0.005;
        assert!((upper[0] - 0.01 / det).abs() < 1e-9, "xx");
        assert!((upper[5] + 0.005 / det).abs() < 1e-9, "x qz");
        assert!((upper[20] - 0.25 / det).abs() < 1e-9, "qz qz");
        assert!((upper[15] - 1.0 / (0.01 * 0.25)).abs() < 1e-6, "qx qx");
    }

    #[test]
    fn a_covariance_that_is_none_gives_no_weight() {
        assert_eq!(information(&-Matrix6::identity()), Matrix6::zeros());
    }
}
