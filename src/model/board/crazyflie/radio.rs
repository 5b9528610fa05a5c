//! The way between board and companion: a queue of packets and a radio that is polled.
//!
//! When the radio is slower than the blocks ask, rows grow old before any is lost; when the companion hears nothing,
//! neither does the board. Lengths of queues: crazyflie-firmware 2a18fc29, `crtp.c`.

use std::collections::VecDeque;

use haltere_core::checks::Problems;
use haltere_dialect::crtp::packet::Packet;
use serde::{Deserialize, Serialize};

use crate::random::Stream;

/// Packets that wait to be sent; what comes then is lost.
pub(super) const QUEUE: usize = 200;

/// How good it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Radio {
    /// Packets a second that it fetches from the board. 0: no limit, as with USB.
    pub packets_hz: f64,
    /// Share of packets that is lost, each way.
    pub lost: f64,
    /// A packet is under way for up to this long, s, each way.
    pub age_s: f64,
}

impl Default for Radio {
    /// What the maintainers promise of a small packet (crazyflie-testing, `requirements`: 500 a second at least).
    fn default() -> Self {
        Self { packets_hz: 500.0, lost: 0.0, age_s: 0.0 }
    }
}

impl Radio {
    pub(super) fn check(&self, key: &str, problems: &mut Problems) {
        problems.range(format_args!("{key}.packets_hz"), self.packets_hz, 0.0..=5000.0, "Hz");
        problems.range(format_args!("{key}.lost"), self.lost, 0.0..=1.0, "");
        problems.range(format_args!("{key}.age_s"), self.age_s, 0.0..=1.0, "s");
    }
}

/// Packets of one direction that are under way, with the time at which each arrives, µs.
#[derive(Default)]
struct Air {
    packets: VecDeque<(u64, Packet)>,
    last_us: u64,
}

impl Air {
    fn send(&mut self, now_us: u64, radio: &Radio, rng: &mut Stream, packet: Packet) {
        // Both are drawn each time, so that neither shifts the other's.
        let (luck, age_s) = (rng.uniform(), rng.between(0.0, radio.age_s.max(f64::MIN_POSITIVE)));
        if luck < radio.lost {
            return;
        }
        self.last_us = self.last_us.max(now_us + (age_s * 1e6) as u64);
        self.packets.push_back((self.last_us, packet));
    }

    fn arrived(&mut self, now_us: u64) -> Option<Packet> {
        let (due_us, packet) = *self.packets.front()?;
        if due_us > now_us {
            return None;
        }
        self.packets.pop_front();
        Some(packet)
    }
}

/// The link.
pub(super) struct Link {
    pub radio: Radio,
    queue: VecDeque<Packet>,
    up: Air,
    down: Air,
    rng: Stream,
    /// Packets that it may fetch by now.
    credit: f64,
    /// Nothing passes before this time, µs.
    silent_until_us: u64,
    /// Rate under congestion, Hz.
    pub congested_hz: Option<f64>,
}

impl Link {
    pub fn new(radio: Radio, seed: u64) -> Self {
        Self {
            radio,
            queue: VecDeque::new(),
            up: Air::default(),
            down: Air::default(),
            rng: Stream::new(seed, "crazyflie-radio"),
            credit: 0.0,
            silent_until_us: 0,
            congested_hz: None,
        }
    }

    /// Nothing passes until this time, µs.
    pub fn silence(&mut self, until_us: u64) {
        self.silent_until_us = until_us;
    }

    fn passes(&self, now_us: u64) -> bool {
        now_us >= self.silent_until_us
    }

    /// From the companion, into the air.
    pub fn up(&mut self, now_us: u64, packet: Packet) {
        if self.passes(now_us) {
            self.up.send(now_us, &self.radio, &mut self.rng, packet);
        }
    }

    /// What has arrived at the board.
    pub fn arrived(&mut self, now_us: u64) -> Option<Packet> {
        self.up.arrived(now_us)
    }

    /// From the board, into its queue.
    pub fn down(&mut self, packet: Packet) {
        if self.queue.len() < QUEUE {
            self.queue.push_back(packet);
        }
    }

    #[cfg(test)]
    pub fn waiting(&self) -> usize {
        self.queue.len()
    }

    /// The board forgets what waits.
    pub fn flush(&mut self) {
        self.queue.clear();
    }

    /// A time of `dt_s` passes: the radio fetches what it can, and what has arrived goes to `out`, each packet
    /// behind its length.
    pub fn pass(&mut self, now_us: u64, dt_s: f64, out: &mut Vec<u8>) {
        let rate_hz = self.congested_hz.unwrap_or(self.radio.packets_hz);
        self.credit = if rate_hz > 0.0 {
            (self.credit + rate_hz * dt_s).min(rate_hz * dt_s + 1.0)
        } else {
            f64::MAX
        };
        while self.passes(now_us) && self.credit >= 1.0 {
            let Some(packet) = self.queue.pop_front() else { break };
            self.credit -= 1.0;
            self.down.send(now_us, &self.radio, &mut self.rng, packet);
        }
        while let Some(packet) = self.down.arrived(now_us) {
            out.push(packet.bytes().len() as u8);
            out.extend_from_slice(packet.bytes());
        }
    }
}
