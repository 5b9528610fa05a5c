//! Where it was and how fast: maps, position and velocity, and the error of the estimate.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::{Clock, SHOWN, WIDE_PX, series};
use crate::report::errors::{AXES, Path, PathKind};
use crate::report::flight::Flight;
use crate::report::svg::{Mark, Pin, Plot, Series, Tone};
use crate::report::truth::TruthRow;
use haltere_core::estimate::{Estimate, Health};
use haltere_core::frames::{E, Vec3};
use haltere_core::time::HostTime;

/// Four shapes a row.
const SHAPE_PX: [f64; 2] = [270.0, 260.0];
const MAP_PX: [f64; 2] = [540.0, 430.0];
/// Smallest extents of vertical axes, so that noise does not fill a plot.
const LEAST_M: f64 = 0.5;
const LEAST_MPS: f64 = 0.4;

/// Maps and position.
pub(super) fn place(flight: &Flight, clock: &Clock) -> Vec<String> {
    vec![plan(flight, false), plan(flight, true), position(flight, clock)]
}

/// Truth, estimate and command seen from above, at the times that `inside` picks.
fn tracks(flight: &Flight, inside: impl Fn(HostTime) -> bool, names: bool) -> Vec<Series> {
    let map = |v: Vec3<E>| [v.y(), v.x()];
    let setpoint = |s: &[Option<f64>; 3]| match s {
        [Some(x), Some(y), _] => [*y, *x],
        _ => [f64::NAN; 2],
    };
    let name = |name| if names { name } else { "" };
    let truth = flight.truth.iter().filter(|row| inside(row.at));
    let estimates = flight.estimates.iter().filter(|e| inside(e.at));
    let controls = flight.controls.iter().filter(|c| inside(c.at));
    let truth = truth.map(|row| map(row.pos_E_m)).collect();
    let estimate = estimates.map(|e| map(believed(e).pos_E_m)).collect();
    let command = controls.map(|c| setpoint(&c.pos_setpoint_E_m)).collect();
    vec![
        series(name("truth"), Tone::Truth, Mark::Line, truth),
        series(name("estimate"), Tone::Estimate, Mark::Line, estimate),
        series(name("command"), Tone::Command, Mark::Dashed, command),
    ]
}

/// One map per shape.
pub fn shapes(flight: &Flight, paths: &[Path]) -> String {
    let shapes = paths.iter().filter(|p| p.kind == PathKind::Shape);
    shapes
        .map(|path| {
            let inside = |at| path.spans.iter().any(|(from, to)| (*from..=*to).contains(&at));
            Plot {
                title: path.name.clone(),
                x_label: "east y, m".into(),
                y_label: "north x, m".into(),
                series: tracks(flight, inside, false),
                equal: true,
                least_height: LEAST_M,
                size_px: SHAPE_PX,
                ..Plot::default()
            }
            .render()
        })
        .collect()
}

/// Seen from above: close up, or with the whole room around it.
fn plan(flight: &Flight, room: bool) -> String {
    let pins = flight.survey.iter().filter(|_| room).flat_map(|survey| {
        survey.ids().iter().filter_map(|id| {
            let pos = survey.position_E_m(*id)?;
            Some(((pos.x() * 1e3).round() as i64, (pos.y() * 1e3).round() as i64, *id, pos))
        })
    });
    // Anchors above one another share a pin.
    let mut stacked: BTreeMap<(i64, i64), (String, Vec3<E>)> = BTreeMap::new();
    for (x, y, id, pos) in pins {
        stacked
            .entry((x, y))
            .and_modify(|(name, _)| {
                let _ = write!(name, ", {id}");
            })
            .or_insert((format!("anchor {id}"), pos));
    }
    Plot {
        title: if room { "The room" } else { "From above" }.into(),
        x_label: "east y, m".into(),
        y_label: "north x, m".into(),
        series: tracks(flight, |_| true, true),
        pins: stacked
            .into_values()
            .map(|(name, pos)| Pin { name, at: [pos.y(), pos.x()] })
            .collect(),
        equal: true,
        least_height: LEAST_M,
        size_px: MAP_PX,
        ..Plot::default()
    }
    .render()
}

/// Before alignment there is no estimate: nothing is drawn.
fn believed(estimate: &Estimate) -> Estimate {
    let mut shown = *estimate;
    if estimate.health == Health::NotAligned {
        shown.pos_E_m = Vec3::new(f64::NAN, f64::NAN, f64::NAN);
        shown.vel_B_mps = Vec3::new(f64::NAN, f64::NAN, f64::NAN);
    }
    shown
}

