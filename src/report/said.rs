//! How a flight ended and how well it was flown, in a sentence: the head of its page.

use haltere_core::estimate::Health;
use haltere_core::time::HostTime;
use haltere_pilot::{Event, Mode, TABLE};

use super::flight::{Flight, ModeRow};

/// A sentence, and whether it tells of something that went wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Said {
    /// It crashed, or a reaction ended it.
    pub bad: bool,
    /// The words.
    pub words: String,
}

/// What is to be said of what was flown last.
pub fn said(flight: &Flight) -> Said {
    let rows = flight.last_flown();
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
        return Said { bad: false, words: "Nothing was flown.".to_owned() };
    };
    let start = flight.started.or(flight.ends().map(|ends| ends.0)).unwrap_or_default();
    let seconds = |at: HostTime| at.seconds_since(start);
    let crash = flight.truth.iter().find(|row| row.crashed && row.at >= first.at);
    let reaction = ended_by(rows);
    let how = match (crash, reaction) {
        (Some(row), _) => format!("crashed at {:.1} s", seconds(row.at)),
        (None, Some(row)) => {
            format!("ended at {:.1} s: {} ({})", seconds(row.at), row.cause, row.mode)
        }
        (None, None) if last.mode == Mode::Disarmed.name() => "landed".to_owned(),
        (None, None) => "in the air".to_owned(),
    };
    let off = last.mode == Mode::Disarmed.name();
    let cut = (!off).then(|| format!("the log ends in mode {}", last.mode));
    let parts = [Some(how), cut, items(flight, first, last), accuracy(flight, &seconds)];
    let mut words = parts.into_iter().flatten().collect::<Vec<_>>().join(", ") + ".";
    if let Some(first) = words.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    Said { bad: crash.is_some() || reaction.is_some(), words }
}

/// The change of mode after which nobody flew on as asked.
fn ended_by(rows: &[ModeRow]) -> Option<&ModeRow> {
    let mut ended = None;
    let mut before = Mode::Disarmed;
    for row in rows {
        let Some(mode) = Mode::from_name(&row.mode) else { continue };
        let off = matches!(mode, Mode::Disarming | Mode::Disarmed);
        let cut = off && before.is_flying() && before != Mode::Land;
        if cut || !is_as_asked(&row.cause) {
            ended.get_or_insert(row);
        } else if mode.is_flying() && !matches!(mode, Mode::Return | Mode::Land) {
            ended = None;
        }
        before = mode;
    }
    ended
}

/// Whether a mode changed for what somebody asked, or what comes next of it: for no condition of the supervisor, and
/// for nothing that failed.
fn is_as_asked(cause: &str) -> bool {
    let failed = |event| {
        use Event::*;
        matches!(
            event,
            Ordered(_)
                | ArmFailed
                | NotLifted
                | NoWayHome
                | FloorCarries
                | SetpointsIgnored
                | LandingOverdue
        )
    };
    TABLE.iter().any(|row| row.because == cause && !failed(row.on))
}

/// How much of the mission was flown, where one was.
fn items(flight: &Flight, first: &ModeRow, last: &ModeRow) -> Option<String> {
    flight.flown_modes().find(|(mode, ..)| *mode == Mode::Mission)?;
    let of = flight.mission_items.iter().rfind(|(at, _)| *at <= last.at)?.1;
    let reached = flight.reached.iter().filter(|(at, _)| *at >= first.at && *at <= last.at);
    let reached: std::collections::BTreeSet<u16> = reached.map(|(_, seq)| *seq).collect();
    Some(format!("{} of {of} items", reached.len()))
}

