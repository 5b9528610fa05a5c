//! A hostile or broken station does not delay the control thread, nor fill the memory.

use std::time::Duration;

use super::lab;
use super::support::in_real_time;

#[test]
fn prop_a_flood_delays_no_control_step_and_fills_no_memory() {
    in_real_time("flood", flood);
}

fn flood() {
    let folder = tempfile::tempdir().expect("a folder");
    let ended =
        lab(&["flood", "--seconds", "6", "--json"], folder.path(), Duration::from_secs(120));
    assert_eq!(ended.code, Some(0), "{}", ended.text);
    let start = ended.text.find("\n{").map_or(0, |at| at + 1);
    let json: serde_json::Value = serde_json::Deserializer::from_str(&ended.text[start..])
        .into_iter()
        .next()
        .unwrap()
        .unwrap();
    assert_eq!(json["landed"], true, "{json}");
    let drops = json["drops"].as_object().expect("reasons");
    for reason in ["rate_limited", "mav_garbage_byte", "mav_bad_checksum", "stations_full"] {
        assert!(drops.contains_key(reason), "{reason} is not counted: {json}");
    }
}
