//! What describes the parameters: component metadata for stations.
//!
//! Source: the guide's "Component Metadata Protocol" page, and the schemas `general.schema.json`
//! and `parameter.schema.json` (both version 1) of the mavlink repository.

use haltere_dialect::mav::haltere::{
    COMPONENT_INFORMATION_DATA, COMPONENT_METADATA_DATA, MavMessage,
};
use serde_json::{Value, json};

use haltere_core::checks::shown;
use haltere_core::keys::When;
use haltere_core::time::HostTime;

use super::crc32::crc32;
use super::parameter_table as table;
use super::parameter_table::{Kind, Parameter};
use crate::config::PilotConfig;
use crate::flight::event_list;

/// Number of the kind "parameter" (COMP_METADATA_TYPE_PARAMETER).
const TYPE_PARAMETER: u8 = 1;
/// Number of the kind "events" (COMP_METADATA_TYPE_EVENTS).
const TYPE_EVENTS: u8 = 4;
/// Paths over MAVLink FTP.
pub const GENERAL_PATH: &str = "general.json";
/// Paths over MAVLink FTP.
pub const PARAMETER_PATH: &str = "param.json";
/// Paths over MAVLink FTP.
pub const EVENTS_PATH: &str = "events.json";

/// The files, ready to be sent.
#[derive(Debug)]
pub(crate) struct Metadata {
    pub general: Vec<u8>,
    pub parameters: Vec<u8>,
    pub events: Vec<u8>,
}

impl Metadata {
    pub fn new() -> Self {
        let parameters = parameters_json().to_string().into_bytes();
        let events = event_list::json().to_string().into_bytes();
        let general = json!({
            "version": 1,
            "metadataTypes": [{
                "type": TYPE_PARAMETER,
                "uri": uri(PARAMETER_PATH),
                "fileCrc": crc32(&parameters, 0),
            }, {
                "type": TYPE_EVENTS,
                "uri": uri(EVENTS_PATH),
                "fileCrc": crc32(&events, 0),
            }],
        });
        Self { general: general.to_string().into_bytes(), parameters, events }
    }

    /// All of them, with their names.
    pub fn files(&self) -> impl Iterator<Item = (&'static str, &[u8])> {
        [
            (GENERAL_PATH, &self.general[..]),
            (PARAMETER_PATH, &self.parameters),
            (EVENTS_PATH, &self.events),
        ]
        .into_iter()
    }

    /// COMPONENT_METADATA.
    pub fn message(&self, at: HostTime) -> MavMessage {
        MavMessage::COMPONENT_METADATA(COMPONENT_METADATA_DATA {
            time_boot_ms: (at.as_us() / 1000) as u32,
            file_crc: crc32(&self.general, 0),
            uri: uri_field().into(),
        })
    }

    /// COMPONENT_INFORMATION, which older stations ask for.
    pub fn older_message(&self, at: HostTime) -> MavMessage {
        MavMessage::COMPONENT_INFORMATION(COMPONENT_INFORMATION_DATA {
            time_boot_ms: (at.as_us() / 1000) as u32,
            general_metadata_file_crc: crc32(&self.general, 0),
            peripherals_metadata_file_crc: 0,
            general_metadata_uri: uri_field().into(),
            peripherals_metadata_uri: [0; 100].into(),
        })
    }
}

fn uri(path: &str) -> String {
    format!("mftp:///{path}")
}

fn uri_field() -> [u8; 100] {
    let mut field = [0; 100];
    for (slot, byte) in field.iter_mut().zip(uri(GENERAL_PATH).bytes()) {
        *slot = byte;
    }
    field
}

fn parameters_json() -> Value {
    let defaults = PilotConfig::default();
    let list: Vec<Value> = table::all().map(|p| parameter_json(p, &defaults)).collect();
    json!({ "version": 1, "parameters": list })
}

fn parameter_json(p: &Parameter, defaults: &PilotConfig) -> Value {
    let mut entry = json!({
        "name": p.name,
        "type": "Float",
        "group": p.group(),
        "category": "Standard",
        "shortDesc": p.doc,
        "longDesc": long(p),
        "units": p.unit,
        "rebootRequired": p.when == When::Restart,
        "min": shown(p.low),
        "max": shown(p.high),
    });
    if p.has_default() {
        entry["default"] = json!(p.default_value(defaults));
    }
    match p.kind {
        Kind::Choice(choices) => {
            let values: Vec<_> = choices
                .iter()
                .map(|(n, text)| json!({ "value": n, "description": text }))
                .collect();
            entry["values"] = Value::from(values);
        }
        Kind::Whole => entry["decimalPlaces"] = json!(0),
        _ => {}
    }
    entry
}

/// What is said of it at length.
pub(crate) fn long(p: &Parameter) -> String {
    let when = match p.when {
        When::AtOnce => "Acts at once, in flight too.",
        When::OnFloor => "Acts at once on the floor; refused in flight.",
        When::Restart => "Acts after a restart.",
    };
    match p.kind {
        Kind::Alias(of) => format!("{} The same value as {of}.", p.doc),
        Kind::Fixed(_) => format!("{} It cannot be changed.", p.doc),
        _ => format!("{} {when} Key of the configuration: {}.", p.doc, p.key),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The required fields of the schemas, by hand: the schema files are not in this repository.
    #[test]
    fn prop_metadata_has_what_the_schemas_require() {
        let metadata = Metadata::new();
        let general: Value = serde_json::from_slice(&metadata.general).unwrap();
        assert_eq!(general["version"], 1);
        assert_eq!(general["metadataTypes"][0]["type"], 1);
        assert_eq!(general["metadataTypes"][0]["uri"], "mftp:///param.json");
        assert_eq!(general["metadataTypes"][0]["fileCrc"], crc32(&metadata.parameters, 0));
        let all: Value = serde_json::from_slice(&metadata.parameters).unwrap();
        let list = all["parameters"].as_array().unwrap();
        assert_eq!(list.len(), table::count(true));
        for entry in list {
            assert!(entry["name"].as_str().unwrap().len() <= 16);
            assert_eq!(entry["type"], "Float");
            assert!(entry["min"].as_f64().unwrap() <= entry["max"].as_f64().unwrap());
            assert!(!entry["shortDesc"].as_str().unwrap().is_empty());
        }
    }
}
