//! Hash of the simulator's own source, so that rows of a campaign know the program that flew them.

use std::path::Path;

fn main() -> std::io::Result<()> {
    println!("cargo::rerun-if-changed=src");
    // FNV-1a, 64 bit, over names and contents in order.
    let mut hash = 0xcbf2_9ce4_8422_2325;
    add(Path::new("src"), &mut hash)?;
    println!("cargo::rustc-env=HALTERE_SIM_SOURCE_HASH={hash:016x}");
    Ok(())
}

fn add(path: &Path, hash: &mut u64) -> std::io::Result<()> {
    let mut take = |bytes: &[u8]| {
        for byte in bytes {
            *hash = (*hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    };
    take(path.to_string_lossy().as_bytes());
    if !path.is_dir() {
        take(&std::fs::read(path)?);
        return Ok(());
    }
    let mut inside: Vec<_> =
        std::fs::read_dir(path)?.map(|entry| entry.map(|e| e.path())).collect::<Result<_, _>>()?;
    inside.sort();
    inside.iter().try_for_each(|path| add(path, hash))
}
