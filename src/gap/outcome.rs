//! What a diagnosis may end with: the outcomes, their words for people, names and exit codes for
//! scripts (INTERFACES.md: `gap diagnose`).

use std::fmt::Write;

use serde::{Deserialize, Serialize};

/// One effect with what is known of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// Id of docs/EFFECTS.md.
    pub id: String,
    /// Calibrated probability.
    pub probability: f64,
    /// Best parameters, in the order of the effect's specification.
    pub theta: Vec<f64>,
    /// Central 90 % per parameter.
    pub theta_90: Vec<[f64; 2]>,
}

/// A part of the gap that no effect of the library accounts for.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Remainder {
    /// Share of the gap (excess of the squared whitened distance) that is left.
    pub share: f64,
    /// Block that holds most of it.
    pub block: String,
    /// Statistics that stick out, with their distance in sigma after the explanation.
    pub statistics: Vec<(String, f64)>,
}

/// How a diagnosis ends. Exactly one of these, never a bare ranking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "outcome", rename_all = "snake_case")]
pub enum Outcome {
    /// Nothing that simulation against simulation would not show, or nothing that matters.
    #[serde(rename = "no_gap")]
    NoMaterialGap,
    /// One effect.
    Named {
        /// It.
        effect: Named,
    },
    /// One of some that this flight cannot tell apart.
    #[serde(rename = "ambiguous")]
    OneOf {
        /// Most probable first.
        effects: Vec<Named>,
    },
    /// Several at once.
    Several {
        /// All of them.
        effects: Vec<Named>,
    },
    /// One effect and something else.
    NamedWithRemainder {
        /// The effect.
        effect: Named,
        /// The rest.
        remainder: Remainder,
    },
    /// A gap that no effect of the library makes.
    NotInLibrary {
        /// What is known of it.
        remainder: Remainder,
    },
    /// Constants of the vehicle file that differ.
    Budget {
        /// What they close.
        why: String,
    },
    /// The flight did not visit what would be needed.
    NotTestable {
        /// Why.
        why: String,
    },
    /// The log is damaged, or replay does not reproduce the flown outputs.
    #[serde(rename = "log_fault")]
    Fault {
        /// What was found.
        why: String,
    },
}

/// Which outcome it is, without what was found: the key in JSON.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// No material gap.
    #[default]
    NoGap,
    /// One effect.
    Named,
    /// One of some.
    #[serde(rename = "ambiguous")]
    OneOf,
    /// Several at once.
    Several,
    /// One effect and something else.
    NamedWithRemainder,
    /// No effect of the library.
    NotInLibrary,
    /// Constants of the vehicle file.
    Budget,
    /// The flight does not say.
    NotTestable,
    /// The log cannot be judged.
    #[serde(rename = "log_fault")]
    Fault,
}

impl Ending {
    /// Name for scripts, exit code of `haltere gap diagnose`, first words of the verdict.
    fn row(self) -> (&'static str, u8, &'static str) {
        match self {
            Ending::NoGap => ("no_gap", 0, "no material gap"),
            Ending::Named => ("named", 10, "named"),
            Ending::OneOf => ("ambiguous", 11, "one of"),
            Ending::Several => ("several", 12, "several"),
            Ending::NamedWithRemainder => ("named_with_remainder", 14, "named + remainder"),
            Ending::NotInLibrary => ("not_in_library", 13, "not in the library"),
            Ending::Budget => ("budget", 15, "budget"),
            Ending::NotTestable => ("not_testable", 20, "not testable"),
            Ending::Fault => ("log_fault", 30, "log or replay fault"),
        }
    }

    /// Name for scripts.
    pub fn key(self) -> &'static str {
        self.row().0
    }

    /// Exit code of `haltere gap diagnose`.
    pub fn exit_code(self) -> u8 {
        self.row().1
    }

    /// First words of the verdict.
    pub fn words(self) -> &'static str {
        self.row().2
    }

    /// Whether there is a gap to talk about.
    pub fn is_gap(self) -> bool {
        !matches!(self, Ending::NoGap | Ending::NotTestable | Ending::Fault)
    }

    /// Whether effects act, all that are named.
    pub fn acts(self) -> bool {
        matches!(self, Ending::Named | Ending::NamedWithRemainder | Ending::Several)
    }

    /// Whether effects of the library explain the gap, be it one of some.
    pub fn is_explained(self) -> bool {
        self.acts() || self == Ending::OneOf
    }
}

impl Outcome {
    /// Which of them.
    pub fn kind(&self) -> Ending {
        match self {
            Outcome::NoMaterialGap => Ending::NoGap,
            Outcome::Named { .. } => Ending::Named,
            Outcome::OneOf { .. } => Ending::OneOf,
            Outcome::Several { .. } => Ending::Several,
            Outcome::NamedWithRemainder { .. } => Ending::NamedWithRemainder,
            Outcome::NotInLibrary { .. } => Ending::NotInLibrary,
            Outcome::Budget { .. } => Ending::Budget,
            Outcome::NotTestable { .. } => Ending::NotTestable,
            Outcome::Fault { .. } => Ending::Fault,
        }
    }

