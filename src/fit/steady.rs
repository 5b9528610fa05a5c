//! Speed held by a lean: the source's saturating exponential against a line and a parabola.
//!
//! **Forms**, with the lean ℓ in degrees and the speed v in m/s, both counted towards the motion:
//!
//! ```text
//! angle_of_velocity   ℓ = −(a + b·e^(−c·v))      solved for v: v = −ln((−a − ℓ)/b)/c
//! velocity_of_angle   v = a + b·e^(c·ℓ)
//! linear              v = p0 + p1·ℓ
//! quadratic           v = p0 + p1·ℓ + p2·ℓ²
//! ```
//!
//! The lean is commanded and known, the speed is measured: every form is fitted for the speed, so
//! that they compare. **Choice.** The least AICc, `n·ln(χ²/n) + 2k + 2k(k+1)/(n−k−1)` with k
//! parameters and the variance (Hurvich and Tsai, Biometrika 76, 1989): with the five to ten points
//! of such a test plain AIC would take the form with most parameters. **Standard errors** from the
//! scatter of the points about the form; what each point states is taken as its weight only.
//!
//! **Left out.** Trim: a wrong one shifts ℓ. Fly both sides and fold them; half of it cancels.

use serde::Serialize;

use super::correlated::Covariance;
use super::linear::{Rows, inverse, r_squared, solve};
use super::transient::search;
use super::value::Value;
use haltere_core::frames::G_MPS2;

/// Fewest points: the exponential has three parameters, and scatter needs one more.
pub const LEAST_POINTS: usize = 4;
/// The asymptote is searched from this factor over the largest lean to this angle, deg; there the
/// form is a line within the accuracy of any test.
const ASYMPTOTE: [f64; 2] = [1.02, 2000.0];
/// The exponent per degree is searched between these, either sign, 1/deg.
const EXPONENT_PER_DEG: [f64; 2] = [1e-4, 0.2];

/// One angle: the lean and the speed it ended at.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Point {
    /// Lean towards the motion, deg.
    pub lean_deg: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
    /// One sigma of it, m/s; only its size relative to the other points counts. Zero: all alike.
    pub std_mps: f64,
}

/// Form of the law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// Saturating exponential of the source, angle over speed.
    AngleOfVelocity,
    /// The same function, speed over angle.
    VelocityOfAngle,
    /// Straight line.
    Linear,
    /// Parabola.
    Quadratic,
}

impl Form {
    /// As people call it.
    pub fn name(self) -> &'static str {
        match self {
            Form::AngleOfVelocity => "exp, angle of v",
            Form::VelocityOfAngle => "exp, v of angle",
            Form::Linear => "line",
            Form::Quadratic => "parabola",
        }
    }
}

/// One fitted form.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Law {
    /// Which.
    pub form: Form,
    /// Parameters in the order of the equation, with their names.
    pub parameters: Vec<(&'static str, Value)>,
    /// Drag over mass for small speeds, 1/s: `g·dℓ/dv` at rest, with the lean in radians.
    pub drag_per_s: Value,
    /// Rms of what is left, m/s, weighted.
    pub residual_mps: f64,
    /// Share of the variance that is explained.
    pub r_squared: f64,
    /// The criterion: the least is chosen.
    pub aicc: f64,
    /// A parameter ran to the end of its search: the form is its own limit.
    pub at_bound: bool,
}

/// Every form, and which is chosen.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Steady {
    /// Points, as given.
    pub points: Vec<Point>,
    /// Forms that could be fitted.
    pub laws: Vec<Law>,
    /// The one with the least AICc.
    pub chosen: Form,
    /// Leans that were tested, deg: the law holds in between.
    pub tested_lean_deg: [f64; 2],
    /// Speeds that were reached, m/s.
    pub tested_speed_mps: [f64; 2],
}

/// Why there is no law.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SteadyError {
    /// Too few points.
    #[error("{found} angles, at least {LEAST_POINTS} different ones needed")]
    TooFew {
        /// Found.
        found: usize,
    },
    /// Not finite or not towards the motion.
    #[error("leans and speeds must be positive numbers: counted towards the motion")]
    BadData,
    /// Nothing fits.
    #[error("no form can be fitted to these points")]
    NoFit,
}

