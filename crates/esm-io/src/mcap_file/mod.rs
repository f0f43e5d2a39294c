//! MCAP files: their records, what is damaged in them, and their topics.

mod chunk;
mod damage;
mod definitions;
mod records;
mod stream;
mod summary;
mod topics;

pub use damage::{Damage, Lost};
pub(crate) use stream::{MessageStream, Wanted};
pub use topics::Topic;
pub(crate) use topics::{MessageKind, TopicTable};