/// Distances in the air: estimate to truth, and to the setpoint of truth or, without one, of the estimate.
fn accuracy(flight: &Flight, seconds: &dyn Fn(HostTime) -> f64) -> Option<String> {
    let flown: Vec<_> = flight.flown_modes().filter(|(mode, ..)| mode.is_flying()).collect();
    let mode_at = |at: HostTime| flown.iter().find(|(_, from, to)| at >= *from && at < *to);
    let (mut estimate, mut track) = (Distance::default(), Distance::default());
    let mut is_true = false;
    // Where the place that was asked for jumped: nothing flies there at once.
    let (mut asked, mut jumped_at, mut is_step) = (None, None, false);
    let mut controls = flight.controls.iter().peekable();
    for e in flight.estimates.iter().filter(|e| e.health != Health::NotAligned) {
        let Some((mode, ..)) = mode_at(e.at) else { continue };
        let truth = flight.truth_at(e.at).map(|(pos_E_m, _)| pos_E_m);
        is_true |= truth.is_some();
        if let Some(truth_E_m) = truth {
            estimate.add((e.pos_E_m - truth_E_m).norm(), e.at);
        }
        while controls.next_if(|c| c.at < e.at).is_some() {}
        let Some(control) = controls.peek().filter(|_| *mode != Mode::Land) else { continue };
        let at_E_m = truth.unwrap_or(e.pos_E_m);
        let off = control.pos_setpoint_E_m.iter().zip(at_E_m.to_array());
        let squares = off.map(|(wanted, at)| wanted.map_or(0.0, |wanted| (wanted - at).powi(2)));
        if let Some(places) = asked.replace(control.pos_setpoint_E_m)
            && jump_m(places, control.pos_setpoint_E_m) > STEP_M
        {
            jumped_at = Some(e.at);
        }
        if track.add(squares.sum::<f64>().sqrt(), e.at) {
            is_step = jumped_at.is_some_and(|at: HostTime| e.at.seconds_since(at) < STEP_S);
        }
    }
    let by = if is_true { "" } else { " by its own estimate" };
    let step = if is_step { ", where a step was commanded" } else { "" };
    let parts = [("estimate", "", "", &estimate), ("track", by, step, &track)];
    let told = parts.into_iter().filter(|(.., d)| d.count > 0).map(|(what, by, step, d)| {
        let (worst_m, worst_s) = (d.worst_m, seconds(d.worst_at));
        let worst = format!("(worst {worst_m:.2} m at {worst_s:.0} s{step})");
        format!("{what} off by {:.2} m{by} {worst}", d.mean())
    });
    let words = told.collect::<Vec<_>>().join(", ");
    (!words.is_empty()).then_some(words)
}

/// A step is commanded where the place that is asked for moves by more than this from one setpoint to the next, and whoever
/// flies is far from it for so long (judgement: steps of the demo are 1 and 2 m, paths move it by centimetres).
const STEP_M: f64 = 0.5;
const STEP_S: f64 = 1.0;

/// How far a setpoint moved.
fn jump_m(before: [Option<f64>; 3], after: [Option<f64>; 3]) -> f64 {
    let moved =
        before.iter().zip(after).map(|(a, b)| a.zip(b).map_or(0.0, |(a, b)| (b - a).powi(2)));
    moved.sum::<f64>().sqrt()
}

#[derive(Default)]
struct Distance {
    sum_m: f64,
    count: u32,
    worst_m: f64,
    worst_at: HostTime,
}

impl Distance {
    /// Takes one; whether it is the worst so far.
    fn add(&mut self, off_m: f64, at: HostTime) -> bool {
        (self.sum_m, self.count) = (self.sum_m + off_m, self.count + 1);
        let is_worst = off_m > self.worst_m;
        if is_worst {
            (self.worst_m, self.worst_at) = (off_m, at);
        }
        is_worst
    }

