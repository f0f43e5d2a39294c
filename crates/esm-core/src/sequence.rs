//! [`SequenceLocalizer`]: cloud after cloud of one robot, held together by its odometry.
//!
//! Every cloud is looked for in the whole map, as by [`Localizer`]. The odometry adds two things: where a place that was
//! believed before must be by now is verified too, and of places that look alike those stay that agree with the motion.
//! A belief is a place with the chance that it is a false one. Only a cloud that would do by itself starts one or lowers
//! the chance: what resembles the map a little does so for many clouds on end. While later clouds say less, or nothing,
//! the chance rises with the travel.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::accumulate::LiveCloud;
use crate::cloud::Pose;
use crate::error::{Error, require};
use crate::localization::{Localization, Verdict};
use crate::localizer::{Localizer, Look};
use crate::verdict::{Judged, covariance, judge, rival};

/// Beliefs kept at most, the likeliest: each costs a verification a cloud.
const MOST_BELIEFS: usize = 4;
/// Chance that is left to a place which another one in the same cloud rivals.
const RIVALLED: f64 = 0.5;
/// A belief whose rival is likelier than this many times its own chance of being false is not ambiguous.
const RIVAL_RATIO: f64 = 100.0;
/// Share of the points that must fit where a belief is confirmed.
const CONFIRM_OVERLAP: f64 = 0.6;
/// No evidence makes a chance smaller than this.
const LEAST_CHANCE: f64 = 1e-8;

/// Configuration of sequences.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct SequenceConfig {
    /// Error of the odometry, metres a metre of travel.
    pub drift: f64,
    /// A place agrees with the motion when it lies this near to where the belief says, metres, besides the drift.
    pub reach_m: f64,
    /// And when it is turned by no more than this, degrees.
    pub reach_deg: f64,
    /// Travel over which the chance that a belief is false grows tenfold while no cloud confirms it, metres.
    pub doubt_m: f64,
}

impl Default for SequenceConfig {
    fn default() -> Self {
        Self { drift: 0.03, reach_m: 1.5, reach_deg: 5.0, doubt_m: 10.0 }
    }
}

impl SequenceConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field outside its range.
    pub fn check(&self) -> Result<(), Error> {
        require((0.0..=1.0).contains(&self.drift), "sequence.drift", self.drift, "0 to 1")?;
        require((0.1..=20.0).contains(&self.reach_m), "sequence.reach_m", self.reach_m, "0.1 to 20 m")?;
        require(
            (0.1..=45.0).contains(&self.reach_deg),
            "sequence.reach_deg",
            self.reach_deg,
            "0.1 to 45 degrees",
        )?;
        require((0.1..=1e6).contains(&self.doubt_m), "sequence.doubt_m", self.doubt_m, "0.1 to 1000000 m")
    }
}

/// Localizes the clouds of one robot in the order they were taken.
///
/// ```
/// # fn run(map: std::sync::Arc<esm_core::Map>, clouds: Vec<esm_core::LiveCloud>) -> Result<(), esm_core::Error> {
/// use esm_core::{Config, Localizer, SequenceLocalizer};
/// let mut robot = SequenceLocalizer::new(Localizer::new(map, &Config::default())?);
/// for cloud in clouds {
///     let answer = robot.localize(&cloud)?; // uses cloud.pose_odom_sensor, relatively only
///     println!("{}: {}", answer.stamp, answer.verdict);
/// }
/// # Ok(()) }
/// ```
pub struct SequenceLocalizer {
    localizer: Arc<Localizer>,
    beliefs: Vec<Belief>,
    last_odom: Option<Pose>,
    travel_m: f64,
}

/// A place that may be right, as a pose of the odometry frame.
#[derive(Clone, Debug)]
struct Belief {
    pose_map_odom: Pose,
    /// That it is false, 0 to 1.
    chance: f64,
    /// Travel at the last cloud that confirmed it.
    confirmed_m: f64,
    /// Its place in the cloud at hand.
    place: Option<usize>,
}

impl SequenceLocalizer {
    /// A robot that may be anywhere.
    pub fn new(localizer: impl Into<Arc<Localizer>>) -> Self {
        Self { localizer: localizer.into(), beliefs: Vec::new(), last_odom: None, travel_m: 0.0 }
    }

    /// The localizer in use.
    pub fn localizer(&self) -> &Arc<Localizer> {
        &self.localizer
    }

    /// Forgets where the robot was: call it after a gap, or when it was carried elsewhere.
    pub fn forget(&mut self) {
        (self.beliefs, self.last_odom, self.travel_m) = (Vec::new(), None, 0.0);
    }

    /// Finds the cloud in the map, as [`Localizer::localize`] does, in the light of those before it.
    ///
    /// A cloud without motion stands for itself, and what was believed is forgotten; so it is after a step longer than
    /// `accumulate.max_step_m`, or twice the clouds' length.
    ///
    /// # Errors
    /// As [`Localizer::localize`].
    pub fn localize(&mut self, live: &LiveCloud) -> Result<Localization, Error> {
        let Some(pose_odom_sensor) = live.pose_odom_sensor else {
            self.forget();
            return self.localizer.localize(live);
        };
        let step_m = self.advance(&pose_odom_sensor);
        let expected: Vec<Pose> = self.beliefs.iter().map(|b| b.pose_map_odom * pose_odom_sensor).collect();
        let look = self.localizer.look(live, &expected)?;
        self.weigh(&look, &pose_odom_sensor, step_m);
        let judged = self.judge(&look);
        Ok(self.localizer.answer(live, look, judged))
    }

