//! The size of an effect, searched once more by flying it: the surrogate of the bank says which
//! effect and roughly how large; another law of the same effect on the real vehicle makes that size
//! wrong, and only the closed loop says by how much.
//!
//! The flight that was diagnosed is flown again with the effect, noise paired, at its size and at shares of it that differences along the
//! size foretell, and the nearest of all is taken. Share 0 is among
//! them: an effect that makes the simulator no more like the flight it was fitted to is not added at all.

use crate::bank::library;
use crate::shrink::compressed;
use haltere_model::Vehicle;
use haltere_model::effects::{EffectSpec, ParameterSpec};

/// Shares that are flown (judgement): beyond them it is hardly the effect that was named.
const SHARES: [f64; 2] = [0.25, 1.45];
/// Sizes that are flown at most (judgement): the effect's own, and two that are foretold.
const SIZES: usize = 3;
/// Steps in which foretold shares are looked through, 0.025 each (judgement).
const STEPS: usize = 48;
/// Shares nearer to one another than this part of them are one (judgement).
const ALIKE: f64 = 0.1;

/// How far flights with an effect are from the one that was diagnosed.
#[derive(Debug, Clone)]
pub struct Off {
    /// Mean of every statistic less that of the flight, sigma; NaN: unknown.
    pub mean: Vec<f64>,
    /// Mean distance; infinite: the effect cannot be flown.
    pub distance: f64,
}

/// Searches the size of an effect of a vehicle. `off` flies the mission of the flight that was diagnosed with effects, or knows what it
/// flew before. Returns the share and the parameters; `None`: the effect does not help at any size that was flown.
pub fn resize(
    off: impl Fn(&[(&EffectSpec, &[f64])]) -> Off,
    vehicle: &Vehicle,
    spec: &EffectSpec,
    theta: &[f64],
) -> Option<(f64, Vec<f64>)> {
    let mut flown: Vec<Flown> = vec![(0.0, Vec::new(), off(&[]))];
    let mut share = 1.0;
    while flown.len() <= SIZES {
        let sized = at_share(spec, vehicle, theta, share);
        // Shares beyond what is plausible are one size.
        let known =
            |(was, theta, _): &Flown| (share - was).abs() < ALIKE * share || *theta == sized;
        if flown.iter().any(known) {
            break;
        }
        let found = off(&[(spec, &sized)]);
        flown.push((share, sized, found));
        share = foretold(&flown);
    }
    let best = flown.into_iter().min_by(|a, b| a.2.distance.total_cmp(&b.2.distance));
    best.filter(|(share, ..)| *share > 0.0).map(|(share, sized, _)| (share, sized))
}

/// A share, its parameters, and what came of it.
type Flown = (f64, Vec<f64>, Off);

/// Share at which the flight is nearest if every statistic goes with the share as the polynomial through the flown ones (Lagrange 1795);
/// half of the least one that cannot be flown where none can.
///
/// `z(s) = Σ_k z(s_k) Π_{j≠k} (s - s_j) / (s_k - s_j)`, least `Σ c(z(s))²` over the statistics. `s`: share; `z`: a mean difference (sigma); `c`: [`compressed`].
fn foretold(flown: &[Flown]) -> f64 {
    let can = |(_, _, off): &&Flown| off.distance.is_finite();
    let points: Vec<&Flown> = flown.iter().filter(can).collect();
    let cannot = flown.iter().filter(|it| it.0 > 0.0 && !can(it)).map(|(share, ..)| *share);
    let most = cannot.fold(f64::INFINITY, f64::min);
    if points.len() < 2 {
        return 0.5 * most.min(1.0);
    }
    let left = |share: f64| -> f64 {
        let part = |(k, (own, ..)): (usize, &&Flown)| -> f64 {
            let others = points.iter().enumerate().filter(|(j, _)| *j != k);
            others.map(|(_, (other, ..))| (share - other) / (own - other)).product()
        };
        let parts: Vec<f64> = points.iter().enumerate().map(part).collect();
        let of = |j: usize| parts.iter().zip(&points).map(|(p, (_, _, off))| p * off.mean[j]).sum();
        let squares = (0..points[0].2.mean.len()).map(|j| compressed(of(j)).powi(2));
        squares.filter(|square| square.is_finite()).sum()
    };
    let shares = (0..=STEPS)
        .map(|k| SHARES[0] + (SHARES[1].min(most) - SHARES[0]) * k as f64 / STEPS as f64);
    let near = |a: &f64, b: &f64| left(*a).total_cmp(&left(*b));
    shares.min_by(near).unwrap_or(1.0)
}

