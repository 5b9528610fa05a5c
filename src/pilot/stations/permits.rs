//! Who may command: systems that are not among the commanders of their endpoint may look.
//!
//! What only looks is said by the rows of messages and commands (`schedule/said`, `schedule/ordered`).
//!
//! A system id is no proof of anything: who can send can send any. Together with signatures it is a rule
//! among those who hold the key; without them, an order among people of good will.

use std::fmt;
use std::str::FromStr;

use serde::de::{Error as _, SeqAccess, Visitor};
use serde::ser::SerializeSeq as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use haltere_core::keys::NoNumber;
use haltere_core::time::HostTime;

use super::Stations;
use crate::input::LinkId;
use crate::out::Out;
use crate::out::voice::Severity;

/// People are told again that somebody was refused after this time, s.
const TELL_AGAIN_S: f64 = 10.0;

/// Systems that may command: a set of MAVLink system ids.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Commanders([u64; 4]);

impl NoNumber for Commanders {}

impl Default for Commanders {
    /// Everybody.
    fn default() -> Self {
        Self([u64::MAX; 4])
    }
}

impl Commanders {
    /// Whether this system is among them.
    pub fn contains(&self, system_id: u8) -> bool {
        let [slot, bit] = [system_id / 64, system_id % 64];
        self.0.get(usize::from(slot)).is_some_and(|word| word & (1 << bit) != 0)
    }

    /// The ids. `None`: all there are.
    pub fn listed(&self) -> Option<Vec<u8>> {
        (*self != Self::default()).then(|| self.ids().collect())
    }

    fn insert(&mut self, system_id: u8) {
        let [slot, bit] = [system_id / 64, system_id % 64];
        if let Some(word) = self.0.get_mut(usize::from(slot)) {
            *word |= 1 << bit;
        }
    }

    fn ids(&self) -> impl Iterator<Item = u8> + '_ {
        (0..=u8::MAX).filter(|id| self.contains(*id))
    }
}

impl FromIterator<u8> for Commanders {
    fn from_iter<I: IntoIterator<Item = u8>>(ids: I) -> Self {
        let mut all = Self([0; 4]);
        ids.into_iter().for_each(|id| all.insert(id));
        all
    }
}

impl fmt::Display for Commanders {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::default() {
            return f.write_str("all");
        }
        f.debug_list().entries(self.ids()).finish()
    }
}

impl fmt::Debug for Commanders {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

impl FromStr for Commanders {
    type Err = String;

    /// `all`, or ids between commas, in brackets or not.
    fn from_str(text: &str) -> Result<Self, String> {
        if text == "all" {
            return Ok(Self::default());
        }
        let list = text.trim();
        let list = list.strip_prefix('[').and_then(|t| t.strip_suffix(']')).unwrap_or(list);
        let ids = list.split(',').map(str::trim).filter(|id| !id.is_empty());
        ids.map(|id| {
            id.parse::<u8>()
                .map_err(|_| format!("{id:?}: write \"all\" or a list of system ids, 0 to 255"))
        })
        .collect()
    }
}

impl Serialize for Commanders {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if *self == Self::default() {
            return serializer.serialize_str("all");
        }
        let mut list = serializer.serialize_seq(None)?;
        for id in self.ids() {
            list.serialize_element(&id)?;
        }
        list.end()
    }
}

impl<'de> Deserialize<'de> for Commanders {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = Commanders;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"all\" or a list of system ids, 0 to 255")
            }

            fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Commanders, E> {
                text.parse().map_err(E::custom)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Commanders, A::Error> {
                let mut ids = Vec::new();
                while let Some(id) = list.next_element::<i64>()? {
                    let id = u8::try_from(id).map_err(|_| {
                        A::Error::custom(format!("system id {id}, allowed 0 to 255"))
                    })?;
                    ids.push(id);
                }
                Ok(ids.into_iter().collect())
            }
        }
        deserializer.deserialize_any(Either)
    }
}

impl Stations {
    /// Whether a system may say something to us, or through us to the board. `looks`: it changes nothing.
    pub(crate) fn may_say(&self, link: LinkId, system_id: u8, looks: bool) -> bool {
        looks || self.endpoint_on(link).commanders.contains(system_id)
    }

    /// Somebody who may only look has asked for more, and was answered.
    pub(crate) fn note_refused(
        &self,
        at: HostTime,
        (link, peer): (LinkId, (u8, u8)),
        target: (u8, u8),
        out: &mut Out,
    ) {
        // What is for everyone may be chatter of other vehicles.
        let meant = target.0 == out.own.system_id;
        let told = out.told.refused_at.is_some_and(|t| at.seconds_since(t) < TELL_AGAIN_S);
        if meant && !told {
            out.told.refused_at = Some(at);
            let commanders = self.endpoint_on(link).commanders;
            let text = format!(
                "system {} on link {} may look, not command: ground.commanders = {commanders}",
                peer.0,
                link.number()
            );
            out.say(at, Severity::Warning, text);
        }
    }
}

#[cfg(test)]
mod tests;
