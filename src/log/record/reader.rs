//! Reads a log: whole, cut by a power loss, or damaged; to the last complete record, never further.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use mcap::records::{Record, op};
use prost::Message as _;
use thiserror::Error;

use super::channels::{self, Decoded};
use super::pb;
use super::session::Session;
use haltere_core::checks::schema::NotReadable;
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_pilot::services::FileFault;
use haltere_pilot::{Input, LinkId};

/// Opcode and length before each record.
const RECORD_HEAD_BYTES: usize = 9;

/// Longest record head that is not the payload itself; a longer channel record is damage.
const LONGEST_CHANNEL_BYTES: usize = 1 << 16;

/// Why a file cannot be used as a log.
#[derive(Debug, Error)]
pub enum LogError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is something else.
    #[error(
        "{}: byte 0: not an MCAP file; a flight log is named YYYYMMDD-HHMMSS-NN.mcap and lies in \
         record.directory", path.display()
    )]
    NotMcap {
        /// Which file.
        path: PathBuf,
    },
    /// The file ends or is damaged before its first message is complete.
    #[error(
        "{}: byte {offset}: {why} before the head of the log is complete; nothing can be \
         recovered from it", path.display()
    )]
    NoHead {
        /// Which file.
        path: PathBuf,
        /// Where reading stopped.
        offset: usize,
        /// Why.
        why: String,
    },
    /// The recovered copy cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Copy {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: mcap::McapError,
    },
    /// The part that was asked for is not in the log.
    #[error(
        "{}: nothing between {from_s} and {to_s} s; the log runs from 0 to {end_s:.1} s",
        path.display()
    )]
    NothingThere {
        /// Which file.
        path: PathBuf,
        /// Begin that was asked for, s.
        from_s: f64,
        /// End that was asked for, s.
        to_s: f64,
        /// Where the log ends, s.
        end_s: f64,
    },
    /// A log of a newer build.
    #[error(
        "{}: {why}, or read it with the build that wrote it (haltere {version}, source {source_hash})",
        path.display()
    )]
    Newer {
        /// Which file.
        path: PathBuf,
        /// Version that wrote it.
        version: String,
        /// Source that wrote it.
        source_hash: String,
        /// Which version of the schema.
        why: NotReadable,
    },
    /// An MCAP file of another program.
    #[error("{}: byte {offset}: {why}; it was not written by haltere", path.display())]
    Foreign {
        /// Which file.
        path: PathBuf,
        /// Where.
        offset: usize,
        /// What is there.
        why: String,
    },
}

/// How a log ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LogEnd {
    /// Closed properly.
    Complete,
    /// The file stops in mid-record: power loss, or a copy that was cut.
    Cut {
        /// Offset of the record that is not complete.
        offset: usize,
    },
    /// A record cannot be what was written. Nothing after it is used.
    Damaged {
        /// Offset of that record.
        offset: usize,
        /// What is wrong with it.
        why: String,
    },
}

impl std::fmt::Display for LogEnd {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            LogEnd::Complete => write!(f, "complete"),
            LogEnd::Cut { offset } => write!(f, "cut at byte {offset}"),
            LogEnd::Damaged { offset, why } => write!(f, "damaged at byte {offset}: {why}"),
        }
    }
}

/// An input of the core, as recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RawInput {
    /// See [`Input::Bytes`].
    Bytes {
        /// From where.
        link: LinkId,
        /// As read.
        bytes: Vec<u8>,
    },
    /// See [`Input::LinkUp`].
    LinkUp {
        /// Which.
        link: LinkId,
    },
    /// See [`Input::LinkDown`].
    LinkDown {
        /// Which.
        link: LinkId,
    },
    /// See [`Input::Peer`].
    Peer {
        /// Which link.
        link: LinkId,
        /// Who speaks.
        address: SocketAddr,
    },
    /// See [`Input::Lost`].
    Lost {
        /// On which link.
        link: LinkId,
        /// Why.
        reason: DropReason,
        /// How many.
        count: u64,
    },
    /// See [`Input::File`].
    File {
        /// Ticket of the request.
        ticket: u32,
        /// Why it was not done.
        fault: Option<FileFault>,
        /// What was asked for.
        bytes: Vec<u8>,
    },
    /// See [`Input::Calendar`].
    Calendar {
        /// Since 1970-01-01 UTC, µs.
        unix_us: i64,
    },
    /// See [`Input::EndAsked`].
    EndAsked,
    /// See [`Input::Wake`].
    Wake,
}

