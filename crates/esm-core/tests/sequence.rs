//! Clouds of one robot, one after the other: what the odometry adds, and what it must not do.
#![allow(clippy::unwrap_used)] // What a test makes is there.

use std::sync::Arc;

use esm_core::{
    Accumulator, Config, LiveCloud, Localizer, MapBuilder, PointCloud, Pose, SequenceLocalizer, Verdict,
    transform_point,
};

/// Boxes on a plain: corners and sizes in metres.
struct Site {
    points: Vec<[f32; 3]>,
}

impl Site {
    fn new(boxes: &[([f32; 2], [f32; 3])]) -> Self {
        let mut points = Vec::new();
        for ([x, y], size) in boxes {
            let n = size.map(|s| (s / 0.2) as i32);
            for i in 0..=n[0] {
                for j in 0..=n[1] {
                    if i == 0 || j == 0 || i == n[0] || j == n[1] {
                        points.extend(
                            (0..=n[2])
                                .map(|k| [x + i as f32 * 0.2, y + j as f32 * 0.2, k as f32 * 0.2 + 0.1]),
                        );
                    }
                }
            }
        }
        for i in -200..200 {
            points.extend((-150..150).map(|j| [i as f32 * 0.4, j as f32 * 0.4, 0.0]));
        }
        Self { points }
    }

    /// Boxes of many sizes at odd places.
    fn various() -> Self {
        let mut state = 7u32;
        let mut random = |most: f32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 * most
        };
        let boxes: Vec<_> = (0..60)
            .map(|b| {
                let at = [
                    (b % 10) as f32 * 12.0 - 60.0 + random(5.0),
                    (b / 10) as f32 * 12.0 - 36.0 + random(5.0),
                ];
                (at, [1.0 + random(3.0), 1.0 + random(3.0), 1.0 + random(2.0)])
            })
            .collect();
        Self::new(&boxes)
    }

    /// The same box again and again, in rows.
    fn alike() -> Self {
        let boxes: Vec<_> = (0..200)
            .map(|b| ([(b % 20) as f32 * 6.0 - 60.0, (b / 20) as f32 * 6.0 - 30.0], [1.2, 1.2, 2.0]))
            .collect();
        Self::new(&boxes)
    }

    fn sweep(&self, pose_map_sensor: &Pose, range_m: f32) -> PointCloud {
        let to_sensor = pose_map_sensor.inverse();
        let points = self.points.iter().map(|p| transform_point(&to_sensor, *p));
        let near = points.filter(|p| p[0].hypot(p[1]) < range_m).collect();
        PointCloud::try_new(near).unwrap()
    }

    fn robot(&self, config: &Config) -> SequenceLocalizer {
        let mut builder = MapBuilder::new(config).unwrap();
        for step in 0..30 {
            let pose = Pose::translation(f64::from(step) * 2.0 - 30.0, 0.0, 1.7);
            builder.push_sweep(f64::from(step), &self.sweep(&pose, 45.0), &pose).unwrap();
        }
        SequenceLocalizer::new(Localizer::new(Arc::new(builder.finish().unwrap()), config).unwrap())
    }
}

fn config() -> Config {
    let mut config = Config::default();
    config.accumulate.distance_m = 0.0;
    config
}

/// Where the robot is, and what its odometry says: another frame, and a drift of one percent.
fn drive(steps: usize) -> Vec<(Pose, Pose)> {
    let odom_map = Pose::new([100.0, -40.0, 3.0].into(), [0.0, 0.0, 1.1].into());
    (0..steps)
        .map(|i| {
            let x = i as f64 * 1.5 - 20.0;
            let truth = Pose::new([x, 0.7, 1.7].into(), [0.0, 0.0, 0.1].into());
            let drifted = Pose::new([x * 1.01, 0.7, 1.7].into(), [0.0, 0.0, 0.1].into());
            (truth, odom_map * drifted)
        })
        .collect()
}

