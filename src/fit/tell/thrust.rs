//! `haltere fit thrust`: the command that carries the weight, over battery voltage.
//!
//! **Logs**: hover, in means of half a second, upright part of the command. **Recordings**: the whole
//! flight, the command over the specific force it made: `u·g/(−f_z)` is what would have carried the
//! weight. **Thrust stand**: `T = k·u^p·V^q`, so that at equal thrust the command goes as V^(−q/p).
//!
//! **Symbols.** u command, share of full; V battery; f_z specific force along body z, m/s²; T thrust,
//! N. **Sag.** A burst of thrust pulls the voltage down within the same second. The voltage is
//! therefore averaged over ten seconds; what then is left of its range is discharge, and is told.

use nalgebra::DVector;

use super::drag::flown;
use super::{APART_S, PLOT_PX};
use crate::fit::correlated::covariance;
use crate::fit::ground::HIGH_M;
use crate::fit::linear::{Rows, inverse, r_squared, solve};
use crate::fit::outcome::{Outcome, Refusal, Table, number};
use crate::fit::polynomial::{self, OverVoltage};
use crate::fit::programs::Program;
use crate::fit::source::{Source, names};
use crate::fit::value::Value;
use crate::report::svg::{Mark, Plot, Series, Tone};
use haltere_core::control::voltage::VoltageConfig;
use haltere_core::frames::G_MPS2;
use haltere_log::import::motion;
use haltere_log::import::stand::{Stand, StandRow};

/// Voltage is averaged over this long before and after, s: longer than a swing of the loops, short
/// against the discharge.
const CALM_S: f64 = 5.0;
/// Least range of voltage that says something about it, share of the mean.
const LEAST_RANGE_FRAC: f64 = 0.05;
/// Means of a recording are taken over this many samples of 0.05 s.
const MEAN_SAMPLES: usize = 10;
/// Least specific force along −z that counts as carrying, m/s².
const CARRIES_MPS2: f64 = 3.0;
/// An exponent of command over voltage with a standard error above this is not told.
pub const TOLD: f64 = 0.3;
/// Half of the 95 % interval of the exponent above which no configuration is offered.
const DETERMINED: f64 = 0.35;
/// Rows of a stand below this command turn nothing, share of full …
const TURNS_FRAC: f64 = 0.1;
/// … or below this thrust, N: the drift of the scale.
const PULLS_N: f64 = 0.01;

/// Command that carries the weight, over voltage.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Columns {
    /// Times, s.
    pub t_s: Vec<f64>,
    /// Voltages, V.
    pub supply_v: Vec<f64>,
    /// Commands.
    pub frac: Vec<f64>,
}

impl Columns {
    /// Puts the mean voltage of the seconds around in the place of each. A burst of thrust pulls the
    /// voltage down at once: taken as it is, that sag looks like a law of its own, −3 instead of −1.
    pub fn calm_voltage(&mut self) {
        let n = self.t_s.len();
        let (mut begin, mut end) = (0, 0);
        let mut calm = Vec::with_capacity(n);
        for t_s in &self.t_s {
            while end < n && self.t_s[end] <= t_s + CALM_S {
                end += 1;
            }
            while self.t_s[begin] < t_s - CALM_S {
                begin += 1;
            }
            let near = &self.supply_v[begin..end];
            calm.push(near.iter().sum::<f64>() / near.len().max(1) as f64);
        }
        self.supply_v = calm;
    }

    fn push(&mut self, t_s: f64, supply_v: f64, frac: f64) {
        self.t_s.push(t_s);
        self.supply_v.push(supply_v);
        self.frac.push(frac);
    }
}

/// From samples of motion. Vertical drag is taken off the force first: `−f_z = T + k_z·w`, with k_z
/// from a regression of the force on command times voltage and on the speed w along body z.
pub fn of_samples(samples: &[motion::Sample]) -> Columns {
    let mut columns = Columns::default();
    let rows = Rows::from_fn(samples.len(), 2, |i, row| {
        let s = &samples[i];
        row.copy_from_slice(&[s.command_frac * s.supply_v, s.vel_B_mps.z()]);
    });
    let lift: Vec<f64> = samples.iter().map(|s| -s.force_B_mps2.z()).collect();
    let drag_per_s = solve(&rows, &lift, None).map_or(0.0, |beta| beta[1]);
    for group in samples.chunk_by(|a, b| b.t_s - a.t_s < 0.2) {
        for piece in group.chunks_exact(MEAN_SAMPLES) {
            let n = piece.len() as f64;
            let mean = |of: fn(&motion::Sample) -> f64| piece.iter().map(of).sum::<f64>() / n;
            let lift_mps2 = -mean(|s| s.force_B_mps2.z()) - drag_per_s * mean(|s| s.vel_B_mps.z());
            if lift_mps2 > CARRIES_MPS2 {
                let frac = mean(|s| s.command_frac) * G_MPS2 / lift_mps2;
                columns.push(mean(|s| s.t_s), mean(|s| s.supply_v), frac);
            }
        }
    }
    columns
}