impl RawInput {
    /// As the core takes it.
    pub fn as_input(&self) -> Input<'_> {
        match self {
            RawInput::Bytes { link, bytes } => Input::Bytes { link: *link, bytes },
            RawInput::LinkUp { link } => Input::LinkUp { link: *link },
            RawInput::LinkDown { link } => Input::LinkDown { link: *link },
            RawInput::Peer { link, address } => Input::Peer { link: *link, address: *address },
            RawInput::Lost { link, reason, count } => {
                Input::Lost { link: *link, reason: *reason, count: *count }
            }
            RawInput::File { ticket, fault, bytes } => {
                Input::File { ticket: *ticket, result: fault.map_or(Ok(()), Err), bytes }
            }
            RawInput::Calendar { unix_us } => Input::Calendar { unix_us: *unix_us },
            RawInput::EndAsked => Input::EndAsked,
            RawInput::Wake => Input::Wake,
        }
    }
}

/// One entry of a log, in the order of recording.
#[derive(Debug, Clone, PartialEq)]
// One at a time is alive: a box for the large ones would cost more than it saves.
#[allow(clippy::large_enum_variant)]
pub enum Entry {
    /// Handed to the core.
    Input {
        /// Place in the order of inputs and outputs, from 1.
        sequence: u64,
        /// Time that the core was told.
        at: HostTime,
        /// What.
        input: RawInput,
    },
    /// Sent by the core.
    Output {
        /// Place in the order of inputs and outputs, from 1.
        sequence: u64,
        /// Time of the wake-up.
        at: HostTime,
        /// Where to.
        link: LinkId,
        /// What.
        bytes: Vec<u8>,
    },
    /// A decoded topic.
    Decoded(Decoded),
    /// Entries are missing here.
    Hole(pb::Hole),
    /// The recorder closed the log.
    Closing(pb::Closing),
}

/// A log in memory.
#[derive(Debug)]
pub struct LogReader {
    path: PathBuf,
    bytes: Vec<u8>,
    session: Session,
}

impl LogReader {
    /// Reads the file and its head.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, LogError> {
        let path = path.as_ref().to_owned();
        match crate::intake::bytes(&path, u64::MAX) {
            Ok(bytes) => Self::from_bytes(path, bytes),
            Err(source) => Err(LogError::Io { path, source }),
        }
    }

    /// As [`LogReader::open`], with the content at hand; `path` is for messages only.
    pub fn from_bytes(path: PathBuf, bytes: Vec<u8>) -> Result<Self, LogError> {
        if !bytes.starts_with(mcap::MAGIC) {
            let head = bytes.get(..mcap::MAGIC.len()).unwrap_or(&bytes);
            return Err(if mcap::MAGIC.starts_with(head) {
                LogError::NoHead { path, offset: bytes.len(), why: "the file ends".into() }
            } else {
                LogError::NotMcap { path }
            });
        }
        let mut messages = Messages::new(&bytes);
        let session = match messages.next() {
            Some(message) if message.channel == channels::CONFIG.0 => {
                let offset = message.offset;
                let foreign = |why| LogError::Foreign { path: path.clone(), offset, why };
                let head = pb::Session::decode(message.data).map_err(|e| foreign(e.to_string()))?;
                Session::check_schema(&head).map_err(|why| LogError::Newer {
                    path: path.clone(),
                    version: head.program_version.clone(),
                    source_hash: head.source_hash.clone(),
                    why,
                })?;
                Session::from_message(head).map_err(|problems| foreign(problems.to_string()))?
            }
            Some(message) => {
                let why = format!(
                    "the first message is on channel {}, not on {}",
                    message.channel,
                    channels::CONFIG.0
                );
                return Err(LogError::Foreign { path, offset: message.offset, why });
            }
            None => {
                return Err(match messages.end() {
                    LogEnd::Complete => {
                        LogError::Foreign { path, offset: 0, why: "it holds no message".into() }
                    }
                    LogEnd::Cut { offset } => {
                        LogError::NoHead { path, offset, why: "the file ends".into() }
                    }
                    LogEnd::Damaged { offset, why } => LogError::NoHead { path, offset, why },
                });
            }
        };
        Ok(Self { path, bytes, session })
    }

    /// Name of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The whole file.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Head of the log.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Everything after the head. [`Entries::end`] tells how the log ended once it is exhausted.
    pub fn entries(&self) -> Entries<'_> {
        Entries { messages: Messages::new(&self.bytes), damaged: None }
    }
}

