//! Table 1, figures 4 and 5: how well the first part of a transient tells the last speed that the source's hall shows.
//!
//! The error is |extrapolated − last measured| in m/s, as the source has it. Its equation 5, v(t) = a − b·e^(−c·t+d), has
//! four parameters of which b and d are one; it is fitted to the first 10 to 90 % of what is seen. Where that begins is not
//! stated: the law is that of a constant lean, so the time in which the attitude is on its way is left out, and the same
//! from the step on stands beside.

use anyhow::Result;
use haltere::fit::transient::{SHARES, Transient, fit};
use haltere::report::svg::{Mark, Plot, Series, Tone};
use haltere_model::Vehicle;

use super::angle_steps::{ARRIVAL_S, AXES, AngleStep, FLIGHT_S, HOLD_S, SOURCE_HALL_M, fly_step};
use super::bench::Bench;
use super::results::{Cell, Claim, Figure, Line, Row, Section, Sense, Source, Spread, Table};
use super::source::{ANGLES_DEG, TABLE_1_MPS, TRANSIENT_FROM_DEG};

/// The share whose fit is drawn, by its place in the list: 70 %, as in the source's figure 5.
const DRAWN: usize = 3;
/// A speed that gains more than this when the hall ends has not settled, m/s².
const STILL_RISING_MPS2: f64 = 0.2;
const PLOT_PX: [f64; 2] = [540.0, 300.0];

/// Simulated seconds of a repetition.
pub fn seconds() -> u64 {
    ANGLES_DEG.concat().len() as u64 * FLIGHT_S as u64
}

/// A step and what each share of it says.
struct Extrapolated {
    step: AngleStep,
    /// Error of the last speed, m/s, per share: once the attitude has arrived, and from the step on; `None`: not fitted.
    error_mps: [Vec<Option<f64>>; 2],
    /// The fits once the attitude has arrived.
    fits: Vec<Option<Transient>>,
}

