//! What became of the vehicle, by the truth, and of the programs.

use anyhow::{Result, bail};
use haltere::report::truth::TruthRow;
use serde::Serialize;

use super::kind::{Kind, Trial};

/// Farther sideways than this is no descent over the place any more, m: the walls are 3.5 m away.
const MOST_DRIFT_M: f64 = 2.0;
/// Higher above its place on the floor it has lifted off, m.
const LIFTED_M: f64 = 0.15;
/// Standing for so long is a landing, s: not the touch of a gear that swings back.
const STANDS_S: f64 = 0.3;
/// The hall, m: north and east from 0, and its height.
const HALL_M: [f64; 3] = [10.0, 10.0, 7.0];
/// Higher than where it was to fly and at its highest before the fault, m: nobody asked for that.
const ABOVE_M: f64 = 0.6;

/// What the rig saw of the programs.
#[derive(Debug, Default)]
pub struct Seen {
    pub struck_us: u64,
    /// The truth after this is of no interest any more.
    pub until_us: Option<u64>,
    /// The companion was there after a fault that must not end it.
    pub flies_on: bool,
    pub lands_when_asked: bool,
    /// It ended in time, and well where nobody was in a hurry.
    pub ends_when_asked: bool,
    pub ended_us: Option<u64>,
    /// It said that it was asked to end.
    pub told: bool,
    /// A client's order kept it in the air.
    pub held_back: bool,
    pub arms_again: bool,
    pub recaptured: usize,
}

/// What came of it.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    pub trial: Trial,
    /// Where it was when it was struck: height, m, and speed, m/s.
    pub height_m: f64,
    pub speed_mps: f64,
    /// On the floor at the end.
    pub landed: bool,
    /// Largest way sideways after the fault, m.
    pub drift_m: f64,
    /// Largest height above that at which it was struck, m.
    pub above_m: f64,
    /// Speed at which it met the floor, m/s; 0 when it stood there.
    pub impact_mps: f64,
    /// The plant calls it a crash: it met the floor at more than 2 m/s, or something else at all.
    pub hard: bool,
    /// Times that it lifted off, from the beginning of the flight.
    pub lift_offs: usize,
    /// Inside of the hall all the time.
    pub inside: bool,
    /// Setpoints with thrust that the second companion sent before it was asked to arm.
    pub recaptured: usize,
    /// It armed again when it was asked to.
    pub arms_again: bool,
    /// What the programs did that they should not.
    pub wrong: Vec<&'static str>,
}

impl Outcome {
    pub fn ok(&self) -> bool {
        self.landed && self.wrong.is_empty()
    }
}

fn speed_mps(row: &TruthRow) -> f64 {
    let v = row.vel_E_mps;
    v.x().hypot(v.y()).hypot(v.z())
}

fn is_inside(row: &TruthRow) -> bool {
    let p = row.pos_E_m;
    [p.x(), p.y(), -p.z()].into_iter().zip(HALL_M).all(|(x, most)| (0.0..=most).contains(&x))
}

/// From the floor, after it stood there: how often it rose.
fn lift_offs(rows: &[TruthRow]) -> usize {
    let Some(floor_m) = rows.first().map(|row| -row.pos_E_m.z()) else { return 0 };
    let (mut count, mut stands, mut since_s) = (0, true, 0.0);
    for row in rows {
        if !row.on_ground {
            since_s = row.t_s;
            if stands && -row.pos_E_m.z() > floor_m + LIFTED_M {
                (count, stands) = (count + 1, false);
            }
        } else if row.t_s - since_s > STANDS_S {
            stands = true;
        }
    }
    count
}

pub fn judge(trial: &Trial, rows: &[TruthRow], seen: &Seen) -> Result<Outcome> {
    let until_us = seen.until_us.unwrap_or(u64::MAX);
    let of_fall = |row: &&TruthRow| (seen.struck_us..until_us).contains(&row.at.as_us());
    let after: Vec<&TruthRow> = rows.iter().filter(of_fall).collect();
    let (Some(first), Some(last)) = (after.first(), after.last()) else {
        bail!("the truth file does not cover the time after the fault");
    };
    let sideways = |row: &TruthRow| {
        let (a, b) = (first.pos_E_m, row.pos_E_m);
        (b.x() - a.x()).hypot(b.y() - a.y())
    };
    let impacts = after.windows(2).filter(|w| !w[0].on_ground && w[1].on_ground);
    let highest = after.iter().map(|row| -row.pos_E_m.z()).fold(f64::NEG_INFINITY, f64::max);
    let whole: Vec<TruthRow> =
        rows.iter().filter(|row| row.at.as_us() < until_us).copied().collect();
    let mut outcome = Outcome {
        trial: *trial,
        height_m: -first.pos_E_m.z(),
        speed_mps: speed_mps(first),
        landed: last.on_ground && speed_mps(last) < 0.05,
        drift_m: after.iter().map(|row| sideways(row)).fold(0.0, f64::max),
        above_m: highest + first.pos_E_m.z(),
        impact_mps: impacts.map(|w| speed_mps(w[0])).fold(0.0, f64::max),
        hard: after.iter().any(|row| row.crashed),
        lift_offs: lift_offs(&whole),
        inside: after.iter().all(|row| is_inside(row)),
        recaptured: seen.recaptured,
        arms_again: seen.arms_again,
        wrong: Vec::new(),
    };
    outcome.wrong = wrong(&outcome, seen, first, rows);
    Ok(outcome)
}

