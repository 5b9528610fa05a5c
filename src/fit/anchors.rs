//! Anchors from a flight: how far the survey is off, and the range bias of each anchor.
//!
//! **Equation.** A difference of anchors a and b at the position p of the tag reads
//!
//! ```text
//! d = (|p − s_b − δ_b| + β_b) − (|p − s_a − δ_a| + β_a) + noise
//! ```
//!
//! with the surveyed places s, their errors δ and a range bias β of each anchor; what a pair shows
//! too much is the difference of two of them.
//!
//! **Truth or none.** With the positions known (motion capture, the simulator) δ and β follow by least
//! squares. Without, the positions of short stretches are unknowns too and are eliminated one after
//! the other; the shape of the path within a stretch is taken from the filter.
//!
//! **Gauge.** A common β cancels in every difference: Σβ = 0. Without truth the whole survey could be
//! shifted and turned with the flight in it: the δ given have no common shift and no common turn
//! (Σδ = 0, Σ(s − s̄)×δ = 0). **Prior.** δ and β are expected within [`PRIOR_M`] (one sigma per axis):
//! what the flight does not see stays at the survey, with that much uncertainty.
//!
//! **Standard errors.** Posterior covariance; the variance of a measurement is that of the residuals,
//! stretched by the time over which the noise of a pair lasts (counted on blocks: a share of the
//! multipath stays for as long as the vehicle stays). **Symbols.** m, Earth frame (NED).
//! **Left out.** Biases that depend on direction: an antenna's pattern shows as scatter.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use serde::Serialize;

use super::value::Value;

/// Expected size of a survey error per axis and of a range bias, one sigma, m.
pub const PRIOR_M: f64 = 0.15;
/// Length of a stretch whose position is one unknown, s.
const STRETCH_S: f64 = 0.5;
/// How far the filter may place a stretch wrong, one sigma, m: so wide that it only keeps the
/// elimination regular.
const PLACE_M: f64 = 1.0;
/// Length of a block by which the lasting of noise is counted, s.
const BLOCK_S: f64 = 2.0;
/// Fewest measurements and anchors.
const LEAST_MEASUREMENTS: usize = 500;
const LEAST_ANCHORS: usize = 5;
/// A measurement farther than this from the model counts no more, sigmas: multipath.
const GATE_SIGMAS: f64 = 4.0;
/// Rounds of linearisation.
const ROUNDS: usize = 5;

/// One measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Difference {
    /// When, s.
    pub t_s: f64,
    /// Index of the anchor that is subtracted.
    pub a: usize,
    /// Index of the anchor that is added.
    pub b: usize,
    /// `|p − b| − |p − a|`, m.
    pub difference_m: f64,
    /// Where the tag was: truth, or what the filter said, m.
    pub pos_E_m: [f64; 3],
}

/// Where the positions come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Positions {
    /// Truth.
    Known,
    /// The filter, which flew on the same anchors.
    Estimated,
}

/// One anchor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Anchor {
    /// Found place less surveyed place, north, east, down, m.
    pub offset_E_m: [Value; 3],
    /// Range bias, m; all of them sum to zero.
    pub bias_m: Value,
    /// Measurements with it.
    pub measurements: usize,
}

/// Result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Calibration {
    /// In the order of the survey.
    pub anchors: Vec<Anchor>,
    /// Where positions came from.
    pub positions: Positions,
    /// Rms of the differences before and after, m, of the measurements that count.
    pub residual_m: [f64; 2],
    /// Measurements used, and left out as too far off.
    pub used: usize,
    /// Left out.
    pub gated: usize,
    /// Measurements per independent one.
    pub stretch: f64,
}

/// Why nothing was fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AnchorsError {
    /// Too little.
    #[error(
        "{measurements} measurements of {anchors} anchors, at least {LEAST_MEASUREMENTS} of \
         {LEAST_ANCHORS} needed"
    )]
    TooFew {
        /// Found.
        measurements: usize,
        /// Anchors heard.
        anchors: usize,
    },
    /// The equations are singular or a value is no number.
    #[error("the measurements do not determine anything: places or differences are no numbers")]
    Singular,
}

