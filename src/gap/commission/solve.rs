//! From what flights show to constants: one step of Gauss and Newton with a prior, and variances of what no constant explains by
//! expectation and maximisation. Pure numbers; constants are in sigma of their priors.
//!
//! ```text
//! d_j = Σ_k J_jk s_k + e_j        x + s ~ N(0, 1)        e_j ~ Student(ν) of variance  b_j + τ_g² v_j
//! ```
//! `d` real mean less simulated mean of statistic `j`, `J` its slope on constant `k`, `x` where the constants are and `s` the step,
//! `b` variance of `d` by chance, `v` variance of one flight, `τ_g` misfit of the group `g` of the statistic: what a model with other
//! laws leaves however its constants are chosen (Kennedy and O'Hagan 2001). Without it intervals would be those of a perfect model.
//! A statistic that stands alone counts less the farther it is off (Lange, Little and Taylor 1989), and those of a group that say the
//! same count as one: each by `n_eff / n`.

use nalgebra::{DMatrix, DVector};

/// Degrees of freedom of a statistic's error: between four and six is usual for robust regression (Lange et al. 1989).
const FREEDOM: f64 = 4.0;
/// Rounds of expectation and maximisation: variances have settled to a per cent by then.
const ROUNDS: usize = 60;
/// A constant is shown by flights where they leave less than this of its prior's sigma (judgement: they say more than a third of
/// what was not known).
pub const SHOWN: f64 = 0.8;

/// What flights show, statistic by statistic.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// Real mean less simulated mean.
    pub off: Vec<f64>,
    /// Its variance by chance.
    pub chance: Vec<f64>,
    /// Variance of one flight.
    pub flight: Vec<f64>,
    /// Slope of the simulated mean on each constant, a row for each statistic.
    pub slopes: DMatrix<f64>,
    /// Group of each statistic, from 0.
    pub group: Vec<usize>,
    /// By how much each statistic counts: share of its group that is news.
    pub news: Vec<f64>,
    /// Where the constants are, in sigma of their priors.
    pub at: Vec<f64>,
}

/// What follows for the constants.
#[derive(Debug, Clone)]
pub struct Posterior {
    /// Where they lie, in sigma of their priors; 0 where flights do not show them.
    pub at: Vec<f64>,
    /// Sigma of that; 1 where flights do not show them.
    pub std: Vec<f64>,
    /// Weight of each statistic: the reciprocal of its variance.
    pub weight: Vec<f64>,
    /// Minus twice the logarithm of how likely these flights are where these constants are free and the others are the file's, but for
    /// a number that is the same for all choices (Laplace 1774: what a constant could have been as well counts against it).
    pub unlikely: f64,
}

impl Posterior {
    /// What is left of these differences and of the prior: what a step makes smaller.
    pub fn left(&self, off: &[f64], at: &[f64]) -> f64 {
        let of_flights = off.iter().zip(&self.weight).filter(|(d, _)| d.is_finite());
        of_flights.map(|(d, w)| w * d * d).sum::<f64>() + at.iter().map(|x| x * x).sum::<f64>()
    }

    /// Whether flights show this constant.
    pub fn shows(&self, constant: usize) -> bool {
        self.std[constant] < SHOWN
    }
}

impl Evidence {
    /// All constants at once.
    pub fn solve(&self) -> Posterior {
        let all: Vec<usize> = (0..self.at.len()).collect();
        self.solve_for(&all)
    }

    /// Only those that flights show: the one that is shown least is held at its prior, again and again. Of constants that stand for one
    /// another some stay until the others are held.
    pub fn solve_shown(&self) -> Posterior {
        let mut free: Vec<usize> = (0..self.at.len()).collect();
        loop {
            let posterior = self.solve_for(&free);
            let least =
                free.iter().copied().max_by(|a, b| posterior.std[*a].total_cmp(&posterior.std[*b]));
            match least {
                Some(least) if !posterior.shows(least) => free.retain(|k| *k != least),
                _ => return posterior,
            }
        }
    }

    /// The same where a step to there is in doubt: by a share of what it does to each statistic, and by so much more for each sigma.
    pub fn doubting(&self, to: &[f64], share: f64, curve: f64) -> Self {
        let mut doubting = self.clone();
        for (chance, slopes) in doubting.chance.iter_mut().zip(self.slopes.row_iter()) {
            for (slope, (to, at)) in slopes.iter().zip(to.iter().zip(&self.at)) {
                let step = to - at;
                *chance += ((share + curve * step.abs()) * slope * step).powi(2);
            }
        }
        doubting
    }

