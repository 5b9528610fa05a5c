//! What of a configuration differs from the defaults, for people to see.

use toml::{Table, Value};

use super::Config;

/// A key whose value is not the default.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// Key with its sections.
    pub key: String,
    /// Value, as in a file; `not set` where it is absent.
    pub value: String,
    /// Default, likewise.
    pub default: String,
}

impl Config {
    /// All of them, in the order of their names.
    pub fn differences(&self) -> Vec<Difference> {
        let table = |config: &Config| Table::try_from(config).unwrap_or_default();
        let mut found = Vec::new();
        compare("", &table(self), &table(&Config::default()), &mut found);
        found
    }
}

fn compare(prefix: &str, ours: &Table, defaults: &Table, found: &mut Vec<Difference>) {
    let mut names: Vec<&String> = ours.keys().chain(defaults.keys()).collect();
    names.sort();
    names.dedup();
    for name in names {
        let key = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
        match (ours.get(name), defaults.get(name)) {
            (Some(Value::Table(a)), Some(Value::Table(b))) => compare(&key, a, b, found),
            (a, b) if a == b => {}
            (a, b) => {
                let text = |v: Option<&Value>| v.map_or("not set".to_owned(), Value::to_string);
                found.push(Difference { key, value: text(a), default: text(b) });
            }
        }
    }
}
