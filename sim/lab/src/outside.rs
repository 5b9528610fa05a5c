//! Answers of another method to a sealed suite, so that peers are scored by the same scorer.
//!
//! One JSON object a line:
//!
//! ```text
//! {"id": "case-001", "outcome": "named", "effects": ["A1"],
//!  "ranked": [["A1", 0.8], ["A2", 0.1]], "adequacy": 0.3, "anchors": {"bias": 6}}
//! ```
//!
//! `outcome` is one of the words of [`Outcome::key`]; `effects` what is named, `ranked` every effect
//! with its probability, best first; `adequacy` grows with how badly the best explanation fits, and
//! only its order counts. All but `id` and `outcome` may be left out.

use std::collections::BTreeMap;

use serde::Deserialize;

use haltere_gap::attribute::{Adequacy, Attribution, Candidate, Gate};
use haltere_gap::outcome::{Named, Outcome, Remainder};

/// One line.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Outside {
    /// Id of the case.
    pub id: String,
    outcome: String,
    #[serde(default)]
    effects: Vec<String>,
    #[serde(default)]
    ranked: Vec<(String, f64)>,
    #[serde(default)]
    adequacy: f64,
    /// Anchors by kind of error.
    #[serde(default)]
    pub anchors: BTreeMap<String, u8>,
}

/// Reads all lines.
pub fn read(text: &str) -> Result<Vec<Outside>, String> {
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    lines
        .map(|(k, line)| {
            let one: Outside =
                serde_json::from_str(line).map_err(|e| format!("line {}: {e}", k + 1))?;
            one.verdict().map_err(|e| format!("line {}: {e}", k + 1))?;
            Ok(one)
        })
        .collect()
}

impl Outside {
    fn verdict(&self) -> Result<Outcome, String> {
        let effects: Vec<Named> = self
            .effects
            .iter()
            .map(|id| Named {
                id: id.clone(),
                probability: self.ranked.iter().find(|r| r.0 == *id).map_or(0.0, |r| r.1),
                theta: Vec::new(),
                theta_90: Vec::new(),
            })
            .collect();
        let remainder = Remainder::default();
        let one = || match &effects[..] {
            [one] => Ok(one.clone()),
            _ => Err(format!("{}: {} effects, this outcome has one", self.outcome, effects.len())),
        };
        Ok(match self.outcome.as_str() {
            "no_gap" => Outcome::NoMaterialGap,
            "named" => Outcome::Named { effect: one()? },
            "ambiguous" => Outcome::OneOf { effects },
            "several" => Outcome::Several { effects },
            "named_with_remainder" => Outcome::NamedWithRemainder { effect: one()?, remainder },
            "not_in_library" => Outcome::NotInLibrary { remainder },
            "not_testable" => Outcome::NotTestable { why: "said so".into() },
            other => return Err(format!("outcome {other:?} is none of an outcome's words")),
        })
    }

    /// As the scorer takes it.
    pub fn attribution(&self) -> Result<Attribution, String> {
        let candidates = self
            .ranked
            .iter()
            .map(|(id, posterior)| Candidate {
                id: id.clone(),
                posterior: *posterior,
                log_evidence: f64::NAN,
                theta: Vec::new(),
                theta_90: Vec::new(),
                explained: 0.0,
                residual_score: f64::NAN,
            })
            .collect();
        Ok(Attribution {
            outcome: self.verdict()?,
            candidates,
            pairs: Vec::new(),
            pair_limit: f64::NAN,
            blocks: Vec::new(),
            gate: Gate::default(),
            adequacy: Adequacy { score: self.adequacy, ..Adequacy::default() },
            remainder: Remainder::default(),
            used: 0,
            unknown: Vec::new(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_lines_become_verdicts_and_bad_ones_say_where() {
        let good = "{\"id\":\"a\",\"outcome\":\"named\",\"effects\":[\"A1\"],\"ranked\":[[\"A1\",0.7]]}\n\n\
                    {\"id\":\"b\",\"outcome\":\"no_gap\"}\n";
        let lines = read(good).unwrap();
        let first = lines[0].attribution().unwrap();
        assert_eq!(first.outcome.effects()[0].probability, 0.7);
        assert_eq!(lines[1].attribution().unwrap().outcome, Outcome::NoMaterialGap);
        for bad in [
            "{\"id\":\"a\",\"outcome\":\"named\"}",
            "{\"id\":\"a\",\"outcome\":\"sure\"}",
            "{\"id\":\"a\"}",
            "nonsense",
        ] {
            let error = read(&format!("\n{bad}")).unwrap_err();
            assert!(error.starts_with("line 2:"), "{error}");
        }
    }
}
