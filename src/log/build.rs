//! Compiles the log's message types and stamps the build with its identity.

#[path = "build/source_hash.rs"]
mod source_hash;

use std::error::Error;
use std::path::PathBuf;
use std::process::Command;

use prost::Message as _;

use source_hash::source_hash;

const PROTO: &str = "record/haltere.proto";

/// What decides which bytes the companion makes of its input: a log that another build of these wrote is replayed within a
/// tolerance only.
const REPLAY: [&str; 7] = [
    "Cargo.lock",
    "dialect/build.rs",
    "dialect/src",
    "dialect/xml",
    "src/core",
    "src/log",
    "src/pilot",
];

fn main() -> Result<(), Box<dyn Error>> {
    let out_dir = PathBuf::from(std::env::var("OUT_DIR")?);
    let files = protox::compile([PROTO], ["record"])?;
    std::fs::write(out_dir.join("haltere_descriptors.bin"), files.encode_to_vec())?;
    let mut config = prost_build::Config::new();
    config.type_attribute(".", "#[allow(missing_docs)]");
    config.compile_fds(files)?;

    let hash = source_hash("../..", &REPLAY)?;
    println!("cargo::rustc-env=HALTERE_REPLAY_HASH={hash:016x}");
    println!("cargo::rustc-env=HALTERE_TARGET={}", std::env::var("TARGET")?);
    println!(
        "cargo::rustc-env=HALTERE_PROFILE={}-O{}",
        std::env::var("PROFILE")?,
        std::env::var("OPT_LEVEL")?
    );
    println!("cargo::rustc-env=HALTERE_RUSTC={}", first_line(&std::env::var("RUSTC")?, &["-V"]));
    let commit = first_line("git", &["describe", "--always", "--dirty", "--abbrev=12"]);
    println!("cargo::rustc-env=HALTERE_GIT_COMMIT={commit}");
    Ok(())
}

/// First line that a command prints; empty when it cannot be run, so that a source archive builds.
fn first_line(program: &str, arguments: &[&str]) -> String {
    Command::new(program)
        .args(arguments)
        .output()
        .ok()
        .filter(|output| output.status.success())
        .and_then(|output| String::from_utf8(output.stdout).ok())
        .and_then(|text| text.lines().next().map(str::to_owned))
        .unwrap_or_default()
}
