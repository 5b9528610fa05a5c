//! Stamps the build with what a bank of simulated flights hangs on.

#[path = "../log/build/source_hash.rs"]
mod source_hash;

use source_hash::source_hash;

/// What decides how a simulated flight goes and what is said of a flight: a bank that another build of these flew is flown
/// anew. The words and pages of the program are not among them.
const BANK: [&str; 8] = [
    "Cargo.lock",
    "dialect/build.rs",
    "dialect/src",
    "dialect/xml",
    "src/core",
    "src/gap",
    "src/model",
    "src/pilot",
];

fn main() -> std::io::Result<()> {
    let hash = source_hash("../..", &BANK)?;
    println!("cargo::rustc-env=HALTERE_BANK_HASH={hash:016x}");
    Ok(())
}
