//! Standard errors of least squares on a time series, whose noise is not white.
//!
//! What a filter or a loop leaves over lasts: an error of this instant is mostly the error of the
//! last one. Taken as white, a hundred samples a second promise ten times more than they know. Here
//! the noise is a first-order Gauss-Markov process plus white noise,
//!
//! ```text
//! cov(ε_i, ε_j) = σ²·[(1 − w)·e^(−|t_i − t_j|/τ) + w·δ_ij]
//! ```
//!
//! σ, τ and w are not known either. The fit stays ordinary least squares (a whitened one would live
//! on differences of neighbours and with them on the noise of the regressors); its covariance is
//! `(JᵀJ)⁻¹ JᵀΣJ (JᵀJ)⁻¹`, averaged over a grid of τ and w, even in their logarithms, with the
//! restricted likelihood of the residuals as weight: not knowing τ widens the interval instead of
//! being forgotten.
//!
//! **Symbols.** J sensitivity of the model to the parameters, a row per sample; Σ covariance of the
//! noise; t time, s. **Source.** Restricted likelihood: Patterson and Thompson, Biometrika 58
//! (1971). Whitening by a scalar Kalman filter: Jones, Technometrics 22 (1980). **Left out.** Noise
//! whose size changes within the series; a resonance of the loops: one that is small enough to be
//! overlooked leaves standard errors a tenth too small (`coverage.rs` holds that).

use nalgebra::DMatrix;

use super::linear::{Rows, inverse};
use super::value::Value;

/// Correlation times tried: from one sample to this share of the series. Longer ones could not be
/// told from the parameters themselves.
const LONGEST_SHARE: f64 = 0.3;
/// A gap of this many usual steps divides two flights.
const GAP_STEPS: f64 = 200.0;
/// Number of correlation times, evenly spaced in their logarithm.
const TAUS: usize = 13;
/// White noise is searched as its variance over that of the slow part's change per sample, between
/// these: none, and nothing else.
const RATIOS: [f64; 2] = [1e-2, 1e8];
/// Alternatives with less than this share of the weight are forgotten.
const LEAST_WEIGHT: f64 = 1e-4;
/// Looks at that ratio, and refinements between the two best.
const LOOKS: usize = 11;
const REFINEMENTS: usize = 5;

/// What was learned of the noise of a series: alternatives with their weight.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    alternatives: Vec<Alternative>,
    /// Samples less parameters of the series that it was learned on.
    dof: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Alternative {
    weight: f64,
    tau_s: f64,
    /// Share of white noise in the variance.
    white: f64,
    var: f64,
}

/// Covariance of fitted parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    /// Covariance of the parameters.
    pub matrix: DMatrix<f64>,
    /// Degrees of freedom per parameter.
    pub dof: Vec<f64>,
}

impl Covariance {
    /// The parameter `i` as a value.
    pub fn value(&self, i: usize, value: f64) -> Value {
        let var = self.matrix.get((i, i)).copied().unwrap_or(f64::NAN);
        Value { value, std: var.sqrt(), dof: self.dof.get(i).copied().unwrap_or(f64::NAN) }
    }

    /// A function of the parameters with this gradient.
    pub fn combine(&self, value: f64, gradient: &[f64]) -> Value {
        let mut var = 0.0;
        for (i, a) in gradient.iter().enumerate() {
            for (j, b) in gradient.iter().enumerate() {
                var += a * b * self.matrix.get((i, j)).copied().unwrap_or(f64::NAN);
            }
        }
        let dof = self.dof.iter().copied().fold(f64::INFINITY, f64::min);
        Value { value, std: var.max(0.0).sqrt(), dof }
    }
}

/// Covariance of the parameters of a least-squares fit with sensitivities `jacobian` and these
/// residuals at these times, s, ascending. `None`: the parameters are not determined, or there are
/// not more samples than parameters.
pub fn covariance(times_s: &[f64], jacobian: &Rows, residual: &[f64]) -> Option<Covariance> {
    Noise::learn(times_s, jacobian, residual)?.covariance(times_s, jacobian)
}

impl Noise {
    /// From the residuals of a fit with these sensitivities.
    pub fn learn(times_s: &[f64], jacobian: &Rows, residual: &[f64]) -> Option<Self> {
        Self::learn_within(times_s, jacobian, residual, f64::INFINITY)
    }

