//! Numbers of a vehicle among the keys of the configuration.

use std::sync::LazyLock;

use toml::{Table, Value};

use super::layers::{Layers, lookup};
use haltere_core::checks::Problems;
use haltere_core::keys::{Row, Section as _, below};
use haltere_pilot::settings::{Config, read_config};

/// Keys that belong to the vehicle, whatever room it flies in: drag, levers, and how far its accelerometer and gyroscope
/// can be believed in flight. All else of the filter is the same for every vehicle.
static VEHICLE_KEYS: LazyLock<Vec<String>> = LazyLock::new(|| {
    let mut keys = Vec::new();
    Config::rows("", &mut |at, row| match row {
        Row::Key(key) if key.of_vehicle => keys.push(below(at, key.name)),
        _ => {}
    });
    keys
});

/// Numbers of a vehicle, as lines of a configuration.
#[derive(Debug, Clone)]
pub struct VehicleKeys {
    /// Where they are from, for people.
    pub name: String,
    /// The lines.
    pub text: String,
}

/// Where one number of the vehicle comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Origin {
    /// Its key.
    pub key: &'static str,
    /// What is in force; nothing where the key has no value.
    pub value: Option<Value>,
    /// Name of the file, or the option that set it; nothing where it is the default.
    pub from: Option<String>,
    /// Whether it is told over the files of the configuration: by a vehicle, the environment or the command line.
    pub over_files: bool,
}

impl VehicleKeys {
    /// The lines as a table that holds nothing but numbers of a vehicle.
    pub(super) fn read(&self) -> Result<Table, Problems> {
        let read = read_config(&self.name, &self.text)?;
        let mut keys = Vec::new();
        leaves(&read.table, "", &mut keys);
        match keys.iter().find(|key| !VEHICLE_KEYS.contains(key)) {
            None => Ok(read.table),
            Some(key) => Err(Problems::one(format!(
                "{}: {key} is no number of a vehicle, allowed are {}; it belongs into the configuration (--config)",
                self.name,
                VEHICLE_KEYS.join(", ")
            ))),
        }
    }
}

fn leaves(table: &Table, section: &str, keys: &mut Vec<String>) {
    for (name, value) in table {
        let key = if section.is_empty() { name.clone() } else { format!("{section}.{name}") };
        match value {
            Value::Table(inner) => leaves(inner, &key, keys),
            _ => keys.push(key),
        }
    }
}

/// Where each number of the vehicle comes from.
pub(super) fn origins(config: &Config, layers: &Layers) -> Vec<Origin> {
    let values = Table::try_from(config).unwrap_or_default();
    let origin = |key: &'static String| Origin {
        key,
        value: lookup(&values, key).cloned(),
        from: layers.origin_name(key).map(str::to_owned),
        over_files: layers.is_set(key) && !layers.is_of_file(key),
    };
    VEHICLE_KEYS.iter().map(origin).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Sources, load_with_origins};
    use super::*;

    fn of(text: &str) -> Option<VehicleKeys> {
        Some(VehicleKeys { name: "quad.toml".into(), text: text.into() })
    }

    #[test]
    fn prop_a_vehicle_wins_over_files_and_yields_to_the_command_line() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("own.toml");
        std::fs::write(&file, "[estimator]\ncop_z_m = 0.02\nacc_average_s = 0.01\nalign_s = 2.0")
            .unwrap();
        let vehicle = of("[estimator]\ncop_z_m = 0.01\nacc_average_s = 0.0");
        let overrides = vec!["estimator.acc_average_s=0.005".into()];
        let sources =
            Sources { files: vec![file.clone()], vehicle, overrides, ..Sources::default() };
        let (config, origins) = load_with_origins(&sources).unwrap();
        let e = &config.estimator;
        assert_eq!((e.cop_z_m, e.acc_average_s, e.align_s), (0.01, 0.005, 2.0));
        let from = |key: &str| origins.iter().find(|o| o.key == key).unwrap().from.clone();
        assert_eq!(from("estimator.cop_z_m").unwrap(), "quad.toml");
        assert_eq!(from("estimator.acc_average_s").unwrap(), "--set estimator.acc_average_s=0.005");
        assert_eq!(from("estimator.align_s").unwrap(), file.display().to_string());
        assert_eq!(from("estimator.drag"), None);
    }

    #[test]
    fn prop_a_vehicle_says_nothing_of_the_room() {
        for (text, says) in [
            (
                "[estimator]\nstd_uwb_m = 0.1",
                "quad.toml: estimator.std_uwb_m is no number of a vehicle",
            ),
            ("[estimator.gate]\nsigma = 3.0", "quad.toml: estimator.gate.sigma is no number"),
            ("[estimator]\ncop_m = 0.1", "quad.toml: line 2"),
        ] {
            let sources = Sources { vehicle: of(text), ..Sources::default() };
            let error = load_with_origins(&sources).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
    }

    #[test]
    fn prop_every_number_of_a_vehicle_is_a_key() {
        let sources = Sources::default();
        let (_, origins) = load_with_origins(&sources).unwrap();
        for origin in origins {
            // The height at rest has no default.
            assert!(
                origin.value.is_some() || origin.key == "estimator.rest_height_m",
                "{origin:?}"
            );
        }
    }
}