fn wrong(
    outcome: &Outcome,
    seen: &Seen,
    struck: &TruthRow,
    rows: &[TruthRow],
) -> Vec<&'static str> {
    let kind = outcome.trial.kind;
    let highest_m = outcome.trial.height_m.max(outcome.height_m) + ABOVE_M;
    // In the climb of a flight that goes on it goes on as well.
    let too_high = -struck.pos_E_m.z() + outcome.above_m > highest_m;
    let in_air_at_end = seen.ended_us.is_some_and(|ended_us| {
        let row = rows.iter().take_while(|row| row.at.as_us() <= ended_us).last();
        row.is_some_and(|row| !row.on_ground)
    });
    let table: [(bool, &'static str); 11] = [
        (outcome.lift_offs > 1, "lifted off again"),
        (!outcome.inside, "left the hall"),
        (too_high, "climbed unasked"),
        (outcome.drift_m > MOST_DRIFT_M, "went sideways"),
        (outcome.hard && !kind.leaves_board_alone(), "came down hard"),
        (kind == Kind::Killed && outcome.recaptured > 0, "captured again unasked"),
        // A wreck need not arm again.
        (kind == Kind::Killed && !outcome.arms_again && !outcome.hard, "did not arm again"),
        (kind != Kind::Killed && !seen.flies_on, "the companion ended by itself"),
        (kind != Kind::Killed && !seen.ends_when_asked, "did not end when asked"),
        (matches!(kind, Kind::Interrupt | Kind::Terminate) && !seen.told, "did not say so"),
        (in_air_at_end || seen.held_back, "ended in the air, or was held there"),
    ];
    let mut found: Vec<_> = table.into_iter().filter(|(is, _)| *is).map(|(_, what)| what).collect();
    let follows = kind != Kind::Killed && !kind.ends();
    if follows && outcome.height_m > LIFTED_M && !outcome.landed && !seen.lands_when_asked {
        found.push("did not land when asked");
    }
    found
}

#[cfg(test)]
mod tests {
    use haltere_core::frames::{Rot, Vec3};
    use haltere_core::time::HostTime;

    use super::*;
    use crate::kills::kind::Phase;

    fn row(t_s: f64, height_m: f64) -> TruthRow {
        TruthRow {
            at: HostTime::from_us((t_s * 1e6) as u64),
            t_s,
            pos_E_m: Vec3::new(5.0, 5.0, -height_m),
            vel_E_mps: Vec3::new(0.0, 0.0, 0.0),
            R_EB: Rot::from_euler_rad(0.0, 0.0, 0.0),
            rate_B_radps: Vec3::new(0.0, 0.0, 0.0),
            flap_hz: [0.0; 2],
            supply_v: 8.0,
            charge_frac: 1.0,
            thrust_n: 0.0,
            on_ground: height_m <= 0.12,
            crashed: false,
        }
    }

    /// Heights above the floor at 0.1 s steps.
    fn flown(heights_m: &[f64]) -> Vec<TruthRow> {
        heights_m.iter().enumerate().map(|(n, h)| row(n as f64 * 0.1, 0.12 + h)).collect()
    }

    #[test]
    fn prop_a_second_lift_off_is_seen_and_a_bounce_is_none() {
        let stands = [0.0; 6];
        let up = [0.3, 1.0, 1.0, 0.3];
        let once = [&stands[..], &up, &stands].concat();
        assert_eq!(lift_offs(&flown(&once)), 1);
        let bounce = [&stands[..], &up, &[0.0], &[0.2], &stands].concat();
        assert_eq!(lift_offs(&flown(&bounce)), 1);
        let twice = [&once[..], &up, &stands].concat();
        assert_eq!(lift_offs(&flown(&twice)), 2);
    }

    #[test]
    fn prop_what_is_wrong_is_named() {
        let trial = Trial {
            n: 0,
            kind: Kind::HangUp,
            phase: Phase::Hover,
            height_m: 1.0,
            at_s: 0.5,
            lasts_s: 0.0,
        };
        let good = Seen {
            struck_us: 800_000,
            flies_on: true,
            lands_when_asked: true,
            ends_when_asked: true,
            ..Seen::default()
        };
        let flight = flown(&[&[0.0; 6][..], &[0.5, 1.0, 1.0, 1.0, 0.5], &[0.0; 6]].concat());
        assert_eq!(judge(&trial, &flight, &good).unwrap().wrong, [""; 0]);
        let dead = Seen { flies_on: false, struck_us: 800_000, ..Seen::default() };
        let outcome = judge(&trial, &flight, &dead).unwrap();
        assert_eq!(outcome.wrong, ["the companion ended by itself", "did not end when asked"]);
        let leap = flown(&[&[0.0; 6][..], &[0.5, 1.0, 1.0, 3.0, 0.5], &[0.0; 6]].concat());
        assert_eq!(judge(&trial, &leap, &good).unwrap().wrong, ["climbed unasked"]);
    }
}