    /// Name for scripts.
    pub fn key(&self) -> &'static str {
        self.kind().key()
    }

    /// Exit code of `haltere gap diagnose`.
    pub fn exit_code(&self) -> u8 {
        self.kind().exit_code()
    }

    /// First words of the verdict.
    pub fn words(&self) -> &'static str {
        self.kind().words()
    }

    /// Effects that the outcome names.
    pub fn effects(&self) -> &[Named] {
        match self {
            Outcome::Named { effect } | Outcome::NamedWithRemainder { effect, .. } => {
                std::slice::from_ref(effect)
            }
            Outcome::OneOf { effects } | Outcome::Several { effects } => effects,
            _ => &[],
        }
    }

    /// The same, to be told better.
    pub(crate) fn effects_mut(&mut self) -> &mut [Named] {
        match self {
            Outcome::Named { effect } | Outcome::NamedWithRemainder { effect, .. } => {
                std::slice::from_mut(effect)
            }
            Outcome::OneOf { effects } | Outcome::Several { effects } => effects,
            _ => &mut [],
        }
    }

    /// Why nothing is named; empty where that needs no reason.
    pub fn why(&self) -> &str {
        match self {
            Outcome::Budget { why } | Outcome::NotTestable { why } | Outcome::Fault { why } => why,
            _ => "",
        }
    }

    /// One line of terms. `name`: words for an effect's id.
    pub fn sentence(&self, name: impl Fn(&str) -> String) -> String {
        let mut line = self.words().to_string();
        match self {
            Outcome::NoMaterialGap => {}
            Outcome::Named { effect } => {
                let _ =
                    write!(line, ", confidence {:.2}: {}", effect.probability, name(&effect.id));
            }
            Outcome::OneOf { effects } => {
                let all: Vec<String> = effects
                    .iter()
                    .map(|e| format!("{} ({:.2})", name(&e.id), e.probability))
                    .collect();
                let _ = write!(line, ": {}", all.join(", "));
            }
            Outcome::Several { effects } => {
                let all: Vec<String> = effects.iter().map(|e| name(&e.id)).collect();
                let _ = write!(line, ": {}", all.join(" and "));
            }
            Outcome::NamedWithRemainder { effect, remainder } => {
                let _ = write!(
                    line,
                    ", confidence {:.2}: {}; left unexplained {}",
                    effect.probability,
                    name(&effect.id),
                    remainder.sentence()
                );
            }
            Outcome::NotInLibrary { remainder } => {
                let _ = write!(line, ": the best explanation leaves {}", remainder.sentence());
            }
            Outcome::Budget { .. } | Outcome::NotTestable { .. } | Outcome::Fault { .. } => {
                let _ = write!(line, ": {}", self.why());
            }
        }
        line
    }
}

impl Remainder {
    /// In words.
    pub fn sentence(&self) -> String {
        // Less than is printed is nothing, wherever it lies.
        if self.share < 0.005 {
            return "nothing that stands out from noise".to_owned();
        }
        let mut line = format!("{:.0} % of the gap", 100.0 * self.share);
        if !self.block.is_empty() {
            let _ = write!(line, ", mostly {}", self.block);
        }
        if !self.statistics.is_empty() {
            let all: Vec<String> =
                self.statistics.iter().map(|(n, z)| format!("{n} {z:+.1} sigma")).collect();
            let _ = write!(line, " ({})", all.join(", "));
        }
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_nothing_left_is_said_in_words() {
        let left = |share| Remainder { share, block: "actuators".into(), statistics: Vec::new() };
        assert_eq!(left(0.001).sentence(), "nothing that stands out from noise");
        assert_eq!(left(0.24).sentence(), "24 % of the gap, mostly actuators");
    }

    #[test]
    fn prop_names_codes_and_json_agree() {
        let e = || Named {
            id: "U2".into(),
            probability: 0.94,
            theta: vec![0.21, 5.0],
            theta_90: vec![[0.17, 0.25], [5.0, 5.0]],
        };
        let r = || Remainder {
            share: 0.4,
            block: "uwb".into(),
            statistics: vec![("uwb_nis".into(), 7.0)],
        };
        let why = || "never above 1.9 m".to_string();
        let all = [
            (Outcome::NoMaterialGap, 0),
            (Outcome::Named { effect: e() }, 10),
            (Outcome::OneOf { effects: vec![e(), e()] }, 11),
            (Outcome::Several { effects: vec![e(), e()] }, 12),
            (Outcome::NotInLibrary { remainder: r() }, 13),
            (Outcome::NamedWithRemainder { effect: e(), remainder: r() }, 14),
            (Outcome::Budget { why: why() }, 15),
            (Outcome::NotTestable { why: why() }, 20),
            (Outcome::Fault { why: why() }, 30),
        ];
        for (outcome, code) in all {
            assert_eq!(outcome.exit_code(), code);
            let json = serde_json::to_value(&outcome).unwrap();
            assert_eq!(json["outcome"], outcome.key(), "{json}");
            assert_eq!(serde_json::to_value(outcome.kind()).unwrap(), json["outcome"]);
            assert_eq!(
                serde_json::from_value::<Ending>(json["outcome"].clone()).unwrap(),
                outcome.kind()
            );
            assert_eq!(serde_json::from_value::<Outcome>(json).unwrap(), outcome);
            let line = outcome.sentence(|id| format!("anchor bias {id}"));
            assert!(line.starts_with(outcome.words()), "{line}");
        }
    }
}
