//! UWB traffic for the tests, built from geometry alone: true times in seconds, each device's
//! clock an offset and a skew, every stamp rounded to its ticks. Shares nothing with the engine
//! but the packet encoders.

use haltere_dialect::lps::sniffer::{self, SnifferFrame};
use haltere_dialect::lps::tdoa2::Tdoa2Packet;
use haltere_dialect::lps::tdoa3::{Remote, Tdoa3Packet};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

use haltere_core::frames::{E, Vec3};
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;

const TICKS_PER_S: f64 = 63_897_600_000.0;
const LIGHT_MPS: f64 = 299_792_458.0;
/// Antenna delays of both ends, ticks.
const DELAY_TICKS: i128 = 32_951;
/// The bytes of every packet are read this long after it was heard.
pub const READ_DELAY_S: f64 = 0.001;

pub fn anchors() -> Vec<(AnchorId, Vec3<E>)> {
    (0..8u8)
        .map(|i| {
            let at = |bit: u8, far: f64| if i & bit != 0 { far } else { 0.3 * f64::from(i) };
            (AnchorId(i), Vec3::new(at(1, 10.0), at(2, 9.0), -at(4, 7.0)))
        })
        .collect()
}

pub fn survey() -> Survey {
    Survey::new(&anchors()).unwrap()
}

#[derive(Clone, Copy)]
pub struct Clock {
    pub offset_ticks: i128,
    pub skew: f64,
    /// Growth of the skew, as of a crystal that warms up.
    pub drift_per_s: f64,
}

impl Clock {
    fn at(&self, t_s: f64) -> i128 {
        let skew = self.skew + 0.5 * self.drift_per_s * t_s;
        self.offset_ticks + (t_s * TICKS_PER_S * (1.0 + skew)).round() as i128
    }
}

/// One packet as bytes of the sniffer.
pub struct Heard {
    pub t_s: f64,
    pub source: u8,
    pub bytes: Vec<u8>,
}

impl Heard {
    pub fn received_at(&self) -> HostTime {
        HostTime::from_us(7_000_000 + ((self.t_s + READ_DELAY_S) * 1e6) as u64)
    }

    /// The same packet so much later, with a receive time that somebody has moved, s.
    pub fn played_again(&self, by_s: f64, grow_s: f64) -> Self {
        let mut bytes = self.bytes.clone();
        let mut rx = [0; 8];
        rx[..5].copy_from_slice(&bytes[1..6]);
        let grow_ticks = (grow_s * TICKS_PER_S).round() as u64;
        let moved = u64::from_le_bytes(rx).wrapping_add(grow_ticks).to_le_bytes();
        bytes[1..6].copy_from_slice(&moved[..5]);
        Self { t_s: self.t_s + by_s, source: self.source, bytes }
    }
}

pub struct Air {
    pub tag: Clock,
    pub anchors: Vec<Clock>,
    pub tag_pos: Box<dyn Fn(f64) -> Vec3<E>>,
    /// Share of packets that each receiver loses, independently.
    pub loss_frac: f64,
    /// One sigma of every arrival, anchors' too, m.
    pub std_arrival_m: f64,
    pub tdoa3: bool,
    pub rng: Xoshiro256PlusPlus,
}

impl Air {
    /// Eight anchors with skews between ±`skew`, clocks that begin just before both wraps.
    pub fn new(skew: f64, seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let clock = |rng: &mut Xoshiro256PlusPlus| Clock {
            offset_ticks: (1 << 40) - rng.random_range(0..1i128 << 34),
            skew: skew * rng.random_range(-1.0..1.0),
            drift_per_s: 0.0,
        };
        let tag = Clock { skew: -skew, ..clock(&mut rng) };
        let mut anchors: Vec<_> = (0..8).map(|_| clock(&mut rng)).collect();
        anchors[3].skew = skew;
        Self {
            tag,
            anchors,
            tag_pos: Box::new(|_| Vec3::new(4.0, 3.0, -1.5)),
            loss_frac: 0.0,
            std_arrival_m: 0.0,
            tdoa3: false,
            rng,
        }
    }

