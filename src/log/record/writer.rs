//! Writes a log file: schemas, channels and messages through the MCAP writer, synced every second.
//!
//! A chunk is written as it grows. What is in it is made permanent every second, and only when all of it is,
//! its head is told its length: so a power cut costs what was not synced, and nothing before it.
//! Configuration and survey come first, twice, in small chunks of their own. The index that the MCAP writer keeps in memory to the end grows by some 500 bytes a chunk: chunks of
//! a second would grow it by 2 MB an hour. Neither the MCAP writer nor a flush syncs: that is done here.

use std::collections::BTreeMap;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions};
use thiserror::Error;

use super::DESCRIPTORS;
use super::budget::UNEVENTFUL;
use super::channels::{self, Decoded};
use super::names::create_log;
use super::patient::Patient;
use super::pb;
use super::session::Session;
use haltere_core::time::HostTime;
use haltere_pilot::LinkId;

/// A chunk ends with the record that reaches this, bytes: some seconds of a flight.
const CHUNK_BYTES: usize = 1 << 20;
/// Bytes that are gathered before they are written, when nothing more waits to be gathered …
const BUFFER_BYTES: usize = if cfg!(test) { 0 } else { 1 << 16 };
/// … and when more waits: where each write takes half a second, what came meanwhile is one write and not twenty.
const MOST_BUFFER_BYTES: usize = if cfg!(test) { 0 } else { 1 << 20 };
/// What a message takes in a chunk besides its data: opcode, length, channel, sequence, two times, bytes.
const MESSAGE_HEAD_BYTES: usize = 1 + 8 + 2 + 4 + 8 + 8;

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
    /// There was no room for a log, to the end.
    #[error("without log: {reason}; make room, or name another folder in record.directory")]
    NotBegun {
        /// Why, and where.
        reason: String,
    },
    /// The recorder's thread could not be started.
    #[error("the recorder's thread could not be started: {0}")]
    Thread(io::Error),
}

impl RecordError {
    /// Where and why alone, without what to do about it.
    pub(super) fn cause(&self) -> String {
        match self {
            RecordError::Create { directory, source } => {
                format!("{}: {source}", directory.display())
            }
            RecordError::Write { path, reason } => format!("{}: {reason}", path.display()),
            RecordError::NotBegun { reason } => reason.clone(),
            RecordError::Thread(error) => error.to_string(),
        }
    }
}

/// Sentence about a failure.
pub(super) fn reason(error: &McapError) -> String {
    match error {
        McapError::Io(io) => io.to_string(),
        other => other.to_string(),
    }
}

/// What makes written bytes permanent.
pub(super) type Sync = Box<dyn FnMut() -> io::Result<()> + Send>;

/// The medium: the MCAP writer holds it, and so does who flushes it in the middle of a chunk.
struct Shared<W>(Arc<Mutex<Patient<W>>>);

impl<W> Clone for Shared<W> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<W> Shared<W> {
    fn medium(&self) -> io::Result<MutexGuard<'_, Patient<W>>> {
        self.0.lock().map_err(|_| io::Error::other("a write before ended in a panic"))
    }
}

impl<W: Write + Seek> Write for Shared<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.medium()?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.medium()?.flush()
    }
}

impl<W: Seek> Seek for Shared<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.medium()?.seek(to)
    }
}

/// An open log.
pub(super) struct LogWriter<W: Write + Seek> {
    path: PathBuf,
    mcap: mcap::Writer<Shared<W>>,
    medium: Shared<W>,
    sync: Sync,
    /// All messages so far, bytes.
    size_B: u64,
    /// In the open chunk, bytes.
    open_bytes: usize,
    /// With so many it ends.
    pub(super) chunk_bytes: usize,
    channels: BTreeMap<String, u16>,
    /// How many of them were told outside of chunks, and how often.
    told: (usize, u8),
    buffer: Vec<u8>,
}

impl LogWriter<std::fs::File> {
    /// Creates the next log in `directory`; its head is on disk when this returns.
    pub(super) fn create(directory: &Path, session: &Session) -> Result<Self, RecordError> {
        let failed = |source| RecordError::Create { directory: directory.to_owned(), source };
        let (path, file) = create_log(directory, session.started_unix_us).map_err(failed)?;
        let handle = file.try_clone().map_err(failed)?;
        let sync = Box::new(move || handle.sync_data());
        let begun = Self::on(path.clone(), file, sync, session);
        if begun.is_err() {
            // Nothing is in it, and the next attempt makes one of its own.
            let _ = std::fs::remove_file(&path);
        }
        begun
    }
}

