//! What was asked of the board and what came of it: attitude, thrust and its parts, battery.

use std::collections::BTreeSet;

use super::{Clock, series};
use crate::report::flight::Flight;
use crate::report::svg::{Limit, Mark, Tone};
use haltere_core::estimate::Health;
use haltere_core::time::HostTime;
use haltere_core::topics::ControlRecord;

/// Smallest extent of the axis of angles.
const LEAST_DEG: f64 = 4.0;

/// A column of the control steps over time.
fn column(flight: &Flight, clock: &Clock, f: impl Fn(&ControlRecord) -> f64) -> Vec<[f64; 2]> {
    flight.controls.iter().map(|c| [clock.s(c.at), f(c)]).collect()
}

/// Roll, pitch and yaw.
pub(super) fn attitude(flight: &Flight, clock: &Clock) -> Vec<String> {
    (0..3).map(|axis| angle(flight, clock, axis)).collect()
}

fn angle(flight: &Flight, clock: &Clock, axis: usize) -> String {
    let of = |f: fn(&ControlRecord) -> f64| column(flight, clock, |c| f(c).to_degrees());
    let estimate = flight.estimates.iter().map(|e| {
        let known = e.health != Health::NotAligned;
        let angle_deg = if known { e.R_EB.euler_rad()[axis].to_degrees() } else { f64::NAN };
        [clock.s(e.at), angle_deg]
    });
    let truth = flight.truth.iter();
    let truth = truth.map(|row| [clock.s(row.at), row.R_EB.euler_rad()[axis].to_degrees()]);
    let (title, setpoint, feed_forward) = match axis {
        0 => ("Roll", of(|c| c.roll_rad), Some(of(|c| c.roll_ff_rad))),
        1 => ("Pitch", of(|c| c.pitch_rad), Some(of(|c| c.pitch_ff_rad))),
        _ => ("Yaw, from room north", of(|c| c.yaw_rad), None),
    };
    let mut lines = vec![series("truth", Tone::Truth, Mark::Line, unwound(truth.collect()))];
    // The board's own yaw counts from its own north: not one axis with ours.
    if axis < 2 {
        let board = flight.board_attitudes.iter();
        let board = board.map(|b| [clock.s(b.valid_at), b.attitude.euler_rad()[axis].to_degrees()]);
        lines.push(series("board", Tone::Family(2), Mark::Line, board.collect()));
    }
    if let Some(points) = feed_forward {
        lines.push(series("drag feed-forward", Tone::Family(1), Mark::Line, points));
    }
    let estimate = unwound(estimate.collect());
    lines.push(series("estimate", Tone::Estimate, Mark::Line, estimate));
    lines.push(series("setpoint", Tone::Command, Mark::Dashed, unwound(setpoint)));
    let mut plot = clock.plot(title, "degrees", lines);
    plot.least_height = LEAST_DEG;
    plot.render()
}

/// Breaks a line of angles where it jumps from one end of the circle to the other.
fn unwound(points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let mut out: Vec<[f64; 2]> = Vec::with_capacity(points.len());
    for p in points {
        if out.last().is_some_and(|last| (last[1] - p[1]).abs() > 180.0) {
            out.push([p[0], f64::NAN]);
        }
        out.push(p);
    }
    out
}

/// Thrust, its corrections one by one, and the battery.
pub(super) fn thrust(flight: &Flight, clock: &Clock) -> Vec<String> {
    let mut plots = vec![sent(flight, clock), corrections(flight, clock), battery(flight, clock)];
    if flight.battery.iter().any(|b| b.current_a.is_some()) {
        let points = flight.battery.iter();
        let points = points.map(|b| [clock.s(b.received_at), b.current_a.unwrap_or(f64::NAN)]);
        let lines = vec![series("told by the board", Tone::Estimate, Mark::Line, points.collect())];
        plots.push(clock.plot("Current", "A", lines).render());
    }
    plots
}

/// Outputs of a board that tells four, as the two-winged vehicles of this kind have them (docs/GAP.md, 2).
const FOUR: [&str; 4] = ["Pitch servo", "Left motor", "Yaw servo", "Right motor"];

