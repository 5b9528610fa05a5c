//! Files that nobody misses: what another program or the board would tell again, kept for the next start behind a digest.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read as _};
use std::path::{Path, PathBuf};

use haltere_log::written;
use sha2::{Digest as _, Sha256};

const DIGEST_BYTES: usize = 32;
/// Longest file.
const MOST_BYTES: u64 = 1 << 20;

/// Folder of the companion in the cache of its service, or of the user; `None`: there is none.
pub fn folder() -> Option<PathBuf> {
    let of = |name: &str| std::env::var_os(name).filter(|path| !path.is_empty()).map(PathBuf::from);
    let home = || of("HOME").map(|home| home.join(".cache"));
    of("CACHE_DIRECTORY").or_else(|| Some(of("XDG_CACHE_HOME").or_else(home)?.join("haltere")))
}

/// Keeps it.
pub fn keep(path: &Path, content: &[u8]) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    let none: [&Path; 0] = [];
    let digest = Sha256::digest(content);
    written::write(path, [&digest[..], content].concat(), &none).map_err(io::Error::other)
}

/// What was kept; `None`: nothing was. An error where it is broken, or another's.
pub fn kept(path: &Path) -> io::Result<Option<Vec<u8>>> {
    let file = match File::open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        opened => opened?,
    };
    let mut bytes = Vec::new();
    file.take(MOST_BYTES).read_to_end(&mut bytes)?;
    let whole = bytes.split_at_checked(DIGEST_BYTES);
    let whole = whole.filter(|(digest, content)| *digest == &Sha256::digest(content)[..]);
    whole.map(|(_, content)| Some(content.to_vec())).ok_or(ErrorKind::InvalidData.into())
}