/// Calibrates the anchors at these surveyed places, m.
pub fn fit(
    survey_E_m: &[[f64; 3]],
    differences: &[Difference],
    positions: Positions,
) -> Result<Calibration, AnchorsError> {
    let n = survey_E_m.len();
    let usable: Vec<&Difference> = differences
        .iter()
        .filter(|d| {
            d.a < n
                && d.b < n
                && d.a != d.b
                && d.difference_m.is_finite()
                && d.t_s.is_finite()
                && d.pos_E_m.iter().all(|v| v.is_finite())
        })
        .collect();
    let mut heard = vec![0usize; n];
    for d in &usable {
        heard[d.a] += 1;
        heard[d.b] += 1;
    }
    let anchors = heard.iter().filter(|h| **h > 0).count();
    if usable.len() < LEAST_MEASUREMENTS || anchors < LEAST_ANCHORS {
        return Err(AnchorsError::TooFew { measurements: usable.len(), anchors });
    }
    let start_s = usable.iter().map(|d| d.t_s).fold(f64::INFINITY, f64::min);
    let stretch_of = |d: &Difference| ((d.t_s - start_s) / STRETCH_S) as usize;
    let stretches = usable.iter().map(|d| stretch_of(d)).max().unwrap_or(0) + 1;
    let mut problem = Problem {
        survey: survey_E_m.iter().map(|s| Vector3::from(*s)).collect(),
        rows: usable.iter().map(|d| (**d, stretch_of(d))).collect(),
        shift: vec![Vector3::zeros(); stretches],
        x: DVector::zeros(4 * n),
        counts: vec![true; usable.len()],
        positions,
    };
    let (mut std, mut stretch) = (robust_std(&problem.residuals()), 1.0);
    let before = problem.residuals();
    let mut covariance = DMatrix::zeros(4 * n, 4 * n);
    for _ in 0..ROUNDS {
        covariance = problem.round(std * std * stretch).ok_or(AnchorsError::Singular)?;
        let residuals = problem.residuals();
        std = robust_std(&residuals);
        for (counts, r) in problem.counts.iter_mut().zip(&residuals) {
            *counts = r.abs() < GATE_SIGMAS * std;
        }
        stretch = unabsorbed(problem.stretch(&residuals), anchors, positions);
    }
    let residuals = problem.residuals();
    let rms = |r: &[f64]| {
        let of: Vec<f64> =
            r.iter().zip(&problem.counts).filter(|(_, c)| **c).map(|(r, _)| r * r).collect();
        (of.iter().sum::<f64>() / of.len().max(1) as f64).sqrt()
    };
    let gauge = gauge(&problem.survey, positions);
    let x = &gauge * &problem.x;
    let covariance = &gauge * covariance * gauge.transpose();
    let dof = (usable.len() as f64 / stretch - (4 * n) as f64).max(3.0);
    let value = |i: usize| Value { value: x[i], std: covariance[(i, i)].max(0.0).sqrt(), dof };
    Ok(Calibration {
        anchors: (0..n)
            .map(|i| Anchor {
                offset_E_m: [value(4 * i), value(4 * i + 1), value(4 * i + 2)],
                bias_m: value(4 * i + 3),
                measurements: heard[i],
            })
            .collect(),
        positions,
        residual_m: [rms(&before), rms(&residuals)],
        used: problem.counts.iter().filter(|c| **c).count(),
        gated: problem.counts.iter().filter(|c| !**c).count(),
        stretch,
    })
}

/// Projection onto what can be told: biases without their mean, and without truth offsets without
/// common shift and turn. Four numbers an anchor: offset, then bias.
pub fn gauge(survey: &[Vector3<f64>], positions: Positions) -> DMatrix<f64> {
    let n = survey.len();
    let size = 4 * n;
    let mut freedoms: Vec<DVector<f64>> =
        vec![DVector::from_fn(size, |i, _| if i % 4 == 3 { 1.0 } else { 0.0 })];
    if positions == Positions::Estimated {
        let centre = survey.iter().sum::<Vector3<f64>>() / n.max(1) as f64;
        for axis in 0..3 {
            let unit = Vector3::from_fn(|i, _| f64::from(u8::from(i == axis)));
            freedoms.push(DVector::from_fn(size, |i, _| if i % 4 == axis { 1.0 } else { 0.0 }));
            freedoms.push(DVector::from_fn(size, |i, _| {
                let turned = unit.cross(&(survey[i / 4] - centre));
                if i % 4 == 3 { 0.0 } else { turned[i % 4] }
            }));
        }
    }
    let mut projection = DMatrix::identity(size, size);
    let mut kept: Vec<DVector<f64>> = Vec::new();
    for mut freedom in freedoms {
        for other in &kept {
            freedom -= other * other.dot(&freedom);
        }
        let norm = freedom.norm();
        if norm > 1e-9 {
            freedom /= norm;
            projection -= &freedom * freedom.transpose();
            kept.push(freedom);
        }
    }
    projection
}

struct Problem {
    survey: Vec<Vector3<f64>>,
    /// Measurement and the stretch it lies in.
    rows: Vec<(Difference, usize)>,
    /// Where the filter placed each stretch wrong.
    shift: Vec<Vector3<f64>>,
    /// Offset and bias of every anchor.
    x: DVector<f64>,
    counts: Vec<bool>,
    positions: Positions,
}

impl Problem {
    fn anchor(&self, i: usize) -> (Vector3<f64>, f64) {
        let d = Vector3::new(self.x[4 * i], self.x[4 * i + 1], self.x[4 * i + 2]);
        (self.survey[i] + d, self.x[4 * i + 3])
    }

    /// Residual, and the directions from both anchors to the tag.
    fn look(&self, d: &Difference, stretch: usize) -> (f64, Vector3<f64>, Vector3<f64>) {
        let p = Vector3::from(d.pos_E_m) + self.shift[stretch];
        let ((a, bias_a), (b, bias_b)) = (self.anchor(d.a), self.anchor(d.b));
        let (from_a, from_b) = (p - a, p - b);
        let (far_a, far_b) = (from_a.norm().max(1e-6), from_b.norm().max(1e-6));
        let residual = d.difference_m - (far_b + bias_b - far_a - bias_a);
        (residual, from_a / far_a, from_b / far_b)
    }

