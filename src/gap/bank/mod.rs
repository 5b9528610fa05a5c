//! The bank of one mission: what statistics look like without a gap, and under every effect of
//! the library. Plain data; [`crate::bank::bank_file`] keeps it on disk.

pub mod archive;
pub mod axis;
pub mod bank_file;
pub mod fly;
pub mod jitter;
pub mod kept_file;
pub mod library;
pub mod make_bank;
pub mod missions;
pub(crate) mod not_flown;
pub mod one_flight;
pub mod parts;
pub mod workshop;

use serde::{Deserialize, Serialize};

use crate::bank::axis::Axis;

/// One simulated flight under an effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Draw {
    /// Values of the parameters, in the order of the effect's specification.
    pub theta: Vec<f64>,
    /// Seed of the flight.
    pub seed: u64,
    /// Place in [`Bank::jitter`] of its twin: the same vehicle, noise and start, without the effect. What the two
    /// differ by is the effect's alone.
    pub twin: usize,
    /// Statistics; NaN where the flight could not say.
    pub statistics: Vec<f64>,
}

/// Flights under one effect, parameters drawn from their prior.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectDraws {
    /// Id of docs/EFFECTS.md.
    pub id: String,
    /// What its parameters range over, in the order of the effect's specification.
    pub axes: Vec<Axis>,
    /// The flights.
    pub draws: Vec<Draw>,
}

/// All flights that a diagnosis compares with.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Bank {
    /// Names of the statistics.
    pub names: Vec<String>,
    /// Nominal simulator, one row of statistics per seed.
    pub seeds: Vec<Vec<f64>>,
    /// Benign changes of nominal constants, one row per flight.
    pub jitter: Vec<Vec<f64>>,
    /// Flights per effect.
    pub effects: Vec<EffectDraws>,
}

/// What makes a bank useless.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BankError {
    /// A row with another number of statistics than there are names.
    #[error("{place}: {found} statistics, the bank names {expected}")]
    RowLength {
        /// Which row.
        place: String,
        /// Numbers in it.
        found: usize,
        /// Names in the bank.
        expected: usize,
    },
    /// A parameter vector that differs in length within its effect or is not finite.
    #[error("effect {id}: draw {draw}: parameters {found:?}, expected {expected} finite numbers")]
    Theta {
        /// Effect.
        id: String,
        /// Place of the draw.
        draw: usize,
        /// What is there.
        found: Vec<f64>,
        /// Parameters of the effect.
        expected: usize,
    },
    /// An axis that is no range.
    #[error("effect {id}: parameter {parameter} ranges over {axis:?}")]
    Axis {
        /// Effect.
        id: String,
        /// Place of the parameter.
        parameter: usize,
        /// What it ranges over.
        axis: Axis,
    },
    /// An axis that does not hold its draws.
    #[error("effect {id}: parameter {parameter} ranges over {axis:?}, a draw has {value}")]
    Range {
        /// Effect.
        id: String,
        /// Place of the parameter.
        parameter: usize,
        /// What it ranges over.
        axis: Axis,
        /// Value of a draw.
        value: f64,
    },
    /// A twin that the bank does not hold.
    #[error("effect {id}: draw {draw}: twin {twin}, the bank holds {nulls} flights with jitter")]
    Twin {
        /// Effect.
        id: String,
        /// Place of the draw.
        draw: usize,
        /// Place of the twin.
        twin: usize,
        /// Flights with jitter.
        nulls: usize,
    },
    /// Too little to estimate anything from.
    #[error("{what}: {found}, at least {least} needed")]
    TooFew {
        /// Of what.
        what: String,
        /// How many there are.
        found: usize,
        /// How many are needed.
        least: usize,
    },
    /// The same effect twice.
    #[error("effect {id} is in the bank twice")]
    Twice {
        /// Effect.
        id: String,
    },
    /// No statistic that is known in most null flights and varies at all.
    #[error("none of {names} statistics is usable: unknown in most null flights, or constant")]
    NothingUsable {
        /// Statistics in the bank.
        names: usize,
    },
}

/// Fewest flights with jitter: below this not even the scale of a statistic is known to 20 %.
pub const LEAST_NULLS: usize = 12;
/// Fewest draws of an effect: three folds of two.
pub const LEAST_DRAWS: usize = 6;