/// Parameters at a share of their size, within what is plausible on the vehicle.
fn at_share(spec: &EffectSpec, vehicle: &Vehicle, theta: &[f64], share: f64) -> Vec<f64> {
    let sized = library::at_share(spec, theta, share);
    // A size that was already outside stays reachable.
    let within = |((p, v), was): ((&ParameterSpec, f64), &f64)| {
        let p = p.of(vehicle);
        v.clamp(p.low.min(*was), p.high.max(*was))
    };
    spec.parameters.iter().zip(sized).zip(theta).map(within).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share_of(id: &str, theta: &[f64], share: f64) -> Vec<f64> {
        let spec = library::standard().into_iter().find(|s| s.id == id).unwrap();
        at_share(spec, &Vehicle::default(), theta, share)
    }

    /// What is found for a loss of `loss` where a share of it is off by `mean`, and shares above `most` cannot be flown; and how many were flown.
    fn search(loss: f64, most: f64, mean: impl Fn(f64) -> Vec<f64>) -> (Option<f64>, usize) {
        let count = std::cell::Cell::new(0);
        let off = |effects: &[(&EffectSpec, &[f64])]| {
            let share = effects.first().map_or(0.0, |(_, theta)| theta[0] / loss);
            count.set(count.get() + effects.len());
            let mean = mean(share);
            let known = mean.iter().filter(|z| z.is_finite());
            let distance = known.map(|z| compressed(*z).powi(2)).sum();
            Off { distance: if share > most { f64::INFINITY } else { distance }, mean }
        };
        let found = resize(off, &Vehicle::default(), library::find("P1").unwrap(), &[loss]);
        (found.map(|(_, theta)| theta[0] / loss), count.get())
    }

    #[test]
    fn prop_the_nearest_size_is_found_by_three_at_most_however_loud() {
        for (bend, loud) in [(1.0, 1.0), (1.0, 1e3), (2.0, 30.0), (0.75, 30.0), (0.75, 1e3)] {
            for truth in [0.3_f64, 0.55, 0.7, 1.0, 1.2, 1.4] {
                let gap = |share: f64| loud * (share.powf(bend) - truth.powf(bend));
                // The second statistic is off by what no size mends, the third unknown.
                let mean = |share| vec![gap(share), 0.02 * loud - 0.4 * gap(share), f64::NAN];
                let (share, count) = search(0.1, f64::INFINITY, mean);
                let near = share.is_some_and(|share| (share / truth - 1.0).abs() < 0.2);
                assert!(near && count <= 3, "{truth}, {bend}, {loud}: {share:?} by {count}");
            }
        }
    }

    #[test]
    fn prop_sizes_that_cannot_be_flown_or_do_not_help_are_not_taken() {
        let line = |truth: f64| move |share: f64| vec![20.0 * (share - truth)];
        let near = |share: f64| (share - 0.8).abs() < 0.1;
        assert!(search(0.1, 0.9, line(0.8)).0.is_some_and(near));
        assert!(search(0.2, 0.3, line(0.25)).0.is_some_and(|share| (share - 0.25).abs() < 1e-9));
        assert_eq!(search(0.1, 0.1, line(0.1)).0, None, "too large to be flown at any share");
        assert_eq!(search(0.1, 2.0, line(-0.5)).0, None, "the other way");
    }

    /// The smaller shares of what is hardly plausible are all the least size; a search that flew two of them learned nothing of the side.
    #[test]
    fn bug_shares_that_are_one_size_are_flown_once() {
        let least = library::find("P1").unwrap().parameters[0].of(&Vehicle::default()).low;
        let (share, count) = search(1.5 * least, f64::INFINITY, |share| vec![share - 0.6]);
        assert!(share.is_some_and(|share| (share * 1.5 - 1.0).abs() < 1e-9), "{share:?}");
        assert_eq!(count, 2, "as it is, and the least");
    }

    #[test]
    fn prop_sizes_scale_and_places_and_shapes_stay() {
        assert_eq!(share_of("U2", &[0.3, 5.0], 0.5), [0.15, 5.0]);
        assert_eq!(share_of("A8", &[0.2, 0.31], 0.5), [0.1, 0.31]);
        assert_eq!(share_of("M1", &[0.4, -0.2, 0.1], 0.5), [0.2, -0.1, 0.05]);
        assert_eq!(share_of("A6", &[0.8, 3.0, 2.0, 0.7, 120.0], 0.5), [0.4, 3.0, 2.0, 0.7, 120.0]);
        assert_eq!(share_of("A1", &[1.4, 0.8, 1.0], 0.5), [1.2, 0.9, 1.0]);
    }

    #[test]
    fn prop_effects_that_are_off_at_infinity_grow_weaker_towards_it() {
        assert_eq!(share_of("A2", &[0.9], 0.5), [1.8]);
        assert_eq!(share_of("A2", &[2.0], 0.25), [2.5], "the range of the list ends it");
        assert!(share_of("L5", &[11.0], 0.8)[0] > 11.0);
    }
}
