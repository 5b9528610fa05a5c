//! Which plots a flight gets, and what is drawn in each.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::estimate::{Estimate, Health};
use crate::frames::{E, Vec3};
use crate::report::errors::{AXES, Path, PathKind};
use crate::report::flight::Flight;
use crate::report::svg::{Limit, Mark, Pin, Plot, Series, Span, Tone, escape};
use crate::report::truth::{TruthRow, interpolate};
use crate::time::HostTime;

/// Drawing sizes, pixels: the page shows two plots a row.
const PLOT_PX: [f64; 2] = [540.0, 210.0];
/// Four shapes a row.
const SHAPE_PX: [f64; 2] = [270.0, 260.0];
const MAP_PX: [f64; 2] = [540.0, 430.0];
const WIDE_PX: [f64; 2] = [1100.0, 236.0];
/// Smallest extents of vertical axes, so that noise does not fill a plot.
const LEAST_M: f64 = 0.5;
const LEAST_MPS: f64 = 0.4;
const LEAST_DEG: f64 = 4.0;
/// Innovations are averaged over this span, s.
const CONSISTENCY_BIN_S: f64 = 1.0;
/// Samples below which an average says nothing.
const LEAST_SAMPLES: u32 = 10;

/// A heading and its plots.
pub struct Section {
    /// Heading.
    pub title: &'static str,
    /// One line under it: what to look for.
    pub note: &'static str,
    /// Finished SVG, in order.
    pub plots: Vec<String>,
}

/// Draws everything.
pub fn sections(flight: &Flight) -> Vec<Section> {
    let Some((start, end)) = flight.ends() else { return Vec::new() };
    let clock = Clock { start, end_s: end.seconds_since(start), modes: modes(flight, start, end) };
    vec![
        Section {
            title: "Where it flew",
            note: "Truth, where there is any, is the simulator's: the companion never sees it.",
            plots: vec![plan(flight, false), plan(flight, true), position(flight, &clock)],
        },
        Section {
            title: "Velocity, and the error of the estimate",
            note: "",
            plots: velocity(flight, &clock),
        },
        Section {
            title: "What it asked of the board",
            note: "Setpoints as sent, and the parts they are made of.",
            plots: vec![tilt(flight, &clock, false), tilt(flight, &clock, true)],
        },
        Section {
            title: "Thrust and battery",
            note: "",
            plots: vec![thrust(flight, &clock), battery(flight, &clock)],
        },
        Section {
            title: "Ranging",
            note: "Innovation is measured minus predicted. A pair whose mean stands off zero has a \
                   bias: an anchor moved, or a reflection. Consistency is innovation squared over \
                   its variance: 1 is right, more means the filter trusts too much.",
            plots: vec![pairs(flight), innovations(flight, &clock), consistency(flight, &clock)],
        },
        Section {
            title: "Timing and losses",
            note: "",
            plots: vec![ages(flight, &clock), losses(flight, &clock)],
        },
    ]
}

/// Time axis of a flight.
struct Clock {
    start: HostTime,
    end_s: f64,
    modes: Vec<Span>,
}

impl Clock {
    fn s(&self, at: HostTime) -> f64 {
        at.seconds_since(self.start)
    }

    fn plot(&self, title: &str, y_label: &str, series: Vec<Series>) -> Plot {
        Plot {
            title: title.to_string(),
            x_label: "time, s".to_string(),
            y_label: y_label.to_string(),
            series,
            spans: self.modes.clone(),
            size_px: PLOT_PX,
            x_range: Some([0.0, self.end_s.max(1.0)]),
            ..Plot::default()
        }
    }
}

/// Modes as shaded spans.
fn modes(flight: &Flight, start: HostTime, end: HostTime) -> Vec<Span> {
    let mut spans = Vec::new();
    for (i, record) in flight.modes.iter().enumerate() {
        let to = flight.modes.get(i + 1).map_or(end, |next| next.at);
        spans.push(Span {
            name: record.mode.to_string(),
            x: [record.at.seconds_since(start).max(0.0), to.seconds_since(start)],
        });
    }
    spans
}

fn series(name: &str, tone: Tone, mark: Mark, points: Vec<[f64; 2]>) -> Series {
    Series { name: name.to_string(), tone, mark, points }
}

/// Picks what is drawn from a vector in frame E.
type Shown = fn(Vec3<E>) -> f64;

/// What a plot of frame E shows of a vector: north, east, height.
const SHOWN: [(&str, Shown); 3] =
    [("north x", |v| v.x()), ("east y", |v| v.y()), ("height \u{2212}z", |v| -v.z())];

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

