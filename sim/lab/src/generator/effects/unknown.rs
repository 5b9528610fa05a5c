//! What the diagnosis' library does not have: X1 to X20.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::aero::spec;
use super::{Deviations, Draw, Spec};
use crate::generator::noise::Noise;

/// What deviates.
#[derive(Debug, Clone, Default)]
pub struct Unknown {
    hysteresis: f64,
    /// Cable: length that lies slack (m), pull per stretch (N/m).
    tether: Option<[f64; 2]>,
    /// Loose deck: size of a knock, m/s².
    pub rattle_mps2: f64,
    /// Person: excess path, m.
    person_m: f64,
    /// Magnet: jump of north, rad.
    spike_rad: f64,
    water_kg: f64,
    cogging: f64,
    thin: f64,
    /// Share of packets that carry another anchor's id.
    pub wrong_id: f64,
    /// Share of packets that are heard twice, once by an echo.
    pub doubled: f64,
    /// Steps of the throttle.
    pub throttle_steps: f64,
    /// Factor on the board's yaw gains, less one.
    pub yaw_gain: f64,
    /// Slung mass, kg, and its swing (rad, rad/s) north and east.
    sling_kg: f64,
    swing: [[f64; 2]; 2],
    /// Slipping gear: loss of a wing and which.
    slip: Option<(f64, usize)>,
    contact_ohm: f64,
    /// Gyroscope feels acceleration, rad/s per m/s².
    pub g_sensitivity: f64,
    updraft: Option<([f64; 2], f64)>,
    /// Jumps of the board's clock, s.
    clock_s: f64,
    /// Anchor that restarts: which, silence in s.
    reboot: Option<(usize, f64)>,
    /// Swinging fan, m/s, and its bearing.
    fan: Option<(f64, f64)>,
}

/// A square pulse train: `on` seconds out of every `every`, from `first` on.
fn pulse(t_s: f64, first: f64, every: f64, on: f64) -> bool {
    t_s >= first && (t_s - first) % every < on
}

