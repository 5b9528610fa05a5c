//! The gap matrix: every cell of a flight against the same cell of null flights.
//!
//! `T = (g - m₀) / s₀ √(1 + 1/N)`, for the mean and for the root mean square of a cell; the larger one
//! counts (GAP.md 2.4). `m₀`, `s₀`: median and robust sigma of N null flights with benign jitter,
//! which hold the noise of seeds; with reference flights of the airframe `m₀` moves to their median
//! and their variance is added. `p`: two-sided tail of a Student t whose degrees of freedom follow
//! from N, twice, since two numbers were looked at. A dot is a cell that survives Benjamini and
//! Yekutieli (2001) at q = 0.05 over all visited cells, which need not be independent.

use serde::Serialize;

use crate::flight::cells::{Cell, Part};
use crate::picture::details::{Details, unit};
use crate::shrink::{median, scales};

/// False discovery rate.
const Q: f64 = 0.05;
/// A cell is comparable when at least this share of the null flights visited it.
const LEAST_VISITED: f64 = 0.6;
/// Fewest null flights of a sigma.
const LEAST_NULLS: usize = 12;
/// Fewest reference flights that move the centre.
const LEAST_REFERENCES: usize = 4;
/// Most degrees of freedom of the tail: residual laws are no normal ones, however many flights.
const MOST_FREEDOM: f64 = 10.0;

/// One cell of the matrix.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Square {
    /// Channel.
    pub channel: String,
    /// Regime, window, voxel or anchor.
    pub part: Part,
    /// Mean residual of the flight; absent: not visited.
    pub mean: Option<f64>,
    /// Of the null flights; absent: not visited by enough of them.
    pub expected: Option<f64>,
    /// Residual that null flights stay below in 95 of 100.
    pub limit: Option<f64>,
    /// Unit of both.
    pub unit: &'static str,
    /// Sigma away from the null flights, mean or root mean square, whichever is farther; absent: not
    /// visited.
    pub t: Option<f64>,
    /// Probability of a null flight to lie as far.
    pub p: Option<f64>,
    /// Survives the false discovery rate over all cells.
    pub significant: bool,
}

/// All cells, and what they were compared with.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Matrix {
    /// Cells in a fixed order.
    pub squares: Vec<Square>,
    /// Null flights behind it.
    pub nulls: usize,
    /// Reference flights behind it.
    pub references: usize,
    /// Cells that were tested.
    pub tested: usize,
    /// False discovery rate of the dots.
    pub q: f64,
}

/// Centre and sigma of one number among null and reference flights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Floor {
    /// Centre.
    pub middle: f64,
    /// Sigma of a new flight.
    pub sigma: f64,
}

/// Floor of a number. `None`: too few flights have it.
pub fn floor(nulls: &[f64], references: &[f64]) -> Option<Floor> {
    let finite =
        |rows: &[f64]| -> Vec<f64> { rows.iter().copied().filter(|v| v.is_finite()).collect() };
    let known = finite(nulls);
    if known.len() < LEAST_NULLS || (known.len() as f64) < LEAST_VISITED * nulls.len() as f64 {
        return None;
    }
    let n = known.len() as f64;
    let mut sorted = known.clone();
    let mut middle = median(&mut sorted);
    let rows: Vec<Vec<f64>> = known.iter().map(|v| vec![*v]).collect();
    let sigma = scales(&rows).first().copied().filter(|s| s.is_finite())?;
    let mut variance = sigma * sigma * (1.0 + 1.0 / n);
    let mut own = finite(references);
    if own.len() >= LEAST_REFERENCES {
        let m = own.len() as f64;
        middle = median(&mut own);
        let scatter = own.iter().map(|v| (v - middle).powi(2)).sum::<f64>() / (m - 1.0);
        variance += scatter * (1.0 + 1.0 / m);
    }
    Some(Floor { middle, sigma: variance.sqrt() })
}

/// The matrix of a flight.
pub fn matrix(flight: &Details, nulls: &[Details], references: &[Details]) -> Matrix {
    let column = |from: &[Details], i: usize, of: &dyn Fn(&Cell) -> f64| -> Vec<f64> {
        from.iter().map(|d| d.cells.get(i).map_or(f64::NAN, of)).collect()
    };
    let freedom = (nulls.len() as f64 - 1.0).clamp(1.0, MOST_FREEDOM);
    let mut squares: Vec<Square> = flight
        .cells
        .iter()
        .enumerate()
        .map(|(i, cell)| {
            let of_mean = |c: &Cell| c.mean;
            let of_rms = |c: &Cell| c.rms;
            let means = floor(&column(nulls, i, &of_mean), &column(references, i, &of_mean));
            let squares = floor(&column(nulls, i, &of_rms), &column(references, i, &of_rms));
            let t = |value: f64, floor: Option<Floor>| {
                floor.map(|f| (value - f.middle) / f.sigma).filter(|t| t.is_finite())
            };
            let t = [t(cell.mean, means), t(cell.rms, squares)]
                .into_iter()
                .flatten()
                .max_by(|a, b| a.abs().total_cmp(&b.abs()));
            Square {
                channel: format!("{:?}", cell.channel),
                part: cell.part,
                mean: Some(cell.mean).filter(|m| m.is_finite()),
                expected: means.map(|f| f.middle),
                limit: means.map(|f| 1.96 * f.sigma),
                unit: unit(cell.channel),
                p: t.map(|t| (2.0 * tail(t.abs(), freedom)).min(1.0)),
                t,
                significant: false,
            }
        })
        .collect();
    let tested = discover(&mut squares);
    Matrix { squares, nulls: nulls.len(), references: references.len(), tested, q: Q }
}

