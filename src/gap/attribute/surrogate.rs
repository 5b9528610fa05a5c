//! What an effect does to the statistics as a function of its parameters, learned from its draws.
//!
//! `m(θ) = Q h(θ)`, `h(θ) = Bᵀ k(θ)`: a kernel ridge regression on features of θ, in whitened
//! statistics, as the difference to the null. The kernel is linear, quadratic or smooth (Gaussian,
//! at a short length a nearest-draw mean, which is what effects with a place or an anchor need);
//! kernel, ridge and features are chosen per effect by the leave-one-out likelihood. An effect of no size does nothing:
//! kernels are multiplied by the sizes of both draws, `k(θ, θ') = s(θ) s(θ') k₀(x, x')` with `s` of [`Space::size`] and `x` the
//! features (a product of kernels is one: Rasmussen and Williams 2006, 4.2.4), so that every signature vanishes there. Residuals of
//! left-out draws give the noise of the effect, `τ² (U Uᵀ + diag d)`,
//! with `τ` the size of the signature relative to the draws: what a surrogate gets wrong grows
//! with the effect. `U` holds also what the effect does by other laws than the simulator's ([`beside`]).

use nalgebra::{DMatrix, DVector};

use super::linear::{Noise, directions, joined};
use super::theta::Space;
use crate::bank::axis::Axis;

/// Directions in which kernels are compared.
const COMPARED_DIRECTIONS: usize = 10;
/// Directions of a signature that are kept, and the share of its square that they must hold.
const MOST_DIRECTIONS: usize = 8;
const KEPT_SHARE: f64 = 0.999;
/// Directions of residual noise that are kept.
const MOST_NOISE_DIRECTIONS: usize = 6;
/// Levels of `τ²` at which the noise is prepared; between them the likelihood is interpolated.
pub(super) const LEVELS: [f64; 7] =
    [0.000_976_562_5, 0.003_906_25, 0.015_625, 0.0625, 0.25, 1.0, 4.0];

/// Form of the dependence on θ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kernel {
    /// `1 + x·x'`.
    Linear,
    /// `(1 + x·x' / d)²`.
    Quadratic,
    /// `½ (1 + x·x'/d) + e^(-|x-x'|²/(2 l² d))`.
    Smooth(f64),
}

const KERNELS: [Kernel; 5] = [
    Kernel::Linear,
    Kernel::Quadratic,
    Kernel::Smooth(1.5),
    Kernel::Smooth(0.7),
    Kernel::Smooth(0.3),
];
/// Noise to signal of the draws, as the ridge of the regression.
const RIDGES: [f64; 5] = [3e-4, 3e-3, 3e-2, 0.3, 2.0];

impl Kernel {
    fn of(self, a: &[f64], b: &[f64]) -> f64 {
        let d = a.len().max(1) as f64;
        let product: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
        match self {
            Kernel::Linear => 1.0 + product,
            Kernel::Quadratic => (1.0 + product / d).powi(2),
            Kernel::Smooth(length) => {
                let apart: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
                0.5 * (1.0 + product / d) + (-apart / (2.0 * length * length * d)).exp()
            }
        }
    }

    fn gram(self, x: &[Vec<f64>], sizes: &[f64]) -> DMatrix<f64> {
        let mut gram = DMatrix::zeros(x.len(), x.len());
        for i in 0..x.len() {
            for j in 0..=i {
                let k = self.of(&x[i], &x[j]) * sizes[i] * sizes[j];
                gram[(i, j)] = k;
                gram[(j, i)] = k;
            }
        }
        gram
    }
}

/// Signature and noise of one effect, in whitened statistics.
#[derive(Debug, Clone)]
pub(super) struct Surrogate {
    /// Parameter space.
    pub space: Space,
    kernel: Kernel,
    /// Features in use.
    used: Vec<usize>,
    /// Features of the draws, and their sizes.
    x: Vec<Vec<f64>>,
    sizes: Vec<f64>,
    /// Kernel weights to coordinates, n × r.
    b: DMatrix<f64>,
    /// Directions of the signature, p × r.
    pub q: DMatrix<f64>,
    /// Draws on the unit cube, and their coordinates `h`.
    pub starts: Vec<(Vec<f64>, DVector<f64>)>,
    /// Mean square size of the signatures of the draws.
    size2: f64,
    /// Noise at [`LEVELS`].
    pub noise: Vec<Noise>,
    /// `Qᵀ N⁻¹ Q` and `N⁻¹ Q` at [`LEVELS`].
    pub solved: Vec<[DMatrix<f64>; 2]>,
    /// Diagonal and low-rank part at `τ = 1`.
    pub spread: (DVector<f64>, DMatrix<f64>),
}

