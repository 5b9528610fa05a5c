//! Effects at sensors, applied exactly to recorded flights: an anchor moved, a constant added, a line of sight cut, the IMU scaled, the
//! voltage off.
//!
//! Each flight is cut in its middle. The first half is the accepted flight; in the second the effect begins, at one, two and four
//! times the size from which on it is more probable than nothing. Places and directions are drawn by the hash of the case; the hash of
//! all keys is printed before anything is judged. `haltere gap` itself does not look at these sensors in a flight of others, so what
//! judges is the regression of `judge.rs`, which is told the places of motion capture and no more. Both halves are of one session:
//! scatter from session to session is not in these figures.

mod effects;
mod judge;
mod points;

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use crate::util_flights::file::{Flight, load_located};
use clap::Args;
use haltere::cli::{print, print_json};
use haltere_core::time::HostTime;
use haltere_gap::flight::seal::digest;
use haltere_log::import::{Recording, flapper};
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::Serialize;

use crate::lines_of_sight::Path;
use effects::{Effect, Kind};
use judge::{Found, Judge};
use points::Point;

/// Sizes, in those that are told just.
const TIMES: [f64; 3] = [1.0, 2.0, 4.0];
/// Share of the flight that a cut line of sight is cut in.
const CUT: f64 = 0.33;
/// Odds within which a rival is as probable.
const ALIKE: f64 = 3.162;

/// Scores the naming of effects at sensors that are applied to recorded flights.
#[derive(Debug, Args)]
pub struct Options {
    /// Flights of UTIL, or folders of them.
    #[arg(long, value_name = "DIR|FILE")]
    util: Vec<PathBuf>,
    /// Flights of the Flapper with command and voltage.
    #[arg(long, value_name = "FILE")]
    flapper: Vec<PathBuf>,
    /// Draws other places and directions.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Prints every case with its key as JSON.
    #[arg(long)]
    json: bool,
}

/// One case: its key, and what was said.
#[derive(Debug, Serialize)]
struct Case {
    /// Hash of what was done where.
    id: String,
    flight: String,
    /// Nothing in a flight as it was recorded.
    effect: Option<Effect>,
    /// Size, in those that are told just.
    times: f64,
    is_gap: bool,
    /// Kinds that are as probable as the best, best first.
    set: Vec<Kind>,
}

/// Recorded flights.
enum Recorded {
    Util(Box<Flight>),
    Flapper(Box<Recording>),
}

/// A recorded flight, cut.
struct Cut {
    name: String,
    recorded: Recorded,
    /// Where the second half begins, s on the clock of the points.
    middle_s: f64,
    points: Vec<Point>,
}

/// An effect at the size that is told just.
struct Draw<'a> {
    cut: &'a Cut,
    effect: Effect,
    id: String,
}

/// Reads, injects, judges, scores and prints.
pub fn run(options: &Options) -> anyhow::Result<ExitCode> {
    let mut recorded = Vec::new();
    for path in &options.util {
        recorded.extend(load_located(path)?.into_iter().map(|f| Recorded::Util(Box::new(f))));
    }
    for path in &options.flapper {
        recorded.push(Recorded::Flapper(Box::new(flapper::read(path)?)));
    }
    anyhow::ensure!(!recorded.is_empty(), "no flight: give --util or --flapper");
    let cuts: Vec<Cut> = recorded.into_par_iter().map(Cut::of).collect();
    let draws: Vec<Draw<'_>> = cuts.iter().flat_map(|cut| cut.draws(options.seed)).collect();
    let keys: Vec<&str> = draws.iter().map(|draw| draw.id.as_str()).collect();
    let seal = digest(keys.concat().as_bytes());
    let cases = cases(&cuts, &draws);
    match options.json {
        true => print_json(&cases)?,
        false => print(&format!("keys {seal}\n{}", table(&cases)))?,
    }
    Ok(ExitCode::SUCCESS)
}

