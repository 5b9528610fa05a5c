//! Every kept input of the fuzzers through its target, without a fuzzer: what was found once stays found.

#[path = "../fuzz/src/targets/mod.rs"]
mod targets;

#[path = "corpus/logs.rs"]
mod logs;
#[path = "corpus/recordings.rs"]
mod recordings;
#[path = "corpus/seed.rs"]
mod seed;

use std::path::Path;

use haltere_log::record::{Flights, LogReader};

/// Most bytes of all kept inputs, and of one: they are in every clone.
const MOST_KEPT_B: u64 = 2_000_000;
const MOST_INPUT_B: u64 = 64_000;

fn main_folder() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/fuzz/corpus"))
}

fn inputs(target: &str) -> Vec<std::path::PathBuf> {
    let folder = main_folder().join(target);
    let entries =
        std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut files: Vec<_> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
    files.sort();
    files
}

/// `HALTERE_REWRITE_GOLDENS` writes the first inputs anew; `fuzz/run --merge` adds to them.
#[test]
fn golden_first_inputs() {
    if std::env::var_os("HALTERE_REWRITE_GOLDENS").is_some() {
        seed::write().expect("the corpus can be written");
    }
}

#[test]
fn regress_every_kept_input_is_harmless() {
    let mut total = 0;
    for (name, target) in targets::ALL {
        let files = inputs(name);
        assert!(!files.is_empty(), "{name}: no inputs are kept; fuzz/run makes them");
        for file in files {
            let bytes = std::fs::read(&file).expect("a readable file");
            assert!(
                bytes.len() as u64 <= MOST_INPUT_B,
                "{}: {} bytes",
                file.display(),
                bytes.len()
            );
            total += bytes.len() as u64;
            // Its name stands in the output of a failure.
            println!("{}", file.display());
            target(&bytes);
        }
    }
    assert!(total <= MOST_KEPT_B, "{total} bytes are kept, allowed {MOST_KEPT_B}");
}

/// Logs whose records claim anything: what the fuzzer of logs takes long to find its way to.
#[test]
fn prop_no_claim_of_a_log_is_too_much() {
    for seed in 0..400 {
        println!("mixed {seed}");
        targets::log(&logs::any(seed, 40, None, false));
    }
    for kind in 0..logs::KINDS {
        println!("many of kind {kind}");
        targets::log(&logs::any(kind as u64, 60, Some(kind), false));
        targets::log(&logs::any(kind as u64, 3000, Some(kind), true));
    }
}

/// An index that names one message any number of times would have it in memory as often.
#[test]
fn regress_no_claim_of_a_tail_is_too_much() {
    let log = logs::flights();
    let reader = LogReader::from_bytes("flights.mcap".into(), log.clone()).expect("a log");
    assert!(reader.outline().is_some(), "its tail tells");
    assert!(Flights::recorded(&reader).part(&reader, Some(2)).is_ok(), "two flights");
    for at in 0..log.len() {
        for bits in [0x01, 0xff] {
            let mut claims = log.clone();
            claims[at] ^= bits;
            targets::outline(&claims);
        }
    }
}

/// The same of recordings of others. A stamp that claimed another year filled the memory with a grid up to it.
#[test]
fn regress_no_claim_of_a_recording_is_too_much() {
    for seed in 0..30 {
        for (rows, step_s) in [(3, 4.0), (40, 1.5), (200, 0.5), (600, 0.01)] {
            println!("{seed}: {rows} rows, {step_s} s apart");
            recordings::through(&recordings::ours(seed, rows, step_s, true));
        }
    }
    recordings::through(&recordings::ours(1, 3000, 0.01, false));
}

#[test]
fn prop_every_target_can_be_run_and_every_folder_has_a_target() {
    let manifest = include_str!("../fuzz/Cargo.toml");
    for (name, _) in targets::ALL {
        assert!(manifest.contains(&format!("path = \"fuzz_targets/{name}.rs\"")), "{name}");
    }
    for entry in std::fs::read_dir(main_folder()).expect("the corpus") {
        let name = entry.expect("a readable folder").file_name();
        let known = targets::ALL.iter().any(|(target, _)| name == *target);
        assert!(known, "{} belongs to no target", name.display());
    }
}
