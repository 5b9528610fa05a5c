//! Radio: U1 to U3, U5 to U10.
//!
//! Forms: Student-t noise, wider (U1); a bias that depends a little on range (U2); measured-like lobes
//! of the antenna (U3); an oval with a soft rim and one-sided excess delay (U5); two-ray ripple that
//! fades exponentially with height (U6); the anchor stands elsewhere (U7); drift plus random walk
//! (U8); losses in bursts after Gilbert and Elliott (U9); reflections of exponential size in bursts
//! (U10).

use nalgebra::Vector3;

use super::aero::spec;
use super::{Deviations, Draw, Spec};
use crate::generator::noise::Noise;

/// Most anchors.
const ANCHORS: usize = 8;
/// Mean length of a loss, receptions.
const LOSS_RUN: f64 = 4.0;
/// Rim of a zone, m.
const RIM_M: f64 = 0.15;

/// What deviates.
#[derive(Debug, Clone, Default)]
pub struct Uwb {
    /// Added to the factor 1 on the noise.
    pub noise: f64,
    /// Per anchor, m.
    bias_m: [f64; ANCHORS],
    lobes_m: f64,
    lobes_rad: f64,
    zone: Option<Zone>,
    low_m: f64,
    /// Displacement of an anchor, Earth, m.
    pub moved: Option<(usize, Vector3<f64>)>,
    drift: Option<(usize, f64)>,
    walk_m: f64,
    loss: f64,
    losing: [bool; ANCHORS],
    bursts_hz: f64,
    burst_m: f64,
    burst_until_s: f64,
}

#[derive(Debug, Clone)]
struct Zone {
    anchor: usize,
    place_NE_m: [f64; 2],
    half_NE_m: [f64; 2],
    bias_m: f64,
    std_m: f64,
}

/// A reception at the tag.
#[derive(Debug, Clone, Copy)]
pub struct Path {
    /// Sender.
    pub from: usize,
    /// Sender, Earth, m.
    pub from_E_m: Vector3<f64>,
    /// Antenna, Earth, m.
    pub tag_E_m: Vector3<f64>,
    /// Heading of the vehicle, rad.
    pub yaw_rad: f64,
    /// Time, s.
    pub t_s: f64,
    /// Time since the last reception, s.
    pub dt_s: f64,
}

impl Uwb {
    /// Takes over bursts and walks.
    pub fn go_on_from(&mut self, old: &Self) {
        (self.walk_m, self.losing, self.burst_until_s) =
            (old.walk_m, old.losing, old.burst_until_s);
    }

    /// Added path, m; `None`: lost.
    pub fn extra_m(&mut self, p: &Path, rng: &mut Noise) -> Option<f64> {
        // Always the same number of draws, so that a flight differs by the effect alone.
        let (u, v, n, e) = (rng.uniform(), rng.uniform(), rng.normal(), rng.exponential());
        let to = p.from_E_m - p.tag_E_m;
        let (range_m, height_m) = (to.norm(), -p.tag_E_m.z);
        let bias = self.bias_m.get(p.from).copied().unwrap_or(0.0);
        let mut extra = bias * (0.8 + 0.05 * range_m);
        if self.lobes_m > 0.0 {
            let a = to.y.atan2(to.x) - p.yaw_rad - self.lobes_rad;
            let flat = (to.x.hypot(to.y) / range_m.max(0.1)).sqrt();
            let lobes = a.cos() + 0.4 * (2.0 * a + 0.7).cos() + 0.2 * (3.0 * a - 1.1).cos();
            extra += self.lobes_m * lobes * flat;
        }
        if let Some(z) = self.zone.as_ref().filter(|z| z.anchor == p.from) {
            let d = |i: usize, x: f64| (x - z.place_NE_m[i]) / z.half_NE_m[i];
            let radius = d(0, p.tag_E_m.x).hypot(d(1, p.tag_E_m.y));
            let depth_m = (1.0 - radius) * z.half_NE_m[0].min(z.half_NE_m[1]);
            let inside = 1.0 / (1.0 + (-depth_m / RIM_M).exp());
            extra += inside * (z.bias_m - z.std_m + z.std_m * e);
        }
        if self.low_m > 0.0 && -p.from_E_m.z < 1.0 {
            let ripple = 0.75 + 0.25 * (height_m * 22.0 + p.from as f64).cos();
            let fade = 1.25 * (-(height_m / 0.3).powi(2)).exp();
            extra += self.low_m * fade * ripple * (0.55 + 0.45 * e);
        }
        if let Some((_, rate)) = self.drift.filter(|(anchor, _)| *anchor == p.from) {
            self.walk_m += rate.abs() * 2.0 * n * p.dt_s.sqrt() * 0.35;
            extra += rate * p.t_s + self.walk_m;
        }
        if self.bursts_hz > 0.0 {
            if v < self.bursts_hz * p.dt_s {
                self.burst_until_s = p.t_s + 0.15 + 0.3 * e.min(2.5);
            }
            if p.t_s < self.burst_until_s && u < 0.5 {
                extra += (0.4 + 0.45 * self.burst_m * e).min(2.0 * self.burst_m);
            }
        }
        if self.loss > 0.0 {
            let losing = self.losing.get_mut(p.from)?;
            let leave = 1.0 / LOSS_RUN;
            let enter = leave * self.loss / (1.0 - self.loss);
            *losing = if *losing { u >= leave } else { u < enter };
            if *losing {
                return None;
            }
        }
        Some(extra)
    }
}

