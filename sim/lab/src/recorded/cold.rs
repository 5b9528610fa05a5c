//! Cold starts: the estimator is switched on in the middle of a flight, or on the floor, and is told
//! neither position nor heading.

use std::fmt::{self, Write};

use serde::Serialize;

use crate::util_flights::airborne::Activity;
use crate::util_flights::file::{Flight, Sample};
use crate::util_flights::table;
use haltere_core::estimate::Health;
use haltere_core::estimator::{Estimator, EstimatorConfig};
use haltere_core::measure::ImuSample;

/// Starts in the air are this far apart, s.
const EVERY_S: f64 = 4.0;
/// The first start in the air is this long after the beginning, s.
const FIRST_S: f64 = 8.0;
/// What is watched of each start in the air, s.
const WATCHED_S: f64 = 20.0;
/// An error below this, m …
const CONVERGED_M: f64 = 0.6;
/// … for this long is a converged start, s.
const STAYS_S: f64 = 1.0;

/// How one cold start went.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ColdReport {
    /// Which flight.
    pub flight: String,
    /// When it was switched on, s; 0 is on the floor.
    pub start_s: f64,
    /// Time to the first position, s.
    pub found_after_s: Option<f64>,
    /// Largest error since then, m.
    pub peak_m: Option<f64>,
    /// Time until the error stayed below 0.6 m for a second, s.
    pub converged_after_s: Option<f64>,
    /// Time until the heading was said to be known, s.
    pub heading_after_s: Option<f64>,
    /// Error of the heading one second later, deg.
    pub heading_error_deg: Option<f64>,
    /// One sigma that was stated with it, deg.
    pub heading_std_deg: Option<f64>,
}

/// All cold starts of the flights with IMU.
pub fn cold_starts(
    flights: &[Flight],
    config: &EstimatorConfig,
    mut tell: impl FnMut(usize, usize, &str),
) -> Vec<ColdReport> {
    let config = EstimatorConfig { cold_start: true, ..config.clone() };
    let flights: Vec<&Flight> = flights.iter().filter(|f| f.has_imu()).collect();
    let mut out = Vec::new();
    for (done, flight) in flights.iter().enumerate() {
        tell(done, flights.len(), &flight.name);
        out.push(start(flight, &config, 0.0));
        let (Some(first), Some(last)) = (flight.events.first(), flight.events.last()) else {
            continue;
        };
        let length_s = last.at.seconds_since(first.at);
        let mut start_s = FIRST_S;
        while start_s + WATCHED_S < length_s {
            if flies(flight, start_s) {
                out.push(start(flight, &config, start_s));
            }
            start_s += EVERY_S;
        }
    }
    out
}

/// Whether it is above half a metre at this time and for as long as it is watched.
fn flies(flight: &Flight, start_s: f64) -> bool {
    let Some(first) = flight.events.first() else { return false };
    flight.events.iter().all(|event| match event.sample {
        Sample::Pose(pose) => {
            let t_s = event.at.seconds_since(first.at);
            !(start_s..start_s + WATCHED_S).contains(&t_s) || -pose.pos_E_m.z() > 0.5
        }
        _ => true,
    })
}

fn start(flight: &Flight, config: &EstimatorConfig, start_s: f64) -> ColdReport {
    let config = EstimatorConfig { p_BT_B_m: flight.p_BT_B_m(), ..config.clone() };
    let mut estimator = Estimator::new(config, flight.survey.clone());
    let mut activity = Activity::default();
    let mut report = ColdReport {
        flight: flight.name.clone(),
        start_s,
        found_after_s: None,
        peak_m: None,
        converged_after_s: None,
        heading_after_s: None,
        heading_error_deg: None,
        heading_std_deg: None,
    };
    let Some(first) = flight.events.first() else { return report };
    let (mut acc_B_mps2, mut near_since_s) = (None, None);
    let watched_s = if start_s > 0.0 { WATCHED_S } else { 2.0 * WATCHED_S };
    for event in &flight.events {
        let since_s = event.at.seconds_since(first.at) - start_s;
        if since_s < 0.0 || since_s > watched_s {
            continue;
        }
        match event.sample {
            Sample::Acc(acc) => {
                activity.add(event.at, &acc);
                // Switched on in the air it cannot know that it does not stand before it is shaken.
                estimator.set_airborne(activity.is_airborne());
                acc_B_mps2 = Some(acc);
            }
            Sample::Gyro(rate_B_radps) => {
                if let Some(acc_B_mps2) = acc_B_mps2 {
                    estimator.imu(&ImuSample {
                        valid_at: event.at,
                        received_at: event.at,
                        acc_B_mps2,
                        rate_B_radps,
                    });
                }
            }
            Sample::Tdoa(tdoa) => {
                estimator.tdoa(&tdoa);
            }
            Sample::Baro(_) => {}
            Sample::Pose(pose) => {
                let estimate = estimator.estimate();
                if estimate.health == Health::NotAligned {
                    continue;
                }
                report.found_after_s.get_or_insert(since_s);
                let error_m = (estimate.pos_E_m - pose.pos_E_m).norm();
                report.peak_m = Some(report.peak_m.unwrap_or(0.0).max(error_m));
                if error_m > CONVERGED_M {
                    near_since_s = None;
                } else {
                    let since = *near_since_s.get_or_insert(since_s);
                    if since_s - since > STAYS_S {
                        report.converged_after_s.get_or_insert(since);
                    }
                }
                if estimator.is_aligned() {
                    let known_s = *report.heading_after_s.get_or_insert(since_s);
                    if since_s > known_s + 1.0
                        && report.heading_error_deg.is_none()
                        && let Some(truth) = pose.attitude
                    {
                        let off = (truth.inverse() * estimate.R_EB).yaw_rad();
                        report.heading_error_deg = Some(off.to_degrees());
                        report.heading_std_deg = Some(estimate.std_att_B_rad.z().to_degrees());
                    }
                }
            }
        }
    }
    report
}