impl Surrogate {
    /// `axes`: of the parameters; `thetas`: of the draws. `z`: draws minus their twins, whitened (n × p). `others`: what the effect does by
    /// other laws, whitened (m × p), of any size; without any the library's law is the only one.
    pub fn new(axes: &[Axis], thetas: &[&[f64]], z: &DMatrix<f64>, others: &DMatrix<f64>) -> Self {
        let space = Space::of(axes);
        let sizes: Vec<f64> = thetas.iter().map(|t| space.size(t)).collect();
        let units: Vec<Vec<f64>> = thetas.iter().map(|t| space.to_unit(t)).collect();
        let full: Vec<Vec<f64>> = units.iter().map(|u| space.features(u)).collect();
        let (kernel, ridge, used) = choose(&full, &sizes, z);
        let x: Vec<Vec<f64>> = full.iter().map(|f| pick(f, &used)).collect();
        let n = x.len();
        let (smoother, weights) = smoother(kernel, ridge, &x, &sizes);
        let fitted = &smoother * z;
        let mut left_out = z - &fitted;
        for i in 0..n {
            left_out.row_mut(i).scale_mut(1.0 / (1.0 - smoother[(i, i)]).max(LEAST_FREEDOM));
        }
        let (values, basis) = directions(&fitted, MOST_DIRECTIONS);
        let keep = enough(&values, fitted.norm_squared());
        let q = basis.columns(0, keep).into_owned();
        let b = weights * (z * &q);
        let size2 = (fitted.norm_squared() / n as f64).max(1.0);
        let spread = residual_noise(&left_out, &fitted, size2, &beside(&q, others, size2));
        let (noise, solved) = at_levels(&q, &spread);
        let mut surrogate = Self {
            space,
            kernel,
            used,
            x,
            sizes,
            b,
            q,
            starts: vec![],
            size2,
            noise,
            solved,
            spread,
        };
        surrogate.starts =
            units.into_iter().map(|u| (u.clone(), surrogate.coordinates(&u))).collect();
        surrogate
    }

    /// The same effect as these whitened numbers alone see it.
    pub fn seen_by(&self, rows: &[usize]) -> Self {
        let q = self.q.select_rows(rows);
        let spread = (self.spread.0.select_rows(rows), self.spread.1.select_rows(rows));
        let (noise, solved) = at_levels(&q, &spread);
        Self { q, noise, solved, spread, ..self.clone() }
    }

    /// Coordinates of the signature at a point of the unit cube.
    pub fn coordinates(&self, unit: &[f64]) -> DVector<f64> {
        let features = pick(&self.space.features(unit), &self.used);
        let size = self.space.size(&self.space.value(unit));
        let mut h = DVector::zeros(self.q.ncols());
        for (i, x) in self.x.iter().enumerate() {
            let k = self.kernel.of(&features, x) * size * self.sizes[i];
            for (to, weight) in h.iter_mut().zip(self.b.row(i).iter()) {
                *to += k * weight;
            }
        }
        h
    }

    /// Signature in whitened statistics.
    pub fn mean(&self, h: &DVector<f64>) -> DVector<f64> {
        &self.q * h
    }

    /// `τ²` of a signature.
    pub fn level(&self, h: &DVector<f64>) -> f64 {
        (h.norm_squared() / self.size2).clamp(LEVELS[0], LEVELS[LEVELS.len() - 1])
    }
}

/// Noise at [`LEVELS`], and `Qᵀ N⁻¹ Q` and `N⁻¹ Q`.
fn at_levels(
    q: &DMatrix<f64>,
    spread: &(DVector<f64>, DMatrix<f64>),
) -> (Vec<Noise>, Vec<[DMatrix<f64>; 2]>) {
    let at = |level: &f64| Noise::new(&(&spread.0 * *level), &(&spread.1 * level.sqrt()));
    let noise: Vec<Noise> = LEVELS.iter().map(at).collect();
    let solved = noise.iter().map(|n| n.solve(q)).map(|solved| [q.transpose() * &solved, solved]);
    let solved = solved.collect();
    (noise, solved)
}

