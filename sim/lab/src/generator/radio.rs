//! UWB of the generator: TDoA2 anchors with clocks of their own, and the passive tag.
//!
//! ```text
//! C_i(t) = c_i + f (t + s_i t + w_i τ (1 - e^(-t/τ)))     clock of a device, ticks of 15.65 ps
//! ```
//! Anchor 0 leads; the others send in their slots as they heard it, each a few µs late in its own way.
//! Places in the room have a bias made of smooth bumps, the antenna has small lobes, low anchors a
//! bias that fades as a Gaussian with height.

use haltere_dialect::lps::{LIGHT_MPS, RX_BITS, TICK_HZ, TICK_M, sniffer, tdoa2, text};
use nalgebra::{UnitQuaternion, Vector3};

use super::craft::Craft;
use super::effects::Deviations;
use super::effects::uwb::Path;
use super::noise::Noise;

/// Slot, ticks of the leading anchor, and grid of sending times, ticks.
const SLOT_TICKS: f64 = 134_217_728.0;
const GRID_TICKS: f64 = 512.0;
/// Antenna delays in every time of flight, ticks.
const DELAY_TICKS: f64 = 32951.0;
/// Warm-up of crystals, s.
const WARM_S: f64 = 90.0;
/// Bumps of the room's bias per anchor.
const BUMPS: usize = 9;
/// Share of the noise outside the usual that lobes of the antenna have, m.
const LOBE_M: f64 = 0.012;
/// Delay of an echo, ticks: 1.4 m.
const ECHO_TICKS: u64 = 300;
const ANCHORS: usize = tdoa2::ANCHORS;
const BOOT: &[u8] = b"\r\nSYSTEM\t: Loco node\r\nCONFIG\t: Mode is Sniffer\r\nSYSTEM\t: Ready\r\n";

#[derive(Debug, Clone, Copy)]
struct Clock {
    start: f64,
    skew: f64,
    warm: f64,
}

impl Clock {
    fn new(rng: &mut Noise) -> Self {
        Self {
            start: rng.uniform() * (1u64 << 40) as f64,
            skew: (2.5e-6 * rng.laplace()).clamp(-1.2e-5, 1.2e-5),
            warm: 1.2e-7 * rng.normal(),
        }
    }
    fn at(&self, t_s: f64) -> f64 {
        let warm = self.warm * WARM_S * (1.0 - (-t_s / WARM_S).exp());
        self.start + TICK_HZ * (t_s + self.skew * t_s + warm)
    }
    fn when(&self, ticks: f64, near_s: f64) -> f64 {
        let mut t = near_s;
        for _ in 0..3 {
            t += (ticks - self.at(t)) / TICK_HZ;
        }
        t
    }
}

#[derive(Debug, Clone)]
struct Anchor {
    id: u8,
    site: Vector3<f64>,
    clock: Clock,
    late_s: f64,
    counter: u8,
    floor_m: f64,
    bumps: [(Vector3<f64>, f64, f64); BUMPS],
    /// Of the others: counter, receive time.
    heard: [Option<(u8, u32)>; ANCHORS],
}

/// Where the tag is.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Time of the state, s.
    pub t_s: f64,
    /// Centre of mass, Earth, m.
    pub pos: Vector3<f64>,
    /// Velocity, m/s.
    pub vel: Vector3<f64>,
    /// Attitude.
    pub q: UnitQuaternion<f64>,
}

/// Anchors and tag.
#[derive(Debug)]
pub struct Radio {
    anchors: Vec<Anchor>,
    tag: Clock,
    slot: u64,
    next_s: f64,
    tof_error: [[f64; ANCHORS]; ANCHORS],
    last_s: f64,
    middle_NE_m: [f64; 2],
    noise: Noise,
    deviating: Noise,
    binary: bool,
    /// Sniffer bytes that the tag has produced.
    pub out: Vec<u8>,
}

