//! `[watch]`: the page that shows the flight live, and where the token lies that lets others look.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::address::{Address, AddressError};
use haltere_core::checks::Problems;
use haltere_core::keys::NoNumber;

/// Most other sites.
const MOST_ORIGINS: usize = 8;

haltere_core::keys! {
    /// `[watch]`
    pub struct WatchConfig {
        /// Where a page shows the flight live, and viewers of the Foxglove kind find the same data:
        /// "tcpin:127.0.0.1:8480" for browsers on this computer, "tcpin:0.0.0.0:8480" for a phone beside the flight
        /// room, which needs a token. Empty: nowhere. docs/WATCH.md.
        // Off unless named: a flight program listens nowhere that it was not told.
        address: WatchAddress = WatchAddress::default();
        /// File with the token that clients must show: at least 16 letters and digits, readable by the owner alone
        /// (`head -c 18 /dev/urandom | base64 | tr -d '/+' > FILE; chmod 600 FILE`). Empty: no token, and only this
        /// computer may look.
        token_file: PathBuf = PathBuf::new();
        /// Pages of other sites that may connect besides our own, for example "https://app.foxglove.dev".
        origins: Vec<String> = Vec::new();
    } rules addresses;
}

/// An address `tcpin:HOST:PORT`; where none is named the page listens nowhere.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct WatchAddress(Option<Address>);

impl NoNumber for WatchAddress {}

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
    fn addresses(&self, key: &str, problems: &mut Problems) {
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
