//! One text of a configuration, read strictly: what a file, a variable or the head of a log may hold, and where in it
//! something is wrong.

use std::ops::Range;

use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

use super::Config;
use haltere_core::checks::Problems;
use haltere_core::checks::schema::Schema;

/// A configuration that was read from one text.
#[derive(Debug)]
pub struct Read {
    /// Typed, what is absent at its default.
    pub config: Config,
    /// As it stands there.
    pub table: Table,
}

/// Keys that logs hold, which live longer than builds, and that this build does not know.
pub(super) const FORMER: [&str; 7] = [
    "estimator.acc_over_beats",
    "estimator.uwb_arrival_frac",
    "diagnosis.after_programs",
    "diagnosis.size",
    "diagnosis.banks",
    "diagnosis.references",
    "diagnosis.vehicle",
];

/// Reads one text of a configuration that a user wrote.
pub fn read_config(name: &str, text: &str) -> Result<Read, Problems> {
    read(name, text, &[])
}

/// Reads the configuration in the head of a log, which may be of an older build.
pub fn read_recorded(name: &str, text: &str) -> Result<Read, Problems> {
    read(name, text, &FORMER)
}

/// Reads one text without the keys of `former`.
fn read(name: &str, text: &str, former: &[&str]) -> Result<Read, Problems> {
    let mut root = parse(name, text)?;
    check_schema(name, &mut root)?;
    for key in former {
        take_out(root.get_mut(), key);
    }
    let table: Table = typed(name, text, root.clone())?;
    let config: Config = typed(name, text, root)?;
    let understood = Table::try_from(&config).unwrap_or_default();
    match surplus(&table, &understood, "") {
        Some(why) => Err(Problems::one(format!("{name}: {why}"))),
        None => Ok(Read { config, table }),
    }
}

/// Removes a key, and sections that hold nothing without it.
fn take_out(table: &mut DeTable<'_>, key: &str) {
    let Some((section, rest)) = key.split_once('.') else {
        table.remove(key);
        return;
    };
    if let Some(DeValue::Table(inner)) = table.get_mut(section).map(Spanned::get_mut) {
        take_out(inner, rest);
        if inner.is_empty() {
            table.remove(section);
        }
    }
}

/// A list of numbers that is longer than what was understood of it: serde takes the first of too many without a word.
pub fn surplus(found: &Table, understood: &Table, section: &str) -> Option<String> {
    found.iter().find_map(|(key, value)| {
        let key_here = if section.is_empty() { key.clone() } else { format!("{section}.{key}") };
        surplus_in(value, understood.get(key)?, &key_here)
    })
}

fn surplus_in(found: &Value, understood: &Value, key: &str) -> Option<String> {
    match (found, understood) {
        (Value::Table(found), Value::Table(understood)) => surplus(found, understood, key),
        (Value::Array(found), Value::Array(understood)) => {
            let numbers = |all: &[Value]| all.iter().all(|v| v.is_integer() || v.is_float());
            if numbers(found) && numbers(understood) && found.len() > understood.len() {
                let list = Value::Array(found.clone());
                return Some(format!(
                    "{key} = {list}: {} numbers, allowed {}",
                    found.len(),
                    understood.len()
                ));
            }
            let mut pairs = found.iter().zip(understood).enumerate();
            pairs.find_map(|(n, (a, b))| surplus_in(a, b, &format!("{key}[{n}]")))
        }
        _ => None,
    }
}

/// As many numbers as are due, neither more nor fewer: for `deserialize_with`.
pub(super) fn exactly<'de, D: serde::Deserializer<'de>, const N: usize>(
    from: D,
) -> Result<[f64; N], D::Error> {
    let all = <Vec<f64> as serde::Deserialize>::deserialize(from)?;
    let count = all.len();
    all.try_into()
        .map_err(|_| serde::de::Error::custom(format_args!("found {count} numbers, allowed {N}")))
}

