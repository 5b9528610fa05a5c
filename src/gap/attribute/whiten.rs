//! From statistics with units to whitened numbers: middle and scale per statistic, a compression of extreme values, and the
//! covariance of healthy flights.
//!
//! `x = (s - m) / w`, `u = k asinh(x / k)`, `z = W u`. Compressed, an effect a thousand
//! sigma large weighs some forty; a 10 % error of its size stays below one sigma and cannot outvote
//! all other statistics. `m`, `w`: middle and sigma of the next healthy flight ([`Scatter`]), and the resolution of a statistic: what the
//! recording computer adds, which a simulator does not. How statistics go together is taken from the bank's flights with jitter and from
//! accepted ones, each in sigma of their own kind.

use nalgebra::{DMatrix, DVector};

use super::linear::{matrix, shrunk_covariance, whitener};
use super::scatter::{Hours, Scatter, in_sigma, spread};

/// Sigma at which compression sets in.
const KNEE: f64 = 8.0;
/// Largest standardised value; beyond it a number says no more than "very large".
const LARGEST: f64 = 1e5;
/// A statistic unknown in more than this share of null flights is not used.
const MOST_UNKNOWN: f64 = 0.2;

/// `k asinh(x/k)`.
pub(super) fn compress(x: f64) -> f64 {
    KNEE * (x / KNEE).asinh()
}

/// Inverse of [`compress`].
pub(super) fn expand(u: f64) -> f64 {
    KNEE * (u / KNEE).sinh().clamp(-LARGEST, LARGEST)
}

/// Middle and scale of the statistics in use.
#[derive(Debug, Clone, Default)]
pub(super) struct Standard {
    /// Places of the statistics in use.
    pub columns: Vec<usize>,
    scatter: Vec<Scatter>,
    middle: Vec<f64>,
    scale: Vec<f64>,
    /// Share of the resolution in the square of the scale.
    unresolved: Vec<f64>,
}

impl Standard {
    /// From flights of the bank without an effect, `[of one vehicle, with other benign constants]`, and accepted flights; `effects`
    /// only give a scale to statistics that never vary. `resolution`: of every statistic, or empty. `allowed`: which statistics may be used.
    pub fn new<'a>(
        nulls: [&[&'a [f64]]; 2],
        effects: impl Iterator<Item = &'a [f64]> + Clone,
        accepted: &[&[f64]],
        resolution: &[f64],
        hours: Hours<'_>,
        allowed: impl Fn(usize) -> bool,
    ) -> Self {
        let all = || nulls.into_iter().flatten();
        let (count, width) = (all().count(), all().next().map_or(0, |row| row.len()));
        let mut standard = Self::default();
        for j in (0..width).filter(|j| allowed(*j)) {
            let unknown = all().filter(|row| !row[j].is_finite()).count();
            if unknown as f64 > MOST_UNKNOWN * count as f64 {
                continue;
            }
            let Some(scatter) = Scatter::of(j, nulls, accepted, hours) else { continue };
            let [mut sigma, _] = scatter.next;
            let [centre, _] = scatter.bank;
            if sigma <= f64::EPSILON * centre.abs() {
                let away: Vec<f64> =
                    effects.clone().map(|r| r[j]).filter(|v| v.is_finite()).collect();
                // Never moved in a healthy flight: an effect that moves it counts as some sigma.
                sigma = spread(&away, centre) / KNEE;
            }
            let resolution = resolution.get(j).copied().unwrap_or(0.0);
            let scale = sigma.hypot(resolution);
            if scale.is_finite() && scale > f64::EPSILON * centre.abs() && scale > f64::MIN_POSITIVE
            {
                standard.columns.push(j);
                standard.scatter.push(scatter);
                standard.middle.push(scatter.accepted.map_or(centre, |[middle, _]| middle));
                standard.scale.push(scale);
                standard.unresolved.push((resolution / scale).powi(2));
            }
        }
        standard
    }

    /// Standardised, NaN where unknown.
    pub fn raw(&self, statistics: &[f64]) -> Vec<f64> {
        self.each(statistics, |k, value| (value - self.middle[k]) / self.scale[k])
    }

    /// What a flight of the bank differs by from its twin, compressed; NaN where either is unknown.
    pub fn apart(&self, flight: &[f64], twin: &[f64]) -> Vec<f64> {
        let apart = |k: usize, value| {
            let twin = twin.get(self.columns[k]).copied().unwrap_or(f64::NAN);
            (value - twin) / self.scale[k]
        };
        self.each(flight, apart).into_iter().map(compress).collect()
    }

    /// Differences of the statistics in units of the scale.
    pub fn in_scale(&self, differences: &[f64]) -> Vec<f64> {
        self.each(differences, |k, value| value / self.scale[k])
    }

    /// What `of` makes of every statistic in use, within what is still a number.
    fn each(&self, statistics: &[f64], of: impl Fn(usize, f64) -> f64) -> Vec<f64> {
        let at = |k: usize| {
            let x = of(k, statistics.get(self.columns[k]).copied().unwrap_or(f64::NAN));
            if x.is_nan() { x } else { x.clamp(-LARGEST, LARGEST) }
        };
        (0..self.columns.len()).map(at).collect()
    }

    /// Sigma of the next healthy flight, in units of the statistic.
    pub fn scale(&self, k: usize) -> f64 {
        self.scale[k]
    }

    /// Covariance of healthy flights in units of the scale: `nulls` and `accepted` say how statistics go together.
    fn covariance(&self, nulls: &[&[f64]], accepted: &[&[f64]]) -> DMatrix<f64> {
        let of_bank =
            |row: &&[f64]| self.each(row, |k, value| in_sigma(value, self.scatter[k].bank));
        let of_airframe = |row: &&[f64]| {
            self.each(row, |k, value| {
                self.scatter[k].accepted.map_or(0.0, |about| in_sigma(value, about))
            })
        };
        let rows = nulls.iter().map(of_bank).chain(accepted.iter().map(of_airframe));
        let rows: Vec<Vec<f64>> = rows.map(|row| compressed(&row)).collect();
        let (mut covariance, _) = shrunk_covariance(&matrix(&rows, self.columns.len()));
        let own = |k: usize| 1.0 - self.unresolved[k];
        for i in 0..self.columns.len() {
            for j in 0..self.columns.len() {
                covariance[(i, j)] *= (own(i) * own(j)).sqrt();
            }
            // No statistic is quieter than its scale says, and one with heavy tails is louder.
            covariance[(i, i)] = covariance[(i, i)].max(own(i)) + self.unresolved[i];
        }
        covariance
    }
}

/// Compressed and whitened statistics.
#[derive(Debug, Clone)]
pub(super) struct Whitening {
    /// Middle and scale.
    pub standard: Standard,
    /// Of healthy flights, in units of the scale.
    pub covariance: DMatrix<f64>,
    w: DMatrix<f64>,
    /// Its inverse.
    back: DMatrix<f64>,
}

impl Whitening {
    /// `nulls`: rows of the bank that say how statistics go together (jitter, which contains the noise of seeds); `accepted` say it too.
    pub fn new(standard: Standard, nulls: &[&[f64]], accepted: &[&[f64]]) -> Self {
        let covariance = standard.covariance(nulls, accepted);
        let [w, back] = whitener(&covariance);
        Self { standard, covariance, w, back }
    }

