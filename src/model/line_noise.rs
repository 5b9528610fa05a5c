//! A one-way line that loses, delays, repeats, swaps, damages and freezes what it carries.
//!
//! The unit is a delivery: what one end writes at one instant, a datagram or a few frames. Each share is
//! the probability that a delivery suffers it; several may befall the same one. Quiet, it draws no random
//! number and is [`Line`].

use crate::link::Line;
use crate::random::Stream;
use haltere_core::checks::Problems;

/// What a line does to deliveries; shares from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LineNoise {
    /// Share that never arrives.
    pub lost: f64,
    /// Share that is late; what is sent behind it waits, as on a serial line.
    pub late: f64,
    /// By how much, s.
    pub late_s: f64,
    /// Share that comes twice.
    pub twice: f64,
    /// Share that is overtaken by the delivery behind it.
    pub swapped: f64,
    /// Share of which one to four bytes are replaced by random ones.
    pub damaged: f64,
    /// Share in whose place the first delivery since the noise began comes again: a buffer that is not
    /// filled any more.
    pub frozen: f64,
}

impl LineNoise {
    /// Whether it does nothing.
    pub fn is_quiet(&self) -> bool {
        *self == Self { late_s: self.late_s, ..Self::default() }
    }

    /// Adds what is out of range to `problems`.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        for (name, share) in [
            ("lost", self.lost),
            ("late", self.late),
            ("twice", self.twice),
            ("swapped", self.swapped),
            ("damaged", self.damaged),
            ("frozen", self.frozen),
        ] {
            problems.range(format_args!("{key}.{name}"), share, 0.0..=1.0, "");
        }
        problems.range(format_args!("{key}.late_s"), self.late_s, 0.0..=10.0, "s");
    }
}

/// A line with noise on it.
#[derive(Debug)]
pub struct NoisyLine {
    line: Line,
    noise: LineNoise,
    rng: Stream,
    /// A delivery that the next one overtakes.
    held: Option<Vec<u8>>,
    /// What a frozen line repeats.
    first: Option<Vec<u8>>,
}

impl NoisyLine {
    /// Quiet. `name` tells its random numbers from those of other lines.
    pub fn new(seed: u64, name: &str) -> Self {
        let (line, noise) = (Line::default(), LineNoise::default());
        Self { line, noise, rng: Stream::new(seed, name), held: None, first: None }
    }

    /// From now on.
    pub fn set(&mut self, noise: LineNoise) {
        self.noise = noise;
        self.first = None;
    }

    /// Sends `bytes` at `now_us`; they arrive after `delay_s` and what the noise adds.
    pub fn send(&mut self, now_us: u64, delay_s: f64, bytes: &[u8]) {
        if self.noise.is_quiet() && self.held.is_none() {
            self.line.send(now_us, delay_s, bytes);
            return;
        }
        let LineNoise { lost, late, late_s, twice, swapped, damaged, frozen } = self.noise;
        // Every share draws its number, whatever becomes of the delivery: one fault's draws do not
        // depend on another's.
        let mut befalls = |share: f64| self.rng.uniform() < share;
        let [lost, late, twice, swapped, damaged, frozen] =
            [lost, late, twice, swapped, damaged, frozen].map(&mut befalls);
        if lost {
            return;
        }
        let delay_s = delay_s + if late { late_s } else { 0.0 };
        let mut bytes = bytes.to_vec();
        if frozen {
            bytes.clone_from(self.first.get_or_insert_with(|| bytes.clone()));
        }
        if damaged {
            self.damage(&mut bytes);
        }
        if swapped && self.held.is_none() {
            self.held = Some(bytes);
            return;
        }
        for _ in 0..=u8::from(twice) {
            self.line.send(now_us, delay_s, &bytes);
        }
        if let Some(held) = self.held.take() {
            self.line.send(now_us, delay_s, &held);
        }
    }

    /// Moves what has arrived by `now_us` to the end of `out`.
    #[inline]
    pub fn receive(&mut self, now_us: u64, out: &mut Vec<u8>) {
        self.line.receive(now_us, out);
    }

    fn damage(&mut self, bytes: &mut [u8]) {
        for _ in 0..=(self.rng.uniform() * MOST_DAMAGED) as u32 {
            let place = (self.rng.uniform() * bytes.len() as f64) as usize;
            if let Some(byte) = bytes.get_mut(place) {
                *byte = (self.rng.uniform() * 256.0) as u8;
            }
        }
    }
}

/// Most bytes of a delivery that are replaced.
const MOST_DAMAGED: f64 = 4.0;

#[cfg(test)]
mod tests {
    use super::*;

    /// Deliveries of eight bytes, all equal to their number, through a line; what came out.
    fn through(noise: LineNoise, count: u8) -> Vec<u8> {
        let mut line = NoisyLine::new(5, "test");
        line.set(noise);
        let mut out = Vec::new();
        for n in 0..count {
            let now_us = 1000 * u64::from(n);
            line.send(now_us, 0.0, &[n; 8]);
            line.receive(now_us, &mut out);
        }
        out
    }

    #[test]
    fn prop_quiet_is_a_plain_line() {
        let out = through(LineNoise::default(), 200);
        assert!(out.chunks(8).zip(0..).all(|(chunk, n)| chunk == [n; 8]) && out.len() == 1600);
    }

    #[test]
    fn prop_each_share_does_what_it_says() {
        let quiet = LineNoise::default();
        let n = 250.0;
        let lost = through(LineNoise { lost: 0.1, ..quiet }, 250).len() as f64 / 8.0;
        assert!((0.85..0.95).contains(&(lost / n)), "{lost}");
        let twice = through(LineNoise { twice: 0.1, ..quiet }, 250).len() as f64 / 8.0;
        assert!((1.05..1.15).contains(&(twice / n)), "{twice}");
        let damaged = through(LineNoise { damaged: 0.1, ..quiet }, 250);
        let wrong = damaged.chunks(8).zip(0..).filter(|(c, n)| *c != [*n; 8]).count() as f64;
        assert!(damaged.len() == 2000 && (0.05..0.15).contains(&(wrong / n)), "{wrong}");
        let swapped = through(LineNoise { swapped: 0.1, ..quiet }, 250);
        let order: Vec<u8> = swapped.chunks(8).map(|c| c[0]).collect();
        let back = order.windows(2).filter(|w| w[1] < w[0]).count() as f64;
        assert!((0.05..0.15).contains(&(back / n)), "{back}");
        assert!(order.windows(2).all(|w| w[1] >= w[0] || w[0] - w[1] == 1), "{order:?}");
        let frozen = through(LineNoise { frozen: 1.0, ..quiet }, 20);
        assert_eq!(frozen, [0; 160]);
    }

    #[test]
    fn prop_what_is_late_holds_up_what_follows() {
        let mut line = NoisyLine::new(5, "test");
        line.set(LineNoise { late: 1.0, late_s: 0.05, ..LineNoise::default() });
        let mut out = Vec::new();
        line.send(0, 0.0, b"a");
        line.set(LineNoise::default());
        line.send(1000, 0.0, b"b");
        line.receive(49_000, &mut out);
        assert!(out.is_empty());
        line.receive(50_000, &mut out);
        assert_eq!(out, b"ab");
    }

    #[test]
    fn prop_refuses_shares_beyond_one() {
        let mut problems = Problems::new();
        LineNoise { lost: 1.5, late_s: 20.0, ..LineNoise::default() }.check("x", &mut problems);
        assert_eq!(problems.lines().len(), 2, "{problems}");
    }
}