fn cloud(site: &Site, config: &Config, truth: &Pose, odom: Option<Pose>, range_m: f32) -> LiveCloud {
    let mut accumulator = Accumulator::new(config.accumulate.clone()).unwrap();
    accumulator.push(0.0, &site.sweep(truth, range_m), odom).unwrap()
}

fn error_m(found: &Pose, truth: &Pose) -> f64 {
    (found.translation.vector - truth.translation.vector).norm()
}

#[test]
fn the_motion_helps_where_a_cloud_alone_says_too_little() {
    let (config, site) = (config(), Site::various());
    let mut robot = site.robot(&config);
    // In the middle of the drive the robot sees little.
    let range_m = |i: usize| if (5..15).contains(&i) { 11.0 } else { 30.0 };
    let (mut alone, mut together) = (0, 0);
    for (i, (truth, odom)) in drive(20).into_iter().enumerate() {
        let live = cloud(&site, &config, &truth, Some(odom), range_m(i));
        alone += usize::from(robot.localizer().localize(&live).unwrap().verdict == Verdict::Located);
        let answer = robot.localize(&live).unwrap();
        if answer.verdict == Verdict::Located {
            together += 1;
            assert!(error_m(&answer.pose_map_sensor.unwrap(), &truth) < 0.3, "cloud {i}");
        }
    }
    assert!(alone >= 9, "{alone} of 20 alone");
    assert!(together > alone, "{together} of 20 with the motion, {alone} alone");
}

#[test]
fn a_robot_that_was_carried_elsewhere_is_not_held_to_where_it_was() {
    let (config, site) = (config(), Site::various());
    let mut robot = site.robot(&config);
    let steps = drive(14);
    for (truth, odom) in &steps[..4] {
        let answer = robot.localize(&cloud(&site, &config, truth, Some(*odom), 30.0)).unwrap();
        assert_eq!(answer.verdict, Verdict::Located);
    }
    // The odometry goes on from where it was, the robot from ten metres to the side and turned about.
    let carried = Pose::new([0.0, 9.0, 0.0].into(), [0.0, 0.0, 3.0].into());
    let mut located = 0;
    for (truth, odom) in &steps[4..] {
        let elsewhere =
            Pose::translation(0.0, 9.0, 0.0) * truth * Pose::rotation(carried.rotation.scaled_axis());
        let answer = robot.localize(&cloud(&site, &config, &elsewhere, Some(*odom), 30.0)).unwrap();
        if answer.verdict == Verdict::Located {
            located += 1;
            assert!(error_m(&answer.pose_map_sensor.unwrap(), &elsewhere) < 0.3);
        }
    }
    robot.forget();
    let (truth, odom) = &steps[0];
    let answer = robot.localize(&cloud(&site, &config, truth, Some(*odom), 30.0)).unwrap();
    assert_eq!(answer.verdict, Verdict::Located, "after forgetting, {located} before");
}

#[test]
fn rows_of_the_same_thing_are_never_believed_in_the_wrong_place() {
    let (config, site) = (config(), Site::alike());
    let mut robot = site.robot(&config);
    for (i, (truth, odom)) in drive(12).into_iter().enumerate() {
        let answer = robot.localize(&cloud(&site, &config, &truth, Some(odom), 20.0)).unwrap();
        if answer.verdict == Verdict::Located {
            let off = error_m(&answer.pose_map_sensor.unwrap(), &truth);
            assert!(off < 2.0, "cloud {i} is {off:.1} m off");
        }
    }
}

#[test]
fn without_motion_every_cloud_stands_for_itself() {
    let (config, site) = (config(), Site::various());
    let mut robot = site.robot(&config);
    for (truth, _) in drive(4) {
        let live = cloud(&site, &config, &truth, None, 30.0);
        let (alone, together) = (robot.localizer().localize(&live).unwrap(), robot.localize(&live).unwrap());
        assert_eq!(alone.pose_map_sensor, together.pose_map_sensor);
        assert_eq!((alone.verdict, alone.inliers), (together.verdict, together.inliers));
    }
}
