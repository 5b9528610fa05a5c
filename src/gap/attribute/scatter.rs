//! How much a statistic of a healthy flight scatters: in the bank, and on the airframe whose accepted flights are there.
//!
//! Accepted flights are few and often of one hour, and a flight that is judged is of another, with another charge, another load of
//! the computer, a start some centimetres beside the mark and trims that were set anew. Within an hour their own scatter counts, and that of the
//! bank's flights of one vehicle as of some flights more: both are the same scatter, and their sum made noise twice as wide as it is. What
//! another hour adds is taught by worlds that were drawn. No healthy flight scatters less than the benign constants of a vehicle make
//! it do in the bank: accepted flights share theirs.
//!
//! ```text
//! σ² = w (1 + 1/n) + max(h r w, s_j² - w, 0),   w = ν/(ν - 2) (ν₀ s_s² + (n - 1) s²)/ν,   ν = ν₀ + n - 1
//! ```
//! σ of a statistic in another flight, in its unit (variance of Student's predictive distribution); s over n accepted flights; s_s over
//! the bank's flights of one vehicle, which count as ν₀, and s_j over those whose constants are drawn; h how surely the accepted ones are
//! of one hour, 0 to 1, and r what another hour adds, in variances within one ([`Hours`]).

use std::collections::BTreeMap;
use std::sync::LazyLock;

use crate::flight::residuals::StatSpec;
use crate::normal::median;

/// Fewer reference flights say nothing about a centre and a scatter.
pub(super) const LEAST_REFERENCES: usize = 4;
/// Flights that the bank counts as beside accepted ones (judgement). Few, so that these soon outweigh a simulator; some, since
/// one of hundreds of statistics repeats on ten flights by chance.
const BANK_COUNT: f64 = 4.0;
/// Accepted flights that are an hour's work, and those that are surely of several: packs have to be charged between (judgement).
const OF_ONE_HOUR: f64 = 10.0;
const OF_SEVERAL: f64 = 20.0;
/// Sigma of a normal variable per median absolute deviation, 1/Φ⁻¹(3/4).
const SIGMA_PER_MAD: f64 = 1.4826;
/// A robust sigma below this share of the plain one is that of a variable that is mostly constant.
const LEAST_ROBUST_SHARE: f64 = 0.3;

/// How surely so many accepted flights are of one hour, 0 to 1.
pub(crate) fn of_one_hour(accepted: usize) -> f64 {
    ((OF_SEVERAL - accepted as f64) / (OF_SEVERAL - OF_ONE_HOUR)).clamp(0.0, 1.0)
}

/// What another hour may add to accepted flights.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Hours<'a> {
    /// How surely the accepted flights are of one, 0 to 1.
    pub one: f64,
    /// Variance that another one adds to every statistic, in variances within one.
    more: &'a [f64],
}

impl<'a> Hours<'a> {
    /// `more`: of every statistic ([`between_hours`]), or empty: hours add nothing. `accepted`: how many flights there are; many
    /// are of several hours and show themselves what these differ by.
    pub fn of(more: &'a [f64], accepted: usize) -> Self {
        Self { one: if more.is_empty() { 0.0 } else { of_one_hour(accepted) }, more }
    }
}

/// Variance that another hour adds to a statistic, in variances within one, as drawn worlds teach it (`haltere-lab worlds --sessions`):
/// some thirty for the pack and the noise of UWB, nothing for most.
pub(crate) fn between_hours(of: &StatSpec) -> f64 {
    static TAUGHT: LazyLock<BTreeMap<String, f64>> =
        LazyLock::new(|| serde_json::from_str(include_str!("hours.json")).unwrap_or_default());
    TAUGHT.get(&of.name).copied().unwrap_or(0.0)
}

/// One statistic.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Scatter {
    /// Median of the bank's flights without an effect, and their robust sigma.
    pub bank: [f64; 2],
    /// Median of accepted flights, and the sigma of one among them; `None`: too few know it.
    pub accepted: Option<[f64; 2]>,
    /// Sigma of the next flight of the airframe, and what of it another hour or other constants add. Without accepted flights it is one of the bank.
    pub next: [f64; 2],
}