    /// The same where nothing in the noise can last longer than this, s.
    pub fn learn_within(
        times_s: &[f64],
        jacobian: &Rows,
        residual: &[f64],
        lasts_s: f64,
    ) -> Option<Self> {
        let n = times_s.len();
        let p = jacobian.width;
        if n != jacobian.len() || n != residual.len() || n < p + 2 || p == 0 {
            return None;
        }
        let (step_s, length_s) = stretch(times_s)?;
        let longest = (LONGEST_SHARE * length_s).min(lasts_s).max(2.0 * step_s);
        let ratio = (longest / step_s).powf(1.0 / (TAUS - 1) as f64);
        let mut found = Vec::with_capacity(TAUS);
        for k in 0..TAUS {
            let tau_s = step_s * ratio.powi(k as i32);
            let change = 1.0 - (-2.0 * step_s / tau_s).exp();
            let of = |ratio: f64| {
                let white = ratio * change;
                likelihood(times_s, jacobian, residual, tau_s, white / (1.0 + white))
            };
            found.extend(over_ratios(of).into_iter().map(|(l, width)| (l, tau_s, width)));
        }
        let best = found.iter().map(|f| f.0.log).fold(f64::NEG_INFINITY, f64::max);
        if !best.is_finite() {
            return None;
        }
        let mut alternatives: Vec<Alternative> = found
            .into_iter()
            .map(|(l, tau_s, width)| Alternative {
                weight: (l.log - best).exp() * width,
                tau_s,
                white: l.white,
                var: l.var,
            })
            .collect();
        let total: f64 = alternatives.iter().map(|a| a.weight).sum();
        alternatives.retain(|a| a.weight > LEAST_WEIGHT * total);
        let total: f64 = alternatives.iter().map(|a| a.weight).sum();
        alternatives.iter_mut().for_each(|a| a.weight /= total);
        Some(Self { alternatives, dof: (n - p) as f64 })
    }

    /// Standard deviation of the noise.
    pub fn std(&self) -> f64 {
        self.alternatives.iter().map(|a| a.weight * a.var).sum::<f64>().sqrt()
    }

    /// Time over which the noise lasts, s: the integral of its correlation from 0 on.
    pub fn lasts_s(&self) -> f64 {
        self.alternatives.iter().map(|a| a.weight * (1.0 - a.white) * a.tau_s).sum()
    }

    /// Covariance of the parameters of a least-squares fit with these sensitivities, of a series
    /// with this noise.
    pub fn covariance(&self, times_s: &[f64], jacobian: &Rows) -> Option<Covariance> {
        let p = jacobian.width;
        let bread = inverse(&jacobian.normal(None))?;
        let mut matrices = Vec::with_capacity(self.alternatives.len());
        for a in &self.alternatives {
            let correlated = correlate(times_s, jacobian, a.tau_s, a.white);
            let mut meat = DMatrix::zeros(p, p);
            for (row, other) in jacobian.iter().zip(correlated.iter()) {
                for (i, x) in row.iter().enumerate() {
                    for (j, y) in other.iter().enumerate() {
                        meat[(i, j)] += x * y;
                    }
                }
            }
            let matrix = &bread * meat * &bread * a.var;
            if matrix.iter().any(|c| !c.is_finite()) {
                return None;
            }
            matrices.push((a.weight, matrix));
        }
        let mut mean = DMatrix::zeros(p, p);
        matrices.iter().for_each(|(w, m)| mean += m * *w);
        // The scatter of ln(variance) is a lack of degrees of freedom: for χ²/ν it is 2/ν. The
        // variance that goes with Student's t is the geometric mean.
        let mut dof = Vec::with_capacity(p);
        let mut shrink = Vec::with_capacity(p);
        for i in 0..p {
            let log = |m: &DMatrix<f64>| m[(i, i)].max(f64::MIN_POSITIVE).ln();
            let centre: f64 = matrices.iter().map(|(w, m)| w * log(m)).sum();
            let scatter: f64 = matrices.iter().map(|(w, m)| w * (log(m) - centre).powi(2)).sum();
            dof.push(2.0 / (scatter + 2.0 / self.dof));
            shrink.push((centre.exp() / mean[(i, i)]).sqrt());
        }
        for i in 0..p {
            for j in 0..p {
                mean[(i, j)] *= shrink[i] * shrink[j];
            }
        }
        Some(Covariance { matrix: mean, dof })
    }
}

/// Usual time between samples, and the longest time without a gap: nothing lasts from one flight to
/// the next.
fn stretch(times_s: &[f64]) -> Option<(f64, f64)> {
    let mut steps: Vec<f64> = times_s.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    let usual_s = *steps.get(steps.len() / 2)?;
    if usual_s.is_nan() || usual_s <= 0.0 {
        return None;
    }
    let (mut longest_s, mut since_s) = (0.0f64, *times_s.first()?);
    for pair in times_s.windows(2) {
        if pair[1] - pair[0] > GAP_STEPS * usual_s {
            since_s = pair[1];
        }
        longest_s = longest_s.max(pair[1] - since_s);
    }
    Some((usual_s, longest_s.max(usual_s)))
}