impl Unknown {
    /// Density of the air over the usual one.
    pub fn density(&self) -> f64 {
        1.0 - self.thin
    }
    /// Water on the wings, kg.
    pub fn water_kg(&self, t_s: f64) -> f64 {
        self.water_kg * (-t_s / 45.0).exp()
    }
    /// Factor on the thrust of a wing; `lagged_hz` is the flap rate a moment ago.
    pub fn lift(&self, t_s: f64, wing: usize, flap_hz: f64, lagged_hz: f64) -> f64 {
        let mut lift = 1.0 - 5.0 * self.water_kg(t_s);
        // A flexible wing gives more while the rate falls than while it rises.
        lift -= self.hysteresis * ((flap_hz - lagged_hz) / 0.02).tanh();
        let steps = TAU * flap_hz / 0.9;
        lift += self.cogging * steps.sin();
        if let Some((loss, _)) =
            self.slip.filter(|(_, w)| *w == wing && pulse(t_s, 14.0, 9.3, 0.25))
        {
            lift -= loss;
        }
        lift.max(0.0)
    }
    /// Resistance of a bad contact, Ω.
    pub fn contact_ohm(&self, t_s: f64) -> f64 {
        if pulse(t_s, 11.0, 6.7, 0.8) { self.contact_ohm } else { 0.0 }
    }
    /// Forces of cable and slung mass, Earth, N; `acc_E` of the vehicle.
    pub fn pull_n(
        &mut self,
        pos: &Vector3<f64>,
        acc_E: &Vector3<f64>,
        start_NE_m: [f64; 2],
        dt_s: f64,
    ) -> Vector3<f64> {
        let mut pull = Vector3::zeros();
        if let Some([slack_m, stiff]) = self.tether {
            let to = Vector3::new(start_NE_m[0], start_NE_m[1], 0.0) - pos;
            let length = to.norm();
            // The part in the air weighs too.
            pull.z += 0.02 * (-pos.z).max(0.0);
            if length > slack_m {
                pull += to * ((length - slack_m) * stiff / length);
            }
        }
        if self.sling_kg > 0.0 {
            let hold = if -pos.z > 0.3 { 1.0 } else { 0.0 };
            for (axis, [angle, rate]) in self.swing.iter_mut().enumerate() {
                // A string of 0.4 m, lightly damped, driven by its point of suspension.
                let push = -(9.81 * angle.sin() + acc_E[axis] * angle.cos()) / 0.4 - 0.3 * *rate;
                *rate = (*rate + push * dt_s).clamp(-8.0, 8.0) * hold;
                *angle = (*angle + *rate * dt_s).clamp(-1.2, 1.2) * hold;
                pull[axis] += self.sling_kg * 9.81 * angle.sin() * hold;
            }
            pull.z += self.sling_kg * 9.81 * hold;
        }
        pull
    }
    /// Wind, m/s.
    pub fn wind(&self, pos: &Vector3<f64>, t_s: f64) -> Vector3<f64> {
        let mut wind = Vector3::zeros();
        if let Some(([n, e], speed)) = self.updraft {
            let away = (pos.x - n).hypot(pos.y - e);
            wind.z -= speed / (1.0 + (away / 0.9).powi(4));
        }
        if let Some((speed, bearing)) = self.fan {
            let now = bearing + 0.9 * (TAU * t_s / 4.5).sin();
            wind += Vector3::new(now.cos(), now.sin(), 0.0)
                * (speed * (0.5 + 0.5 * (TAU * t_s / 4.5).cos()));
        }
        wind
    }
    /// Jump of north, rad.
    pub fn north_rad(&self, t_s: f64) -> f64 {
        if pulse(t_s, 13.0, 17.0, 2.5) { self.spike_rad } else { 0.0 }
    }
    /// Error of the board's clock, s.
    pub fn clock_s(&self, t_s: f64) -> f64 {
        if self.clock_s > 0.0 { self.clock_s * (t_s / 12.0).floor() } else { 0.0 }
    }
    /// Excess path past a walking person, m; lost one time in three.
    pub fn person_m(
        &self,
        from: &Vector3<f64>,
        tag: &Vector3<f64>,
        middle_NE_m: [f64; 2],
        t_s: f64,
        rng: &mut Noise,
    ) -> Option<f64> {
        if self.person_m <= 0.0 {
            return Some(0.0);
        }
        let phase = TAU * t_s / 22.0;
        let at = [middle_NE_m[0] + 2.4 * phase.cos(), middle_NE_m[1] + 2.4 * (2.0 * phase).sin()];
        let (dx, dy) = (from.x - tag.x, from.y - tag.y);
        let along = (((at[0] - tag.x) * dx + (at[1] - tag.y) * dy) / (dx * dx + dy * dy).max(0.01))
            .clamp(0.0, 1.0);
        let miss = (tag.x + along * dx - at[0]).hypot(tag.y + along * dy - at[1]);
        let height = -(tag.z + along * (from.z - tag.z));
        let blocked = miss < 0.3 && height < 1.8;
        let (u, e) = (rng.uniform(), rng.exponential());
        match blocked {
            false => Some(0.0),
            true if u < 0.33 => None,
            true => Some(self.person_m * (0.5 + 0.5 * e)),
        }
    }
    /// Whether an anchor is silent.
    pub fn silent(&self, anchor: usize, t_s: f64) -> bool {
        self.reboot.is_some_and(|(n, s)| n == anchor && pulse(t_s, 18.0, 31.0, s))
    }
}

macro_rules! plain {
    ($name:ident, $field:ident, $note:literal) => {
        fn $name(d: &mut Deviations, w: &mut Draw<'_>) {
            d.unknown.$field = w.size;
            w.set.note($note, w.size);
        }
    };
}
plain!(hysteresis, hysteresis, "share");
plain!(rattle, rattle_mps2, "knock_mps2");
plain!(person, person_m, "excess_m");
plain!(cogging, cogging, "share");
plain!(thin, thin, "density_loss");
plain!(wrong_id, wrong_id, "share");
plain!(doubled, doubled, "share");
plain!(throttle, throttle_steps, "steps");
plain!(yaw_gain, yaw_gain, "further_gain");
plain!(contact, contact_ohm, "ohm");
plain!(g_sensitivity, g_sensitivity, "radps_per_mps2");

