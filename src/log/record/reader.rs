//! Reads a log: whole, cut by a power loss, or damaged in places; what is bad is stepped over and named.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use prost::Message as _;

use super::channels::{self, Decoded};
use super::entry::{Entry, decode};
use super::errors::{LogEnd, LogError};
use super::forms::unchecked;
use super::messages::{Message, Messages, WalkEnd};
use super::names::utc_text;
use super::outline::Outline;
use super::pb;
use super::session::Session;
use super::source::{Source, Window};
use super::tail::Tail;

/// A log, whose head is in memory.
#[derive(Debug)]
pub struct LogReader {
    path: PathBuf,
    source: Source,
    tail: Option<Tail>,
    session: Session,
    /// The message it was read from.
    head: Vec<u8>,
    /// Whether it was the first message, with nothing damaged before it.
    head_whole: bool,
}

impl LogReader {
    /// Opens the file and reads its head.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, LogError> {
        let path = path.as_ref().to_owned();
        match Source::file(&path) {
            Ok(source) => Self::of(path, source)?.alone(),
            Err(source) => Err(LogError::Io { path, source }),
        }
    }

    /// As [`LogReader::open`], with the content at hand; `path` is for messages only.
    pub fn from_bytes(path: PathBuf, bytes: Vec<u8>) -> Result<Self, LogError> {
        Self::of(path, Source::memory(bytes))?.alone()
    }

    fn session_of(path: &Path, offset: u64, head: &[u8]) -> Result<Session, LogError> {
        let foreign = |why| LogError::Foreign { path: path.to_owned(), offset, why };
        let decoded = pb::Session::decode(head).map_err(|e| foreign(e.to_string()))?;
        Session::check_schema(&decoded).map_err(|why| LogError::Newer {
            path: path.to_owned(),
            version: decoded.program_version.clone(),
            source_hash: decoded.source_hash.clone(),
            why,
        })?;
        Session::from_message(decoded).map_err(|problems| foreign(problems.to_string()))
    }

    fn of(path: PathBuf, source: Source) -> Result<Self, LogError> {
        let begin = Window::new(&source).some(0, mcap::MAGIC.len() as u64).to_vec();
        let end = source.length();
        let closed =
            end.checked_sub(mcap::MAGIC.len() as u64).is_some_and(|at| source.has(at, mcap::MAGIC));
        // The sector with the first bytes may be the one that is bad.
        if begin != mcap::MAGIC && !closed {
            return Err(if mcap::MAGIC.starts_with(&begin) {
                LogError::NoHead { path, offset: end, why: "the file ends".into() }
            } else {
                LogError::NotMcap { path }
            });
        }
        let tail = Tail::read(&source);
        let mut messages = Messages::new(&source, tail.as_ref());
        let mut found = None;
        while let Some(message) = messages.next() {
            let (offset, channel) = (message.offset, message.channel.clone());
            if *channel == *channels::CONFIG.0 {
                found = Some((offset, message.data.to_vec()));
                break;
            }
            if messages.damage().is_empty() {
                let why = format!(
                    "the first message is on channel {channel}, not on {}",
                    channels::CONFIG.0
                );
                return Err(LogError::Foreign { path, offset, why });
            }
        }
        // A log of an older build has its head once. What its metadata say of it must agree.
        let head = found.or_else(|| {
            let (about, data) = unchecked(&source, channels::CONFIG.0)?;
            let head = pb::Session::decode(&*data).ok()?;
            let told = |name: &str, value: &str| {
                about.metadata.get(name).map(String::as_str) == Some(value)
            };
            let agrees = told("config_toml", &head.config_toml)
                && told("source_hash", &head.source_hash)
                && told("started_unix_us", &head.started_unix_us.to_string())
                && told("pilot_started_us", &head.pilot_started_us.to_string());
            agrees.then_some((0, data))
        });
        let Some((offset, head)) = head else {
            let end = messages.end();
            return Err(match (messages.damage().first(), end) {
                (Some(damage), _) => {
                    LogError::NoHead { path, offset: damage.offset, why: damage.why.clone() }
                }
                (None, WalkEnd::Complete) => {
                    LogError::Foreign { path, offset: 0, why: "it holds no message".into() }
                }
                (None, WalkEnd::Cut(offset)) => {
                    LogError::NoHead { path, offset, why: "the file ends".into() }
                }
                (None, WalkEnd::Unreadable(offset, why)) => LogError::NoHead { path, offset, why },
            });
        };
        let session = Self::session_of(&path, offset, &head)?;
        let head_whole = messages.damage().is_empty();
        drop(messages);
        Ok(Self { path, source, tail, session, head, head_whole })
    }

    /// Refuses a file that holds a second session.
    fn alone(self) -> Result<Self, LogError> {
        let first = utc_text(self.session.started_unix_us);
        match self.second() {
            None => Ok(self),
            Some((offset, None)) => Err(LogError::Twice { offset, first, path: self.path }),
            Some((offset, Some(started_unix_us))) => Err(LogError::Merged {
                offset,
                first,
                second: utc_text(started_unix_us),
                path: self.path,
            }),
        }
    }

    /// Where another session begins, and when it was recorded; without a time it is the same session once more.
    fn second(&self) -> Option<(u64, Option<i64>)> {
        let mut heads = Heads::default();
        let Some(tail) = self.tail.as_ref().filter(|tail| tail.tells_chunks()) else {
            let mut messages = self.messages();
            while let Some(message) = messages.next() {
                if let Some(second) = heads.begins(&message, &self.head) {
                    return Some((message.offset, second));
                }
            }
            return None;
        };
        // The end of the file says in which chunks there are heads, and which channels there are.
        for (from, to) in tail.chunks_with(channels::CONFIG.0) {
            let mut messages = Messages::from(&self.source, Some(tail), from);
            while let Some(message) = messages.next().filter(|message| message.offset < to) {
                if let Some(second) = heads.begins(&message, &self.head) {
                    return Some((message.offset, second));
                }
            }
        }
        let mut ids = tail.channels.iter();
        ids.any(|(id, name)| heads.is_told_twice(*id, name)).then_some((0, None))
    }

    /// Name of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its messages as they are.
    pub(super) fn messages(&self) -> Messages<'_> {
        Messages::new(&self.source, self.tail.as_ref())
    }

    /// What its head and tail say. `None`: it was not closed, or head or tail is damaged: then it must be read whole.
    pub fn outline(&self) -> Option<Outline<'_>> {
        if !self.head_whole {
            return None;
        }
        Outline::of(&self.source, self.tail.as_ref()?)
    }

    /// Message of the head.
    pub(super) fn head(&self) -> &[u8] {
        &self.head
    }

    /// Head of the log.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Everything after the head. [`Entries::end`] tells how the log ended once it is exhausted.
    pub fn entries(&self) -> Entries<'_> {
        self.entries_with(|_| true)
    }

    /// The same with those decoded topics alone whose channel is wanted: most of a log are topics, and who asks the core has no
    /// use for what it told.
    pub fn entries_with(&self, wanted: fn(&str) -> bool) -> Entries<'_> {
        Entries { messages: self.messages(), wanted }
    }

    /// Changes of mode as the log tells them.
    pub fn modes(&self) -> Vec<pb::Mode> {
        let mode = |entry| match entry {
            Entry::Decoded(Decoded::Mode(mode)) => Some(mode),
            _ => None,
        };
        let told = self.outline().and_then(|outline| outline.entries("/mode"));
        let walked = || self.entries_with(|channel| channel == "/mode").filter_map(mode).collect();
        told.map_or_else(walked, |told| told.into_iter().filter_map(mode).collect())
    }
}