/// Iterates over a log.
#[derive(Debug)]
pub struct Entries<'a> {
    messages: Messages<'a>,
    damaged: Option<LogEnd>,
}

impl Entries<'_> {
    /// How the log ended; meaningful after the last entry.
    pub fn end(&self) -> LogEnd {
        self.damaged.clone().unwrap_or_else(|| self.messages.end())
    }
}

impl Iterator for Entries<'_> {
    type Item = Entry;

    fn next(&mut self) -> Option<Entry> {
        while self.damaged.is_none() {
            let message = self.messages.next()?;
            match decode(&message) {
                Ok(Some(entry)) => return Some(entry),
                Ok(None) => {}
                Err(error) => {
                    self.damaged = Some(LogEnd::Damaged {
                        offset: message.offset,
                        why: format!("message on {}: {error}", message.channel),
                    });
                }
            }
        }
        None
    }
}

/// `None`: the head, or a channel that this version does not know.
fn decode(message: &Message<'_>) -> Result<Option<Entry>, prost::DecodeError> {
    let channel = message.channel.as_str();
    let data = message.data;
    if let Some(decoded) = Decoded::decode(channel, data) {
        return decoded.map(|decoded| Some(Entry::Decoded(decoded)));
    }
    let raw_link = |prefix| channel.strip_prefix(prefix).and_then(channels::link_from_name);
    Ok(Some(if channel == channels::WAKE.0 {
        let wake = pb::Wake::decode(data)?;
        Entry::Input {
            sequence: wake.sequence,
            at: HostTime::from_us(wake.host_time_us),
            input: RawInput::Wake,
        }
    } else if channel == channels::FILE.0 {
        let answer = pb::FileAnswer::decode(data)?;
        let fault = match answer.fault {
            0 => None,
            // A fault of a newer build: it was not done, for some reason.
            number => Some(
                u8::try_from(number)
                    .ok()
                    .and_then(FileFault::from_number)
                    .unwrap_or(FileFault::Failed),
            ),
        };
        Entry::Input {
            sequence: answer.sequence,
            at: HostTime::from_us(answer.host_time_us),
            input: RawInput::File { ticket: answer.ticket, fault, bytes: answer.data },
        }
    } else if channel == channels::CALENDAR.0 {
        let calendar = pb::Calendar::decode(data)?;
        Entry::Input {
            sequence: calendar.sequence,
            at: HostTime::from_us(calendar.host_time_us),
            input: RawInput::Calendar { unix_us: calendar.unix_us },
        }
    } else if channel == channels::END_ASKED.0 {
        let asked = pb::EndAsked::decode(data)?;
        Entry::Input {
            sequence: asked.sequence,
            at: HostTime::from_us(asked.host_time_us),
            input: RawInput::EndAsked,
        }
    } else if channel == channels::EVENT.0 {
        let event = pb::LinkEvent::decode(data)?;
        let Ok(number) = u8::try_from(event.link) else { return Ok(None) };
        let link = LinkId::from_number(number);
        let input = match event.kind() {
            pb::link_event::Kind::Up => RawInput::LinkUp { link },
            pb::link_event::Kind::Down => RawInput::LinkDown { link },
            pb::link_event::Kind::Unknown => return Ok(None),
        };
        Entry::Input { sequence: event.sequence, at: HostTime::from_us(event.host_time_us), input }
    } else if channel == channels::PEER.0 {
        let peer = pb::LinkPeer::decode(data)?;
        let (Ok(number), Ok(address)) = (u8::try_from(peer.link), peer.address.parse()) else {
            return Ok(None);
        };
        let input = RawInput::Peer { link: LinkId::from_number(number), address };
        Entry::Input { sequence: peer.sequence, at: HostTime::from_us(peer.host_time_us), input }
    } else if channel == channels::LOST.0 {
        let lost = pb::Lost::decode(data)?;
        let reason = DropReason::ALL.into_iter().find(|reason| reason.name() == lost.reason);
        let (Ok(number), Some(reason)) = (u8::try_from(lost.link), reason) else { return Ok(None) };
        let input = RawInput::Lost { link: LinkId::from_number(number), reason, count: lost.count };
        Entry::Input { sequence: lost.sequence, at: HostTime::from_us(lost.host_time_us), input }
    } else if let Some(link) = raw_link("/in/") {
        let raw = pb::RawBytes::decode(data)?;
        Entry::Input {
            sequence: raw.sequence,
            at: HostTime::from_us(raw.host_time_us),
            input: RawInput::Bytes { link, bytes: raw.data },
        }
    } else if let Some(link) = raw_link("/out/") {
        let raw = pb::RawBytes::decode(data)?;
        Entry::Output {
            sequence: raw.sequence,
            at: HostTime::from_us(raw.host_time_us),
            link,
            bytes: raw.data,
        }
    } else if channel == channels::HOLE.0 {
        Entry::Hole(pb::Hole::decode(data)?)
    } else if channel == channels::CLOSING.0 {
        Entry::Closing(pb::Closing::decode(data)?)
    } else {
        return Ok(None);
    }))
}