    /// Number of statistics in use.
    pub fn width(&self) -> usize {
        self.standard.columns.len()
    }

    /// Standardises, compresses and whitens one flight.
    pub fn flight(&self, statistics: &[f64]) -> DVector<f64> {
        self.apply(&compressed(&self.standard.raw(statistics)))
    }

    /// Whitened numbers of compressed ones.
    pub fn apply(&self, compressed: &[f64]) -> DVector<f64> {
        &self.w * DVector::from_column_slice(compressed)
    }

    /// Whitened rows of compressed rows.
    pub fn apply_rows(&self, rows: &[Vec<f64>]) -> DMatrix<f64> {
        matrix(rows, self.width()) * self.w.transpose()
    }

    /// Compressed numbers of whitened ones.
    pub fn undo(&self, z: &DVector<f64>) -> DVector<f64> {
        &self.back * z
    }

    /// The same of columns.
    pub fn undo_all(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        &self.back * columns
    }
}

/// Compressed; unknown becomes "as in a null flight".
pub(super) fn compressed(raw: &[f64]) -> Vec<f64> {
    raw.iter().map(|x| if x.is_finite() { compress(*x) } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_model::random::Stream;

    fn rows(of: &[Vec<f64>]) -> Vec<&[f64]> {
        of.iter().map(Vec::as_slice).collect()
    }

    /// Statistics that go together in the bank do so on the airframe, whose own flights are too few to show it.
    #[test]
    fn prop_healthy_flights_of_the_airframe_are_white() {
        let mut rng = Stream::new(5, "white");
        let (width, airframes) = (40, 40);
        let mut flights = |count: usize, sigma: f64, from: f64| -> Vec<Vec<f64>> {
            let mut one = || {
                let common = rng.normal();
                let own = |rng: &mut Stream| from + sigma * (common + 0.5 * rng.normal());
                (0..width).map(|_| own(&mut rng)).collect()
            };
            (0..count).map(|_| one()).collect()
        };
        let bank = flights(60, 1.0, 0.0);
        let nulls = rows(&bank);
        let mut mean = 0.0;
        for _ in 0..airframes {
            let (accepted, next) = (flights(10, 1.0, 7.0), flights(10, 1.0, 7.0));
            let accepted = rows(&accepted);
            let none = std::iter::empty::<&[f64]>();
            let standard =
                Standard::new([&nulls, &[]], none, &accepted, &[], Hours::default(), |_| true);
            let whitening = Whitening::new(standard, &nulls, &accepted);
            let square = |flight: &Vec<f64>| {
                whitening.apply(&compressed(&whitening.standard.raw(flight))).norm_squared()
            };
            mean += next.iter().map(square).sum::<f64>() / f64::from(10 * width * airframes);
        }
        assert!((0.8..1.25).contains(&mean), "{mean}");
    }

    #[test]
    fn prop_what_a_computer_cannot_resolve_is_no_gap_in_any_view() {
        // A number that is exact in the simulator: it varies by 1e-8 from flight to flight.
        let nulls: Vec<Vec<f64>> = (0..30).map(|i| vec![f64::from(i % 5) * 1e-8]).collect();
        let nulls: Vec<&[f64]> = nulls.iter().map(Vec::as_slice).collect();
        let none = std::iter::empty::<&[f64]>();
        let seen = |resolution: &[f64], off: f64| {
            let standard = Standard::new(
                [&nulls, &[]],
                none.clone(),
                &[],
                resolution,
                Hours::default(),
                |_| true,
            );
            let raw = compressed(&standard.raw(&[off]));
            Whitening::new(standard, &nulls, &[]).apply(&raw)[0]
        };
        assert!(seen(&[], 1e-5) > 8.0, "without a resolution it stands out");
        assert!(seen(&[1e-4], 1e-5).abs() < 0.2, "a tenth of the resolution is nothing");
        let ten = seen(&[1e-4], 1e-3);
        assert!((5.0..10.5).contains(&ten), "ten times is ten sigma, compressed: {ten}");
    }
}
