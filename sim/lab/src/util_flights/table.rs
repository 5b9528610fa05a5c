//! Table of the flights, for people.

use std::fmt::{self, Write};

use super::{Beside, Consistency, FlightReport};

/// Writes one line per flight, the medians of the whole-flight and airborne figures with and without
/// IMU, whether the stated errors are honest, and what was doubted by anchor.
pub fn print_table(out: &mut impl Write, reports: &[FlightReport]) -> fmt::Result {
    writeln!(
        out,
        "{:<26} {:>6} {:>8} {:>6} {:>6} {:>6}  {:>20} {:>10} {:>8} {:>7} {:>6} {:>6} {:>5} {:>6}",
        "flight",
        "rmse_m",
        "airborne",
        "median",
        "p95",
        "worst",
        "bias N E D",
        "tilt yaw",
        "updates",
        "reject",
        "absurd",
        "doubts",
        "ns",
        "verdict"
    )?;
    for r in reports {
        let [n, e, d] = r.bias_m;
        writeln!(
            out,
            "{:<26} {:>6} {:>8} {:>6} {:>6} {:>6}  {n:>6.3} {e:>6.3} {d:>6.3} {:>10} {:>8} \
             {:>7} {:>6} {:>6} {:>5} {:>6}",
            r.flight,
            metres(r.rmse_3d_m),
            metres(r.rmse_3d_airborne_m),
            metres(r.median_m),
            metres(r.p95_m),
            metres(r.worst_m),
            r.attitude_deg.map_or("-".into(), |[tilt, yaw]| format!("{tilt:.1} {yaw:.1}")),
            r.updates,
            r.rejected,
            r.impossible,
            r.remedies,
            r.ns_per_update.map_or("-".into(), |ns| format!("{ns:.0}")),
            if r.diverged { "DIVERGED" } else { "ok" }
        )?;
    }
    for (name, aided) in [("median, with IMU", true), ("median, TDOA alone", false)] {
        let of = || reports.iter().filter(|r| r.aided_by_imu == aided);
        if of().next().is_some() {
            writeln!(
                out,
                "{name:<26} {:>6} {:>8}",
                metres(median(of().map(|r| r.rmse_3d_m))),
                metres(median(of().map(|r| r.rmse_3d_airborne_m)))
            )?;
        }
    }
    writeln!(out, "{:<26} {:<36} nis, as nees", "", "nees (95 % of honest, independent)")?;
    for r in reports {
        let [nees, nis] = [r.nees_band, r.nis_band].map(consistency);
        writeln!(out, "{:<26} {nees:<36} {nis}", r.flight)?;
    }
    writeln!(out, "{:<26} rejected or more than 3 sigma off, by anchor", "")?;
    for r in reports {
        let anchors: Vec<String> =
            r.doubted_by_anchor.iter().map(|(id, count)| format!("{id}: {count}")).collect();
        writeln!(out, "{:<26} {}", r.flight, anchors.join(", "))?;
    }
    Ok(())
}

/// Writes what each estimate of one's own flights was held against.
pub fn print_truth(out: &mut impl Write, reports: &[FlightReport]) -> fmt::Result {
    writeln!(
        out,
        "{:<26} assumed in the frame of the anchors and of the vehicle's centre; clock without what the estimate lags",
        "truth"
    )?;
    for r in reports {
        let Some(Beside { source, poses, unused, clock, frames, lost_inputs }) = &r.truth else {
            continue;
        };
        write!(out, "{:<26} {source}: {poses} poses", r.flight)?;
        if unused.count() > 0 {
            write!(out, ", not used: {unused}")?;
        }
        if *lost_inputs > 0 {
            write!(out, "; the log has lost {lost_inputs} inputs")?;
        }
        let clock = clock.map_or("that of the companion".into(), |c| c.to_string());
        let [n, e, d] = frames.shift_E_m;
        let turn = frames.yaw_rad.map_or("not turned".into(), |yaw_rad| {
            format!("turned by {:+.1} deg from north to east", yaw_rad.to_degrees())
        });
        writeln!(
            out,
            "\n{:<26}   clock: {clock}\n{:<26}   what flew is off by {:.3} m rms; it would be by {:.3} m if the truth were {turn} \
             and moved by N {n:+.3} E {e:+.3} D {d:+.3} m (not applied)",
            "", "", frames.rms_m, frames.fitted_rms_m
        )?;
    }
    Ok(())
}

/// With band and effective number, and whether it is outside.
pub fn consistency(value: Option<Consistency>) -> String {
    value.map_or("-".into(), |v| v.to_string())
}

/// To the millimetre, or a dash.
pub fn metres(value: Option<f64>) -> String {
    value.map_or("-".into(), |v| format!("{v:.3}"))
}

/// Mean of the two middle values for an even number; `None` if any is missing.
pub fn median(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect::<Option<_>>()?;
    values.sort_by(f64::total_cmp);
    let n = values.len();
    Some(0.5 * (values.get(n / 2)? + values.get(n.checked_sub(1)? / 2)?))
}
