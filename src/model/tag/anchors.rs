//! Anchors: when they send, what they heard, what they report.

use haltere_dialect::lps::{TICK_M, tdoa2, tdoa3};
use nalgebra::Vector3;

use crate::effects::{Bank, State};
use crate::random::Stream;
use crate::tag::air::{MAX_ANCHORS, Packet};
use crate::tag::clock::{Clock, TICKS_PER_US, Ticks};
use crate::tag::{Reception, TagProtocol};
use haltere_core::checks::Problems;

/// Slot of TDoA2, ticks of the first anchor's clock (INTERFACES.md).
const SLOT_TICKS: i64 = 1 << 27;
/// The radio sends at multiples of this (DW1000 User Manual: delayed send drops the low 9 bits).
const SEND_GRID_TICKS: i64 = 512;
/// Antenna delays of sender and receiver that stand in every time of flight, ticks (154.6 m).
const ANTENNA_TICKS: f64 = 32951.0;
/// Ticks that light takes for a metre.
const TICKS_PER_M: f64 = 1.0 / TICK_M;
/// Rate of each TDoA3 anchor, Hz (INTERFACES.md).
const TDOA3_HZ: [f64; 2] = [20.0, 50.0];
/// Clocks start anywhere in their 40-bit range: the wraps must not all come together.
const CLOCK_RANGE: f64 = (1u64 << 40) as f64;

/// What one anchor last heard of another.
#[derive(Debug, Clone, Copy, Default)]
struct Heard {
    counter: u8,
    rx: u32,
    yes: bool,
}

/// The anchors and the air between them.
pub struct Anchors {
    protocol: TagProtocol,
    ids: Vec<u8>,
    sites_E_m: Vec<Vector3<f64>>,
    /// Clocks of the anchors; the last is the tag's.
    clocks: Vec<Clock>,
    skews: Vec<f64>,
    counters: [u8; MAX_ANCHORS],
    heard: [[Heard; MAX_ANCHORS]; MAX_ANCHORS],
    /// Straight paths between anchors with the antenna delays, ticks.
    between: [[f64; MAX_ANCHORS]; MAX_ANCHORS],
    /// Times of flight between anchors, ticks, as ranging would settle at.
    tofs: [[u16; MAX_ANCHORS]; MAX_ANCHORS],
    /// TDoA2: place in the frame of each slot; `None`: nobody has it.
    slots: [Option<usize>; tdoa2::ANCHORS],
    slot: i64,
    slot_base: i64,
    /// TDoA3: next sending time of each anchor.
    due: [Ticks; MAX_ANCHORS],
    next: (Ticks, Option<usize>),
    payload: Vec<u8>,
    rng: Stream,
    /// Anchors that faults have silenced.
    pub silent: [bool; MAX_ANCHORS],
}

impl Anchors {
    /// Anchors by ascending id where they truly stand.
    pub fn new(
        protocol: TagProtocol,
        ids: &[u8],
        sites_E_m: &[Vector3<f64>],
        seed: u64,
    ) -> Result<Self, Problems> {
        let mut problems = Problems::new();
        if ids.len() > MAX_ANCHORS {
            problems.say(format!(
                "{} anchors, the simulator holds {MAX_ANCHORS}; leave some out of the survey",
                ids.len()
            ));
        }
        let mut slots = [None; tdoa2::ANCHORS];
        for (index, id) in ids.iter().enumerate() {
            match slots.get_mut(usize::from(*id)) {
                Some(slot) => *slot = Some(index),
                None if protocol == TagProtocol::Tdoa3 => {}
                None => problems.say(format!(
                    "anchor {id}: TDoA2 knows anchors 0 to 7 only; renumber it or use tdoa3"
                )),
            }
        }
        problems.into_result()?;
        let mut rng = Stream::new(seed, "anchors");
        let clocks: Vec<_> =
            (0..=ids.len()).map(|_| Clock::new((CLOCK_RANGE * rng.uniform()) as i64)).collect();
        let mut tofs = [[0; MAX_ANCHORS]; MAX_ANCHORS];
        let mut between = [[0.0; MAX_ANCHORS]; MAX_ANCHORS];
        for (i, a) in sites_E_m.iter().enumerate() {
            for (j, b) in sites_E_m.iter().enumerate() {
                between[i][j] = (a - b).norm() / TICK_M + ANTENNA_TICKS;
                // A hall is far below the 153 m at which the field ends; beyond it saturates.
                tofs[i][j] = between[i][j].round() as u16;
            }
        }
        let due = [(); MAX_ANCHORS].map(|()| Ticks::from_us((rng.uniform() * 50_000.0) as u64));
        let slot_base = clocks.first().map_or(0, |c| c.at(Ticks::from_us(0)).whole);
        let mut anchors = Self {
            protocol,
            ids: ids.to_vec(),
            sites_E_m: sites_E_m.to_vec(),
            skews: vec![0.0; clocks.len()],
            clocks,
            counters: [0; MAX_ANCHORS],
            heard: [[Heard::default(); MAX_ANCHORS]; MAX_ANCHORS],
            between,
            tofs,
            slots,
            slot: 0,
            slot_base,
            due,
            next: (Ticks::from_us(0), None),
            payload: Vec::with_capacity(128),
            rng,
            silent: [false; MAX_ANCHORS],
        };
        anchors.schedule();
        Ok(anchors)
    }

