//! A fault with a name, as a campaign brings it into a flight: who has a list of them flies each in every part of one.

use anyhow::{Context, Result};
use serde::Deserialize;

use crate::simulated::faults::{FaultAt, Part};

/// First line of what is broken from the floor on.
pub const FROM_FLOOR: &str = "floor = true";

/// Whether anything on board could save the flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reaction {
    /// This; a crash is a failure of ours.
    Exists(&'static str),
    /// Nothing, and why; a crash is listed.
    None(&'static str),
}

/// One fault.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Name in tables and files.
    pub name: String,
    /// Group in tables.
    pub group: &'static str,
    /// The `[[fault]]` tables, or the `[told]`.
    pub text: String,
    /// What can be done about it.
    pub reaction: Reaction,
}

/// An entry as a scenario holds it.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Parts {
    /// What breaks, without time.
    pub fault: Vec<FaultAt>,
    /// What is told wrongly, from the start.
    pub told: Option<toml::Table>,
    /// It is broken before anybody arms, and the vehicle takes off in each of the ways (`takeoff.rs`).
    pub floor: bool,
}

impl Entry {
    /// As a scenario holds them.
    pub fn parts(&self) -> Result<Parts> {
        toml::from_str(&self.text).with_context(|| format!("catalogue: {}", self.name))
    }

    /// Whether it is there before the flight begins, so that it has no part of the flight.
    pub fn is_from_start(&self) -> bool {
        self.text.contains("[told]") || self.is_from_floor()
    }

    /// Whether something is broken before anybody arms.
    pub fn is_from_floor(&self) -> bool {
        self.text.starts_with(FROM_FLOOR)
    }

    /// How long the companion stands still by it, s.
    pub fn stands_still_s(&self) -> Option<f64> {
        let faults = self.parts().ok()?.fault;
        faults.iter().find(|fault| fault.part == Part::Pause)?.length_s
    }

    /// Whether `word` names it or its group: small letters and digits count, `_` or anything else between them.
    pub fn is_named(&self, word: &str) -> bool {
        let word = plain(word);
        !word.is_empty() && (plain(&self.name).contains(&word) || plain(self.group) == word)
    }
}

/// Letters and digits with one `_` between the words.
fn plain(text: &str) -> String {
    let lower = text.to_lowercase();
    let words: Vec<&str> =
        lower.split(|c: char| !c.is_alphanumeric()).filter(|w| !w.is_empty()).collect();
    words.join("_")
}