/// What the board told each motor and servo.
pub(super) fn outputs(flight: &Flight, clock: &Clock) -> Vec<String> {
    let outputs = flight.outputs();
    let ports = outputs.keys().map(|(port, _)| port).collect::<BTreeSet<_>>().len();
    let plot = |((port, n), told): (&(u8, usize), &Vec<(HostTime, f32)>)| {
        let points = told.iter().map(|(at, value)| [clock.s(*at), f64::from(*value)]).collect();
        let lines = vec![series("told by the board", Tone::Command, Mark::Line, points)];
        let all = outputs.keys().filter(|(of, _)| of == port).count();
        let name = FOUR.get(n.wrapping_sub(1)).filter(|_| all == FOUR.len());
        let of = if ports > 1 { format!(" of port {port}") } else { String::new() };
        let title = match name {
            Some(name) => format!("{name} (output {n}{of})"),
            None => format!("Output {n}{of}"),
        };
        let mut plot = clock.plot(&title, "\u{b5}s, or as its driver takes", lines);
        plot.least_height = 20.0;
        plot.render()
    };
    outputs.iter().map(plot).collect()
}

fn sent(flight: &Flight, clock: &Clock) -> String {
    let mut lines = vec![
        series("base", Tone::Family(0), Mark::Line, column(flight, clock, |c| c.thrust_base_frac)),
        series("sent", Tone::Command, Mark::Line, column(flight, clock, |c| c.thrust_frac)),
    ];
    let cut = |c: &ControlRecord| c.saturation.thrust_high || c.saturation.thrust_low;
    let at_limit: Vec<_> =
        flight.controls.iter().filter(|c| cut(c)).map(|c| [clock.s(c.at), c.thrust_frac]).collect();
    if !at_limit.is_empty() {
        lines.push(series("at a limit", Tone::Family(3), Mark::Dots, at_limit));
    }
    let mut plot = clock.plot("Thrust", "of full throttle", lines);
    plot.least_height = 0.2;
    plot.render()
}

/// What each correction adds to the thrust, in the order in which the law applies them: voltage to the
/// base, feedback, then the factors of tilt and ground.
fn corrections(flight: &Flight, clock: &Clock) -> String {
    let both = |c: &ControlRecord| c.thrust_base_frac + c.thrust_feedback_frac;
    // Old logs do not hold the factor of the tilt: that line is then missing.
    let tilt = column(flight, clock, |c| both(c) * (c.tilt_factor - 1.0));
    let ground = column(flight, clock, |c| {
        let tilt = if c.tilt_factor.is_finite() { c.tilt_factor } else { 1.0 };
        both(c) * tilt * (c.ground_factor - 1.0)
    });
    let feedback = column(flight, clock, |c| c.thrust_feedback_frac);
    let mut lines = vec![series("feedback", Tone::Family(0), Mark::Line, feedback)];
    if tilt.iter().any(|p| p[1].is_finite()) {
        lines.push(series("tilt", Tone::Family(1), Mark::Line, tilt));
    }
    lines.push(series("ground effect", Tone::Family(2), Mark::Line, ground));
    if let Some(nominal) = flight.base_nominal_frac {
        let voltage = column(flight, clock, |c| c.thrust_base_frac - nominal);
        lines.push(series("voltage", Tone::Family(3), Mark::Line, voltage));
    }
    let mut plot = clock.plot("Corrections", "of full throttle", lines);
    plot.limits = vec![Limit { name: String::new(), y: 0.0 }];
    plot.least_height = 0.1;
    plot.render()
}

fn battery(flight: &Flight, clock: &Clock) -> String {
    let told = flight.battery.iter().map(|b| [clock.s(b.received_at), b.supply_v]).collect();
    let truth = flight.truth.iter().map(|row| [clock.s(row.at), row.supply_v]).collect();
    let mut plot = clock.plot(
        "Battery",
        "V",
        vec![
            series("truth", Tone::Truth, Mark::Line, truth),
            series("told by the board", Tone::Estimate, Mark::Line, told),
        ],
    );
    for (tone, id) in (0..).zip(flight.other_packs().into_keys()) {
        let others = flight.other_batteries.iter().filter(|other| other.id == id);
        let others = others.map(|o| [clock.s(o.sample.received_at), o.sample.supply_v]);
        let name = format!("battery {id}, not flown on");
        plot.series.push(series(&name, Tone::Family(tone), Mark::Dashed, others.collect()));
    }
    plot.limits = flight.battery_limits.clone();
    plot.least_height = 0.4;
    plot.render()
}
