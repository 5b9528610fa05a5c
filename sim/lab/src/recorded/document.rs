//! docs/ESTIMATOR.md: what is measured on the recorded flights, as one page that a command writes.

use std::fmt::Write as _;

use crate::util_flights::file::Flight;
use crate::util_flights::{Consistency, FlightReport, run_flight, table};
use haltere_core::estimator::EstimatorConfig;

use super::cold::{ColdReport, cold_starts, print_cold};
use super::floor::floor_check;
use super::ingredients::{Ingredients, ingredients, print_ingredients};
use super::integrity::{Integrity, integrity, print_integrity};
use super::search::{LEFT_OUT_HEAD, LeftOut, leave_one_out, print_medians};

/// Measures everything and writes the page. `tell` is told how far it is: done, of how many, what.
pub fn document(
    flights: &[Flight],
    flown: &EstimatorConfig,
    mut tell: impl FnMut(usize, usize, &str),
) -> String {
    let (with_imu, unaided): (Vec<Flight>, Vec<Flight>) =
        flights.iter().cloned().partition(|f| f.has_imu());
    let reports: Vec<FlightReport> =
        flights.iter().map(|flight| run_flight(flight, flown)).collect();
    let rows = ingredients(flights, flown, &mut tell);
    let cold = cold_starts(flights, flown, &mut tell);
    let left_out = leave_one_out(flights, flown, &mut tell);
    let faults = [
        ("with IMU", integrity(&with_imu, flown, &mut tell)),
        ("TDOA alone", integrity(&unaided, flown, &mut tell)),
    ];
    let mut out = page(flown, &reports, &rows, &cold, &left_out);
    // Writing to a String cannot fail.
    let _ = more(&mut out, flights, &faults);
    out
}

fn page(
    flown: &EstimatorConfig,
    reports: &[FlightReport],
    rows: &[Ingredients],
    cold: &[ColdReport],
    left_out: &[LeftOut],
) -> String {
    let mut out = String::from(INTRODUCTION);
    // Writing to a String cannot fail.
    let _ = (|| -> std::fmt::Result {
        out.push_str(&what_flew(flown));
        writeln!(out, "\n## Every flight\n\n{ABOUT_FLIGHTS}\n")?;
        flights_table(&mut out, reports)?;
        outside(&mut out, reports)?;
        writeln!(out, "\n## Every ingredient on and off\n\n{ABOUT_INGREDIENTS}\n")?;
        print_ingredients(&mut out, rows)?;
        writeln!(out, "\n## One flight left out\n\n{ABOUT_LEFT_OUT}\n")?;
        writeln!(out, "{LEFT_OUT_HEAD}")?;
        print_medians(&mut out, left_out)?;
        writeln!(out, "\n## Cold starts\n\n{ABOUT_COLD}\n")?;
        print_cold(&mut out, cold)
    })();
    out
}

/// A fault of the survey of so much is told, m.
const TOLD_M: f64 = 0.3;

/// What is not about errors of position: warnings, the floor, time.
fn more(
    out: &mut String,
    flights: &[Flight],
    faults: &[(&str, Vec<Integrity>)],
) -> std::fmt::Result {
    writeln!(out, "\n## Warnings before the estimate is wrong\n\n{ABOUT_INTEGRITY}\n")?;
    print_integrity(out, faults)?;
    writeln!(out, "\n## Survey check on the floor\n\n{ABOUT_FLOOR}\n")?;
    writeln!(
        out,
        "| flight | low anchors, m | worst anchor | it reads too far by, m | doubt | others | says |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|---|")?;
    for flight in flights {
        let Some(fit) = floor_check(flight) else {
            writeln!(out, "| {} | - | - | - | - | - | too little heard |", flight.name)?;
            continue;
        };
        if !fit.is_at_fault(TOLD_M) {
            continue;
        }
        writeln!(
            out,
            "| {} | {:+.2} | {} | {:+.2} | {:.2} | {:.2} | {} |",
            flight.name,
            fit.hidden_m,
            fit.worst,
            fit.range_bias_m,
            fit.doubt,
            fit.others_doubt,
            if fit.is_at_fault(0.6) { "refuses" } else { "tells" }
        )?;
    }
    Ok(())
}

/// The settings of the UWB that flew: a test holds the page and the defaults together by it.
fn what_flew(flown: &EstimatorConfig) -> String {
    let (bias, quality, gate) = (&flown.anchor_bias, &flown.quality, &flown.gate);
    format!(
        "## What flew\n\nThe configuration that flies when nobody configures anything (`config/haltere.toml`), with the \
         numbers of the recorded quadrotor (`sim/lab/src/util_flights/quadrotor.toml`) and, without IMU, `motion = \"unaided\"`. \
         One set of parameters for all flights; `haltere-lab util DIR` prints the same. The nine states alone, with \
         `control.learned_uwb_errors = false`, stand among the ingredients. Of the UWB:\n\n\
         | key of `[estimator]` | value |\n|---|---|\n\
         | `std_uwb_m`, `uwb_correlation_s`, `uwb_noise` | {}, {}, {:?} |\n\
         | `anchor_bias`: `std_m`, `correlation_s`, `correlation_m`, `level_s`, `constant_std_m` | {}, {}, {}, {}, {} |\n\
         | `quality`: `time_s`, `least`; `gate`: `tail_sigma`, `reject` | {}, {}; {}, {} |\n\
         | `isolation.leave_out` | {} |\n",
        flown.std_uwb_m,
        flown.uwb_correlation_s,
        flown.uwb_noise,
        bias.std_m,
        bias.correlation_s,
        bias.correlation_m,
        bias.level_s,
        bias.constant_std_m,
        quality.time_s,
        quality.least,
        gate.tail_sigma,
        gate.reject,
        flown.isolation.leave_out,
    )
}

