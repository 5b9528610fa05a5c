//! What the fits take from a flight: held angles, hovers, all as plain columns.
//!
//! Times are seconds since the first control step. Leans and speeds are counted in the heading frame:
//! forward and right.

use crate::report::flight::Flight;
use haltere_core::control::TiltAxis;
use haltere_core::control::config::TrimConfig;
use haltere_core::frames::{B, E, Rot, Vec3};
use haltere_core::time::HostTime;
use haltere_core::topics::ControlRecord;

/// A setpoint that stays the same to this for longer than [`HELD_S`] is held, rad.
const SAME_RAD: f64 = 1e-9;
/// Shortest hold, s.
const HELD_S: f64 = 0.25;
/// Least held angle, rad (a degree).
const LEAST_RAD: f64 = 0.0175;
/// Control steps farther apart than this are no one stretch, s.
const GAP_S: f64 = 0.1;
/// Hover: the commanded point rests (moves less than this from step to step, m) …
const REST_M: f64 = 1e-6;
/// … for so long already, s: what a manoeuvre leaves behind has gone …
const CALM_S: f64 = 4.0;
/// … and the speed is below this, m/s: near the floor the filter wanders by half a metre a second.
const HOVER_MPS: f64 = 1.0;
/// Hover is averaged over this, s.
const MEAN_S: f64 = 0.5;

/// One held angle.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldStep {
    /// Which axis.
    pub axis: TiltAxis,
    /// Commanded angle without trim, rad.
    pub angle_rad: f64,
    /// Since the first control step, s.
    pub start_s: f64,
    /// Time since the start of the hold, s.
    pub t_s: Vec<f64>,
    /// Speed in the direction that the lean drives to, m/s.
    pub speed_mps: Vec<f64>,
    /// Attitude reached over the commanded angle.
    pub reached_frac: Vec<f64>,
}

impl HeldStep {
    /// First sample at which the attitude has arrived (90 %), or the first after 0.5 s.
    pub fn arrived(&self) -> usize {
        let there = self.reached_frac.iter().position(|r| *r >= 0.9);
        let late = self.t_s.iter().position(|t| *t >= 0.5);
        let last = self.t_s.len();
        there.unwrap_or(last).min(late.unwrap_or(last))
    }
}

/// A second-long piece of hover.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoverMean {
    /// Middle, s.
    pub t_s: f64,
    /// Thrust that carries the weight upright: command times the cosine of the tilt.
    pub thrust_frac: f64,
    /// Battery, V.
    pub supply_v: f64,
    /// Height that was asked for above the origin, m; without one, the estimate's.
    pub height_m: f64,
    /// Height by the estimate, or true if that was asked for, m.
    pub seen_m: f64,
}

/// Attitude, position and velocity.
type Motion = (Rot<E, B>, Vec3<E>, Vec3<E>);

/// Estimate or truth at the time of each control step.
fn motions(flight: &Flight, truth: bool) -> Vec<Option<Motion>> {
    let at = |t: HostTime, motion: Motion| (t, motion);
    let rows: Vec<(HostTime, Motion)> = if truth && !flight.truth.is_empty() {
        flight.truth.iter().map(|r| at(r.at, (r.R_EB, r.pos_E_m, r.vel_E_mps))).collect()
    } else {
        flight.estimates.iter().map(|e| at(e.at, (e.R_EB, e.pos_E_m, e.vel_E_mps()))).collect()
    };
    let mut next = 0;
    flight
        .controls
        .iter()
        .map(|c| {
            while next + 1 < rows.len() && rows[next + 1].0 <= c.at {
                next += 1;
            }
            let (t, motion) = rows.get(next)?;
            let ok = c.at.seconds_since(*t).abs() < GAP_S
                && motion.1.is_finite()
                && motion.2.is_finite();
            ok.then_some(*motion)
        })
        .collect()
}

/// Every held angle of a flight.
pub fn held_steps(flight: &Flight, trims: &TrimConfig, truth: bool) -> Vec<HeldStep> {
    let motions = motions(flight, truth);
    let controls = &flight.controls;
    let Some(first) = controls.first() else { return Vec::new() };
    let trim = |axis| match axis {
        TiltAxis::Roll => trims.roll_deg.to_radians(),
        TiltAxis::Pitch => trims.pitch_deg.to_radians(),
    };
    let mut found = Vec::new();
    for axis in [TiltAxis::Pitch, TiltAxis::Roll] {
        let of = |i: usize| [controls[i].roll_rad, controls[i].pitch_rad];
        let [own, other] = match axis {
            TiltAxis::Roll => [0, 1],
            TiltAxis::Pitch => [1, 0],
        };
        let set = |i: usize| of(i)[own];
        let mut start = 0;
        for i in 1..=controls.len() {
            let goes_on = i < controls.len()
                && (set(i) - set(start)).abs() < SAME_RAD
                && !controls[i].saturation.tilt
                && (0.0..GAP_S).contains(&controls[i].at.seconds_since(controls[i - 1].at));
            if goes_on {
                continue;
            }
            let angle_rad = set(start) - trim(axis);
            let long_s = controls[i - 1].at.seconds_since(controls[start].at);
            // While one axis is stepped, the other keeps the vehicle on its line, and may rest at its limit.
            let aside_rad =
                (start..i).map(|k| of(k)[other].abs()).sum::<f64>() / (i - start) as f64;
            let along = aside_rad < angle_rad.abs();
            if long_s >= HELD_S && angle_rad.abs() >= LEAST_RAD && angle_rad.is_finite() && along {
                let begin = controls[start].at;
                let mut step = HeldStep {
                    axis,
                    angle_rad,
                    start_s: begin.seconds_since(first.at),
                    t_s: Vec::new(),
                    speed_mps: Vec::new(),
                    reached_frac: Vec::new(),
                };
                for k in start..i {
                    let Some((R_EB, _, vel)) = motions[k] else { continue };
                    let heading = Rot::<E, B>::from_euler_rad(0.0, 0.0, R_EB.yaw_rad());
                    let v = heading.inverse() * vel;
                    let [roll, pitch, _] = R_EB.euler_rad();
                    // Nose down flies forward, right side down flies right.
                    let (along, lean) = match axis {
                        TiltAxis::Pitch => (-v.x() * angle_rad.signum(), pitch),
                        TiltAxis::Roll => (v.y() * angle_rad.signum(), roll),
                    };
                    step.t_s.push(controls[k].at.seconds_since(begin));
                    step.speed_mps.push(along);
                    step.reached_frac.push((lean - trim(axis)) / angle_rad);
                }
                found.push(step);
            }
            start = i;
        }
    }
    found.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    found
}

