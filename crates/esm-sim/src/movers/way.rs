//! How far along its way a mover is at a time.

use std::f64::consts::{PI, TAU};

use crate::motion::Trajectory;

/// Seconds that turning round at the end of a walk takes.
const TURN_S: f64 = 2.0;
/// Farther than this from where they meet the sensor, those who pass are not there, metres.
pub(super) const REACH_M: f64 = 110.0;

/// How a mover goes along its way.
#[derive(Clone, Copy, Debug)]
pub(super) enum Pace {
    /// There and back again between the ends, m/s, `phase` (0 to 1) of the round at time 0.
    Shuttle { speed: f64, phase: f64 },
    /// Round and round a closed way, from `start` metres on.
    Laps { speed: f64, start: f64 },
    /// Once: at `meet` metres at the time `when`; a negative speed goes against the way. `sway` metres to and fro about it.
    Once { speed: f64, meet: f64, when: f64, sway: f64 },
    /// On the sensor's own way, `gap` metres before it (behind: negative) at the time `when`, farther off the longer before
    /// and after: `widen` m/s^2 times half of the time squared.
    Company { gap: f64, when: f64, widen: f64 },
}

/// A place along a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    /// Metres from its start.
    pub(super) along: f64,
    /// Radians between the way's heading and where the mover looks.
    pub(super) turned: f64,
}

impl Pace {
    /// Where it is at a time; `None` while it is not there.
    pub(super) fn at(&self, trajectory: &Trajectory<'_>, length: f64, seconds: f64) -> Option<Step> {
        match *self {
            Self::Shuttle { speed, phase } => {
                let leg = length / speed;
                let round = 2.0 * (leg + TURN_S);
                let u = (seconds + phase * round).rem_euclid(round);
                let (u, back) = if u < 0.5 * round { (u, false) } else { (u - 0.5 * round, true) };
                let gone = (u * speed).min(length);
                let turning = PI * ((u - leg) / TURN_S).max(0.0);
                Some(if back {
                    Step { along: length - gone, turned: PI + turning }
                } else {
                    Step { along: gone, turned: turning }
                })
            }
            Self::Laps { speed, start } => {
                Some(Step { along: (start + speed * seconds).rem_euclid(length), turned: 0.0 })
            }
            Self::Once { speed, meet, when, sway } => {
                let off = speed * (seconds - when);
                let along = meet + off + sway * (TAU * (seconds - when) / 3.7).sin();
                let there = off.abs() <= REACH_M && (0.0..=length).contains(&along);
                there.then_some(Step { along, turned: if speed < 0.0 { PI } else { 0.0 } })
            }
            Self::Company { gap, when, widen } => {
                let off = gap + (0.5 * widen * (seconds - when).powi(2)).copysign(gap);
                let along = trajectory.travelled(seconds) + off;
                let there = off.abs() <= REACH_M && (0.0..=length).contains(&along);
                there.then_some(Step { along, turned: 0.0 })
            }
        }
    }

    /// The times between which it can be there.
    pub(super) fn span(&self) -> (f64, f64) {
        match *self {
            Self::Shuttle { .. } | Self::Laps { .. } => (f64::NEG_INFINITY, f64::INFINITY),
            Self::Once { speed, when, .. } => {
                let half = REACH_M / speed.abs();
                (when - half, when + half)
            }
            Self::Company { gap, when, widen } => {
                let half = (2.0 * (REACH_M - gap.abs()).max(0.0) / widen).sqrt();
                (when - half, when + half)
            }
        }
    }
}
