//! Tests of the laboratory's commands as processes. What they measure are the programs of `haltere-sim`, which lie beside the
//! laboratory's own.

mod endurance;
mod flood;
mod own_truth;
#[path = "../process/support.rs"]
#[expect(dead_code, reason = "shared with the tests of the other programs")]
mod support;

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use support::{Ended, finish};

/// Runs the laboratory to its end.
fn lab(args: &[&str], folder: &Path, limit: Duration) -> Ended {
    let mut command = Command::new(env!("CARGO_BIN_EXE_haltere-lab"));
    command.args(args).current_dir(folder);
    finish(command, folder, limit)
}