impl Bank {
    /// Checks shape and numbers. Statistics may be NaN, parameters may not.
    pub fn check(&self) -> Result<(), BankError> {
        let expected = self.names.len();
        let row = |place: String, row: &[f64]| {
            let found = row.len();
            if found == expected {
                Ok(())
            } else {
                Err(BankError::RowLength { place, found, expected })
            }
        };
        for (i, s) in self.seeds.iter().enumerate() {
            row(format!("seed flight {i}"), s)?;
        }
        for (i, s) in self.jitter.iter().enumerate() {
            row(format!("jitter flight {i}"), s)?;
        }
        let found = self.jitter.len();
        if found < LEAST_NULLS {
            let what = "flights with jitter".to_string();
            return Err(BankError::TooFew { what, found, least: LEAST_NULLS });
        }
        for (place, effect) in self.effects.iter().enumerate() {
            let id = &effect.id;
            if self.effects[..place].iter().any(|e| e.id == *id) {
                return Err(BankError::Twice { id: id.clone() });
            }
            let found = effect.draws.len();
            if found < LEAST_DRAWS {
                let what = format!("draws of effect {id}");
                return Err(BankError::TooFew { what, found, least: LEAST_DRAWS });
            }
            if let Some(parameter) = effect.axes.iter().position(|axis| !axis.is_sound()) {
                let (id, axis) = (id.clone(), effect.axes[parameter]);
                return Err(BankError::Axis { id, parameter, axis });
            }
            let expected = effect.axes.len();
            for (draw, d) in effect.draws.iter().enumerate() {
                row(format!("effect {id}, draw {draw}"), &d.statistics)?;
                if d.theta.len() != expected || d.theta.iter().any(|v| !v.is_finite()) {
                    let (id, found) = (id.clone(), d.theta.clone());
                    return Err(BankError::Theta { id, draw, found, expected });
                }
                for (parameter, (axis, value)) in effect.axes.iter().zip(&d.theta).enumerate() {
                    if !(axis.low..=axis.high).contains(value) {
                        let (id, axis, value) = (id.clone(), *axis, *value);
                        return Err(BankError::Range { id, parameter, axis, value });
                    }
                }
                if d.twin >= self.jitter.len() {
                    let (id, twin, nulls) = (id.clone(), d.twin, self.jitter.len());
                    return Err(BankError::Twin { id, draw, twin, nulls });
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_bank_says_what_is_wrong_with_it() {
        let draw =
            |v: f64| Draw { theta: vec![v], seed: 1, twin: 0, statistics: vec![0.0, f64::NAN] };
        let good = Bank {
            names: vec!["a".into(), "b".into()],
            seeds: vec![vec![0.0; 2]; 8],
            jitter: vec![vec![0.0; 2]; 12],
            effects: vec![EffectDraws {
                id: "A1".into(),
                axes: vec![Axis::over([0.0, 1.5].into_iter())],
                draws: vec![draw(1.0); 6],
            }],
        };
        assert_eq!(good.check(), Ok(()));
        let mut bad = good.clone();
        bad.jitter[3].push(0.0);
        assert!(matches!(bad.check(), Err(BankError::RowLength { found: 3, .. })));
        let mut bad = good.clone();
        bad.effects[0].draws[5].theta[0] = f64::INFINITY;
        assert!(matches!(bad.check(), Err(BankError::Theta { draw: 5, .. })));
        let mut bad = good.clone();
        bad.effects.push(bad.effects[0].clone());
        assert!(matches!(bad.check(), Err(BankError::Twice { .. })));
        let mut bad = good.clone();
        bad.effects[0].axes[0].high = f64::NAN;
        assert!(matches!(bad.check(), Err(BankError::Axis { parameter: 0, .. })));
        let mut bad = good.clone();
        bad.effects[0].draws[3].theta[0] = 2.0;
        assert!(matches!(bad.check(), Err(BankError::Range { value: 2.0, .. })));
        let mut bad = good.clone();
        bad.effects[0].draws[2].twin = 12;
        assert!(matches!(bad.check(), Err(BankError::Twin { draw: 2, twin: 12, nulls: 12, .. })));
        let mut bad = good;
        bad.jitter.truncate(11);
        assert!(matches!(bad.check(), Err(BankError::TooFew { found: 11, .. })));
    }
}
