//! The balance of a vehicle that has a bank, beside it: what forces, actuators and battery show against accepted flights alone.
//!
//! Its numbers are the coefficients of a regression on what the board was told and what was measured, so that nothing simulated goes into
//! them but the file's constants, which are the same on both sides. What the two verdicts say of one flight is compared in words.

use haltere_model::effects::Block;
use serde::Serialize;

use crate::attribute::{Settings, between_hours, of_one_hour};
use crate::bank::library;
use crate::flight::residuals::StatSpec;
use crate::flight::statistics::specs;
use crate::normal::prediction_factor;

/// Blocks that a balance is of.
const BALANCED: [Block; 4] = [Block::Actuators, Block::Thrust, Block::Aerodynamics, Block::Battery];
/// Fewest accepted flights in which a number is known.
const LEAST_KNOWN: usize = 8;
/// Numbers that are listed.
const LISTED: usize = 4;

/// A number that accepted flights do not have.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Apart {
    /// Its name, as `haltere gap observe` has it.
    pub name: String,
    /// What it is.
    pub meaning: &'static str,
    /// Its block.
    pub block: &'static str,
    /// Difference from the mean of accepted flights, in its unit.
    pub by: f64,
    /// The unit.
    pub unit: &'static str,
    /// The same over the limit.
    pub over_limit: f64,
}

/// Both verdicts.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Beside {
    /// Numbers that were looked at.
    pub looked_at: usize,
    /// Those beyond their limits, the farthest first.
    pub apart: Vec<Apart>,
    /// Whether the balance says what the bank says; `None`: of what the bank names it shows nothing.
    pub agree: Option<bool>,
    /// In a sentence.
    pub words: String,
}

/// The balance beside what the bank says: whether there is a gap, and the effects that it names. `None` where too few accepted flights are
/// known.
pub fn beside<'a>(
    flight: &[f64],
    references: &[Vec<f64>],
    is_gap: bool,
    named: impl Iterator<Item = &'a str>,
) -> Option<Beside> {
    let rows = specs().iter().enumerate().filter(|(_, spec)| BALANCED.contains(&spec.block));
    let known: Vec<(&StatSpec, f64, Vec<f64>)> = rows
        .filter_map(|(place, spec)| {
            let of = references.iter().filter_map(|row| row.get(place).copied());
            let of: Vec<f64> = of.filter(|value| value.is_finite()).collect();
            let value = flight.get(place).copied().filter(|value| value.is_finite())?;
            (of.len() >= LEAST_KNOWN).then_some((spec, value, of))
        })
        .collect();
    if known.is_empty() {
        return None;
    }
    // Of so many healthy flights any number sticks out, up or down, as many as the gate lets through.
    let share = 1.0 - 0.5 * Settings::default().false_alarm / known.len() as f64;
    let mut apart: Vec<Apart> = known
        .iter()
        .filter_map(|(spec, value, of)| {
            let n = of.len() as f64;
            let mean = of.iter().sum::<f64>() / n;
            let variance = of.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let more = 1.0 + of_one_hour(of.len()) * between_hours(spec);
            let limit = prediction_factor(share, of.len()) * (more * variance).sqrt();
            let (by, over_limit) =
                (value - mean, (value - mean).abs() / limit.max(spec.resolution));
            (over_limit > 1.0).then(|| Apart {
                name: spec.name.clone(),
                meaning: spec.meaning,
                block: spec.block.name(),
                by,
                unit: spec.unit,
                over_limit,
            })
        })
        .collect();
    apart.sort_by(|a, b| b.over_limit.total_cmp(&a.over_limit));
    let named: Vec<Block> = named.filter_map(|id| Some(library::find(id)?.block)).collect();
    let (agree, comparison) = compared(&apart, &named, is_gap);
    let told = apart.iter().take(LISTED).map(|apart| {
        let by = match apart.unit {
            "ln" => format!("{:+.0} %", 100.0 * apart.by.exp_m1()),
            "1" => format!("{:+.3}", apart.by),
            unit => format!("{:+.3} {unit}", apart.by),
        };
        format!("{} {by} ({})", apart.meaning, apart.name)
    });
    let told: Vec<String> = told.collect();
    let found = match told.is_empty() {
        true => "nothing is beyond the scatter of the accepted flights".to_owned(),
        false => format!("beyond the scatter of the accepted flights: {}", told.join(", ")),
    };
    let words = format!(
        "Forces, actuators and battery by measurement alone, nothing simulated: {found}. {comparison}"
    );
    Some(Beside { looked_at: known.len(), apart, agree, words })
}