fn flights_table(out: &mut String, reports: &[FlightReport]) -> std::fmt::Result {
    writeln!(
        out,
        "| flight | IMU | whole | airborne | median | 95 % | worst | bias N, E, D | NEES | NIS | \
         over 1 m: warned, not, s |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|---|---|---|---|---|")?;
    for r in reports {
        let [n, e, d] = r.bias_m;
        writeln!(
            out,
            "| {}{} | {} | {} | {} | {} | {} | {} | {n:.2}, {e:.2}, {d:.2} | {} | {} | {:.1}, {:.1} |",
            r.flight,
            if r.diverged { " †" } else { "" },
            if r.aided_by_imu { "yes" } else { "no" },
            table::metres(r.rmse_3d_m),
            table::metres(r.rmse_3d_airborne_m),
            table::metres(r.median_m),
            table::metres(r.p95_m),
            table::metres(r.worst_m),
            table::consistency(r.nees_band),
            table::consistency(r.nis_band),
            r.warned_s,
            r.unwarned_s,
        )?;
    }
    for (name, aided) in [("with IMU", true), ("TDOA alone", false)] {
        let of = || reports.iter().filter(|r| r.aided_by_imu == aided);
        if of().next().is_some() {
            writeln!(
                out,
                "| **median, {name}** | | {} | {} | | | | | | | |",
                table::metres(table::median(of().map(|r| r.rmse_3d_m))),
                table::metres(table::median(of().map(|r| r.rmse_3d_airborne_m))),
            )?;
        }
    }
    Ok(())
}

/// Which flights are outside the bands, and on which side.
fn outside(out: &mut String, reports: &[FlightReport]) -> std::fmt::Result {
    let side = |of: fn(&FlightReport) -> Option<Consistency>, is: fn(&Consistency) -> bool| {
        let names: Vec<String> = reports
            .iter()
            .filter(|r| of(r).is_some_and(|c| is(&c)))
            .map(|r| format!("`{}`", r.flight))
            .collect();
        if names.is_empty() { "none".to_owned() } else { names.join(", ") }
    };
    writeln!(out, "\nOutside:\n")?;
    type Figure = fn(&FlightReport) -> Option<Consistency>;
    let figures: [(&str, Figure); 2] = [("NEES", |r| r.nees_band), ("NIS", |r| r.nis_band)];
    for (name, of) in figures {
        let known = reports.iter().filter_map(of).count();
        writeln!(
            out,
            "* {name} of {known} flights: below, cautious: {}; above, overconfident: {}.",
            side(of, Consistency::is_cautious),
            side(of, Consistency::is_overconfident)
        )?;
    }
    Ok(())
}

const INTRODUCTION: &str = "\
# Estimator: what it does on recorded flights

Written by `haltere-lab recorded DIR --document docs/ESTIMATOR.md`; do not edit by hand. DIR holds
`full/` and `tdoa_pos/` of UTIL (Zhao, Goudar, Qiao, Schoellig, IJRR 43(10), 2024), which is no part
of this repository. † diverged (more than 2 m for more than 1 s), or found no start.

## The filter

The nine states of the source (position, velocity, attitude) stay as they are. What stands beside them follows the
errors of these recordings: those of the pairs are the differences of one number for each anchor. On the floor the four
low anchors read 3 to 4 m too far; behind the metal box of `apr26-traj11` anchor 0 does by 2.5 m, in both of its pairs with
opposite signs; in free space they differ by -0.1 to +0.1 m that stay for days, and wander by some 0.2 m over half a metre
of flight.

* Each of up to 16 anchors has a range bias in two parts, one that wanders with time and distance flown and one that stays
  (`src/core/estimator/bias.rs`). How much each wanders is learned in flight, within seconds (`bias_level.rs`).
* Each anchor has a quality, a factor on its variance that is learned from its innovations (`quality.rs`).
* No gate throws a measurement away: what does not fit keeps the weight that a Student-t tail leaves it.
* When most anchors at once do not fit, the filter is doubted: a position is found anew by least squares, and taken if it
  explains the measurements better. Without IMU this is also done while the height is uncertain where the floor hides
  the low anchors.
* One anchor that does not fit while all others fit one another is left out, and health is degraded until it fits
  again (`isolation.rs`). When anchors contradict one another and none can be named, health is degraded and says which
  axis is in doubt and by how much.