    /// All packets that the tag hears in `span_s`.
    pub fn run(&mut self, span_s: std::ops::Range<f64>) -> Vec<Heard> {
        let at: Vec<_> = anchors().iter().map(|(_, p)| *p).collect();
        let mut heard = Vec::new();
        // What each anchor heard last of each: counter and arrival.
        let mut last = [[None::<(u8, i128)>; 8]; 8];
        let mut counters = [0u8; 8];
        let mut next_s = [0.0f64; 8].map(|_| span_s.start + self.rng.random_range(0.0..0.03));
        let mut slot = 0u32;
        loop {
            let (n, t_s) = if self.tdoa3 {
                let n = (0..8).min_by(|a, b| next_s[*a].total_cmp(&next_s[*b])).unwrap();
                let t_s = next_s[n];
                next_s[n] += self.rng.random_range(0.02..0.05);
                (n, t_s)
            } else {
                slot += 1;
                (slot as usize % 8, span_s.start + f64::from(slot) * 134_217_728.0 / TICKS_PER_S)
            };
            if t_s > span_s.end {
                return heard;
            }
            counters[n] = counters[n].wrapping_add(1) & if self.tdoa3 { 0x7F } else { 0xFF };
            let tx = self.anchors[n].at(t_s);
            let mut remotes = [None; 8];
            for (r, entry) in remotes.iter_mut().enumerate() {
                let tof = ((at[n] - at[r]).norm() / LIGHT_MPS * TICKS_PER_S).round() as i128;
                *entry = last[n][r].map(|(counter, rx)| (counter, rx, tof + DELAY_TICKS));
            }
            let noise_s = |rng: &mut Xoshiro256PlusPlus, std_m: f64| {
                // Sum of twelve uniforms: near enough to a Gaussian.
                let sum: f64 = (0..12).map(|_| rng.random::<f64>()).sum();
                (sum - 6.0) * std_m / LIGHT_MPS
            };
            for m in (0..8).filter(|m| *m != n) {
                if !self.rng.random_bool(self.loss_frac) {
                    let way_s = (at[n] - at[m]).norm() / LIGHT_MPS;
                    let t_rx_s = t_s + way_s + noise_s(&mut self.rng, self.std_arrival_m);
                    last[m][n] = Some((counters[n], self.anchors[m].at(t_rx_s) + DELAY_TICKS));
                }
            }
            if self.rng.random_bool(self.loss_frac) {
                continue;
            }
            let way_s = ((self.tag_pos)(t_s) - at[n]).norm() / LIGHT_MPS;
            let t_rx_s = t_s + way_s + noise_s(&mut self.rng, self.std_arrival_m);
            let rx_ticks = (self.tag.at(t_rx_s) + DELAY_TICKS).rem_euclid(1 << 40) as u64;
            let payload = self.payload(n, counters[n], tx, &remotes);
            let mut bytes = Vec::new();
            let frame =
                SnifferFrame { rx_ticks, source: n as u8, destination: 0xFF, payload: &payload };
            sniffer::encode(&mut bytes, &frame);
            heard.push(Heard { t_s, source: n as u8, bytes });
        }
    }

    fn payload(
        &self,
        n: usize,
        counter: u8,
        tx: i128,
        remotes: &[Option<(u8, i128, i128)>; 8],
    ) -> Vec<u8> {
        let low = |ticks: i128| ticks.rem_euclid(1 << 32) as u32;
        let mut payload = Vec::new();
        if self.tdoa3 {
            let mut packet = Tdoa3Packet { counter, tx: low(tx), ..Default::default() };
            for (id, entry) in remotes.iter().enumerate() {
                if let Some((counter, rx, tof)) = *entry {
                    let tof = Some(tof as u16);
                    packet.remotes.push(Remote { id: id as u8, counter, rx: low(rx), tof });
                }
            }
            packet.encode(&mut payload);
        } else {
            let mut packet = Tdoa2Packet::default();
            for (id, entry) in remotes.iter().enumerate() {
                if let Some((counter, rx, tof)) = *entry {
                    packet.counters[id] = counter;
                    packet.times[id] = low(rx);
                    packet.tofs[id] = tof as u16;
                }
            }
            packet.counters[n] = counter;
            packet.times[n] = low(tx);
            packet.encode(&mut payload);
        }
        payload
    }
}
