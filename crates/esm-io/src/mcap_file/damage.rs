//! What a torn or damaged recording lost, and where.

use std::collections::BTreeMap;
use std::fmt;

use crate::plain::Plain;

/// Places listed one by one; further ones are counted.
const PLACES_LISTED: usize = 8;

/// How many messages are missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lost {
    /// The file's own statistics or indexes tell.
    Exactly(u64),
    /// These for sure; the file does not tell about the rest. 0 where nothing is known.
    AtLeast(u64),
}

/// A recording from which something is missing: bytes, or messages that contradict themselves. Every intact message was
/// used all the same.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Missing messages of all topics.
    pub lost: Lost,
    /// Missing clouds, those of the cloud topic.
    pub lost_clouds: Lost,
    /// Where and what, in file order: the first few places.
    pub places: Vec<String>,
    /// Number of further places.
    pub more_places: usize,
}

impl Lost {
    /// In words, with what is counted: `22 messages`, `at least 1 cloud`.
    fn of(self, thing: &str) -> String {
        let plural = |n: u64| if n == 1 { "" } else { "s" };
        match self {
            Self::Exactly(n) => format!("{n} {thing}{}", plural(n)),
            Self::AtLeast(0) => format!("an unknown number of {thing}s"),
            Self::AtLeast(n) => format!("at least {n} {thing}{}", plural(n)),
        }
    }
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the recording is damaged: {}", Plain(self.places.join("; ")))?;
        if self.more_places > 0 {
            write!(f, "; and {} more places", self.more_places)?;
        }
        if self.lost == Lost::Exactly(0) {
            return f.write_str("; no message was lost");
        }
        let (messages, clouds) = (self.lost.of("message"), self.lost_clouds.of("cloud"));
        write!(f, "; every intact message was used, lost are {messages}, among them {clouds}")
    }
}

/// Gathers damage while a file is read.
#[derive(Default)]
pub(super) struct DamageLog {
    places: Vec<String>,
    more_places: usize,
    /// By channel: as the indexes behind a damaged chunk told, and messages that contradict themselves.
    counted: BTreeMap<u16, u64>,
    /// Messages of unknown channels that are missing for sure.
    uncounted: u64,
    /// Whether something may be missing that nothing counts.
    open: bool,
    /// A damaged chunk whose indexes may follow: what was still read from it, by channel, and whether an index came.
    chunk: Option<(BTreeMap<u16, u64>, bool)>,
}

impl DamageLog {
    pub(super) fn place(&mut self, place: String) {
        if self.places.len() < PLACES_LISTED {
            self.places.push(place);
        } else {
            self.more_places += 1;
        }
    }

    pub(super) fn first_place(&self) -> Option<&str> {
        self.places.first().map(String::as_str)
    }

    /// The number of missing messages is open from here on; `sure` of them are missing in any case.
    pub(super) fn lose_uncounted(&mut self, sure: u64) {
        self.uncounted += sure;
        self.open = true;
    }

    /// A message that came whole turned out to be of no use.
    pub(super) fn refuse(&mut self, channel: u16) {
        *self.counted.entry(channel).or_default() += 1;
    }

    /// A chunk was damaged; `read` messages by channel could be used.
    pub(super) fn lose_chunk(&mut self, read: BTreeMap<u16, u64>) {
        self.close_chunk();
        self.chunk = Some((read, false));
    }

    /// An index names the messages of a channel in the chunk before it.
    pub(super) fn index(&mut self, channel: u16, messages: u64) {
        if let Some((read, counted)) = &mut self.chunk {
            *counted = true;
            let lost = messages.saturating_sub(read.get(&channel).copied().unwrap_or(0));
            *self.counted.entry(channel).or_default() += lost;
        }
    }

    /// No more indexes follow the chunk.
    pub(super) fn close_chunk(&mut self) {
        if let Some((_, false)) = self.chunk.take() {
            self.open = true;
        }
    }

    /// The damage as far as it is known: from statistics (messages by channel) where the file has them.
    pub(super) fn report(
        &self,
        expected: Option<&BTreeMap<u16, u64>>,
        read: &BTreeMap<u16, u64>,
        is_cloud: &dyn Fn(u16) -> bool,
    ) -> Option<Damage> {
        let missing = |of: &dyn Fn(u16) -> bool| -> Option<u64> {
            let expected = expected?.iter().filter(|(c, _)| of(**c));
            Some(expected.map(|(c, n)| n.saturating_sub(read.get(c).copied().unwrap_or(0))).sum())
        };
        let lost = |of: &dyn Fn(u16) -> bool, uncounted: u64| match missing(of) {
            Some(n) => Lost::Exactly(n),
            None => {
                let n = self.counted.iter().filter(|(c, _)| of(**c)).map(|(_, n)| n).sum::<u64>() + uncounted;
                if self.open { Lost::AtLeast(n) } else { Lost::Exactly(n) }
            }
        };
        let all = lost(&|_| true, self.uncounted);
        let mut places = self.places.clone();
        if places.is_empty() {
            match all {
                Lost::Exactly(0) | Lost::AtLeast(0) => return None,
                _ => places.push("the file holds fewer messages than its statistics say".to_owned()),
            }
        }
        Some(Damage { lost: all, lost_clouds: lost(is_cloud, 0), places, more_places: self.more_places })
    }
}
