//! The key, and the times of those who sign with it.
//!
//! Replay protection as the MAVLink guide has it: the timestamps of one stream (system, component and
//! link id of the signature) only grow, on whatever link of ours they come; a stream that is new may be
//! at most a minute behind us; and we are never behind what we have verified, nor behind what we signed
//! before a restart.

use haltere_dialect::mav_stream::MavFrame;
use haltere_dialect::signing::{self, SigningKey, TIMESTAMPS_PER_S};

use haltere_core::drops::DropReason;

/// How far a stream that is new may be behind us, in timestamps of 10 µs (MAVLink guide).
pub const MINUTE: u64 = 60 * TIMESTAMPS_PER_S;
/// Most streams that are followed. Only holders of the key can make one.
pub(super) const MOST_STREAMS: usize = 256;
/// What is kept for a restart is this far ahead, in timestamps: it need not be written more often.
const KEPT_AHEAD: u64 = 10 * TIMESTAMPS_PER_S;
/// It is written again when what is kept is less than this ahead.
const KEPT_MARGIN: u64 = 2 * TIMESTAMPS_PER_S;

/// System, component and link id of the signature.
type Stream = (u8, u8, u8);

/// What a frame's signature is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// There is none, or we have no key to check it.
    Unsigned,
    /// Right and fresh.
    Signed,
    /// Wrong or old.
    Refused(DropReason),
}

/// The key and the times.
#[derive(Debug, Default)]
pub struct KeyRing {
    key: Option<SigningKey>,
    /// The newest timestamp that we signed with or verified.
    newest: u64,
    /// What is on disk, for a restart.
    kept: u64,
    streams: Vec<(Stream, u64)>,
    /// The key before this one and its streams: should it come back, what was signed with it then stays old.
    former: Option<(SigningKey, Vec<(Stream, u64)>)>,
}

impl KeyRing {
    /// With the key in force, and the timestamp that was kept over the restart.
    pub fn new(key: Option<SigningKey>, kept: u64) -> Self {
        Self { key, newest: kept, kept, streams: Vec::new(), former: None }
    }

    /// Whether there is a key.
    pub fn has_key(&self) -> bool {
        self.key.is_some()
    }

    /// Whether this is the key in force.
    pub fn is_key(&self, key: &SigningKey) -> bool {
        self.key.as_ref() == Some(key)
    }

    /// Another key from now on. `timestamp`: what its giver says the time is.
    pub fn change(&mut self, key: SigningKey, timestamp: u64) {
        self.newest = self.newest.max(timestamp.min(signing::LAST_TIMESTAMP));
        if self.is_key(&key) {
            return;
        }
        // A station that was ahead of its own clock, since we were after a restart, begins again by that clock:
        // held to its old times it would be deaf for seconds. Its old frames do not verify any more.
        let streams = match self.former.take() {
            Some((former, streams)) if former == key => streams,
            _ => Vec::new(),
        };
        let before = std::mem::replace(&mut self.streams, streams);
        self.former = self.key.replace(key).map(|former| (former, before));
    }

    /// Our own time: the clock's, unless we have seen a later one.
    fn now(&self, unix_us: i64) -> u64 {
        self.newest.max(signing::timestamp(unix_us))
    }

    /// What a frame's signature is worth, without taking note of it.
    pub fn look(&self, frame: &MavFrame<'_>, unix_us: i64) -> Standing {
        let (Some(key), Some((link_id, timestamp))) = (&self.key, frame.signature()) else {
            return Standing::Unsigned;
        };
        if !signing::verify(frame, key) {
            return Standing::Refused(DropReason::MavBadSignature);
        }
        let stream = (frame.header.system_id, frame.header.component_id, link_id);
        match self.streams.iter().find(|(known, _)| *known == stream) {
            Some((_, last)) if timestamp <= *last => Standing::Refused(DropReason::MavReplayed),
            Some(_) => Standing::Signed,
            None if timestamp.saturating_add(MINUTE) < self.now(unix_us) => {
                Standing::Refused(DropReason::MavStaleTime)
            }
            None => Standing::Signed,
        }
    }

    /// What a frame's signature is worth; from now on older frames of its stream are replays.
    pub fn admit(&mut self, frame: &MavFrame<'_>, unix_us: i64) -> Standing {
        let standing = self.look(frame, unix_us);
        let (Standing::Signed, Some((link_id, timestamp))) = (standing, frame.signature()) else {
            return standing;
        };
        let stream = (frame.header.system_id, frame.header.component_id, link_id);
        if let Some((_, last)) = self.streams.iter_mut().find(|(known, _)| *known == stream) {
            *last = timestamp;
        } else {
            if self.streams.len() >= MOST_STREAMS && !self.forget_one(unix_us) {
                return Standing::Refused(DropReason::MavStaleTime);
            }
            self.streams.push((stream, timestamp));
        }
        self.newest = self.newest.max(timestamp);
        standing
    }

    /// Makes room for a stream: one that is more than a minute behind us, whose old frames would be
    /// refused as a new stream too. `false`: there is none.
    fn forget_one(&mut self, unix_us: i64) -> bool {
        let now = self.now(unix_us);
        let old = |(_, last): &(Stream, u64)| last.saturating_add(MINUTE) < now;
        match self.streams.iter().position(old) {
            Some(index) => {
                self.streams.swap_remove(index);
                true
            }
            None => false,
        }
    }

    /// The signed form of a frame of ours. `None`: there is no key, or it is no such frame.
    pub fn sign(&mut self, frame: &[u8], link_id: u8, unix_us: i64) -> Option<Vec<u8>> {
        let key = self.key.as_ref()?;
        // No timestamp twice.
        let timestamp = signing::timestamp(unix_us).max(self.newest.saturating_add(1));
        let signed = signing::sign(frame, key, link_id, timestamp)?;
        self.newest = timestamp;
        Some(signed)
    }

    /// The timestamp that must be written to disk now, if any: a restart begins there.
    pub fn due_to_keep(&self, unix_us: i64) -> Option<u64> {
        let now = self.now(unix_us);
        let wanted = now.saturating_add(KEPT_AHEAD).min(signing::LAST_TIMESTAMP);
        (self.key.is_some() && now.saturating_add(KEPT_MARGIN) > self.kept).then_some(wanted)
    }

    /// That it is on disk.
    pub fn was_kept(&mut self, timestamp: u64) {
        self.kept = self.kept.max(timestamp);
    }

    /// Where a restart may begin after an orderly end.
    pub fn newest(&self) -> u64 {
        self.newest
    }

    /// Streams that are followed.
    #[cfg(test)]
    pub(super) fn streams(&self) -> usize {
        self.streams.len()
    }
}
