//! Killed in flight or disturbed otherwise, and flown for a while: short forms of `haltere-lab kills` and `soak`.

use std::time::Duration;

use super::lab;
use super::support::in_real_time;

fn json_of(text: &str) -> serde_json::Value {
    let start = text.find("\n{").map_or(0, |at| at + 1);
    let mut values = serde_json::Deserializer::from_str(&text[start..]).into_iter();
    values.next().expect("a result").expect("JSON")
}

#[test]
fn prop_a_killed_companion_takes_nothing_over() {
    in_real_time("kills", kills);
}

fn kills() {
    let folder = tempfile::tempdir().expect("a folder");
    let args = ["kills", "--count", "2", "--jobs", "2", "--json"];
    let ended = lab(&args, folder.path(), Duration::from_secs(200));
    let json = json_of(&ended.text);
    assert_eq!(ended.code, Some(0), "{json:#}");
    assert_eq!((&json["landed"], &json["recaptured"]), (&2.into(), &0.into()), "{json:#}");
    assert_eq!(json["arm_again"], 2, "{json:#}");
}

#[test]
fn regress_signals_and_output_end_no_flight() {
    in_real_time("kinds", kinds);
}

fn kinds() {
    let folder = tempfile::tempdir().expect("a folder");
    let kinds = ["hang-up", "terminate", "output-blocked", "output-closed"];
    let chosen = kinds.iter().flat_map(|kind| ["--kind", *kind]);
    let args = ["kills", "--phase", "hover", "--count", "1", "--jobs", "4", "--json"];
    let args: Vec<&str> = args.into_iter().chain(chosen).collect();
    let ended = lab(&args, folder.path(), Duration::from_secs(200));
    let json = json_of(&ended.text);
    assert_eq!(ended.code, Some(0), "{json:#}");
    assert_eq!((&json["landed"], &json["hard"]), (&4.into(), &0.into()), "{json:#}");
}

#[test]
fn prop_a_soak_sees_setpoints_latency_and_memory() {
    in_real_time("soak", soak);
}

fn soak() {
    let folder = tempfile::tempdir().expect("a folder");
    // How regular they are is a matter of the machine; that they are seen is not.
    let args = ["soak", "--minutes", "0.3", "--longest-gap-ms", "1000", "--json"];
    let ended = lab(&args, folder.path(), Duration::from_secs(120));
    let json = json_of(&ended.text);
    assert_eq!((&json["flights"], &json["missed"]), (&1.into(), &0.into()), "{json:#}");
    let count = |key: &str, of: &str| json[key][of].as_u64().unwrap_or(0);
    assert!(json["setpoints"].as_u64() > Some(1000), "{json:#}");
    assert!(
        count("latency_ms", "count") > 1000 && count("lateness_ms", "steps") > 1000,
        "{json:#}"
    );
    assert!(json["latency_ms"]["median"].as_f64().is_some_and(|ms| ms > 0.1), "{json:#}");
    assert!(count("memory_kB", "most") > 1000, "{json:#}");
}
