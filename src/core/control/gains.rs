//! Gains of the cascade, and the list by which a search walks over them.
//!
//! One set serves both versions of the controller; a search on `raw` found it. The search starts
//! from a design on a linear model, [`ControlGains::designed`]:
//!
//! * attitude: second order, 10 rad/s, damping 0.7, 30 ms of transport (0.17 s to half);
//! * velocity over lean: g/(s + k), k = 4.2 (x), 1.9 (y) 1/s; climb over thrust: 15.3 m/s² per
//!   full throttle (g over 0.639 at 7.4 V), lag 0.08 s, drag 0.65 1/s;
//! * velocity loop: P for g·P near 2.5 rad/s, a quarter of the attitude's bandwidth, where the
//!   attitude takes 20° and its transport 4° of phase; I/P at about half the drag rate k: the whole
//!   would cancel that pole, but overshoots with the position loop closed around it;
//! * climb: g/0.639·P = 3.4 rad/s, where the thrust lag takes 15°; I/P 0.5 1/s, the drag's rate;
//! * position loops: about half of that;
//! * no D: the estimate's velocity noise (0.1 to 0.2 m/s) costs more than the phase is worth.
//!
//! They are close to public firmware for this vehicle in P (15 and 10 degrees per m/s, 1.5 1/s;
//! 12 500 counts of 65 535 per m/s), with far more I: without drag feed-forward the I has to
//! carry 23° at 1 m/s.

use serde::{Deserialize, Serialize};

use crate::checks::Problems;

/// Gains of position and velocity loops, key `control.gains`. x is forward, y is right.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ControlGains {
    /// Velocity setpoint per position error, forward. 1/s
    pub pos_x_p_per_s: f64,
    /// Velocity setpoint per position error, right. 1/s
    pub pos_y_p_per_s: f64,
    /// Velocity setpoint per position error, down. 1/s
    pub pos_z_p_per_s: f64,
    /// Velocity setpoint per position error and second, down. 1/s²
    pub pos_z_i_per_s2: f64,
    /// Velocity setpoint taken off per measured velocity, horizontal. m/s per m/s
    pub pos_xy_d_frac: f64,
    /// Velocity setpoint taken off per measured velocity, vertical. m/s per m/s
    pub pos_z_d_frac: f64,
    /// Lean per velocity error, forward. rad per m/s
    pub vel_x_p_rad_per_mps: f64,
    /// Lean per velocity error and second, forward. rad per m
    pub vel_x_i_rad_per_m: f64,
    /// Lean taken off per measured acceleration, forward. rad per m/s²
    pub vel_x_d_rad_per_mps2: f64,
    /// Lean per velocity error, right. rad per m/s
    pub vel_y_p_rad_per_mps: f64,
    /// Lean per velocity error and second, right. rad per m
    pub vel_y_i_rad_per_m: f64,
    /// Lean taken off per measured acceleration, right. rad per m/s²
    pub vel_y_d_rad_per_mps2: f64,
    /// Thrust per velocity error, vertical. frac per m/s
    pub vel_z_p_frac_per_mps: f64,
    /// Thrust per velocity error and second, vertical. frac per m
    pub vel_z_i_frac_per_m: f64,
    /// Thrust taken off per measured acceleration, vertical. frac per m/s²
    pub vel_z_d_frac_per_mps2: f64,
    /// Time constant of the low-pass on the measured acceleration that feeds D. s
    pub vel_d_filter_s: f64,
}

/// One number that a search may change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tunable {
    /// Name, as in [`ControlGains`] and under `control.gains`.
    pub name: &'static str,
    /// Lowest value worth trying, in the unit of the name.
    pub low: f64,
    /// Highest value worth trying; also the highest that a configuration may hold.
    pub high: f64,
    /// Whether a search should step in ratios (then `low` is above zero).
    pub log_scale: bool,
    /// Unit for messages.
    pub unit: &'static str,
}

