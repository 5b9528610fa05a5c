//! The file of the signing key: who may read it is checked before it is used.
//!
//! ```text
//! signing.key        the key: 32 bytes, or 64 hexadecimal digits
//! signing.key.time   the time behind which our signatures never go back, in 10 µs since 2015
//! ```

use std::fs;
use std::io::{ErrorKind, Read as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use haltere_dialect::signing::{LAST_TIMESTAMP, SigningKey};
use thiserror::Error;

/// Mode bits that let others than the owner in.
const OTHERS: u32 = 0o077;
/// A key file is shorter than this, bytes.
const MOST_BYTES: u64 = 1024;

/// Why a key file is not used.
#[derive(Debug, Error)]
pub enum KeyFileError {
    /// It is not there.
    #[error("{}: there is no such file; `haltere key {}` makes one", path.display(), path.display())]
    Missing {
        /// Which.
        path: PathBuf,
    },
    /// The system does not let us.
    #[error("{}: cannot be read: {error}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// Others may read it.
    #[error(
        "{}: its mode is {mode:03o}, allowed is 600 or less: others could read the key; `chmod 600 {}`, \
         and make a new key if others have been here", path.display(), path.display()
    )]
    Open {
        /// Which.
        path: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// It belongs to somebody else.
    #[error(
        "{}: it belongs to user {owner}, and we are user {us}; `chown {us} {}`", path.display(),
        path.display()
    )]
    Owner {
        /// Which.
        path: PathBuf,
        /// Whose.
        owner: u32,
        /// Who we are.
        us: u32,
    },
    /// It holds something else.
    #[error(
        "{}: {bytes} bytes that are no key, allowed are 32 bytes or 64 hexadecimal digits, not all zero; \
         `haltere key FILE` makes one", path.display()
    )]
    NoKey {
        /// Which.
        path: PathBuf,
        /// How long.
        bytes: usize,
    },
}

/// Reads a key that nobody else can read.
pub fn read_key(path: &Path) -> Result<SigningKey, KeyFileError> {
    let path = path.to_owned();
    let io = |error: std::io::Error| match error.kind() {
        ErrorKind::NotFound => KeyFileError::Missing { path: path.clone() },
        _ => KeyFileError::Io { path: path.clone(), error },
    };
    let file = haltere_log::intake::open(&path).map_err(io)?;
    // Of the file that was opened: the name may mean another one by now.
    let meta = file.metadata().map_err(io)?;
    let (owner, us) = (meta.uid(), rustix::process::geteuid().as_raw());
    if owner != us {
        return Err(KeyFileError::Owner { path, owner, us });
    }
    if meta.mode() & OTHERS != 0 {
        return Err(KeyFileError::Open { path, mode: meta.mode() & 0o777 });
    }
    let mut content = Vec::new();
    file.take(MOST_BYTES).read_to_end(&mut content).map_err(io)?;
    let bytes = content.len();
    SigningKey::from_file(&content).ok_or(KeyFileError::NoKey { path, bytes })
}

/// Where the time is kept that belongs to a key file.
pub fn time_file(key_file: &Path) -> PathBuf {
    let mut name = key_file.as_os_str().to_owned();
    name.push(".time");
    name.into()
}

/// The time behind which we must not go back. The error is for people: with it the clock alone counts.
pub fn read_time(key_file: &Path) -> Result<u64, String> {
    let path = time_file(key_file);
    let name = path.display();
    match fs::read_to_string(&path) {
        Ok(text) => match text.trim().parse::<u64>() {
            Ok(time) if time <= LAST_TIMESTAMP => Ok(time),
            _ => Err(format!(
                "{name}: {text:?} is no time, allowed 0 to {LAST_TIMESTAMP}; what was signed before \
                 could be taken for new if the clock is wrong"
            )),
        },
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(0),
        Err(error) => Err(format!("{name}: cannot be read: {error}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    fn file(folder: &Path, content: &[u8], mode: u32) -> PathBuf {
        let path = folder.join("key");
        let _ = fs::remove_file(&path);
        fs::write(&path, content).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
        path
    }

    #[test]
    fn prop_only_a_private_key_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let key = SigningKey::new([5; 32]).unwrap();
        for mode in [0o600, 0o400] {
            assert_eq!(read_key(&file(folder.path(), &[5; 32], mode)).unwrap(), key);
        }
        let digits = key.to_file();
        assert_eq!(read_key(&file(folder.path(), digits.as_bytes(), 0o600)).unwrap(), key);
        for mode in [0o644, 0o640, 0o660, 0o602, 0o601] {
            let error = read_key(&file(folder.path(), &[5; 32], mode)).unwrap_err().to_string();
            assert!(error.contains(&format!("its mode is {mode:o}")), "{error}");
            assert!(error.contains("chmod 600"), "{error}");
        }
        for content in [&b""[..], &[5; 31], &[0; 32], &[7; 4000]] {
            let error = read_key(&file(folder.path(), content, 0o600)).unwrap_err().to_string();
            assert!(error.contains("that are no key"), "{error}");
        }
        let error = read_key(&folder.path().join("none")).unwrap_err().to_string();
        assert!(error.contains("`haltere key"), "{error}");
    }

    #[test]
    fn prop_the_time_is_read_or_people_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let key = folder.path().join("key");
        assert_eq!(read_time(&key), Ok(0));
        fs::write(time_file(&key), "123456789\n").unwrap();
        assert_eq!(read_time(&key), Ok(123_456_789));
        for bad in ["", "-1", "yesterday", "18446744073709551615"] {
            fs::write(time_file(&key), bad).unwrap();
            assert!(read_time(&key).unwrap_err().contains("key.time"));
        }
    }
}
