//! `haltere fit drag`: from angle steps of our own logs, or from all of a recorded flight.
//!
//! **Steps.** Each held angle gives a transient (`super::transient`) and with it the speed that the
//! lean tends to; the speeds of several angles give the law (`super::steady`). Pitch and roll apart.
//!
//! **Recordings.** Motion capture gives specific force and speed in body axes. Thrust acts along −z of
//! the body, so along x and y there is nothing but drag and a constant of trim and reference:
//! `f_x = b_x − k_x·u`, `f_y = b_y − k_y·v`. **Symbols.** f m/s², u and v speed forward and right
//! m/s, k 1/s, b m/s². **Left out.** Drag of turning, wind; both widen the error.

use super::{APART_S, PLOT_PX};
use crate::fit::columns::{HeldStep, held_steps, hover_speeds};
use crate::fit::correlated::{Noise, covariance};
use crate::fit::linear::{Rows, r_squared, solve};
use crate::fit::outcome::{Outcome, Refusal, Table, number};
use crate::fit::programs::Program;
use crate::fit::source::{Source, names};
use crate::fit::steady::{self, Form, Point, Steady};
use crate::fit::transient::{self, Transient};
use crate::fit::value::Value;
use crate::report::svg::{Mark, Pin, Plot, Series, Tone};
use haltere_core::control::TiltAxis;
use haltere_core::control::drag::ASYMPTOTE_MOST_DEG;
use haltere_core::frames::G_MPS2;
use haltere_log::import::{Recording, motion};

/// Pieces of a fitted line in a plot.
const LINE_POINTS: i32 = 60;

/// Least spread of speed along an axis that shows drag, m/s rms.
const LEAST_RMS_MPS: f64 = 0.25;
/// Least hover that noise is learned from, s.
const NOISE_S: f64 = 8.0;
/// Standard errors by which a drag that pushes is no matter of noise.
const PUSHES: f64 = 5.0;

/// Names of the axes, and of the lean that drives along them.
const AXES: [(TiltAxis, &str); 2] = [(TiltAxis::Pitch, "pitch"), (TiltAxis::Roll, "roll")];

/// Fits drag.
pub fn fit(sources: &[Source], truth: bool) -> Result<Outcome, Refusal> {
    let mut logs = Vec::new();
    let mut recordings = Vec::new();
    for source in sources {
        match source {
            Source::Log { flight, config, .. } => logs.push((flight, config)),
            Source::Recording(r) => recordings.push(r),
            Source::Stand(s) => {
                return Err(Refusal::WrongKind {
                    why: format!("{}: a thrust stand shows no drag", s.name),
                });
            }
        }
    }
    if !logs.is_empty() && !recordings.is_empty() {
        return Err(Refusal::WrongKind {
            why: "logs and recordings are fitted by different means: one kind at a time".into(),
        });
    }
    if recordings.is_empty() {
        let mut steps = Vec::new();
        let mut noise = [None, None];
        for (flight, config) in &logs {
            steps.extend(held_steps(flight, &config.control.trims, truth));
            for (slot, (t, v)) in noise.iter_mut().zip(hover_speeds(flight, truth)) {
                if slot.is_none() {
                    *slot = noise_of(&t, &v);
                }
            }
        }
        return from_steps(sources, &steps, noise);
    }
    from_recordings(sources, &recordings)
}

/// Noise of a speed in hover.
fn noise_of(t_s: &[f64], v_mps: &[f64]) -> Option<Noise> {
    if t_s.last()? - t_s.first()? < NOISE_S {
        return None;
    }
    let mean = v_mps.iter().sum::<f64>() / v_mps.len() as f64;
    let residual: Vec<f64> = v_mps.iter().map(|v| v - mean).collect();
    Noise::learn(t_s, &Rows::from_fn(t_s.len(), 1, |_, row| row[0] = 1.0), &residual)
}

/// A step with its fitted transient.
struct Fitted<'a> {
    step: &'a HeldStep,
    from: usize,
    whole: Transient,
}