fn tether(d: &mut Deviations, w: &mut Draw<'_>) {
    let slack_m = w.rng.between(1.2, 1.8);
    d.unknown.tether = Some([slack_m, w.size]);
    w.set.note("slack_m", slack_m);
    w.set.note("n_per_m", w.size);
}
fn spike(d: &mut Deviations, w: &mut Draw<'_>) {
    d.unknown.spike_rad = (w.size * w.rng.sign()).to_radians();
    w.set.note("deg", d.unknown.spike_rad.to_degrees());
}
fn water(d: &mut Deviations, w: &mut Draw<'_>) {
    d.unknown.water_kg = w.size * 1e-3;
    w.set.note("g", w.size);
}
fn sling(d: &mut Deviations, w: &mut Draw<'_>) {
    d.unknown.sling_kg = w.size * 1e-3;
    w.set.note("g", w.size);
}
fn slip(d: &mut Deviations, w: &mut Draw<'_>) {
    let wing = w.rng.below(2);
    d.unknown.slip = Some((w.size, wing));
    w.set.note("loss", w.size);
    w.set.note("wing", wing as f64);
}
fn updraft(d: &mut Deviations, w: &mut Draw<'_>) {
    let place = w.hall.place(w.rng, 0.4);
    d.unknown.updraft = Some((place, w.size));
    w.set.place_NE_m = Some(place);
    w.set.note("mps", w.size);
}
fn clock(d: &mut Deviations, w: &mut Draw<'_>) {
    d.unknown.clock_s = w.size * 1e-3;
    w.set.note("jump_ms", w.size);
}
fn reboot(d: &mut Deviations, w: &mut Draw<'_>) {
    let anchor = w.rng.below(w.hall.anchors);
    d.unknown.reboot = Some((anchor, w.size));
    w.set.anchor = Some(anchor as u8);
    w.set.note("silence_s", w.size);
}
fn fan(d: &mut Deviations, w: &mut Draw<'_>) {
    let bearing = w.rng.between(0.0, TAU);
    d.unknown.fan = Some((w.size, bearing));
    w.set.note("mps", w.size);
    w.set.note("towards", bearing.to_degrees());
}

/// Entries.
pub static SPECS: &[Spec] = &[
    spec!("X1", "flexible-wing hysteresis", "thrust", "", [0.05, 0.12], false, hysteresis),
    spec!("X2", "tether", "aerodynamics", "N/m", [0.05, 0.2], false, tether),
    spec!("X3", "loose deck rattles", "imu", "m/s²", [10.0, 35.0], false, rattle),
    spec!("X4", "walking person", "uwb", "m", [0.4, 1.2], false, person),
    spec!("X5", "magnetic spikes", "inner_loop", "deg", [12.0, 30.0], false, spike),
    spec!("X6", "wet wings", "thrust", "g", [4.0, 12.0], false, water),
    spec!("X7", "motor cogging", "thrust", "", [0.05, 0.12], false, cogging),
    spec!("X8", "thin air", "aerodynamics", "", [0.06, 0.14], false, thin),
    spec!("X9", "wrong anchor ids", "uwb", "", [0.04, 0.15], false, wrong_id),
    spec!("X10", "doubled packets", "uwb", "", [0.1, 0.4], false, doubled),
    spec!("X11", "quantised throttle", "link", "steps", [40.0, 16.0], false, throttle, Inverse),
    spec!("X12", "yaw gain typo", "inner_loop", "", [1.5, 3.5], false, yaw_gain, Above),
    spec!("X13", "slung mass", "aerodynamics", "g", [3.0, 9.0], false, sling),
    spec!("X14", "slipping gear", "thrust", "", [0.15, 0.35], false, slip),
    spec!("X15", "bad contact", "battery", "Ω", [0.1, 0.35], false, contact),
    spec!(
        "X16",
        "g-sensitive gyroscope",
        "imu",
        "rad/s per m/s²",
        [0.002, 0.006],
        false,
        g_sensitivity
    ),
    spec!("X17", "updraft", "aerodynamics", "m/s", [0.4, 1.2], false, updraft),
    spec!("X18", "jumping board clock", "timing", "ms", [5.0, 25.0], false, clock),
    spec!("X19", "restarting anchor", "uwb", "s", [4.0, 12.0], false, reboot),
    spec!("X20", "swinging fan", "aerodynamics", "m/s", [0.25, 0.45], false, fan),
];