/// Fits thrust.
pub fn fit(sources: &[Source]) -> Result<Outcome, Refusal> {
    let mut columns = Columns::default();
    let mut recordings = Vec::new();
    let mut stands = Vec::new();
    let mut offset_s = 0.0;
    for source in sources {
        match source {
            Source::Log { flight, config, .. } => {
                let lowest_m = HIGH_M + config.flight.gear_height_m;
                let means = crate::fit::columns::hover_means(flight, false);
                // Nearer to the floor it carries a part.
                for mean in means.iter().filter(|m| m.height_m >= lowest_m) {
                    columns.push(offset_s + mean.t_s, mean.supply_v, mean.thrust_frac);
                }
                offset_s = columns.t_s.last().copied().unwrap_or(0.0) + APART_S;
            }
            Source::Recording(r) => recordings.push(r),
            Source::Stand(s) => stands.push(s),
        }
    }
    let kinds = [!columns.t_s.is_empty(), !recordings.is_empty(), !stands.is_empty()];
    if kinds.iter().filter(|k| **k).count() > 1 {
        return Err(Refusal::WrongKind {
            why: "logs, recordings and thrust stands are fitted by different means: one kind at a \
                  time"
                .into(),
        });
    }
    if !stands.is_empty() {
        return from_stands(sources, &stands);
    }
    if !recordings.is_empty() {
        columns = of_samples(&flown(&recordings)?);
    }
    columns.calm_voltage();
    over_voltage(sources, &columns)
}

/// The pack of the vehicle that flew: as its log says, else the usual one.
pub fn pack(sources: &[Source]) -> VoltageConfig {
    let told = sources.iter().find_map(|source| match source {
        Source::Log { config, .. } => Some(config.control.voltage.clone()),
        _ => None,
    });
    told.unwrap_or_default()
}

fn over_voltage(sources: &[Source], columns: &Columns) -> Result<Outcome, Refusal> {
    let refuse = |why: String| Refusal::NotExcited { why, program: Program::Thrust };
    let n = columns.t_s.len();
    let fold = |of: fn(f64, f64) -> f64, start| columns.supply_v.iter().copied().fold(start, of);
    let (low, high) = (fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY));
    if n == 0 || high - low < LEAST_RANGE_FRAC * high {
        let range = if n == 0 { "no hover".into() } else { format!("{low:.2} to {high:.2} V") };
        return Err(refuse(format!(
            "{n} means of hover above {HIGH_M} m, {range}: a change of {:.0} % in voltage needed",
            LEAST_RANGE_FRAC * 100.0
        )));
    }
    let pack = pack(sources);
    let centre_v = pack.centre_v();
    let found = polynomial::fit(&columns.t_s, &columns.supply_v, &columns.frac, centre_v)
        .map_err(|why| refuse(why.to_string()))?;
    let mut outcome = Outcome::new(
        "thrust",
        names(sources),
        format!(
            "thrust command that carries the weight = y({centre_v} V)·(V/{centre_v})^n, and polynomials of V - {centre_v}"
        ),
    );
    outcome.parameter("exponent n", "", found.power.exponent);
    outcome.parameter(format!("command at {centre_v} V"), "of full", found.power.at_centre);
    outcome.quality("power law R²", found.power.r_squared, "");
    outcome.quality("power law rms of what is left", found.power.residual, "of full");
    outcome.quality("means of half a second", n as f64, "");
    let rows = found
        .polynomials
        .iter()
        .map(|p| {
            let mut row = vec![p.order.to_string()];
            row.extend((0..4).map(|k| {
                p.coefficients
                    .get(k)
                    .map_or(String::new(), |c| format!("{:.5} ± {:.5}", c.value, c.std))
            }));
            row.push(format!("{:.4}", p.r_squared));
            row.push(number(p.residual));
            row
        })
        .collect();
    outcome.tables.push(Table {
        title: "polynomials of the same, for comparison alone".into(),
        head: ["order", "c0", "c1", "c2", "c3", "R²", "rms"].map(String::from).to_vec(),
        rows,
    });
    outcome.notes.push(format!(
        "voltages from {low:.2} to {high:.2} V; what is said beyond them is the power law alone"
    ));
    outcome.plots.push(plot(columns, &found, [low, high]));
    let half_width = found.power.exponent.half_width(0.95);
    if half_width > DETERMINED {
        outcome.notes.push(format!(
            "the exponent is known to ± {half_width:.2} only (95 %, at most {DETERMINED} for a \
             snippet): beyond {low:.2} to {high:.2} V the law would be a guess; {}, or give several \
             flights at different voltages",
            Program::Thrust.advice()
        ));
        return Ok(outcome);
    }
    outcome.offer(format!(
        "# least-squares cubic of the power law over {:.1} to {:.1} V\n[control.voltage]\n\
         base_coefficients_frac = [{}]\n",
        pack.lowest_v(),
        pack.highest_v(),
        cubic(&found, &pack).map(|c| format!("{c:.6}")).join(", ")
    ));
    Ok(outcome)
}

