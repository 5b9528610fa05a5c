//! The constants of the vehicle file that flights are asked for, each with what its owner may be wrong by.
//!
//! The spread of a prior is what the way of measuring that docs/VEHICLE.md gives is good to: a kitchen scale one per cent, a data
//! sheet or a fit five to thirty, what nobody measures (loops of the board, noise) a factor of two at two sigma. It is the same for
//! every vehicle. Geometry that a ruler tells, travels of servos and the curve of a cell are not asked for.

use haltere_core::frames::G_MPS2;
use haltere_model::Vehicle;

/// A constant of the vehicle file.
#[derive(Clone, Copy)]
pub struct Constant {
    /// Key in the vehicle file, with the axis of a vector: `drag.k_ns_per_m_hz.x`.
    pub key: &'static str,
    /// Where it stands.
    at: fn(&mut Vehicle) -> &mut f64,
    prior: Prior,
}

/// How far the file may be off, one sigma.
#[derive(Clone, Copy)]
enum Prior {
    /// A share of the constant, which keeps its sign: normal in its logarithm.
    Share(f64),
    /// So much of its unit, between two bounds.
    Of(fn(&Vehicle) -> f64, [f64; 2]),
}

impl Constant {
    /// As a vehicle has it.
    pub fn value(&self, vehicle: &Vehicle) -> f64 {
        *(self.at)(&mut vehicle.clone())
    }

    /// Its value so many sigma of the prior from the file's.
    pub fn moved(&self, file: &Vehicle, sigmas: f64) -> f64 {
        let value = self.value(file);
        match self.prior {
            Prior::Share(share) => value * (share * sigmas).exp(),
            Prior::Of(sigma, [low, high]) => {
                (value + sigma(file) * sigmas).clamp(low.min(value), high.max(value))
            }
        }
    }

    /// The same where the file itself is in doubt, however well its way of measuring is good.
    pub fn in_doubt(self) -> Self {
        match self.prior {
            Prior::Share(share) => Self { prior: Prior::Share(share.max(MISTAKEN)), ..self },
            Prior::Of(..) => self,
        }
    }

    /// How many sigma of the prior `value` lies from the file's; 0 where the prior does not let it move.
    pub fn sigmas(&self, file: &Vehicle, value: f64) -> f64 {
        let of_file = self.value(file);
        let sigmas = match self.prior {
            Prior::Share(share) => (value / of_file).ln() / share,
            Prior::Of(sigma, _) => (value - of_file) / sigma(file),
        };
        if sigmas.is_finite() { sigmas } else { 0.0 }
    }
}

/// What a number of a file is off by that may be mistaken or another vehicle's: 15 to 30 % are one to one and a half sigma.
const MISTAKEN: f64 = 0.2;

/// The file with each of these constants so many sigma from where it stands there.
pub fn moved(constants: &[Constant], file: &Vehicle, sigmas: &[f64]) -> Vehicle {
    let mut vehicle = file.clone();
    for (constant, sigmas) in constants.iter().zip(sigmas) {
        if *sigmas != 0.0 {
            *(constant.at)(&mut vehicle) = constant.moved(file, *sigmas);
        }
    }
    vehicle
}

const ANY: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];
const NOT_BELOW_0: [f64; 2] = [0.0, f64::INFINITY];

const fn share(key: &'static str, at: fn(&mut Vehicle) -> &mut f64, sigma: f64) -> Constant {
    Constant { key, at, prior: Prior::Share(sigma) }
}

const fn of(
    key: &'static str,
    at: fn(&mut Vehicle) -> &mut f64,
    sigma: fn(&Vehicle) -> f64,
    bounds: [f64; 2],
) -> Constant {
    Constant { key, at, prior: Prior::Of(sigma, bounds) }
}

