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

use crate::keys::{Range, Section};

crate::keys! {
    /// Gains of position and velocity loops, key `control.gains`. x is forward, y is right.
    /// Found for `raw` by `haltere-lab tune --generations 60 --seeds 2`, rounded to three digits: the
    /// least worst-case error over a nominal vehicle and seven that differ from it.
    #[derive(Copy)]
    pub struct ControlGains {
        /// Velocity setpoint per position error, forward.
        pos_x_p_per_s: f64 = 1.54, [0.0..=6.0, "1/s"], GAN_POS_X_P(69, AtOnce);
        /// Velocity setpoint per position error, right.
        pos_y_p_per_s: f64 = 1.32, [0.0..=6.0, "1/s"], GAN_POS_Y_P(70, AtOnce);
        /// Velocity setpoint per position error, down.
        pos_z_p_per_s: f64 = 1.85, [0.0..=8.0, "1/s"], GAN_POS_Z_P(71, AtOnce);
        /// Velocity setpoint per position error and second, down.
        pos_z_i_per_s2: f64 = 0.14, [0.0..=2.0, "1/s²"], GAN_POS_Z_I(72, AtOnce);
        /// Velocity setpoint taken off per measured velocity, horizontal.
        pos_xy_d_frac: f64 = 0.0, [0.0..=0.8, "m/s per m/s"], GAN_POS_XY_D(73, AtOnce);
        /// Velocity setpoint taken off per measured velocity, vertical.
        pos_z_d_frac: f64 = 0.0, [0.0..=0.8, "m/s per m/s"], GAN_POS_Z_D(74, AtOnce);
        /// Lean per velocity error, forward.
        vel_x_p_rad_per_mps: f64 = 0.334, [0.0..=1.0, "rad per m/s"], GAN_VEL_X_P(75, AtOnce);
        /// Lean per velocity error and second, forward.
        vel_x_i_rad_per_m: f64 = 1.12, [0.0..=3.0, "rad per m"], GAN_VEL_X_I(76, AtOnce);
        /// Lean taken off per measured acceleration, forward.
        vel_x_d_rad_per_mps2: f64 = 0.0536, [0.0..=0.1, "rad per m/s²"], GAN_VEL_X_D(77, AtOnce);
        /// Lean per velocity error, right.
        vel_y_p_rad_per_mps: f64 = 0.35, [0.0..=1.0, "rad per m/s"], GAN_VEL_Y_P(78, AtOnce);
        /// Lean per velocity error and second, right.
        vel_y_i_rad_per_m: f64 = 0.632, [0.0..=3.0, "rad per m"], GAN_VEL_Y_I(79, AtOnce);
        /// Lean taken off per measured acceleration, right.
        vel_y_d_rad_per_mps2: f64 = 0.0058, [0.0..=0.1, "rad per m/s²"], GAN_VEL_Y_D(80, AtOnce);
        /// Thrust per velocity error, vertical.
        vel_z_p_frac_per_mps: f64 = 0.374, [0.0..=1.0, "frac per m/s"], GAN_VEL_Z_P(81, AtOnce);
        /// Thrust per velocity error and second, vertical.
        vel_z_i_frac_per_m: f64 = 0.0632, [0.0..=1.5, "frac per m"], GAN_VEL_Z_I(82, AtOnce);
        /// Thrust taken off per measured acceleration, vertical.
        vel_z_d_frac_per_mps2: f64 = 0.0152, [0.0..=0.1, "frac per m/s²"], GAN_VEL_Z_D(83, AtOnce);
        /// Time constant of the low-pass on the measured acceleration.
        vel_d_filter_s: f64 = 0.05, [0.0..=0.5, "s"], GAN_VEL_D_T(84, AtOnce);
    }
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

/// How many numbers [`ControlGains`] has.
pub const TUNABLE_COUNT: usize = ControlGains::KEYS.len();

/// Where a search begins to step in ratios; 0 for those that are off by default.
const LOWEST: [f64; TUNABLE_COUNT] = [
    0.3, 0.3, 0.3, 0.0, 0.0, 0.0, // position
    0.03, 0.01, 0.0, 0.03, 0.01, 0.0, 0.03, 0.005, 0.0,  // velocity
    0.01, // low-pass of D
];

impl ControlGains {
    /// What a search may change, in the order of [`Self::as_vector`].
    pub const TUNABLES: [Tunable; TUNABLE_COUNT] = {
        let mut all = [Tunable { name: "", low: 0.0, high: 0.0, log_scale: false, unit: "" }; _];
        let mut i = 0;
        while i < TUNABLE_COUNT {
            let (key, low) = (&Self::KEYS[i], LOWEST[i]);
            if let Some(Range { high, unit, .. }) = key.range {
                all[i] = Tunable { name: key.name, low, high, log_scale: low > 0.0, unit };
            }
            i += 1;
        }
        all
    };

    /// The numbers in the order of [`Self::TUNABLES`]. Any may be 0, which switches it off.
    pub fn as_vector(&self) -> [f64; TUNABLE_COUNT] {
        Self::TUNABLES.map(|t| self.value(t.name).map_or(0.0, |v| v.number(0, 0.0)))
    }

    /// Gains from numbers in the order of [`Self::TUNABLES`].
    pub fn from_vector(v: [f64; TUNABLE_COUNT]) -> Self {
        let mut gains = Self::default();
        for (tunable, number) in Self::TUNABLES.iter().zip(v) {
            if let Some(value) = gains.value_mut(tunable.name) {
                value.set(0, number, 0.0);
            }
        }
        gains
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checks::Problems;

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