fn from_steps(
    sources: &[Source],
    steps: &[HeldStep],
    noise: [Option<Noise>; 2],
) -> Result<Outcome, Refusal> {
    let mut outcome = Outcome::new(
        "drag",
        names(sources),
        "v(t) = a - B·exp(-c·t) after each step, B = b·exp(d) of the source; then lean over final speed",
    );
    if noise.iter().any(Option::is_none) {
        outcome.notes.push(format!(
            "no hover of {NOISE_S} s to learn the noise of the speed from: errors are learned from \
             the steps themselves and may be too small"
        ));
    }
    let mut laws = 0;
    let mut rates = [None, None];
    let mut snippet = String::new();
    for (index, (axis, name)) in AXES.into_iter().enumerate() {
        let noise = noise[index].as_ref();
        let fitted: Vec<Fitted<'_>> = steps
            .iter()
            .filter(|s| s.axis == axis)
            .filter_map(|step| {
                let from = step.arrived();
                let (t, v) = (step.t_s.get(from..)?, step.speed_mps.get(from..)?);
                let whole = transient::fit_in_noise(t, v, 1.0, noise).ok()?;
                Some(Fitted { step, from, whole })
            })
            .collect();
        if fitted.is_empty() {
            continue;
        }
        shares_table(&mut outcome, name, &fitted, noise);
        transient_plot(&mut outcome, name, &fitted);
        let determined: Vec<&Fitted<'_>> = fitted.iter().filter(|f| f.whole.determined).collect();
        if determined.len() < fitted.len() {
            outcome.notes.push(format!(
                "{name}: {} of {} steps are too short to tell the final speed and are left out of \
                 the law",
                fitted.len() - determined.len(),
                fitted.len()
            ));
        }
        let points: Vec<Point> = determined
            .iter()
            .map(|f| Point {
                lean_deg: f.step.angle_rad.abs().to_degrees(),
                speed_mps: f.whole.a_mps.value,
                std_mps: f.whole.a_mps.std,
            })
            .collect();
        rates[index] = balance(&points);
        if let Some(rate) = rates[index] {
            outcome.parameter(format!("{name} drag, g·tan(lean)/v"), "1/s", rate);
        }
        match steady::fit(&points) {
            Ok(law) => {
                laws += 1;
                steady_outcome(&mut outcome, name, &law, &mut snippet);
            }
            Err(why) => outcome.notes.push(format!("{name}: no law of lean over speed: {why}")),
        }
    }
    if outcome.parameters.is_empty() {
        return Err(Refusal::NotExcited {
            why: format!(
                "no angle was held: {} held steps in {}",
                steps.len(),
                names(sources).join(", ")
            ),
            program: Program::Drag,
        });
    }
    if laws < AXES.len() {
        outcome.notes.push(format!("for both axes with a law: {}", Program::Drag.advice()));
    }
    let [x, y] = rates;
    if let (Some(x), Some(y)) = (x, y) {
        let header = format!(
            "# from {} angle steps; drag of the filter is the balance g·tan(lean) = k·v\n\
             [estimator]\ndrag_per_s = [{:.3}, {:.3}, 0.3]\n\n",
            steps.len(),
            x.value,
            y.value
        );
        outcome.offer(header + &snippet_of(&snippet));
    } else if !snippet.is_empty() {
        outcome.offer(snippet_of(&snippet));
    }
    Ok(outcome)
}

fn snippet_of(lines: &str) -> String {
    if lines.is_empty() {
        return String::new();
    }
    format!("[control.drag]\nreading = \"angle_of_velocity\"\n{lines}")
}

