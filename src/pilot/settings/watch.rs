//! `[watch]`: the page that shows the flight live, and where the token lies that lets others look.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::address::{Address, AddressError};
use haltere_core::checks::Problems;

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

/// An address `tcpin:HOST:PORT`; where none is named the page listens nowhere.
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
}

#[cfg(test)]
mod tests {
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
}
