//! What events there are, with the texts of their components: the file `events.json`.
//!
//! Source: the README and `libs/cpp/parse` of the libevents project, whose parser stations use. An
//! event's id is its namespace (8 bits, our component) and its own number (24 bits).

use serde_json::{Map, Value, json};

use super::at_rest::{AT_REST, Quantity, is};
use super::modes::{Event as Cause, Mode, TABLE};
use super::shown_modes::SHOWN_MODES;
use super::supervisor::CONDITIONS;
use crate::out::OWN_COMPONENT;

/// Numbers of events.
pub const MODE_CHANGED: u32 = 1;
/// Numbers of events.
pub const ARMING_SUMMARY: u32 = 2;
/// Numbers of events.
pub const HEALTH_SUMMARY: u32 = 3;
/// Numbers of events.
pub const CONDITION_BEGINS: u32 = 4;
/// Numbers of events.
pub const CONDITION_ENDS: u32 = 5;
/// Number of the event of the first row of [`AT_REST`]; the others follow in their order.
pub const FIRST_CHECK: u32 = 16;

/// Bit of a component of health: 0 is "none", what is known at rest follows.
pub fn health_bit(row: &Quantity) -> u32 {
    1 << health_index(row)
}

/// Index of the same.
pub fn health_index(row: &Quantity) -> u8 {
    AT_REST.iter().position(|other| is(other, row)).unwrap_or(0) as u8 + 1
}

/// All modes that can be chosen: each has a bit, in the order of AVAILABLE_MODES.
pub fn all_modes() -> u32 {
    (1 << SHOWN_MODES.len()) - 1
}

/// Number of a mode as an argument.
pub fn mode_number(mode: Mode) -> u8 {
    Mode::ALL.iter().position(|m| *m == mode).unwrap_or(0) as u8
}

/// Number of a row of the table of modes as an argument. The conditions of the supervisor follow.
pub fn cause_number(from: Mode, on: Cause) -> u8 {
    TABLE.iter().position(|row| row.on == on && row.from.contains(&from)).unwrap_or(0) as u8
}

fn argument(kind: &str, name: &str) -> Value {
    json!({ "type": kind, "name": name })
}

fn entries<'a>(of: impl Iterator<Item = (u64, &'a str, &'a str)>) -> Value {
    let map: Map<String, Value> = of
        .map(|(n, name, text)| (n.to_string(), json!({ "name": name, "description": text })))
        .collect();
    Value::Object(map)
}

