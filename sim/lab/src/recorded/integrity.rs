//! Whether health says so before the estimate is wrong: recorded flights with a fault from their middle on.

use std::fmt::{self, Write};

use crate::util_flights::file::{Flight, Sample};
use crate::util_flights::run_traced;
use haltere_core::estimate::Health;
use haltere_core::estimator::EstimatorConfig;
use haltere_core::frames::{E, Vec3};
use haltere_core::measure::Tdoa;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;

/// An estimate is wrong beyond this, m …
const WRONG_M: f64 = 1.0;
/// … for longer than this, s.
const WRONG_FOR_S: f64 = 0.2;
/// A warning that ended longer ago does not count, s.
const STILL_WARNED_S: f64 = 2.0;
/// Below this nobody needs a warning, m.
const FINE_M: f64 = 0.5;
/// What is above this flies, m.
const AIRBORNE_M: f64 = 0.5;

/// What is done to the recording from its middle on.
#[derive(Debug, Clone, Copy)]
enum Fault {
    None,
    /// These anchors fall silent.
    Silent(&'static [u8]),
    /// An anchor is moved so far to the north, m.
    Moved(u8, f64),
    /// These anchors read so much too far, m, as behind metal or by a reflection.
    Far(&'static [u8], f64),
    /// The same from the first measurement on.
    AlwaysFar(&'static [u8], f64),
    /// All UWB comes so late, s, and is stamped so.
    Late(f64),
    /// Nothing comes for so long, s.
    Gap(f64),
}

const FAULTS: [(&str, Fault); 18] = [
    ("none", Fault::None),
    ("anchor 2 silent", Fault::Silent(&[2])),
    ("anchors 0, 3 and 5 silent", Fault::Silent(&[0, 3, 5])),
    ("anchors 0, 2, 3, 5 and 6 silent", Fault::Silent(&[0, 2, 3, 5, 6])),
    ("anchor 0 moved by 1 m", Fault::Moved(0, 1.0)),
    ("anchor 0 moved by 2 m", Fault::Moved(0, 2.0)),
    ("anchor 0 moved by 3 m", Fault::Moved(0, 3.0)),
    ("anchor 6 moved by 1 m", Fault::Moved(6, 1.0)),
    ("anchor 6 moved by 3 m", Fault::Moved(6, 3.0)),
    ("anchors 1 and 4 read 1 m too far", Fault::Far(&[1, 4], 1.0)),
    ("anchors 2 and 3 read 1 m too far", Fault::Far(&[2, 3], 1.0)),
    ("anchor 6 reads 0.6 m too far throughout", Fault::AlwaysFar(&[6], 0.6)),
    ("anchors 2 and 3 read 0.6 m too far throughout", Fault::AlwaysFar(&[2, 3], 0.6)),
    ("UWB late by 0.1 s", Fault::Late(0.1)),
    ("UWB late by 0.3 s", Fault::Late(0.3)),
    ("UWB late by 0.6 s", Fault::Late(0.6)),
    ("no UWB for 2 s", Fault::Gap(2.0)),
    ("no UWB for 10 s", Fault::Gap(10.0)),
];

/// How the flights of one kind went with one fault.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Integrity {
    /// What was done.
    pub fault: &'static str,
    /// Flights.
    pub flights: usize,
    /// Those that became wrong with a warning before.
    pub warned: usize,
    /// Those that became wrong without.
    pub unwarned: usize,
    /// Those that were warned of and did not become wrong.
    pub in_vain: usize,
    /// Share of the time below 0.5 m of error in which a warning stood.
    pub vain_share: f64,
    /// Longest time over 1 m in which health was good, s.
    pub silent_s: f64,
    /// Largest error, m.
    pub worst_m: f64,
}

/// Flies all of them. `tell` is told how far it is: done, of how many, what.
pub fn integrity(
    flights: &[Flight],
    flown: &EstimatorConfig,
    mut tell: impl FnMut(usize, usize, &str),
) -> Vec<Integrity> {
    let mut out = Vec::new();
    for (done, (name, fault)) in FAULTS.iter().enumerate() {
        tell(done, FAULTS.len(), name);
        let seen: Vec<Seen> = std::thread::scope(|scope| {
            let running: Vec<_> = flights
                .iter()
                .map(|flight| scope.spawn(move || fly(flight, flown, *fault)))
                .collect();
            running.into_iter().filter_map(|r| r.join().ok()).collect()
        });
        let fine_s: f64 = seen.iter().map(|s| s.fine_s).sum();
        let vain_s: f64 = seen.iter().map(|s| s.vain_s).sum();
        out.push(Integrity {
            fault: name,
            flights: seen.len(),
            warned: seen.iter().filter(|s| s.wrong == Some(true)).count(),
            unwarned: seen.iter().filter(|s| s.wrong == Some(false)).count(),
            in_vain: seen.iter().filter(|s| s.wrong.is_none() && s.warned_at.is_some()).count(),
            vain_share: if fine_s > 0.0 { vain_s / fine_s } else { 0.0 },
            silent_s: seen.iter().map(|s| s.longest_s).fold(0.0, f64::max),
            worst_m: seen.iter().map(|s| s.worst_m).fold(0.0, f64::max),
        });
    }
    out
}

/// What was seen of one flight from its middle on, in the air.
#[derive(Debug, Default)]
struct Seen {
    /// Whether it became wrong, and whether a warning came before.
    wrong: Option<bool>,
    warned_at: Option<HostTime>,
    fine_s: f64,
    vain_s: f64,
    silent_s: f64,
    longest_s: f64,
    worst_m: f64,
}

fn fly(flight: &Flight, flown: &EstimatorConfig, fault: Fault) -> Seen {
    let middle = middle(flight);
    let broken = with(flight, fault, middle);
    let mut seen = Seen::default();
    let mut last: Option<HostTime> = None;
    let mut wrong_s = 0.0;
    run_traced(&broken, flown, |at, estimate, pose| {
        let flies = -pose.pos_E_m.z() > AIRBORNE_M;
        if at < middle || !flies {
            return;
        }
        let dt_s = last.map_or(0.0, |t| at.seconds_since(t)).min(0.1);
        last = Some(at);
        let error_m = (estimate.pos_E_m - pose.pos_E_m).norm();
        let warns = estimate.health != Health::Good;
        if warns {
            seen.warned_at = Some(at);
        }
        seen.worst_m = seen.worst_m.max(error_m);
        if error_m < FINE_M {
            seen.fine_s += dt_s;
            seen.vain_s += if warns { dt_s } else { 0.0 };
        }
        seen.silent_s = if error_m > WRONG_M && !warns { seen.silent_s + dt_s } else { 0.0 };
        seen.longest_s = seen.longest_s.max(seen.silent_s);
        wrong_s = if error_m > WRONG_M { wrong_s + dt_s } else { 0.0 };
        if wrong_s > WRONG_FOR_S && seen.wrong.is_none() {
            seen.wrong = Some(seen.warned_at.is_some_and(|t| at.seconds_since(t) < STILL_WARNED_S));
        }
    });
    seen
}

fn middle(flight: &Flight) -> HostTime {
    let ends = [flight.events.first(), flight.events.last()].map(|e| e.map(|e| e.at));
    match ends {
        [Some(first), Some(last)] => first.offset_us((last.seconds_since(first) * 0.5e6) as i64),
        _ => HostTime::default(),
    }
}

/// The recording with a fault in it.
fn with(flight: &Flight, fault: Fault, from: HostTime) -> Flight {
    let mut out = flight.clone();
    let mut at_E_m = Vec3::<E>::zero();
    for event in &mut out.events {
        if let Sample::Pose(pose) = &event.sample {
            at_E_m = pose.pos_E_m;
        }
        if event.at < from && !matches!(fault, Fault::AlwaysFar(..)) {
            continue;
        }
        let Sample::Tdoa(tdoa) = &mut event.sample else { continue };
        match fault {
            Fault::Far(ids, by_m) | Fault::AlwaysFar(ids, by_m) => {
                let more = |id: u8| if ids.contains(&id) { by_m } else { 0.0 };
                tdoa.distance_diff_m += more(tdoa.anchor_b.0) - more(tdoa.anchor_a.0);
            }
            Fault::Moved(id, by_m) => {
                tdoa.distance_diff_m += moved(tdoa, &flight.survey, at_E_m, id, by_m)
            }
            Fault::Late(by_s) => {
                let by_us = (by_s * 1e6) as i64;
                tdoa.valid_at = tdoa.valid_at.offset_us(by_us);
                tdoa.received_at = tdoa.received_at.offset_us(by_us);
                event.at = event.at.offset_us(by_us);
            }
            Fault::None | Fault::Silent(_) | Fault::Gap(_) => {}
        }
    }
    out.events.retain(|event| match (&event.sample, fault) {
        (Sample::Tdoa(t), Fault::Silent(ids)) => {
            event.at < from || !ids.iter().any(|id| t.anchor_a.0 == *id || t.anchor_b.0 == *id)
        }
        (Sample::Tdoa(_), Fault::Gap(for_s)) => {
            event.at < from || event.at.seconds_since(from) > for_s
        }
        _ => true,
    });
    out.events.sort_by_key(|event| event.at);
    out
}

/// What a measurement has more when an anchor really stands elsewhere.
fn moved(tdoa: &Tdoa, survey: &Survey, at_E_m: Vec3<E>, id: u8, by_m: f64) -> f64 {
    let more = |anchor: haltere_core::measure::AnchorId| {
        let Some(site) = survey.position_E_m(anchor).filter(|_| anchor.0 == id) else { return 0.0 };
        let now = site + Vec3::new(by_m, 0.0, 0.0);
        (at_E_m - now).norm() - (at_E_m - site).norm()
    };
    more(tdoa.anchor_b) - more(tdoa.anchor_a)
}

/// Writes the table as Markdown, the kinds of flights side by side.
pub fn print_integrity(out: &mut impl Write, kinds: &[(&str, Vec<Integrity>)]) -> fmt::Result {
    write!(out, "| from the middle on |")?;
    for (title, rows) in kinds {
        let flights = rows.first().map_or(0, |r| r.flights);
        write!(out, " {title}, {flights} flights | over 1 m and good, s | worst, m |")?;
    }
    writeln!(out, "\n|---|{}", "---|---|---|".repeat(kinds.len()))?;
    for (i, fault) in FAULTS.iter().enumerate() {
        write!(out, "| {} |", fault.0)?;
        for r in kinds.iter().filter_map(|(_, rows)| rows.get(i)) {
            write!(
                out,
                " {}, {}, {} | {:.1} | {:.2} |",
                r.warned, r.unwarned, r.in_vain, r.silent_s, r.worst_m
            )?;
        }
        writeln!(out)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::util_flights::{Flown, load_all};

    use super::*;

    #[test]
    fn val_a_flight_without_fault_is_neither_wrong_nor_doubted_for_long() {
        let Some(dir) = crate::recordings::util() else {
            println!("skipped: no data");
            return;
        };
        let flights = load_all(&dir.join("full")).unwrap();
        let flight = flights.iter().find(|f| f.name.starts_with("jun05")).unwrap();
        let flown = Flown::by_default().unwrap().estimator;
        let sound = fly(flight, &flown, Fault::None);
        assert!(sound.wrong.is_none() && sound.vain_s < 0.05 * sound.fine_s, "{sound:?}");
        // Without UWB nobody knows where it is, and health says so.
        let blind = fly(flight, &flown, Fault::Gap(10.0));
        assert!(blind.wrong == Some(true), "{blind:?}");
        // An anchor's fault is in both of its measurements, and in no other.
        let moved = with(flight, Fault::Moved(6, 2.0), middle(flight));
        let differ =
            flight.events.iter().zip(&moved.events).filter(|(a, b)| match (&a.sample, &b.sample) {
                (Sample::Tdoa(a), Sample::Tdoa(b)) => {
                    let concerns = a.anchor_a.0 == 6 || a.anchor_b.0 == 6;
                    let differs = a.distance_diff_m != b.distance_diff_m;
                    assert!(concerns || !differs);
                    differs
                }
                _ => false,
            });
        assert!(differ.count() > 100);
    }
}