const fn log(name: &'static str, low: f64, high: f64, unit: &'static str) -> Tunable {
    Tunable { name, low, high, log_scale: true, unit }
}

const fn linear(name: &'static str, high: f64, unit: &'static str) -> Tunable {
    Tunable { name, low: 0.0, high, log_scale: false, unit }
}

/// How many numbers [`ControlGains`] has.
pub const TUNABLE_COUNT: usize = 16;

impl ControlGains {
    /// What a search may change, in the order of [`Self::as_vector`].
    pub const TUNABLES: [Tunable; TUNABLE_COUNT] = [
        log("pos_x_p_per_s", 0.3, 6.0, "1/s"),
        log("pos_y_p_per_s", 0.3, 6.0, "1/s"),
        log("pos_z_p_per_s", 0.3, 8.0, "1/s"),
        linear("pos_z_i_per_s2", 2.0, "1/s²"),
        linear("pos_xy_d_frac", 0.8, "m/s per m/s"),
        linear("pos_z_d_frac", 0.8, "m/s per m/s"),
        log("vel_x_p_rad_per_mps", 0.03, 1.0, "rad per m/s"),
        log("vel_x_i_rad_per_m", 0.01, 3.0, "rad per m"),
        linear("vel_x_d_rad_per_mps2", 0.1, "rad per m/s²"),
        log("vel_y_p_rad_per_mps", 0.03, 1.0, "rad per m/s"),
        log("vel_y_i_rad_per_m", 0.01, 3.0, "rad per m"),
        linear("vel_y_d_rad_per_mps2", 0.1, "rad per m/s²"),
        log("vel_z_p_frac_per_mps", 0.03, 1.0, "frac per m/s"),
        log("vel_z_i_frac_per_m", 0.005, 1.5, "frac per m"),
        linear("vel_z_d_frac_per_mps2", 0.1, "frac per m/s²"),
        log("vel_d_filter_s", 0.01, 0.5, "s"),
    ];

    /// The numbers in the order of [`Self::TUNABLES`].
    pub fn as_vector(&self) -> [f64; TUNABLE_COUNT] {
        [
            self.pos_x_p_per_s,
            self.pos_y_p_per_s,
            self.pos_z_p_per_s,
            self.pos_z_i_per_s2,
            self.pos_xy_d_frac,
            self.pos_z_d_frac,
            self.vel_x_p_rad_per_mps,
            self.vel_x_i_rad_per_m,
            self.vel_x_d_rad_per_mps2,
            self.vel_y_p_rad_per_mps,
            self.vel_y_i_rad_per_m,
            self.vel_y_d_rad_per_mps2,
            self.vel_z_p_frac_per_mps,
            self.vel_z_i_frac_per_m,
            self.vel_z_d_frac_per_mps2,
            self.vel_d_filter_s,
        ]
    }

    /// Gains from numbers in the order of [`Self::TUNABLES`].
    pub fn from_vector(v: [f64; TUNABLE_COUNT]) -> Self {
        let [pxp, pyp, pzp, pzi, pd, pzd, vxp, vxi, vxd, vyp, vyi, vyd, vzp, vzi, vzd, filter] = v;
        Self {
            pos_x_p_per_s: pxp,
            pos_y_p_per_s: pyp,
            pos_z_p_per_s: pzp,
            pos_z_i_per_s2: pzi,
            pos_xy_d_frac: pd,
            pos_z_d_frac: pzd,
            vel_x_p_rad_per_mps: vxp,
            vel_x_i_rad_per_m: vxi,
            vel_x_d_rad_per_mps2: vxd,
            vel_y_p_rad_per_mps: vyp,
            vel_y_i_rad_per_m: vyi,
            vel_y_d_rad_per_mps2: vyd,
            vel_z_p_frac_per_mps: vzp,
            vel_z_i_frac_per_m: vzi,
            vel_z_d_frac_per_mps2: vzd,
            vel_d_filter_s: filter,
        }
    }