fn cases(cuts: &[Cut], draws: &[Draw<'_>]) -> Vec<Case> {
    let untouched = cuts.par_iter().map(|cut| {
        let found = cut.judge().judge(&cut.late());
        case(String::new(), cut, None, 0.0, &found)
    });
    let all: Vec<(&Draw<'_>, f64)> =
        draws.iter().flat_map(|draw| TIMES.map(|times| (draw, times))).collect();
    let touched = all.par_iter().map(|(draw, times)| {
        let effect = draw.effect.times(*times);
        let found = draw.cut.judge().judge(&draw.cut.with(effect));
        case(draw.id.clone(), draw.cut, Some(effect), *times, &found)
    });
    untouched.chain(touched).collect()
}

fn case(id: String, cut: &Cut, effect: Option<Effect>, times: f64, found: &Found) -> Case {
    let best = found.kinds.first().map_or(0.0, |(_, evidence)| *evidence);
    let alike = found.kinds.iter().filter(|(_, evidence)| best - evidence < ALIKE.ln());
    let set = alike.map(|(kind, _)| *kind).collect();
    Case { id, flight: cut.name.clone(), effect, times, is_gap: found.is_gap, set }
}

impl Cut {
    fn of(recorded: Recorded) -> Self {
        let (name, points) = match &recorded {
            Recorded::Util(flight) => (flight.name.clone(), points::of_flight(flight)),
            Recorded::Flapper(flight) => (flight.name.clone(), points::of_recording(flight)),
        };
        let ends =
            |best: fn(f64, f64) -> f64, from: f64| points.iter().map(|p| p.at_s).fold(from, best);
        let middle_s = 0.5 * (ends(f64::min, f64::INFINITY) + ends(f64::max, f64::NEG_INFINITY));
        Self { name, recorded, middle_s, points }
    }

    fn half(&self, points: &[Point], is_late: bool) -> Vec<Point> {
        points.iter().filter(|p| (p.at_s >= self.middle_s) == is_late).copied().collect()
    }

    fn late(&self) -> Vec<Point> {
        self.half(&self.points, true)
    }

    fn judge(&self) -> Judge<'_> {
        let survey = match &self.recorded {
            Recorded::Util(flight) => Some(&flight.survey),
            Recorded::Flapper(_) => None,
        };
        Judge::new(&self.half(&self.points, false), survey)
    }

    /// The second half with an effect.
    fn with(&self, effect: Effect) -> Vec<Point> {
        let points = match &self.recorded {
            Recorded::Util(flight) => {
                let begin = flight.events.first().map_or(HostTime::from_us(0), |event| event.at);
                let path = Path::of(flight);
                let tag = |at: HostTime| path.tag_at(at.seconds_since(begin));
                let from = begin.offset_us((self.middle_s * 1e6) as i64);
                points::of_flight(&effect.into_flight(flight, from, tag))
            }
            Recorded::Flapper(flight) => {
                let begin_s = flight.rows.first().map_or(0.0, |row| row.t_s);
                points::of_recording(&effect.into_recording(flight, begin_s + self.middle_s))
            }
        };
        self.half(&points, true)
    }

    /// Every kind at every anchor once, as the hash of the case draws it.
    fn draws(&self, seed: u64) -> Vec<Draw<'_>> {
        let (judge, late) = (self.judge(), self.late());
        let kinds = judge.kinds(&late).into_iter().filter(|kind| *kind != Kind::Thrust);
        // A voltage is told too high or too low.
        let kinds = kinds.flat_map(|kind| vec![kind; if kind == Kind::Voltage { 2 } else { 1 }]);
        let draw = |(number, kind): (usize, Kind)| {
            let id = digest(format!("{seed} {} {number} {kind:?}", self.name).as_bytes());
            let chance = |k: usize| {
                let digits =
                    id.get(8 * k..8 * k + 8).and_then(|hex| u32::from_str_radix(hex, 16).ok());
                f64::from(digits.unwrap_or(0)) / f64::from(u32::MAX)
            };
            let angle = 2.0 * std::f64::consts::PI * chance(0);
            let sign = if chance(1) < 0.5 { -1.0 } else { 1.0 };
            let one = Vector3::new(1.0, 0.0, 0.0);
            let smallest = |columns: &[Vector3<f64>], of: Vector3<f64>| {
                judge.smallest(kind, &late, columns, of)
            };
            let plain = || smallest(&judge.columns(kind, &late, None), one);
            let effect = match kind {
                Kind::Moved(anchor) => {
                    let up = 2.0 * chance(2) - 1.0;
                    let level = (1.0 - up * up).sqrt();
                    let way = Vector3::new(level * angle.cos(), level * angle.sin(), up);
                    let size = smallest(&judge.columns(kind, &late, None), way);
                    Effect::Moved { anchor, by_E_m: (way * size).into() }
                }
                Kind::Constant(anchor) => Effect::Constant { anchor, by_m: sign * plain() },
                Kind::Cut(anchor) => {
                    let along_E = [angle.cos(), angle.sin()];
                    let from_m = judge::beyond(&late, along_E, CUT);
                    let columns = judge.columns(kind, &late, Some((along_E, from_m)));
                    Effect::Cut { anchor, by_m: smallest(&columns, one), along_E, from_m }
                }
                Kind::Acceleration => Effect::Acceleration { share: sign * plain() },
                Kind::Rate => Effect::Rate { share: sign * plain() },
                _ => Effect::Voltage { by_v: if number % 2 == 0 { plain() } else { -plain() } },
            };
            Draw { cut: self, effect, id }
        };
        kinds.enumerate().map(draw).collect()
    }
}