    /// These constants; the others at their priors.
    pub fn solve_for(&self, free: &[usize]) -> Posterior {
        let n = self.off.len();
        let slopes = self.slopes.select_columns(free);
        // What is held goes back to its prior: the differences that it made are there again.
        let mut off = DVector::from_column_slice(&self.off);
        for (k, at) in self.at.iter().enumerate().filter(|(k, _)| !free.contains(k)) {
            off += self.slopes.column(k) * *at;
        }
        let at = DVector::from_iterator(free.len(), free.iter().map(|k| self.at[*k]));
        let groups = self.group.iter().max().map_or(0, |g| g + 1);
        let mut misfit = vec![0.0; groups];
        let mut robust = vec![1.0; n];
        let mut step = DVector::zeros(free.len());
        let mut covariance = DMatrix::identity(free.len(), free.len());
        let mut weight = vec![0.0; n];
        let mut unlikely = f64::INFINITY;
        for _ in 0..ROUNDS {
            for j in 0..n {
                let variance = self.chance[j] + misfit[self.group[j]] * self.flight[j];
                weight[j] = self.news[j] * robust[j] / variance;
            }
            let weighted = DMatrix::from_fn(n, free.len(), |j, k| weight[j] * slopes[(j, k)]);
            let information = slopes.tr_mul(&weighted) + DMatrix::identity(free.len(), free.len());
            // Positive by the prior's identity.
            let Some(cholesky) = information.cholesky() else { break };
            step = cholesky.solve(&(weighted.tr_mul(&off) - &at));
            covariance = cholesky.inverse();
            unlikely = cholesky.ln_determinant() + (&at + &step).norm_squared();
            let left = &off - &slopes * &step;
            let spread = &slopes * &covariance;
            let mut sums = vec![[0.0; 3]; groups];
            for j in 0..n {
                let variance = self.chance[j] + misfit[self.group[j]] * self.flight[j];
                let square = left[j] * left[j] / variance;
                unlikely +=
                    self.news[j] * (variance.ln() + (FREEDOM + 1.0) * (square / FREEDOM).ln_1p());
                robust[j] = (FREEDOM + 1.0) / (FREEDOM + square);
                let square = robust[j] * (left[j] * left[j] + spread.row(j).dot(&slopes.row(j)));
                let sum = &mut sums[self.group[j]];
                sum[0] += (square - self.chance[j]) / self.flight[j];
                sum[1] += 1.0;
            }
            for (misfit, [excess, count, _]) in misfit.iter_mut().zip(sums) {
                *misfit = (0.5 * *misfit + 0.5 * excess / f64::max(count, 1.0)).max(0.0);
            }
        }
        let (origin, whole) = (vec![0.0; self.at.len()], vec![1.0; self.at.len()]);
        let mut posterior = Posterior { at: origin, std: whole, weight, unlikely };
        for (place, k) in free.iter().enumerate() {
            posterior.at[*k] = at[place] + step[place];
            posterior.std[*k] = covariance[(place, place)].sqrt();
        }
        posterior
    }
}

/// Slopes `J` after a step `s` that took `Δd` off the differences, `taken` with the variance `r` of that: along the step they become those
/// that foretell it (Broyden 1965), by the share of it that is not chance (Kalman 1960).
///
/// `J' = J + e² (Δd - J s) sᵀ / (e² |s|² + r)`, `e = error ‖J‖ |s|`: `error` is the share of a slope that changes within a sigma. `J` in units
/// of the statistic by sigma of the prior, `s` in these sigma.
pub fn carried(
    mut slopes: DMatrix<f64>,
    step: &DVector<f64>,
    taken: &[[f64; 2]],
    error: f64,
) -> DMatrix<f64> {
    let length = step.norm_squared();
    for (mut slope, [taken, chance]) in slopes.row_iter_mut().zip(taken) {
        let missed = taken - slope.transpose().dot(step);
        let error = (error * slope.norm()).powi(2) * length;
        let gain = error / (error * length + chance);
        if gain.is_finite() {
            slope += step.transpose() * (gain * missed);
        }
    }
    slopes
}

