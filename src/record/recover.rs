//! Rewrites a log that was cut into a complete one that every viewer opens.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;

use super::DESCRIPTORS;
use super::channels::{self, Decoded};
use super::reader::{LogEnd, LogError, LogReader, Messages};

/// Writes what is readable of `path` to `to` (which must not exist) with a proper end. Returns how
/// many messages were saved and how the original ended.
pub fn recover(path: &Path, to: &Path) -> Result<(u64, LogEnd), LogError> {
    let log = LogReader::open(path)?;
    copy(log.bytes(), to).map_err(|source| LogError::Copy { path: to.to_owned(), source })
}

fn copy(bytes: &[u8], to: &Path) -> Result<(u64, LogEnd), McapError> {
    let file = OpenOptions::new().write(true).create_new(true).open(to)?;
    let handle = file.try_clone()?;
    let mut out = mcap::WriteOptions::new()
        .compression(None)
        .profile("haltere")
        .disable_seeking(true)
        .create(NoSeek::new(BufWriter::new(file)))?;
    let mut ids = BTreeMap::new();
    let mut saved = 0;
    let mut messages = Messages::new(bytes);
    for message in messages.by_ref() {
        let id = match ids.get(&message.channel) {
            Some(id) => *id,
            None => {
                let Some(schema) = schema_of(&message.channel) else { continue };
                let schema = out.add_schema(schema, "protobuf", DESCRIPTORS)?;
                let id = out.add_channel(schema, &message.channel, "protobuf", &BTreeMap::new())?;
                ids.insert(message.channel.clone(), id);
                id
            }
        };
        let header = MessageHeader {
            channel_id: id,
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.log_time,
        };
        out.write_to_known_channel(&header, message.data)?;
        saved += 1;
    }
    out.finish()?;
    out.into_inner().flush()?;
    handle.sync_all()?;
    Ok((saved, messages.end()))
}

/// Name beside `path` for its recovered copy.
pub fn recovered_name(path: &Path) -> PathBuf {
    path.with_extension("recovered.mcap")
}

fn schema_of(channel: &str) -> Option<&'static str> {
    let fixed = [
        channels::CONFIG,
        channels::EVENT,
        channels::LOST,
        channels::FILE,
        channels::WAKE,
        channels::HOLE,
        channels::CLOSING,
    ];
    fixed
        .iter()
        .chain(Decoded::CHANNELS)
        .find(|(name, _)| *name == channel)
        .map(|(_, schema)| *schema)
        .or_else(|| {
            let raw = channel.strip_prefix("/in/").or_else(|| channel.strip_prefix("/out/"))?;
            channels::link_from_name(raw).map(|_| channels::RAW_BYTES)
        })
}
