//! Every parameter a ground station can see: one table for list, checks and metadata.
//!
//! A parameter is a number of the configuration under a name of at most 16 characters. All are
//! `MAV_PARAM_TYPE_REAL32`, so that both ways of writing integers are right (STATIONS.md). What is
//! not here is not a number (addresses, devices, paths) or belongs to the installation (priority
//! of threads, recording).

use std::sync::LazyLock;

use super::parameter_list::{common, px4_only};
use crate::config::PilotConfig;
use haltere_core::checks::{Problems, shown};
use haltere_core::keys::{Section, When};

/// All of them, in the order of their indices.
static ALL: LazyLock<Vec<Parameter>> = LazyLock::new(|| [common(), px4_only()].concat());
/// How many of them every client sees; the rest are for clients of PX4.
static COMMON: LazyLock<usize> = LazyLock::new(|| ALL.len() - px4_only().len());

/// What values a parameter takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// Any number of the range.
    Number,
    /// Whole numbers of the range.
    Whole,
    /// One of these, with its meaning.
    Choice(&'static [(i8, &'static str)]),
    /// Another name of the parameter with this name.
    Alias(&'static str),
    /// Cannot be changed: it tells a client what it wants to hear.
    Fixed(f32),
}

/// One parameter.
#[derive(Debug, Clone)]
pub struct Parameter {
    /// Name on the wire, at most 16 characters.
    pub name: &'static str,
    /// Key of the configuration, as people write it.
    pub key: String,
    /// Which number of a list it is.
    pub part: usize,
    /// Values.
    pub kind: Kind,
    /// When a new value acts.
    pub when: When,
    /// Lowest value.
    pub low: f64,
    /// Highest value.
    pub high: f64,
    /// Unit; empty: none.
    pub unit: String,
    /// What it does, one sentence or two.
    pub doc: String,
}

impl Parameter {
    /// Its value in a configuration. A range that is not configured is unknown here: the core fills
    /// it in from the survey at the start.
    pub fn value(&self, config: &PilotConfig) -> f32 {
        match self.kind {
            Kind::Fixed(value) => value,
            Kind::Alias(of) => find(of).map_or(0.0, |(_, p)| p.value(config)),
            _ => {
                let value = config.value(self.key_of_list());
                value.map_or(0.0, |v| v.number(self.part, self.low)) as f32
            }
        }
    }

    /// The number a client means, or why it cannot be taken.
    pub fn checked(&self, value: f32) -> Result<f64, String> {
        let Self { name, low, high, ref unit, .. } = *self;
        let [low_shown, high_shown] = [low, high].map(shown);
        if !value.is_finite() {
            return Err(format!("{name} = {value}: not a number"));
        }
        // The shortest decimal of the float: 0.1 stays 0.1 and not 0.10000000149.
        let exact = value.to_string().parse::<f64>().unwrap_or(f64::from(value));
        match self.kind {
            Kind::Choice(choices) if !choices.iter().any(|(n, _)| f64::from(*n) == exact) => {
                let all: Vec<_> =
                    choices.iter().map(|(n, meaning)| format!("{n} {meaning}")).collect();
                return Err(format!("{name} = {value}, allowed {}", all.join(", ")));
            }
            Kind::Choice(_) => {}
            Kind::Whole if exact.fract() != 0.0 => {
                return Err(format!(
                    "{name} = {value}, allowed whole numbers {low_shown} to {high_shown} {unit}"
                ));
            }
            _ if !(low..=high).contains(&exact) => {
                return Err(format!(
                    "{name} = {value}, allowed {low_shown} to {high_shown} {unit}"
                ));
            }
            _ => {}
        }
        Ok(exact)
    }

    /// Checks a value and writes it into a configuration; rules between values are not looked at.
    pub fn put(&self, config: &mut PilotConfig, value: f32) -> Result<(), String> {
        let exact = self.checked(value)?;
        self.set(config, exact);
        Ok(())
    }

