//! Lag of the attitude: what the board and the wings make of a setpoint.
//!
//! **Equation.** `y(t) = b + g·x(t)`, where x follows the setpoint u delayed by d,
//!
//! ```text
//! first order    T·x' = u(t − d) − x
//! second order   x'' + 2·ζ·ω·x' + ω²·x = ω²·u(t − d)
//! ```
//!
//! **Method.** For given d and T (or ω, ζ) the rest is linear; the others are found on a grid and
//! refined by damped Gauss-Newton steps. Standard errors as in [`super::correlated`]. The second
//! order is preferred when AIC over the independent samples says so.
//!
//! **Symbols.** u setpoint and y attitude, rad; d, T s; ω rad/s. **Left out.** Limits of the servos,
//! and the loop around: in a flight without doublets the setpoint answers to the attitude, and what
//! is fitted is partly the loop.

use serde::Serialize;

use super::correlated::{Covariance, Noise};
use super::linear::{Rows, r_squared, solve};
use super::value::Value;

/// Least rms of the setpoint, rad: a degree, twice what the attitude wanders by itself.
pub const LEAST_RMS_RAD: f64 = 0.017;
/// Fewest samples.
const LEAST_SAMPLES: usize = 100;
/// Delays and time constants of the grid, s; frequencies, rad/s; dampings.
const DELAYS_S: [f64; 4] = [0.0, 0.02, 0.05, 0.1];
const TIMES_S: [f64; 6] = [0.02, 0.04, 0.07, 0.12, 0.2, 0.35];
const OMEGAS_RADPS: [f64; 5] = [4.0, 8.0, 15.0, 30.0, 60.0];
const DAMPINGS: [f64; 2] = [0.5, 1.0];
/// What a second order must gain in AIC to be preferred.
const GAIN_AIC: f64 = 4.0;

/// Order of the response.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// One time constant.
    First,
    /// Frequency and damping.
    Second,
}

/// A fitted response.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Response {
    /// Order.
    pub order: Order,
    /// Delay, s.
    pub delay_s: Value,
    /// Time constant of the first order, s.
    pub time_s: Option<Value>,
    /// Natural frequency of the second order, rad/s.
    pub omega_radps: Option<Value>,
    /// Damping of the second order.
    pub damping: Option<Value>,
    /// Gain.
    pub gain: Value,
    /// Offset, rad.
    pub offset_rad: Value,
    /// Time by which a slow setpoint is late, s: delay and time constant, or delay and 2ζ/ω.
    pub late_s: Value,
    /// Share of the variance that is explained.
    pub r_squared: f64,
    /// Rms of what is left, rad.
    pub residual_rad: f64,
    /// Criterion; less is better.
    pub aic: f64,
}

/// Both orders, and which is preferred.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Lag {
    /// First order.
    pub first: Response,
    /// Second order, if it could be fitted.
    pub second: Option<Response>,
    /// Preferred one.
    pub preferred: Order,
    /// Rms of the setpoint, rad.
    pub setpoint_rms_rad: f64,
}

impl Lag {
    /// The preferred response.
    pub fn best(&self) -> &Response {
        match (&self.second, self.preferred) {
            (Some(second), Order::Second) => second,
            _ => &self.first,
        }
    }
}

/// Why nothing was fitted.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LagError {
    /// Too few samples.
    #[error("{found} samples, at least {LEAST_SAMPLES} needed")]
    TooFew {
        /// Found.
        found: usize,
    },
    /// The setpoint rests.
    #[error("the setpoint moves by {found_deg:.2} deg rms, at least {:.1} needed",
        LEAST_RMS_RAD.to_degrees())]
    NotExcited {
        /// Found, deg.
        found_deg: f64,
    },
    /// Not finite.
    #[error("setpoints and attitudes must be numbers, and the step between samples positive")]
    BadData,
    /// The response does not follow.
    #[error("the attitude does not follow the setpoint")]
    NoFit,
}