/// The power law as the configuration takes it: a cubic over the whole range of the controller, so
/// that nothing extrapolates a polynomial.
fn cubic(found: &OverVoltage, pack: &VoltageConfig) -> [f64; 4] {
    let (low_v, high_v) = (pack.lowest_v(), pack.highest_v());
    let volts: Vec<f64> =
        (0..=48).map(|k| low_v + (high_v - low_v) / 48.0 * f64::from(k)).collect();
    let rows = Rows::from_fn(volts.len(), 4, |i, row| {
        row.iter_mut().zip(0..).for_each(|(x, k)| *x = (volts[i] - pack.centre_v()).powi(k));
    });
    let y: Vec<f64> = volts.iter().map(|v| found.power.at(*v)).collect();
    let beta = solve(&rows, &y, None).unwrap_or_default();
    std::array::from_fn(|k| beta.get(k).copied().unwrap_or(f64::NAN))
}

fn plot(columns: &Columns, found: &OverVoltage, [low, high]: [f64; 2]) -> Plot {
    let line = |of: &dyn Fn(f64) -> f64| {
        (0..=60)
            .map(|i| low + (high - low) * f64::from(i) / 60.0)
            .map(|v| [v, of(v)])
            .collect::<Vec<_>>()
    };
    let measured = Series {
        name: "measured".into(),
        tone: Tone::Family(0),
        mark: Mark::Dots,
        points: columns.supply_v.iter().zip(&columns.frac).map(|(v, u)| [*v, *u]).collect(),
    };
    let law = Series {
        name: format!("power {:.2}", found.power.exponent.value),
        tone: Tone::Command,
        mark: Mark::Line,
        points: line(&|v| found.power.at(v)),
    };
    Plot {
        title: "Command that carries the weight".into(),
        x_label: "battery, V".into(),
        y_label: "command, share of full".into(),
        series: vec![measured, law],
        size_px: PLOT_PX,
        ..Plot::default()
    }
}

/// `T = k·u^p·V^q`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandLaw {
    /// ln k, with T in N and V in volts.
    pub ln_k: f64,
    /// Exponent of the command.
    pub p: Value,
    /// Exponent of the voltage; 0 where it is left out.
    pub q: Value,
    /// Exponent of the command over voltage at equal thrust, −q/p.
    pub command: Value,
    /// Rms of what is left, N.
    pub residual_n: f64,
    /// Share of the variance that is explained.
    pub r_squared: f64,
}

impl StandLaw {
    /// Thrust, N.
    pub fn thrust_n(&self, row: &StandRow) -> f64 {
        (self.ln_k + self.p.value * row.command_frac.ln() + self.q.value * row.supply_v.ln()).exp()
    }
}

/// Rows of a stand on which something turns.
pub fn turning(stand: &Stand) -> Vec<StandRow> {
    let turns =
        |r: &&StandRow| r.command_frac > TURNS_FRAC && r.thrust_n > PULLS_N && r.supply_v > 1.0;
    stand.rows.iter().filter(turns).copied().collect()
}

