//! Rewrites a log that was cut into a complete one that every viewer opens.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;

use super::DESCRIPTORS;
use super::channels::{self, Decoded};
use super::reader::{LogEnd, LogError, LogReader, Message, Messages};

/// Writes what is readable of `path` to `to` (which must not exist) with a proper end. Returns how
/// many messages were saved and how the original ended.
pub fn recover(path: &Path, to: &Path) -> Result<(u64, LogEnd), LogError> {
    let log = LogReader::open(path)?;
    copy(log.bytes(), to).map_err(|source| LogError::Copy { path: to.to_owned(), source })
}

fn copy(bytes: &[u8], to: &Path) -> Result<(u64, LogEnd), McapError> {
    let mut out = Copy::create(to)?;
    let mut messages = Messages::new(bytes);
    for message in messages.by_ref() {
        out.put(&message)?;
    }
    Ok((out.finish()?, messages.end()))
}

/// A new log made of messages of another.
pub(super) struct Copy {
    out: mcap::Writer<NoSeek<BufWriter<File>>>,
    handle: File,
    ids: BTreeMap<String, u16>,
    saved: u64,
}

impl Copy {
    /// `to` must not exist.
    pub(super) fn create(to: &Path) -> Result<Self, McapError> {
        let file = OpenOptions::new().write(true).create_new(true).open(to)?;
        let handle = file.try_clone()?;
        let out = mcap::WriteOptions::new()
            .compression(None)
            .profile("haltere")
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::new(file)))?;
        Ok(Self { out, handle, ids: BTreeMap::new(), saved: 0 })
    }

    /// A message of a channel that this build does not know is left out: its schema is lost.
    pub(super) fn put(&mut self, message: &Message<'_>) -> Result<(), McapError> {
        let id = match self.ids.get(&message.channel) {
            Some(id) => *id,
            None => {
                let Some(schema) = schema_of(&message.channel) else { return Ok(()) };
                let schema = self.out.add_schema(schema, "protobuf", DESCRIPTORS)?;
                let id =
                    self.out.add_channel(schema, &message.channel, "protobuf", &BTreeMap::new())?;
                self.ids.insert(message.channel.clone(), id);
                id
            }
        };
        let header = MessageHeader {
            channel_id: id,
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.log_time,
        };
        self.out.write_to_known_channel(&header, message.data)?;
        self.saved += 1;
        Ok(())
    }

    /// Gives the number of messages, when they are on disk.
    pub(super) fn finish(mut self) -> Result<u64, McapError> {
        self.out.finish()?;
        self.out.into_inner().flush()?;
        self.handle.sync_all()?;
        Ok(self.saved)
    }
}

/// Name beside `path` for its recovered copy.
pub fn recovered_name(path: &Path) -> PathBuf {
    path.with_extension("recovered.mcap")
}

fn schema_of(channel: &str) -> Option<&'static str> {
    channels::FIXED
        .iter()
        .chain(Decoded::CHANNELS)
        .find(|(name, _)| *name == channel)
        .map(|(_, schema)| *schema)
        .or_else(|| {
            let raw = channel.strip_prefix("/in/").or_else(|| channel.strip_prefix("/out/"))?;
            channels::link_from_name(raw).map(|_| channels::RAW_BYTES)
        })
}