    fn mean(&self) -> f64 {
        self.sum_m / f64::from(self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::estimate::Estimate;
    use haltere_core::frames::{Rot, Vec3};
    use haltere_core::topics::ControlRecord;

    fn at(s: u64) -> HostTime {
        HostTime::from_us(1_000_000 * s)
    }

    /// Changes of mode one second apart, on which the log ends.
    fn flown(modes: &[(&str, &str)]) -> Flight {
        let rows = modes.iter().zip(0..).map(|((mode, cause), s)| ModeRow {
            at: at(s),
            mode: (*mode).to_owned(),
            armed: true,
            cause: (*cause).to_owned(),
        });
        let modes: Vec<ModeRow> = rows.collect();
        let end = ControlRecord { at: at(modes.len() as u64), ..ControlRecord::default() };
        let begin = ControlRecord { at: at(0), ..ControlRecord::default() };
        Flight { modes, controls: vec![begin, end], ..Flight::default() }
    }

    const UP: [(&str, &str); 4] = [
        ("arming", "arming asked"),
        ("spool", "take-off"),
        ("takeoff", "thrust is up"),
        ("mission", "take-off height reached"),
    ];
    const DOWN: [(&str, &str); 2] = [("disarming", "on the floor"), ("disarmed", "board disarmed")];

    #[test]
    fn prop_the_head_says_how_it_ended() {
        let of = |middle: &[(&str, &str)], end: &[(&str, &str)]| {
            let mut flight = flown(&[&UP, middle, end].concat());
            flight.mission_items = vec![(at(0), 8)];
            flight.reached = vec![(at(4), 0), (at(4), 1), (at(4), 1)];
            let said = said(&flight);
            (said.bad, said.words)
        };
        let land = ("land", "the mission lands");
        assert_eq!(of(&[land], &DOWN), (false, "Landed, 2 of 8 items.".into()));
        let battery = ("return", "battery low");
        let (bad, words) = of(&[battery, ("land", "over home")], &DOWN);
        assert_eq!((bad, &*words), (true, "Ended at 4.0 s: battery low (return), 2 of 8 items."));
        // A pause that somebody ended by flying on is no end.
        let (bad, _) = of(&[("hold", "UWB is silent"), ("mission", "mission asked"), land], &DOWN);
        assert!(!bad);
        assert!(of(&[("hold", "UWB is silent"), ("land", "landing asked")], &DOWN).0);
        // Motors off in the air, whoever wanted it.
        assert!(of(&[("disarming", "disarming asked")], &DOWN[1..]).0);
        assert!(of(&[], &DOWN[1..]).0);
        assert!(of(&[], &[]).1.starts_with("In the air, the log ends in mode mission"));
        assert_eq!(said(&flown(&[DOWN[1]])).words, "Nothing was flown.");
    }

    #[test]
    fn prop_far_from_where_a_step_was_commanded_is_told_so() {
        let told = |jump_m: f64| {
            let mut flight = flown(&[&UP[..], &[("land", "the mission lands")]].concat());
            let end = flight.controls.pop();
            for k in 0..10_u64 {
                let at = HostTime::from_us(3_000_000 + 100_000 * k);
                let there_m = if k < 5 { 0.0 } else { jump_m };
                let pos_setpoint_E_m = [Some(there_m), Some(0.0), Some(0.0)];
                let control = ControlRecord { at, pos_setpoint_E_m, ..ControlRecord::default() };
                flight.controls.push(control);
                flight.estimates.push(Estimate {
                    at,
                    pos_E_m: Vec3::new(0.2, 0.0, 0.0),
                    vel_B_mps: Vec3::zero(),
                    R_EB: Rot::identity(),
                    rate_B_radps: Vec3::zero(),
                    std_pos_E_m: Vec3::zero(),
                    std_vel_B_mps: Vec3::zero(),
                    std_att_B_rad: Vec3::zero(),
                    uwb_noise_factor: 1.0,
                    health: Health::Good,
                });
            }
            flight.controls.extend(end);
            said(&flight).words
        };
        let step = told(2.0);
        assert!(step.contains("(worst 1.80 m at 4 s, where a step was commanded)"), "{step}");
        let path = told(0.3);
        assert!(path.contains("(worst 0.20 m at 3 s)"), "{path}");
    }

    #[test]
    fn prop_every_cause_of_the_table_is_as_asked_or_a_failure() {
        let failed: Vec<&str> =
            TABLE.iter().map(|row| row.because).filter(|because| !is_as_asked(because)).collect();
        assert_eq!(
            failed.iter().filter(|cause| **cause != "by the supervisor").count(),
            6,
            "{failed:?}"
        );
        assert!(!is_as_asked("any condition of the supervisor"));
    }
}
