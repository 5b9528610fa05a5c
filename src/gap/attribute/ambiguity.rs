//! Which other effects could have made the same flight.
//!
//! `D² = min over θ' of (m_e - m_e')ᵀ N⁻¹ (m_e - m_e')`: distance between the signature that was
//! found and the closest one of another effect. Below 3.3 the two cannot be told apart at 5 % and
//! 5 % (GAP.md 2.5, stage E): `2 · 1.645` sigma.

use super::evidence::{Fit, Sufficient};
use super::library::Library;

/// Distance below which two effects are merged, sigma.
pub(super) const MERGED: f64 = 3.3;
/// An effect less probable than this is ruled out by the flight itself, whatever the
/// distance between the signatures.
pub(super) const RULED_OUT: f64 = 0.02;

/// Distance from the signature of `fit` to the closest one of effect `other`.
pub(super) fn distance(library: &Library, fit: &Fit, other: usize) -> f64 {
    let (Some(own), Some(rival)) = (library.effects.get(fit.effect), library.effects.get(other))
    else {
        return f64::INFINITY;
    };
    let mean = own.mean(&fit.h);
    let closest = Sufficient::new(rival, &mean).fit(other);
    library.left(&mean, &closest).squared.max(0.0).sqrt()
}

/// Effects among `candidates` that are not told apart from `fit` and not ruled out.
pub(super) fn merged(
    library: &Library,
    fit: &Fit,
    candidates: &[usize],
    posterior: &[f64],
) -> Vec<(usize, f64)> {
    candidates
        .iter()
        .filter(|e| **e != fit.effect && posterior.get(**e).is_some_and(|p| *p >= RULED_OUT))
        .map(|e| (*e, distance(library, fit, *e)))
        .filter(|(_, d)| *d < MERGED)
        .collect()
}