    /// Metres since the last cloud.
    fn advance(&mut self, pose_odom_sensor: &Pose) -> f64 {
        let last = self.last_odom.unwrap_or(*pose_odom_sensor);
        let step_m = (pose_odom_sensor.translation.vector - last.translation.vector).norm();
        let accumulate = &self.localizer.config().accumulate;
        // Swathes follow each other at their own length.
        if step_m > accumulate.max_step_m.max(2.0 * accumulate.distance_m) {
            self.forget();
        }
        self.travel_m += step_m;
        self.last_odom = Some(*pose_odom_sensor);
        step_m
    }

    /// Takes the places of a cloud as evidence for and against what is believed.
    fn weigh(&mut self, look: &Look, pose_odom_sensor: &Pose, step_m: f64) {
        let config = self.localizer.config();
        let c = &config.sequence;
        let chances: Vec<f64> = (0..look.places.len()).map(|i| self.chance(look, i)).collect();
        // Whether a place's points and matches alone would do, rivals or not.
        let is_strong = |i: usize| {
            let place = &look.places[i];
            chances[i] < 1.0 && 1000.0 * place.chance_false() <= config.verify.max_false_per_thousand
        };
        let mut taken = vec![false; look.places.len()];
        self.beliefs.sort_by(|a, b| a.chance.total_cmp(&b.chance));
        for belief in &mut self.beliefs {
            let since_m = self.travel_m - belief.confirmed_m;
            let expected = belief.pose_map_odom * pose_odom_sensor;
            let reach_m = c.reach_m + c.drift * since_m;
            belief.place = (0..look.places.len()).find(|i| {
                let place = &look.places[*i];
                let pose = self.localizer.to_map_frame(&place.pose_map_sensor);
                !taken[*i]
                    && place.verified.overlap >= CONFIRM_OVERLAP
                    && place.verified.seen >= config.verify.min_seen
                    && place.verified.free_space_violated <= config.verify.max_free_space_violated
                    && (pose.translation.vector - expected.translation.vector).norm() <= reach_m
                    && pose.rotation.angle_to(&expected.rotation) <= c.reach_deg.to_radians()
            });
            let confirmed = belief.place.filter(|i| is_strong(*i));
            if let Some(i) = belief.place {
                taken[i] = true;
            }
            let Some(i) = confirmed else {
                belief.chance *= 10f64.powf(step_m / c.doubt_m);
                continue;
            };
            belief.chance = belief.chance.min(chances[i]).max(LEAST_CHANCE);
            let pose = self.localizer.to_map_frame(&look.places[i].pose_map_sensor);
            belief.pose_map_odom = pose * pose_odom_sensor.inverse();
            belief.confirmed_m = self.travel_m;
        }
        for (i, place) in look.places.iter().enumerate().filter(|(i, _)| !taken[*i] && is_strong(*i)) {
            let pose = self.localizer.to_map_frame(&place.pose_map_sensor);
            self.beliefs.push(Belief {
                pose_map_odom: pose * pose_odom_sensor.inverse(),
                chance: chances[i],
                confirmed_m: self.travel_m,
                place: Some(i),
            });
        }
        self.beliefs.retain(|b| b.chance <= RIVALLED);
        self.beliefs.sort_by(|a, b| a.chance.total_cmp(&b.chance));
        self.beliefs.truncate(MOST_BELIEFS);
    }

    /// That a place is a false one, by what its cloud alone tells.
    fn chance(&self, look: &Look, i: usize) -> f64 {
        let verify = &self.localizer.config().verify;
        let place = &look.places[i];
        let v = &place.verified;
        let seen_through = v.free_space_violated > verify.max_free_space_violated;
        if v.seen < verify.min_seen || seen_through || v.refined.covariance.is_none() {
            return 1.0;
        }
        let chance = place.chance_false();
        let rivalled = rival(i, &look.places).is_some_and(|r| r.score > verify.max_runner_up * place.score);
        if rivalled { chance.max(RIVALLED) } else { chance }
    }

    fn judge(&self, look: &Look) -> Judged {
        let verify = &self.localizer.config().verify;
        let alone = || judge(&look.places, verify);
        let Some(best) = self.beliefs.first() else { return alone() };
        let Some(meant) = best.place else {
            let alone = alone();
            return match alone.verdict {
                Verdict::NotFound => alone,
                _ => {
                    alone.disbelieved("the place contradicts the motion since the last one that was believed")
                }
            };
        };
        if 1000.0 * best.chance > verify.max_false_per_thousand {
            return alone();
        }
        // Another belief that this cloud confirms nearly as well; a place that the map holds twice is one place.
        let rival = rival(meant, &look.places)
            .filter(|r| r.score > verify.max_runner_up * look.places[meant].score)
            .and_then(|r| {
                let is = |b: &&Belief| b.place.is_some_and(|i| std::ptr::eq(&look.places[i], r));
                self.beliefs[1..].iter().find(is)
            })
            .filter(|b| b.chance < best.chance * RIVAL_RATIO);
        let places = &look.places;
        let runner_up = (0..places.len())
            .filter(|i| *i != meant)
            .max_by(|a, b| places[*a].score.total_cmp(&places[*b].score));
        Judged {
            verdict: if rival.is_some() { Verdict::Ambiguous } else { Verdict::Located },
            reason: rival.map(|r| {
                format!(
                    "another place agrees with the motion too (chances of being false: {:.1e} and {:.1e})",
                    best.chance, r.chance
                )
            }),
            best: Some(meant),
            covariance: covariance(meant, places),
            runner_up,
        }
    }
}
