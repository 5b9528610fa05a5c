//! A hash of source files, for build scripts: tells two trees apart, nothing more.

use std::path::Path;

/// FNV-1a, 64 bits, over names and contents in order; `sources` are paths from the root of the repository, which lies at
/// `root` as seen from the package. The script runs again when one of them changes.
pub fn source_hash(root: &str, sources: &[&str]) -> std::io::Result<u64> {
    let mut hash = 0xcbf2_9ce4_8422_2325;
    for source in sources {
        println!("cargo::rerun-if-changed={root}/{source}");
        if !Path::new(root).join(source).exists() {
            let why = format!("{source} is no more: name what stands in its place");
            return Err(std::io::Error::other(why));
        }
        add_tree(Path::new(root), source, &mut hash)?;
    }
    Ok(hash)
}

fn add_tree(root: &Path, path: &str, hash: &mut u64) -> std::io::Result<()> {
    let at = root.join(path);
    if at.is_dir() {
        let mut names: Vec<_> =
            std::fs::read_dir(at)?.map(|e| e.map(|e| e.file_name())).collect::<Result<_, _>>()?;
        names.sort();
        return names.iter().try_for_each(|name| {
            add_tree(root, &format!("{path}/{}", name.to_string_lossy()), hash)
        });
    }
    for byte in path.bytes().chain(std::fs::read(at)?) {
        *hash = (*hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    }
    Ok(())
}