    /// Writes a checked value into a configuration.
    pub(crate) fn set(&self, config: &mut PilotConfig, exact: f64) {
        if let Some(value) = config.value_mut(self.key_of_list()) {
            value.set(self.part, exact, self.low);
        }
    }

    /// Its key, of a number of a list the key of the list.
    pub fn key_of_list(&self) -> &str {
        self.key.split('[').next().unwrap_or_default()
    }

    /// Whether a default is known without a survey.
    pub fn has_default(&self) -> bool {
        !(self.key.starts_with("limits.north")
            || self.key.starts_with("limits.east")
            || self.key.starts_with("limits.height"))
    }

    /// The default as people write it: not the float32 with its seventeen digits.
    pub fn default_value(&self, defaults: &PilotConfig) -> f64 {
        let value = self.value(defaults);
        value.to_string().parse().unwrap_or(f64::from(value))
    }

    /// The group it is shown in: the first part of its name.
    pub fn group(&self) -> &'static str {
        GROUPS
            .iter()
            .find(|(prefix, _)| self.name.starts_with(prefix))
            .map_or("Clients of PX4", |(_, title)| title)
    }
}

/// What the first part of a name stands for.
const GROUPS: [(&str, &str); 12] = [
    ("MAV_", "Stations"),
    ("FLT_", "Flight"),
    ("LIM_", "Limits"),
    ("CTL_", "Control"),
    ("CLM_", "Control limits"),
    ("TRM_", "Trims"),
    ("GAN_", "Gains"),
    ("DRG_", "Drag"),
    ("VLT_", "Voltage"),
    ("GND_", "Ground effect"),
    ("EST_", "Estimator"),
    ("UWB_", "Ultra-wideband"),
];

/// The parameter with this name, and its place among all.
pub fn find(name: &str) -> Option<(usize, &'static Parameter)> {
    all().enumerate().find(|(_, p)| p.name == name)
}

/// All of them, in the order of their indices.
pub fn all() -> impl Iterator<Item = &'static Parameter> {
    ALL.iter()
}

/// The one with this index.
pub fn at(index: usize) -> Option<&'static Parameter> {
    ALL.get(index)
}

/// How many a client sees.
pub fn count(px4: bool) -> usize {
    if px4 { ALL.len() } else { *COMMON }
}