impl Steady {
    /// The law of a form.
    pub fn law(&self, form: Form) -> Option<&Law> {
        self.laws.iter().find(|l| l.form == form)
    }

    /// The law through rest with its asymptote given, for points on so straight a line that they do not tell one.
    ///
    /// The source's law is lean = -(a + b·exp(-c·v)) with lean in deg, counted towards the motion, and v the steady speed in
    /// m/s, both in the heading frame (IMAV 2021, drag of the angle). No lean at no speed makes b = -a = A, so
    /// v = -ln(1 - lean/A)/c: a line through zero in x = -ln(1 - lean/A), whose slope 1/c is found by least squares with
    /// weights 1/std², or even ones where a point has no standard error. With A far beyond the leans c·A is the slope, deg per
    /// m/s, and A does not matter. Answer: c in s/m, and the largest distance of a point from the law in m/s.
    pub fn through_rest(&self, asymptote_deg: f64) -> [f64; 2] {
        let even = self.points.iter().any(|p| p.std_mps <= 0.0);
        let at = |p: &Point| -(1.0 - p.lean_deg / asymptote_deg).ln();
        let [xv, xx] = self.points.iter().fold([0.0; 2], |[xv, xx], p| {
            let (x, w) = (at(p), if even { 1.0 } else { p.std_mps.powi(-2) });
            [xv + w * x * p.speed_mps, xx + w * x * x]
        });
        let off = |p: &Point| (p.speed_mps - at(p) * xv / xx).abs();
        [xx / xv, self.points.iter().map(off).fold(0.0, f64::max)]
    }

    /// The exponential that a configuration can hold: the better of the two readings.
    pub fn exponential(&self) -> Option<&Law> {
        let ok = |l: &&Law| matches!(l.form, Form::AngleOfVelocity | Form::VelocityOfAngle);
        self.laws.iter().filter(ok).min_by(|a, b| a.aicc.total_cmp(&b.aicc))
    }
}

impl Law {
    /// Speed at this lean, m/s.
    pub fn speed_mps(&self, lean_deg: f64) -> f64 {
        let p: Vec<f64> = self.parameters.iter().map(|p| p.1.value).collect();
        match (self.form, &p[..]) {
            (Form::AngleOfVelocity, [a, b, c]) => -((-a - lean_deg) / b).ln() / c,
            (Form::VelocityOfAngle, [a, b, c]) => a + b * (c * lean_deg).exp(),
            (Form::Linear, [p0, p1]) => p0 + p1 * lean_deg,
            (Form::Quadratic, [p0, p1, p2]) => p0 + lean_deg * (p1 + lean_deg * p2),
            _ => f64::NAN,
        }
    }
}

/// Fits every form to the points of one axis.
pub fn fit(points: &[Point]) -> Result<Steady, SteadyError> {
    let good = |p: &Point| {
        p.lean_deg > 0.0 && p.lean_deg.is_finite() && p.speed_mps.is_finite() && p.std_mps >= 0.0
    };
    if !points.iter().all(good) {
        return Err(SteadyError::BadData);
    }
    let mut leans: Vec<f64> = points.iter().map(|p| p.lean_deg).collect();
    leans.sort_by(f64::total_cmp);
    leans.dedup_by(|a, b| (*a - *b).abs() < 0.5);
    if leans.len() < LEAST_POINTS {
        return Err(SteadyError::TooFew { found: leans.len() });
    }
    let even = points.iter().any(|p| p.std_mps <= 0.0);
    let mut weights: Vec<f64> =
        points.iter().map(|p| if even { 1.0 } else { p.std_mps.powi(-2) }).collect();
    // Mean weight one: χ² is then in (m/s)².
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    weights.iter_mut().for_each(|w| *w /= mean);
    let data = Data { points, weights: &weights };
    let mut laws: Vec<Law> = [data.angle_of_velocity(), data.velocity_of_angle()]
        .into_iter()
        .chain([data.polynomial(1), data.polynomial(2)])
        .flatten()
        .collect();
    laws.retain(|l| l.parameters.iter().all(|p| p.1.value.is_finite()));
    let chosen = laws
        .iter()
        .filter(|l| !l.at_bound)
        .min_by(|a, b| a.aicc.total_cmp(&b.aicc))
        .map(|l| l.form)
        .ok_or(SteadyError::NoFit)?;
    let range = |of: fn(&Point) -> f64| {
        points
            .iter()
            .map(of)
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    };
    Ok(Steady {
        points: points.to_vec(),
        laws,
        chosen,
        tested_lean_deg: range(|p| p.lean_deg),
        tested_speed_mps: range(|p| p.speed_mps),
    })
}

