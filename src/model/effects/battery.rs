//! Battery: charge, open-circuit voltage, inner resistance.
//!
//! ```text
//! P = P_e + ½ P_h Σ (f_i / f_h)³     I = P / V     V = n U(q) - R I - W     q' = -I / C     W' = (R_s I - W) / τ_s
//! ```
//! `P` power (W), `P_e` electronics, `P_h` both motors in hover, `f_h` hover flap rate (Hz), `I`
//! current (A), `V` voltage at the plug (V), `U` open-circuit voltage of a cell, `q` charge (0 to 1),
//! `C` capacity (A·s), `R` resistance (Ω), `R_s` and `τ_s` those of the polarisation `W` (V; one of the two of Chen and
//! Rincón-Mora 2006; none unless the vehicle file says so). Source: 2 cells, 300 mAh, 4 to 6 min (paper); OCV curve
//! usual for LiPo; power of flapping as the cube of its rate. Left out: temperature, recovery.

use crate::effects::{
    Block, Build, Effect, EffectSpec, Kind, ParameterSpec, Role, STEP_S, Stage, State, Supply,
};
use crate::vehicle;

/// Seconds per hour over milliampere per ampere.
const AS_PER_MAH: f64 = 3.6;
/// Share of the open-circuit voltage below which the pack does not sink: keeps current finite.
const FLOOR_V_PER_CELL: f64 = 1.0;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N7",
    name: "battery",
    block: Block::Battery,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "capacity",
            "mAh",
            Kind::Inverse,
            1e9,
            300.0,
            [150.0, 320.0],
            "capacity",
        )
        .of_vehicle(|v| &mut v.battery.capacity_mah),
        ParameterSpec::new(
            "resistance",
            "Ω",
            Kind::Size,
            0.0,
            0.17,
            [0.10, 0.5],
            "inner resistance",
        )
        .of_vehicle(|v| &mut v.battery.resistance_ohm),
        ParameterSpec::new("charge", "", Kind::Shape, 1.0, 1.0, [0.2, 1.0], "charge at start")
            .of_vehicle(|v| &mut v.battery.charge_frac),
        ParameterSpec::new(
            "hover_power",
            "W",
            Kind::Size,
            0.0,
            24.5,
            [18.0, 32.0],
            "both motors in hover",
        )
        .of_vehicle(|v| &mut v.battery.hover_w),
    ],
    off: "constant 3.7 V per cell, no current",
    source: "paper (cells, capacity, flight time); LiPo discharge curve",
    equation: "V = n U(q) - R P(f) / V, q' = -I / C",
    build: |b| Box::new(Battery::new(b)),
};

struct Battery {
    file: vehicle::Battery,
    inverse_hover_hz: f64,
    volt: f64,
    charge_frac: f64,
    polarised_v: f64,
}

impl Battery {
    fn new(b: Build<'_>) -> Self {
        let file = b.vehicle.battery.clone();
        let volt = file.cells * open_circuit_v(&file.cell_v, file.charge_frac);
        Self {
            inverse_hover_hz: 1.0 / b.nominal.hover_hz(),
            volt,
            charge_frac: file.charge_frac,
            polarised_v: 0.0,
            file,
        }
    }
}

impl Effect for Battery {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Battery]
    }
    fn battery(&mut self, s: &State, supply: &mut Supply) {
        let [left, right] = s.flap_hz.map(|f| f * self.inverse_hover_hz);
        let motors_w = 0.5 * self.file.hover_w * (left * left * left + right * right * right);
        let current_a = (motors_w + self.file.electronics_w) / self.volt;
        self.charge_frac = (self.charge_frac
            - current_a * STEP_S / (self.file.capacity_mah * AS_PER_MAH))
            .max(0.0);
        self.polarised_v +=
            (self.file.slow_ohm * current_a - self.polarised_v) * STEP_S / self.file.slow_s;
        // A step later this voltage sets the current: the loop gain R I / V is below 0.1.
        self.volt = (self.file.cells * open_circuit_v(&self.file.cell_v, self.charge_frac)
            - self.file.resistance_ohm * current_a
            - self.polarised_v)
            .max(self.file.cells * FLOOR_V_PER_CELL);
        *supply = Supply { volt: self.volt, current_a, charge_frac: self.charge_frac };
    }
}

/// Linear between the tenths of charge.
fn open_circuit_v(cell_v: &[f64; 11], charge_frac: f64) -> f64 {
    let at = charge_frac.clamp(0.0, 1.0) * 10.0;
    let low = (at as usize).min(9);
    cell_v[low] + (cell_v[low + 1] - cell_v[low]) * (at - low as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn val_hover_lasts_4_to_6_minutes_and_draws_3_to_4_5_ampere() {
        let mut battery = probe::build(&SPEC, &[]);
        let s = probe::hover();
        let mut supply = Supply { volt: 0.0, current_a: 0.0, charge_frac: 1.0 };
        let (mut seconds, mut at_start) = (0.0, None);
        // 6.4 V: warning of the firmware.
        while seconds < 600.0 && (seconds < 0.1 || supply.volt > 6.4) {
            battery.battery(&s, &mut supply);
            seconds += STEP_S;
            if seconds > 2.0 && at_start.is_none() {
                at_start = Some(supply);
            }
        }
        assert!((240.0..360.0).contains(&seconds), "{seconds}");
        let supply = at_start.unwrap();
        assert!((3.0..4.5).contains(&supply.current_a), "{}", supply.current_a);
        // Recorded hover: 7.9 V at the start, 7.1 V later.
        assert!((supply.volt - 7.85).abs() < 0.15, "{}", supply.volt);
    }

    #[test]
    fn prop_polarisation_takes_its_voltage_late() {
        // Nothing else lowers the voltage, and so little that the current stays what it is.
        let mut plain = vehicle::Vehicle::default();
        (plain.battery.resistance_ohm, plain.battery.capacity_mah) = (0.0, 1e4);
        let mut polarised = plain.clone();
        polarised.battery.slow_ohm = 0.01;
        let share_lost = |seconds: f64| {
            let [plain_v, [late_v, current_a]] = [&plain, &polarised].map(|vehicle| {
                let mut battery = probe::build_values(&SPEC, &[], vehicle);
                let mut supply = Supply { volt: 0.0, current_a: 0.0, charge_frac: 1.0 };
                for _ in 0..(seconds / STEP_S) as usize {
                    battery.battery(&probe::hover(), &mut supply);
                }
                [supply.volt, supply.current_a]
            });
            (plain_v[0] - late_v) / (0.01 * current_a)
        };
        // 1 - 1/e after the time constant of 20 s, all of it after five of them.
        let seen = [0.1, 20.0, 100.0].map(share_lost);
        assert!(
            seen[0] < 0.01 && (seen[1] - 0.632).abs() < 0.01 && (seen[2] - 0.993).abs() < 0.02,
            "{seen:?}"
        );
    }

    #[test]
    fn prop_rest_draws_the_electronics_only() {
        let mut battery = probe::build(&SPEC, &[]);
        let s = State { flap_hz: [0.0; 2], ..probe::hover() };
        let mut supply = Supply { volt: 0.0, current_a: 0.0, charge_frac: 1.0 };
        for _ in 0..50 {
            battery.battery(&s, &mut supply);
        }
        assert!(supply.current_a < 0.2 && supply.volt > 8.35);
    }
}
