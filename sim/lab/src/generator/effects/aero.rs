//! Air: A1 to A10.
//!
//! Forms: drag scaled (A1); `tanh` instead of a rational law (A2); a plate per axis (A3); another
//! exponent of thrust (A4); wind with a logarithmic profile over the floor (A5); an L-shaped draught
//! with steep edges (A6); Dryden turbulence (A7); rational cushions instead of exponential ones at
//! floor (A8), ceiling (A9) and wall (A10).

use nalgebra::Vector3;

use super::{Deviations, Draw, Spec};
use crate::generator::noise::Noise;

/// Roughness height of the wind profile, m.
const ROUGH_M: f64 = 0.1;
/// `tanh(x) / x` is one half here.
const HALF_TANH: f64 = 1.915;
/// Width of the edge of a draught, m.
const EDGE_M: f64 = 0.12;

/// What deviates.
#[derive(Debug, Clone)]
pub struct Aero {
    /// Factor on drag, body axes.
    pub drag_scale: [f64; 3],
    /// Speed scale of the tanh law, m/s; 0: the healthy law.
    pub tanh_mps: f64,
    /// Plates: 1/m per axis.
    pub plate_per_m: [f64; 3],
    /// Added to the exponent of thrust.
    pub expo: f64,
    /// Wind at 1 m, m/s.
    wind_NE_mps: [f64; 2],
    draught: Option<Draught>,
    /// Turbulence, m/s, and its scale time, s.
    turbulence: Option<Dryden>,
    /// Gain on the floor, length (m).
    floor: [f64; 2],
    /// Gain at the ceiling, length, ceiling (m).
    ceiling: [f64; 3],
    /// Force (N), length (m), outward normal, its distance (m).
    wall: Option<(f64, f64, Vector3<f64>, f64)>,
}

impl Default for Aero {
    fn default() -> Self {
        Self {
            drag_scale: [1.0; 3],
            tanh_mps: 0.0,
            plate_per_m: [0.0; 3],
            expo: 0.0,
            wind_NE_mps: [0.0; 2],
            draught: None,
            turbulence: None,
            floor: [0.0, 1.0],
            ceiling: [0.0, 1.0, 0.0],
            wall: None,
        }
    }
}

#[derive(Debug, Clone)]
struct Draught {
    corner_NE_m: [f64; 2],
    arm_m: f64,
    wind: Vector3<f64>,
}

#[derive(Debug, Clone)]
struct Dryden {
    std_mps: f64,
    tau_s: f64,
    along: f64,
    across: [[f64; 2]; 2],
    bearing_rad: f64,
}

fn edge(d_m: f64) -> f64 {
    1.0 / (1.0 + (-d_m / EDGE_M).exp())
}

impl Aero {
    /// Takes over the turbulence.
    pub fn go_on_from(&mut self, old: &Self) {
        if let (Some(new), Some(old)) = (&mut self.turbulence, &old.turbulence) {
            (new.along, new.across) = (old.along, old.across);
        }
    }

    /// Bend of the drag law at this speed.
    pub fn bend(&self, speed_mps: f64, healthy_mps: f64) -> f64 {
        if self.tanh_mps > 0.0 {
            let x = speed_mps / self.tanh_mps;
            return if x < 1e-6 { 1.0 } else { x.tanh() / x };
        }
        1.0 / (1.0 + (speed_mps / healthy_mps).powi(2)).sqrt()
    }

    /// Acceleration of the plates, m/s² of the nominal mass.
    pub fn plates(&self, v: &Vector3<f64>) -> Vector3<f64> {
        Vector3::from_fn(|i, _| -self.plate_per_m[i] * v[i] * v[i].abs())
    }

    /// Factor on thrust near floor and ceiling.
    pub fn lift_factor(&self, height_m: f64) -> f64 {
        let [gain, length_m] = self.floor;
        let floor = 1.0 + gain / (1.0 + height_m.max(0.0) / length_m).powi(2);
        let [gain, length_m, ceiling_m] = self.ceiling;
        let below = ((ceiling_m - height_m).max(0.0) / length_m).powi(2);
        floor * (1.0 + gain / (1.0 + below).powi(2))
    }

