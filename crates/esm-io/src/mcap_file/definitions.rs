//! Schemas and channels: which number stands for which topic and message type.

use std::collections::BTreeMap;

use mcap::records::{Record, op};

/// Longest name of a topic or message type, bytes: names are kept.
const NAME_LIMIT: usize = 1024;

/// A channel with what its schema says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChannelInfo {
    pub(crate) topic: String,
    pub(crate) schema: String,
    pub(crate) encoding: String,
}

/// Why a schema or channel could not be registered.
pub(super) enum Undefined {
    /// Its bytes are none.
    Broken(String),
    /// It is intact and has a name of so many bytes, more than are kept.
    LongName(usize),
}

/// What to say of a name that is too long.
pub(super) fn long_name(bytes: usize) -> String {
    format!("a name of {bytes} bytes is longer than {NAME_LIMIT}")
}

/// Registers a schema or channel; other records are ignored.
pub(super) fn define(
    schemas: &mut BTreeMap<u16, String>,
    channels: &mut BTreeMap<u16, ChannelInfo>,
    opcode: u8,
    data: &[u8],
) -> Result<(), Undefined> {
    if !matches!(opcode, op::SCHEMA | op::CHANNEL) {
        return Ok(());
    }
    match mcap::parse_record(opcode, data).map_err(|e| Undefined::Broken(e.to_string()))? {
        Record::Schema { header, .. } => {
            check_name(&header.name)?;
            schemas.insert(header.id, header.name);
        }
        Record::Channel(c) => {
            check_name(&c.topic)?;
            check_name(&c.message_encoding)?;
            let schema = schemas.get(&c.schema_id).cloned().unwrap_or_default();
            let known = channels.get(&c.id).is_some_and(|k| !k.schema.is_empty());
            if !known {
                channels.insert(c.id, ChannelInfo { topic: c.topic, schema, encoding: c.message_encoding });
            }
        }
        _ => {}
    }
    Ok(())
}

fn check_name(name: &str) -> Result<(), Undefined> {
    match name.len() {
        n if n > NAME_LIMIT => Err(Undefined::LongName(n)),
        _ => Ok(()),
    }
}
