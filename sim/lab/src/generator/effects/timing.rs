//! Links and heading: T1 to T3, H1.
//!
//! Forms: a delay that breathes a little (T1, T2); pauses of gamma distributed spacing and random
//! length instead of a Poisson process of fixed length (T3); an offset of north with a share that
//! depends on the heading, as soft iron does (H1).

use super::aero::spec;
use super::{Deviations, Draw, Spec};
use crate::generator::noise::Noise;

/// Longest pause, s.
const LONGEST_S: f64 = 0.6;

/// What deviates.
#[derive(Debug, Clone, Default)]
pub struct Timing {
    tag_s: f64,
    board_s: f64,
    pause_s: f64,
    every_s: f64,
    pause: [f64; 2],
    north_rad: f64,
}

impl Timing {
    /// Takes over the pause that is on, or next.
    pub fn go_on_from(&mut self, old: &Self) {
        self.pause = old.pause;
    }

    /// Further delay of the tag's bytes, s.
    pub fn tag_s(&self, t_s: f64) -> f64 {
        self.tag_s * (1.0 + 0.04 * (t_s / 7.0).sin())
    }
    /// Further delay of bytes to the board, s.
    pub fn board_s(&self, t_s: f64) -> f64 {
        self.board_s * (1.0 + 0.08 * (t_s / 3.0).sin())
    }
    /// Whether a setpoint that arrives now is ignored.
    pub fn pauses(&mut self, t_s: f64, rng: &mut Noise) -> bool {
        if self.pause_s <= 0.0 {
            return false;
        }
        if t_s > self.pause[1] {
            // Sum of two exponentials: pauses keep some distance from one another.
            let wait = 0.5 * self.every_s * (rng.exponential() + rng.exponential());
            let length = (self.pause_s * (0.6 + 0.4 * rng.exponential())).min(LONGEST_S);
            let start =
                if self.pause[1] == 0.0 { t_s + wait } else { self.pause[1].max(t_s) + wait };
            self.pause = [start, start + length];
        }
        t_s >= self.pause[0] && t_s <= self.pause[1]
    }
    /// Further angle from room north to the board's, rad.
    pub fn north_rad(&self, yaw_rad: f64) -> f64 {
        self.north_rad * (1.0 + 0.12 * (yaw_rad + 0.6).cos())
    }
}

fn tag(d: &mut Deviations, w: &mut Draw<'_>) {
    d.timing.tag_s = w.size * 1e-3;
    w.set.note("delay", w.size);
}

fn board(d: &mut Deviations, w: &mut Draw<'_>) {
    d.timing.board_s = w.size * 1e-3;
    w.set.note("delay", w.size);
}

fn pauses(d: &mut Deviations, w: &mut Draw<'_>) {
    let per_min = w.rng.between(10.0, 25.0);
    d.timing.pause_s = w.size;
    d.timing.every_s = 60.0 / per_min;
    w.set.note("length", w.size);
    w.set.note("rate", per_min);
}

fn north(d: &mut Deviations, w: &mut Draw<'_>) {
    let angle = w.size * w.rng.sign();
    d.timing.north_rad = angle.to_radians();
    w.set.note("angle", angle);
}

/// Entries.
pub static SPECS: &[Spec] = &[
    spec!("T1", "UWB time offset", "timing", "ms", [30.0, 95.0], false, tag),
    spec!("T2", "command delay", "link", "ms", [20.0, 80.0], false, board),
    spec!("T3", "dropped setpoints", "link", "s", [0.1, 0.45], true, pauses),
    spec!("H1", "heading misalignment", "inner_loop", "deg", [3.0, 17.0], false, north),
];