/// All of them, in the order of the vehicle file.
pub const CONSTANTS: [Constant; 56] = [
    share("body.mass_kg", |v| &mut v.body.mass_kg, 0.01),
    share("body.inertia_kgm2.x", |v| &mut v.body.inertia_kgm2[0], 0.1),
    share("body.inertia_kgm2.y", |v| &mut v.body.inertia_kgm2[1], 0.1),
    share("body.inertia_kgm2.z", |v| &mut v.body.inertia_kgm2[2], 0.1),
    of("body.cg_B_m.x", |v| &mut v.body.cg_B_m[0], |v| 0.025 * v.wings.centre_m, ANY),
    of("body.cg_B_m.y", |v| &mut v.body.cg_B_m[1], |v| 0.025 * v.wings.centre_m, ANY),
    share("wings.thrust_n_per_hz", |v| &mut v.wings.thrust_n_per_hz, 0.05),
    of("wings.thrust_offset_n", |v| &mut v.wings.thrust_offset_n, |v| 0.1 * weight_n(v), ANY),
    of("wings.thrust_curve", |v| &mut v.wings.thrust_curve, |_| 0.5, [-1.0, 2.0]),
    share("wings.flap_hz_per_v", |v| &mut v.wings.flap_hz_per_v, 0.05),
    of("wings.flap_offset_hz", |v| &mut v.wings.flap_offset_hz, |v| 0.1 * v.hover_hz(), ANY),
    of("wings.voltage_exponent", |v| &mut v.wings.voltage_exponent, |_| 0.3, [0.0, 3.0]),
    share("wings.flap_lag_s", |v| &mut v.wings.flap_lag_s, 0.2),
    share("wings.cop_m", |v| &mut v.wings.cop_m, 0.2),
    of(
        "wings.passive_dihedral_rad_per_mps",
        |v| &mut v.wings.passive_dihedral_rad_per_mps,
        |_| 0.05,
        ANY,
    ),
    share("drag.k_ns_per_m_hz.x", |v| &mut v.drag.k_ns_per_m_hz[0], 0.15),
    share("drag.k_ns_per_m_hz.y", |v| &mut v.drag.k_ns_per_m_hz[1], 0.15),
    share("drag.k_ns_per_m_hz.z", |v| &mut v.drag.k_ns_per_m_hz[2], 0.3),
    of("drag.saturation_s_per_m", |v| &mut v.drag.saturation_s_per_m, |_| 0.1, NOT_BELOW_0),
    of("drag.body_per_m", |v| &mut v.drag.body_per_m, body_per_m, NOT_BELOW_0),
    share("drag.damping_factor", |v| &mut v.drag.damping_factor, 0.3),
    share("pitch_servo.frequency_radps", |v| &mut v.pitch_servo.frequency_radps, 0.2),
    share("pitch_servo.damping", |v| &mut v.pitch_servo.damping, 0.2),
    share("yaw_servo.frequency_radps", |v| &mut v.yaw_servo.frequency_radps, 0.2),
    share("yaw_servo.damping", |v| &mut v.yaw_servo.damping, 0.2),
    share("battery.capacity_mah", |v| &mut v.battery.capacity_mah, 0.1),
    share("battery.resistance_ohm", |v| &mut v.battery.resistance_ohm, 0.3),
    of(
        "battery.slow_ohm",
        |v| &mut v.battery.slow_ohm,
        |v| 0.3 * v.battery.resistance_ohm,
        NOT_BELOW_0,
    ),
    share("battery.slow_s", |v| &mut v.battery.slow_s, 0.7),
    of("battery.charge_frac", |v| &mut v.battery.charge_frac, |_| 0.03, [0.05, 1.0]),
    share("battery.hover_w", |v| &mut v.battery.hover_w, 0.1),
    share("battery.electronics_w", |v| &mut v.battery.electronics_w, 0.3),
    of("ground.gain", |v| &mut v.ground.gain, |_| 0.1, [-0.5, 1.0]),
    share("ground.length_m", |v| &mut v.ground.length_m, 0.3),
    share("inner_loop.frequency_radps.x", |v| &mut v.inner_loop.frequency_radps[0], 0.35),
    share("inner_loop.frequency_radps.y", |v| &mut v.inner_loop.frequency_radps[1], 0.35),
    share("inner_loop.frequency_radps.z", |v| &mut v.inner_loop.frequency_radps[2], 0.35),
    share("inner_loop.damping.x", |v| &mut v.inner_loop.damping[0], 0.35),
    share("inner_loop.damping.y", |v| &mut v.inner_loop.damping[1], 0.35),
    share("inner_loop.damping.z", |v| &mut v.inner_loop.damping[2], 0.35),
    share("inner_loop.boost", |v| &mut v.inner_loop.boost, 0.7),
    share("inner_loop.boost_s", |v| &mut v.inner_loop.boost_s, 0.7),
    of("inner_loop.delay_ms", |v| &mut v.inner_loop.delay_ms, |_| 20.0, NOT_BELOW_0),
    share("imu.vibration_g.x", |v| &mut v.imu.vibration_g[0], 0.7),
    share("imu.vibration_g.y", |v| &mut v.imu.vibration_g[1], 0.7),
    share("imu.vibration_g.z", |v| &mut v.imu.vibration_g[2], 0.7),
    share("imu.vibration_radps", |v| &mut v.imu.vibration_radps, 0.7),
    share("imu.std_acc_mps2", |v| &mut v.imu.std_acc_mps2, 0.7),
    share("imu.std_gyro_radps", |v| &mut v.imu.std_gyro_radps, 0.7),
    share("imu.std_pressure_pa", |v| &mut v.imu.std_pressure_pa, 0.7),
    share("imu.std_lean_deg", |v| &mut v.imu.std_lean_deg, 0.7),
    share("uwb.std_m", |v| &mut v.uwb.std_m, 0.35),
    share("uwb.path_bias_m", |v| &mut v.uwb.path_bias_m, 0.7),
    share("uwb.loss", |v| &mut v.uwb.loss, 0.7),
    share("link.delay_ms", |v| &mut v.link.delay_ms, 0.7),
    share("link.jitter_ms", |v| &mut v.link.jitter_ms, 0.7),
];