struct Data<'a> {
    points: &'a [Point],
    weights: &'a [f64],
}

impl Data<'_> {
    fn n(&self) -> usize {
        self.points.len()
    }

    fn speeds(&self) -> Vec<f64> {
        self.points.iter().map(|p| p.speed_mps).collect()
    }

    /// Linear fit of the speed on functions of the lean: χ² and coefficients.
    fn linear(&self, width: usize, row: impl Fn(f64, &mut [f64])) -> Option<(f64, Vec<f64>)> {
        let rows = Rows::from_fn(self.n(), width, |i, slot| row(self.points[i].lean_deg, slot));
        let beta = solve(&rows, &self.speeds(), Some(self.weights))?;
        let model = rows.times(&beta);
        let square = model
            .iter()
            .zip(self.points)
            .zip(self.weights)
            .map(|((m, p), w)| w * (p.speed_mps - m).powi(2))
            .sum();
        Some((square, beta))
    }

    /// Covariance with the scale of the scatter, and the quality of the fit.
    fn judged(&self, jacobian: &Rows, model: &[f64]) -> Option<(Covariance, f64, f64, f64)> {
        let n = self.n();
        let p = jacobian.width;
        if n <= p {
            return None;
        }
        let residual: Vec<f64> =
            self.points.iter().zip(model).map(|(p, m)| p.speed_mps - m).collect();
        let square: f64 = residual.iter().zip(self.weights).map(|(r, w)| w * r * r).sum();
        let dof = (n - p) as f64;
        let matrix = inverse(&jacobian.normal(Some(self.weights)))? * (square / dof);
        let k = (p + 1) as f64;
        let small = n as f64 - k - 1.0;
        let correction = if small > 0.0 { 2.0 * k * (k + 1.0) / small } else { f64::INFINITY };
        let aicc = n as f64 * (square / n as f64).max(1e-30).ln() + 2.0 * k + correction;
        let covariance = Covariance { matrix, dof: vec![dof; p] };
        let r2 = r_squared(&self.speeds(), &residual);
        Some((covariance, (square / n as f64).sqrt(), r2, aicc))
    }

    fn polynomial(&self, order: usize) -> Option<Law> {
        let width = order + 1;
        let row = |lean: f64, slot: &mut [f64]| {
            slot.iter_mut().zip(0..).for_each(|(x, k)| *x = lean.powi(k));
        };
        let (_, beta) = self.linear(width, row)?;
        let jacobian = Rows::from_fn(self.n(), width, |i, s| row(self.points[i].lean_deg, s));
        let (cov, residual_mps, r_squared, aicc) =
            self.judged(&jacobian, &jacobian.times(&beta))?;
        let names = ["p0 (m/s)", "p1 (m/s per deg)", "p2 (m/s per deg^2)"];
        let parameters =
            names.into_iter().zip(0..).take(width).map(|(n, i)| (n, cov.value(i, beta[i])));
        // dv/dℓ at rest is p1.
        let slope = beta[1];
        let gradient: Vec<f64> =
            (0..width).map(|i| if i == 1 { -per_lean() / (slope * slope) } else { 0.0 }).collect();
        Some(Law {
            form: if order == 1 { Form::Linear } else { Form::Quadratic },
            parameters: parameters.collect(),
            drag_per_s: cov.combine(per_lean() / slope, &gradient),
            residual_mps,
            r_squared,
            aicc,
            at_bound: false,
        })
    }

    /// v = α + β·ln(A − ℓ), A = −a, c = −1/β, b = e^(−α/β).
    fn angle_of_velocity(&self) -> Option<Law> {
        let most = self.points.iter().map(|p| p.lean_deg).fold(0.0, f64::max);
        let [least, high] = [ASYMPTOTE[0] * most, ASYMPTOTE[1]];
        let of = |asymptote: f64| {
            self.linear(2, |lean, s| s.copy_from_slice(&[1.0, (asymptote - lean).ln()]))
        };
        // Searched as the distance above the largest lean, which spans decades.
        let over = search([least - most, high - most], |over| {
            of(most + over).map_or(f64::INFINITY, |f| f.0)
        });
        let asymptote = most + over;
        let (_, beta) = of(asymptote)?;
        let (alpha, beta) = (beta[0], beta[1]);
        let jacobian = Rows::from_fn(self.n(), 3, |i, s| {
            let below = asymptote - self.points[i].lean_deg;
            s.copy_from_slice(&[beta / below, 1.0, below.ln()]);
        });
        let model: Vec<f64> =
            self.points.iter().map(|p| alpha + beta * (asymptote - p.lean_deg).ln()).collect();
        let (cov, residual_mps, r_squared, aicc) = self.judged(&jacobian, &model)?;
        let c = -1.0 / beta;
        let b = (-alpha / beta).exp();
        let dc = [0.0, 0.0, 1.0 / (beta * beta)];
        let db = [0.0, -b / beta, b * alpha / (beta * beta)];
        // Lean per speed at rest is b·c.
        let slope: Vec<f64> = (0..3).map(|i| (db[i] * c + b * dc[i]) * per_lean()).collect();
        Some(Law {
            form: Form::AngleOfVelocity,
            parameters: vec![
                ("a_deg", cov.combine(-asymptote, &[-1.0, 0.0, 0.0])),
                ("b_deg", cov.combine(b, &db)),
                ("c_s_per_m", cov.combine(c, &dc)),
            ],
            drag_per_s: cov.combine(per_lean() * b * c, &slope),
            residual_mps,
            r_squared,
            aicc,
            at_bound: over < (least - most) * 1.01 || asymptote > high * 0.99,
        })
    }

    /// v = a + b·e^(c·ℓ).
    fn velocity_of_angle(&self) -> Option<Law> {
        let of = |c: f64| self.linear(2, |lean, s| s.copy_from_slice(&[1.0, (c * lean).exp()]));
        let best = |sign: f64| {
            search(EXPONENT_PER_DEG, |c| of(sign * c).map_or(f64::INFINITY, |f| f.0)) * sign
        };
        let square = |c: f64| of(c).map_or(f64::INFINITY, |f| f.0);
        let (up, down) = (best(1.0), best(-1.0));
        let c = if square(up) <= square(down) { up } else { down };
        let (_, beta) = of(c)?;
        let (a, b) = (beta[0], beta[1]);
        let jacobian = Rows::from_fn(self.n(), 3, |i, s| {
            let lean = self.points[i].lean_deg;
            let e = (c * lean).exp();
            s.copy_from_slice(&[1.0, e, b * lean * e]);
        });
        let model: Vec<f64> = self.points.iter().map(|p| a + b * (c * p.lean_deg).exp()).collect();
        let (cov, residual_mps, r_squared, aicc) = self.judged(&jacobian, &model)?;
        // Speed per lean at rest is b·c.
        let slope = b * c;
        let over = -per_lean() / (slope * slope);
        let [low, high] = EXPONENT_PER_DEG;
        Some(Law {
            form: Form::VelocityOfAngle,
            parameters: vec![
                ("a_mps", cov.value(0, a)),
                ("b_mps", cov.value(1, b)),
                ("c_per_deg", cov.value(2, c)),
            ],
            drag_per_s: cov.combine(per_lean() / slope, &[0.0, over * c, over * b]),
            residual_mps,
            r_squared,
            aicc,
            at_bound: c.abs() < low * 1.01 || c.abs() > high * 0.99,
        })
    }
}

/// Acceleration that a degree of lean gives, m/s².
fn per_lean() -> f64 {
    G_MPS2 * 1f64.to_radians()
}
