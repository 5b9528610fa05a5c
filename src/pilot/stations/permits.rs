//! Who may command: systems that are not among the commanders of their endpoint may look.
//!
//! Looking is a list, and everything else needs a permit: a message that nobody thought of is refused.
//! A refusal is answered in the words of its protocol, so that no client waits.
//!
//! A system id is no proof of anything: who can send can send any. Together with signatures it is a rule
//! among those who hold the key; without them, an order among people of good will.

use std::fmt;
use std::str::FromStr;

use haltere_dialect::mav::haltere::{
    COMMAND_ACK_DATA, MavCmd, MavFtpErr, MavFtpOpcode, MavMessage, MavMissionResult, MavParamError,
    MavResult, PARAM_ERROR_DATA, PARAM_EXT_ACK_DATA, PARAM_REQUEST_READ_DATA, ParamAck,
};
use haltere_dialect::mav::known;
use haltere_dialect::mav_stream;
use serde::de::{Error as _, SeqAccess, Visitor};
use serde::ser::SerializeSeq as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use super::Stations;
use super::mission_transfer::ack;
use super::services::ftp_wire::Packet;
use crate::Pilot;
use crate::input::LinkId;
use crate::out::voice::Severity;

/// People are told again that somebody was refused after this time, s.
const TELL_AGAIN_S: f64 = 10.0;
/// PREFLIGHT_STORAGE, param1: reset. Its other actions change nothing here.
const STORAGE_RESET: f32 = 2.0;
/// Name of the parameter whose setting means "spare me the list".
const HASH_NAME: &[u8] = b"_HASH_CHECK";

/// Systems that may command: a set of MAVLink system ids.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Commanders([u64; 4]);

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

/// Commands that only ask.
fn asks(command: u16, param1: f32) -> bool {
    let Some(command) = known(command) else { return false };
    match command {
        MavCmd::MAV_CMD_REQUEST_MESSAGE
        | MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL
        | MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL
        | MavCmd::MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES
        | MavCmd::MAV_CMD_REQUEST_PROTOCOL_VERSION
        | MavCmd::MAV_CMD_GET_HOME_POSITION => true,
        MavCmd::MAV_CMD_PREFLIGHT_STORAGE => param1 != STORAGE_RESET,
        // Names of programs.
        MavCmd::MAV_CMD_USER_4 => param1 == 0.0,
        _ => false,
    }
}

/// FTP requests that change nothing on the disk.
fn reads(opcode: u8) -> bool {
    use MavFtpOpcode as O;
    [
        O::MAV_FTP_OPCODE_NONE,
        O::MAV_FTP_OPCODE_TERMINATESESSION,
        O::MAV_FTP_OPCODE_RESETSESSION,
        O::MAV_FTP_OPCODE_LISTDIRECTORY,
        O::MAV_FTP_OPCODE_OPENFILERO,
        O::MAV_FTP_OPCODE_READFILE,
        O::MAV_FTP_OPCODE_CALCFILECRC,
        O::MAV_FTP_OPCODE_BURSTREADFILE,
    ]
    .into_iter()
    .any(|allowed| allowed as u8 == opcode)
}

/// Whether a message only looks.
fn looks(message: &MavMessage) -> bool {
    match message {
        MavMessage::HEARTBEAT(_)
        | MavMessage::TIMESYNC(_)
        | MavMessage::PING(_)
        | MavMessage::SYSTEM_TIME(_)
        | MavMessage::STATUSTEXT(_)
        | MavMessage::COMMAND_ACK(_)
        | MavMessage::REQUEST_DATA_STREAM(_)
        | MavMessage::MESSAGE_INTERVAL(_)
        | MavMessage::PARAM_REQUEST_LIST(_)
        | MavMessage::PARAM_REQUEST_READ(_)
        | MavMessage::MISSION_REQUEST_LIST(_)
        | MavMessage::MISSION_REQUEST_PARTIAL_LIST(_)
        | MavMessage::MISSION_REQUEST(_)
        | MavMessage::MISSION_REQUEST_INT(_)
        | MavMessage::MISSION_ACK(_)
        | MavMessage::LOG_REQUEST_LIST(_)
        | MavMessage::LOG_REQUEST_DATA(_)
        | MavMessage::LOG_REQUEST_END(_)
        | MavMessage::RADIO_STATUS(_) => true,
        MavMessage::PARAM_SET(m) => m.param_id.starts_with(HASH_NAME),
        MavMessage::COMMAND_LONG(m) => asks(m.command, m.param1),
        MavMessage::COMMAND_INT(m) => asks(m.command, m.param1),
        MavMessage::FILE_TRANSFER_PROTOCOL(m) => reads(Packet::decode(&m.payload).opcode),
        _ => false,
    }
}