/// Channel u16, then the length in bytes u32 of what follows.
fn is_message_index(body: &[u8]) -> bool {
    let length = body.get(2..6).and_then(|b| b.first_chunk::<4>()).map(|b| u32::from_le_bytes(*b));
    // Not 6 and the length: where addresses have 32 bits the sum may not fit.
    length.is_some_and(|length| body.len().checked_sub(6) == usize::try_from(length).ok())
}

/// One message of any channel.
#[derive(Debug)]
pub(super) struct Message<'a> {
    /// Offset in the file, for error messages.
    pub offset: usize,
    pub channel: String,
    pub sequence: u32,
    pub log_time: u64,
    pub data: &'a [u8],
}

/// Walks the records of a file and of its chunks.
#[derive(Debug)]
pub(super) struct Messages<'a> {
    file: Walk<'a>,
    chunk: Option<Walk<'a>>,
    /// The chunk was never closed, or the file ends within it: nothing follows.
    open: bool,
    channels: BTreeMap<u16, String>,
    end: Option<LogEnd>,
}

impl<'a> Messages<'a> {
    /// `bytes` begins with the magic.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let file = Walk { bytes, at: mcap::MAGIC.len(), base: 0 };
        Self { file, chunk: None, open: false, channels: BTreeMap::new(), end: None }
    }

    /// How it ended.
    pub(super) fn end(&self) -> LogEnd {
        self.end.clone().unwrap_or(LogEnd::Cut { offset: self.file.at })
    }

    fn stop(&mut self, end: LogEnd) -> Option<Message<'a>> {
        self.end.get_or_insert(end);
        self.chunk = None;
        None
    }
}

impl<'a> Iterator for Messages<'a> {
    type Item = Message<'a>;