    /// Says what is wrong with the values under `key`. Any gain may be 0, which switches it off.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        for (tunable, value) in Self::TUNABLES.iter().zip(self.as_vector()) {
            let allowed = 0.0..=tunable.high;
            problems.range(format!("{key}.{}", tunable.name), value, allowed, tunable.unit);
        }
    }
}

impl ControlGains {
    /// The design on a linear model, see the top of this file: where the search starts.
    pub const fn designed() -> Self {
        Self {
            pos_x_p_per_s: 1.5,
            pos_y_p_per_s: 1.2,
            pos_z_p_per_s: 1.5,
            pos_z_i_per_s2: 0.0,
            pos_xy_d_frac: 0.0,
            pos_z_d_frac: 0.0,
            vel_x_p_rad_per_mps: 0.26,
            vel_x_i_rad_per_m: 0.6,
            vel_x_d_rad_per_mps2: 0.0,
            vel_y_p_rad_per_mps: 0.22,
            vel_y_i_rad_per_m: 0.25,
            vel_y_d_rad_per_mps2: 0.0,
            vel_z_p_frac_per_mps: 0.22,
            vel_z_i_frac_per_m: 0.12,
            vel_z_d_frac_per_mps2: 0.0,
            vel_d_filter_s: 0.05,
        }
    }
}

impl Default for ControlGains {
    /// Found for `raw` by `haltere-lab tune --generations 60 --seeds 2`, rounded to three digits: the
    /// least worst-case error over a nominal vehicle and seven that differ from it.
    fn default() -> Self {
        Self {
            pos_x_p_per_s: 1.54,
            pos_y_p_per_s: 1.32,
            pos_z_p_per_s: 1.85,
            pos_z_i_per_s2: 0.14,
            pos_xy_d_frac: 0.0,
            pos_z_d_frac: 0.0,
            vel_x_p_rad_per_mps: 0.334,
            vel_x_i_rad_per_m: 1.12,
            vel_x_d_rad_per_mps2: 0.0536,
            vel_y_p_rad_per_mps: 0.35,
            vel_y_i_rad_per_m: 0.632,
            vel_y_d_rad_per_mps2: 0.0058,
            vel_z_p_frac_per_mps: 0.374,
            vel_z_i_frac_per_m: 0.0632,
            vel_z_d_frac_per_mps2: 0.0152,
            vel_d_filter_s: 0.05,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_vector_and_struct_are_the_same_numbers_under_the_same_names() {
        let counted: [f64; TUNABLE_COUNT] = std::array::from_fn(|i| i as f64);
        let gains = ControlGains::from_vector(counted);
        assert_eq!(gains.as_vector(), counted);
        let table = toml::Table::try_from(gains).expect("a table");
        assert_eq!(table.len(), TUNABLE_COUNT);
        for (i, tunable) in ControlGains::TUNABLES.iter().enumerate() {
            assert_eq!(table[tunable.name].as_float(), Some(i as f64), "{}", tunable.name);
        }
    }

    #[test]
    fn prop_defaults_lie_in_the_ranges_of_the_search() {
        for (t, value) in ControlGains::TUNABLES.iter().zip(ControlGains::default().as_vector()) {
            assert!((t.low..=t.high).contains(&value), "{}", t.name);
            assert!(!t.log_scale || t.low > 0.0, "{}", t.name);
        }
    }

    #[test]
    fn prop_bad_gains_are_refused_by_name() {
        for (i, tunable) in ControlGains::TUNABLES.iter().enumerate() {
            for bad in [-0.1, tunable.high * 1.01, f64::NAN] {
                let mut v = ControlGains::default().as_vector();
                v[i] = bad;
                let mut problems = Problems::new();
                ControlGains::from_vector(v).check("control.gains", &mut problems);
                assert_eq!(problems.lines().len(), 1);
                assert!(problems.lines()[0].contains(tunable.name));
            }
        }
    }
}
