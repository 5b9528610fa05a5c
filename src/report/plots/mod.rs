//! Which plots a flight gets, and in which order.

mod control;
mod motion;
mod ranging;
mod timeline;
mod timing;
mod vibration;

pub use motion::shapes;

use crate::report::flight::Flight;
use crate::report::svg::{Mark, Plot, Series, Span, Tone};
use haltere_core::frames::{E, Vec3};
use haltere_core::time::HostTime;

/// Drawing sizes, pixels: the page shows two plots a row.
const PLOT_PX: [f64; 2] = [540.0, 210.0];
const WIDE_PX: [f64; 2] = [1100.0, 236.0];

/// The section that not every board fills.
const OUTPUTS: &str = "Motors and servos";

/// A heading and its plots.
pub struct Section {
    /// Heading.
    pub title: &'static str,
    /// A sentence or two under it: what to look for.
    pub note: String,
    /// Finished SVG, in order.
    pub plots: Vec<String>,
}

/// Draws everything.
pub fn sections(flight: &Flight) -> Vec<Section> {
    let Some((first, end)) = flight.ends() else { return Vec::new() };
    let start = flight.started.unwrap_or(first);
    let since = |at: HostTime| at.seconds_since(start);
    let clock = Clock {
        start,
        span_s: [since(first).max(0.0), since(end)],
        modes: modes(flight, start, [first, end]),
        flown_s: flight
            .flown_modes()
            .filter(|(mode, ..)| mode.has_thrust())
            .map(|(_, from, to)| [since(from), since(to)])
            .reduce(|all, mode| [all[0].min(mode[0]), all[1].max(mode[1])]),
    };
    let section = |title, note: &str, plots| Section { title, note: note.to_owned(), plots };
    let all = vec![
        section(
            "Where it flew",
            "Truth, where there is any, is the simulator's or motion capture's: the companion never \
             sees it.",
            motion::place(flight, &clock),
        ),
        section(
            "Timeline",
            "Marks in the row of messages: what people were told; its words appear under the pointer \
             and stand at the end of the page.",
            vec![timeline::timeline(flight, &clock)],
        ),
        section("Velocity, and the error of the estimate", "", motion::velocity(flight, &clock)),
        section(
            "Attitude",
            "Setpoints as sent, the part of them that is drag feed-forward, and what came of them.",
            control::attitude(flight, &clock),
        ),
        section(
            "Thrust and battery",
            "Full throttle is 1. Base is what hovering takes at the present voltage; sent is base and \
             feedback together, times the factors of tilt and ground, within its limits. Corrections: what \
             each of these adds to the base at the nominal voltage.",
            control::thrust(flight, &clock),
        ),
        section(
            OUTPUTS,
            "What the board told each output, in its own numbers. A servo that has to stand off its middle in \
             steady flight holds something up: a trim, a bent rod, a wing that gives less.",
            control::outputs(flight, &clock),
        ),
        section(
            "Ranging",
            "Innovation is measured minus predicted. A pair whose mean stands off zero has a bias: an \
             anchor moved, or a reflection. Consistency is innovation squared over its variance: 1 is \
             right, more means the filter trusts too much.",
            ranging::plots(flight, &clock),
        ),
        Section {
            title: "Vibration",
            note: vibration::note(flight),
            plots: vibration::plots(flight),
        },
        Section {
            title: "Timing and losses",
            note: timing::note(flight),
            plots: timing::plots(flight, &clock),
        },
    ];
    // A board that does not tell its outputs has no section of them.
    all.into_iter().filter(|s| s.title != OUTPUTS || !s.plots.is_empty()).collect()
}

/// Time axis of a flight.
struct Clock {
    start: HostTime,
    /// First and last thing told, s since start.
    span_s: [f64; 2],
    modes: Vec<Span>,
    /// Begin and end of what was flown last, s since start: plots are scaled to it.
    flown_s: Option<[f64; 2]>,
}

impl Clock {
    fn s(&self, at: HostTime) -> f64 {
        at.seconds_since(self.start)
    }

    fn plot(&self, title: &str, y_label: &str, series: Vec<Series>) -> Plot {
        let [low, high] = self.span_s;
        Plot {
            title: title.to_string(),
            x_label: "time, s".to_string(),
            y_label: y_label.to_string(),
            series,
            spans: self.modes.clone(),
            size_px: PLOT_PX,
            x_range: Some([low, high.max(low + 1.0)]),
            scaled_to: self.flown_s,
            shared_time: true,
            ..Plot::default()
        }
    }
}

/// Modes as shaded spans.
fn modes(flight: &Flight, start: HostTime, [first, end]: [HostTime; 2]) -> Vec<Span> {
    let mut spans = Vec::new();
    for (i, record) in flight.modes.iter().enumerate() {
        let to = flight.modes.get(i + 1).map_or(end, |next| next.at);
        spans.push(Span {
            name: record.mode.to_string(),
            x: [record.at.max(first).seconds_since(start), to.seconds_since(start)],
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