/// The file.
pub fn json() -> Value {
    let checks = || AT_REST.iter();
    let health = std::iter::once((1, "none", "None"))
        .chain(checks().map(|row| (u64::from(health_bit(row)), row.name, row.title)));
    let choices = SHOWN_MODES.iter().enumerate();
    let groups: Map<String, Value> =
        choices.clone().map(|(i, m)| (i.to_string(), json!([m.mode.custom_mode()]))).collect();
    let causes: Vec<String> =
        (0..TABLE.len() + CONDITIONS.len()).map(|n| format!("cause_{n}")).collect();
    let reasons =
        || TABLE.iter().map(|row| row.because).chain(CONDITIONS.iter().map(|row| row.because));
    let check_events: Map<String, Value> = checks()
        .zip(FIRST_CHECK..)
        .map(|(row, number)| {
            let event = json!({
                "name": format!("check_{}", row.name),
                "message": row.failed,
                "arguments": [
                    argument("navigation_mode_group_t", "modes"),
                    argument("uint8_t", "health_component_index"),
                ],
            });
            (number.to_string(), event)
        })
        .collect();
    let mut arming = check_events;
    arming.insert(
        ARMING_SUMMARY.to_string(),
        json!({
            "name": "arming_check_summary",
            "message": "Arming checks",
            "type": "summary",
            "arguments": [
                argument("uint8_t", "chunk_idx"),
                argument("health_component_t", "error"),
                argument("health_component_t", "warning"),
                argument("navigation_mode_group_t", "can_arm"),
                argument("navigation_mode_group_t", "can_run"),
            ],
        }),
    );
    json!({
        "version": 2,
        "components": { OWN_COMPONENT.to_string(): {
            "namespace": "haltere",
            "enums": {
                "mode_t": {
                    "type": "uint8_t",
                    "description": "Modes",
                    "entries": entries((0..).zip(Mode::ALL).map(|(n, m)| (n, m.name(), m.name()))),
                },
                "cause_t": {
                    "type": "uint8_t",
                    "description": "Why a mode changed: rows of docs/MODES.md, then conditions of docs/SAFETY.md",
                    "entries": entries(
                        (0..).zip(reasons()).zip(&causes)
                            .map(|((n, because), name)| (n, name.as_str(), because)),
                    ),
                },
                "condition_t": {
                    "type": "uint8_t",
                    "description": "What the supervisor watches for: rows of docs/SAFETY.md",
                    "entries": entries(
                        (0..).zip(&CONDITIONS).map(|(n, row)| (n, row.name, row.because)),
                    ),
                },
                "health_component_t": {
                    "type": "uint32_t",
                    "is_bitfield": true,
                    "description": "What the arming checks look at",
                    "entries": entries(health),
                },
                "navigation_mode_group_t": {
                    "type": "uint32_t",
                    "is_bitfield": true,
                    "description": "Modes that can be chosen",
                    "entries": entries(choices.map(|(i, m)| (1 << i, m.name, m.name))),
                },
            },
            "event_groups": {
                "default": { "events": { CONDITION_BEGINS.to_string(): {
                    "name": "condition_begins",
                    "message": "{1}",
                    "description": "Watched by the supervisor.",
                    "arguments": [argument("condition_t", "condition")],
                }, CONDITION_ENDS.to_string(): {
                    "name": "condition_ends",
                    "message": "over: {1}",
                    "description": "Watched by the supervisor.",
                    "arguments": [argument("condition_t", "condition")],
                }, MODE_CHANGED.to_string(): {
                    "name": "mode_changed",
                    "message": "{2}: {3}",
                    "description": "From {1}.",
                    "arguments": [
                        argument("mode_t", "from"),
                        argument("mode_t", "to"),
                        argument("cause_t", "cause"),
                    ],
                } } },
                "arming_check": { "events": arming },
                "health": { "events": { HEALTH_SUMMARY.to_string(): {
                    "name": "health_summary",
                    "message": "Health",
                    "type": "summary",
                    "arguments": [
                        argument("uint8_t", "chunk_idx"),
                        argument("health_component_t", "is_present"),
                        argument("health_component_t", "error"),
                        argument("health_component_t", "warning"),
                    ],
                } } },
            },
            "navigation_mode_groups": { "groups": groups },
            "supported_protocols": ["health_and_arming_check"],
        } },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_every_mode_and_every_row_has_its_number() {
        for (n, mode) in Mode::ALL.into_iter().enumerate() {
            assert_eq!(usize::from(mode_number(mode)), n);
        }
        let mut seen = std::collections::BTreeSet::new();
        for row in TABLE {
            seen.insert(cause_number(row.from[0], row.on));
            for from in row.from {
                assert!(std::ptr::eq(&TABLE[usize::from(cause_number(*from, row.on))], row));
            }
        }
        assert_eq!(seen.len(), TABLE.len());
    }

    /// What the parser of libevents asks of the file.
    #[test]
    fn prop_arguments_have_types_that_are_defined() {
        let file = json();
        let component = &file["components"]["1"];
        let enums = component["enums"].as_object().unwrap();
        let mut numbers = std::collections::BTreeSet::new();
        for (_, group) in component["event_groups"].as_object().unwrap() {
            for (number, event) in group["events"].as_object().unwrap() {
                assert!(numbers.insert(number.parse::<u32>().unwrap()));
                for argument in event["arguments"].as_array().unwrap() {
                    let kind = argument["type"].as_str().unwrap();
                    assert!(kind == "uint8_t" || enums.contains_key(kind), "{kind}");
                }
            }
        }
        let first = &enums["health_component_t"]["entries"]["1"]["name"];
        assert_eq!(first, "none");
        assert_eq!(numbers.len(), 5 + AT_REST.len());
    }
}
