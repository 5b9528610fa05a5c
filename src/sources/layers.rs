//! Layers of configuration: each is parsed strictly by itself, then they are merged.
//!
//! The merging crate turns one type into another without a word (9.7 becomes 10, "77" becomes 77).
//! So every layer is first read into the typed configuration as it stands, and only what passed
//! is merged.

use std::path::{Path, PathBuf};

use toml::{Table, Value};

use super::{DEFAULT_FILE, Sources};
use haltere_core::checks::Problems;
use haltere_log::intake;
use haltere_pilot::settings::{Config, Note, read_config, read_recorded, reference};

/// Longest configuration that is read, bytes.
pub(super) const MOST_BYTES: u64 = 4 << 20;
/// What begins the name of every environment variable that is a configuration key.
const ENVIRONMENT_PREFIX: &str = "HALTERE_";
/// What stands between section and key in it.
const ENVIRONMENT_SEPARATOR: &str = "__";

/// One origin of values.
#[derive(Debug)]
struct Layer {
    name: String,
    path: Option<PathBuf>,
    table: Table,
}

/// All origins, in the order of their authority.
#[derive(Debug)]
pub(super) struct Layers {
    layers: Vec<Layer>,
    /// What people should know.
    pub notes: Vec<Note>,
}

impl Layers {
    /// Reads every origin and refuses what cannot be typed.
    pub(super) fn read(sources: &Sources) -> Result<Self, Problems> {
        let mut problems = Problems::new();
        let (mut layers, mut notes): (Vec<Layer>, _) = (Vec::new(), Vec::new());
        let mut files = sources.files.clone();
        match &sources.recorded {
            Some(recorded) if files.is_empty() => {
                match read_recorded(&recorded.name, &recorded.text) {
                    Ok(read) => {
                        let name = recorded.name.clone();
                        layers.push(Layer { name, path: None, table: read.table });
                    }
                    Err(found) => found.lines().iter().for_each(|line| problems.say(line)),
                }
            }
            None if files.is_empty() && Path::new(DEFAULT_FILE).exists() => {
                files.push(DEFAULT_FILE.into());
            }
            _ => {}
        }
        for path in files {
            match read_file(&path) {
                Ok(layer) => layers.push(layer),
                Err(found) => found.lines().iter().for_each(|line| problems.say(line)),
            }
        }
        if let Some(vehicle) = &sources.vehicle {
            match vehicle.read() {
                Ok(table) => layers.push(Layer { name: vehicle.name.clone(), path: None, table }),
                Err(found) => found.lines().iter().for_each(|line| problems.say(line)),
            }
        }
        let defaults = Table::try_from(Config::default()).unwrap_or_default();
        for (name, _) in &sources.environment {
            if let Some(key) = nearly_a_key(name) {
                notes.push(Note::misspelt(format!(
                    "environment variable {name}: not used: {} sets {key}",
                    variable_of(&key)
                )));
            }
        }
        let variables = sources.environment.iter().filter_map(|(name, value)| {
            let key = name.strip_prefix(ENVIRONMENT_PREFIX)?;
            if !key.contains(ENVIRONMENT_SEPARATOR) {
                return None;
            }
            let key = as_written(&defaults, &key.replace(ENVIRONMENT_SEPARATOR, "."));
            Some((format!("environment variable {name}"), key, value.as_str()))
        });
        let overrides = sources.overrides.iter().map(|text| match text.split_once('=') {
            Some((key, value)) => (format!("--set {text}"), key.trim().to_owned(), value.trim()),
            None => (format!("--set {text}"), String::new(), ""),
        });
        for (name, key, value) in variables.chain(overrides) {
            match single(&name, &key, value) {
                Ok(table) => layers.push(Layer { name, path: None, table }),
                Err(found) => found.lines().iter().for_each(|line| problems.say(line)),
            }
        }
        problems.into_result()?;
        Ok(Self { layers, notes })
    }

    /// One typed configuration out of all of them.
    pub(super) fn merged(&self) -> Result<Config, Problems> {
        let mut builder = config::Config::builder();
        for layer in &self.layers {
            let text = layer.table.to_string();
            builder = builder.add_source(config::File::from_str(&text, config::FileFormat::Toml));
        }
        let merged = builder.build().and_then(config::Config::try_deserialize::<Table>);
        let merged = merged.map_err(|error| Problems::one(error.to_string()))?;
        Ok(read_config("configuration", &merged.to_string())?.config)
    }

    /// A problem's line, led by the origin of the key that it begins with.
    pub(super) fn with_origin(&self, line: &str) -> String {
        let end = line
            .find(|c: char| !(c.is_ascii_alphanumeric() || matches!(c, '.' | '_')))
            .unwrap_or(line.len());
        let key = line.get(..end).unwrap_or_default();
        match self.origin(key) {
            Some(layer) => format!("{}: {line}", layer.name),
            None => line.to_owned(),
        }
    }