/// What a log of one session, written once, holds once: each of the two copies of its head, before everything else, and
/// each other channel.
#[derive(Default)]
struct Heads {
    seen: BTreeSet<u16>,
    channels: BTreeMap<Arc<str>, u16>,
    has_begun: bool,
}

impl Heads {
    /// Whether a session begins with this message that is not the one that runs: when it was recorded, or `None` inside
    /// if it is the same once more.
    fn begins(&mut self, message: &Message<'_>, head: &[u8]) -> Option<Option<i64>> {
        if *message.channel != *channels::CONFIG.0 {
            self.has_begun |= message.sequence > 0;
            return self.is_told_twice(message.channel_id, &message.channel).then_some(None);
        }
        if message.data != head {
            return Some(Some(pb::Session::decode(message.data).ok()?.started_unix_us));
        }
        (self.has_begun || !self.seen.insert(message.channel_id)).then_some(None)
    }

    fn is_told_twice(&mut self, id: u16, name: &Arc<str>) -> bool {
        **name != *channels::CONFIG.0 && *self.channels.entry(name.clone()).or_insert(id) != id
    }
}

/// Iterates over a log. What is missing of a damaged one is missing in the numbers of inputs and outputs.
#[derive(Debug)]
pub struct Entries<'a> {
    messages: Messages<'a>,
    wanted: fn(&str) -> bool,
}

impl Entries<'_> {
    /// How the log ended; meaningful after the last entry.
    pub fn end(&self) -> LogEnd {
        self.messages.log_end()
    }
}

impl Iterator for Entries<'_> {
    type Item = Entry;

    fn next(&mut self) -> Option<Entry> {
        loop {
            let message = self.messages.next()?;
            if !(self.wanted)(&message.channel) && channels::is_decoded(&message.channel) {
                continue;
            }
            let offset = message.offset;
            match decode(&message) {
                Ok(Some(entry)) => return Some(entry),
                Ok(None) => {}
                Err(error) => {
                    let why = not_decoded(&message, &error);
                    self.messages.note(offset, why);
                }
            }
        }
    }
}

/// Why a message cannot be understood, for who copies messages as they are.
pub(super) fn fault(message: &Message<'_>) -> Option<String> {
    decode(message).err().map(|error| not_decoded(message, &error))
}

fn not_decoded(message: &Message<'_>, error: &prost::DecodeError) -> String {
    format!("message on {}: {error}", message.channel)
}