fn velocity(flight: &Flight, clock: &Clock) -> Vec<String> {
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

/// Estimated minus true position.
fn estimate_error(flight: &Flight, clock: &Clock) -> String {
    let mut lines: [Vec<[f64; 2]>; 3] = Default::default();
    for estimate in flight.estimates.iter().filter(|e| e.health != Health::NotAligned) {
        let Some(truth) = interpolate(&flight.truth, estimate.at) else { continue };
        let error = estimate.pos_E_m - truth.pos_E_m;
        for (axis, line) in lines.iter_mut().enumerate() {
            line.push([clock.s(estimate.at), error[axis]]);
        }
    }
    let tones = [Tone::Command, Tone::Estimate, Tone::Family(2)];
    let lines = lines.into_iter().zip(AXES).zip(tones);
    let lines = lines.map(|((points, axis), tone)| series(axis, tone, Mark::Line, points));
    let mut plot = clock.plot("Estimate \u{2212} truth", "m", lines.collect());
    plot.least_height = 0.2;
    plot.render()
}

fn tilt(flight: &Flight, clock: &Clock, pitch: bool) -> String {
    let column = |f: fn(&crate::topics::ControlRecord) -> f64| {
        flight.controls.iter().map(|c| [clock.s(c.at), f(c).to_degrees()]).collect::<Vec<_>>()
    };
    let axis = usize::from(pitch);
    let board = flight.board_attitudes.iter();
    let board = board.map(|b| [clock.s(b.valid_at), b.attitude.euler_rad()[axis].to_degrees()]);
    let (title, all, ff) = if pitch {
        ("Pitch", column(|c| c.pitch_rad), column(|c| c.pitch_ff_rad))
    } else {
        ("Roll", column(|c| c.roll_rad), column(|c| c.roll_ff_rad))
    };
    let mut plot = clock.plot(
        title,
        "degrees",
        vec![
            series("board", Tone::Truth, Mark::Line, board.collect()),
            series("drag feed-forward", Tone::Family(1), Mark::Line, ff),
            series("setpoint", Tone::Command, Mark::Line, all),
        ],
    );
    plot.least_height = LEAST_DEG;
    plot.render()
}

fn thrust(flight: &Flight, clock: &Clock) -> String {
    let column = |f: fn(&crate::topics::ControlRecord) -> f64| {
        flight.controls.iter().map(|c| [clock.s(c.at), f(c)]).collect::<Vec<_>>()
    };
    let mut plot = clock.plot(
        "Thrust, full throttle = 1",
        "fraction",
        vec![
            series("feedback", Tone::Family(2), Mark::Line, column(|c| c.thrust_feedback_frac)),
            series(
                "ground \u{2212} 1",
                Tone::Family(1),
                Mark::Line,
                column(|c| c.ground_factor - 1.0),
            ),
            series("base", Tone::Family(0), Mark::Line, column(|c| c.thrust_base_frac)),
            series("sent", Tone::Command, Mark::Line, column(|c| c.thrust_frac)),
        ],
    );
    plot.least_height = 0.2;
    plot.render()
}

fn battery(flight: &Flight, clock: &Clock) -> String {
    let told = flight.battery.iter().map(|b| [clock.s(b.received_at), b.supply_v]).collect();
    let truth = truth_points(flight, |row| [clock.s(row.at), row.supply_v]);
    let mut plot = clock.plot(
        "Battery",
        "V",
        vec![
            series("truth", Tone::Truth, Mark::Line, truth),
            series("told by the board", Tone::Estimate, Mark::Line, told),
        ],
    );
    plot.least_height = 0.4;
    plot.render()
}

/// Mean and spread of the innovation of every anchor pair, with the share that was rejected.
fn pairs(flight: &Flight) -> String {
    let pairs = flight.pairs();
    let mut plot = Plot {
        title: "Innovation by anchor pair: mean, \u{b1} one sigma; below, the share rejected"
            .into(),
        y_label: "m".into(),
        size_px: WIDE_PX,
        least_height: 0.2,
        x_range: Some([-0.7, pairs.len() as f64 - 0.3]),
        ..Plot::default()
    };
    let mut bars = Vec::new();
    let mut means = Vec::new();
    let mut labels = Vec::new();
    for (i, ((a, b), stats)) in pairs.iter().enumerate() {
        let (x, total) = (i as f64, stats.fused + stats.rejected);
        let rejected = f64::from(stats.rejected) / f64::from(total.max(1));
        labels.push((x, format!("{a}\u{2013}{b}"), format!("{:.0}%", 100.0 * rejected)));
        if let (Some(mean), Some(std)) = (stats.mean_m(), stats.std_m()) {
            bars.extend([[x, mean - std], [x, mean + std], [f64::NAN; 2]]);
            means.push([x, mean]);
        }
    }
    plot.series = vec![
        series("\u{b1} one sigma", Tone::Family(0), Mark::Line, bars),
        series("mean", Tone::Command, Mark::Dots, means),
    ];
    plot.limits = vec![Limit { name: String::new(), y: 0.0 }];
    plot.categories = labels;
    format!("<div class=\"wide bars\">{}</div>", plot.render())
}

fn innovations(flight: &Flight, clock: &Clock) -> String {
    let points = |fused: bool| {
        let records = flight.uwb.iter().filter(move |r| r.fused == fused);
        records.map(|r| [clock.s(r.tdoa.valid_at), r.innovation_m]).collect::<Vec<_>>()
    };
    let (fused, rejected) = (points(true), points(false));
    let share = 100.0 * rejected.len() as f64 / (fused.len() + rejected.len()).max(1) as f64;
    let mut plot = clock.plot(
        "Innovations",
        "m",
        vec![
            series("fused", Tone::Family(0), Mark::Dots, fused),
            series(&format!("rejected {share:.1} %"), Tone::Command, Mark::Dots, rejected),
        ],
    );
    plot.least_height = 0.4;
    plot.render()
}

fn consistency(flight: &Flight, clock: &Clock) -> String {
    let mut bins: BTreeMap<i64, (u32, f64)> = BTreeMap::new();
    for record in flight.uwb.iter().filter(|r| r.fused && r.var_innovation_m2 > 0.0) {
        let bin = (clock.s(record.tdoa.valid_at) / CONSISTENCY_BIN_S).floor() as i64;
        let (n, sum) = bins.entry(bin).or_default();
        *n += 1;
        *sum += record.innovation_m * record.innovation_m / record.var_innovation_m2;
    }
    let points = bins.into_iter().filter(|(_, (n, _))| *n >= LEAST_SAMPLES);
    let points = points
        .map(|(bin, (n, sum))| [(bin as f64 + 0.5) * CONSISTENCY_BIN_S, sum / f64::from(n)])
        .collect();
    let mut plot = clock.plot(
        "Consistency of the filter, mean over 1 s",
        "innovation\u{b2} / variance",
        vec![series("", Tone::Estimate, Mark::Line, points)],
    );
    plot.limits = vec![Limit { name: "consistent".into(), y: 1.0 }];
    plot.least_height = 2.0;
    plot.render()
}

fn ages(flight: &Flight, clock: &Clock) -> String {
    let column = |f: fn(&crate::topics::HealthRecord) -> Option<f64>| {
        let rows = flight.health.iter();
        rows.map(|h| [clock.s(h.at), f(h).map_or(f64::NAN, |s| s * 1e3)]).collect::<Vec<_>>()
    };
    let misses = flight.health.windows(2).map(|w| {
        [clock.s(w[1].at), w[1].deadline_misses.saturating_sub(w[0].deadline_misses) as f64]
    });
    let mut plot = clock.plot(
        "Data age, missed deadlines",
        "ms or count",
        vec![
            series("UWB, ms", Tone::Estimate, Mark::Line, column(|h| h.uwb_age_s)),
            series("IMU, ms", Tone::Family(2), Mark::Line, column(|h| h.imu_age_s)),
            series("missed per s", Tone::Command, Mark::Dots, misses.collect()),
        ],
    );
    plot.least_height = 10.0;
    plot.render()
}

/// Losses over time, the most frequent reasons first.
fn losses(flight: &Flight, clock: &Clock) -> String {
    let mut lines: BTreeMap<&'static str, Vec<[f64; 2]>> = BTreeMap::new();
    for health in &flight.health {
        let mut sums: BTreeMap<&'static str, u64> = BTreeMap::new();
        for (reason, n) in health.drops.iter().flat_map(|(_, drops)| drops.iter()) {
            *sums.entry(reason.name()).or_default() += n;
        }
        for (reason, n) in sums {
            lines.entry(reason).or_default().push([clock.s(health.at), n as f64]);
        }
    }
    let last = |points: &[[f64; 2]]| points.last().map_or(0.0, |p| p[1]);
    let mut lines: Vec<_> = lines.into_iter().collect();
    lines.sort_by(|a, b| last(&b.1).total_cmp(&last(&a.1)));
    lines.truncate(3);
    let lines = lines.into_iter().enumerate();
    let lines = lines
        .map(|(i, (name, points))| {
            series(&name.replace('_', " "), Tone::Family(i as u8), Mark::Line, points)
        })
        .collect();
    let mut plot = clock.plot("Losses", "count since start", lines);
    plot.least_height = 10.0;
    plot.render()
}

/// Modes as a list for people who cannot see the shading.
pub fn mode_list(flight: &Flight) -> String {
    let Some((start, _)) = flight.ends() else { return String::new() };
    let mut rows = String::new();
    for record in &flight.modes {
        let _ = write!(
            rows,
            "<tr><td class=\"n\">{:.1}</td><td>{}</td><td>{}</td></tr>",
            record.at.seconds_since(start),
            escape(&record.mode),
            escape(&record.cause)
        );
    }
    rows
}
