//! Hash of what simulated flights are made of here, so that rows of a campaign know the program that flew them.

#[path = "src/log/build/source_hash.rs"]
mod source_hash;

use source_hash::source_hash;

fn main() -> std::io::Result<()> {
    let hash = source_hash(".", &["src/simulated", "sim/scenarios"])?;
    println!("cargo::rustc-env=HALTERE_SIMULATED_HASH={hash:016x}");
    Ok(())
}