impl Radio {
    /// Anchors at surveyed places, by ascending id below 8. Bias of places and anchors belongs to the
    /// room, clocks and noise to the flight.
    pub fn new(anchors: &[(u8, Vector3<f64>)], craft: &Craft, room_seed: u64, seed: u64) -> Self {
        let mut rng = Noise::new(room_seed, "room");
        let mut clocks = Noise::new(seed, "clocks");
        let middle =
            anchors.iter().map(|(_, p)| p).sum::<Vector3<f64>>() / anchors.len().max(1) as f64;
        let anchors: Vec<Anchor> = anchors
            .iter()
            .map(|(id, site)| Anchor {
                id: *id,
                site: *site,
                clock: Clock::new(&mut clocks),
                late_s: 4e-6 * rng.uniform(),
                counter: clocks.below(128) as u8,
                floor_m: if -site.z < 1.0 { craft.floor_m * rng.between(0.4, 1.0) } else { 0.0 },
                bumps: std::array::from_fn(|_| {
                    let at = middle
                        + Vector3::new(
                            rng.between(-3.0, 3.0),
                            rng.between(-3.0, 3.0),
                            rng.between(-1.5, 1.5),
                        );
                    (at, rng.between(0.6, 1.3), 1.6 * craft.field_m * rng.normal())
                }),
                heard: [None; ANCHORS],
            })
            .collect();
        let mut tof_error = [[0.0; ANCHORS]; ANCHORS];
        for (i, j) in (0..ANCHORS).flat_map(|i| (0..i).map(move |j| (i, j))) {
            let error_m = 0.004 * rng.laplace();
            (tof_error[i][j], tof_error[j][i]) = (error_m, error_m);
        }
        Self {
            tag: Clock::new(&mut clocks),
            anchors,
            slot: 0,
            next_s: 0.0,
            tof_error,
            last_s: 0.0,
            middle_NE_m: [middle.x, middle.y],
            noise: Noise::new(seed, "reception"),
            deviating: Noise::new(seed, "deviating reception"),
            binary: false,
            out: BOOT.to_vec(),
        }
    }

    /// Single-character commands.
    pub fn command(&mut self, bytes: &[u8]) {
        for byte in bytes {
            match byte {
                b'b' => self.binary = true,
                b'd' => {
                    self.binary = false;
                    self.out.extend_from_slice(BOOT);
                }
                _ => {}
            }
        }
    }

    /// Everything that is sent before `until_s`.
    pub fn advance(&mut self, until_s: f64, place: &Place, craft: &Craft, d: &mut Deviations) {
        while self.next_s < until_s {
            let slot_s = self.next_s;
            let index = (self.slot % ANCHORS as u64) as usize;
            if let Some(from) = self.anchors.iter().position(|a| usize::from(a.id) == index) {
                self.send(from, slot_s, place, craft, d);
            }
            self.slot += 1;
            if let Some(lead) = self.anchors.first() {
                let ticks = lead.clock.start + self.slot as f64 * SLOT_TICKS;
                self.next_s = lead.clock.when(ticks, slot_s + SLOT_TICKS / TICK_HZ);
            } else {
                self.next_s += SLOT_TICKS / TICK_HZ;
            }
        }
    }

    fn site(&self, index: usize, d: &Deviations) -> Vector3<f64> {
        let moved = d.uwb.moved.filter(|(n, _)| *n == index).map_or(Vector3::zeros(), |(_, m)| m);
        self.anchors[index].site + moved
    }

