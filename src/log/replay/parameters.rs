//! Parameters that stations changed in a flight, read from what the companion told them.
//!
//! Whatever is put in force is told to every open station as PARAM_VALUE. The first value of a name is
//! that of the recorded configuration; a later one that differs is a change.

use std::collections::BTreeMap;

use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::MavSplitter;

use super::recorded_config;
use crate::record::{Entry, LogReader};
use haltere_core::time::HostTime;
use haltere_pilot::LinkId;
use haltere_pilot::services::find_parameter;

/// A change.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterChange {
    /// When it was told.
    pub at: HostTime,
    /// Its name.
    pub name: &'static str,
    /// Value before; `None` where the configuration leaves it to the survey.
    pub from: Option<f64>,
    /// Value since then.
    pub to: f64,
    /// Unit; empty: none.
    pub unit: &'static str,
}

/// Changes in the order of time. Empty for a log whose configuration this build refuses.
pub fn changed_parameters(log: &LogReader) -> Vec<ParameterChange> {
    let Ok(config) = recorded_config(log) else { return Vec::new() };
    let pilot = config.pilot();
    let mut known: BTreeMap<&'static str, f32> = BTreeMap::new();
    let mut splitters: BTreeMap<LinkId, MavSplitter> = BTreeMap::new();
    let mut changes = Vec::new();
    for entry in log.entries() {
        let Entry::Output { at, link, bytes, .. } = entry else { continue };
        if !matches!(link, LinkId::Ground(_)) {
            continue;
        }
        let splitter = splitters.entry(link).or_default();
        splitter.push(&bytes);
        while let Some(found) = splitter.next() {
            let Ok(MavMessage::PARAM_VALUE(m)) = found.and_then(|frame| frame.decode()) else {
                continue;
            };
            let name: String =
                m.param_id.iter().take_while(|b| **b != 0).map(|b| *b as char).collect();
            // The hash of all of them is told in the same form, and is no parameter.
            let Some((_, parameter)) = find_parameter(&name) else { continue };
            let set = parameter.has_default();
            let before = known
                .insert(parameter.name, m.param_value)
                .or_else(|| set.then(|| parameter.value(&pilot)));
            if before.is_some_and(|before| before.to_bits() != m.param_value.to_bits()) {
                // The shortest decimal of the float: 0.1, not 0.10000000149.
                let decimal = |v: f32| v.to_string().parse().unwrap_or(f64::from(v));
                changes.push(ParameterChange {
                    at,
                    name: parameter.name,
                    from: before.map(decimal),
                    to: decimal(m.param_value),
                    unit: &parameter.unit,
                });
            }
        }
    }
    changes
}
