//! Rewrites a log that was cut or is damaged into a complete one that every viewer opens. What is missing is missing in
//! the numbers of its inputs and outputs.

use std::collections::BTreeMap;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::McapError;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;

use super::DESCRIPTORS;
use super::channels;
use super::errors::{LogEnd, LogError};
use super::messages::Message;
use super::reader::{LogReader, fault};
use crate::written::{Old, Output};

/// Writes what is readable of `path` to `to` (which must not exist) with a proper end. Returns how
/// many messages were saved and how the original ended.
pub fn recover(path: &Path, to: &Path) -> Result<(u64, LogEnd), LogError> {
    let log = LogReader::open(path)?;
    let mut out = Copy::create(to)?;
    let end =
        copy(&log, &mut out).map_err(|source| LogError::Copy { path: to.to_owned(), source })?;
    Ok((out.finish(to)?, end))
}

fn copy(log: &LogReader, out: &mut Copy) -> Result<LogEnd, McapError> {
    out.head(log)?;
    let mut messages = log.messages();
    while let Some(message) = messages.next() {
        if *message.channel == *channels::CONFIG.0 {
            continue;
        }
        if let Some(why) = fault(&message) {
            let offset = message.offset;
            messages.note(offset, why);
            continue;
        }
        out.put(&message)?;
    }
    Ok(messages.log_end())
}

/// A new log made of messages of another; without [`Copy::finish`] there is none.
pub(super) struct Copy {
    out: mcap::Writer<NoSeek<BufWriter<Output>>>,
    ids: BTreeMap<Arc<str>, u16>,
    saved: u64,
}

impl Copy {
    /// `to` must not exist.
    pub(super) fn create(to: &Path) -> Result<Self, LogError> {
        let output = Output::begin(to, &[""; 0], Old::Stays)?;
        let out = mcap::WriteOptions::new()
            .compression(None)
            .profile("haltere")
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::new(output)))
            .map_err(|source| LogError::Copy { path: to.to_owned(), source })?;
        Ok(Self { out, ids: BTreeMap::new(), saved: 0 })
    }

    /// Configuration and survey, twice, in chunks of their own.
    pub(super) fn head(&mut self, log: &LogReader) -> Result<(), McapError> {
        let (topic, schema) = channels::CONFIG;
        let schema = self.out.add_schema(schema, "protobuf", DESCRIPTORS)?;
        let log_time = log.session().pilot_started_at.as_us().saturating_mul(1000);
        for about in [None, Some(("copy".to_owned(), "2".to_owned()))] {
            let about = about.into_iter().collect();
            let channel_id = self.out.add_channel(schema, topic, "protobuf", &about)?;
            self.write(channel_id, 0, log_time, log.head())?;
            self.out.flush()?;
        }
        Ok(())
    }

    /// A message without a number.
    pub(super) fn again(&mut self, channel: &str, at: u64, data: &[u8]) -> Result<(), McapError> {
        match self.id(&channel.into())? {
            Some(id) => self.write(id, 0, at, data),
            None => Ok(()),
        }
    }

    /// A message of a channel that this build does not know is left out: its schema is lost.
    pub(super) fn put(&mut self, message: &Message<'_>) -> Result<(), McapError> {
        match self.id(&message.channel)? {
            Some(id) => self.write(id, message.sequence, message.log_time, message.data),
            None => Ok(()),
        }
    }

    fn id(&mut self, channel: &Arc<str>) -> Result<Option<u16>, McapError> {
        if let Some(id) = self.ids.get(channel) {
            return Ok(Some(*id));
        }
        let Some(schema) = channels::schema_of(channel) else { return Ok(None) };
        let schema = self.out.add_schema(schema, "protobuf", DESCRIPTORS)?;
        let id = self.out.add_channel(schema, channel, "protobuf", &BTreeMap::new())?;
        self.ids.insert(channel.clone(), id);
        Ok(Some(id))
    }

    fn write(
        &mut self,
        channel_id: u16,
        sequence: u32,
        log_time: u64,
        data: &[u8],
    ) -> Result<(), McapError> {
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.out.write_to_known_channel(&header, data)?;
        self.saved += 1;
        Ok(())
    }

    /// Gives the number of messages, when they are on disk.
    pub(super) fn finish(mut self, to: &Path) -> Result<u64, LogError> {
        let failed = |source| LogError::Copy { path: to.to_owned(), source };
        self.out.finish().map_err(failed)?;
        let buffered = self.out.into_inner().into_inner();
        let output = buffered.into_inner().map_err(|error| failed(error.into_error().into()))?;
        output.finish()?;
        Ok(self.saved)
    }
}

/// Name beside `path` for its recovered copy.
pub fn recovered_name(path: &Path) -> PathBuf {
    path.with_extension("recovered.mcap")
}