/// Least `1 - H_ii`: a draw that determines itself says nothing about prediction.
const LEAST_FREEDOM: f64 = 0.02;

fn pick(features: &[f64], used: &[usize]) -> Vec<f64> {
    used.iter().filter_map(|k| features.get(*k).copied()).collect()
}

/// `H = K (K + λ)⁻¹` and `(K + λ)⁻¹`.
fn smoother(
    kernel: Kernel,
    ridge: f64,
    x: &[Vec<f64>],
    sizes: &[f64],
) -> (DMatrix<f64>, DMatrix<f64>) {
    smoother_of(&kernel.gram(x, sizes), ridge)
}

/// The same of a Gram matrix.
fn smoother_of(gram: &DMatrix<f64>, ridge: f64) -> (DMatrix<f64>, DMatrix<f64>) {
    let n = gram.nrows();
    let scale = ridge * gram.trace() / n.max(1) as f64;
    let padded = gram + DMatrix::identity(n, n) * scale;
    match padded.cholesky() {
        Some(c) => {
            let inverse = c.inverse();
            (gram * &inverse, inverse)
        }
        None => (DMatrix::zeros(n, n), DMatrix::zeros(n, n)),
    }
}

fn enough(values: &[f64], total: f64) -> usize {
    let mut sum = 0.0;
    for (k, v) in values.iter().enumerate() {
        sum += v;
        if sum >= KEPT_SHARE * total {
            return k + 1;
        }
    }
    values.len()
}

/// Kernel, ridge and features with the best leave-one-out likelihood, features by backward
/// elimination.
fn choose(full: &[Vec<f64>], sizes: &[f64], z: &DMatrix<f64>) -> (Kernel, f64, Vec<usize>) {
    let (_, basis) = directions(z, COMPARED_DIRECTIONS);
    let y = z * basis;
    let width = full.first().map_or(0, Vec::len);
    let mut used: Vec<usize> = (0..width).collect();
    let mut best = best_of(full, sizes, &y, &used, &KERNELS, &RIDGES);
    while used.len() > 1 {
        let mut trials = (0..used.len()).map(|k| {
            let mut fewer = used.clone();
            fewer.remove(k);
            let kernels = [best.1, Kernel::Smooth(0.7)];
            let kernels = if kernels[0] == kernels[1] { &kernels[..1] } else { &kernels[..] };
            (best_of(full, sizes, &y, &fewer, kernels, &[best.2]), fewer)
        });
        let first = trials.next();
        let Some(better) = trials.fold(first, |a, b| match a {
            Some(a) if a.0.0 <= b.0.0 => Some(a),
            _ => Some(b),
        }) else {
            break;
        };
        if better.0.0 >= best.0 {
            break;
        }
        (best, used) = better;
    }
    if used.len() < width {
        best = best_of(full, sizes, &y, &used, &KERNELS, &RIDGES);
    }
    (best.1, best.2, used)
}

/// Mean square residual, in null sigma, below which fits are equally good: a thirtieth of a sigma (judgement).
const LEAST_RESIDUAL: f64 = 1e-3;

/// Minus log likelihood of left-out draws, kernel, ridge.
fn best_of(
    full: &[Vec<f64>],
    sizes: &[f64],
    y: &DMatrix<f64>,
    used: &[usize],
    kernels: &[Kernel],
    ridges: &[f64],
) -> (f64, Kernel, f64) {
    let x: Vec<Vec<f64>> = full.iter().map(|f| pick(f, used)).collect();
    let n = x.len() as f64;
    let mut best = (f64::INFINITY, Kernel::Linear, RIDGES[RIDGES.len() - 1]);
    for kernel in kernels {
        let gram = kernel.gram(&x, sizes);
        for ridge in ridges {
            let (h, _) = smoother_of(&gram, *ridge);
            let residual = y - &h * y;
            let mut cost = 0.0;
            for j in 0..y.ncols() {
                let square =
                    |i: usize| (residual[(i, j)] / (1.0 - h[(i, i)]).max(LEAST_FREEDOM)).powi(2);
                let mean = (0..y.nrows()).map(square).sum::<f64>() / n;
                cost += 0.5 * n * (LEAST_RESIDUAL + mean).ln();
            }
            if cost < best.0 {
                best = (cost, *kernel, *ridge);
            }
        }
    }
    best
}