fn truth_points(flight: &Flight, point: impl Fn(&TruthRow) -> [f64; 2]) -> Vec<[f64; 2]> {
    flight.truth.iter().map(point).collect()
}

fn position(flight: &Flight, clock: &Clock) -> String {
    let mut all = String::from("<div class=\"wide\">");
    for (name, shown) in SHOWN {
        let setpoint = |s: &[Option<f64>; 3]| {
            let at = |i: usize| s[i].unwrap_or(f64::NAN);
            shown(Vec3::new(at(0), at(1), at(2)))
        };
        let truth = truth_points(flight, |row| [clock.s(row.at), shown(row.pos_E_m)]);
        let mut lines = vec![
            series(
                "command",
                Tone::Command,
                Mark::Dashed,
                flight
                    .controls
                    .iter()
                    .map(|c| [clock.s(c.at), setpoint(&c.pos_setpoint_E_m)])
                    .collect(),
            ),
            series("truth", Tone::Truth, Mark::Line, truth),
            series(
                "estimate",
                Tone::Estimate,
                Mark::Line,
                flight
                    .estimates
                    .iter()
                    .map(|e| [clock.s(e.at), shown(believed(e).pos_E_m)])
                    .collect(),
            ),
        ];
        if !flight.references.is_empty() {
            let points = flight.references.iter();
            let points = points.map(|r| [clock.s(r.valid_at), shown(r.pos_E_m)]).collect();
            lines.push(series("motion capture", Tone::Family(3), Mark::Line, points));
        }
        let mut plot = clock.plot(name, "m", lines);
        plot.least_height = LEAST_M;
        plot.size_px = [WIDE_PX[0], 170.0];
        all.push_str(&plot.render());
    }
    all.push_str("</div>");
    all
}

/// Velocity by axis, and the error of the position.
pub(super) fn velocity(flight: &Flight, clock: &Clock) -> Vec<String> {
    let names = ["north", "east", "climb"];
    names
        .into_iter()
        .zip(SHOWN)
        .map(|(name, (_, shown))| {
            let command = flight.controls.iter();
            let truth = truth_points(flight, |row| [clock.s(row.at), shown(row.vel_E_mps)]);
            let estimate = flight.estimates.iter();
            let mut plot = clock.plot(
                name,
                "m/s",
                vec![
                    series(
                        "command",
                        Tone::Command,
                        Mark::Dashed,
                        command.map(|c| [clock.s(c.at), shown(c.vel_setpoint_E_mps)]).collect(),
                    ),
                    series("truth", Tone::Truth, Mark::Line, truth),
                    series(
                        "estimate",
                        Tone::Estimate,
                        Mark::Line,
                        estimate.map(|e| [clock.s(e.at), shown(believed(e).vel_E_mps())]).collect(),
                    ),
                ],
            );
            plot.least_height = LEAST_MPS;
            plot.render()
        })
        .chain([estimate_error(flight, clock)])
        .collect()
}

/// Estimated minus true position, where somebody knows the truth, within three sigma of the filter.
fn estimate_error(flight: &Flight, clock: &Clock) -> String {
    let mut lines: [Vec<[f64; 2]>; 3] = Default::default();
    let mut bound = Vec::new();
    for estimate in flight.estimates.iter().filter(|e| e.health != Health::NotAligned) {
        let Some((truth_E_m, _)) = flight.truth_at(estimate.at) else { continue };
        let error = estimate.pos_E_m - truth_E_m;
        let at_s = clock.s(estimate.at);
        for (axis, line) in lines.iter_mut().enumerate() {
            line.push([at_s, error[axis]]);
        }
        let std_m = estimate.std_pos_E_m;
        bound.push([at_s, 3.0 * std_m.x().max(std_m.y()).max(std_m.z())]);
    }
    let below = bound.iter().map(|p| [p[0], -p[1]]).collect();
    let bounds = [("3\u{3c3} of the filter", bound), ("", below)]
        .map(|(name, points)| series(name, Tone::Family(3), Mark::Bound, points));
    let tones = [Tone::Command, Tone::Estimate, Tone::Family(2)];
    let lines = lines.into_iter().zip(AXES).zip(tones);
    let lines = lines.map(|((points, axis), tone)| series(axis, tone, Mark::Line, points));
    let series = bounds.into_iter().chain(lines).collect();
    let mut plot = clock.plot("Estimate \u{2212} truth", "m", series);
    plot.least_height = 0.2;
    plot.render()
}