    /// Force of a wall, Earth, N.
    pub fn wall_n(&self, pos: &Vector3<f64>) -> Vector3<f64> {
        let Some((force_n, length_m, normal, at_m)) = self.wall else { return Vector3::zeros() };
        let away = ((at_m - normal.dot(pos)).max(0.0) / length_m).powi(2);
        normal * (-force_n / (1.0 + away).powf(1.5))
    }

    /// Air at a place, m/s; advances the turbulence by `dt_s`.
    pub fn wind(&mut self, pos: &Vector3<f64>, dt_s: f64, rng: &mut Noise) -> Vector3<f64> {
        let height_m = (-pos.z).max(0.0);
        let profile = (1.0 + height_m / ROUGH_M).ln() / (1.0 + 1.0 / ROUGH_M).ln();
        let [n, e] = self.wind_NE_mps;
        let mut wind = Vector3::new(n, e, 0.0) * profile;
        if let Some(d) = &self.draught {
            let (n, e) = (pos.x - d.corner_NE_m[0], pos.y - d.corner_NE_m[1]);
            // Two legs of an L: one runs north, one east, each half as wide as it is long.
            let half = 0.5 * d.arm_m;
            let leg = |along: f64, across: f64| {
                edge(along + half) * edge(d.arm_m - along) * edge(half - across.abs())
            };
            wind += d.wind * leg(n, e).max(leg(e, n));
        }
        if let Some(t) = &mut self.turbulence {
            let rate = dt_s / t.tau_s;
            let kick = (2.0 * rate).sqrt();
            t.along += -rate * t.along + kick * rng.normal();
            for [u, v] in &mut t.across {
                // Second order, as the lateral spectrum: a lag and its derivative, unit variance.
                let n = kick * rng.normal();
                *u += -rate * *u + n;
                *v += rate * (*u - *v);
            }
            let side = |[u, v]: [f64; 2]| (0.5f64.sqrt()) * (u + 0.73 * (u - v));
            let (a, b, c) = (t.along, side(t.across[0]), side(t.across[1]));
            let (sin, cos) = t.bearing_rad.sin_cos();
            wind += Vector3::new(cos * a - sin * b, sin * a + cos * b, 0.5 * c) * t.std_mps;
        }
        wind
    }
}

fn drag_scale(d: &mut Deviations, w: &mut Draw<'_>) {
    let up = w.rng.sign() > 0.0;
    let kappa = |size: f64| if up { 1.0 + size } else { 1.0 / (1.0 + size) };
    let (x, y) = (kappa(w.size), kappa(w.size * w.rng.between(0.6, 1.0)));
    d.aero.drag_scale = [x, y, 1.0];
    w.set.note("kappa_x", x);
    w.set.note("kappa_y", y);
}

fn saturation(d: &mut Deviations, w: &mut Draw<'_>) {
    d.aero.tanh_mps = w.size / HALF_TANH;
    w.set.note("speed", w.size);
}

fn quadratic(d: &mut Deviations, w: &mut Draw<'_>) {
    d.aero.plate_per_m = [w.size, 1.2 * w.size, 0.8 * w.size];
    w.set.note("c", w.size);
}

fn expo(d: &mut Deviations, w: &mut Draw<'_>) {
    d.aero.expo = w.size * w.rng.sign();
    w.set.note("epsilon", d.aero.expo);
}

fn wind(d: &mut Deviations, w: &mut Draw<'_>) {
    let to = w.rng.between(0.0, std::f64::consts::TAU);
    d.aero.wind_NE_mps = [w.size * to.cos(), w.size * to.sin()];
    w.set.note("north", d.aero.wind_NE_mps[0]);
    w.set.note("east", d.aero.wind_NE_mps[1]);
}

fn draught(d: &mut Deviations, w: &mut Draw<'_>) {
    let place = w.hall.place(w.rng, 0.5);
    let to = w.rng.between(-std::f64::consts::PI, std::f64::consts::PI);
    let arm_m = w.rng.between(0.8, 1.5);
    d.aero.draught = Some(Draught {
        corner_NE_m: place,
        arm_m,
        wind: Vector3::new(to.cos(), to.sin(), 0.0) * w.size,
    });
    w.set.place_NE_m = Some(place);
    w.set.note("speed", w.size);
    w.set.note("towards", to.to_degrees());
    w.set.note("arm_m", arm_m);
}