    /// Sets the rates of all clocks.
    pub fn update_clocks(&mut self, t_us: u64, s: &State, bank: &mut Bank) {
        self.skews.fill(0.0);
        bank.clocks(s, &mut self.skews);
        let now = Ticks::from_us(t_us);
        for (clock, skew) in self.clocks.iter_mut().zip(&self.skews) {
            clock.set_skew(now, *skew);
        }
    }

    /// Sends what is due before true time `until_us`. `s` is the state at `s_us`; the tag moves on
    /// from there with its velocity. `antenna_B_m` is the antenna from the centre of mass.
    pub fn advance(
        &mut self,
        s_us: u64,
        until_us: u64,
        s: &State,
        antenna_B_m: Vector3<f64>,
        bank: &mut Bank,
        mut receive: impl FnMut(Reception<'_>),
    ) {
        let until = Ticks::from_us(until_us);
        while self.next.0.since(until) < 0.0 {
            let (at, from) = self.next;
            if let Some(from) = from {
                let since_s = at.since(Ticks::from_us(s_us)) / (TICKS_PER_US * 1e6);
                let tag_E_m = s.pos_E_m + s.R_EB * antenna_B_m + s.vel_E_mps * since_s;
                self.send(at, from, tag_E_m, s, bank, &mut receive);
            }
            self.schedule();
        }
    }

    fn schedule(&mut self) {
        if self.protocol == TagProtocol::Tdoa3 {
            let mut first = (Ticks { whole: i64::MAX, part: 0.0 }, None);
            for (index, due) in self.due.iter().take(self.ids.len()).enumerate() {
                if due.whole < first.0.whole {
                    first = (*due, Some(index));
                }
            }
            self.next = first;
            return;
        }
        let local = Ticks { whole: self.slot_base + self.slot * SLOT_TICKS, part: 0.0 };
        let from = self.slots[(self.slot % tdoa2::ANCHORS as i64) as usize];
        self.next = (self.clocks[0].when(local), from);
        self.slot += 1;
    }

    fn send(
        &mut self,
        at: Ticks,
        from: usize,
        tag_E_m: Vector3<f64>,
        s: &State,
        bank: &mut Bank,
        receive: &mut impl FnMut(Reception<'_>),
    ) {
        if self.protocol == TagProtocol::Tdoa3 {
            let [low, high] = TDOA3_HZ;
            let wait_us = 1e6 / self.rng.between(low, high);
            self.due[from] = at.later(wait_us * TICKS_PER_US);
        }
        // Effects see the packet even when a fault swallows it: their draws must not shift.
        let mut packet = Packet::new(from, &self.sites_E_m, tag_E_m);
        bank.air(s, &mut packet);
        if self.silent[from] {
            return;
        }
        let clock = &self.clocks[from];
        let earliest = clock.at(at).whole;
        let x = (earliest + SEND_GRID_TICKS - 1).div_euclid(SEND_GRID_TICKS) * SEND_GRID_TICKS;
        let sent = clock.when(Ticks { whole: x, part: 0.0 });
        self.counters[from] = self.counters[from].wrapping_add(1) & 0x7f;
        let counter = self.counters[from];

        self.payload.clear();
        self.report(from, x as u32);
        let path_m = packet.tag_range_m + packet.tag_extra_m;
        if !packet.tag_lost {
            let arrival = sent.later(path_m * TICKS_PER_M + ANTENNA_TICKS);
            let tag = self.clocks.last().map_or(arrival, |c| c.at(arrival));
            receive(Reception {
                rx_ticks: tag.rounded(),
                path_m,
                source: self.ids[from],
                payload: &self.payload,
            });
        }
        for (to, hop) in packet.anchor_hops().iter().enumerate() {
            if to == from || hop.lost {
                continue;
            }
            let arrival = sent.later(self.between[from][to] + hop.extra_m * TICKS_PER_M);
            let rx = self.clocks[to].at(arrival).rounded() as u32;
            self.heard[to][from] = Heard { counter, rx, yes: true };
        }
    }

    /// Writes the payload of anchor `from` for a packet sent at `x`.
    fn report(&mut self, from: usize, x: u32) {
        let heard = &self.heard[from];
        if self.protocol == TagProtocol::Tdoa3 {
            let mut packet =
                tdoa3::Tdoa3Packet { counter: self.counters[from], tx: x, ..Default::default() };
            for (to, h) in heard.iter().enumerate().filter(|(_, h)| h.yes) {
                let tof = Some(self.tofs[from][to]);
                let id = self.ids[to];
                packet.remotes.push(tdoa3::Remote { id, counter: h.counter, rx: h.rx, tof });
            }
            packet.encode(&mut self.payload);
            return;
        }
        let mut packet = tdoa2::Tdoa2Packet::default();
        for (slot, index) in self.slots.iter().enumerate() {
            let Some(index) = *index else { continue };
            if index == from {
                packet.counters[slot] = self.counters[from];
                packet.times[slot] = x;
            } else if heard[index].yes {
                packet.counters[slot] = heard[index].counter;
                packet.times[slot] = heard[index].rx;
                packet.tofs[slot] = self.tofs[from][index];
            }
        }
        packet.encode(&mut self.payload);
    }
}
