//! Table 1, figures 4 and 5: how well the first part of a transient tells the final speed.
//!
//! A lean is held until the speed has settled; the transient `v(t) = a − B·e^(−c·t)` is fitted to the
//! first 10 to 90 % of it, and its a compared with the speed that was reached.

use anyhow::Result;
use haltere::fit::transient::{SHARES, Transient, fit};
use haltere::report::svg::{Mark, Plot, Series, Tone};
use haltere_model::Vehicle;

use super::angle_steps::{ARRIVAL_S, AXES, AngleStep, FLIGHT_S, HOLD_S, SOURCE_HALL_M, fly_step};
use super::bench::Bench;
use super::results::{Cell, Figure, Row, Section, Spread, Table};
use super::source;

/// The share whose fit is drawn, by its place in the list: 30 %.
const DRAWN: usize = 1;
/// A speed that gains more than this at the end of the hold has not settled, m/s².
const STILL_RISING_MPS2: f64 = 0.2;
/// Under the tables.
const NOTE: &str = "In brackets: by its own standard error the fit does not determine the final speed, in most \
                    repetitions; a user of it is told so.";
const PLOT_PX: [f64; 2] = [1100.0, 320.0];

/// Simulated seconds.
pub fn cost(bench: &Bench) -> u64 {
    bench.cost(source::ANGLES_DEG.iter().map(|a| a.len()).sum(), FLIGHT_S)
}

/// A step and what each share of it says.
struct Extrapolated {
    step: AngleStep,
    /// Error of the final speed over it, per share, as motion capture sees it and as the filter does;
    /// `None`: not fitted.
    error_frac: [Vec<Option<f64>>; 2],
    /// Whether the fit itself says that its data determine the final speed; the same order.
    determined: [Vec<bool>; 2],
    /// Fits of the speed as motion capture sees it.
    fits: Vec<Option<Transient>>,
}

fn extrapolate(step: AngleStep) -> Extrapolated {
    let fits = |estimated: bool| -> Vec<Option<Transient>> {
        let (t, v) = step.settled(estimated);
        SHARES.iter().map(|share| fit(&t, &v, *share).ok()).collect()
    };
    let error = |fits: &[Option<Transient>]| {
        fits.iter()
            .map(|fit| {
                let a_mps = fit.as_ref()?.a_mps.value;
                Some((a_mps - step.final_mps).abs() / step.final_mps)
            })
            .collect()
    };
    let (true_fits, filter_fits) = (fits(false), fits(true));
    let error_frac = [error(&true_fits), error(&filter_fits)];
    let determined = [&true_fits, &filter_fits]
        .map(|fits| fits.iter().map(|f| f.as_ref().is_some_and(|f| f.determined)).collect());
    Extrapolated { step, error_frac, determined, fits: true_fits }
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    let cases: Vec<(usize, f64)> = source::ANGLES_DEG
        .iter()
        .enumerate()
        .flat_map(|(axis, angles)| angles.iter().map(move |angle| (axis, *angle)))
        .collect();
    let vehicle = Vehicle::default();
    let flown = bench.each(&cases, FLIGHT_S, |(axis, angle_deg), seed| {
        Ok(fly_step(bench, &vehicle, *axis, *angle_deg, seed)?.map(extrapolate))
    })?;
    let refused = flown.iter().flatten().filter(|f| f.is_none()).count();
    let [source_m, _] = SOURCE_HALL_M;
    let mut section = Section {
        method: format!(
            "A lean held for {HOLD_S:.0} s in a hall long enough for the speed to settle, one flight each. The \
             fit leaves out the first {ARRIVAL_S} s, in which the attitude is on its way, and uses the first \
             part of the rest. Error: |extrapolated \u{2212} reached| over reached, in percent. Speeds are true \
             ones, as motion capture would give; below also those of the filter. {refused} of {} flights were \
             refused for want of thrust at 52\u{b0}. Whether the source means percent, and what its table \
             says, is not available to us.",
            flown.len() * bench.repetitions as usize
        ),
        ..Section::default()
    };
    for (source, title) in [
        "Table 1: error of the extrapolated final speed, %",
        "The same from speeds of the filter, %",
    ]
    .into_iter()
    .enumerate()
    {
        section.tables.push(table(title, source, &cases, &flown));
    }
    for (k, share) in SHARES.iter().enumerate() {
        let mean = (0..bench.repetitions as usize).map(|i| {
            let errors: Vec<f64> = flown
                .iter()
                .filter_map(|f| f.get(i)?.as_ref()?.error_frac[0][k])
                .map(|e| 100.0 * e)
                .collect();
            errors.iter().sum::<f64>() / errors.len() as f64
        });
        let what = format!("error from the first {:.0} %, all angles", 100.0 * share);
        section.rows.push(Row::new(what, "%", 2, Spread::of(mean)));
    }
    let fits: Vec<String> = cases
        .iter()
        .zip(&flown)
        .map(|((axis, angle), flown)| {
            let fits = Spread::of(flown.iter().flatten().map(|e| 100.0 * e.step.fits_frac)).mean;
            format!("{} {angle:.0}\u{b0} {fits:.0} %", AXES[*axis])
        })
        .collect();
    section.findings.push(format!(
        "Of these transients a hall of {source_m:.0} m, fences and braking counted, shows only the first part: {}. \
         That is what extrapolation is for.",
        fits.join(", ")
    ));
    let mean = |flown: &[Option<Extrapolated>], pick: fn(&AngleStep) -> f64| {
        Spread::of(flown.iter().flatten().map(|e| pick(&e.step))).mean
    };
    let rising: Vec<String> = cases
        .iter()
        .zip(&flown)
        .filter_map(|((axis, angle), flown)| {
            let gain = mean(flown, |s| s.late_mps2);
            let [early, late] = [mean(flown, |s| s.flap_hz[0]), mean(flown, |s| s.flap_hz[1])];
            (gain > STILL_RISING_MPS2).then(|| {
                format!(
                    "{} {angle:.0}\u{b0} {gain:+.2} m/s\u{b2}, {early:.1} to {late:.1} Hz",
                    AXES[*axis]
                )
            })
        })
        .collect();
    if !rising.is_empty() {
        section.findings.push(format!(
            "Some speeds are still rising when the hold ends; acceleration over its last half second, and flap rate \
             half a second after the step and at its end: {}. Drag goes with the flap rate, and in fast flight it \
             carries a part of the weight, so that the wings slow down: a constant lean has no constant rate then, and \
             more data than the first bend mislead the exponential.",
            rising.join("; ")
        ));
    }
    for (axis, name) in ["Figure 4", "Figure 5"].into_iter().enumerate() {
        section.figures.push(figure(name, axis, &cases, &flown));
    }
    Ok(section)
}

