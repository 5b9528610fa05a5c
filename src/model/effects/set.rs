//! Which effects are on, with which values.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::effects::{ALL, EffectSpec, Role, Source};
use haltere_core::checks::Problems;

/// A value may leave its plausible range by this many times the width of the range: severities
/// beyond the plausible are wanted in tests, slips of the unit are not.
const RANGE_MARGIN: f64 = 5.0;
/// The same of a size that goes with the vehicle, for the heaviest one that a file may describe.
const VEHICLE_MARGIN: f64 = 100.0;

/// Effects as written in a scenario file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EffectConfig {
    /// Start from the nominal set; else from nothing.
    pub nominal: bool,
    /// Ids to switch off.
    pub off: Vec<String>,
    /// Ids to switch on, with values for their parameters.
    pub on: BTreeMap<String, BTreeMap<String, f64>>,
}

impl Default for EffectConfig {
    fn default() -> Self {
        Self { nominal: true, off: Vec::new(), on: BTreeMap::new() }
    }
}

/// Effects that are on. `None` stands for the default of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectSet {
    /// By place in [`ALL`].
    values: Vec<Option<Vec<Option<f64>>>>,
}

impl Default for EffectSet {
    fn default() -> Self {
        Self::nominal()
    }
}

impl EffectSet {
    /// Nothing but rigid body, thrust and exact sensors.
    pub fn none() -> Self {
        Self { values: vec![None; ALL.len()] }
    }

    /// Every nominal effect, no deviation.
    pub fn nominal() -> Self {
        let on = |spec: &EffectSpec| {
            (spec.role == Role::Nominal).then(|| vec![None; spec.parameters.len()])
        };
        Self { values: ALL.iter().map(on).collect() }
    }

    /// As a scenario says. Refuses unknown ids and keys and senseless values, all at once.
    pub fn from_config(config: &EffectConfig) -> Result<Self, Problems> {
        let mut problems = Problems::new();
        let mut set = if config.nominal { Self::nominal() } else { Self::none() };
        for id in &config.off {
            match place(id) {
                Some(i) => set.values[i] = None,
                None => problems.say(unknown(id)),
            }
        }
        for (id, values) in &config.on {
            let values: Vec<_> = values.iter().map(|(k, v)| (k.as_str(), *v)).collect();
            set.switch_on(id, &values, &mut problems);
        }
        problems.into_result().map(|()| set)
    }

    /// This set with `id` on and these parameters, by name.
    pub fn with(mut self, id: &str, values: &[(&str, f64)]) -> Result<Self, Problems> {
        let mut problems = Problems::new();
        self.switch_on(id, values, &mut problems);
        problems.into_result().map(|()| self)
    }

    /// This set with `id` off. An unknown id is refused.
    pub fn without(mut self, id: &str) -> Result<Self, Problems> {
        let mut problems = Problems::new();
        match place(id) {
            Some(i) => self.values[i] = None,
            None => problems.say(unknown(id)),
        }
        problems.into_result().map(|()| self)
    }

    /// Whether `id` is on.
    pub fn is_on(&self, id: &str) -> bool {
        place(id).is_some_and(|i| self.values[i].is_some())
    }

    /// What is on, in the order of the list, with the given values.
    pub fn iter(&self) -> impl Iterator<Item = (&'static EffectSpec, &[Option<f64>])> {
        ALL.iter().zip(&self.values).filter_map(|(spec, v)| Some((spec, v.as_deref()?)))
    }

    fn switch_on(&mut self, id: &str, values: &[(&str, f64)], problems: &mut Problems) {
        let Some(i) = place(id) else {
            problems.say(unknown(id));
            return;
        };
        let spec = &ALL[i];
        let slots = self.values[i].get_or_insert_with(|| vec![None; spec.parameters.len()]);
        for (name, value) in values {
            let Some(k) = spec.parameters.iter().position(|p| p.name == *name) else {
                let known: Vec<_> = spec.parameters.iter().map(|p| p.name).collect();
                problems.say(format!("effects.{id}.{name}: no such key, has {}", known.join(", ")));
                continue;
            };
            let p = &spec.parameters[k];
            let of_vehicle = matches!(p.source, Source::Vehicle(_)) || p.beside.is_some();
            let widths = if of_vehicle { VEHICLE_MARGIN } else { RANGE_MARGIN };
            let margin = widths * (p.high - p.low);
            if *value != p.off {
                let allowed = p.low - margin..=p.high + margin;
                problems.range(format_args!("effects.{id}.{name}"), *value, allowed, p.unit);
            }
            slots[k] = Some(*value);
        }
    }
}

fn place(id: &str) -> Option<usize> {
    ALL.iter().position(|spec| spec.id == id)
}

fn unknown(id: &str) -> String {
    format!("effects.{id}: no such effect; ids are those of docs/EFFECTS.md")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_config_switches_and_says_what_it_refuses() {
        let config: EffectConfig =
            toml::from_str("off = [\"N7\"]\n[on.A1]\nkappa_x = 1.3\n[on.U2]\n").unwrap();
        let set = EffectSet::from_config(&config).unwrap();
        assert!(!set.is_on("N7") && set.is_on("N1") && set.is_on("A1") && set.is_on("U2"));
        let bad: EffectConfig =
            toml::from_str("off = [\"Z9\"]\n[on.A1]\nkappa_q = 1.3\nkappa_x = 300.0\n[on.X1]\n")
                .unwrap();
        let says = EffectSet::from_config(&bad).unwrap_err();
        assert_eq!(says.lines().len(), 4, "{says}");
        assert!(says.to_string().contains("effects.A1.kappa_x = 300, allowed"), "{says}");
    }
}
