//! When a world is visited, and what has changed since the first time.

use crate::hash::Key;

/// Foliage of a time of the year.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Season {
    /// Bare.
    February,
    /// Full and thin.
    May,
    /// Half fallen.
    October,
}

impl Season {
    /// Share of the foliage that broad leaves and their twigs stop beams with. Bare twigs stop about a tenth to a fifth of
    /// what summer's crown does: plant area index of leafless to leafed broadleaf stands, 0.7 to 5 (Chianucci, Cutini,
    /// Agricultural and Forest Meteorology 168, 2013).
    pub fn broadleaf(self) -> f32 {
        match self {
            Self::February => 0.15,
            Self::May => 1.0,
            Self::October => 0.6,
        }
    }

    /// Share of ferns, grass and brambles that stands up.
    pub fn ground_layer(self) -> f32 {
        match self {
            Self::February => 0.35,
            Self::May => 0.9,
            Self::October => 1.0,
        }
    }
}

/// One visit.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Visit {
    /// 0 for the visit that others are compared with, up to 3.
    pub number: u8,
    /// Foliage.
    pub season: Season,
    /// Share of the things that last (trees, bushes, street furniture) that are gone since visit 0; as many are new. Of
    /// parked cars and bins eight times the share has moved, up to all of them. What stays has grown or was cut back by as much.
    pub change: f32,
    /// Where it is given, the share of all that can change, what lasts and what moves easily alike, that is not what it was
    /// at visit 0; growth stays that of `change`. Houses, kerbs and the ground never change. What has changed at one share has
    /// changed at every higher one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub changed: Option<f64>,
}

impl Visit {
    /// Whether something that lasts still stands.
    pub(crate) fn keeps(&self, thing: Key) -> bool {
        self.number == 0 || self.chance(thing) >= self.changed.map_or(self.change, |share| share as f32)
    }

    /// Whether something that moves easily is where it was.
    pub(crate) fn keeps_loose(&self, thing: Key) -> bool {
        self.number == 0 || self.chance(thing) >= self.changed.map_or(8.0 * self.change, |share| share as f32)
    }

    fn chance(&self, thing: Key) -> f32 {
        thing.with(0xC0 + u64::from(self.number)).unit()
    }

    /// A key for what is of this visit only.
    pub(crate) fn own(&self, key: Key) -> Key {
        key.with(0xE000 + u64::from(self.number))
    }

    /// How much something has grown or was cut back: 1 at visit 0, else about 1 with a deviation of 3 times the change.
    pub(crate) fn growth(&self, thing: Key) -> f32 {
        if self.number == 0 {
            return 1.0;
        }
        (1.0 + 3.0 * self.change * self.own(thing).draw().normal()).clamp(0.6, 1.4)
    }
}