/// Writes the table as Markdown, a line for each flight.
pub fn print_cold(out: &mut impl Write, reports: &[ColdReport]) -> fmt::Result {
    writeln!(
        out,
        "| flight | starts | found after, s | peak, m: median, worst | converged after, s: median, \
         worst | not within {WATCHED_S} s | heading known | after, s | its error, deg: median, worst | over sigma, rms |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|---|---|---|---|")?;
    let mut names: Vec<(&str, bool)> =
        reports.iter().map(|r| (r.flight.as_str(), r.start_s > 0.0)).collect();
    names.sort_by_key(|(_, air)| *air);
    names.dedup();
    let mut seen = std::collections::BTreeSet::new();
    for (name, air) in names {
        if !seen.insert((name, air)) {
            continue;
        }
        let of: Vec<&ColdReport> =
            reports.iter().filter(|r| r.flight == name && (r.start_s > 0.0) == air).collect();
        let two = |values: Vec<f64>| {
            let worst = values.iter().copied().reduce(f64::max);
            let text = |v: Option<f64>| v.map_or("-".into(), |v| format!("{v:.1}"));
            format!("{}, {}", text(table::median(values.iter().map(|v| Some(*v)))), text(worst))
        };
        let values =
            |get: fn(&ColdReport) -> Option<f64>| of.iter().filter_map(|r| get(r)).collect();
        writeln!(
            out,
            "| {name}, {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            if air { "in the air" } else { "on the floor" },
            of.len(),
            two(values(|r| r.found_after_s)),
            two(values(|r| r.peak_m)),
            two(values(|r| r.converged_after_s)),
            of.iter().filter(|r| r.converged_after_s.is_none()).count(),
            of.iter().filter(|r| r.heading_after_s.is_some()).count(),
            two(values(|r| r.heading_after_s)),
            two(values(|r| r.heading_error_deg.map(f64::abs))),
            over_sigma(&of).map_or("-".into(), |rms| format!("{rms:.1}")),
        )?;
    }
    Ok(())
}

/// Errors of the heading over what was stated of them, rms.
fn over_sigma(reports: &[&ColdReport]) -> Option<f64> {
    let squares: Vec<f64> = reports
        .iter()
        .filter_map(|r| Some((r.heading_error_deg? / r.heading_std_deg?).powi(2)))
        .collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use crate::util_flights::{Flown, load_all};

    use super::*;

    /// Past bug: on the first of these flights it was called known to 10 degrees and was off by 72.
    #[test]
    fn val_a_heading_found_by_motion_is_as_good_as_it_is_said_to_be() {
        let Some(dir) = crate::recordings::util() else {
            println!("skipped: no data");
            return;
        };
        let mut flights = load_all(&dir.join("full")).unwrap();
        flights.retain(|f| f.name.starts_with("jun05") || f.name.starts_with("apr26-traj02"));
        let starts = cold_starts(&flights, &Flown::by_default().unwrap().estimator, |_, _, _| {});
        let known: Vec<(f64, f64)> = starts
            .iter()
            .filter_map(|s| Some((s.heading_error_deg?.abs(), s.heading_std_deg?)))
            .collect();
        // 12 of 12 were found.
        assert!(known.len() >= 10, "{starts:?}");
        assert!(known.iter().all(|(off, std)| *off < 3.0 * std && *std < 20.0), "{known:?}");
    }
}
