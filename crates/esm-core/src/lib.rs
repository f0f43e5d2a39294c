//! Efficient Segment Matching: where am I in this map, from LiDAR alone, on a CPU.
//!
//! After Tinchev, Penate-Sanchez and Fallon, *Learning to See the Wood for the Trees* (RA-L 2019). The modules are the
//! rooms of the pipeline, in the order the data flows through them:
//!
//! | room | in | out |
//! |---|---|---|
//! | [`accumulate`] | sweeps and their motion | [`LiveCloud`]: the last metres of travel in the newest sensor frame |
//! | [`segment`](mod@segment) | a cloud | ground, and what stands on it in [`Segment`](segment::Segment)s |
//! | [`describe`] | segments | a row of numbers and a quality each ([`Descriptor`]) |
//! | [`index`], [`matching`] | descriptors | the K nearest map segments of each as [`Candidate`](estimate::Candidate)s |
//! | [`estimate`] | candidates | places where many of them agree |
//! | [`verify`] | places | refined poses, and whether the points are really there |
//! | [`localizer`] | all of the above | a [`Localization`]: pose, covariance, evidence and an honest [`Verdict`] |
//! | [`sequence`] | the clouds of one robot | the same in the light of the clouds before, by their odometry |
//!
//! [`map`] builds and keeps the prior map, [`loops`] finds places that one recording passes twice. Points are f32 metres,
//! poses f64 and named by their frames: `pose_map_sensor` takes sensor coordinates to map coordinates. Frames have z up.
//! Nothing here reads recordings (that is `esm-io`), prints, or keeps global state; the same input gives the same bits with
//! any number of threads.
//!
//! ```
//! use std::sync::Arc;
//! use esm_core::{Accumulator, Config, Localizer, MapBuilder, PointCloud, Pose, Verdict, transform_point};
//!
//! # // Thirty boxes of different sizes on a plain, all visible all the time.
//! # let (mut site, mut state) = (Vec::new(), 7u32);
//! # let mut random = |most: f32| { state = state.wrapping_mul(1664525).wrapping_add(1013904223); (state >> 8) as f32 / (1 << 24) as f32 * most };
//! # for b in 0..30 {
//! #     let (x, y) = ((b % 6) as f32 * 12.0 - 20.0 + random(5.0), (b / 6) as f32 * 12.0 - 24.0 + random(5.0));
//! #     let size = [1.0 + random(3.0), 1.0 + random(3.0), 1.0 + random(2.0)].map(|s| (s / 0.2) as i32);
//! #     for i in 0..=size[0] { for j in 0..=size[1] { for k in 0..=size[2] {
//! #         if i == 0 || j == 0 || i == size[0] || j == size[1] { site.push([x + i as f32 * 0.2, y + j as f32 * 0.2, k as f32 * 0.2]); }
//! #     } } }
//! # }
//! # for i in -120..120 { for j in -120..120 { site.push([i as f32 * 0.4, j as f32 * 0.4, 0.0]); } }
//! # let sweep_at = |pose_map_sensor: &Pose| {
//! #     let to_sensor = pose_map_sensor.inverse();
//! #     PointCloud::try_new(site.iter().map(|p| transform_point(&to_sensor, *p)).collect()).unwrap()
//! # };
//! let config = Config::default();
//!
//! // Yesterday: a posed drive becomes a map.
//! let mut builder = MapBuilder::new(&config)?;
//! for step in 0..4 {
//!     let pose_map_sensor = Pose::translation(step as f64 * 2.0, 0.0, 1.7);
//!     builder.push_sweep(step as f64, &sweep_at(&pose_map_sensor), &pose_map_sensor)?;
//! }
//! let map = Arc::new(builder.finish()?); // map.write(path), Map::open(path)
//!
//! // Today: one sweep from somewhere in it, facing another way, with no idea where.
//! let truth = Pose::new([5.0, -3.0, 1.7].into(), [0.0, 0.0, 2.0].into());
//! let localizer = Localizer::new(map, &config)?;
//! let live = Accumulator::new(config.accumulate.clone())?.push(0.0, &sweep_at(&truth), None).unwrap();
//! let answer = localizer.localize(&live)?;
//! assert_eq!(answer.verdict, Verdict::Located);
//! let error = answer.pose_map_sensor.unwrap().inv_mul(&truth);
//! assert!(error.translation.vector.norm() < 0.2 && error.rotation.angle() < 0.02);
//! # Ok::<(), esm_core::Error>(())
//! ```

pub mod accumulate;
mod budget;
pub mod cloud;
pub mod config;
pub mod describe;
pub mod error;
pub mod estimate;
pub mod index;
pub mod localization;
pub mod localizer;
pub mod loops;
pub mod map;
pub mod matching;
pub mod odometry;
pub mod segment;
pub mod sequence;

mod verdict;
pub mod verify;

pub use accumulate::{AccumulateConfig, Accumulator, LiveCloud, Viewpoint};
pub use budget::BudgetConfig;
pub use cloud::{PointCloud, Pose, transform_point};
pub use config::Config;
pub use describe::{Descriptions, Descriptor};
pub use error::Error;
pub use localization::{Localization, MatchedSegment, Timings, Verdict};
pub use localizer::Localizer;
pub use loops::{LoopAnswer, LoopClosure, LoopFinder};
pub use map::{Map, MapBuilder};
pub use odometry::OdometryConfig;
pub use sequence::{SequenceConfig, SequenceLocalizer};