/// The longest stretch of hover: times and horizontal speeds forward and right, for what noise is
/// in them.
pub fn hover_speeds(flight: &Flight, truth: bool) -> [(Vec<f64>, Vec<f64>); 2] {
    let motions = motions(flight, truth);
    let calm = calm_steps(flight, &motions);
    let mut best = 0..0;
    let mut start = 0;
    for i in 0..=calm.len() {
        if i < calm.len() && calm[i] {
            continue;
        }
        if i - start > best.len() {
            best = start..i;
        }
        start = i + 1;
    }
    let mut out = [(Vec::new(), Vec::new()), (Vec::new(), Vec::new())];
    let Some(begin) = flight.controls.get(best.start).map(|c| c.at) else { return out };
    for k in best {
        let Some((R_EB, _, vel)) = motions[k] else { continue };
        let heading = Rot::<E, B>::from_euler_rad(0.0, 0.0, R_EB.yaw_rad());
        let v = heading.inverse() * vel;
        for (slot, value) in out.iter_mut().zip([v.x(), v.y()]) {
            slot.0.push(flight.controls[k].at.seconds_since(begin));
            slot.1.push(value);
        }
    }
    out
}

/// Control steps in calm hover.
fn calm_steps(flight: &Flight, motions: &[Option<Motion>]) -> Vec<bool> {
    let mut since: Option<HostTime> = None;
    let mut before: Option<&ControlRecord> = None;
    flight
        .controls
        .iter()
        .zip(motions)
        .map(|(c, motion)| {
            let rests = before.is_some_and(|b| {
                let mut pairs = b.pos_setpoint_E_m.iter().zip(c.pos_setpoint_E_m);
                let still = |(a, b): (&Option<f64>, Option<f64>)| {
                    matches!((a, b), (Some(a), Some(b)) if (a - b).abs() < REST_M)
                };
                pairs.all(still)
                    && (0.0..GAP_S).contains(&c.at.seconds_since(b.at))
            });
            before = Some(c);
            if !rests {
                since = None;
                return false;
            }
            let s = c.saturation;
            motion.is_some_and(|(_, _, v)| v.norm() < HOVER_MPS)
                && !(s.tilt || s.thrust_high || s.thrust_low)
                && c.at.seconds_since(*since.get_or_insert(c.at)) > CALM_S
        })
        .collect()
}

/// Hover in means of half a second; heights seen are true ones if `truth` is asked for and there.
pub fn hover_means(flight: &Flight, truth: bool) -> Vec<HoverMean> {
    let motions = motions(flight, truth);
    let calm = calm_steps(flight, &motions);
    let Some(first) = flight.controls.first() else { return Vec::new() };
    let mut battery = flight.battery.iter().peekable();
    let mut supply_v = None;
    let mut means = Vec::new();
    let mut sum = [0.0; 5];
    let (mut count, mut begin_s) = (0.0, f64::NAN);
    for ((c, motion), calm) in flight.controls.iter().zip(&motions).zip(calm) {
        while let Some(b) = battery.next_if(|b| b.received_at <= c.at) {
            supply_v = Some(b.supply_v);
        }
        let t_s = c.at.seconds_since(first.at);
        let (Some((R_EB, pos, _)), Some(supply_v), true) = (motion, supply_v, calm) else {
            (sum, count) = ([0.0; 5], 0.0);
            continue;
        };
        if count == 0.0 {
            begin_s = t_s;
        }
        let upright = R_EB.matrix()[(2, 2)];
        let height_m = c.pos_setpoint_E_m[2].map_or(-pos.z(), |z| -z);
        for (slot, value) in
            sum.iter_mut().zip([t_s, c.thrust_frac * upright, supply_v, height_m, -pos.z()])
        {
            *slot += value;
        }
        count += 1.0;
        if t_s - begin_s >= MEAN_S {
            let [t_s, thrust_frac, supply_v, height_m, seen_m] = sum.map(|s| s / count);
            let mean = HoverMean { t_s, thrust_frac, supply_v, height_m, seen_m };
            if thrust_frac > 0.0 && supply_v > 0.0 {
                means.push(mean);
            }
            (sum, count) = ([0.0; 5], 0.0);
        }
    }
    means
}
