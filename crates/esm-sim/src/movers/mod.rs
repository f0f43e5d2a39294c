//! What moves within a visit: cars, cyclists, people, dogs. Their places are functions of time, and rays meet them where they
//! are when the beam is fired: one sweep sees them skewed, sweeps laid over each other see them smeared.

mod body;
mod crowd;
mod populate;
mod way;

use std::sync::Arc;

use esm_core::Pose;
use nalgebra::{Translation3, UnitQuaternion, Vector3};

use crate::cast::Scene;
use crate::hash::Key;
use crate::motion::{Path, Trajectory};
use crate::world::{Class, World};

use body::Body;
use way::Pace;

pub(crate) use crowd::{Crowd, Present};

/// One thing that moves.
pub struct Mover {
    /// Its number, its alone at this visit: the low 16 bits are 0, which no standing thing has.
    pub id: u32,
    /// What it is.
    pub class: Class,
    way: Arc<Path>,
    /// Metres to the left of its way, seen along the way.
    left_m: f64,
    pace: Pace,
    /// Its shapes at equal shares of a stride or a turn of the pedals; one for cars.
    gait: Vec<Body>,
    stride_m: f64,
}

/// All that moves at a visit, about one ride through it.
pub struct Movers<'a> {
    world: &'a World,
    trajectory: Arc<Trajectory<'a>>,
    list: Vec<Mover>,
}

impl<'a> Movers<'a> {
    /// What moves while a trajectory is ridden, between two of its times (seconds): cars and cyclists that are met on the
    /// road, people on pavements and paths, walkers and dogs on trails. `density` scales their number; 1 is a quiet
    /// afternoon, 0 nobody, 20 the most. None of them comes so near that it would touch the sensor's carrier.
    pub fn new(
        world: &'a World,
        trajectory: Arc<Trajectory<'a>>,
        (from_s, to_s): (f64, f64),
        density: f64,
        key: Key,
    ) -> Self {
        let list = populate::populate(world, &trajectory, (from_s, to_s), density, key);
        Self { world, trajectory, list }
    }

    /// All of them.
    pub fn list(&self) -> &[Mover] {
        &self.list
    }

    /// `pose_map_mover` at a time: x ahead, z up, the origin on the ground; `None` while it is not there.
    pub fn pose(&self, mover: &Mover, seconds: f64) -> Option<Pose> {
        let at = mover.place(&self.trajectory, seconds)?;
        let place = Vector3::new(at.x, at.y, self.world.height(at.x, at.y));
        Some(Pose::from_parts(
            Translation3::from(place),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), at.yaw),
        ))
    }

    /// The surface it has at a time, in its own frame.
    pub fn surface<'b>(&self, mover: &'b Mover, seconds: f64) -> Option<&'b Scene> {
        Some(mover.body(mover.place(&self.trajectory, seconds)?.along).scene())
    }
}

/// Where a mover is over the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    x: f64,
    y: f64,
    yaw: f64,
    /// Metres along its way, for its stride.
    along: f64,
}

impl Mover {
    fn place(&self, trajectory: &Trajectory<'_>, seconds: f64) -> Option<Place> {
        let step = self.pace.at(trajectory, self.way.length(), seconds)?;
        let (p, heading) = (self.way.at(step.along), self.way.heading(step.along, 1.5));
        let (s, c) = heading.sin_cos();
        let (x, y) = (p[0] - self.left_m * s, p[1] + self.left_m * c);
        Some(Place { x, y, yaw: heading + step.turned, along: step.along })
    }

    fn body(&self, along: f64) -> &Body {
        let share = (along / self.stride_m).rem_euclid(1.0);
        &self.gait[((share * self.gait.len() as f64) as usize).min(self.gait.len() - 1)]
    }
}