fn gusts(d: &mut Deviations, w: &mut Draw<'_>) {
    let tau_s = w.rng.between(0.7, 2.5);
    d.aero.turbulence = Some(Dryden {
        std_mps: w.size,
        tau_s,
        along: 0.0,
        across: [[0.0; 2]; 2],
        bearing_rad: w.rng.between(0.0, std::f64::consts::TAU),
    });
    w.set.note("std", w.size);
    w.set.note("tau", tau_s);
}

fn floor(d: &mut Deviations, w: &mut Draw<'_>) {
    // The plausible range is -0.1 to 0.3: the negative side is smaller.
    let sign = if w.size <= 0.1 { w.rng.sign() } else { 1.0 };
    d.aero.floor = [sign * w.size, 1.67 * w.rng.between(0.15, 0.35)];
    w.set.note("gain", d.aero.floor[0]);
    w.set.note("length", d.aero.floor[1] / 1.67);
}

fn ceiling(d: &mut Deviations, w: &mut Draw<'_>) {
    let length_m = w.rng.between(0.35, 0.6);
    d.aero.ceiling = [w.size, length_m, w.hall.ceiling_m];
    w.set.note("gain", w.size);
    w.set.note("length_m", length_m);
}

fn wall(d: &mut Deviations, w: &mut Draw<'_>) {
    let number = w.rng.below(4);
    let force_n = w.size * w.rng.sign();
    let length_m = w.rng.between(0.6, 1.0);
    let (normal, at_m) = match number {
        0 => (Vector3::x(), w.hall.north_m[1]),
        1 => (Vector3::y(), w.hall.east_m[1]),
        2 => (-Vector3::x(), -w.hall.north_m[0]),
        _ => (-Vector3::y(), -w.hall.east_m[0]),
    };
    d.aero.wall = Some((force_n, length_m, normal, at_m));
    w.set.note("force", force_n);
    w.set.note("wall", number as f64);
    w.set.note("length_m", length_m);
}

macro_rules! spec {
    ($id:literal, $name:literal, $block:literal, $unit:literal, $range:expr, $sudden:literal, $set:path) => {
        spec!($id, $name, $block, $unit, $range, $sudden, $set, Size)
    };
    ($id:literal, $name:literal, $block:literal, $unit:literal, $range:expr, $sudden:literal, $set:path, $scale:ident) => {
        Spec {
            id: $id,
            name: $name,
            block: $block,
            unit: $unit,
            range: $range,
            scale: crate::generator::effects::Scale::$scale,
            sudden: $sudden,
            set: $set,
        }
    };
}
pub(super) use spec;

/// Entries.
pub static SPECS: &[Spec] = &[
    spec!("A1", "drag scale", "aerodynamics", "", [0.15, 0.6], false, drag_scale),
    spec!(
        "A2",
        "drag law saturates",
        "aerodynamics",
        "m/s",
        [2.5, 1.5],
        false,
        saturation,
        Inverse
    ),
    spec!("A3", "quadratic body drag", "aerodynamics", "1/m", [0.2, 2.0], false, quadratic),
    spec!("A4", "thrust curve", "thrust", "", [0.05, 0.2], false, expo),
    spec!("A5", "steady wind", "aerodynamics", "m/s", [0.1, 0.6], true, wind),
    spec!("A6", "draught zone", "aerodynamics", "m/s", [0.25, 1.0], false, draught),
    spec!("A7", "gusts", "aerodynamics", "m/s", [0.1, 0.6], true, gusts),
    spec!("A8", "ground effect error", "aerodynamics", "", [0.08, 0.3], false, floor),
    spec!("A9", "ceiling effect", "aerodynamics", "", [0.05, 0.2], false, ceiling),
    spec!("A10", "wall effect", "aerodynamics", "N", [0.03, 0.12], false, wall),
];