fn anchor(w: &mut Draw<'_>) -> usize {
    let anchor = w.rng.below(w.hall.anchors.min(ANCHORS));
    w.set.anchor = Some(anchor as u8);
    w.set.note("anchor", anchor as f64);
    anchor
}

fn noise(d: &mut Deviations, w: &mut Draw<'_>) {
    d.uwb.noise = w.size - 1.0;
    w.set.note("factor", w.size);
}

fn bias(d: &mut Deviations, w: &mut Draw<'_>) {
    let bias = w.size * w.rng.sign();
    let n = anchor(w);
    d.uwb.bias_m[n] = bias;
    w.set.note("bias", bias);
}

fn lobes(d: &mut Deviations, w: &mut Draw<'_>) {
    d.uwb.lobes_m = w.size;
    d.uwb.lobes_rad = w.rng.between(-std::f64::consts::PI, std::f64::consts::PI);
    w.set.note("amplitude", w.size);
    w.set.note("phase", d.uwb.lobes_rad.to_degrees());
}

fn zone(d: &mut Deviations, w: &mut Draw<'_>) {
    let anchor = anchor(w);
    let place_NE_m = w.hall.place(w.rng, 0.5);
    let half = w.rng.between(0.8, 1.5);
    let half_NE_m = [half, half * w.rng.between(0.7, 1.3)];
    let std_m = 0.35 * w.size;
    d.uwb.zone = Some(Zone { anchor, place_NE_m, half_NE_m, bias_m: w.size, std_m });
    w.set.place_NE_m = Some(place_NE_m);
    w.set.note("bias", w.size);
    w.set.note("std", std_m);
    w.set.note("north", place_NE_m[0]);
    w.set.note("east", place_NE_m[1]);
    w.set.note("size", half);
}

fn low(d: &mut Deviations, w: &mut Draw<'_>) {
    d.uwb.low_m = w.size;
    w.set.note("bias", w.size);
}

fn moved(d: &mut Deviations, w: &mut Draw<'_>) {
    let n = anchor(w);
    let mut to = Vector3::from_fn(|_, _| w.rng.normal());
    to.z *= 0.5;
    let to = to.normalize() * w.size;
    d.uwb.moved = Some((n, to));
    w.set.note("north", to.x);
    w.set.note("east", to.y);
    w.set.note("down", to.z);
}

fn drift(d: &mut Deviations, w: &mut Draw<'_>) {
    let rate = w.size * w.rng.sign();
    let n = anchor(w);
    d.uwb.drift = Some((n, rate * 1e-3));
    w.set.note("rate", rate);
}

fn loss(d: &mut Deviations, w: &mut Draw<'_>) {
    d.uwb.loss = w.size;
    w.set.note("probability", w.size);
}

fn bursts(d: &mut Deviations, w: &mut Draw<'_>) {
    let per_min = w.rng.between(6.0, 12.0);
    d.uwb.bursts_hz = per_min / 60.0;
    d.uwb.burst_m = w.size;
    w.set.note("rate", per_min);
    w.set.note("size", w.size);
}

/// Entries.
pub static SPECS: &[Spec] = &[
    spec!("U1", "UWB noise level", "uwb", "", [1.4, 3.0], true, noise, Above),
    spec!("U2", "anchor bias", "uwb", "m", [0.08, 0.35], true, bias),
    spec!("U3", "pose-dependent bias", "uwb", "m", [0.05, 0.25], false, lobes),
    spec!("U5", "NLOS zone", "uwb", "m", [0.15, 0.8], false, zone),
    spec!("U6", "near-ground multipath", "uwb", "m", [0.1, 0.5], false, low),
    spec!("U7", "anchor survey error", "uwb", "m", [0.1, 0.5], true, moved),
    spec!("U8", "anchor drift", "uwb", "mm/s", [2.0, 10.0], false, drift),
    spec!("U9", "packet loss", "uwb", "", [0.25, 0.8], true, loss),
    spec!("U10", "outlier bursts", "uwb", "m", [1.0, 6.0], true, bursts),
];
