//! The flights for the fits as a user flies them in the simulator: printed, flown, fitted.

use std::fs;
use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use super::support::{companion, sim};

const LIMIT: Duration = Duration::from_secs(300);

/// Prints the program, flies it and fits its log: in an empty folder, where a survey was asked for, in the simulator's hall.
fn fitted(folder: &Path, program: &str) -> Value {
    let printed = companion(&["fit", "program", program], folder, LIMIT);
    assert_eq!(printed.code, Some(0), "{program}: {}", printed.text);
    let (said, text) = printed.text.split_at(printed.text.find("# haltere fit program").unwrap());
    assert!(said.contains("no survey here: placed in the hall of `haltere-sim fly`"), "{said}");
    let mission = format!("fly-{program}.toml");
    fs::write(folder.join(&mission), text).unwrap();
    let flown = sim(&["fly", &mission, "--out", "flown"], folder, LIMIT);
    assert_eq!(flown.code, Some(0), "{program}: {}", flown.text);
    let log = format!("flown/fly-{program}-1.mcap");
    let result = companion(&["fit", program, &log, "--json"], folder, LIMIT);
    assert_eq!(result.code, Some(0), "{program}: {}", result.text);
    assert!(!result.text.contains("haltere fit program"), "what was just flown: {}", result.text);
    // The log on standard error stands in the same file, before or after.
    let (begin, end) =
        (result.text.find("\n{").map_or(0, |i| i + 1), result.text.rfind('}').unwrap());
    serde_json::from_str(&result.text[begin..=end])
        .unwrap_or_else(|e| panic!("{e}: {}", result.text))
}

#[test]
fn regress_a_program_that_was_flown_can_be_fitted() {
    let dir = tempfile::tempdir().unwrap();
    let snippet = |program: &str| {
        let fit = fitted(dir.path(), program);
        fit["snippet"].as_str().unwrap_or_default().to_owned()
    };
    // The steps of one axis leaned the other one to its limit, and that was taken for a step of its own; the second
    // axis had three angles only, or so straight a law that nothing was offered.
    let drag = snippet("drag");
    assert!(drag.contains("\npitch = {") && drag.contains("\nroll = {"), "{drag}");
    assert!(snippet("thrust").contains("[control.voltage]"));
    for program in ["ground", "trim", "lag", "imu", "anchors"] {
        fitted(dir.path(), program);
    }
}