/// Share of each group's statistics that is news, from flights that differ by chance alone: `(Σ λ)² / Σ λ²` of their correlations
/// (participation ratio) over their number, less what so few flights correlate by themselves.
pub fn news(rows: &[Vec<f64>], group: &[usize]) -> Vec<f64> {
    let scaled: Vec<Vec<f64>> = (0..group.len())
        .map(|j| {
            let column: Vec<f64> = rows.iter().map(|row| row[j]).collect();
            let mean = column.iter().sum::<f64>() / column.len() as f64;
            let square = column.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
            column
                .iter()
                .map(|v| if square > 0.0 { (v - mean) / square.sqrt() } else { 0.0 })
                .collect()
        })
        .collect();
    let by_chance = 1.0 / (rows.len().max(2) as f64 - 1.0);
    let groups = group.iter().max().map_or(0, |g| g + 1);
    let shares: Vec<f64> = (0..groups)
        .map(|g| {
            let places: Vec<usize> = (0..group.len()).filter(|j| group[*j] == g).collect();
            let n = places.len() as f64;
            let mut more = 0.0;
            for (k, a) in places.iter().enumerate() {
                for b in &places[k + 1..] {
                    let r: f64 = scaled[*a].iter().zip(&scaled[*b]).map(|(x, y)| x * y).sum();
                    more += 2.0 * (r * r - by_chance);
                }
            }
            n / (n + more.max(0.0))
        })
        .collect();
    group.iter().map(|g| shares[*g]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_model::random::Stream;

    /// Statistics of two groups, the second with laws that no constant explains, of five constants; the last one moves nothing.
    fn world(seed: u64) -> (Evidence, Vec<f64>) {
        let (n, constants) = (60, 5);
        let mut rng = Stream::new(seed, "commission");
        let slopes = DMatrix::from_fn(n, constants, |j, k| {
            if k == 4 || (j >= 30) == (k < 2) { 0.0 } else { rng.normal() }
        });
        let truth: Vec<f64> = (0..constants).map(|_| rng.normal()).collect();
        let noise = |j: usize| if j >= 30 { 1.0 } else { 0.1 };
        let off = (0..n)
            .map(|j| {
                let shift: f64 = (0..constants).map(|k| slopes[(j, k)] * truth[k]).sum();
                shift + noise(j) * rng.normal()
            })
            .collect();
        let evidence = Evidence {
            off,
            chance: vec![0.01; n],
            flight: vec![0.04; n],
            slopes,
            group: (0..n).map(|j| usize::from(j >= 30)).collect(),
            news: vec![1.0; n],
            at: vec![0.0; constants],
        };
        (evidence, truth)
    }

    #[test]
    fn prop_intervals_hold_the_truth_as_often_as_they_say_with_laws_that_are_not_ours() {
        let (mut inside, mut count) = (0, 0);
        for seed in 0..60 {
            let (evidence, truth) = world(seed);
            let posterior = evidence.solve();
            for (truth, (at, std)) in
                truth.iter().zip(posterior.at.iter().zip(&posterior.std)).take(4)
            {
                count += 1;
                inside += usize::from((at - truth).abs() < 1.645 * std);
            }
        }
        let share = f64::from(inside as u32) / f64::from(count);
        assert!((0.84..=0.96).contains(&share), "{share} of 0.90");
    }

    #[test]
    fn prop_slopes_follow_a_step_along_it_alone_and_not_its_noise() {
        let slopes = DMatrix::from_row_slice(3, 2, &[1.0, 2.0, 1.0, 2.0, 0.0, 0.0]);
        let (step, across) = (DVector::repeat(2, 1.0), DVector::from_vec(vec![1.0, -1.0]));
        // The step was to take three off: it took four, in the second by chance; nothing moves the third.
        let taken = [[4.0, 0.0], [4.0, 1e6], [4.0, 0.0]];
        let after = carried(slopes.clone(), &step, &taken, 0.05);
        let wanted = DVector::from_vec(vec![4.0, 3.0, 0.0]);
        assert!((&after * &step - wanted).norm() < 1e-3, "{after}");
        assert!((&after * &across - &slopes * &across).norm() < 1e-9, "{after}");
        let stood = carried(slopes.clone(), &DVector::zeros(2), &[[0.1, 1.0]; 3], 0.05);
        assert_eq!(stood, slopes);
    }

    #[test]
    fn prop_what_nothing_shows_stays_where_it_was_and_says_so() {
        let (evidence, truth) = world(7);
        let posterior = evidence.solve_shown();
        assert_eq!((posterior.at[4], posterior.std[4]), (0.0, 1.0));
        assert!(!posterior.shows(4) && (0..4).all(|k| posterior.shows(k)));
        assert!((posterior.at[0] - truth[0]).abs() < 0.1);
    }

    #[test]
    fn prop_a_step_from_elsewhere_ends_where_one_from_the_prior_does() {
        let (evidence, _) = world(3);
        let from_prior = evidence.solve();
        let elsewhere = vec![0.5, -0.4, 0.3, -0.2, 0.1];
        let mut moved = evidence.clone();
        let shift = &evidence.slopes * DVector::from_column_slice(&elsewhere);
        moved.off = evidence.off.iter().zip(shift.iter()).map(|(d, s)| d - s).collect();
        moved.at = elsewhere;
        for (a, b) in from_prior.at.iter().zip(moved.solve().at) {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
        for (a, b) in from_prior.at.iter().zip(moved.solve_shown().at).take(4) {
            assert!((a - b).abs() < 1e-2, "{a} {b}");
        }
    }

    #[test]
    fn prop_copies_of_one_statistic_are_news_once() {
        let mut rng = Stream::new(1, "news");
        let rows: Vec<Vec<f64>> = (0..40)
            .map(|_| {
                let one = rng.normal();
                let mut row = vec![one; 5];
                row.extend((0..5).map(|_| rng.normal()));
                row
            })
            .collect();
        let news = news(&rows, &[0, 0, 0, 0, 0, 1, 1, 1, 1, 1]);
        assert!((news[0] - 0.2).abs() < 0.03 && news[9] > 0.85, "{news:?}");
    }
}