/// What the checks of the configuration say about the sections that parameters belong to.
pub fn problems(config: &PilotConfig) -> Problems {
    let mut problems = Problems::new();
    config.check(&mut problems);
    config.limits.check_pack("limits", &config.control.voltage, &mut problems);
    problems
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_names_fit_the_wire_and_are_unique() {
        let mut seen = std::collections::BTreeSet::new();
        for p in all() {
            assert!(p.name.len() <= 16 && p.name.is_ascii(), "{}", p.name);
            assert!(seen.insert(p.name), "{} twice", p.name);
            assert!(p.doc.ends_with('.') && p.doc.len() < 100, "{}", p.name);
            assert!(p.low <= p.high, "{}", p.name);
        }
        assert_eq!(count(true), seen.len());
        assert_eq!(count(false), seen.len() - px4_only().len());
        assert!(at(count(true)).is_none());
    }

    /// What a range of the table allows, the checks of the configuration allow; what it refuses at
    /// its ends, they refuse too. Rules that join two values are left to the checks alone.
    #[test]
    fn prop_ranges_are_those_of_the_configuration() {
        const JOINED: [&str; 14] = [
            "LIM_",
            "CLM_LEAN_INT",
            "CLM_TILT",
            "DRG_PIT",
            "DRG_ROL",
            "DRG_IPT",
            "DRG_IRL",
            "VLT_BASE",
            "VLT_NOMINAL",
            "GND_LAMBDA",
            "GND_POLE",
            "EST_REST_HGT",
            "UWB_PAIRS",
            "FLT_RTN",
        ];
        for p in all().take(count(false)).filter(|p| matches!(p.kind, Kind::Number)) {
            if JOINED.iter().any(|j| p.name.starts_with(j)) {
                continue;
            }
            let try_value = |value: f64| {
                let mut config = PilotConfig::default();
                p.set(&mut config, value);
                problems(&config)
            };
            for inside in [p.low, p.high] {
                let found = try_value(inside);
                assert!(found.is_empty(), "{} = {inside}: {found}", p.name);
            }
            let step = 0.01 * (p.high - p.low);
            for outside in [p.low - step, p.high + step] {
                assert!(!try_value(outside).is_empty(), "{} = {outside} passes", p.name);
            }
        }
    }

    #[test]
    fn prop_every_value_is_set_and_read_back_through_the_wire() {
        for p in all().take(count(false)) {
            let mut config = PilotConfig::default();
            let values: Vec<f64> = match p.kind {
                Kind::Choice(all) => all.iter().map(|(n, _)| f64::from(*n)).collect(),
                Kind::Whole => vec![p.low, p.high],
                _ => vec![p.low, 0.5 * (p.low + p.high), p.high],
            };
            for value in values {
                let exact = p.checked(value as f32).expect("inside its range");
                p.set(&mut config, exact);
                assert_eq!(p.value(&config), value as f32, "{}", p.name);
            }
        }
    }

    #[test]
    fn prop_nonsense_is_refused_with_name_value_and_range() {
        let (_, p) = find("FLT_TKO_HGT").expect("it is in the table");
        assert_eq!(p.checked(25.0).unwrap_err(), "FLT_TKO_HGT = 25, allowed 0.3 to 20 m");
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(p.checked(bad).unwrap_err().ends_with("not a number"));
        }
        let (_, p) = find("CTL_DRAG_FF").expect("it is in the table");
        assert!(p.checked(0.5).unwrap_err().contains("-1 as the version has it, 0 off, 1 on"));
        let (_, p) = find("UWB_PAIRS").expect("it is in the table");
        assert!(p.checked(2.5).unwrap_err().contains("whole numbers 1 to 7"));
        // 0.1 is 0.1, not what a float32 makes of it.
        let (_, p) = find("GAN_VEL_X_P").expect("it is in the table");
        assert_eq!(p.checked(0.1), Ok(0.1));
    }

    /// Every number and switch of the core's configuration is a parameter, or left out for a reason.
    #[test]
    fn prop_no_key_of_the_configuration_is_forgotten() {
        const LEFT_OUT: [&str; 3] = [
            // A list by anchor: written by `haltere fit anchors` into the configuration.
            "estimator.range_bias_m",
            // Without an IMU nothing flies: for recorded flights alone.
            "estimator.motion",
            // Whether it flies at all is chosen where it is started, not by a station.
            "flight.shadow",
        ];
        fn keys(prefix: &str, table: &toml::Table, into: &mut Vec<String>) {
            for (name, value) in table {
                let key = format!("{prefix}.{name}");
                match value {
                    toml::Value::Table(inner) => keys(&key, inner, into),
                    _ => into.push(key),
                }
            }
        }
        let config = PilotConfig::default();
        let mut all = Vec::new();
        for (section, table) in [
            ("flight", toml::Table::try_from(&config.flight)),
            ("limits", toml::Table::try_from(&config.limits)),
            ("uwb", toml::Table::try_from(&config.uwb)),
            ("estimator", toml::Table::try_from(&config.estimator)),
            ("control", toml::Table::try_from(&config.control)),
        ] {
            keys(section, &table.expect("a table"), &mut all);
        }
        let known: Vec<String> =
            super::all().take(count(false)).map(|p| p.key_of_list().to_owned()).collect();
        for key in all {
            let is_known = known.contains(&key) || LEFT_OUT.contains(&key.as_str());
            assert!(is_known, "{key} is no parameter");
        }
    }
}