* Health is degraded for some two seconds at each take-off among anchors on the floor, which is no fault and no
  warning is told, and for 5 s after a loss of UWB in the air, until a tilt that has drifted is back.

";
const ABOUT_FLIGHTS: &str = "\
3D errors in m against motion capture, causal. Motion capture is stamped some 10 ms late and taken as it is stamped. Whole: from the
first estimate on, floor included. Airborne: above 0.5 m and more than 5 s after lift-off. NEES: mean squared error
over stated covariance per axis; NIS: mean squared innovation over stated variance, each at most 25; 1 is
honest, below 1 cautious. In brackets the values between which 95 % of honest filters are, from χ² (Bar-Shalom, Li, Kirubarajan,
Estimation with applications to tracking and navigation, 2001, section 5.4) of the effective number n of independent errors,
by the autocorrelation of the flight's own errors (Bayley and Hammersley, J. R. Stat. Soc. Suppl. 8(2), 1946, ended as by Geyer,
Statistical Science 7(4), 1992). Of 20 figures of honest filters one is outside by chance. The UWB errors of the
configuration were taken from the README of the recordings, and within its ranges from NEES and NIS of these
flights. The filter is told the heading at the first instant when there is an IMU, and nothing else but the anchors and where
the tag is on the vehicle (June and `const`: 9 cm above the centre; April: unknown, taken as zero).";
const ABOUT_INGREDIENTS: &str = "\
Airborne 3D rms, m; whole flights: their median. All else as in the first row. A variant is not tuned anew for what it lacks.";
const ABOUT_INTEGRITY: &str = "\
Each recording with a fault from its middle to its end, in the air. The first number counts flights whose error was over 1 m for
longer than 0.2 s and was warned of: health was not good then or within the 2 s before. The second counts those without
a warning, the third those with a warning that were never over 1 m. Then follow the longest time over 1 m while health was good, and the worst
error. Two anchors that read too far together are told of where their pair explains the misfit, not left out; 1 and 4 hang on one
wall under the ceiling, and the position takes most of what they do upon itself. Fewer than seven anchors heard count as a
warning: one that is wrong would not be found out among them.";
const ABOUT_FLOOR: &str = "\
What the check before take-off (docs/SAFETY.md, `anchors`) says of each recording at the moment before its
lift-off, told nothing but the anchors. Doubt: how much of the misfit the anchor explains, in units of what
is usual; it is named from 2 on if the others, without it, stay below 1. Where the floor adds more than 1 m to
the low anchors nothing is concluded. Of the other flights it says nothing; these have a metal box beside anchor 2.";
const ABOUT_LEFT_OUT: &str = "\
For each flight the parameters of the UWB errors were searched on the eleven others, from round numbers that no result of ours has
shaped, and then judged on the flight that was left out. Drag and process noise are the vehicle's, from its IMU and motion capture
and the NEES of all flights, and are not searched; nor is `quality.least`. The set: `EstimatorConfig::learned_uwb_errors`.
By flight, and what the searches chose: `haltere-lab recorded DIR --leave-one-out`.";
const ABOUT_COLD: &str = "\
Switched on every 4 s of a flight, in the air, or at its beginning on the floor, and told neither
position nor heading. Peak: largest error from the first position that is offered. Converged: below
0.6 m for a second. Until the heading is known, health is `Lost`: a position to look at, not to fly on.
Known: when one sigma of the best of sixteen filters that race (`src/core/estimator/cold.rs`) is below 14 deg. The last
column is the error over the sigma stated with it; 1 is honest.";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_the_page_is_of_the_set_that_is_shipped() {
        let page = include_str!("../../../../docs/ESTIMATOR.md");
        let flown = crate::util_flights::Flown::by_default().unwrap().estimator;
        let said = what_flew(&flown);
        assert!(
            page.contains(&said),
            "docs/ESTIMATOR.md was measured with other settings than fly now: write it anew \
             (`haltere-lab recorded DIR --document docs/ESTIMATOR.md`); expected in it:\n{said}"
        );
    }

    #[test]
    fn prop_the_page_names_what_is_outside_and_on_which_side() {
        let report = |flight: &str, nees, nis| FlightReport {
            flight: flight.into(),
            nees_band: nees,
            nis_band: nis,
            ..FlightReport::default()
        };
        let band = |mean| Some(Consistency { mean, independent: 25.0, low: 0.52, high: 1.63 });
        let reports = [
            report("a", band(0.4), band(1.0)),
            report("b", band(1.0), None),
            report("c", band(2.0), None),
        ];
        let mut out = String::new();
        flights_table(&mut out, &reports).unwrap();
        outside(&mut out, &reports).unwrap();
        for says in [
            "| 0.40 (0.52 to 1.63, n 25) outside | 1.00 (0.52 to 1.63, n 25) |",
            "* NEES of 3 flights: below, cautious: `a`; above, overconfident: `c`.",
            "* NIS of 1 flights: below, cautious: none; above, overconfident: none.",
        ] {
            assert!(out.contains(says), "{out}");
        }
    }
}
