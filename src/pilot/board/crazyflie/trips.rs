//! How long the board takes to answer, and whether it is heard: echoes ten times a second, and the times of its packets.

use haltere_dialect::crtp::ToBoard;
use haltere_dialect::crtp::link::Link;
use haltere_dialect::crtp::packet::Packet;

use haltere_core::time::HostTime;

/// Between two echoes, µs.
const PERIOD_US: i64 = 100_000;
/// Questions that an answer may still come to: 1.6 s of them.
const KEPT: usize = 16;
/// A longer pause between two packets is a silence, s.
const PAUSE_S: f64 = 0.3;
/// The best of more than this is no latency of a radio, s.
const MOST_LATENCY_S: f64 = 0.02;

/// Follows them.
#[derive(Debug, Default)]
pub(crate) struct Trips {
    sent_us: [u64; KEPT],
    next_at: HostTime,
    best_s: Option<f64>,
    heard_at: Option<HostTime>,
    talks_since: HostTime,
}

impl Trips {
    /// The echo that is due.
    pub fn due(&mut self, at: HostTime) -> Option<Packet> {
        if at < self.next_at {
            return None;
        }
        self.next_at = at.offset_us(PERIOD_US);
        self.sent_us.rotate_right(1);
        self.sent_us[0] = at.as_us();
        ToBoard::Link(Link::Echo(&at.as_us().to_le_bytes())).encode()
    }

    /// An echo came: the round trip, s.
    pub fn answered(&mut self, at: HostTime, bytes: &[u8]) -> Option<f64> {
        let sent_us = u64::from_le_bytes(bytes.try_into().ok()?);
        let slot = self.sent_us.iter_mut().find(|us| **us == sent_us && sent_us != 0)?;
        *slot = 0;
        let trip_s = at.seconds_since(HostTime::from_us(sent_us));
        self.best_s = Some(self.best_s.map_or(trip_s, |best_s| best_s.min(trip_s)));
        Some(trip_s)
    }

    /// Least time from the board to our read call, s: half the best round trip. One-way stamps cannot show it.
    pub fn least_s(&self) -> f64 {
        self.best_s.map_or(0.0, |best_s| 0.5 * best_s.clamp(0.0, MOST_LATENCY_S))
    }

    /// A packet came: how long it had been silent, s.
    pub fn heard(&mut self, at: HostTime) -> f64 {
        let silent_s = self.silent_s(at);
        if silent_s > PAUSE_S {
            self.talks_since = at;
        }
        self.heard_at = Some(at);
        silent_s
    }

    /// For how long nothing has come, s.
    pub fn silent_s(&self, at: HostTime) -> f64 {
        self.heard_at.map_or(f64::INFINITY, |t| at.seconds_since(t))
    }

    /// When something came last.
    pub fn heard_at(&self) -> HostTime {
        self.heard_at.unwrap_or_default()
    }

    /// Since when it has spoken without a silence.
    pub fn talks_since(&self) -> HostTime {
        self.talks_since
    }
}