impl<W: Write + Seek> LogWriter<W> {
    /// Begins a log on any medium.
    pub(super) fn on(
        path: PathBuf,
        medium: W,
        sync: Sync,
        session: &Session,
    ) -> Result<Self, RecordError> {
        let medium = Shared(Arc::new(Mutex::new(Patient::new(medium, MOST_BUFFER_BYTES))));
        let begun = WriteOptions::new()
            .compression(None)
            .profile("haltere")
            .library(concat!("haltere/", env!("CARGO_PKG_VERSION")))
            .chunk_size(None)
            .create(medium.clone());
        let mcap = match begun {
            Ok(mcap) => mcap,
            Err(error) => return Err(RecordError::Write { path, reason: error.to_string() }),
        };
        let (channels, buffer) = (BTreeMap::new(), Vec::new());
        let (open_bytes, chunk_bytes) = (0, CHUNK_BYTES);
        let told = (0, 0);
        let size_B = 0;
        let mut log = Self {
            path,
            mcap,
            medium,
            sync,
            size_B,
            open_bytes,
            chunk_bytes,
            channels,
            told,
            buffer,
        };
        log.begin(session).map_err(|error| log.error(&error))?;
        match log.fault() {
            None => Ok(log),
            Some(error) => Err(log.error(&McapError::Io(error))),
        }
    }

    fn begin(&mut self, session: &Session) -> Result<(), McapError> {
        let message = session.message();
        // In chunks of their own, with the metadata between them: one bad sector leaves one of the two.
        self.put(channels::CONFIG, session.pilot_started_at, 0, &message)?;
        self.mcap.flush()?;
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
        let head = self.channels.remove(channels::CONFIG.0);
        let (topic, schema) = channels::CONFIG;
        let schema_id = self.mcap.add_schema(schema, "protobuf", DESCRIPTORS)?;
        // A channel of its own, so that its record is in this chunk too.
        let copy = BTreeMap::from([("copy".to_owned(), "2".to_owned())]);
        let copy = self.mcap.add_channel(schema_id, topic, "protobuf", &copy)?;
        self.channels.insert(topic.into(), copy);
        self.put(channels::CONFIG, session.pilot_started_at, 0, &message)?;
        self.channels.extend(head.map(|id| (topic.to_owned(), id)));
        self.mcap.flush()?;
        self.open_bytes = 0;
        self.settle()?;
        Ok(())
    }

    /// Sentence about a failure.
    pub(super) fn error(&self, error: &McapError) -> RecordError {
        let reason = reason(error);
        RecordError::Write { path: self.path.clone(), reason }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// How long it has become, bytes, but for what MCAP adds to messages.
    pub(super) fn size_B(&self) -> u64 {
        self.size_B
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
        self.mcap.write_to_known_channel(&header, &self.buffer)?;
        let bytes = MESSAGE_HEAD_BYTES + self.buffer.len();
        self.open_bytes += bytes;
        self.size_B = self.size_B.saturating_add(bytes as u64);
        if self.open_bytes >= self.chunk_bytes { self.persist() } else { Ok(()) }
    }

    /// Makes everything so far permanent, unless [`Self::fault`] says why not, and then closes a chunk that is long enough.
    pub(super) fn persist(&mut self) -> Result<(), McapError> {
        self.settle()?;
        // A chunk tells its length only when all of it is permanent.
        if self.open_bytes >= self.chunk_bytes && self.fault().is_none() {
            self.mcap.flush()?;
            self.open_bytes = 0;
            self.tell_channels()?;
            self.settle()?;
        }
        Ok(())
    }

    /// A channel has one record, in the chunk where it first comes. Its name is told twice more, behind this chunk
    /// and the next one: so neither chunk costs what is in later ones.
    fn tell_channels(&mut self) -> Result<(), McapError> {
        let (known, times) = self.told;
        if known == self.channels.len() && times >= 2 {
            return Ok(());
        }
        self.told = (self.channels.len(), if known == self.channels.len() { times + 1 } else { 1 });
        let names = self.channels.iter().map(|(name, id)| (name.as_str(), *id));
        self.mcap.write_metadata(&channels::to_metadata(names))
    }

    /// Writes what has gathered, if it is worth it: nothing more waits.
    pub(super) fn put_out(&mut self) -> Result<(), McapError> {
        self.medium.medium()?.put_out_beyond(BUFFER_BYTES);
        Ok(())
    }

    fn settle(&mut self) -> io::Result<()> {
        let Self { medium, sync, .. } = self;
        medium.medium()?.settle(sync);
        Ok(())
    }

    /// Why what was written does not come to the disk. It waits in memory, and the file goes on when it does.
    pub(super) fn fault(&self) -> Option<io::Error> {
        match self.medium.medium() {
            Ok(medium) => medium.fault(),
            Err(error) => Some(error),
        }
    }

    /// Writes that nothing happened in this log, which may be removed one day, and where a reader finds that.
    pub(super) fn note_uneventful(&mut self) -> Result<(), McapError> {
        let metadata = BTreeMap::new();
        self.mcap.write_metadata(&Metadata { name: UNEVENTFUL.into(), metadata })
    }

    /// Writes the index. The log is complete when this returns.
    pub(super) fn finish(mut self) -> Result<(), McapError> {
        self.settle()?;
        self.mcap.finish()?;
        self.settle()?;
        self.fault().map_or(Ok(()), |error| Err(error.into()))
    }
}