    fn send(&mut self, from: usize, slot_s: f64, place: &Place, craft: &Craft, d: &mut Deviations) {
        let std_m = craft.uwb_m * (1.0 + d.uwb.noise);
        let site = self.site(from, d);
        let sender = &mut self.anchors[from];
        sender.counter = sender.counter.wrapping_add(1) & 0x7f;
        let clock = sender.clock;
        let due_s = slot_s + sender.late_s;
        let x = (clock.at(due_s) / GRID_TICKS).ceil() * GRID_TICKS;
        let sent_s = clock.when(x, due_s);
        let payload = self.report(from, x, d);
        let counter = self.anchors[from].counter;
        let silent = d.unknown.silent(from, sent_s);

        for to in 0..self.anchors.len() {
            let error_m = std_m * self.noise.student();
            let lost = self.noise.uniform() < craft.loss;
            if to == from || lost || silent {
                continue;
            }
            let path_m = (site - self.site(to, d)).norm() + error_m;
            let clock = &self.anchors[to].clock;
            let rx = clock.at(sent_s + path_m / LIGHT_MPS) + DELAY_TICKS;
            let id = usize::from(self.anchors[from].id);
            self.anchors[to].heard[id] = Some((counter, rx.round() as i64 as u32));
        }

        let tag_E_m = place.pos
            + place.vel * (sent_s - place.t_s)
            + place.q * Vector3::from(craft.antenna_B_m);
        let yaw_rad = place.q.euler_angles().2;
        let mut extra_m = std_m * self.noise.student() + self.room_m(from, &tag_E_m, yaw_rad);
        extra_m += self.anchors[from].floor_m
            * (-(tag_E_m.z / craft.floor_height_m).powi(2)).exp()
            * (1.0 + 0.2 * self.noise.laplace());
        let mut lost = silent | (self.noise.uniform() < craft.loss);
        let path = Path {
            from,
            from_E_m: site,
            tag_E_m,
            yaw_rad,
            t_s: sent_s,
            dt_s: (sent_s - self.last_s).max(0.0),
        };
        self.last_s = sent_s;
        let more = d.uwb.extra_m(&path, &mut self.deviating);
        let person =
            d.unknown.person_m(&site, &tag_E_m, self.middle_NE_m, sent_s, &mut self.deviating);
        let (wrong, twice) = (self.deviating.uniform(), self.deviating.uniform());
        lost |= more.is_none() | person.is_none();
        if lost {
            return;
        }
        extra_m += more.unwrap_or(0.0) + person.unwrap_or(0.0);
        let range_m = (tag_E_m - site).norm() + extra_m;
        let rx = self.tag.at(sent_s + range_m / LIGHT_MPS) + DELAY_TICKS;
        let id = self.anchors[from].id;
        let source = if wrong < d.unknown.wrong_id { id ^ 1 } else { id };
        let frame = sniffer::SnifferFrame {
            rx_ticks: (rx.round() as u64) & ((1 << RX_BITS) - 1),
            source,
            destination: 0xFF,
            payload: &payload,
        };
        // An echo that is heard as a packet of its own, before or after the straight one is reported.
        let echo = sniffer::SnifferFrame {
            rx_ticks: frame.rx_ticks.wrapping_add(ECHO_TICKS) & ((1 << RX_BITS) - 1),
            ..frame
        };
        let share = d.unknown.doubled;
        let frames: &[_] = match twice < share {
            false => &[frame],
            true if twice < 0.5 * share => &[echo, frame],
            true => &[frame, echo],
        };
        for frame in frames {
            if self.binary {
                sniffer::encode(&mut self.out, frame);
            } else {
                text::encode(&mut self.out, frame);
            }
        }
    }

    /// Bias of a place and a bearing, m.
    fn room_m(&self, from: usize, tag: &Vector3<f64>, yaw_rad: f64) -> f64 {
        let a = &self.anchors[from];
        let bumps: f64 = a
            .bumps
            .iter()
            .map(|(at, size, height)| {
                height * (-0.5 * (tag - at).norm_squared() / (size * size)).exp()
            })
            .sum();
        let bearing = (a.site.y - tag.y).atan2(a.site.x - tag.x) - yaw_rad;
        bumps + LOBE_M * (2.0 * bearing + 0.5).cos()
    }

    fn report(&self, from: usize, x: f64, d: &Deviations) -> Vec<u8> {
        let me = &self.anchors[from];
        let mut packet = tdoa2::Tdoa2Packet::default();
        for (index, other) in self.anchors.iter().enumerate() {
            let slot = usize::from(other.id);
            if index == from {
                packet.counters[slot] = me.counter;
                packet.times[slot] = x as i64 as u32;
            } else if let Some((counter, rx)) = me.heard[slot] {
                packet.counters[slot] = counter;
                packet.times[slot] = rx;
                let own = usize::from(me.id);
                let apart_m = (self.site(from, d) - self.site(index, d)).norm();
                let tof = (apart_m + self.tof_error[own][slot]) / TICK_M + DELAY_TICKS;
                packet.tofs[slot] = tof.round().clamp(0.0, 65535.0) as u16;
            }
        }
        let mut payload = Vec::with_capacity(tdoa2::LEN);
        packet.encode(&mut payload);
        payload
    }
}