fn extrapolate(step: AngleStep) -> Extrapolated {
    let last_mps = step.in_hall().last().map_or(f64::NAN, |row| row[1]);
    let fits = |from_s: f64| -> Vec<Option<Transient>> {
        let seen = step.in_hall().iter().filter(|row| row[0] >= from_s);
        let (t, v): (Vec<f64>, Vec<f64>) = seen.map(|row| (row[0], row[1])).unzip();
        SHARES.iter().map(|share| fit(&t, &v, *share).ok()).collect()
    };
    let error = |fits: &[Option<Transient>]| {
        fits.iter().map(|f| Some((f.as_ref()?.a_mps.value - last_mps).abs())).collect()
    };
    let [arrived, all] = [fits(ARRIVAL_S), fits(0.0)];
    Extrapolated { error_mps: [error(&arrived), error(&all)], fits: arrived, step }
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    let cases: Vec<(usize, usize)> =
        (0..AXES.len()).flat_map(|axis| (0..5).map(move |angle| (axis, angle))).collect();
    let vehicle = Vehicle::default();
    let flown = bench.each(&cases, FLIGHT_S, |(axis, angle), seed| {
        Ok(fly_step(bench, &vehicle, *axis, ANGLES_DEG[*axis][*angle], seed)?.map(extrapolate))
    })?;
    let refused = flown.iter().flatten().filter(|f| f.is_none()).count();
    let [source_m, margin_m] = SOURCE_HALL_M;
    let mut section = Section {
        method: format!(
            "A lean held for {HOLD_S:.0} s, one flight each, seen as far as the source's hall of {source_m:.0} m lets it: less \
             {margin_m} m to both walls and what braking takes. Error: |extrapolated \u{2212} last speed seen|, true speeds, as \
             motion capture has them. Equation 5 is fitted without the first {ARRIVAL_S} s, in \
             which the attitude is on its way; from the step on it is the second table. {refused} of {} flights were refused for want of thrust at 52\u{b0}.",
            flown.len() * bench.repetitions as usize
        ),
        ..Section::default()
    };
    let of = |case: usize, law: usize, share: usize| {
        let steps = flown[case].iter().flatten();
        Spread::of(steps.filter_map(|e| e.error_mps[law][share]))
    };
    for (axis, tables) in TABLE_1_MPS.iter().enumerate() {
        for (share, cells) in tables.iter().enumerate() {
            for (angle, cell) in cells.iter().enumerate() {
                let case = 5 * axis + angle;
                let angle_deg = ANGLES_DEG[axis][angle];
                let mark = if angle_deg >= TRANSIENT_FROM_DEG { "*" } else { "" };
                let what = format!(
                    "{} {angle_deg:.0}\u{b0}{mark}, {:.0} %",
                    AXES[axis],
                    100.0 * SHARES[share]
                );
                let source = Source::number(*cell, "table 1");
                let row = Row::new(what, "m/s", 3, of(case, 0, share), source, Sense::Less);
                let whole = flown[case].iter().flatten();
                let settled = Spread::of(whole.filter_map(|e| {
                    Some((e.fits.get(share)?.as_ref()?.a_mps.value - e.step.final_mps).abs())
                }));
                section.rows.push(
                    row.tried("from the step on", of(case, 1, share).mean)
                        .tried("against the speed that a longer hall shows", settled.mean),
                );
            }
        }
    }
    section.tables.push(from_the_step(&of));
    let cells = |law: usize| {
        (0..cases.len()).flat_map(move |c| (0..SHARES.len()).map(move |s| (c, law, s)))
    };
    let median = |law: usize| {
        let mut all: Vec<f64> = cells(law).map(|(c, l, s)| of(c, l, s).mean).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    let mut theirs: Vec<f64> = TABLE_1_MPS.concat().concat();
    theirs.sort_by(f64::total_cmp);
    let reached = section.rows.iter().filter(|r| r.reached()).count();
    section.lines.push(Line::new(
        Claim::of(&section.rows),
        format!(
            "Table 1, extrapolated speed: {reached} of {} cells at the source's or below; median error {:.3} m/s ({:.3}); \
             from the step on, the attitude still on its way, {:.3}.",
            section.rows.len(),
            median(0),
            theirs[theirs.len() / 2],
            median(1)
        ),
    ));
    let seen = cases.iter().zip(&flown).map(|((axis, angle), flown)| {
        let mean = |pick: &dyn Fn(&AngleStep) -> f64| {
            Spread::of(flown.iter().flatten().map(|e| pick(&e.step))).mean
        };
        let rising = mean(&AngleStep::late_mps2);
        format!(
            "{} {:.0}\u{b0} {:.1} s, {}",
            AXES[*axis],
            ANGLES_DEG[*axis][*angle],
            mean(&|s| s.in_hall().last().map_or(0.0, |row| row[0])),
            if rising > STILL_RISING_MPS2 {
                let [early, late] = [0, 1].map(|k| mean(&move |s: &AngleStep| s.flap_hz[k]));
                format!("still rising by {rising:.2} m/s\u{b2} ({early:.1} to {late:.1} Hz)")
            } else {
                "settled".into()
            }
        )
    });
    section.findings.push(format!(
        "What the hall shows of each: {}. A speed that still rises at its end is the transient that the source marks with a \
         star. Drag goes with the flap rate, and in fast flight it carries a part of the weight, so that the wings slow down: \
         a constant lean has no constant rate then, and the exponential is not the law.",
        seen.collect::<Vec<_>>().join("; ")
    ));
    section.figures.push(figure("Figure 4", &cases, &flown, false));
    section.figures.push(figure("Figure 5", &cases, &flown, true));
    Ok(section)
}

/// The same cells with the attitude's way.
fn from_the_step(of: &dyn Fn(usize, usize, usize) -> Spread) -> Table {
    let mut columns = vec!["data".to_owned()];
    for (axis, angles) in ANGLES_DEG.iter().enumerate() {
        columns.extend(angles.map(|angle| format!("{} {angle:.0}\u{b0}", AXES[axis])));
    }
    let rows = SHARES.iter().enumerate().map(|(share, frac)| {
        let mut row = vec![Cell::from(format!("{:.0} %", 100.0 * frac))];
        row.extend((0..10).map(|case| Cell::Spread(of(case, 1, share), 3)));
        row
    });
    Table {
        title: "Table 1 with equation 5 from the step on, m/s".into(),
        columns,
        rows: rows.collect(),
        note: String::new(),
        ..Table::default()
    }
}

/// Figure 4: the speeds; figure 5: with the law that a part of the data says.
fn figure(
    name: &'static str,
    cases: &[(usize, usize)],
    flown: &[Vec<Option<Extrapolated>>],
    laws: bool,
) -> Figure {
    let plots = (0..AXES.len()).map(|axis| {
        let mut series = Vec::new();
        for ((_, angle), flown) in cases.iter().zip(flown).filter(|((a, _), _)| *a == axis) {
            let Some(first) = flown.iter().flatten().next() else { continue };
            let tone = Tone::Family(*angle as u8);
            series.push(Series {
                name: format!("{:.0}\u{b0}", ANGLES_DEG[axis][*angle]),
                tone,
                mark: Mark::Line,
                points: first.step.in_hall().iter().map(|row| [row[0], row[1]]).collect(),
            });
            if let Some(fit) = first.fits.get(DRAWN).and_then(Option::as_ref).filter(|_| laws) {
                series.push(Series {
                    name: String::new(),
                    tone,
                    mark: Mark::Dashed,
                    points: (0..=60)
                        .map(|i| f64::from(i) * HOLD_S / 60.0)
                        .map(|t| [t, fit.at(t)])
                        .collect(),
                });
            }
        }
        Plot {
            title: format!("Steps in {}", AXES[axis]),
            x_label: "s".into(),
            y_label: "m/s".into(),
            series,
            size_px: PLOT_PX,
            ..Plot::default()
        }
    });
    let dashed = if laws {
        format!("; dashed: equation 5 as the first {:.0} % say it", 100.0 * SHARES[DRAWN])
    } else {
        String::new()
    };
    Figure {
        name,
        caption: format!(
            "Speed after steps, as far as the source's hall, first repetition{dashed}."
        ),
        plots: plots.collect(),
    }
}
