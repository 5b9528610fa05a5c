//! `[watch]`: the page that shows the flight live, and the token that lets others look.

use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use thiserror::Error;

use super::address::{Address, AddressError};
use crate::checks::Problems;

/// Shortest and longest token, bytes.
const TOKEN_BYTES: std::ops::RangeInclusive<usize> = 16..=128;
/// Mode bits that let others than the owner in.
const OTHERS: u32 = 0o077;
/// Most other sites.
const MOST_ORIGINS: usize = 8;

/// `[watch]`
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WatchConfig {
    /// Where it listens. Off unless named: a flight program listens nowhere that it was not told.
    pub address: WatchAddress,
    /// File of the token, relative to the configuration file that names it. Empty: none.
    pub token_file: PathBuf,
    /// Sites whose pages may connect besides our own, as browsers write `Origin`.
    pub origins: Vec<String>,
}

/// `tcpin:HOST:PORT`, or empty for nowhere.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct WatchAddress(Option<Address>);

impl WatchAddress {
    /// The address, if there is one.
    pub fn get(&self) -> Option<&Address> {
        self.0.as_ref()
    }
}

impl TryFrom<String> for WatchAddress {
    type Error = AddressError;

    fn try_from(text: String) -> Result<Self, AddressError> {
        if text.is_empty() { Ok(Self(None)) } else { text.parse().map(|at| Self(Some(at))) }
    }
}

impl From<WatchAddress> for String {
    fn from(address: WatchAddress) -> String {
        address.0.map_or_else(String::new, |address| address.to_string())
    }
}

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

impl WatchConfig {
    pub(super) fn check(&self, key: &str, problems: &mut Problems) {
        match self.address.get() {
            None | Some(Address::TcpIn(_)) => {}
            Some(other) => {
                problems
                    .say(format!("{key}.address = \"{other}\": allowed tcpin:HOST:PORT, or empty"));
            }
        }
        if self.origins.len() > MOST_ORIGINS {
            let n = self.origins.len();
            problems.say(format!("{key}.origins: {n} sites, allowed {MOST_ORIGINS}"));
        }
        for origin in self.origins.iter().filter(|o| o.is_empty() || *o == "*") {
            problems
                .say(format!("{key}.origins: \"{origin}\", allowed a site as https://example.org"));
        }
    }

    /// The token, if clients must show one.
    pub fn token(&self) -> Result<Option<Token>, TokenError> {
        let path = self.token_file.clone();
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
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn prop_addresses_are_tcpin_or_nothing() {
        let read = |text: &str| toml::from_str::<WatchConfig>(text);
        assert_eq!(read("").unwrap().address.get(), None);
        assert_eq!(read("address = \"\"").unwrap(), WatchConfig::default());
        let on = read("address = \"tcpin:127.0.0.1:8480\"").unwrap();
        assert_eq!(toml::from_str::<WatchConfig>(&toml::to_string(&on).unwrap()).unwrap(), on);
        assert!(read("address = \"http://localhost\"").is_err());
        let mut problems = Problems::new();
        read("address = \"udpin:127.0.0.1:8480\"\norigins = [\"*\"]")
            .unwrap()
            .check("watch", &mut problems);
        assert_eq!(problems.lines().len(), 2, "{problems}");
    }

    #[test]
    fn prop_a_token_is_private_long_and_known_only_by_itself() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("token");
        let config = WatchConfig { token_file: path.clone(), ..WatchConfig::default() };
        assert!(matches!(config.token(), Err(TokenError::Io { .. })));
        std::fs::write(&path, "0123456789abcdef-_\n").unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o644)).unwrap();
        assert!(matches!(config.token(), Err(TokenError::Open { .. })));
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
        let token = config.token().unwrap().unwrap();
        assert!(token.is("0123456789abcdef-_"));
        for wrong in ["", "0123456789abcdef-", "0123456789abcdef-_ ", "0123456789abcdef--"] {
            assert!(!token.is(wrong), "{wrong}");
        }
        assert_eq!(format!("{token:?}"), "Token");
        for bad in ["short", "with space in it here", "ümlaut-and-more-of-it"] {
            std::fs::write(&path, bad).unwrap();
            assert!(matches!(config.token(), Err(TokenError::NoToken { .. })), "{bad}");
        }
    }
}
