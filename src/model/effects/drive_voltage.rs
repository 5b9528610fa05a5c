//! The drive turns voltage into flap rate less, or more, than in proportion: losses of motor, gear and controller.
//!
//! `f -> b + (f - b) (V/V_r)^(x - 1)`, `f` the rate that a wing settles at and `b` that of no command (Hz), `V` supply and `V_r` the
//! pack's nominal voltage (V), `x` from the vehicle file; at `V_r` nothing changes. Source of `x`: `haltere gap commission`; recorded
//! flights of the Flapper have 1.01.

use crate::effects::{Block, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::wings::Actuation;

/// Least share of the nominal voltage in the law: a pack without voltage turns nothing, and no power of zero is asked for.
const LEAST_VOLTAGE_SHARE: f64 = 0.1;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N24",
    name: "voltage exponent of the drive",
    block: Block::Thrust,
    role: Role::Nominal,
    parameters: &[ParameterSpec::new(
        "exponent",
        "",
        Kind::Shape,
        1.0,
        1.0,
        [0.5, 1.5],
        "of the flap rate against voltage",
    )
    .of_vehicle(|v| &mut v.wings.voltage_exponent)],
    off: "flap rate in proportion to command times voltage",
    source: "recorded flights: 1.01 between 7.9 and 7.1 V",
    equation: "f -> b + (f - b) (V/V_r)^(x - 1)",
    build: |b| {
        Box::new(DriveVoltage {
            exponent: b.value[0] - 1.0,
            inverse_rated_v: 1.0 / b.vehicle.rated_v(),
            offset_hz: b.vehicle.wings.flap_offset_hz,
        })
    },
};

struct DriveVoltage {
    exponent: f64,
    inverse_rated_v: f64,
    offset_hz: f64,
}

impl Effect for DriveVoltage {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Actuate]
    }
    fn actuate(&mut self, s: &State, actuation: &mut Actuation) {
        if self.exponent == 0.0 {
            return;
        }
        let factor =
            (s.supply_v * self.inverse_rated_v).max(LEAST_VOLTAGE_SHARE).powf(self.exponent);
        for f in &mut actuation.flap_hz {
            // A wing that stands has no command.
            if *f > 0.0 {
                *f = (self.offset_hz + (*f - self.offset_hz) * factor).max(0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_nothing_at_the_nominal_voltage_and_by_the_exponent_beside_it() {
        let mut effect = probe::build(&SPEC, &[("exponent", 1.5)]);
        let offset_hz = crate::vehicle::Vehicle::default().wings.flap_offset_hz;
        for (supply_v, factor) in [(7.4, 1.0), (8.14, 1.1_f64.sqrt()), (6.66, 0.9_f64.sqrt())] {
            let mut a = Actuation { flap_hz: [12.0, 0.0], ..Actuation::default() };
            effect.actuate(&State { supply_v, ..probe::hover() }, &mut a);
            let wanted = offset_hz + (12.0 - offset_hz) * factor;
            assert!((a.flap_hz[0] - wanted).abs() < 1e-9, "{supply_v}: {:?}", a.flap_hz);
            assert_eq!(a.flap_hz[1], 0.0);
        }
    }
}
