//! Hash of the simulator's own source, so that rows of a campaign know the program that flew them.

#[path = "../src/log/build/source_hash.rs"]
mod source_hash;

use source_hash::source_hash;

fn main() -> std::io::Result<()> {
    let hash = source_hash("..", &["sim/src"])?;
    println!("cargo::rustc-env=HALTERE_SIM_SOURCE_HASH={hash:016x}");
    Ok(())
}
