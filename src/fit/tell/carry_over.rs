//! `haltere fit carry-over`: does what one flight taught hold on flights it has not seen?
//!
//! **Flights.** Two models are fitted on one recorded flight and judged on others: thrust that goes
//! with the voltage against thrust that does not (mean of the vertical force), and drag linear in
//! speed against no drag (rms of the horizontal force). The exponent of the voltage is the one of
//! physics, −1, unless the flight tells a better one: its own is used when its standard error is
//! below `TOLD`.
//!
//! ```text
//! vertical     −f_z = g·u/y(V),  y = y0·(V/7.4)^n   against   −f_z = g·u/y0'
//! horizontal   f = b − k·v                           against   f = b'
//! ```
//!
//! **Stands.** The law of thrust fitted on one table, with and without voltage, on another.

use serde::Serialize;

use super::drag::{along, flown};
use super::thrust::{of_samples, stand_law, turning};
use crate::fit::outcome::{Outcome, Refusal, Table};
use crate::fit::polynomial;
use crate::fit::programs::Program;
use crate::fit::source::Source;
use haltere_core::frames::G_MPS2;
use haltere_log::import::{Recording, motion};

/// An exponent whose standard error is above this is not told by the flight.
const TOLD: f64 = 0.05;
/// Voltage that commands are told at, V: two cells, as the recordings have.
const CENTRE_V: f64 = 7.4;
/// Exponent of physics: thrust at the same product of command and voltage.
const PHYSICS: f64 = -1.0;

/// How far an unseen flight came down.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cut {
    /// Without the model.
    pub before: f64,
    /// With it.
    pub after: f64,
}

impl Cut {
    /// Share that is gone.
    pub fn gone(&self) -> f64 {
        1.0 - self.after / self.before
    }
}

/// What the models leave on one unseen flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unseen {
    /// Name.
    pub name: String,
    /// Magnitude of the mean vertical force that is left, m/s².
    pub vertical_mean_mps2: Cut,
    /// Rms of the horizontal force, forward and right together, m/s².
    pub horizontal_rms_mps2: Cut,
    /// The same forward and right.
    pub axes_rms_mps2: [Cut; 2],
}

/// Two models of a flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Models {
    /// Command at 7.4 V and the exponent.
    pub at_centre_frac: f64,
    /// Exponent of the voltage.
    pub exponent: f64,
    /// Whether the flight told it; else physics did.
    pub exponent_told: bool,
    /// Command without voltage.
    pub plain_frac: f64,
    /// Drag forward and right, 1/s.
    pub drag_per_s: [f64; 2],
    /// Constant beside the drag, m/s².
    pub constant_mps2: [f64; 2],
    /// Constant without drag, m/s².
    pub plain_mps2: [f64; 2],
}

/// Fits both models. `None`: the flight is too short.
pub fn models(samples: &[motion::Sample]) -> Option<Models> {
    let mut columns = of_samples(samples);
    columns.calm_voltage();
    let found = polynomial::fit(&columns.t_s, &columns.supply_v, &columns.frac, CENTRE_V).ok();
    let told = found.as_ref().map(|f| f.power.exponent).filter(|e| e.std < TOLD);
    let exponent = told.map_or(PHYSICS, |e| e.value);
    let n = samples.len().max(1) as f64;
    // y such that the mean vertical force of this very flight is met: Σ f_z = 0 of the residual.
    let carried: f64 = samples.iter().map(|s| -s.force_B_mps2.z()).sum::<f64>() / n;
    let asked = |of: &dyn Fn(&motion::Sample) -> f64| {
        samples.iter().map(|s| G_MPS2 * s.command_frac / of(s)).sum::<f64>() / n / carried
    };
    let at_centre_frac = asked(&|s| (s.supply_v / CENTRE_V).powf(exponent));
    let plain_frac = asked(&|_| 1.0);
    let axes = [along(samples, 0)?, along(samples, 1)?];
    let mean = |axis: usize| samples.iter().map(|s| s.force_B_mps2[axis]).sum::<f64>() / n;
    Some(Models {
        at_centre_frac,
        exponent,
        exponent_told: told.is_some(),
        plain_frac,
        drag_per_s: axes.map(|a| a.rate_per_s.value),
        constant_mps2: axes.map(|a| a.constant_mps2.value),
        plain_mps2: [mean(0), mean(1)],
    })
}

/// Judges the models on another flight.
pub fn judge(models: &Models, name: &str, samples: &[motion::Sample]) -> Unseen {
    let n = samples.len().max(1) as f64;
    let vertical = |of: &dyn Fn(&motion::Sample) -> f64| {
        let left = samples.iter().map(|s| s.force_B_mps2.z() + G_MPS2 * s.command_frac / of(s));
        (left.sum::<f64>() / n).abs()
    };
    let rms = |axis: usize, of: &dyn Fn(&motion::Sample) -> f64| {
        (samples.iter().map(|s| (s.force_B_mps2[axis] - of(s)).powi(2)).sum::<f64>() / n).sqrt()
    };
    let axes_rms_mps2: [Cut; 2] = std::array::from_fn(|axis| Cut {
        before: rms(axis, &|_| models.plain_mps2[axis]),
        after: rms(axis, &|s| {
            models.constant_mps2[axis] - models.drag_per_s[axis] * s.vel_B_mps[axis]
        }),
    });
    let [x, y] = axes_rms_mps2;
    Unseen {
        name: name.to_owned(),
        vertical_mean_mps2: Cut {
            before: vertical(&|_| models.plain_frac),
            after: vertical(&|s| {
                models.at_centre_frac * (s.supply_v / CENTRE_V).powf(models.exponent)
            }),
        },
        horizontal_rms_mps2: Cut {
            before: x.before.hypot(y.before),
            after: x.after.hypot(y.after),
        },
        axes_rms_mps2,
    }
}

