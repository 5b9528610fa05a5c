//! The key, and the times of those who sign with it.
//!
//! Replay protection as the MAVLink guide has it: the timestamps of one stream (system, component and
//! link id of the signature) only grow, on whatever link of ours they come; a stream that is new may be
//! at most a minute behind us; and what we sign is never behind what we signed before a restart.
//!
//! However far ahead a frame is, it comes in: its stream is then held to its time, and others are not. One
//! holder of the key, or one whose clock is wrong, must not shut out those whose clocks are right. So where our
//! clock is set, new streams are judged by it alone, and what we sign follows others by a minute at most.

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

/// 2026-11-01 00:00 UTC, µs since 1970: before this build. A clock that says less was never set, as that of a
/// computer without a battery, which begins in 1970.
const SET_SINCE_US: i64 = 1_793_491_200_000_000;
/// The time that a clock which was not set is given may lie so far behind that, µs: 30 years, which no build lives.
const PLAUSIBLE_US: i64 = 30 * 365 * 86_400 * 1_000_000;
/// What was kept is believed against a clock that is set when it is ahead of it by no more, timestamps: a clock that
/// goes on where the computer was switched off is a day behind. Further, it is the record of a wrong time.
const DAY: u64 = 24 * 60 * MINUTE;

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

/// What became of our time, for people.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeNews {
    /// Our clock was never set: from now on the time is what this frame said, µs since 1970.
    Taken {
        /// System and component of the sender.
        from: (u8, u8),
        /// The time.
        unix_us: i64,
    },
    /// Somebody signs so far ahead of our time, s: one of the two clocks is wrong.
    Ahead {
        /// System and component of the sender.
        from: (u8, u8),
        /// By how much, s.
        by_s: u64,
    },
    /// What was kept over a restart is so far ahead of our clock, s, that it is not used.
    KeptUnused {
        /// By how much, s.
        by_s: u64,
    },
}

/// The key and the times.
#[derive(Debug, Default)]
pub struct KeyRing {
    key: Option<SigningKey>,
    /// The newest timestamp that we signed with.
    signed: u64,
    /// The newest that others signed with, as far as it moves us.
    seen: u64,
    /// From before a restart: new streams are not more than a minute behind it.
    floor: u64,
    /// What is on disk, for a restart.
    kept: u64,
    /// The time that a clock which is not set was given: timestamp, and what the clock said then, µs.
    taken: Option<(u64, i64)>,
    /// What our clock said last, µs.
    clock_us: i64,
    news: Option<TimeNews>,
    told_ahead: bool,
    streams: Vec<(Stream, u64)>,
    /// The key before this one and its streams: should it come back, what was signed with it then stays old.
    former: Option<(SigningKey, Vec<(Stream, u64)>)>,
}

