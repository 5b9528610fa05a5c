//! Two effects at once: each that was searched, with every other effect.
//!
//! Standardised statistics add, compressed ones do not: the signature of a pair is
//! `c(c⁻¹(m₁) + c⁻¹(m₂))`. Pairs are screened as if the compressed added, the best are fitted
//! jointly in both parameters with the exact composition.

use nalgebra::DVector;

use super::evidence::{Fit, Sufficient, climb};
use super::library::{Left, Library};
use super::linear::{Noise, joined};
use super::whiten::{compress, expand};

/// Evidence that a second effect adds, relative to the strength of the first: a signature that is
/// wrong by some per cent leaves the more, the larger the effect, and anything explains some of it.
pub(super) fn relative(gain: f64, first: f64) -> f64 {
    gain / (OFFSET + first.max(0.0))
}

/// Strength of a first effect below which its error is noise, in log evidence.
const OFFSET: f64 = 10.0;

/// Most rounds of a joint fit (judgement).
const ROUNDS: usize = 3;

/// Two effects and how well they explain a flight.
#[derive(Debug, Clone)]
pub(super) struct PairFit {
    /// Places of the effects in the bank.
    pub effects: [usize; 2],
    /// Parameters on the unit cubes.
    pub units: [Vec<f64>; 2],
    /// Log evidence, Laplace.
    pub log_z: f64,
    /// What it leaves.
    pub left: Left,
    /// The same, whitened.
    pub residual: DVector<f64>,
}

/// Log evidence of the best single.
pub(super) fn best_single(fits: &[Fit]) -> f64 {
    fits.iter().map(|fit| fit.log_z).fold(f64::NEG_INFINITY, f64::max)
}

/// Best pairs, best first; `polished`: how many are fitted jointly.
pub(super) fn search(
    library: &Library,
    z: &DVector<f64>,
    fits: &[Fit],
    polished: usize,
) -> Vec<PairFit> {
    let mut screened: Vec<(f64, &Fit, Fit)> = Vec::new();
    for first in fits.iter().filter(|fit| fit.is_searched()) {
        let Some(s) = library.effects.get(first.effect) else { continue };
        let rest = z - s.mean(&first.h);
        for (e, second) in library.effects.iter().enumerate() {
            let taken = screened.iter().any(|(_, a, b)| a.effect == e && b.effect == first.effect);
            if e == first.effect || taken {
                continue;
            }
            let fit = Sufficient::new(second, &rest).screen(e);
            screened.push((fit.log_z, first, fit));
        }
    }
    screened.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut pairs: Vec<PairFit> = screened
        .iter()
        .take(polished)
        .map(|(_, first, second)| joint(library, z, first, second))
        .collect();
    pairs.sort_by(|a, b| b.log_z.total_cmp(&a.log_z));
    pairs
}

/// Fits both parameters together.
fn joint(library: &Library, z: &DVector<f64>, first: &Fit, second: &Fit) -> PairFit {
    let effects = [first.effect, second.effect];
    let [a, b] = effects.map(|e| &library.effects[e]);
    let whitening = &library.whitening;
    let (qa, qb) = (whitening.undo_all(&a.q), whitening.undo_all(&b.q));
    let cut = a.space.len();
    let residual = |u: &[f64]| {
        let (ua, ub) = u.split_at(cut);
        let mean = (&qa * a.coordinates(ua))
            .zip_map(&(&qb * b.coordinates(ub)), |x, y| compress(expand(x) + expand(y)));
        z - whitening.apply(mean.as_slice())
    };
    let noise = |u: &[f64]| {
        let (ua, ub) = u.split_at(cut);
        let (la, lb) = (a.level(&a.coordinates(ua)), b.level(&b.coordinates(ub)));
        let d = &a.spread.0 * la + &b.spread.0 * lb;
        Noise::new(&d, &joined(&(&a.spread.1 * la.sqrt()), &(&b.spread.1 * lb.sqrt())))
    };
    let both = joined(&a.q, &b.q);
    let coordinates = |u: &[f64]| {
        let (ua, ub) = u.split_at(cut);
        let (ha, hb) = (a.coordinates(ua), b.coordinates(ub));
        DVector::from_iterator(both.ncols(), ha.iter().chain(&hb).copied())
    };
    let mut unit: Vec<f64> = first.unit.iter().chain(&second.unit).copied().collect();
    let (mut last, mut rest) = (noise(&unit), residual(&unit));
    for _ in 0..ROUNDS {
        // What the exact composition differs by from a sum hardly changes with the parameters: it is held while they are searched.
        let aim = &rest + &both * coordinates(&unit);
        let solved = last.solve(&both);
        let (gram, seen) = (both.tr_mul(&solved), solved.tr_mul(&aim));
        let objective = |u: &[f64]| {
            let h = coordinates(u);
            h.dot(&seen) - 0.5 * h.dot(&(&gram * &h))
        };
        let found = climb(objective(&unit), unit.clone(), objective).1;
        let left = residual(&found);
        // Nothing else, or nothing better, comes of another round.
        if last.squared(&left) >= last.squared(&rest) {
            break;
        }
        (last, rest, unit) = (noise(&found), left, found);
    }
    let left = Left { squared: last.squared(&rest), peak: last.peak(&rest) };
    let peak = -0.5 * left.squared - 0.5 * last.log_det;
    // What integrating over θ costs, from each effect alone.
    let alone = |s, at: &DVector<f64>, e| {
        let fit = Sufficient::new(s, at).fit(e);
        fit.peak - fit.log_z
    };
    let (ua, ub) = unit.split_at(cut);
    let price = alone(a, &(z - b.mean(&b.coordinates(ub))), effects[0])
        + alone(b, &(z - a.mean(&a.coordinates(ua))), effects[1]);
    let units = [ua.to_vec(), ub.to_vec()];
    PairFit { effects, units, log_z: peak - price, left, residual: rest }
}