/// Fits the law to the thrust itself: Gauss-Newton from the fit of the logarithms. Without
/// `with_voltage` q stays 0.
pub fn stand_law(rows: &[StandRow], with_voltage: bool) -> Option<StandLaw> {
    let width = if with_voltage { 3 } else { 2 };
    let row_of = |r: &StandRow, slot: &mut [f64]| {
        slot.iter_mut()
            .zip([1.0, r.command_frac.ln(), r.supply_v.ln()])
            .for_each(|(x, value)| *x = value);
    };
    let design = Rows::from_fn(rows.len(), width, |i, slot| row_of(&rows[i], slot));
    let logs: Vec<f64> = rows.iter().map(|r| r.thrust_n.ln()).collect();
    let thrust: Vec<f64> = rows.iter().map(|r| r.thrust_n).collect();
    let mut beta = solve(&design, &logs, None)?;
    for _ in 0..30 {
        let model: Vec<f64> = design.times(&beta).iter().map(|x| x.exp()).collect();
        let jacobian = scaled(&design, &model);
        let mut right = DVector::zeros(width);
        for ((row, m), t) in jacobian.iter().zip(&model).zip(&thrust) {
            row.iter().enumerate().for_each(|(k, x)| right[k] += x * (t - m));
        }
        let step = inverse(&jacobian.normal(None))? * right;
        beta.iter_mut().zip(step.iter()).for_each(|(b, s)| *b += s);
        if step.norm() < 1e-10 {
            break;
        }
    }
    let model: Vec<f64> = design.times(&beta).iter().map(|x| x.exp()).collect();
    let residual: Vec<f64> = thrust.iter().zip(&model).map(|(t, m)| t - m).collect();
    // No time in the table: the order of the rows stands for it.
    let order: Vec<f64> = (0..rows.len()).map(|i| i as f64).collect();
    let cov = covariance(&order, &scaled(&design, &model), &residual)?;
    let p = cov.value(1, beta[1]);
    let none = Value { value: 0.0, std: 0.0, dof: p.dof };
    let (q, command) = match beta.get(2) {
        Some(q) => (
            cov.value(2, *q),
            cov.combine(-q / p.value, &[0.0, q / (p.value * p.value), -1.0 / p.value]),
        ),
        None => (none, none),
    };
    let rms = (residual.iter().map(|r| r * r).sum::<f64>() / residual.len() as f64).sqrt();
    Some(StandLaw {
        ln_k: beta[0],
        p,
        q,
        command,
        residual_n: rms,
        r_squared: r_squared(&thrust, &residual),
    })
}

fn scaled(design: &Rows, model: &[f64]) -> Rows {
    let flat =
        design.iter().zip(model).flat_map(|(row, m)| row.iter().map(move |x| x * m)).collect();
    Rows { width: design.width, flat }
}

fn from_stands(sources: &[Source], stands: &[&Stand]) -> Result<Outcome, Refusal> {
    let rows: Vec<StandRow> = stands.iter().flat_map(|s| turning(s)).collect();
    let refuse = || Refusal::WrongKind {
        why: format!(
            "{}: {} rows with thrust, too few or at one voltage",
            names(sources).join(", "),
            rows.len()
        ),
    };
    let law = stand_law(&rows, true).ok_or_else(refuse)?;
    let plain = stand_law(&rows, false).ok_or_else(refuse)?;
    let mut outcome = Outcome::new(
        "thrust",
        names(sources),
        "thrust on the stand T = k·u^p·V^q; at equal thrust the command goes as V^(-q/p)",
    );
    outcome.parameter("exponent of the command p", "", law.p);
    outcome.parameter("exponent of the voltage q", "", law.q);
    outcome.parameter("exponent of command over voltage -q/p", "", law.command);
    outcome.quality("R²", law.r_squared, "");
    outcome.quality("rms of what is left", law.residual_n, "N");
    outcome.quality("rms without voltage", plain.residual_n, "N");
    outcome.quality("rows with thrust", rows.len() as f64, "");
    let (chosen, told) = if law.command.std > TOLD { (&plain, "without") } else { (&law, "with") };
    if law.command.std > TOLD {
        outcome.notes.push(format!(
            "the voltage is not told apart from the command here (exponent ± {:.1}): the load of one \
             ramp pulls it down, so both go together; a table of equal commands on a full and on an \
             empty battery would tell. Without voltage: T = k·u^p with p = {:.3} ± {:.3}",
            law.command.std, plain.p.value, plain.p.std
        ));
    }
    outcome.notes.push(
        "the rows carry no time: their order stands for it in the standard errors; the scale lags \
         the motors"
            .into(),
    );
    outcome.plots.push(Plot {
        title: format!("Thrust on the stand, {told} voltage"),
        x_label: "measured, N".into(),
        y_label: "law, N".into(),
        series: vec![Series {
            name: String::new(),
            tone: Tone::Estimate,
            mark: Mark::Dots,
            points: rows.iter().map(|r| [r.thrust_n, chosen.thrust_n(r)]).collect(),
        }],
        size_px: PLOT_PX,
        ..Plot::default()
    });
    Ok(outcome)
}
