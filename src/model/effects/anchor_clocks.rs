//! Crystals of anchors and tag run at their own rates, which wander with temperature.
//!
//! `rate = 1 + s`, `s = s₀ + √2 σ_d sin(2π t / T + φ)`; `s₀ ~ N(0, σ²)` and `φ`, `T` (1 to 3 minutes) per
//! device; parts per million. The last entry is the tag. Source: crystals of DWM1000 nodes, trimmed to
//! a few ppm. Drift is smooth because it is thermal: within the 50 ms that a TDOA spans it changes a
//! path by millimetres at most, as on the real devices. Left out: warm-up in the first seconds (U8 ramps
//! one anchor), phase noise.

use std::f64::consts::{SQRT_2, TAU};

use crate::effects::{Block, Build, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};

const PPM: f64 = 1e-6;
/// Periods of the drift, s. Assumed: thermal.
const PERIOD_S: [f64; 2] = [60.0, 180.0];

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N14",
    name: "anchor and tag clocks",
    block: Block::Uwb,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "std_offset",
            "ppm",
            Kind::Size,
            0.0,
            3.0,
            [0.5, 10.0],
            "rate error of each device",
        ),
        ParameterSpec::new(
            "std_drift",
            "ppm",
            Kind::Size,
            0.0,
            0.05,
            [0.0, 0.5],
            "wander of each rate",
        ),
    ],
    off: "all clocks run at the same rate",
    source: "DWM1000 crystals; drift assumed",
    equation: "rate = 1 + s₀ + √2 σ_d sin(2π t / T + φ)",
    build: |b| Box::new(AnchorClocks::new(b)),
};

struct Device {
    offset: f64,
    drift: f64,
    frequency_radps: f64,
    phase_rad: f64,
}

struct AnchorClocks(Vec<Device>);

impl AnchorClocks {
    fn new(mut b: Build<'_>) -> Self {
        let devices = (0..=b.sites_E_m.len())
            .map(|_| Device {
                offset: b.value[0] * PPM * b.rng.normal(),
                drift: SQRT_2 * b.value[1] * PPM,
                frequency_radps: TAU / b.rng.between(PERIOD_S[0], PERIOD_S[1]),
                phase_rad: b.rng.between(0.0, TAU),
            })
            .collect();
        Self(devices)
    }
}

impl Effect for AnchorClocks {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Clocks]
    }
    fn clocks(&mut self, s: &State, skew: &mut [f64]) {
        for (d, skew) in self.0.iter().zip(skew) {
            *skew += d.offset + d.drift * (d.frequency_radps * s.t_s + d.phase_rad).sin();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_devices_differ_and_drift_smoothly() {
        let mut clocks = probe::build(&SPEC, &[]);
        let mut read = |t_s| {
            let mut skew = [0.0; 9];
            clocks.clocks(&State { t_s, ..probe::hover() }, &mut skew);
            skew
        };
        let (first, next, later) = (read(0.0), read(0.1), read(60.0));
        for i in 0..9 {
            assert!(first[i] != 0.0 && first[i].abs() < 12.0 * PPM);
            assert!((first[i] - next[i]).abs() < 0.001 * PPM);
            assert!((first[i] - later[i]).abs() < 0.15 * PPM);
        }
        assert!(first != later);
    }
}
