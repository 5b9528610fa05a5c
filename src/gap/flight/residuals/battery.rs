//! BAT: voltage minus open-circuit voltage of the charge drawn and nominal resistance, V.
//! CUR: current minus that of the nominal flap rate, A.

use super::{Channel, Flight, Sheet};
use crate::flight::regress::{Ridge, log, moments};
use haltere_model::effects::Block;

/// Ampere seconds in a milliampere hour.
const AS_PER_MAH: f64 = 3.6;
/// Time constant of the fast part of the current, s.
const FAST_S: f64 = 2.0;
/// Flap rate over that of hover from which on it is high: motors of P5 saturate from 1.05 on.
const HIGH: f64 = 1.08;

/// Noise of any board's voltage, V: two steps of a converter of 12 bits over 10 V. A model that is better
/// than that is not seen to be.
const NOISE_V: f64 = 0.005;

/// Residuals at the battery's own samples.
#[derive(Debug, Default)]
pub struct Rows {
    /// Point of the grid.
    pub k: Vec<usize>,
    /// Voltage minus nominal, V.
    pub volt: Vec<f64>,
    /// Current minus nominal, A.
    pub current: Vec<f64>,
    /// Flap rate over that of hover.
    pub ratio: Vec<f64>,
    /// Current, A; its fast part, A; charge drawn, share; charge told minus nominal, share.
    pub inputs: Vec<[f64; 4]>,
}

/// Residuals of a flight; empty when the board tells no current.
pub fn residuals(f: &Flight<'_>) -> Rows {
    let mut rows = Rows::default();
    let b = &f.nominal.vehicle.battery;
    let (mut drawn_as, mut slow_a) = (0.0, f64::NAN);
    let mut last = None;
    for s in &f.trace.batteries {
        let Some(current_a) = s.current_a else { continue };
        let dt = last.map_or(0.0, |t| s.received_at.seconds_since(t)).clamp(0.0, 5.0);
        last = Some(s.received_at);
        drawn_as += current_a * dt;
        if !slow_a.is_finite() {
            slow_a = current_a;
        }
        slow_a += (current_a - slow_a) * (1.0 - (-dt / FAST_S).exp());
        let Some((k, _)) = f.line.place(s.received_at).filter(|(k, _)| f.clear[*k]) else {
            continue;
        };
        let used = drawn_as / (b.capacity_mah * AS_PER_MAH);
        let told = s.remaining_frac.map_or(f64::NAN, |q| q - (b.charge_frac - used));
        rows.k.push(k);
        rows.volt.push(s.supply_v - f.nominal.supply_v(b.charge_frac - used, current_a));
        rows.current.push(current_a - f.nominal.current_a(f.flap_hz[k], s.supply_v));
        rows.ratio.push(f.flap_hz[k] / f.nominal.vehicle.hover_hz());
        rows.inputs.push([current_a, current_a - slow_a, used, told]);
    }
    rows
}

/// Writes the statistics; `None` lists them.
pub fn put(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    let mut v = [f64::NAN; 7];
    let mut c = [f64::NAN; 6];
    let mut told = [f64::NAN; 2];
    if let Some(rows) = f.map(residuals).filter(|r| r.k.len() >= 20) {
        let n = rows.k.len() as f64;
        let mean = rows.inputs.iter().map(|i| i[0]).sum::<f64>() / n;
        let mut volt = Ridge::new(&[0.5, 0.3, 3.0, 0.3], 0.03);
        let mut current = Ridge::new(&[1.0, 1.0, 1.0, 10.0], 0.2);
        let mut charge = Ridge::new(&[0.2, 1.0], 0.02);
        for (i, x) in rows.inputs.iter().enumerate() {
            volt.row(&[1.0, x[0] - mean, x[2] - 0.2, x[1]], rows.volt[i]);
            current.row(&[1.0, x[1], x[2] - 0.2, (rows.ratio[i] - HIGH).max(0.0)], rows.current[i]);
            charge.row(&[1.0, x[2] - 0.2], x[3]);
        }
        let (b, a, q) = (volt.solve(), current.solve(), charge.solve());
        let end = rows.volt[rows.volt.len() - 10..].iter().sum::<f64>() / 10.0;
        let start = rows.volt[..10].iter().sum::<f64>() / 10.0;
        v = [
            b[0],
            b[1],
            b[2],
            b[3],
            log(moments(rows.volt.iter().copied()).std.hypot(NOISE_V)),
            end,
            start,
        ];
        let m = moments(rows.current.iter().copied());
        let high = rows.ratio.iter().filter(|r| **r > HIGH).count() >= 5;
        c = [a[0], a[1], a[2], log(m.std), m.skew, if high { a[3] } else { f64::NAN }];
        told = [q[0], q[1]];
    }
    let at = (Block::Battery, Channel::Battery);
    let names = [
        ("const", "V", "voltage beyond nominal"),
        ("current", "Ω", "with current"),
        ("drawn", "V", "with charge drawn"),
        ("fast", "Ω", "with the fast part of the current"),
        ("std", "ln", "spread"),
        ("end", "V", "at the end"),
        ("start", "V", "at the start"),
    ];
    for ((name, unit, meaning), value) in names.into_iter().zip(v) {
        sheet.put(at, format!("battery.{name}"), unit, meaning, value);
    }
    sheet.put(at, "battery.told", "1", "charge told beyond that drawn", told[0]);
    sheet.put(at, "battery.told_slope", "1", "its change per charge drawn", told[1]);
    let at = (Block::Thrust, Channel::Current);
    let names = [
        ("const", "A", "current beyond nominal"),
        ("fast", "1", "with the fast part of the current"),
        ("drawn", "A", "with charge drawn"),
        ("std", "ln", "spread"),
        ("skew", "1", "skewness: clipped at high throttle"),
        ("high", "A", "with flap rate beyond 1.08 of hover: a plateau"),
    ];
    for ((name, unit, meaning), value) in names.into_iter().zip(c) {
        sheet.put(at, format!("current.{name}"), unit, meaning, value);
    }
}