/// Drag rate of the balance `g·tan(lean) = k·v`, least squares over the speeds.
fn balance(points: &[Point]) -> Option<Value> {
    let n = points.len();
    if n < 2 {
        return None;
    }
    let weights: Vec<f64> = points.iter().map(|p| p.std_mps.max(1e-3).powi(-2)).collect();
    // v = (g·tan(lean))·m, m = 1/k.
    let rows = Rows::from_fn(n, 1, |i, row| {
        row[0] = G_MPS2 * points[i].lean_deg.to_radians().tan();
    });
    let v: Vec<f64> = points.iter().map(|p| p.speed_mps).collect();
    let m = solve(&rows, &v, Some(&weights))?[0];
    let model = rows.times(&[m]);
    let square: f64 =
        v.iter().zip(&model).zip(&weights).map(|((v, m), w)| w * (v - m).powi(2)).sum();
    let normal = rows.normal(Some(&weights))[(0, 0)];
    let dof = (n - 1) as f64;
    // Never less than what the points themselves state.
    let scale = (square / dof).max(1.0);
    let std_m = (scale / normal).sqrt();
    (m > 0.0).then(|| Value { value: 1.0 / m, std: std_m / (m * m), dof })
}

fn shares_table(outcome: &mut Outcome, name: &str, fitted: &[Fitted<'_>], noise: Option<&Noise>) {
    let head = ["angle deg", "held s", "a m/s", "±", "c 1/s", "±", "seen"]
        .into_iter()
        .map(String::from)
        .chain(transient::SHARES.map(|s| format!("a at {:.0} %", s * 100.0)))
        .collect();
    let rows = fitted
        .iter()
        .map(|f| {
            let (t, v) = (&f.step.t_s[f.from..], &f.step.speed_mps[f.from..]);
            let mut row = vec![
                format!("{:+.1}", f.step.angle_rad.to_degrees()),
                format!("{:.2}", f.step.t_s.last().copied().unwrap_or_default()),
                format!("{:.3}", f.whole.a_mps.value),
                format!("{:.3}", f.whole.a_mps.std),
                format!("{:.2}", f.whole.c_per_s.value),
                format!("{:.2}", f.whole.c_per_s.std),
                format!("{:.0} %", f.whole.seen_frac * 100.0),
            ];
            for share in transient::SHARES {
                row.push(match transient::fit_in_noise(t, v, share, noise) {
                    Ok(x) if x.determined => format!("{:.2}", x.a_mps.value),
                    Ok(x) => format!("({:.1})", x.a_mps.value),
                    Err(_) => "-".into(),
                });
            }
            row
        })
        .collect();
    outcome.tables.push(Table {
        title: format!(
            "{name} steps: fitted to all, then extrapolated from the first share of the data (in \
             brackets: not determined)"
        ),
        head,
        rows,
    });
}

/// Two steps whose angles add up to less than this go to both sides by the same, rad.
const MIRRORED_RAD: f64 = 0.01;

fn transient_plot(outcome: &mut Outcome, name: &str, fitted: &[Fitted<'_>]) {
    let mut series = Vec::new();
    let mut pins = Vec::new();
    for (k, f) in fitted.iter().enumerate() {
        let angle = f.step.angle_rad.to_degrees();
        series.push(Series {
            name: String::new(),
            tone: Tone::Family(k as u8),
            mark: Mark::Dots,
            points: f.step.t_s.iter().zip(&f.step.speed_mps).map(|(t, v)| [*t, *v]).collect(),
        });
        // Both directions of a step end at about one place: one name for them.
        let mirrored = |o: &Fitted<'_>| (o.step.angle_rad + f.step.angle_rad).abs() < MIRRORED_RAD;
        let other = fitted[..k].iter().any(mirrored);
        if let Some(t) = f.step.t_s.last().filter(|_| !other) {
            let name = if fitted[k..].iter().any(mirrored) {
                format!("\u{b1}{:.0}°", angle.abs())
            } else {
                format!("{angle:+.0}°")
            };
            pins.push(Pin { name, at: [*t, f.whole.at(*t)] });
        }
        series.push(Series {
            name: String::new(),
            tone: Tone::Family(k as u8),
            mark: Mark::Line,
            points: f.step.t_s[f.from..].iter().map(|t| [*t, f.whole.at(*t)]).collect(),
        });
    }
    outcome.plots.push(Plot {
        title: format!("{name}: speed after the step, and the fit"),
        x_label: "time, s".into(),
        y_label: "speed, m/s".into(),
        series,
        pins,
        size_px: PLOT_PX,
        ..Plot::default()
    });
}

fn steady_outcome(outcome: &mut Outcome, name: &str, law: &Steady, snippet: &mut String) {
    let mut rows = Vec::new();
    for l in &law.laws {
        rows.push(vec![
            format!("{}{}", l.form.name(), if l.form == law.chosen { " (chosen)" } else { "" }),
            format!("{:.3}", l.residual_mps),
            format!("{:.4}", l.r_squared),
            format!("{:.1}", l.aicc),
            l.parameters
                .iter()
                .map(|(n, v)| format!("{n} {} ± {}", number(v.value), number(v.std)))
                .chain(l.at_bound.then(|| "at a bound".to_owned()))
                .collect::<Vec<_>>()
                .join(", "),
        ]);
    }
    outcome.tables.push(Table {
        title: format!("{name}: forms of the law, the least AICc is chosen"),
        head: ["form", "rms m/s", "R²", "AICc", "parameters"].map(String::from).to_vec(),
        rows,
    });
    let [low, high] = law.tested_lean_deg;
    let [slow, fast] = law.tested_speed_mps;
    outcome.notes.push(format!(
        "{name}: tested from {low:.0} to {high:.0} deg and {slow:.2} to {fast:.2} m/s; beyond, the \
         law is a guess"
    ));
    let exponential = law.law(Form::AngleOfVelocity).and_then(|l| match l.parameters[..] {
        [(_, a), (_, b), (_, c)] => Some((l.at_bound, [a, b, c])),
        _ => None,
    });
    // What was not chosen stands in the table of forms alone.
    let chosen = law.law(law.chosen).into_iter().flat_map(|l| &l.parameters);
    if law.chosen == Form::AngleOfVelocity {
        for ((n, unit), (_, v)) in
            [("a", "deg"), ("b", "deg"), ("c", "s/m")].into_iter().zip(chosen)
        {
            outcome.parameter(format!("{name} {n}, lean = -(a + b·exp(-c·v))"), unit, *v);
        }
    } else {
        for (parameter, value) in chosen {
            outcome.parameter(format!("{name} {parameter}, {}", law.chosen.name()), "", *value);
        }
        outcome.notes.push(format!(
            "{name}: the configuration knows lean = -(a + b·exp(-c·v)) alone and gets the one nearest to the same points"
        ));
    }
    // At the near bound of the search speed does not grow with the lean, which is no law; at the far one it is a line.
    let configured = match exponential.map(|(at_bound, values)| (at_bound, values.map(|v| v.value)))
    {
        Some((true, [a, ..])) if a >= -ASYMPTOTE_MOST_DEG => None,
        Some((_, [a, b, c])) if a >= -ASYMPTOTE_MOST_DEG && b <= ASYMPTOTE_MOST_DEG => {
            Some([a, b, c])
        }
        _ => {
            let [c, off_mps] = law.through_rest(ASYMPTOTE_MOST_DEG);
            outcome.notes.push(format!(
                "{name}: over the angles flown the law is so straight that they do not tell its asymptote: the \
                 configuration gets the law through rest with the farthest one that it takes ({ASYMPTOTE_MOST_DEG} deg), \
                 which lies at most {off_mps:.2} m/s from the measured speeds"
            ));
            Some([-ASYMPTOTE_MOST_DEG, ASYMPTOTE_MOST_DEG, c])
        }
    };
    if let Some([a_deg, b_deg, c_s_per_m]) = configured {
        snippet.push_str(&format!(
            "{name} = {{ a_deg = {a_deg:.3}, b_deg = {b_deg:.3}, c_s_per_m = {c_s_per_m:.4} }}\n"
        ));
    }
    let mut series: Vec<Series> = law
        .law(law.chosen)
        .map(|l| Series {
            name: l.form.name().into(),
            tone: Tone::Command,
            mark: Mark::Line,
            points: (0..=60)
                .map(|i| low + (high - low) * f64::from(i) / 60.0)
                .map(|lean| [lean, l.speed_mps(lean)])
                .collect(),
        })
        .into_iter()
        .collect();
    series.push(Series {
        name: "held steps".into(),
        tone: Tone::Truth,
        mark: Mark::Dots,
        points: law.points.iter().map(|p| [p.lean_deg, p.speed_mps]).collect(),
    });
    outcome.plots.push(Plot {
        title: format!("{name}: v(lean)"),
        x_label: "lean, deg".into(),
        y_label: "speed, m/s".into(),
        series,
        size_px: PLOT_PX,
        ..Plot::default()
    });
}

/// Drag of a recording along one body axis, with the constant beside it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisDrag {
    /// Drag over mass, 1/s.
    pub rate_per_s: Value,
    /// Constant of trim and reference, m/s².
    pub constant_mps2: Value,
    /// Rms of the speed about its mean, m/s.
    pub spread_mps: f64,
    /// Largest speed, m/s.
    pub fastest_mps: f64,
    /// Share of the variance of the force that is explained.
    pub r_squared: f64,
    /// Rms of the force and of what is left, m/s².
    pub rms_mps2: [f64; 2],
}

/// Samples of several recordings after one another.
pub fn samples(recordings: &[&Recording]) -> Vec<motion::Sample> {
    let mut all: Vec<motion::Sample> = Vec::new();
    for recording in recordings {
        let offset_s = all.last().map_or(0.0, |s| s.t_s + APART_S);
        let (mut found, _) = motion::samples(recording);
        found.iter_mut().for_each(|s| s.t_s += offset_s);
        all.extend(found);
    }
    all
}

/// Drag along forward (0) or right (1). `None`: too few samples or no motion.
pub fn along(samples: &[motion::Sample], axis: usize) -> Option<AxisDrag> {
    let v: Vec<f64> = samples.iter().map(|s| s.vel_B_mps[axis]).collect();
    let f: Vec<f64> = samples.iter().map(|s| s.force_B_mps2[axis]).collect();
    let t: Vec<f64> = samples.iter().map(|s| s.t_s).collect();
    let n = v.len().max(1) as f64;
    let mean = v.iter().sum::<f64>() / n;
    let spread_mps = (v.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
    let rows = Rows::from_fn(v.len(), 2, |i, row| row.copy_from_slice(&[1.0, -v[i]]));
    let beta = solve(&rows, &f, None)?;
    let residual: Vec<f64> = rows.times(&beta).iter().zip(&f).map(|(m, f)| f - m).collect();
    let cov = covariance(&t, &rows, &residual)?;
    let centre = f.iter().sum::<f64>() / n;
    let rms =
        |values: &mut dyn Iterator<Item = f64>| (values.map(|r| r * r).sum::<f64>() / n).sqrt();
    Some(AxisDrag {
        rate_per_s: cov.value(1, beta[1]),
        constant_mps2: cov.value(0, beta[0]),
        spread_mps,
        fastest_mps: v.iter().fold(0.0, |m, v| m.max(v.abs())),
        r_squared: r_squared(&f, &residual),
        rms_mps2: [rms(&mut f.iter().map(|f| f - centre)), rms(&mut residual.iter().copied())],
    })
}

/// The same, refused with what is likely where nothing flies.
pub(super) fn flown(recordings: &[&Recording]) -> Result<Vec<motion::Sample>, Refusal> {
    let samples = samples(recordings);
    let likely = recordings.iter().filter_map(|recording| {
        let why = motion::why_none_flies(recording)?;
        Some(format!("{}: no sample in the air: {why}", recording.name))
    });
    let likely: Vec<String> = likely.collect();
    if samples.is_empty() && !likely.is_empty() {
        return Err(Refusal::WrongKind { why: likely.join("; ") });
    }
    Ok(samples)
}

fn from_recordings(sources: &[Source], recordings: &[&Recording]) -> Result<Outcome, Refusal> {
    let samples = flown(recordings)?;
    let mut outcome = Outcome::new(
        "drag",
        names(sources),
        "force along the body over mass: f = b - k·v, from motion capture, body x (forward) and y (right)",
    );
    let mut rates = [0.0; 2];
    for (axis, name) in ["forward", "sideways"].into_iter().enumerate() {
        let found = along(&samples, axis).filter(|d| d.spread_mps >= LEAST_RMS_MPS);
        let Some(d) = found else {
            return Err(Refusal::NotExcited {
                why: format!(
                    "{name}: {} samples in the air whose speed spreads by less than \
                     {LEAST_RMS_MPS} m/s: drag does not show",
                    samples.len()
                ),
                program: Program::Drag,
            });
        };
        let Value { value, std, .. } = d.rate_per_s;
        if value < -PUSHES * std {
            let (column, positive) =
                [("pitch_deg", "nose up"), ("roll_deg", "right side down")][axis];
            return Err(Refusal::WrongKind {
                why: format!(
                    "{name}: a drag of {value:.2} ± {std:.2} 1/s, which pushes the vehicle on: is the sign of {column} \
                     right (ned-frd: {positive} positive; docs/IMPORT.md), and do its axes match the positions?"
                ),
            });
        }
        rates[axis] = d.rate_per_s.value;
        outcome.parameter(format!("{name} drag k"), "1/s", d.rate_per_s);
        outcome.parameter(format!("{name} constant b"), "m/s²", d.constant_mps2);
        outcome.quality(format!("{name} R²"), d.r_squared, "");
        outcome.quality(format!("{name} rms of the force"), d.rms_mps2[0], "m/s²");
        outcome.quality(format!("{name} rms of what is left"), d.rms_mps2[1], "m/s²");
        outcome.notes.push(format!(
            "{name}: speeds up to {:.1} m/s, {:.2} m/s rms; beyond, the line is a guess",
            d.fastest_mps, d.spread_mps
        ));
        let (low, high) = samples
            .iter()
            .map(|s| s.vel_B_mps[axis])
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        outcome.plots.push(Plot {
            title: format!("{name}: force over speed"),
            x_label: "speed, m/s".into(),
            y_label: "force over mass, m/s²".into(),
            series: vec![
                Series {
                    name: "measured".into(),
                    tone: Tone::Family(0),
                    mark: Mark::Dots,
                    points: samples
                        .iter()
                        .map(|s| [s.vel_B_mps[axis], s.force_B_mps2[axis]])
                        .collect(),
                },
                Series {
                    name: "b - k·v".into(),
                    tone: Tone::Command,
                    mark: Mark::Line,
                    // Many points: the plot leaves out single ones that lie beyond its axes.
                    points: (0..=LINE_POINTS)
                        .map(|k| low + (high - low) * f64::from(k) / f64::from(LINE_POINTS))
                        .map(|v| [v, d.constant_mps2.value - d.rate_per_s.value * v])
                        .collect(),
                },
            ],
            size_px: PLOT_PX,
            ..Plot::default()
        });
    }
    let c = rates.map(exponential_of);
    outcome.offer(format!(
        "# c is that of a + b·exp(-c·v) nearest to atan(k·v/g) over 0 to 2 m/s\n\
         [estimator]\ndrag_per_s = [{:.3}, {:.3}, 0.3]\n\n[control.drag]\n\
         reading = \"angle_of_velocity\"\n\
         pitch = {{ a_deg = -90.0, b_deg = 90.0, c_s_per_m = {:.4} }}\n\
         roll = {{ a_deg = -90.0, b_deg = 90.0, c_s_per_m = {:.4} }}\n",
        rates[0], rates[1], c[0], c[1]
    ));
    Ok(outcome)
}

/// c of `90·(1 − e^(−c·v))` nearest to the lean that drag of this rate takes, over 0 to 2 m/s.
fn exponential_of(rate_per_s: f64) -> f64 {
    transient::search([0.005, 5.0], |c| {
        (1..=20)
            .map(|k| {
                let v = 0.1 * f64::from(k);
                let lean_deg = (rate_per_s * v / G_MPS2).atan().to_degrees();
                (90.0 * (1.0 - (-c * v).exp()) - lean_deg).powi(2)
            })
            .sum()
    })
}