/// What other laws do beside the signature, at `τ = 1`: `(1 - Q Qᵀ) X s / |X|`, with the laws X (whitened, one a column) and s the root mean
/// square size of the draws: as large beside it as it is among all that they do.
fn beside(q: &DMatrix<f64>, others: &DMatrix<f64>, size2: f64) -> DMatrix<f64> {
    let whole = others.norm_squared().max(f64::MIN_POSITIVE);
    let others = others.transpose();
    (&others - q * q.tr_mul(&others)) * (size2 / whole).sqrt()
}

/// Diagonal and low-rank part of what residuals hold, at `τ = 1`, with `beside`.
fn residual_noise(
    left_out: &DMatrix<f64>,
    fitted: &DMatrix<f64>,
    size2: f64,
    beside: &DMatrix<f64>,
) -> (DVector<f64>, DMatrix<f64>) {
    let p = left_out.ncols();
    // Σ τ²: every draw holds τ² times the noise at τ = 1.
    let weight: f64 = fitted
        .row_iter()
        .map(|r| (r.norm_squared() / size2).clamp(LEVELS[0], LEVELS[LEVELS.len() - 1]))
        .sum();
    let (values, mut own) = directions(left_out, MOST_NOISE_DIRECTIONS);
    for (mut column, value) in own.column_iter_mut().zip(&values) {
        column.scale_mut((value / weight).sqrt());
    }
    let beyond = |j: usize| left_out.column(j).norm_squared() / weight - own.row(j).norm_squared();
    let raw = DVector::from_fn(p, |j, _| beyond(j).max(0.0));
    let mean = (0..p).map(beyond).sum::<f64>().max(0.0) / p.max(1) as f64;
    // Some forty draws know a variance to a fifth: lean on the mean over the statistics.
    let d = raw.map(|own| 0.5 * (own + mean));
    (d, joined(&own, beside))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::evidence::Sufficient;
    use crate::bank::axis::Size;
    use haltere_model::random::Stream;

    fn axes(thetas: &[&[f64]]) -> Vec<Axis> {
        (0..thetas[0].len()).map(|k| Axis::over(thetas.iter().map(|t| t[k]))).collect()
    }

    fn check(law: impl Fn(f64, f64) -> f64, most: f64) {
        let mut rng = Stream::new(5, "surrogate");
        let p = 40;
        let along = DVector::from_fn(p, |_, _| rng.normal());
        let thetas: Vec<Vec<f64>> =
            (0..40).map(|_| vec![rng.between(-1.0, 1.0), rng.between(0.0, 7.0)]).collect();
        let rows: Vec<_> = thetas
            .iter()
            .map(|t| &along * law(t[0], t[1]) + DVector::from_fn(p, |_, _| 0.7 * rng.normal()))
            .collect();
        let z = DMatrix::from_fn(40, p, |i, j| rows[i][j]);
        let refs: Vec<&[f64]> = thetas.iter().map(Vec::as_slice).collect();
        let s = Surrogate::new(&axes(&refs), &refs, &z, &DMatrix::zeros(0, p));
        let mut worst: f64 = 0.0;
        for k in 0..40 {
            let theta = [-0.9 + 1.8 * f64::from(k) / 39.0, rng.between(0.5, 6.5)];
            let h = s.coordinates(&s.space.to_unit(&theta));
            let want = &along * law(theta[0], theta[1]);
            worst = worst.max((s.mean(&h) - want).norm() / (p as f64).sqrt());
        }
        assert!(worst < most, "error {worst} sigma, {:?}, features {:?}", s.kernel, s.used);
    }

    #[test]
    fn prop_learns_linear_curved_and_one_sided_signatures() {
        check(|a, _| 10.0 * a, 0.8);
        check(|a, _| 10.0 * a * a - 2.0 * a, 1.2);
        check(|a, _| 12.0 * a.abs(), 1.2);
        check(|a, b| 5.0 * a + b, 1.2);
    }

    /// Few draws, none of them weak: that nothing is left at no size tells what weak ones do.
    #[test]
    fn prop_a_signature_vanishes_where_its_effect_is_off() {
        let mut rng = Stream::new(11, "surrogate");
        let p = 30;
        let along = DVector::from_fn(p, |_, _| rng.normal());
        let thetas: Vec<[f64; 1]> = (0..10).map(|k| [1.0 + 0.1 * f64::from(k)]).collect();
        let rows: Vec<_> = thetas
            .iter()
            .map(|t| &along * (3.0 * t[0]) + DVector::from_fn(p, |_, _| rng.normal()))
            .collect();
        let z = DMatrix::from_fn(10, p, |i, j| rows[i][j]);
        let refs: Vec<&[f64]> = thetas.iter().map(|t| t.as_slice()).collect();
        let at = |size: Option<Size>, theta: f64| {
            let axis = Axis { low: 0.0, high: 2.0, choice: false, size };
            let s = Surrogate::new(&[axis], &refs, &z, &DMatrix::zeros(0, p));
            let found = s.mean(&s.coordinates(&s.space.to_unit(&[theta])));
            (found - &along * (3.0 * theta)).norm() / (p as f64).sqrt()
        };
        let size = Some(Size::From(0.0));
        assert_eq!(at(size, 0.0), 0.0);
        let [with, without] = [at(size, 0.3), at(None, 0.3)];
        // What there is to see is 0.9 sigma.
        assert!(with < 0.4 && without > 2.0 * with, "{with} sigma, {without} without");
    }

    #[test]
    fn prop_noise_that_depends_on_the_effect_is_found() {
        let mut rng = Stream::new(6, "surrogate");
        let p = 60;
        let thetas: Vec<[f64; 1]> = (0..40).map(|_| [rng.between(0.5, 1.0)]).collect();
        // One direction of strong extra noise beside a plain signature.
        let z = DMatrix::from_fn(40, p, |_, _| 0.7 * rng.normal());
        let mut noisy = z.clone();
        for i in 0..40 {
            noisy[(i, 0)] += 10.0 * thetas[i][0];
            noisy[(i, 1)] += 8.0 * thetas[i][0] * rng.normal();
        }
        let refs: Vec<&[f64]> = thetas.iter().map(|t| t.as_slice()).collect();
        let s = Surrogate::new(&axes(&refs), &refs, &noisy, &DMatrix::zeros(0, p));
        let variance = |j: usize| s.spread.0[j] + s.spread.1.row(j).norm_squared();
        assert!(variance(1) > 30.0 && variance(1) < 130.0, "{}", variance(1));
        assert!(variance(5) < 2.0, "{}", variance(5));
    }

    /// By another law than the simulator's an effect does something beside its signature: what such laws did on other vehicles is noise of it, in
    /// proportion to its size, and nothing else is.
    #[test]
    fn prop_what_other_laws_did_beside_the_signature_is_no_other_cause() {
        let mut rng = Stream::new(7, "surrogate");
        let p = 30;
        let mut along = || DVector::from_fn(p, |_, _| rng.normal()).normalize();
        let [own, law, other] = [along(), along(), along()];
        let thetas: Vec<[f64; 1]> = (0..41).map(|i| [0.025 * f64::from(i)]).collect();
        let refs: Vec<&[f64]> = thetas.iter().map(|t| t.as_slice()).collect();
        let z = DMatrix::from_fn(41, p, |i, j| 40.0 * thetas[i][0] * own[j]);
        let laws = DMatrix::from_fn(3, p, |i, j| {
            [3.0, 3.0, -3.0][i] * (own[j] + [0.6, -0.4, 0.5][i] * law[j])
        });
        let none = DMatrix::zeros(0, p);
        let axis = Axis { low: 0.0, high: 1.0, choice: false, size: Some(Size::From(0.0)) };
        let evidence = |others: &DMatrix<f64>, size: f64, beside: &DVector<f64>| {
            let s = Surrogate::new(std::slice::from_ref(&axis), &refs, &z, others);
            let flight = (&own + beside * 0.5) * size;
            Sufficient::new(&s, &flight).fit(0).log_z + 0.5 * flight.norm_squared()
        };
        for size in [10.0, 30.0] {
            let gained =
                [&law, &other].map(|by| evidence(&laws, size, by) - evidence(&none, size, by));
            assert!(gained[0] > 5.0 && gained[1] < 0.2 * gained[0], "{gained:?} at {size}");
        }
        assert!(evidence(&laws, 0.5, &law) < 0.5, "what is hardly there is no evidence");
        // In any unit.
        let [one, other] = [1.0, 1e-3].map(|unit| evidence(&(&laws * unit), 30.0, &law));
        assert!((one - other).abs() < 1e-6, "{one} {other}");
    }
}