/// Fits both orders to evenly spaced samples.
pub fn fit(dt_s: f64, setpoint_rad: &[f64], attitude_rad: &[f64]) -> Result<Lag, LagError> {
    let n = setpoint_rad.len();
    if n < LEAST_SAMPLES {
        return Err(LagError::TooFew { found: n });
    }
    let finite = setpoint_rad.iter().chain(attitude_rad).all(|v| v.is_finite());
    if !(finite && attitude_rad.len() == n && dt_s > 0.0) {
        return Err(LagError::BadData);
    }
    let mean = setpoint_rad.iter().sum::<f64>() / n as f64;
    let rms = (setpoint_rad.iter().map(|u| (u - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
    if rms < LEAST_RMS_RAD {
        return Err(LagError::NotExcited { found_deg: rms.to_degrees() });
    }
    let data = Data { dt_s, u: setpoint_rad, y: attitude_rad };
    let first = data.best(Order::First).ok_or(LagError::NoFit)?;
    let second = data.best(Order::Second);
    let better = second.as_ref().is_some_and(|s| s.aic + GAIN_AIC < first.aic);
    let preferred = if better { Order::Second } else { Order::First };
    Ok(Lag { first, second, preferred, setpoint_rms_rad: rms })
}

/// What a fitted response makes of a setpoint, rad.
pub fn response(dt_s: f64, setpoint_rad: &[f64], fitted: &Response) -> Vec<f64> {
    let mut shape = vec![fitted.delay_s.value];
    shape.extend(fitted.time_s.map(|t| t.value));
    shape.extend(fitted.omega_radps.map(|w| w.value));
    shape.extend(fitted.damping.map(|z| z.value));
    if setpoint_rad.is_empty() {
        return Vec::new();
    }
    let data = Data { dt_s, u: setpoint_rad, y: setpoint_rad };
    let of = |x: f64| fitted.offset_rad.value + fitted.gain.value * x;
    data.simulate(&shape).into_iter().map(of).collect()
}

struct Data<'a> {
    dt_s: f64,
    u: &'a [f64],
    y: &'a [f64],
}

impl Data<'_> {
    /// Setpoint at a fractional index, held between samples, linear across one.
    fn delayed(&self, i: usize, delay_s: f64) -> f64 {
        let at = i as f64 - delay_s / self.dt_s;
        let low = at.floor();
        let share = at - low;
        let of = |k: f64| self.u[(k.max(0.0) as usize).min(self.u.len() - 1)];
        of(low) * (1.0 - share) + of(low + 1.0) * share
    }

    /// Response to the setpoint without gain and offset. `shape`: delay, then T, or ω and ζ.
    fn simulate(&self, shape: &[f64]) -> Vec<f64> {
        let mut x = self.u[0];
        let mut v = 0.0;
        let mut out = Vec::with_capacity(self.u.len());
        for i in 0..self.u.len() {
            let u = self.delayed(i, shape[0]);
            if shape.len() == 2 {
                let keep = (-self.dt_s / shape[1]).exp();
                x = u + (x - u) * keep;
            } else {
                // Runge-Kutta of fourth order, the setpoint held: within 1e-3 up to ω·dt of 1.
                let (h, omega, zeta) = (self.dt_s, shape[1], shape[2]);
                let rate = |x: f64, v: f64| omega * omega * (u - x) - 2.0 * zeta * omega * v;
                let (x1, v1) = (v, rate(x, v));
                let (x2, v2) = (v + 0.5 * h * v1, rate(x + 0.5 * h * x1, v + 0.5 * h * v1));
                let (x3, v3) = (v + 0.5 * h * v2, rate(x + 0.5 * h * x2, v + 0.5 * h * v2));
                let (x4, v4) = (v + h * v3, rate(x + h * x3, v + h * v3));
                x += h / 6.0 * (x1 + 2.0 * x2 + 2.0 * x3 + x4);
                v += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
            }
            out.push(x);
        }
        out
    }

    /// Best offset and gain for a shape: sum of squares, both, and the response.
    fn linear(&self, shape: &[f64]) -> Option<(f64, [f64; 2], Vec<f64>)> {
        let x = self.simulate(shape);
        let rows = Rows::from_fn(x.len(), 2, |i, row| row.copy_from_slice(&[1.0, x[i]]));
        let beta = solve(&rows, self.y, None)?;
        let square = rows.times(&beta).iter().zip(self.y).map(|(m, y)| (y - m).powi(2)).sum();
        Some((square, [beta[0], beta[1]], x))
    }

    fn best(&self, order: Order) -> Option<Response> {
        let mut shapes: Vec<Vec<f64>> = Vec::new();
        for d in DELAYS_S {
            match order {
                Order::First => shapes.extend(TIMES_S.map(|t| vec![d, t])),
                Order::Second => {
                    for w in OMEGAS_RADPS {
                        shapes.extend(DAMPINGS.map(|z| vec![d, w, z]));
                    }
                }
            }
        }
        let value = |shape: &[f64]| self.linear(shape).map_or(f64::INFINITY, |l| l.0);
        let (mut square, mut shape) = shapes
            .into_iter()
            .map(|shape| (value(&shape), shape))
            .min_by(|a, b| a.0.total_cmp(&b.0))?;
        let mut damping = 1e-3;
        for _ in 0..40 {
            let (jacobian, residual) = self.sensitivities(&shape)?;
            let mut normal = jacobian.normal(None);
            for i in 0..normal.nrows() {
                normal[(i, i)] *= 1.0 + damping;
            }
            let mut right = nalgebra::DVector::zeros(jacobian.width);
            for (row, r) in jacobian.iter().zip(&residual) {
                row.iter().enumerate().for_each(|(k, x)| right[k] += x * r);
            }
            let step = normal.lu().solve(&right)?;
            let next: Vec<f64> = shape
                .iter()
                .enumerate()
                .map(|(k, s)| {
                    let low = if k == 0 { 0.0 } else { 1e-3 };
                    (s + step[k]).max(low)
                })
                .collect();
            let found = value(&next);
            if found < square {
                let small = square - found < 1e-9 * square;
                (shape, square, damping) = (next, found, damping * 0.3);
                if small {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        self.response(order, &shape)
    }

    /// Sensitivities to the shape, then offset and gain; and the residual.
    fn sensitivities(&self, shape: &[f64]) -> Option<(Rows, Vec<f64>)> {
        let (_, [offset, gain], x) = self.linear(shape)?;
        let mut columns = Vec::with_capacity(shape.len());
        for k in 0..shape.len() {
            let h = 1e-3 * shape[k].max(0.01);
            let mut more = shape.to_vec();
            more[k] += h;
            let moved = self.simulate(&more);
            columns.push(moved.iter().zip(&x).map(|(a, b)| gain * (a - b) / h).collect::<Vec<_>>());
        }
        let width = shape.len() + 2;
        let jacobian = Rows::from_fn(x.len(), width, |i, row| {
            for (slot, column) in row.iter_mut().zip(&columns) {
                *slot = column[i];
            }
            row[width - 2] = 1.0;
            row[width - 1] = x[i];
        });
        let residual = x.iter().zip(self.y).map(|(x, y)| y - offset - gain * x).collect();
        Some((jacobian, residual))
    }

    fn response(&self, order: Order, shape: &[f64]) -> Option<Response> {
        let (jacobian, residual) = self.sensitivities(shape)?;
        let (square, [offset, gain], _) = self.linear(shape)?;
        let times: Vec<f64> = (0..self.u.len()).map(|i| i as f64 * self.dt_s).collect();
        let noise = Noise::learn(&times, &jacobian, &residual)?;
        let cov = noise.covariance(&times, &jacobian)?;
        let n = self.u.len() as f64;
        let independent = (n * self.dt_s / (2.0 * noise.lasts_s() + self.dt_s)).max(8.0);
        let k = jacobian.width;
        let aic = independent * (square / n).max(1e-30).ln() + 2.0 * k as f64;
        let at = |i: usize| cov.value(i, shape[i]);
        let late = |cov: &Covariance| match shape {
            [d, t] => cov.combine(d + t, &[1.0, 1.0, 0.0, 0.0]),
            [d, w, z] => {
                cov.combine(d + 2.0 * z / w, &[1.0, -2.0 * z / (w * w), 2.0 / w, 0.0, 0.0])
            }
            _ => cov.value(0, f64::NAN),
        };
        let second = order == Order::Second;
        Some(Response {
            order,
            delay_s: at(0),
            time_s: (!second).then(|| at(1)),
            omega_radps: second.then(|| at(1)),
            damping: second.then(|| at(2)),
            gain: cov.value(k - 1, gain),
            offset_rad: cov.value(k - 2, offset),
            late_s: late(&cov),
            r_squared: r_squared(self.y, &residual),
            residual_rad: (square / n).sqrt(),
            aic,
        })
    }
}
