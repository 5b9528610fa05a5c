//! The table is whole. What users and logs are told of its keys is tried where files are read.

use super::*;
use crate::settings::Config;

/// Made up: the real one may be empty.
const TABLE: &[Retired] = &[
    Retired {
        key: "flight.hop_m",
        fate: Fate::Gone { default: "0.5", heir: "flight.takeoff_height_m" },
    },
    Retired { key: "log.folder", fate: Fate::MovedTo("record.directory") },
];

#[test]
fn prop_the_real_table_is_whole() {
    // The same is asked of the table of these tests, so that it is asked of something.
    for row in RETIRED.iter().chain(TABLE) {
        let defaults = toml::Table::try_from(Config::default()).unwrap();
        let is_default = |key: &str| {
            let mut parts = key.split('.');
            let first = defaults.get(parts.next().unwrap_or_default());
            parts.try_fold(first, |v, part| v.map(|v| v.get(part))).flatten().is_some()
        };
        assert!(row.key.contains('.'), "{}: write it with its section", row.key);
        assert!(!is_default(row.key), "{} is in force", row.key);
        let guarded = GUARDED.iter().any(|s| row.key.starts_with(&format!("{s}.")));
        match row.fate {
            Fate::Gone { default, heir } => {
                assert!(!guarded || !heir.is_empty(), "{}: name what serves its purpose", row.key);
                let value = ValueDeserializer::parse(default).is_ok();
                assert!(default.is_empty() || value, "{}: default {default}", row.key);
            }
            Fate::MovedTo(heir) => {
                let shown = crate::settings::reference()
                    .iter()
                    .any(|key| format!("{}.{}", key.section, key.name) == heir);
                assert!(shown, "{}: there is no key {heir}", row.key);
            }
        }
    }
    for (i, row) in RETIRED.iter().enumerate() {
        assert!(!RETIRED[..i].iter().any(|other| other.key == row.key), "{}: twice", row.key);
    }
}
