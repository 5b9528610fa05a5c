//! The Loco deck: distance differences of TDoA2 as its driver makes them, and the memory of its anchors.
//!
//! `d(A-B) = |tag - B| - |tag - A|` for consecutive anchors A, B, B the one that was heard now: the last value only,
//! in whole ticks of the radio. Source: crazyflie-firmware 2a18fc29, `lpsTdoa2Tag.c` and `locodeck.c`.

use haltere_dialect::crtp::loco::{ACTIVE, AnchorPosition, HEARD, POSITION_LEN, position};
use haltere_dialect::lps::{RX_BITS, TICK_M, tdoa2};

use crate::tag::Reception;

/// Anchors of TDoA2.
pub const ANCHORS: usize = tdoa2::ANCHORS;
/// An anchor that was heard within this time is there, µs, and so its position.
const ACTIVE_US: u64 = 2_000_000;
/// The chip is asked whether it lives when nothing was heard for so long, µs: 2 to 4 s pass; 4 was seen.
const DEAD_US: u64 = 4_000_000;

#[derive(Debug, Clone, Copy)]
struct Heard {
    at_us: u64,
    counter: u8,
    rx_ticks: i64,
    tx: u32,
}

/// The deck.
pub(super) struct Loco {
    /// Where anchors say that they are, in their own world, z up, m.
    pub positions_m: [Option<[f32; 3]>; ANCHORS],
    heard: [Option<Heard>; ANCHORS],
    /// In the order in which they were heard first.
    order: Vec<u8>,
    /// `d7-0`, `d0-1`, …, m.
    pub tdoa_m: [f64; ANCHORS],
    /// TDoA3 is on the air.
    pub is_tdoa3: bool,
    /// Since when the chip does not answer, µs.
    pub dead_since_us: Option<u64>,
    /// What is added to the positions that anchors say, m.
    pub off_m: [f32; 3],
}

impl Loco {
    pub fn new(positions_m: [Option<[f32; 3]>; ANCHORS]) -> Self {
        Self {
            positions_m,
            heard: [None; ANCHORS],
            order: Vec::new(),
            tdoa_m: [0.0; ANCHORS],
            is_tdoa3: false,
            dead_since_us: None,
            off_m: [0.0; 3],
        }
    }

    /// What a restart leaves of it.
    pub fn restart(&mut self) {
        (self.heard, self.tdoa_m) = ([None; ANCHORS], [0.0; ANCHORS]);
        self.order.clear();
    }

    /// `loco.mode`: 0 while it looks for anchors.
    pub fn mode(&self) -> i64 {
        match (self.order.is_empty(), self.is_tdoa3) {
            (_, true) => 3,
            (true, _) => 0,
            _ => 2,
        }
    }

    /// `deckStatus.bcLoco` is not 0.
    pub fn has_fault(&self, now_us: u64) -> bool {
        self.dead_since_us.is_some_and(|since_us| now_us.saturating_sub(since_us) >= DEAD_US)
    }

    /// A frame of an anchor.
    pub fn hear(&mut self, now_us: u64, r: &Reception<'_>) {
        let b = usize::from(r.source);
        if self.is_tdoa3 || self.dead_since_us.is_some() || b >= ANCHORS {
            return;
        }
        let Ok(packet) = tdoa2::Tdoa2Packet::decode(r.payload) else { return };
        if !self.order.contains(&r.source) {
            self.order.push(r.source);
        }
        let a = (b + ANCHORS - 1) % ANCHORS;
        let now = Heard {
            at_us: now_us,
            counter: packet.counters[b] & 0x7F,
            rx_ticks: r.rx_ticks,
            tx: packet.times[b],
        };
        let last = self.heard[b].replace(now);
        let (Some(last), Some(other)) = (last, self.heard[a]) else { return };
        // The anchor speaks of the very frame that we heard, and both have said where they are.
        let same = packet.counters[a] & 0x7F == other.counter && packet.times[a] != 0;
        if !same || self.positions_m[a].is_none() || self.positions_m[b].is_none() {
            return;
        }
        let wrap = |ticks: i64| ticks.rem_euclid(1 << RX_BITS) as f64;
        let own = f64::from(now.tx.wrapping_sub(last.tx));
        if own == 0.0 {
            return;
        }
        let clock = wrap(now.rx_ticks - last.rx_ticks) / own;
        let since = f64::from(packet.tofs[a]) + f64::from(now.tx.wrapping_sub(packet.times[a]));
        let ticks = wrap(now.rx_ticks - other.rx_ticks) - clock * since;
        self.tdoa_m[b] = ticks.round() * TICK_M;
    }

    fn is_active(&self, id: usize, now_us: u64) -> bool {
        let heard = self.heard.get(id).copied().flatten();
        heard.is_some_and(|heard| now_us.saturating_sub(heard.at_us) < ACTIVE_US)
    }

    /// Bytes of LocoMemory 2; `None`: nothing is at this address.
    pub fn read(&self, address: u32, len: usize, now_us: u64) -> Option<Vec<u8>> {
        let mut bytes = if address == HEARD || address == ACTIVE {
            let all = address == HEARD;
            let ids = self.order.iter().copied();
            let ids: Vec<u8> =
                ids.filter(|id| all || self.is_active(usize::from(*id), now_us)).collect();
            let mut list = vec![ids.len() as u8];
            list.extend(ids);
            list
        } else {
            let id = (0..ANCHORS as u8).find(|id| position(*id) == address)?;
            if len != usize::from(POSITION_LEN) {
                return None;
            }
            let at = self.positions_m[usize::from(id)];
            let valid = at.is_some() && self.is_active(usize::from(id), now_us);
            let mut position_m = at.unwrap_or_default();
            position_m.iter_mut().zip(self.off_m).for_each(|(p, off)| *p += off);
            AnchorPosition { position_m, valid }.bytes().to_vec()
        };
        bytes.resize(len, 0);
        Some(bytes)
    }
}
