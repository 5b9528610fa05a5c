//! `haltere fit imu`: bias and noise at rest, vibration and the wing beat in flight.

use super::PLOT_PX;
use crate::fit::imu::{self, LEAST_FLIGHT_S, LEAST_LINE_HZ, LEAST_REST_S};
use crate::fit::outcome::{Outcome, Refusal};
use crate::fit::programs::Program;
use crate::fit::source::{Source, names};
use crate::fit::value::Value;
use crate::report::svg::{Mark, Plot, Series, Tone};
use haltere_core::frames::G_MPS2;

/// Thrust below this is rest, above the next is flight.
const REST_FRAC: f64 = 0.02;
const FLIGHT_FRAC: f64 = 0.3;
/// Longest rest and flight that are used, s.
const MOST_S: f64 = 120.0;

/// One sample of any file.
#[derive(Clone, Copy)]
struct Row {
    t_s: f64,
    acc: [f64; 3],
    rate: Option<[f64; 3]>,
    thrust_frac: f64,
}

/// Names of the columns and their units.
const COLUMNS: [(&str, &str); 6] = [
    ("accelerometer x", "m/s²"),
    ("accelerometer y", "m/s²"),
    ("accelerometer z", "m/s²"),
    ("gyroscope x", "rad/s"),
    ("gyroscope y", "rad/s"),
    ("gyroscope z", "rad/s"),
];

fn column(row: &Row, k: usize) -> Option<f64> {
    if k < 3 { Some(row.acc[k]) } else { row.rate.map(|r| r[k - 3]) }
}

/// Looks at the sensors.
pub fn fit(sources: &[Source]) -> Result<Outcome, Refusal> {
    let [source] = sources else {
        return Err(Refusal::WrongKind {
            why: "fit imu takes one file: biases of different days do not mix".into(),
        });
    };
    let rows = rows(source)?;
    let rest = longest(&rows, |r| r.thrust_frac < REST_FRAC);
    let flight = longest(&rows, |r| r.thrust_frac > FLIGHT_FRAC);
    let length_s = |rows: &[Row]| match (rows.first(), rows.last()) {
        (Some(a), Some(b)) => b.t_s - a.t_s,
        _ => 0.0,
    };
    if length_s(rest) < LEAST_REST_S && length_s(flight) < LEAST_FLIGHT_S {
        return Err(Refusal::NotExcited {
            why: format!(
                "{:.1} s of rest and {:.1} s of flight in one piece, at least {LEAST_REST_S} or \
                 {LEAST_FLIGHT_S} s needed",
                length_s(rest),
                length_s(flight)
            ),
            program: Program::Imu,
        });
    }
    let mut outcome = Outcome::new(
        "imu",
        names(sources),
        "mean and scatter at rest; spectrum in flight with the line of the wing beat",
    );
    at_rest(&mut outcome, rest);
    in_flight(&mut outcome, flight);
    Ok(outcome)
}

fn at_rest(outcome: &mut Outcome, rest: &[Row]) {
    let t: Vec<f64> = rest.iter().map(|r| r.t_s).collect();
    let mut means: Vec<Option<Value>> = Vec::new();
    for (k, (name, unit)) in COLUMNS.into_iter().enumerate() {
        let values: Vec<f64> = rest.iter().filter_map(|r| column(r, k)).collect();
        let found = if values.len() == t.len() { imu::at_rest(&t, &values) } else { None };
        if let Some(found) = found {
            let what = if k < 3 { "mean at rest" } else { "bias" };
            outcome.parameter(format!("{name} {what}"), unit, found.mean);
            outcome.quality(format!("{name} noise at rest"), found.std, unit);
        }
        means.push(found.map(|f| f.mean));
    }
    if let [Some(x), Some(y), Some(z)] = means[..3] {
        let length = (x.value.powi(2) + y.value.powi(2) + z.value.powi(2)).sqrt();
        outcome.parameter(
            "length of the vector at rest less gravity",
            "m/s²",
            Value { value: length - G_MPS2, std: z.std, dof: z.dof },
        );
        outcome.notes.push(format!(
            "horizontal means at rest are lean and bias in one: {:.2} and {:.2} deg if all of it were \
             lean",
            (x.value / G_MPS2).asin().to_degrees(),
            (-y.value / G_MPS2).asin().to_degrees()
        ));
    } else {
        outcome.notes.push(format!("no rest of {LEAST_REST_S} s: no bias"));
    }
}