/// Whether both say the same, and in words.
fn compared(apart: &[Apart], named: &[Block], is_gap: bool) -> (Option<bool>, String) {
    let blocks = |of: &[&str]| {
        let named = Block::CHAIN.iter().map(|block| block.name()).filter(|name| of.contains(name));
        named.collect::<Vec<_>>().join(", ")
    };
    let by_bank: Vec<&str> = named.iter().map(|block| block.name()).collect();
    let by_balance: Vec<&str> = apart.iter().map(|apart| apart.block).collect();
    let is_force =
        |block: &&str| [Block::Thrust, Block::Aerodynamics].iter().any(|of| of.name() == *block);
    match (is_gap, apart.is_empty()) {
        (false, true) => (Some(true), "The bank and it agree: no gap.".into()),
        (false, false) => {
            (Some(false), format!("They differ in {}: the bank finds no gap.", blocks(&by_balance)))
        }
        (true, true) if !named.iter().any(|block| BALANCED.contains(block)) => (
            None,
            "They do not contradict one another: what the bank finds is no part of a balance."
                .into(),
        ),
        (true, true) => (
            Some(false),
            format!("They differ in {}, where the bank finds a gap.", blocks(&by_bank)),
        ),
        (true, false) if by_bank.is_empty() => (
            Some(true),
            format!(
                "They agree that there is a gap, which the bank does not name; it shows in {}.",
                blocks(&by_balance)
            ),
        ),
        // A balance of forces has the accelerometer on its other side.
        (true, false) if named.contains(&Block::Imu) && by_balance.iter().any(is_force) => {
            (Some(true), "They agree: what an accelerometer reads wrongly shows as a force.".into())
        }
        (true, false) => match by_bank.iter().find(|block| by_balance.contains(block)) {
            Some(block) => (Some(true), format!("The bank and it agree in {block}.")),
            None => (
                Some(false),
                format!(
                    "They differ: the bank names {}, it shows {}.",
                    blocks(&by_bank),
                    blocks(&by_balance)
                ),
            ),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten accepted flights that scatter by 0.1 in every number, and one that has this much more of one.
    fn said(more: f64, is_gap: bool, ids: &[&str]) -> Beside {
        let place = specs().iter().position(|spec| spec.name == "force.z.const").unwrap();
        let row = |k: usize| vec![if k.is_multiple_of(2) { 0.1 } else { -0.1 }; specs().len()];
        let references: Vec<Vec<f64>> = (0..10).map(row).collect();
        let mut flight = vec![0.0; specs().len()];
        flight[place] = more;
        beside(&flight, &references, is_gap, ids.iter().copied()).unwrap()
    }

    #[test]
    fn prop_the_balance_and_the_bank_are_compared_in_words() {
        let agree = said(0.0, false, &[]);
        assert_eq!((agree.agree, agree.apart.len()), (Some(true), 0));
        assert!(agree.words.ends_with("agree: no gap."), "{}", agree.words);
        // P1 is a loss of thrust, U2 an offset of an anchor.
        let thrust = said(-9.0, true, &["P1"]);
        assert_eq!((thrust.agree, &thrust.apart[0].name[..]), (Some(true), "force.z.const"));
        assert!(
            thrust.words.contains("-9.000 m/s² (force.z.const)")
                && thrust.words.contains("agree in thrust")
        );
        assert_eq!(said(0.0, true, &["U2"]).agree, None);
        assert_eq!(said(0.0, true, &["P1"]).agree, Some(false));
        let differ = said(-9.0, false, &[]);
        assert!(differ.words.contains("They differ in thrust"), "{}", differ.words);
        assert_eq!(said(-9.0, true, &[]).agree, Some(true));
        assert!(said(-9.0, true, &["U2"]).words.contains("bank names uwb"));
        // M6 shifts the accelerometer, which is held against the forces.
        assert_eq!(said(-9.0, true, &["M6"]).agree, Some(true));
    }

    #[test]
    fn prop_without_accepted_flights_there_is_no_balance() {
        assert_eq!(beside(&vec![0.0; specs().len()], &[], false, std::iter::empty()), None);
    }
}
