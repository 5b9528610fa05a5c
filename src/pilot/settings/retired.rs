//! Keys that the configuration had once: what became of each, as one table.
//!
//! A key that leaves the program gets a row here in the same commit, and the row stays: logs and files of
//! users live longer than builds. A log is read in silence, whatever it holds of them, since it tells what was
//! flown. In what a user wrote, a key that is called otherwise now gives its value to its heir and that is
//! told; one that has no effect any more is told if it was not at its last default, and refused if it belongs
//! to a section of [`GUARDED`]: nobody may believe in a limit that is none.

use std::borrow::Cow;
use std::ops::Range;

use serde::Deserialize as _;
use toml::de::{DeTable, DeValue, ValueDeserializer};
use toml::{Spanned, Value};

/// A key that is no more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Retired {
    /// With its sections.
    pub key: &'static str,
    /// What became of it.
    pub fate: Fate,
}

/// What became of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It has no effect any more.
    Gone {
        /// Its last default, as in a file; empty: it was absent.
        default: &'static str,
        /// What serves its purpose now, for people: a key, or what the program does instead. Never empty
        /// in a section of [`GUARDED`].
        heir: &'static str,
    },
    /// It is called so now; value, unit and meaning are the same.
    MovedTo(&'static str),
}

/// Every key that has left, oldest first.
pub const RETIRED: &[Retired] = &[
    Retired {
        key: "estimator.acc_over_beats",
        fate: Fate::Gone { default: "false", heir: "estimator.acc_average_s" },
    },
    Retired {
        key: "estimator.uwb_arrival_frac",
        fate: Fate::Gone { default: "0.0", heir: "estimator.uwb_correlation_s" },
    },
    Retired {
        key: "diagnosis.after_programs",
        fate: Fate::Gone { default: "false", heir: "haltere gap diagnose" },
    },
    Retired {
        key: "diagnosis.size",
        fate: Fate::Gone { default: "\"full\"", heir: "haltere gap diagnose" },
    },
    Retired {
        key: "diagnosis.banks",
        fate: Fate::Gone { default: "\"\"", heir: "haltere gap diagnose" },
    },
    Retired {
        key: "diagnosis.references",
        fate: Fate::Gone { default: "\"\"", heir: "haltere gap diagnose" },
    },
    Retired {
        key: "diagnosis.vehicle",
        fate: Fate::Gone { default: "\"\"", heir: "haltere gap diagnose" },
    },
];

/// Sections that keep a flight safe: what is set in them is never ignored.
const GUARDED: [&str; 4] = ["limits", "supervisor", "flight", "board"];

/// Who wrote a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Author {
    /// A user: file, environment or command line.
    User,
    /// The recorder, in the head of a log.
    Recorder,
}

/// Something to tell, or to refuse, with its place in the text.
pub(super) type Remark = (Range<usize>, String);

/// What was found in a text of a user.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// For people to know.
    pub told: Vec<Remark>,
    /// Reasons to refuse the text.
    pub refused: Vec<Remark>,
}

/// The key whose type a value is read as: that of the heir, where there is one.
pub fn present_name<'k>(retired: &[Retired], key: &'k str) -> &'k str {
    let moved = retired.iter().find(|row| row.key == key).map(|row| row.fate);
    if let Some(Fate::MovedTo(heir)) = moved { heir } else { key }
}

/// Takes every retired key out of `root`, and gives values to their heirs.
pub(super) fn apply(root: &mut DeTable<'_>, retired: &[Retired], author: Author) -> Found {
    let mut found = Found::default();
    for row in retired {
        let Some((at, value)) = take(root, row.key) else { continue };
        match row.fate {
            Fate::MovedTo(heir) => moved(root, row.key, heir, (at, value), &mut found),
            Fate::Gone { default, heir } => gone(row.key, default, heir, (at, &value), &mut found),
        }
    }
    if author == Author::Recorder { Found::default() } else { found }
}

/// A value, and where its key stands.
type Placed<V> = (Range<usize>, V);

fn moved<'i>(
    root: &mut DeTable<'i>,
    key: &str,
    heir: &'static str,
    (at, value): Placed<Spanned<DeValue<'i>>>,
    found: &mut Found,
) {
    let text = format!("{key}{}: the key is called {heir} now", shown(&value));
    if put(root, heir, at.clone(), value) {
        found.told.push((at, format!("{text} and was read as such")));
    } else {
        found.refused.push((at, format!("{text}, which is set too; take {key} out")));
    }
}

fn gone(
    key: &str,
    default: &str,
    heir: &str,
    (at, value): Placed<&Spanned<DeValue<'_>>>,
    found: &mut Found,
) {
    let mut text = format!("{key}{}: the key has no effect any more", shown(value));
    if !heir.is_empty() {
        text += &format!("; {heir} serves its purpose now");
    }
    let changed = plain(value).is_none_or(|value| !is_same(&value, default));
    let guarded = key.split('.').next().is_some_and(|section| GUARDED.contains(&section));
    if changed && guarded {
        found.refused.push((at, text + "; take it out once that is set as you need it"));
    } else if changed || guarded {
        found.told.push((at, text));
    }
}

fn shown(value: &Spanned<DeValue<'_>>) -> String {
    plain(value).map_or_else(String::new, |value| format!(" = {value}"))
}

/// Removes a key, and sections that hold nothing without it.
fn take<'i>(table: &mut DeTable<'i>, key: &str) -> Option<(Range<usize>, Spanned<DeValue<'i>>)> {
    let Some((section, rest)) = key.split_once('.') else {
        return table.remove_entry(key).map(|(name, value)| (name.span(), value));
    };
    let DeValue::Table(inner) = table.get_mut(section)?.get_mut() else { return None };
    let taken = take(inner, rest)?;
    if inner.is_empty() {
        table.remove(section);
    }
    Some(taken)
}

/// Sets a key that is not set; `false`: it is.
fn put<'i>(
    table: &mut DeTable<'i>,
    key: &'static str,
    at: Range<usize>,
    value: Spanned<DeValue<'i>>,
) -> bool {
    let name = |name: &'static str| Spanned::new(at.clone(), Cow::Borrowed(name));
    let Some((section, rest)) = key.split_once('.') else {
        let free = !table.contains_key(key);
        if free {
            table.insert(name(key), value);
        }
        return free;
    };
    let empty = || Spanned::new(at.clone(), DeValue::Table(DeTable::new()));
    match table.entry(name(section)).or_insert_with(empty).get_mut() {
        DeValue::Table(inner) => put(inner, rest, at, value),
        _ => false,
    }
}

/// A value without its place. `None`: no value of TOML, such as a number out of range.
fn plain(value: &Spanned<DeValue<'_>>) -> Option<Value> {
    Value::deserialize(ValueDeserializer::from(value.clone())).ok()
}

/// Whether a value is that of `default`, however a number is written. Nothing is the same as no default.
fn is_same(value: &Value, default: &str) -> bool {
    let number = |v: &Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
    let parsed = ValueDeserializer::parse(default).and_then(Value::deserialize);
    parsed.is_ok_and(|default| match (number(value), number(&default)) {
        (Some(a), Some(b)) => a.to_bits() == b.to_bits(),
        _ => *value == default,
    })
}

#[cfg(test)]
mod tests;
