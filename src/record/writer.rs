//! Writes a log file: schemas, channels and messages through the MCAP writer, synced every second.
//!
//! Chunks without seeking make the file append-only, so that a power cut costs only what was not
//! synced. Neither the MCAP writer nor a flush syncs: that is done here.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions};
use thiserror::Error;

use super::DESCRIPTORS;
use super::channels::{self, Decoded};
use super::names::create_log;
use super::pb;
use super::session::Session;
use crate::pilot::LinkId;
use crate::time::HostTime;

/// Largest chunk, bytes. The flush each second makes most chunks smaller.
const CHUNK_BYTES: u64 = 1 << 20;

/// Why a flight is not recorded, or no longer.
#[derive(Debug, Error)]
pub enum RecordError {
    /// The log could not be created.
    #[error(
        "record.directory = {}: cannot create a log there: {source}; \
         name a directory that can be written", directory.display()
    )]
    Create {
        /// Where.
        directory: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The log could not be written.
    #[error("{}: recording stopped: {reason}; the flight goes on, what was written stays readable",
        path.display())]
    Write {
        /// Which log.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The recorder's thread could not be started.
    #[error("the recorder's thread could not be started: {0}")]
    Thread(io::Error),
}

/// What makes written bytes permanent.
pub(super) type Sync = Box<dyn FnMut() -> io::Result<()> + Send>;

/// An open log.
pub(super) struct LogWriter<W: Write> {
    path: PathBuf,
    mcap: mcap::Writer<NoSeek<W>>,
    sync: Sync,
    channels: BTreeMap<String, u16>,
    buffer: Vec<u8>,
}

impl LogWriter<io::BufWriter<std::fs::File>> {
    /// Creates the next log in `directory`; its head is on disk when this returns.
    pub(super) fn create(directory: &Path, session: &Session) -> Result<Self, RecordError> {
        let failed = |source| RecordError::Create { directory: directory.to_owned(), source };
        let (path, file) = create_log(directory, session.started_unix_us).map_err(failed)?;
        let handle = file.try_clone().map_err(failed)?;
        let sync = Box::new(move || handle.sync_data());
        Self::on(path, io::BufWriter::new(file), sync, session)
    }
}

impl<W: Write> LogWriter<W> {
    /// Begins a log on any medium.
    pub(super) fn on(
        path: PathBuf,
        medium: W,
        sync: Sync,
        session: &Session,
    ) -> Result<Self, RecordError> {
        let begun = WriteOptions::new()
            .compression(None)
            .profile("haltere")
            .library(concat!("haltere/", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .create(NoSeek::new(medium));
        let mcap = match begun {
            Ok(mcap) => mcap,
            Err(error) => return Err(RecordError::Write { path, reason: error.to_string() }),
        };
        let mut log = Self { path, mcap, sync, channels: BTreeMap::new(), buffer: Vec::new() };
        log.begin(session).map_err(|error| log.error(&error))?;
        Ok(log)
    }

    fn begin(&mut self, session: &Session) -> Result<(), McapError> {
        let message = session.message();
        self.mcap.write_metadata(&Metadata {
            name: "haltere.session".into(),
            metadata: BTreeMap::from([
                ("program_version".into(), message.program_version.clone()),
                ("git_commit".into(), message.git_commit.clone()),
                ("source_hash".into(), message.source_hash.clone()),
                ("target".into(), message.target.clone()),
                ("rustc".into(), message.rustc.clone()),
                ("build_profile".into(), message.build_profile.clone()),
                ("processor".into(), message.processor.clone()),
                ("started_unix_us".into(), message.started_unix_us.to_string()),
                ("pilot_started_us".into(), message.pilot_started_us.to_string()),
                ("config_toml".into(), message.config_toml.clone()),
            ]),
        })?;
        self.put(channels::CONFIG, session.pilot_started_at, 0, &message)?;
        self.persist()
    }

    /// Sentence about a failure.
    pub(super) fn error(&self, error: &McapError) -> RecordError {
        let reason = match error {
            McapError::Io(io) => io.to_string(),
            other => other.to_string(),
        };
        RecordError::Write { path: self.path.clone(), reason }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Raw bytes of a link.
    pub(super) fn raw(
        &mut self,
        out: bool,
        link: LinkId,
        at: HostTime,
        sequence: u64,
        bytes: &[u8],
    ) -> Result<(), McapError> {
        let name = if out { channels::output_channel(link) } else { channels::input_channel(link) };
        let message = pb::RawBytes { sequence, host_time_us: at.as_us(), data: bytes.to_vec() };
        self.put((&name, channels::RAW_BYTES), at, sequence, &message)
    }

    /// A decoded message.
    pub(super) fn decoded(&mut self, decoded: &Decoded) -> Result<(), McapError> {
        let schema = Decoded::CHANNELS
            .iter()
            .find(|(name, _)| *name == decoded.channel())
            .map_or("", |(_, schema)| schema);
        decoded.encode(&mut self.buffer);
        self.write((decoded.channel(), schema), decoded.at(), 0)
    }

    /// Any other message.
    pub(super) fn put(
        &mut self,
        channel: (&str, &str),
        at: HostTime,
        sequence: u64,
        message: &impl prost::Message,
    ) -> Result<(), McapError> {
        self.buffer.clear();
        message.encode(&mut self.buffer).map_err(io::Error::other)?;
        self.write(channel, at, sequence)
    }

    /// Writes `self.buffer`.
    fn write(
        &mut self,
        (name, schema): (&str, &str),
        at: HostTime,
        sequence: u64,
    ) -> Result<(), McapError> {
        let channel_id = match self.channels.get(name) {
            Some(id) => *id,
            None => {
                let schema_id = self.mcap.add_schema(schema, "protobuf", DESCRIPTORS)?;
                let id = self.mcap.add_channel(schema_id, name, "protobuf", &BTreeMap::new())?;
                self.channels.insert(name.to_owned(), id);
                id
            }
        };
        let log_time = at.as_us().saturating_mul(1000);
        // MCAP's number has 32 bits; ours, whole, is inside the message.
        #[allow(clippy::cast_possible_truncation)]
        let sequence = sequence as u32;
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.mcap.write_to_known_channel(&header, &self.buffer)
    }

    /// Closes the open chunk and makes everything so far permanent.
    pub(super) fn persist(&mut self) -> Result<(), McapError> {
        self.mcap.flush()?;
        (self.sync)()?;
        Ok(())
    }

    /// Writes the index. The log is complete when this returns.
    pub(super) fn finish(mut self) -> Result<(), McapError> {
        self.mcap.finish()?;
        let mut medium = self.mcap.into_inner();
        medium.flush()?;
        (self.sync)()?;
        Ok(())
    }
}
