//! The token that lets others look at the watch page: who may read its file is checked before it is used.

use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::PathBuf;

use sha2::{Digest as _, Sha256};
use thiserror::Error;

use haltere_pilot::settings::WatchConfig;

/// Shortest and longest token, bytes.
const TOKEN_BYTES: std::ops::RangeInclusive<usize> = 16..=128;
/// Mode bits that let others than the owner in.
const OTHERS: u32 = 0o077;

/// Why there is no token.
#[derive(Debug, Error)]
pub enum TokenError {
    /// The file cannot be read.
    #[error(
        "{}: cannot be read: {error}; make one with `head -c 18 /dev/urandom | base64 | tr -d '/+' > {}; \
         chmod 600 {}`", path.display(), path.display(), path.display()
    )]
    Io {
        /// Which.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// Others may read it.
    #[error("{}: its mode is {mode:03o}, allowed is 600 or less: others could read the token; `chmod 600 {}`",
        path.display(), path.display())]
    Open {
        /// Which.
        path: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// It holds something else.
    #[error(
        "{}: {bytes} characters, allowed are {} to {} letters, digits, - and _", path.display(),
        TOKEN_BYTES.start(), TOKEN_BYTES.end()
    )]
    NoToken {
        /// Which.
        path: PathBuf,
        /// How many were found.
        bytes: usize,
    },
}

/// What lets others look. Only its digest is held.
#[derive(Clone, PartialEq, Eq)]
pub struct Token([u8; 32]);

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token")
    }
}

impl Token {
    /// Of its text. `None`: too short, too long, or characters that do not pass a URL as they are.
    pub fn new(text: &str) -> Option<Self> {
        let fits = TOKEN_BYTES.contains(&text.len())
            && text.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
        fits.then(|| Self(Sha256::digest(text).into()))
    }

    /// Whether somebody shows the same one. Takes the same time whatever is shown of a given length.
    pub fn is(&self, shown: &str) -> bool {
        let shown: [u8; 32] = Sha256::digest(shown).into();
        // Digests differ in unforeseeable places; no early end here either.
        self.0.iter().zip(shown).fold(0, |differs, (a, b)| differs | (a ^ b)) == 0
    }
}

/// The token, if clients must show one: a file that nobody but its owner may read.
pub fn token(config: &WatchConfig) -> Result<Option<Token>, TokenError> {
    let path = config.token_file.clone();
    if path.as_os_str().is_empty() {
        return Ok(None);
    }
    let io = |error| TokenError::Io { path: path.clone(), error };
    let file = File::open(&path).map_err(io)?;
    // Of the file that was opened: the name may mean another one by now.
    let mode = file.metadata().map_err(io)?.mode();
    if mode & OTHERS != 0 {
        return Err(TokenError::Open { path, mode: mode & 0o777 });
    }
    let mut text = String::new();
    file.take(4096).read_to_string(&mut text).map_err(io)?;
    let text = text.trim();
    let token = Token::new(text);
    token.map(Some).ok_or_else(|| TokenError::NoToken { path, bytes: text.chars().count() })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn prop_a_token_is_private_long_and_known_only_by_itself() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("token");
        let config = WatchConfig { token_file: path.clone(), ..WatchConfig::default() };
        assert!(matches!(token(&config), Err(TokenError::Io { .. })));
        std::fs::write(&path, "0123456789abcdef-_\n").unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o644)).unwrap();
        assert!(matches!(token(&config), Err(TokenError::Open { .. })));
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
        let found = token(&config).unwrap().unwrap();
        assert!(found.is("0123456789abcdef-_"));
        for wrong in ["", "0123456789abcdef-", "0123456789abcdef-_ ", "0123456789abcdef--"] {
            assert!(!found.is(wrong), "{wrong}");
        }
        assert_eq!(format!("{found:?}"), "Token");
        for bad in ["short", "with space in it here", "ümlaut-and-more-of-it"] {
            std::fs::write(&path, bad).unwrap();
            assert!(matches!(token(&config), Err(TokenError::NoToken { .. })), "{bad}");
        }
    }
}