fn weight_n(v: &Vehicle) -> f64 {
    v.body.mass_kg * G_MPS2
}

/// As large beside wing and mass as half of the usual size of A3 is for the Flapper.
fn body_per_m(v: &Vehicle) -> f64 {
    let beside = |v: &Vehicle| v.wings.centre_m.powi(2) / v.body.mass_kg;
    0.3 * beside(v) / beside(&Vehicle::default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_keys_are_those_of_the_file_and_values_come_back() {
        let file = Vehicle::default();
        let table = toml::Table::try_from(&file).unwrap();
        for constant in &CONSTANTS {
            let mut parts = constant.key.split('.');
            let (group, key) = (parts.next().unwrap(), parts.next().unwrap());
            let found = table.get(group).and_then(|t| t.get(key));
            let axis =
                parts.next().map(|axis| ["x", "y", "z"].iter().position(|a| *a == axis).unwrap());
            let found = found.and_then(|v| match axis {
                Some(axis) => v.as_array()?.get(axis)?.as_float(),
                None => v.as_float(),
            });
            assert_eq!(found, Some(constant.value(&file)), "{}", constant.key);
        }
    }

    #[test]
    fn prop_sigmas_are_undone() {
        let file = Vehicle::default();
        for (k, constant) in CONSTANTS.iter().enumerate() {
            let mut sigmas = [0.0; CONSTANTS.len()];
            sigmas[k] = 0.7;
            let there = moved(&CONSTANTS, &file, &sigmas);
            let value = constant.value(&there);
            let back = constant.sigmas(&file, value);
            let held = value == constant.value(&file);
            assert!((back - 0.7).abs() < 1e-9 || held, "{}: {back}", constant.key);
            let others = CONSTANTS.iter().filter(|c| c.value(&there) != c.value(&file)).count();
            assert_eq!(others, usize::from(!held), "{}", constant.key);
        }
    }
}