fn table(
    title: &str,
    source: usize,
    cases: &[(usize, f64)],
    flown: &[Vec<Option<Extrapolated>>],
) -> Table {
    let rows = cases.iter().zip(flown).map(|((axis, angle), flown)| {
        let mut row = vec![Cell::from(format!("{} {angle:.0}\u{b0}", AXES[*axis]))];
        row.push(Cell::Spread(Spread::of(flown.iter().flatten().map(|e| e.step.final_mps)), 2));
        for k in 0..SHARES.len() {
            let errors: Vec<f64> = flown
                .iter()
                .flatten()
                .filter_map(|e| e.error_frac[source][k])
                .map(|e| 100.0 * e)
                .collect();
            let steps = flown.iter().flatten();
            let determined = steps.clone().filter(|e| e.determined[source][k]).count();
            row.push(if errors.is_empty() || errors.len() < steps.clone().count() {
                Cell::from("no fit")
            } else if 2 * determined < errors.len() {
                Cell::from(format!("({})", Spread::of(errors).text(0)))
            } else {
                Cell::Spread(Spread::of(errors), 1)
            });
        }
        row
    });
    let mut columns = vec![String::new(), "reached, m/s".into()];
    columns.extend(SHARES.map(|share| format!("{:.0} %", 100.0 * share)));
    Table { title: title.into(), columns, rows: rows.collect(), note: NOTE.into() }
}

fn figure(
    name: &'static str,
    axis: usize,
    cases: &[(usize, f64)],
    flown: &[Vec<Option<Extrapolated>>],
) -> Figure {
    let tones = [0, 1, 2, 3, 4].map(Tone::Family);
    let mut series = Vec::new();
    let of_axis = cases.iter().zip(flown).filter(|((a, _), _)| *a == axis);
    for (((_, angle), flown), tone) in of_axis.zip(tones) {
        let Some(first) = flown.iter().flatten().next() else { continue };
        series.push(Series {
            name: format!("{angle:.0}\u{b0}"),
            tone,
            mark: Mark::Line,
            points: first.step.trace.iter().map(|row| [row[0], row[1]]).collect(),
        });
        if let Some(fit) = first.fits.get(DRAWN).and_then(Option::as_ref) {
            series.push(Series {
                name: String::new(),
                tone,
                mark: Mark::Dashed,
                points: (0..=60)
                    .map(|i| ARRIVAL_S + f64::from(i) * (HOLD_S - ARRIVAL_S) / 60.0)
                    .map(|t| [t, fit.at(t)])
                    .collect(),
            });
        }
    }
    Figure {
        name,
        caption: format!(
            "Speed after steps in {}, first repetition; dashed: what the first {:.0} % of the transient say of \
             the rest.",
            AXES[axis],
            100.0 * SHARES[DRAWN]
        ),
        plots: vec![Plot {
            title: format!("Steps in {}", AXES[axis]),
            x_label: "s".into(),
            y_label: "m/s".into(),
            series,
            size_px: PLOT_PX,
            ..Plot::default()
        }],
    }
}