/// Fits on the first source, judges on the others.
pub fn fit(train: &Source, tests: &[Source]) -> Result<Outcome, Refusal> {
    let mut outcome = Outcome::new(
        "carry-over",
        vec![format!("fitted on {}", train.name())],
        "models of one file on files that the fit has not seen",
    );
    match train {
        Source::Recording(recording) => {
            let flights = of_kind(tests, |s| match s {
                Source::Recording(r) => Some(r),
                _ => None,
            })?;
            of_flights(&mut outcome, recording, &flights)?;
        }
        Source::Stand(stand) => {
            let tables = of_kind(tests, |s| match s {
                Source::Stand(s) => Some(s),
                _ => None,
            })?;
            let none =
                || Refusal::WrongKind { why: format!("{}: too few rows with thrust", stand.name) };
            let rows = turning(stand);
            let law = stand_law(&rows, true).ok_or_else(none)?;
            let plain = stand_law(&rows, false).ok_or_else(none)?;
            outcome.parameter("exponent of the command, no voltage", "", plain.p);
            outcome.parameter("exponent of command over voltage", "", law.command);
            outcome.quality("rms on the table itself, no voltage", plain.residual_n, "N");
            if law.command.std > super::thrust::TOLD {
                outcome.notes.push(
                    "the table does not tell voltage from command (see `fit thrust`): the law without \
                     voltage is the one to carry"
                        .into(),
                );
            }
            let mut lines = Vec::new();
            for table in tables {
                let unseen = turning(table);
                let n = unseen.len().max(1) as f64;
                let rms = |law: &super::thrust::StandLaw| {
                    let square: f64 =
                        unseen.iter().map(|r| (r.thrust_n - law.thrust_n(r)).powi(2)).sum();
                    (square / n).sqrt()
                };
                let cut = Cut { before: rms(&plain), after: rms(&law) };
                lines.push(vec![
                    table.name.clone(),
                    unseen.len().to_string(),
                    format!("{:.4}", cut.before),
                    format!("{:.4}", cut.after),
                    format!("{:.0} %", cut.gone() * 100.0),
                ]);
            }
            outcome.tables.push(Table {
                title: "rms of thrust on unseen tables, N".into(),
                head: ["table", "rows", "without voltage", "with", "gone"]
                    .map(String::from)
                    .to_vec(),
                rows: lines,
            });
        }
        Source::Log { name, .. } => {
            return Err(Refusal::WrongKind {
                why: format!(
                    "{name} is our own log: its velocities come from a filter that holds a drag model \
                     itself, so nothing would be proven; give recordings with motion capture"
                ),
            });
        }
    }
    Ok(outcome)
}

fn of_kind<'a, T>(
    tests: &'a [Source],
    pick: impl Fn(&'a Source) -> Option<&'a T>,
) -> Result<Vec<&'a T>, Refusal> {
    tests
        .iter()
        .map(|s| {
            pick(s).ok_or_else(|| Refusal::WrongKind {
                why: format!("{} is {}, another kind than the first file", s.name(), s.kind()),
            })
        })
        .collect()
}

fn of_flights(
    outcome: &mut Outcome,
    train: &Recording,
    tests: &[&Recording],
) -> Result<(), Refusal> {
    let samples = flown(&[train])?;
    let models = models(&samples).ok_or_else(|| Refusal::NotExcited {
        why: format!(
            "{}: {} samples in the air, too few or without motion",
            train.name,
            samples.len()
        ),
        program: Program::Drag,
    })?;
    let [x, y] = [along(&samples, 0), along(&samples, 1)];
    for (name, axis) in [("forward drag", x), ("sideways drag", y)] {
        if let Some(axis) = axis {
            outcome.parameter(name, "1/s", axis.rate_per_s);
        }
    }
    outcome.notes.push(format!(
        "exponent of the voltage {:.3}, {}",
        models.exponent,
        if models.exponent_told {
            "told by the flight"
        } else {
            "that of physics: one flight spans too little voltage to tell it"
        }
    ));
    let mut rows = Vec::new();
    for test in tests {
        let (samples, _) = motion::samples(test);
        let unseen = judge(&models, &test.name, &samples);
        let cut = |c: &Cut| {
            [
                format!("{:.3}", c.before),
                format!("{:.3}", c.after),
                format!("{:.0} %", c.gone() * 100.0),
            ]
        };
        rows.push(
            [unseen.name.clone()]
                .into_iter()
                .chain(cut(&unseen.vertical_mean_mps2))
                .chain(cut(&unseen.horizontal_rms_mps2))
                .chain(cut(&unseen.axes_rms_mps2[0]))
                .chain(cut(&unseen.axes_rms_mps2[1]))
                .collect(),
        );
        let name = &unseen.name;
        outcome.quality(
            format!("{name}: vertical mean gone"),
            unseen.vertical_mean_mps2.gone(),
            "",
        );
        outcome.quality(
            format!("{name}: horizontal rms gone"),
            unseen.horizontal_rms_mps2.gone(),
            "",
        );
    }
    outcome.tables.push(Table {
        title: "left on unseen flights, m/s²: without the model, with it, and the share gone"
            .into(),
        head: [
            "flight",
            "vertical mean",
            "with",
            "gone",
            "horizontal rms",
            "with",
            "gone",
            "forward",
            "with",
            "gone",
            "right",
            "with",
            "gone",
        ]
        .map(String::from)
        .to_vec(),
        rows,
    });
    Ok(())
}