/// Marks what survives the false discovery rate; returns the number of tests.
fn discover(squares: &mut [Square]) -> usize {
    let mut order: Vec<(f64, usize)> =
        squares.iter().enumerate().filter_map(|(i, s)| Some((s.p?, i))).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let m = order.len();
    let harmonic: f64 = (1..=m).map(|k| 1.0 / k as f64).sum();
    let last = order
        .iter()
        .enumerate()
        .rposition(|(k, (p, _))| *p <= Q * (k + 1) as f64 / (m as f64 * harmonic));
    if let Some(last) = last {
        for (_, i) in order.iter().take(last + 1) {
            if let Some(square) = squares.get_mut(*i) {
                square.significant = true;
            }
        }
    }
    m
}

/// Two-sided tail of a Student t, by Simpson's rule on the density over `θ = atan(t/√ν)`, where it is
/// `cos(θ)^(ν-1)`: smooth and on a finite interval.
fn tail(t: f64, freedom: f64) -> f64 {
    let from = (t / freedom.sqrt()).atan();
    let to = std::f64::consts::FRAC_PI_2;
    let density = |x: f64| x.cos().max(0.0).powf(freedom - 1.0);
    let integral = |from: f64| {
        const STEPS: usize = 400;
        let h = (to - from) / STEPS as f64;
        let inner: f64 = (1..STEPS)
            .map(|k| (if k % 2 == 1 { 4.0 } else { 2.0 }) * density(from + k as f64 * h))
            .sum();
        (density(from) + inner + density(to)) * h / 3.0
    };
    (integral(from) / integral(0.0)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::cells::{REGIMES, Regime};
    use crate::flight::residuals::Channel;
    use haltere_model::random::Stream;

    fn flight(means: &[f64]) -> Details {
        let cells = means
            .iter()
            .enumerate()
            .map(|(k, mean)| Cell {
                channel: Channel::ForceX,
                part: Part::Regime(REGIMES[k % REGIMES.len()]),
                mean: *mean,
                rms: mean.abs(),
                n_eff: 10.0,
            })
            .collect();
        Details {
            cells,
            lines: Vec::new(),
            regressors: Vec::new(),
            force_NE_mps2: Vec::new(),
            pairs_m: Vec::new(),
        }
    }

    #[test]
    fn val_tail_of_student() {
        // Abramowitz & Stegun table 26.10: t(0.975; 10) = 2.228, t(0.995; 4) = 4.604.
        assert!((tail(2.228, 10.0) - 0.05).abs() < 1e-4, "{}", tail(2.228, 10.0));
        assert!((tail(4.604, 4.0) - 0.01).abs() < 1e-4, "{}", tail(4.604, 4.0));
    }

    #[test]
    fn prop_null_flights_have_no_dots_and_a_shifted_cell_has() {
        let mut rng = Stream::new(1, "matrix");
        let mut draw = |shift: f64| {
            let mut means: Vec<f64> = (0..300).map(|_| rng.normal()).collect();
            means[7] += shift;
            flight(&means)
        };
        let nulls: Vec<Details> = (0..40).map(|_| draw(0.0)).collect();
        let mut dotted = 0;
        for _ in 0..40 {
            let m = matrix(&draw(0.0), &nulls, &[]);
            assert_eq!(m.tested, 300);
            dotted += usize::from(m.squares.iter().any(|s| s.significant));
        }
        assert!(dotted <= 5, "{dotted} of 40 null flights have a dot, 2 allowed on average");
        let m = matrix(&draw(25.0), &nulls, &[]);
        assert!(m.squares[7].significant);
        assert!(m.squares.iter().filter(|s| s.significant).count() <= 2);
    }

    #[test]
    fn prop_what_was_not_visited_is_grey_and_references_move_the_centre() {
        let mut rng = Stream::new(2, "matrix");
        let nulls: Vec<Details> =
            (0..30).map(|_| flight(&[rng.normal(), f64::NAN, rng.normal()])).collect();
        let m = matrix(&flight(&[f64::NAN, 1.0, 9.0]), &nulls, &[]);
        assert_eq!((m.squares[0].t, m.squares[0].mean), (None, None));
        assert_eq!(m.squares[1].t, None, "no null flight was there");
        assert_eq!(m.tested, 1);
        assert_eq!(m.squares[2].part, Part::Regime(Regime::Cruise));
        let own: Vec<Details> = (0..20).map(|_| flight(&[0.0, 0.0, 9.0 + rng.normal()])).collect();
        let moved = matrix(&flight(&[0.0, 1.0, 9.0]), &nulls, &own);
        assert!(moved.squares[2].t.unwrap().abs() < 3.0 && !moved.squares[2].significant);
    }
}