    fn residuals(&self) -> Vec<f64> {
        self.rows.iter().map(|(d, k)| self.look(d, *k).0).collect()
    }

    /// One linearisation: moves anchors and stretches; the covariance of the anchors.
    fn round(&mut self, var: f64) -> Option<DMatrix<f64>> {
        let size = self.x.len();
        let mut normal = DMatrix::zeros(size, size);
        let mut right = DVector::zeros(size);
        let free = self.positions == Positions::Estimated;
        let k = self.shift.len();
        let mut place_normal = vec![Matrix3::identity() * (var / (PLACE_M * PLACE_M)); k];
        let mut place_right: Vec<Vector3<f64>> =
            self.shift.iter().map(|s| -s * (var / (PLACE_M * PLACE_M))).collect();
        let mut cross = vec![DMatrix::<f64>::zeros(if free { size } else { 0 }, 3); k];
        for ((d, stretch), counts) in self.rows.iter().zip(&self.counts) {
            if !counts {
                continue;
            }
            let (r, to_a, to_b) = self.look(d, *stretch);
            // Derivatives of the model: by offset and bias of a and of b, and by the place.
            let mut row = [0.0; 8];
            for i in 0..3 {
                (row[i], row[4 + i]) = (to_a[i], -to_b[i]);
            }
            (row[3], row[7]) = (-1.0, 1.0);
            let at = |i: usize| if i < 4 { 4 * d.a + i } else { 4 * d.b + i - 4 };
            for (i, x) in row.iter().enumerate() {
                right[at(i)] += x * r;
                for (j, y) in row.iter().enumerate() {
                    normal[(at(i), at(j))] += x * y;
                }
            }
            if free {
                let place = to_b - to_a;
                place_normal[*stretch] += place * place.transpose();
                place_right[*stretch] += place * r;
                for (i, x) in row.iter().enumerate() {
                    for j in 0..3 {
                        cross[*stretch][(at(i), j)] += x * place[j];
                    }
                }
            }
        }
        for i in 0..size {
            normal[(i, i)] += var / (PRIOR_M * PRIOR_M);
            right[i] -= self.x[i] * var / (PRIOR_M * PRIOR_M);
        }
        let mut inverses = Vec::with_capacity(if free { k } else { 0 });
        if free {
            for stretch in 0..k {
                let inverse = place_normal[stretch].try_inverse()?;
                let weighted = &cross[stretch] * inverse;
                normal -= &weighted * cross[stretch].transpose();
                right -= &weighted * place_right[stretch];
                inverses.push(inverse);
            }
        }
        let inverse = normal.cholesky()?.inverse();
        let step = &inverse * right;
        if step.iter().any(|s| !s.is_finite()) {
            return None;
        }
        for (stretch, place) in inverses.iter().enumerate() {
            let carried = cross[stretch].transpose() * &step;
            self.shift[stretch] += place * (place_right[stretch] - carried);
        }
        self.x += step;
        Some(inverse * var)
    }

    /// Measurements per independent one: variance of sums over blocks of a pair against that of
    /// single measurements.
    fn stretch(&self, residuals: &[f64]) -> f64 {
        let mut sums: std::collections::BTreeMap<(usize, usize, u64), (f64, f64)> =
            std::collections::BTreeMap::new();
        let (mut square, mut count) = (0.0, 0.0);
        for (((d, _), r), counts) in self.rows.iter().zip(residuals).zip(&self.counts) {
            if !counts {
                continue;
            }
            // Both anchors of a pair carry the error of their own path.
            for (anchor, side) in [(d.a, -1.0), (d.b, 1.0)] {
                let slot = sums.entry((anchor, 0, (d.t_s / BLOCK_S) as u64)).or_default();
                slot.0 += side * r;
                slot.1 += 1.0;
            }
            square += r * r;
            count += 1.0;
        }
        let var = square / f64::max(count, 1.0);
        let (mut of_sums, mut members) = (0.0, 0.0);
        for (sum, n) in sums.values() {
            of_sums += sum * sum;
            members += n;
        }
        (of_sums / (members * var).max(1e-300)).max(1.0)
    }
}

/// What lasts in the noise of n anchors has n parts in a stretch; one of them cancels in the
/// differences, and without truth three more go into the place: the residuals show only the rest.
fn unabsorbed(stretch: f64, anchors: usize, positions: Positions) -> f64 {
    let gone = if positions == Positions::Estimated { 4 } else { 1 };
    let n = anchors as f64;
    1.0 + (stretch - 1.0) * n / (anchors.saturating_sub(gone).max(1) as f64)
}

/// Standard deviation by the median of the magnitudes.
fn robust_std(residuals: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    // Median of |x| of a normal variable is 0.6745 sigma.
    sizes.get(sizes.len() / 2).copied().unwrap_or(0.0).max(1e-4) / 0.6745
}
