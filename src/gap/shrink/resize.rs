//! The size of an effect, searched once more by flying it: the surrogate of the bank says which
//! effect and roughly how large; another law of the same effect on the real vehicle makes that size
//! wrong, and only the closed loop says by how much.
//!
//! The flight that was diagnosed is flown again with the effect at shares of its size, noise paired,
//! and the share with the least distance is taken. Share 0 is among them: an effect that makes the
//! simulator no more like the flight it was fitted to is not added at all.

use crate::bank::library;
use haltere_model::Vehicle;
use haltere_model::effects::{EffectSpec, ParameterSpec};

/// Shares that are flown.
const SHARES: [f64; 8] = [0.25, 0.4, 0.55, 0.7, 0.85, 1.0, 1.2, 1.45];

/// Searches the size of an effect of a vehicle. `left` flies the mission of the flight that was diagnosed with effects, or knows what it flew
/// before, and says how far it is from that. Along the size this is taken to have one valley, so that of two neighbours the nearer one says on which side of
/// them the nearest lies: four or five of the eight shares are flown. Returns the share and the parameters; `None`: the effect does not help at
/// any size.
pub fn resize(
    left: impl Fn(&[(&EffectSpec, &[f64])]) -> f64,
    vehicle: &Vehicle,
    spec: &EffectSpec,
    theta: &[f64],
) -> Option<(f64, Vec<f64>)> {
    let mut sizes = SHARES.map(|share| (share, at_share(spec, vehicle, theta, share))).to_vec();
    // Shares beyond what is plausible are one size, and say nothing of the side.
    sizes.dedup_by(|next, kept| next.1 == kept.1);
    let distance = |at: usize| left(&[(spec, &sizes[at].1)]);
    let (mut low, mut high) = (0, sizes.len() - 1);
    while low < high {
        let middle = (low + high) / 2;
        // Sizes that cannot be flown are infinitely far: smaller ones are tried.
        let is_below = distance(middle) <= distance(middle + 1);
        (low, high) = if is_below { (low, middle) } else { (middle + 1, high) };
    }
    (distance(low) < left(&[])).then(|| sizes.swap_remove(low))
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

    #[test]
    fn prop_the_nearest_size_is_found_by_five_at_most() {
        let spec = library::find("P1").unwrap();
        for truth in SHARES.into_iter().chain([0.0, 3.0]) {
            let flown = std::cell::RefCell::new(std::collections::BTreeSet::new());
            let left = |effects: &[(&EffectSpec, &[f64])]| {
                let Some((_, theta)) = effects.first() else { return truth.powi(2) };
                flown.borrow_mut().insert(theta[0].to_bits());
                // Losses of more than 14 % cannot be flown.
                if theta[0] > 0.14 { f64::INFINITY } else { (theta[0] / 0.1 - truth).powi(2) }
            };
            let found =
                resize(left, &Vehicle::default(), spec, &[0.1]).map_or(0.0, |(share, _)| share);
            let share = if truth > 1.2 { 1.2 } else { truth };
            assert!((found - share).abs() < 1e-9, "{truth}: {found}");
            let flown = flown.borrow().len();
            assert!(flown <= 5, "{truth}: {flown} sizes");
        }
    }

    /// The smaller shares of what is hardly plausible are all the least size; two of them, equally far, sent the search away from the nearest.
    #[test]
    fn bug_shares_that_are_one_size_do_not_hide_the_nearest() {
        let spec = library::find("P1").unwrap();
        let vehicle = Vehicle::default();
        let theta = 1.5 * spec.parameters[0].of(&vehicle).low;
        let left = |effects: &[(&EffectSpec, &[f64])]| {
            effects.first().map_or(1.0, |(_, sized)| (sized[0] / theta - 0.7).powi(2))
        };
        let (share, sized) = resize(left, &vehicle, spec, &[theta]).unwrap();
        assert!(theta > 0.0 && share == 0.7 && (sized[0] - 0.7 * theta).abs() < 1e-9, "{share}");
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