fn table(cases: &[Case]) -> String {
    let mut out = String::from(
        "| effect | times | cases | called a gap | named first | of a set | wrong anchor or kind |\n|---|---|---|---|---|---|---|\n",
    );
    let untouched: Vec<&Case> = cases.iter().filter(|case| case.effect.is_none()).collect();
    let called = untouched.iter().filter(|case| case.is_gap).count();
    let _ = writeln!(out, "| none | | {} | {called} | | | |", untouched.len());
    let mut names: Vec<&str> = cases.iter().filter_map(|c| Some(c.effect?.kind().name())).collect();
    names.sort_unstable();
    names.dedup();
    names.push("all");
    for name in names {
        for times in TIMES {
            let is_of = |case: &&Case| {
                let kind = case.effect.map(Effect::kind);
                case.times == times && kind.is_some_and(|kind| name == "all" || kind.name() == name)
            };
            let of: Vec<&Case> = cases.iter().filter(is_of).collect();
            let count = |is: &dyn Fn(&Case, Kind) -> bool| {
                of.iter().filter(|case| case.effect.is_some_and(|e| is(case, e.kind()))).count()
            };
            let gaps = count(&|case, _| case.is_gap);
            let first = count(&|case, kind| case.is_gap && case.set.first() == Some(&kind));
            let within = count(&|case, kind| case.is_gap && case.set.contains(&kind));
            let n = of.len();
            let share = |k: usize| k as f64 / n.max(1) as f64;
            let _ = writeln!(
                out,
                "| {name} | {times} | {n} | {:.2} | {:.2} | {:.2} | {:.2} |",
                share(gaps),
                share(first),
                share(within),
                share(gaps - within),
            );
        }
    }
    out
}

/// What today's figures are not to fall below; `ignored` without the recordings.
#[test]
fn val_effects_at_sensors_are_named_on_recorded_flights() {
    let Some(folder) = crate::recordings::util() else {
        println!("not checked: no data");
        return;
    };
    // One flight: all take minutes.
    let path = folder.join("full/apr26-traj02-tdoa2.csv.gz");
    let flights = load_located(&path).unwrap();
    let cuts: Vec<Cut> =
        flights.into_iter().map(|f| Cut::of(Recorded::Util(Box::new(f)))).collect();
    let draws: Vec<Draw<'_>> = cuts.iter().flat_map(|cut| cut.draws(1)).collect();
    let cases = cases(&cuts, &draws);
    print!("{}", table(&cases));
    let of = |times: f64| cases.iter().filter(move |case| case.times == times);
    let first = of(4.0).filter(|c| c.set.first() == c.effect.map(Effect::kind).as_ref()).count();
    assert!(first as f64 > 0.5 * of(4.0).count() as f64, "{first}");
}