impl Stations {
    /// Whether a system may say this to us, or through us to the board. `None`: a message that we do
    /// not know, which may be anything.
    pub(crate) fn may_say(
        &self,
        link: LinkId,
        system_id: u8,
        message: Option<&MavMessage>,
    ) -> bool {
        let commands = self.endpoint_on(link).commanders.contains(system_id);
        commands || message.is_some_and(looks)
    }
}

impl Pilot {
    /// Whether what a system asks for is refused, because it may only look. `true`: it is answered.
    pub(crate) fn is_refused(
        &mut self,
        at: HostTime,
        link: LinkId,
        peer: (u8, u8),
        message: &MavMessage,
    ) -> bool {
        if self.stations.may_say(link, peer.0, Some(message)) {
            return false;
        }
        self.out.lose(link, DropReason::NotPermitted, 1);
        self.answer_refusal(at, link, peer, message);
        // What is for everyone may be chatter of other vehicles.
        let meant = mav_stream::target(message).0 == self.out.own.system_id;
        let told = self.out.told.refused_at.is_some_and(|t| at.seconds_since(t) < TELL_AGAIN_S);
        if meant && !told {
            self.out.told.refused_at = Some(at);
            let commanders = self.stations.endpoint_on(link).commanders;
            let text = format!(
                "system {} on link {} may look, not command: ground.commanders = {commanders}",
                peer.0,
                link.number()
            );
            self.out.say(at, Severity::Warning, text);
        }
        true
    }

    fn answer_refusal(&mut self, at: HostTime, link: LinkId, peer: (u8, u8), message: &MavMessage) {
        let denied = |command| {
            MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                command,
                result: MavResult::MAV_RESULT_DENIED as u8,
                progress: 0,
                result_param2: 0,
                target_system: peer.0,
                target_component: peer.1,
            })
        };
        let no_mission = |kind| ack(peer, kind, MavMissionResult::MAV_MISSION_DENIED, 0);
        let answer = match message {
            MavMessage::COMMAND_LONG(m) => denied(m.command),
            MavMessage::COMMAND_INT(m) => denied(m.command),
            MavMessage::MISSION_COUNT(m) => no_mission(m.mission_type),
            MavMessage::MISSION_ITEM(m) => no_mission(m.mission_type),
            MavMessage::MISSION_ITEM_INT(m) => no_mission(m.mission_type),
            MavMessage::MISSION_CLEAR_ALL(m) => no_mission(m.mission_type),
            MavMessage::MISSION_WRITE_PARTIAL_LIST(m) => no_mission(m.mission_type),
            MavMessage::PARAM_SET(m) => {
                // Clients that do not know PARAM_ERROR read the refusal from the old value.
                let read = MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
                    param_index: -1,
                    target_system: self.out.own.system_id,
                    target_component: self.out.own.component_id,
                    param_id: m.param_id,
                });
                self.service_message(at, link, peer, &read);
                MavMessage::PARAM_ERROR(PARAM_ERROR_DATA {
                    param_index: -1,
                    target_system: peer.0,
                    target_component: peer.1,
                    param_id: m.param_id,
                    error: MavParamError::MAV_PARAM_ERROR_PERMISSION_DENIED,
                })
            }
            MavMessage::PARAM_EXT_SET(m) => MavMessage::PARAM_EXT_ACK(PARAM_EXT_ACK_DATA {
                param_id: m.param_id,
                param_value: m.param_value,
                param_type: m.param_type,
                param_result: ParamAck::PARAM_ACK_FAILED as u8,
            }),
            MavMessage::FILE_TRANSFER_PROTOCOL(m) => {
                let nak = Packet::decode(&m.payload).nak(MavFtpErr::MAV_FTP_ERR_FILEPROTECTED);
                MavMessage::FILE_TRANSFER_PROTOCOL(nak.encode(peer))
            }
            // No word of refusal in these; the heartbeat shows that nothing has changed.
            _ => return,
        };
        self.out.message(link, &answer);
    }
}

#[cfg(test)]
mod tests;