impl KeyRing {
    /// With the key in force, and the timestamp that was kept over the restart.
    pub fn new(key: Option<SigningKey>, kept: u64) -> Self {
        Self { key, signed: kept, floor: kept, kept, ..Self::default() }
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
    pub fn change(&mut self, key: SigningKey, timestamp: u64, from: (u8, u8), unix_us: i64) {
        self.follow(timestamp.min(signing::LAST_TIMESTAMP), from, unix_us);
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

    /// Our time: the clock's if it is set, else what it was given and what has passed since. `None`: we have none.
    fn time(&self, unix_us: i64) -> Option<u64> {
        if unix_us >= SET_SINCE_US {
            return Some(signing::timestamp(unix_us));
        }
        let (timestamp, then_us) = self.taken?;
        let passed_us = unix_us.saturating_sub(then_us).max(0).unsigned_abs();
        Some(timestamp.saturating_add(passed_us / 10).min(signing::LAST_TIMESTAMP))
    }

    /// By which new streams are judged.
    fn now(&self, unix_us: i64) -> u64 {
        self.time(unix_us).unwrap_or(0).max(self.floor)
    }

    /// What our clock says: it may have been set, forward or back.
    fn look_at_clock(&mut self, unix_us: i64) {
        let back = unix_us.saturating_add(1_000_000) < self.clock_us;
        self.clock_us = unix_us;
        if unix_us < SET_SINCE_US {
            return;
        }
        let clock = signing::timestamp(unix_us);
        let ahead = self.floor.saturating_sub(clock);
        if ahead > DAY {
            self.news = Some(TimeNews::KeptUnused { by_s: ahead / TIMESTAMPS_PER_S });
            if self.signed <= self.floor {
                // Nothing was signed since.
                self.signed = 0;
            }
            (self.floor, self.seen) = (0, 0);
        } else if back {
            // Where it was ahead of the right time, so was what we kept of it.
            (self.floor, self.seen) = (0, 0);
        }
    }

    /// Somebody who has the key says what the time is.
    fn follow(&mut self, timestamp: u64, from: (u8, u8), unix_us: i64) {
        let Some(time) = self.time(unix_us) else {
            let earliest = signing::timestamp(SET_SINCE_US).max(self.floor.saturating_sub(MINUTE));
            let latest = signing::timestamp(SET_SINCE_US.saturating_add(PLAUSIBLE_US));
            if (earliest..=latest).contains(&timestamp) {
                self.taken = Some((timestamp, unix_us));
                self.news = Some(TimeNews::Taken { from, unix_us: signing::unix_us(timestamp) });
            }
            return;
        };
        let most = time.saturating_add(MINUTE);
        self.seen = self.seen.max(timestamp.min(most));
        if timestamp > most && !std::mem::replace(&mut self.told_ahead, true) {
            let by_s = timestamp.saturating_sub(time) / TIMESTAMPS_PER_S;
            self.news = Some(TimeNews::Ahead { from, by_s });
        }
    }

    /// What people must be told, once.
    pub fn take_news(&mut self) -> Option<TimeNews> {
        self.news.take()
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
        self.look_at_clock(unix_us);
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
        self.follow(timestamp, (stream.0, stream.1), unix_us);
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
        self.look_at_clock(unix_us);
        let key = self.key.as_ref()?;
        // No timestamp twice.
        let timestamp =
            self.ours(unix_us).max(self.signed.saturating_add(1)).min(signing::LAST_TIMESTAMP);
        let signed = signing::sign(frame, key, link_id, timestamp)?;
        self.signed = timestamp;
        Some(signed)
    }

    /// What we sign with: our time, or what others say as far as we follow.
    fn ours(&self, unix_us: i64) -> u64 {
        self.now(unix_us).max(self.seen)
    }

    /// Where a restart begins that happens now: not behind what we signed, unless our clock has been set back.
    fn restart(&self, unix_us: i64) -> u64 {
        let newest = self.ours(unix_us).max(self.signed);
        let most = self.time(unix_us).map_or(u64::MAX, |time| time.saturating_add(MINUTE));
        newest.min(most.max(self.floor))
    }

    /// The timestamp that must be written to disk now, if any: a restart begins there.
    pub fn due_to_keep(&self, unix_us: i64) -> Option<u64> {
        let now = self.restart(unix_us);
        let wanted = now.saturating_add(KEPT_AHEAD).min(signing::LAST_TIMESTAMP);
        let margin = now.saturating_add(KEPT_MARGIN);
        let set_back = self.kept > wanted.saturating_add(MINUTE);
        (self.key.is_some() && (margin > self.kept || set_back)).then_some(wanted)
    }

    /// That it is on disk.
    pub fn was_kept(&mut self, timestamp: u64) {
        self.kept = timestamp;
    }

    /// Where a restart may begin after an orderly end.
    pub fn newest(&self, unix_us: i64) -> u64 {
        self.restart(unix_us)
    }

    /// Streams that are followed.
    #[cfg(test)]
    pub(super) fn streams(&self) -> usize {
        self.streams.len()
    }
}
