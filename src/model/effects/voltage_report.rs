//! The board measures its voltage late or wrongly, so voltage compensation goes wrong.
//!
//! `V_told = V₀ (V_lag / V₀)^e`, `V_lag' = (V - V_lag) / τ`, `V₀` 3.7 V a cell. Size by judgement. Left out: errors inside
//! the companion.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, STEP_S, Stage, State,
    Supply,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "P8",
    name: "voltage report error",
    block: Block::Battery,
    parameters: &[
        ParameterSpec::new("lag", "s", Kind::Size, 0.0, 2.0, [0.5, 5.0], "lag of the measurement")
            .ways("late", "late"),
        ParameterSpec::new("exponent", "", Kind::Component, 1.0, 0.8, [0.5, 1.5], "exponent")
            .ways("of every change missing", "of every change too much"),
    ],
    off: "voltage reported as it is",
    source: "plausible sizes by judgement",
    equation: "V_told = V₀ (V_lag / V₀)^e",
    role: Role::Deviation(Deviation {
        standard: false,
        hidden: Hidden::Never,
        verdict: "The board reports the voltage of the battery wrongly: {}.",
        causes: "a voltage divider that was not calibrated, a slow filter on the board",
        remedy: "calibrate the board's measurement of voltage beside a voltmeter, and make its \
            filter faster",
        shows: "errors of thrust where the voltage changes, and only there",
        looks_like: &["P2", "P4"],
        apart: "Compare with a voltmeter while the throttle is stepped: resistance (P2) and a lag \
            of thrust (P4) leave the report right.",
    }),
    build: |b| {
        Box::new(VoltageReport {
            gain: 1.0 - (-STEP_S / b.value[0].max(1e-9)).exp(),
            exponent: b.value[1],
            rated_v: b.nominal.rated_v(),
            volt: None,
        })
    },
};

struct VoltageReport {
    gain: f64,
    exponent: f64,
    /// Voltage at which the exponent does nothing, V.
    rated_v: f64,
    volt: Option<f64>,
}

impl Effect for VoltageReport {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::BatteryReport]
    }
    fn battery_report(&mut self, _s: &State, supply: &mut Supply) {
        let volt = self.volt.get_or_insert(supply.volt);
        *volt += self.gain * (supply.volt - *volt);
        supply.volt = if self.exponent == 1.0 {
            *volt
        } else {
            self.rated_v * (volt.max(0.0) / self.rated_v).powf(self.exponent)
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_lags_and_bends() {
        let mut report = probe::build(&SPEC, &[("exponent", 1.0)]);
        let mut last = 0.0;
        for k in 0..=1000 {
            let volt = if k == 0 { 8.0 } else { 7.0 };
            let mut s = Supply { volt, current_a: 3.0, charge_frac: 0.5 };
            report.battery_report(&probe::hover(), &mut s);
            last = s.volt;
        }
        assert!((last - (7.0 + (-1.0f64).exp())).abs() < 1e-3, "{last}");
        let mut s = Supply { volt: 6.4, current_a: 3.0, charge_frac: 0.5 };
        probe::build(&SPEC, &[]).battery_report(&probe::hover(), &mut s);
        assert!(s.volt > 6.5 && s.volt < 6.7, "{}", s.volt);
    }
}