/// Likelihoods over the ratio of white noise: a look over all sizes, then refinements about the best;
/// each with the width in ln(ratio) that it stands for.
fn over_ratios(of: impl Fn(f64) -> Option<Likely>) -> Vec<(Likely, f64)> {
    let [low, high] = RATIOS.map(f64::ln);
    let mut step = (high - low) / (LOOKS - 1) as f64;
    let mut found: Vec<(f64, Likely)> = Vec::with_capacity(LOOKS + 2 * REFINEMENTS);
    for k in 0..LOOKS {
        let x = low + step * k as f64;
        found.extend(of(x.exp()).map(|l| (x, l)));
    }
    for _ in 0..REFINEMENTS {
        step *= 0.5;
        let best = found.iter().max_by(|a, b| a.1.log.total_cmp(&b.1.log)).map(|b| b.0);
        let Some(centre) = best else { break };
        for x in [centre - step, centre + step] {
            if (low..=high).contains(&x) {
                found.extend(of(x.exp()).map(|l| (x, l)));
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at: Vec<f64> = found.iter().map(|f| f.0).collect();
    let width = |i: usize| {
        let before = if i == 0 { at[0] } else { at[i - 1] };
        let after = at.get(i + 1).copied().unwrap_or(at[i]);
        0.5 * (after - before)
    };
    found.iter().enumerate().map(|(i, f)| (f.1, width(i))).collect()
}

/// One point of the grid: logarithm of the likelihood, share of white noise, variance.
#[derive(Debug, Clone, Copy)]
struct Likely {
    log: f64,
    white: f64,
    var: f64,
}

/// Restricted log-likelihood of the residuals for one correlation time and one share of white
/// noise, that share, and the variance that goes with them.
fn likelihood(
    times_s: &[f64],
    jacobian: &Rows,
    residual: &[f64],
    tau_s: f64,
    white: f64,
) -> Option<Likely> {
    let (whitened, r, log_det) = whiten(times_s, jacobian, residual, tau_s, white);
    let factor = whitened.normal(None).cholesky()?;
    let log_det_normal: f64 = 2.0 * factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
    let mut right = nalgebra::DVector::zeros(jacobian.width);
    for (row, r) in whitened.iter().zip(&r) {
        for (a, x) in row.iter().enumerate() {
            right[a] += x * r;
        }
    }
    let explained = right.dot(&factor.solve(&right));
    let dof = (times_s.len() - jacobian.width) as f64;
    let var = (r.iter().map(|r| r * r).sum::<f64>() - explained).max(1e-300) / dof;
    let log = -0.5 * (dof * var.ln() + log_det + log_det_normal);
    log.is_finite().then_some(Likely { log, white, var })
}

/// Innovations of a scalar Kalman filter for this noise, of every column and of the residual, each
/// over its standard deviation; and the logarithm of the determinant of the correlation.
fn whiten(
    times_s: &[f64],
    jacobian: &Rows,
    residual: &[f64],
    tau_s: f64,
    white: f64,
) -> (Rows, Vec<f64>, f64) {
    let p = jacobian.width;
    let slow = 1.0 - white;
    let mut state = vec![0.0; p + 1];
    let mut var = slow;
    let mut log_det = 0.0;
    let mut before_s = times_s.first().copied().unwrap_or_default();
    let mut out = Vec::with_capacity(jacobian.flat.len());
    let mut r = Vec::with_capacity(residual.len());
    for ((t_s, row), res) in times_s.iter().zip(jacobian.iter()).zip(residual) {
        let keep = (-(t_s - before_s).max(0.0) / tau_s).exp();
        before_s = *t_s;
        var = keep * keep * var + slow * (1.0 - keep * keep);
        state.iter_mut().for_each(|x| *x *= keep);
        let total = var + white;
        let gain = var / total;
        let over = total.sqrt().recip();
        for (x, value) in state.iter_mut().zip(row.iter().chain([res])) {
            let innovation = value - *x;
            *x += gain * innovation;
            out.push(innovation * over);
        }
        r.push(out.pop().unwrap_or_default());
        var *= 1.0 - gain;
        log_det += total.ln();
    }
    (Rows { width: p, flat: out }, r, log_det)
}

/// Correlation matrix times the columns, by one pass forwards and one backwards.
fn correlate(times_s: &[f64], columns: &Rows, tau_s: f64, white: f64) -> Rows {
    let p = columns.width;
    let slow = 1.0 - white;
    let mut out: Vec<f64> = columns.flat.clone();
    let mut pass = |order: &mut dyn Iterator<Item = usize>| {
        let mut sum = vec![0.0; p];
        let mut before: Option<f64> = None;
        for i in order {
            let keep = before.map_or(0.0, |b| (-(times_s[i] - b).abs() / tau_s).exp());
            before = Some(times_s[i]);
            for a in 0..p {
                // What came before, seen from here; the sample itself is already in `out`.
                sum[a] *= keep;
                out[i * p + a] += slow * sum[a];
                sum[a] += columns.flat[i * p + a];
            }
        }
    };
    pass(&mut (0..times_s.len()));
    pass(&mut (0..times_s.len()).rev());
    Rows { width: p, flat: out }
}
