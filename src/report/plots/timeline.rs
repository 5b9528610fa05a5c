//! What was in force when: modes, arming, health of the estimate, limits touched, messages.

use super::Clock;
use crate::report::flight::Flight;
use crate::report::lanes::{self, Kind, Lane, Stretch};
use haltere_core::estimate::Health;
use haltere_core::topics::ControlRecord;

/// Height of a row, pixels.
const ROW_PX: f64 = 20.0;
/// Touches of a limit closer together than this are one, s: the eye does not part them.
const TOGETHER_S: f64 = 0.1;
/// MAVLink severities.
const SEVERITY_ERROR: u8 = 3;
const SEVERITY_WARNING: u8 = 4;

pub(super) fn timeline(flight: &Flight, clock: &Clock) -> String {
    let mut lanes = vec![modes(clock), armed(flight, clock), health(flight, clock)];
    let limits: [(&str, Touched); 3] = [
        ("velocity cut", |c| c.saturation.velocity),
        ("tilt cut", |c| c.saturation.tilt),
        ("thrust cut", |c| c.saturation.thrust_high || c.saturation.thrust_low),
    ];
    lanes.extend(limits.map(|(name, touched)| limit(flight, clock, name, touched)));
    lanes.push(messages(flight, clock));
    // A row of limits that were never touched says nothing.
    let always = ["mode", "messages"];
    lanes.retain(|lane| always.contains(&lane.name.as_str()) || !lane.stretches.is_empty());
    lanes::render("What was in force", &lanes, clock.span_s, ROW_PX)
}

fn modes(clock: &Clock) -> Lane {
    let kind = |mode: &str| match mode {
        "disarmed" | "arming" | "idle" | "disarming" => Kind::Quiet,
        "spool" | "takeoff" => Kind::Family(2),
        "land" | "return" => Kind::Family(3),
        "mission" => Kind::Family(4),
        "offboard" | "manual" => Kind::Family(1),
        "descend" => Kind::Bad,
        _ => Kind::Family(0),
    };
    let stretch = |span: &crate::report::svg::Span| Stretch {
        x: span.x,
        kind: kind(&span.name),
        strength: 0.55,
        name: span.name.clone(),
        hint: format!("{}: {:.1} to {:.1} s", span.name, span.x[0], span.x[1]),
    };
    Lane {
        name: "mode".into(),
        stretches: clock.modes.iter().map(stretch).collect(),
        marks: Vec::new(),
    }
}

fn armed(flight: &Flight, clock: &Clock) -> Lane {
    let mut lane = Lane { name: "armed".into(), ..Lane::default() };
    for (i, row) in flight.modes.iter().enumerate().filter(|(_, row)| row.armed) {
        let to_s = flight.modes.get(i + 1).map_or(clock.span_s[1], |next| clock.s(next.at));
        let from_s = clock.s(row.at).max(clock.span_s[0]);
        match lane.stretches.last_mut() {
            Some(last) if (last.x[1] - from_s).abs() < 1e-9 => last.x[1] = to_s,
            _ => lane.stretches.push(plain([from_s, to_s], Kind::Quiet, "board armed")),
        }
    }
    lane
}

fn health(flight: &Flight, clock: &Clock) -> Lane {
    let mut lane = Lane { name: "estimate".into(), ..Lane::default() };
    let mut before = None;
    for estimate in &flight.estimates {
        let at_s = clock.s(estimate.at);
        if let Some(last) = lane.stretches.last_mut() {
            last.x[1] = at_s;
        }
        if before != Some(estimate.health) {
            before = Some(estimate.health);
            let (kind, word) = match estimate.health {
                Health::NotAligned => (Kind::Quiet, "not aligned"),
                Health::Good => (Kind::Family(2), "good"),
                Health::Degraded => (Kind::Warn, "degraded"),
                Health::Lost => (Kind::Bad, "lost"),
            };
            let mut stretch = plain([at_s, at_s], kind, word);
            stretch.name = word.to_owned();
            lane.stretches.push(stretch);
        }
    }
    lane
}

/// Whether a control step touched a limit.
type Touched = fn(&ControlRecord) -> bool;

fn limit(flight: &Flight, clock: &Clock, name: &str, touched: Touched) -> Lane {
    let mut lane = Lane { name: name.into(), ..Lane::default() };
    for control in flight.controls.iter().filter(|c| touched(c)) {
        let at_s = clock.s(control.at);
        match lane.stretches.last_mut() {
            Some(last) if at_s - last.x[1] < TOGETHER_S => last.x[1] = at_s,
            _ => lane.stretches.push(plain([at_s, at_s], Kind::Warn, name)),
        }
    }
    lane
}

fn messages(flight: &Flight, clock: &Clock) -> Lane {
    let marks = flight.texts.iter().map(|text| {
        let kind = match text.severity {
            s if s <= SEVERITY_ERROR => Kind::Bad,
            s if s <= SEVERITY_WARNING => Kind::Warn,
            _ => Kind::Quiet,
        };
        let at_s = clock.s(text.at);
        (at_s, kind, format!("{at_s:.1} s: {}", text.text))
    });
    Lane { name: "messages".into(), stretches: Vec::new(), marks: marks.collect() }
}

fn plain(x: [f64; 2], kind: Kind, hint: &str) -> Stretch {
    Stretch { x, kind, strength: 0.55, name: String::new(), hint: hint.to_owned() }
}