/// Takes the version out of a text, and refuses a newer one before any key of it is judged.
fn check_schema(name: &str, root: &mut Spanned<DeTable<'_>>) -> Result<(), Problems> {
    let Some(version) = root.get_mut().remove(Schema::KEY) else { return Ok(()) };
    let shown = version.get_ref().as_integer().map_or("no whole number", |v| v.as_str());
    Schema::CONFIGURATION
        .check_text(shown)
        .map_err(|error| Problems::one(format!("{name}: {error}")))
}

/// Typed content of a TOML text; a refusal names file, line, key, and what is allowed.
pub fn parse_strictly<T: DeserializeOwned>(name: &str, text: &str) -> Result<T, Problems> {
    typed(name, text, parse(name, text)?)
}

fn parse<'t>(name: &str, text: &'t str) -> Result<Spanned<DeTable<'t>>, Problems> {
    DeTable::parse(text).map_err(|e| {
        let line = line_of(text, e.span().map_or(0, |span| span.start));
        Problems::one(format!("{name}: line {line}: {}", e.message().trim()))
    })
}

fn typed<T: DeserializeOwned>(
    name: &str,
    text: &str,
    root: Spanned<DeTable<'_>>,
) -> Result<T, Problems> {
    T::deserialize(toml::Deserializer::from(root)).map_err(|error| {
        let span = error.span();
        let key = span.as_ref().and_then(|at| key_of(parse(name, text).ok()?.get_ref(), at));
        let key = key.map_or_else(String::new, |key| key + ": ");
        let place = place(name, text, span.map_or(0, |span| span.start));
        Problems::one(format!("{place}{key}{}", in_words(error.message())))
    })
}

/// The innermost key that stands, or whose value stands, around a piece of the text.
fn key_of(table: &DeTable<'_>, piece: &Range<usize>) -> Option<String> {
    table.iter().find_map(|(key, value)| {
        let name = key.get_ref();
        if around(&key.span(), piece) { Some(name.to_string()) } else { key_in(value, piece, name) }
    })
}

fn key_in(value: &Spanned<DeValue<'_>>, piece: &Range<usize>, key: &str) -> Option<String> {
    let inside = match value.get_ref() {
        DeValue::Table(table) => key_of(table, piece).map(|rest| format!("{key}.{rest}")),
        DeValue::Array(items) => (items.iter().enumerate())
            .find_map(|(n, item)| key_in(item, piece, &format!("{key}[{n}]"))),
        _ => None,
    };
    inside.or_else(|| around(&value.span(), piece).then(|| key.to_owned()))
}

fn around(span: &Range<usize>, piece: &Range<usize>) -> bool {
    span.start <= piece.start && piece.end <= span.end
}

/// Where in a text something stands, for people. A text of one key has no lines.
fn place(name: &str, text: &str, at: usize) -> String {
    if text.contains('\n') && name.ends_with(".toml") {
        format!("{name}: line {}: ", line_of(text, at))
    } else {
        format!("{name}: ")
    }
}

fn line_of(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|byte| *byte == b'\n').count()
}

/// The parser's words for types, in words for people.
fn in_words(message: &str) -> String {
    let mut message = message.trim().to_owned();
    for (theirs, ours) in [
        ("unknown field", "unknown key"),
        ("missing field", "missing key"),
        ("unknown variant", "unknown choice"),
        ("expected f64", "expected a number"),
        ("expected u8", "expected a whole number from 0 to 255"),
        ("expected u32", "expected a whole number from 0 to 4294967295"),
        ("expected u64", "expected a whole number"),
        ("expected usize", "expected a whole number"),
        ("expected a boolean", "expected true or false"),
        ("expected a string", "expected text in quotes"),
        ("expected a sequence", "expected a list"),
        ("invalid type: ", "found "),
        ("invalid value: ", "found "),
        ("floating point ", "number "),
    ] {
        message = message.replace(theirs, ours);
    }
    message
}
