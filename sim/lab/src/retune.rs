//! The peer of every named effect: no new effect, but all constants of the nominal model retuned, as
//! SimOpt (Chebotar et al. 2019) and DROPO (Tiboni et al. 2023) do with a search. What it closes is what
//! wrong constants can hide of a missing effect.
//!
//! One Gauss-Newton step with a prior, and its length searched in closed loop. With `z` the standardised
//! deviation of the flight from the nominal model, `J` the change of `z` per relative change of each
//! constant (central differences of flown missions), `s` the prior sigma of a relative change:
//!
//! ```text
//! δ = (JᵀJ/σ² + I/s²)⁻¹ Jᵀ z/σ²,   σ² = 2: one real flight against one simulated
//! ```

use nalgebra::{DMatrix, DVector};

use haltere_gap::flight::statistics::specs;
use haltere_gap::shrink::held_out::HeldOut;
use haltere_model::Vehicle;
use haltere_model::effects::{ALL, EffectSpec, Role, Source};

/// Relative step of the differences: the size of benign jitter.
const STEP: f64 = 0.05;
/// Prior sigma of a relative change: more than that is another aircraft.
const PRIOR: f64 = 0.2;
/// Variance of a standardised difference of two flights.
const VARIANCE: f64 = 2.0;
/// Shares of the step that are flown.
const SHARES: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// Flights with each value of the constants (judgement).
const FLIGHTS: usize = 4;
/// Deviations beyond this many sigma count as so many.
const LARGEST: f64 = 10.0;

/// One constant of the nominal model.
#[derive(Debug, Clone, Copy)]
struct Constant {
    spec: &'static EffectSpec,
    place: usize,
    value: f64,
}

/// Effects with all their values.
pub type Values = Vec<(&'static EffectSpec, Vec<f64>)>;

/// How statistics answer to the constants.
#[derive(Debug)]
pub struct Retuning {
    constants: Vec<Constant>,
    /// Statistics × constants; unknown entries are zero.
    jacobian: DMatrix<f64>,
    middle: DVector<f64>,
}

impl Retuning {
    /// Flies the differences. `progress`: done, of how many.
    pub fn learn(model: &HeldOut<'_>, progress: impl Fn(usize, usize)) -> Self {
        let constants = constants(model.vehicle());
        let clean = |row: Vec<f64>| {
            let known = |v: f64| if v.is_finite() { v.clamp(-LARGEST, LARGEST) } else { 0.0 };
            DVector::from_iterator(row.len(), row.into_iter().map(known))
        };
        let origin = vec![0.0; specs().len()];
        let at = |moved: &Values| clean(model.off(&origin, &borrowed(moved), FLIGHTS).mean);
        let middle = at(&Vec::new());
        let mut jacobian = DMatrix::zeros(middle.len(), constants.len());
        for k in 0..constants.len() {
            let side = |sign: f64| {
                let mut change = vec![0.0; constants.len()];
                change[k] = sign * STEP;
                at(&values(&constants, &change))
            };
            let (up, down) = (side(1.0), side(-1.0));
            if up.len() == middle.len() && down.len() == middle.len() {
                jacobian.set_column(k, &((up - down) / (2.0 * STEP)));
            }
            progress(k + 1, constants.len());
        }
        Self { constants, jacobian, middle }
    }

    /// Constants that make the model most like a flight; empty: none do.
    pub fn fit(&self, model: &HeldOut<'_>, real: &[f64]) -> Values {
        let n = self.constants.len();
        let nominal = model.off(real, &[], FLIGHTS);
        let clean = |v: f64| if v.is_finite() { -v.clamp(-LARGEST, LARGEST) } else { 0.0 };
        let z = DVector::from_iterator(self.middle.len(), nominal.mean.into_iter().map(clean));
        let normal = self.jacobian.tr_mul(&self.jacobian) / VARIANCE
            + DMatrix::identity(n, n) * PRIOR.powi(-2);
        let right = self.jacobian.tr_mul(&z) / VARIANCE;
        let Some(step) = normal.cholesky().map(|c| c.solve(&right)) else { return Vec::new() };
        let mut best = (nominal.distance, Vec::new());
        for share in SHARES {
            let change: Vec<f64> = step.iter().map(|d| d * share).collect();
            let moved = values(&self.constants, &change);
            let left = model.off(real, &borrowed(&moved), FLIGHTS).distance;
            if left < best.0 {
                best = (left, moved);
            }
        }
        best.1
    }
}

/// As the model takes them.
pub fn borrowed(values: &Values) -> Vec<(&EffectSpec, &[f64])> {
    values.iter().map(|(spec, theta)| (*spec, &theta[..])).collect()
}

/// Every constant of every nominal effect that has a size.
fn constants(vehicle: &Vehicle) -> Vec<Constant> {
    let mut vehicle = vehicle.clone();
    let mut found = Vec::new();
    for spec in ALL.iter().filter(|s| s.role == Role::Nominal) {
        for (place, p) in spec.parameters.iter().enumerate() {
            let value = match p.source {
                Source::List => p.default,
                Source::Vehicle(field) => *field(&mut vehicle),
            };
            if value.is_finite() {
                found.push(Constant { spec, place, value });
            }
        }
    }
    found
}

/// Nominal effects with their constants changed, within the range of the list.
fn values(constants: &[Constant], change: &[f64]) -> Values {
    let mut out: Values = Vec::new();
    for (constant, change) in constants.iter().zip(change) {
        if out.last().is_none_or(|(spec, _)| spec.id != constant.spec.id) {
            let nominal = constants.iter().filter(|c| c.spec.id == constant.spec.id);
            out.push((constant.spec, nominal.map(|c| c.value).collect()));
        }
        let p = &constant.spec.parameters[constant.place];
        if let Some(slot) = out.last_mut().and_then(|(_, theta)| theta.get_mut(constant.place)) {
            let moved = constant.value * (1.0 + change);
            *slot = moved.clamp(p.low.min(constant.value), p.high.max(constant.value));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_no_change_is_the_nominal_model_and_a_change_moves_one_constant() {
        let constants = constants(&Vehicle::default());
        assert!(constants.len() > 30, "{}", constants.len());
        let same = values(&constants, &vec![0.0; constants.len()]);
        let flat = |v: &Values| v.iter().flat_map(|(_, theta)| theta.clone()).collect::<Vec<_>>();
        assert_eq!(flat(&same), constants.iter().map(|c| c.value).collect::<Vec<_>>());
        let mut change = vec![0.0; constants.len()];
        change[2] = 0.05;
        let moved = flat(&values(&constants, &change));
        let differ = flat(&same).iter().zip(&moved).filter(|(a, b)| a != b).count();
        assert_eq!(differ, 1);
    }
}
