//! [`Inbox`]: the clouds of a session that wait, and the motion they will need.

use std::collections::VecDeque;

use axum::body::Bytes;
use esm_core::Pose;
use esm_io::Track;

use crate::body::Held;

/// Most clouds that wait. Those that are not the newest get no answer, but are still part of the accumulated cloud.
const MAX_WAITING: usize = 8;
/// Most samples of motion kept: 40 s at 250 Hz.
const MAX_MOTION: usize = 10_000;

/// A cloud as it came.
pub(super) struct Pending {
    pub(super) stamp_ns: i64,
    /// The whole message.
    pub(super) message: Bytes,
    /// The room that the message takes.
    pub(super) held: Held,
    /// How many clouds came before it.
    pub(super) before: u64,
}

/// What has come and is not taken yet.
pub(super) struct Inbox {
    clouds: VecDeque<Pending>,
    motion: Track,
    moves: bool,
    received: u64,
    max_bytes: usize,
}

impl Inbox {
    pub(super) fn new(max_bytes: usize) -> Self {
        Self { clouds: VecDeque::new(), motion: Track::new(MAX_MOTION), moves: false, received: 0, max_bytes }
    }

    /// Takes in a cloud; the oldest ones go where there is no room. A cloud without room is counted and left out.
    pub(super) fn push(&mut self, stamp_ns: i64, message: Bytes, held: Option<Held>) {
        let before = self.received;
        self.received += 1;
        let Some(held) = held else { return };
        self.clouds.push_back(Pending { stamp_ns, message, held, before });
        let mut bytes: usize = self.clouds.iter().map(|c| c.message.len()).sum();
        while self.clouds.len() > MAX_WAITING || (bytes > self.max_bytes && self.clouds.len() > 1) {
            bytes -= self.clouds.pop_front().map_or(0, |c| c.message.len());
        }
    }

    pub(super) fn moved(&mut self, stamp_ns: i64, pose_odom_sensor: Pose) {
        self.moves = true;
        self.motion.push(stamp_ns, pose_odom_sensor);
    }

    pub(super) fn is_empty(&self) -> bool {
        self.clouds.is_empty()
    }

    /// Whether the motion at the newest cloud may still be on its way.
    pub(super) fn awaits_motion(&self) -> bool {
        self.moves && self.clouds.back().is_some_and(|newest| !self.motion.reaches(newest.stamp_ns))
    }

    /// All clouds, oldest first, each with the pose of the sensor where that is known.
    pub(super) fn take(&mut self) -> Vec<(Pending, Option<Pose>)> {
        let clouds: Vec<_> =
            self.clouds.drain(..).map(|cloud| (self.motion.at(cloud.stamp_ns), cloud)).collect();
        if let Some((_, newest)) = clouds.last() {
            self.motion.forget_before(newest.stamp_ns);
        }
        clouds.into_iter().map(|(pose, cloud)| (cloud, pose)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn push(inbox: &mut Inbox, stamp_ns: i64, bytes: usize) {
        inbox.push(stamp_ns, Bytes::from(vec![0; bytes]), Some(Held::default()));
    }

    #[test]
    fn the_newest_stay_and_the_others_are_counted() {
        let mut inbox = Inbox::new(1000);
        (0..20).for_each(|i| push(&mut inbox, i, 10));
        let taken = inbox.take();
        assert_eq!(taken.len(), MAX_WAITING);
        assert_eq!(taken.last().map(|(c, _)| (c.stamp_ns, c.before)), Some((19, 19)));
        assert!(inbox.is_empty());
        push(&mut inbox, 20, 600);
        push(&mut inbox, 21, 600);
        inbox.push(22, Bytes::new(), None);
        push(&mut inbox, 23, 5000);
        let taken = inbox.take();
        assert_eq!(taken.iter().map(|(c, _)| (c.stamp_ns, c.before)).collect::<Vec<_>>(), [(23, 23)]);
    }

    #[test]
    fn clouds_get_the_motion_at_their_time() {
        let mut inbox = Inbox::new(1000);
        push(&mut inbox, 500, 10);
        assert!(!inbox.awaits_motion(), "nothing moves yet");
        inbox.moved(0, Pose::identity());
        assert!(inbox.awaits_motion());
        inbox.moved(1000, Pose::translation(2.0, 0.0, 0.0));
        assert!(!inbox.awaits_motion());
        assert_eq!(inbox.take()[0].1.unwrap().translation.x, 1.0);
    }
}