fn in_flight(outcome: &mut Outcome, flight: &[Row]) {
    let (Some(first), Some(last)) = (flight.first(), flight.last()) else { return };
    let rate_hz = (flight.len() - 1) as f64 / (last.t_s - first.t_s).max(1e-9);
    let mut shown = Vec::new();
    for (k, (name, unit)) in COLUMNS.into_iter().enumerate() {
        let values: Vec<f64> = flight.iter().filter_map(|r| column(r, k)).collect();
        let found =
            if values.len() == flight.len() { imu::vibration(rate_hz, &values) } else { None };
        let Some(found) = found else { continue };
        outcome.quality(format!("{name} in flight, one sigma"), found.std, unit);
        if let Some(line) = found.line {
            outcome.parameter(format!("{name} line"), "Hz", line.hz);
            outcome.quality(format!("{name} rms of the line"), line.rms, unit);
        } else {
            outcome.notes.push(format!("{name}: no line above {LEAST_LINE_HZ} Hz stands out"));
        }
        if k < 3 {
            shown.push(Series {
                name: name.into(),
                tone: Tone::Family(k as u8),
                mark: Mark::Line,
                points: found
                    .spectrum
                    .iter()
                    .skip(1)
                    .map(|[hz, density]| [*hz, density.max(1e-12).log10()])
                    .collect(),
            });
        }
    }
    if shown.is_empty() {
        outcome.notes.push(format!("no flight of {LEAST_FLIGHT_S} s in one piece: no spectrum"));
        return;
    }
    outcome.notes.push(format!(
        "{rate_hz:.0} samples a second: what beats above {:.0} Hz is folded down and cannot be told \
         from a true line",
        0.5 * rate_hz
    ));
    outcome.plots.push(Plot {
        title: "Spectrum of the accelerometer in flight".into(),
        x_label: "frequency, Hz".into(),
        y_label: "log10 of (m/s²)²/Hz".into(),
        series: shown,
        size_px: PLOT_PX,
        ..Plot::default()
    });
}

/// The longest piece of rows that a test holds for, cut to [`MOST_S`].
fn longest(rows: &[Row], holds: impl Fn(&Row) -> bool) -> &[Row] {
    let mut best = 0..0;
    let mut start = 0;
    for i in 0..=rows.len() {
        let on = i < rows.len()
            && holds(&rows[i])
            && (i == start || rows[i].t_s - rows[i - 1].t_s < 0.1);
        if on {
            continue;
        }
        if i - start > best.len() {
            best = start..i;
        }
        start = if i < rows.len() && holds(&rows[i]) { i } else { i + 1 };
    }
    let piece = &rows[best];
    let end_s = piece.first().map_or(0.0, |r| r.t_s + MOST_S);
    &piece[..piece.partition_point(|r| r.t_s <= end_s)]
}

fn rows(source: &Source) -> Result<Vec<Row>, Refusal> {
    match source {
        Source::Log { flight, .. } => {
            let first = flight.imu.first().map(|i| i.valid_at);
            let mut controls = flight.controls.iter().peekable();
            let mut thrust_frac = 0.0;
            let mut last_at = None;
            let mut rows: Vec<Row> = Vec::with_capacity(flight.imu.len());
            for i in &flight.imu {
                while let Some(c) = controls.next_if(|c| c.at <= i.valid_at) {
                    (thrust_frac, last_at) = (c.thrust_frac, Some(c.at));
                }
                // Without a control step for half a second nothing turns.
                let old = last_at.is_none_or(|at| i.valid_at.seconds_since(at) > 0.5);
                let t_s = first.map_or(0.0, |f| i.valid_at.seconds_since(f));
                if i.acc_B_mps2.is_finite() && rows.last().is_none_or(|r| t_s > r.t_s) {
                    rows.push(Row {
                        t_s,
                        acc: i.acc_B_mps2.to_array(),
                        rate: i.rate_B_radps.is_finite().then(|| i.rate_B_radps.to_array()),
                        thrust_frac: if old { 0.0 } else { thrust_frac },
                    });
                }
            }
            Ok(rows)
        }
        Source::Recording(r) => {
            let rows: Vec<Row> = r
                .rows
                .iter()
                .filter_map(|row| {
                    Some(Row {
                        t_s: row.t_s,
                        acc: row.acc_B_mps2?.to_array(),
                        rate: row.rate_B_radps.map(|v| v.to_array()),
                        thrust_frac: row.thrust_frac,
                    })
                })
                .collect();
            if rows.is_empty() {
                return Err(Refusal::WrongKind {
                    why: format!("{}: no accelerometer in this file", r.name),
                });
            }
            Ok(rows)
        }
        Source::Stand(s) => Err(Refusal::WrongKind {
            why: format!("{}: a thrust stand holds no inertial sensors", s.name),
        }),
    }
}
