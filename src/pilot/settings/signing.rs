//! `[signing]`: the key of MAVLink signatures, and what each link demands of them.

use std::path::PathBuf;

use super::{Config, TagPort};
use crate::config::TagProtocol;
use crate::stations::guard::{DoorConfig, KeySetup, Signing};
use haltere_core::checks::Problems;
use haltere_dialect::mav_stream;

/// Component that we are to the board: `MAV_COMP_ID_ONBOARD_COMPUTER`.
const TO_BOARD: u8 = 191;

haltere_core::keys! {
    /// `[signing]`
    pub struct SigningConfig {
        /// File with the key, relative to this file: 32 bytes or 64 hexadecimal digits, mode 600. `haltere key FILE`
        /// makes one. Beside it, as FILE.time, the time is kept behind which signatures never go back. "": no key.
        // The exception that the MAVLink guide names: radios make this message themselves.
        key_file: PathBuf = PathBuf::new();
        /// Who may change the key with SETUP_SIGNING: "never" (nobody), "signed" (who signs with the key in force).
        setup: KeySetup = KeySetup::Signed;
        /// Messages that come in unsigned where signatures are demanded: radios make this one themselves.
        // The exception that the MAVLink guide names.
        unsigned: Vec<String> = vec!["RADIO_STATUS".to_owned()];
    }
}

impl SigningConfig {
    fn has_file(&self) -> bool {
        !self.key_file.as_os_str().is_empty()
    }

    fn ids(&self) -> Vec<u32> {
        self.unsigned.iter().filter_map(|name| id_of(name)).collect()
    }
}

fn id_of(name: &str) -> Option<u32> {
    mav_stream::id_of_name(name)
}

/// The doors of all links. `None`: bytes pass as they come.
#[derive(Debug, Clone, PartialEq)]
pub struct Doors {
    /// To the tag.
    pub tag: Option<DoorConfig>,
    /// To the board.
    pub board: Option<DoorConfig>,
    /// To each ground endpoint: always there, since each may send us a key, or too much.
    pub ground: Vec<DoorConfig>,
}

impl Config {
    /// The doors of all links.
    pub fn doors(&self) -> Doors {
        let unsigned: std::sync::Arc<[u32]> = self.signing.ids().into();
        let door = |signing, setup, rate, own| {
            let unsigned = unsigned.clone();
            DoorConfig { signing, setup, commanders: None, unsigned, rate, own }
        };
        let device = |signing: Signing, component| {
            let shut = signing != Signing::Off;
            shut.then(|| door(signing, KeySetup::Never, None, (None, component)))
        };
        let ground = self.ground.endpoints.iter().map(|endpoint| {
            let setup = if endpoint.trusted { KeySetup::Anybody } else { self.signing.setup };
            let signing = self.ground.signing_of(endpoint);
            let commanders = endpoint.commanders.unwrap_or(self.ground.commanders).listed();
            let rate = Some(self.ground.rate());
            DoorConfig {
                commanders: commanders.map(Into::into),
                ..door(signing, setup, rate, (Some(self.ground.system_id), 1))
            }
        });
        Doors {
            tag: device(self.tag.signing, 0),
            board: device(self.board.signing, TO_BOARD),
            ground: ground.collect(),
        }
    }

    /// Whether a link looks at signatures, or could be told a key.
    pub fn needs_key(&self) -> bool {
        let Doors { tag, board, ground } = self.doors();
        tag.is_some() || board.is_some() || ground.iter().any(|d| d.signing != Signing::Off)
    }

    /// Whether a key may come over a cable, so that we may start without one.
    pub fn may_be_given_key(&self) -> bool {
        self.ground.endpoints.iter().any(|endpoint| endpoint.trusted)
    }

    pub(super) fn check_signing(&self, problems: &mut Problems) {
        if self.signing.setup == KeySetup::Anybody {
            problems.say(
                "signing.setup = \"anybody\": allowed are \"never\" and \"signed\"; to take a key \
                 unsigned over a cable, mark that endpoint with trusted = true",
            );
        }
        for name in self.signing.unsigned.iter().filter(|name| id_of(name).is_none()) {
            problems.say(format!(
                "signing.unsigned: {name:?} is no MAVLink message that we know; write names as in \
                 RADIO_STATUS"
            ));
        }
        if (self.needs_key() || self.may_be_given_key()) && !self.signing.has_file() {
            problems.say(
                "signing.key_file = \"\": a link signs or may be told a key, so name the file that \
                 holds it; `haltere key FILE` makes one",
            );
        }
        if self.tag.signing != Signing::Off
            && (self.tag.protocol != TagProtocol::Mavlink || self.tag.port == TagPort::Auto)
        {
            problems.say(format!(
                "tag.signing = {:?}: only a tag with tag.protocol = \"mavlink\" can sign",
                self.tag.signing
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(text: &str) -> (Config, String) {
        let config = Config::from_toml("test", text).unwrap_or_else(|p| panic!("{p}"));
        let mut problems = Problems::new();
        config.check_signing(&mut problems);
        (config, problems.to_string())
    }

    #[test]
    fn prop_policies_reach_their_doors() {
        let (config, problems) = config(
            r#"
            [signing]
            key_file = "signing.key"
            [board]
            signing = "accept"
            [ground]
            signing = "require"
            most_frames_per_s = 100
            endpoints = ["udpin:0.0.0.0:1", { address = "serial:/dev/x:57600", trusted = true },
                         { address = "udpin:127.0.0.1:2", signing = "off" }]
            "#,
        );
        assert_eq!(problems, "");
        let doors = config.doors();
        assert_eq!(doors.tag, None);
        assert_eq!(doors.board.map(|d| (d.signing, d.own)), Some((Signing::Accept, (None, 191))));
        let told: Vec<_> = doors.ground.iter().map(|d| (d.signing, d.setup)).collect();
        assert_eq!(
            told,
            [
                (Signing::Require, KeySetup::Signed),
                (Signing::Require, KeySetup::Anybody),
                (Signing::Off, KeySetup::Signed)
            ]
        );
        assert_eq!(*doors.ground[0].unsigned, [109]);
        assert_eq!(doors.ground[2].rate.map(|r| r.frames_per_s), Some(100.0));
        assert!(config.needs_key() && config.may_be_given_key());
        let signs: Vec<_> = config.ground.for_pilot().iter().map(|e| e.signs).collect();
        assert_eq!(signs, [true, true, false]);
    }

    #[test]
    fn prop_what_cannot_work_is_refused_with_a_way_out() {
        for (text, says) in [
            ("[ground]\nsigning = \"require\"", "`haltere key FILE` makes one"),
            ("[signing]\nsetup = \"anybody\"", "trusted = true"),
            ("[signing]\nunsigned = [\"RADIO\"]", "\"RADIO\" is no MAVLink message"),
            (
                "[signing]\nkey_file = \"k\"\n[tag]\nsigning = \"accept\"",
                "only a tag with tag.protocol = \"mavlink\"",
            ),
        ] {
            let (_, problems) = config(text);
            assert!(problems.contains(says), "{text}: {problems}");
        }
        assert_eq!(config("").1, "");
    }
}