    /// `path`, relative to the file that sets `key`.
    pub(super) fn beside(&self, key: &str, path: &Path) -> PathBuf {
        // A default has no file of its own: the last file is meant.
        let base = match self.origin(key) {
            Some(layer) => layer.path.as_deref(),
            None => self.layers.iter().rev().find_map(|layer| layer.path.as_deref()),
        };
        base.and_then(Path::parent).map_or_else(|| path.to_owned(), |folder| folder.join(path))
    }

    /// Whether a key is set by an environment variable or on the command line.
    pub(super) fn is_set_by_hand(&self, key: &str) -> bool {
        self.origin(key).is_some_and(|layer| layer.path.is_none())
    }

    /// Whether a file of the configuration has the last word on a key.
    pub(super) fn is_of_file(&self, key: &str) -> bool {
        self.origin(key).is_some_and(|layer| layer.path.is_some())
    }

    /// Whether any origin sets a key.
    pub(super) fn is_set(&self, key: &str) -> bool {
        self.origin(key).is_some()
    }

    /// Files among the origins.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        self.layers.iter().filter_map(|layer| layer.path.clone()).collect()
    }

    /// Name of the origin that sets a key.
    pub(super) fn origin_name(&self, key: &str) -> Option<&str> {
        self.origin(key).map(|layer| layer.name.as_str())
    }

    fn origin(&self, key: &str) -> Option<&Layer> {
        self.layers.iter().rev().find(|layer| lookup(&layer.table, key).is_some())
    }
}

fn read_file(path: &Path) -> Result<Layer, Problems> {
    let name = path.display().to_string();
    let text = intake::text(path, MOST_BYTES).map_err(|error| {
        Problems::one(format!(
            "{name}: cannot be read: {error}; config/haltere.toml is a sample of what it may hold, \
             `haltere init` writes one"
        ))
    })?;
    let read = read_config(&name, &text)?;
    Ok(Layer { name, path: Some(path.to_owned()), table: read.table })
}

/// A layer of one key.
fn single(name: &str, key: &str, text: &str) -> Result<Table, Problems> {
    let parts: Vec<_> = key.split('.').collect();
    if parts.len() < 2 || parts.iter().any(|part| part.is_empty()) {
        return Err(Problems::one(format!("{name}: write it as section.key=value")));
    }
    let defaults = Table::try_from(Config::default()).unwrap_or_default();
    let mut value = value_like(lookup(&defaults, key), text);
    for part in parts.iter().rev() {
        value = Value::Table(Table::from_iter([((*part).to_owned(), value)]));
    }
    let Value::Table(table) = value else { return Ok(Table::new()) };
    read_config(name, &table.to_string()).map(|read| read.table)
}

/// Text from a command line, typed like the default of its key.
fn value_like(default: Option<&Value>, text: &str) -> Value {
    let parsed = || {
        format!("value = {text}").parse::<Table>().ok().and_then(|mut table| table.remove("value"))
    };
    match default {
        // In quotes as in a file, so that "" is nothing, or as it stands.
        Some(Value::String(_)) => {
            let quoted = parsed().filter(Value::is_str);
            quoted.unwrap_or_else(|| Value::String(text.to_owned()))
        }
        Some(Value::Array(items)) if !text.trim_start().starts_with('[') => Value::Array(
            text.split(',')
                .map(str::trim)
                .filter(|item| !item.is_empty())
                .map(|item| value_like(items.first(), item))
                .collect(),
        ),
        _ => parsed().unwrap_or_else(|| Value::String(text.to_owned())),
    }
}

/// The key that a variable would name if two underscores stood where one does. Others are nobody's business.
fn nearly_a_key(name: &str) -> Option<String> {
    let rest = name.strip_prefix(ENVIRONMENT_PREFIX)?;
    if rest.contains(ENVIRONMENT_SEPARATOR) {
        return None;
    }
    let keys = reference().into_iter().map(|key| format!("{}.{}", key.section, key.name));
    keys.into_iter().find(|key| key.replace('.', "_").eq_ignore_ascii_case(rest))
}

/// The variable that sets a key.
fn variable_of(key: &str) -> String {
    ENVIRONMENT_PREFIX.to_owned() + &key.replace('.', ENVIRONMENT_SEPARATOR).to_uppercase()
}

/// The key of a variable, whose name is in capitals, with the letters that the key has.
fn as_written(defaults: &Table, key: &str) -> String {
    let mut table = Some(defaults);
    let parts = key.split('.').map(|part| {
        let known = table.and_then(|t| t.iter().find(|(name, _)| name.eq_ignore_ascii_case(part)));
        table = known.and_then(|(_, value)| value.as_table());
        known.map_or_else(|| part.to_lowercase(), |(name, _)| name.clone())
    });
    parts.collect::<Vec<_>>().join(".")
}

pub(super) fn lookup<'t>(table: &'t Table, key: &str) -> Option<&'t Value> {
    let (first, rest) = key.split_once('.').map_or((key, None), |(a, b)| (a, Some(b)));
    match (table.get(first)?, rest) {
        (Value::Table(inner), Some(rest)) => lookup(inner, rest),
        (value, None) => Some(value),
        _ => None,
    }
}