    fn next(&mut self) -> Option<Message<'a>> {
        if self.end.is_some() {
            return None;
        }
        loop {
            let in_chunk = self.chunk.is_some();
            let walk = self.chunk.as_mut().unwrap_or(&mut self.file);
            let offset = walk.base + walk.at;
            let Some((opcode, body)) = walk.next() else {
                if in_chunk && !self.open {
                    self.chunk = None;
                    continue;
                }
                if !in_chunk && let Some(open) = self.file.open_chunk() {
                    (self.chunk, self.open) = (Some(open), true);
                    continue;
                }
                return self.stop(LogEnd::Cut { offset });
            };
            let damaged = |why: String| LogEnd::Damaged { offset, why };
            match opcode {
                op::DATA_END if !in_chunk => {
                    // Nothing of ours follows, but without the index and the closing magic most
                    // viewers refuse the file.
                    let closed = self.file.bytes.ends_with(mcap::MAGIC);
                    let end = if closed { LogEnd::Complete } else { LogEnd::Cut { offset } };
                    return self.stop(end);
                }
                op::CHANNEL | op::MESSAGE | op::CHUNK => {}
                // Skipped, so it must be what it says: a chunk whose opcode is damaged is not.
                op::MESSAGE_INDEX if !is_message_index(body) => {
                    return self.stop(damaged("a message index of the wrong length".into()));
                }
                op::HEADER..=op::DATA_END => continue,
                other => return self.stop(damaged(format!("no record has opcode {other:#04x}"))),
            }
            if opcode == op::CHANNEL && body.len() > LONGEST_CHANNEL_BYTES {
                return self.stop(damaged("a channel record of absurd length".into()));
            }
            if opcode == op::CHUNK && !in_chunk && is_untold(body) {
                let base = offset + RECORD_HEAD_BYTES + CHUNK_HEAD_BYTES;
                let bytes = body.get(CHUNK_HEAD_BYTES..).unwrap_or_default();
                (self.chunk, self.open) = (Some(Walk { bytes, at: 0, base }), true);
                continue;
            }
            match mcap::read::parse_record(opcode, body) {
                Ok(Record::Channel(channel)) => {
                    self.channels.insert(channel.id, channel.topic);
                }
                Ok(Record::Message { header, .. }) => {
                    let Some(channel) = self.channels.get(&header.channel_id).cloned() else {
                        let why = format!("message on unknown channel {}", header.channel_id);
                        return self.stop(damaged(why));
                    };
                    let data = body.get(MESSAGE_HEAD_BYTES..).unwrap_or_default();
                    let (sequence, log_time) = (header.sequence, header.log_time);
                    return Some(Message { offset, channel, sequence, log_time, data });
                }
                Ok(Record::Chunk { header, .. }) if !in_chunk => {
                    if !header.compression.is_empty() {
                        return self.stop(damaged(format!(
                            "chunk compressed with {}; run `mcap compress --compression none` on \
                             the file first",
                            header.compression
                        )));
                    }
                    let length = usize::try_from(header.compressed_size).unwrap_or(usize::MAX);
                    let start = body.len().saturating_sub(length);
                    let data = body.get(start..).unwrap_or_default();
                    if header.uncompressed_crc != 0 && crc32(data) != header.uncompressed_crc {
                        return self.stop(damaged("chunk with a wrong checksum".into()));
                    }
                    let base = offset + RECORD_HEAD_BYTES + start;
                    self.chunk = Some(Walk { bytes: data, at: 0, base });
                }
                Ok(_) => return self.stop(damaged(format!("opcode {opcode:#04x} out of place"))),
                Err(error) => return self.stop(damaged(error.to_string())),
            }
        }
    }
}

/// Channel id, sequence number and two times before the data of a message.
const MESSAGE_HEAD_BYTES: usize = 2 + 4 + 8 + 8;

fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// Steps over opcode, length and body.
#[derive(Debug)]
struct Walk<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Offset of `bytes` in the file.
    base: usize,
}

/// Head of a chunk without compression: two times, length, checksum, an empty name, length.
const CHUNK_HEAD_BYTES: usize = 8 + 8 + 8 + 4 + 4 + 8;
/// Where in it the length of the compression's name stands.
const COMPRESSION_AT: usize = 8 + 8 + 8 + 4;

/// Whether the head of a chunk was not told all about it: the disk was full or the power failed between the
/// length of the record and that of the chunk, which is written last.
fn is_untold(body: &[u8]) -> bool {
    body.get(COMPRESSION_AT..CHUNK_HEAD_BYTES)
        .is_some_and(|end| end[..4] == [0; 4] && end[4..] == u64::MAX.to_le_bytes())
}

impl<'a> Walk<'a> {
    /// The records of a chunk that runs beyond the end of the file: one that was being written when the
    /// power failed, or a file that was cut. There is no checksum of a part, so what was torn in
    /// it is only noticed by its form.
    fn open_chunk(&self) -> Option<Walk<'a>> {
        let (opcode, rest) = self.bytes.get(self.at..)?.split_first()?;
        let body = rest.get(8..)?;
        let plain = body.get(COMPRESSION_AT..COMPRESSION_AT + 4)? == [0; 4];
        let bytes = body.get(CHUNK_HEAD_BYTES..).filter(|_| *opcode == op::CHUNK && plain)?;
        let base = self.base + self.at + RECORD_HEAD_BYTES + CHUNK_HEAD_BYTES;
        Some(Walk { bytes, at: 0, base })
    }
}

impl<'a> Iterator for Walk<'a> {
    type Item = (u8, &'a [u8]);

    /// `None` when the next record is not complete; `at` then stays on it.
    fn next(&mut self) -> Option<Self::Item> {
        let (opcode, rest) = self.bytes.get(self.at..)?.split_first()?;
        let (length, rest) = rest.split_first_chunk::<8>()?;
        let body = rest.get(..usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
        self.at += RECORD_HEAD_BYTES + body.len();
        Some((*opcode, body))
    }
}