impl Scatter {
    /// Statistic `j` of the bank's flights without an effect, `[of one vehicle, with other benign constants]`, and of accepted
    /// flights. `None`: no flight of the bank knows it.
    pub fn of(
        j: usize,
        nulls: [&[&[f64]]; 2],
        accepted: &[&[f64]],
        hours: Hours<'_>,
    ) -> Option<Self> {
        let of = |rows: &[&[f64]]| -> Vec<f64> {
            rows.iter().map(|row| row[j]).filter(|v| v.is_finite()).collect()
        };
        let [seeds, jitter] = nulls.map(of);
        let own = of(accepted);
        let known = [seeds.as_slice(), &jitter].concat();
        if known.is_empty() {
            return None;
        }
        let centre = median(known.iter().copied());
        let sigma = spread(&known, centre);
        let bank = [centre, sigma];
        if own.len() < LEAST_REFERENCES {
            return Some(Self { bank, accepted: None, next: [sigma, 0.0] });
        }
        let about_own = |rows: &[f64]| match rows.len() {
            0..LEAST_REFERENCES => sigma,
            _ => spread(rows, median(rows.iter().copied())),
        };
        let (with_constants, one_vehicle) = (about_own(&jitter), about_own(&seeds).min(sigma));
        let middle = median(own.iter().copied());
        let n = own.len() as f64;
        // Plain and not robust: what an accepted flight does now and then is no gap.
        let squares: f64 = own.iter().map(|v| (v - middle).powi(2)).sum();
        let freedom = BANK_COUNT + n - 1.0;
        let variance = (BANK_COUNT * one_vehicle.powi(2) + squares) / freedom;
        let within = freedom / (freedom - 2.0) * variance;
        let taught = hours.one * hours.more.get(j).copied().unwrap_or(0.0) * within;
        let hours = taught.max(with_constants.powi(2) - within).max(0.0);
        let next = within * (1.0 + 1.0 / n) + hours;
        Some(Self {
            bank,
            accepted: Some([middle, variance.sqrt()]),
            next: [next.sqrt(), hours.sqrt()],
        })
    }
}

/// From the middle, in sigma. What never varies is in the middle.
pub(super) fn in_sigma(value: f64, [middle, sigma]: [f64; 2]) -> f64 {
    (value - middle) / sigma.max(f64::MIN_POSITIVE)
}

/// Robust sigma about `centre`; the plain one for variables that are mostly constant.
pub(super) fn spread(values: &[f64], centre: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let off: Vec<f64> = values.iter().map(|v| (v - centre).abs()).collect();
    let plain = (off.iter().map(|v| v * v).sum::<f64>() / off.len() as f64).sqrt();
    let robust = SIGMA_PER_MAD * median(off);
    if robust >= LEAST_ROBUST_SHARE * plain { robust } else { plain }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::statistics::specs;
    use haltere_model::random::Stream;

    /// Rows of one statistic.
    fn rows(values: &[f64]) -> Vec<&[f64]> {
        values.iter().map(std::slice::from_ref).collect()
    }

    #[test]
    fn prop_hours_add_to_what_they_were_taught_of_and_fade_where_flights_are_of_several() {
        assert_eq!([8, 10, 15, 20, 24].map(of_one_hour), [1.0, 1.0, 0.5, 0.0, 0.0]);
        assert_eq!(Hours::of(&[], 8).one, 0.0, "nothing was taught");
        let more: Vec<f64> = specs().iter().map(between_hours).collect();
        assert!(more.iter().all(|r| (0.0..100.0).contains(r)), "{more:?}");
        // Hours differ first in the pack, and not in most numbers.
        let of = |name: &str| specs().iter().position(|s| s.name == name).map(|j| more[j]);
        assert!(of("battery.start") > Some(20.0), "{:?}", of("battery.start"));
        assert!(median(more.iter().copied()) < 0.3, "{more:?}");
    }

    /// Within an hour both scatter by one: added, as they were, they made two. Constants that accepted flights share are part of
    /// another hour: without them every fifth healthy flight with others was a gap.
    #[test]
    fn bug_the_next_flight_scatters_as_accepted_ones_the_bank_and_hours_do() {
        let mut rng = Stream::new(3, "scatter");
        let mut normal = |count: usize, sigma: f64| -> Vec<f64> {
            (0..count).map(|_| sigma * rng.normal()).collect()
        };
        for (more, constants, next) in
            [(0.0, 1.0, 1.0), (4.0, 1.0, f64::sqrt(5.0)), (0.1, 3.0, 3.0)]
        {
            let (mut sum, worlds) = (0.0, 3000);
            for _ in 0..worlds {
                let [seeds, jitter] = [1.0, constants].map(|sigma| normal(60, sigma));
                let accepted = normal(10, 1.0);
                let more = [more];
                let hours = Hours::of(&more, accepted.len());
                let nulls = [&rows(&seeds)[..], &rows(&jitter)];
                let found = Scatter::of(0, nulls, &rows(&accepted), hours).unwrap();
                let [middle, _] = found.accepted.unwrap();
                sum += ((normal(1, next)[0] - middle) / found.next[0]).powi(2);
            }
            let mean = sum / f64::from(worlds);
            assert!((0.8..1.2).contains(&mean), "{more:?}, {constants}: {mean}");
        }
    }

    #[test]
    fn prop_too_few_accepted_flights_leave_the_bank() {
        let nulls = [1.0, 2.0, 3.0, 4.0, 5.0];
        let few = [7.0, 8.0, f64::NAN];
        let found = Scatter::of(0, [&rows(&nulls), &[]], &rows(&few), Hours::of(&[1.0], 3));
        let found = found.unwrap();
        assert_eq!((found.accepted, found.next), (None, [found.bank[1], 0.0]));
        assert_eq!(Scatter::of(0, [&rows(&[f64::NAN]), &[]], &[], Hours::default()), None);
        assert_eq!(in_sigma(3.0, [3.0, 0.0]), 0.0, "what never varies is in the middle");
    }
}
