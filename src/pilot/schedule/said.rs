//! What stations and clients say, one row a message: who may say it, whether it steers, whether its sender waits, what
//! a refusal is answered, and what is done.
//!
//! Looking is for everybody, all else needs a permit: a message that stands in no row is refused to those who may only
//! look, and thrown away else. A refusal is answered in the words of its protocol, so that no client waits.

use haltere_dialect::mav::command_ack;
use haltere_dialect::mav::haltere::{
    MavFtpErr, MavMessage, MavMissionResult, MavParamError, MavResult, PARAM_ERROR_DATA,
    PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, ParamAck,
};

use super::act::{Act, Heard, Permit};
use super::ordered;
use crate::out::voice::Severity;
use crate::stations::mission_transfer::ack;
use crate::stations::services::ftp_wire::{Packet, reads};
use crate::stations::services::{parameters, plan_wire};

/// A message that is heard from stations.
pub struct Said {
    /// Its number.
    pub id: u32,
    /// Its name.
    pub name: &'static str,
    /// Who may say it, to us and through us to the board.
    pub permit: Permit<fn(&MavMessage) -> bool>,
    /// It steers, or changes what the board streams to us: kept from the board while we steer.
    pub steers: bool,
    /// Its sender waits for something.
    pub waits: bool,
    /// What is answered to who may only look. `None`: no word of refusal in this protocol, nothing changes.
    refused: fn(&mut Act<'_>, &Heard<'_>) -> Option<MavMessage>,
    /// What is done. `false`: nothing, the message is ignored.
    act: fn(&mut Act<'_>, &Heard<'_>) -> bool,
}

/// Does something with the fields of a message.
macro_rules! on {
    ($heard:ident, $name:ident($fields:pat) => $done:expr) => {{
        let MavMessage::$name($fields) = $heard.message else { return false };
        $done;
        true
    }};
}

const LOOKS: Said = Said {
    id: 0,
    name: "",
    permit: Permit::Look,
    steers: false,
    waits: false,
    refused: |_, _| None,
    act: |_, _| false,
};
const COMMANDS: Said = Said { permit: Permit::Command, ..LOOKS };
/// Pose of motion capture.
const POSE: Said = Said { act: |p, h| p.take_reference(h), ..COMMANDS };

/// All that is heard, by number.
pub static SAID: &[Said] = &[
    Said {
        id: 0,
        name: "HEARTBEAT",
        act: |p, h| {
            p.flight.supervisor.heard.station_at = Some(h.at);
            true
        },
        ..LOOKS
    },
    Said { id: 2, name: "SYSTEM_TIME", ..LOOKS },
    Said {
        id: 4,
        name: "PING",
        act: |p, h| matches!(h.message, MavMessage::PING(m) if p.out.echo_ping(h.link, h.peer, m)),
        ..LOOKS
    },
    Said {
        id: 11,
        name: "SET_MODE",
        steers: true,
        waits: true,
        act: |p, h| on!(h, SET_MODE(m) => p.set_mode(h, m.custom_mode)),
        ..COMMANDS
    },
    Said {
        id: 20,
        name: "PARAM_REQUEST_READ",
        waits: true,
        act: |p, h| {
            on!(h, PARAM_REQUEST_READ(m) => {
                p.stations.parameter_read(h.link, h.peer, m, p.out)
            })
        },
        ..LOOKS
    },
    Said {
        id: 21,
        name: "PARAM_REQUEST_LIST",
        waits: true,
        act: |p, h| {
            p.stations.parameter_list(h.link);
            true
        },
        ..LOOKS
    },
    Said {
        id: 23,
        name: "PARAM_SET",
        permit: Permit::Asks(
            |m| matches!(m, MavMessage::PARAM_SET(m) if parameters::spares_the_list(m)),
        ),
        waits: true,
        refused: |p, h| {
            let MavMessage::PARAM_SET(m) = h.message else { return None };
            Some(p.refuse_parameter(h, m))
        },
        act: |p, h| on!(h, PARAM_SET(m) => p.set_parameter(h, m)),
        ..COMMANDS
    },
    Said {
        id: 37,
        name: "MISSION_REQUEST_PARTIAL_LIST",
        act: |p, h| {
            on!(h, MISSION_REQUEST_PARTIAL_LIST(m) => {
                let (first, last) = (m.start_index, m.end_index);
                p.request_partial(h.client(), m.mission_type, [first, last])
            })
        },
        ..LOOKS
    },
    Said {
        id: 38,
        name: "MISSION_WRITE_PARTIAL_LIST",
        refused: |_, h| {
            let MavMessage::MISSION_WRITE_PARTIAL_LIST(m) = h.message else { return None };
            no_mission(h, m.mission_type)
        },
        act: |p, h| {
            on!(h, MISSION_WRITE_PARTIAL_LIST(m) => {
                let (first, last) = (m.start_index, m.end_index);
                p.write_partial(h.at, h.client(), m.mission_type, [first, last])
            })
        },
        ..COMMANDS
    },
    Said {
        id: 39,
        name: "MISSION_ITEM",
        refused: |_, h| {
            let MavMessage::MISSION_ITEM(m) = h.message else { return None };
            no_mission(h, m.mission_type)
        },
        act: |p, h| {
            on!(h, MISSION_ITEM(m) => {
                if m.current > 1 {
                    return p.guided_item(h, m);
                }
                p.upload_item(h.at, h.client(), plan_wire::to_int(m), true)
            })
        },
        ..COMMANDS
    },
    Said {
        id: 40,
        name: "MISSION_REQUEST",
        act: |p, h| on!(h, MISSION_REQUEST(m) => p.send_item(h.client(), m.mission_type, m.seq, true)),
        ..LOOKS
    },
    Said {
        id: 41,
        name: "MISSION_SET_CURRENT",
        steers: true,
        act: |p, h| on!(h, MISSION_SET_CURRENT(m) => p.set_current(h, m.seq)),
        ..COMMANDS
    },
    Said {
        id: 43,
        name: "MISSION_REQUEST_LIST",
        waits: true,
        act: |p, h| on!(h, MISSION_REQUEST_LIST(m) => p.count_plan(h.at, h.client(), m.mission_type)),
        ..LOOKS
    },
    Said {
        id: 44,
        name: "MISSION_COUNT",
        waits: true,
        refused: |_, h| {
            let MavMessage::MISSION_COUNT(m) = h.message else { return None };
            no_mission(h, m.mission_type)
        },
        act: |p, h| {
            on!(h, MISSION_COUNT(m) => {
                let count = usize::from(m.count);
                p.upload_begins(h.at, h.client(), m.mission_type, 0, count, false)
            })
        },
        ..COMMANDS
    },
    Said {
        id: 45,
        name: "MISSION_CLEAR_ALL",
        waits: true,
        refused: |_, h| {
            let MavMessage::MISSION_CLEAR_ALL(m) = h.message else { return None };
            no_mission(h, m.mission_type)
        },
        act: |p, h| on!(h, MISSION_CLEAR_ALL(m) => p.clear_plans(h.at, h.client(), m.mission_type)),
        ..COMMANDS
    },
    Said {
        id: 47,
        name: "MISSION_ACK",
        act: |p, h| {
            p.stations.services.plans.transfer.cancel(h.client());
            true
        },
        ..LOOKS
    },
    Said {
        id: 48,
        name: "SET_GPS_GLOBAL_ORIGIN",
        act: |p, h| on!(h, SET_GPS_GLOBAL_ORIGIN(m) => p.origin_set(h, m)),
        ..COMMANDS
    },
    Said {
        id: 51,
        name: "MISSION_REQUEST_INT",
        act: |p, h| on!(h, MISSION_REQUEST_INT(m) => p.send_item(h.client(), m.mission_type, m.seq, false)),
        ..LOOKS
    },
    Said {
        id: 66,
        name: "REQUEST_DATA_STREAM",
        steers: true,
        act: |p, h| {
            on!(h, REQUEST_DATA_STREAM(m) => {
                p.stations.request_streams(h.at, h.link, m, p.out)
            })
        },
        ..LOOKS
    },
    Said {
        id: 69,
        name: "MANUAL_CONTROL",
        steers: true,
        waits: true,
        act: |p, h| on!(h, MANUAL_CONTROL(m) => p.joystick(h, m)),
        ..COMMANDS
    },
    Said { id: 70, name: "RC_CHANNELS_OVERRIDE", steers: true, ..COMMANDS },
    Said {
        id: 73,
        name: "MISSION_ITEM_INT",
        refused: |_, h| {
            let MavMessage::MISSION_ITEM_INT(m) = h.message else { return None };
            no_mission(h, m.mission_type)
        },
        act: |p, h| {
            on!(h, MISSION_ITEM_INT(m) => {
                if m.current > 1 {
                    return p.guided_item_int(h, m);
                }
                p.upload_item(h.at, h.client(), m.clone(), false)
            })
        },
        ..COMMANDS
    },
    Said {
        id: 75,
        name: "COMMAND_INT",
        permit: Permit::Asks(
            |m| matches!(m, MavMessage::COMMAND_INT(m) if ordered::asks(m.command, m.param1)),
        ),
        waits: true,
        refused: |_, h| {
            let MavMessage::COMMAND_INT(m) = h.message else { return None };
            denied(h, m.command)
        },
        act: |p, h| on!(h, COMMAND_INT(m) => p.command_int(h, m)),
        ..COMMANDS
    },
    Said {
        id: 76,
        name: "COMMAND_LONG",
        permit: Permit::Asks(
            |m| matches!(m, MavMessage::COMMAND_LONG(m) if ordered::asks(m.command, m.param1)),
        ),
        waits: true,
        refused: |_, h| {
            let MavMessage::COMMAND_LONG(m) = h.message else { return None };
            denied(h, m.command)
        },
        act: |p, h| on!(h, COMMAND_LONG(m) => p.command_long(h, m)),
        ..COMMANDS
    },
    Said { id: 77, name: "COMMAND_ACK", ..LOOKS },
    Said {
        id: 80,
        name: "COMMAND_CANCEL",
        act: |p, h| on!(h, COMMAND_CANCEL(m) => p.cancel(h.at, h.client(), m.command)),
        ..COMMANDS
    },
    Said {
        id: 82,
        name: "SET_ATTITUDE_TARGET",
        steers: true,
        act: |p, h| {
            // A tilt without a position knows no walls: the limits of the volume could not hold.
            let why = "SET_ATTITUDE_TARGET refused: send positions or velocities".to_owned();
            p.out.refuse_setpoint(h.at, h.link, why);
            true
        },
        ..COMMANDS
    },
    Said {
        id: 84,
        name: "SET_POSITION_TARGET_LOCAL_NED",
        steers: true,
        waits: true,
        act: |p, h| on!(h, SET_POSITION_TARGET_LOCAL_NED(m) => p.take_setpoint(h, Ok(m.clone()))),
        ..COMMANDS
    },
    Said {
        id: 86,
        name: "SET_POSITION_TARGET_GLOBAL_INT",
        steers: true,
        waits: true,
        act: |p, h| on!(h, SET_POSITION_TARGET_GLOBAL_INT(m) => p.take_global_setpoint(h, m)),
        ..COMMANDS
    },
    Said { id: 102, name: "VISION_POSITION_ESTIMATE", ..POSE },
    Said {
        id: 109,
        name: "RADIO_STATUS",
        act: |p, h| {
            on!(h, RADIO_STATUS(m) => if let Some(ground) = p.stations.ground_mut(h.link) {
                ground.streams.radio(m.txbuf, h.at);
            })
        },
        ..LOOKS
    },
    Said {
        id: 110,
        name: "FILE_TRANSFER_PROTOCOL",
        permit: Permit::Asks(|m| {
            matches!(m, MavMessage::FILE_TRANSFER_PROTOCOL(m)
                if reads(Packet::decode(&m.payload).opcode))
        }),
        waits: true,
        refused: |_, h| {
            let MavMessage::FILE_TRANSFER_PROTOCOL(m) = h.message else { return None };
            let nak = Packet::decode(&m.payload).nak(MavFtpErr::MAV_FTP_ERR_FILEPROTECTED);
            Some(MavMessage::FILE_TRANSFER_PROTOCOL(nak.encode(h.peer)))
        },
        act: |p, h| {
            on!(h, FILE_TRANSFER_PROTOCOL(m) => {
                p.stations.ftp_message(h.at, h.client(), &m.payload, p.out)
            })
        },
        ..COMMANDS
    },
    Said {
        id: 111,
        name: "TIMESYNC",
        act: |p, h| {
            matches!(h.message, MavMessage::TIMESYNC(m)
                if p.out.echo_timesync(h.at, h.link, h.peer, m))
        },
        ..LOOKS
    },
    Said {
        id: 117,
        name: "LOG_REQUEST_LIST",
        act: |p, h| on!(h, LOG_REQUEST_LIST(m) => p.stations.log_list(h.at, h.client(), m, p.out)),
        ..LOOKS
    },
    Said {
        id: 119,
        name: "LOG_REQUEST_DATA",
        act: |p, h| on!(h, LOG_REQUEST_DATA(m) => p.stations.log_data(h.at, h.client(), m, p.out)),
        ..LOOKS
    },
    Said {
        id: 121,
        name: "LOG_ERASE",
        act: |p, h| {
            let is_armed = p.board.link.is_armed();
            p.stations.log_erase(h.at, is_armed, p.out);
            true
        },
        ..COMMANDS
    },
    Said {
        id: 122,
        name: "LOG_REQUEST_END",
        act: |p, h| {
            p.stations.log_end(h.client());
            true
        },
        ..LOOKS
    },
    Said {
        id: 126,
        name: "SERIAL_CONTROL",
        act: |p, h| on!(h, SERIAL_CONTROL(m) => p.out.refuse_shell(h.link, h.peer, m)),
        ..COMMANDS
    },
    Said { id: 138, name: "ATT_POS_MOCAP", ..POSE },
    Said { id: 139, name: "SET_ACTUATOR_CONTROL_TARGET", steers: true, ..COMMANDS },
    Said {
        id: 243,
        name: "SET_HOME_POSITION",
        act: |p, h| on!(h, SET_HOME_POSITION(m) => p.home_set(h, m)),
        ..COMMANDS
    },
    Said { id: 244, name: "MESSAGE_INTERVAL", ..LOOKS },
    Said { id: 253, name: "STATUSTEXT", ..LOOKS },
    Said { id: 258, name: "PLAY_TUNE", ..TUNE },
    Said {
        id: 323,
        name: "PARAM_EXT_SET",
        refused: |_, h| {
            let MavMessage::PARAM_EXT_SET(m) = h.message else { return None };
            Some(parameters::ext_ack(m, ParamAck::PARAM_ACK_FAILED))
        },
        // Long values: we have none, and say so where the protocol has a word for it.
        act: |p, h| {
            on!(h, PARAM_EXT_SET(m) => {
                let answer = parameters::ext_ack(m, ParamAck::PARAM_ACK_VALUE_UNSUPPORTED);
                p.out.message(h.link, &answer)
            })
        },
        ..COMMANDS
    },
    Said { id: 331, name: "ODOMETRY", ..POSE },
    Said { id: 400, name: "PLAY_TUNE_V2", ..TUNE },
    Said {
        id: 412,
        name: "REQUEST_EVENT",
        act: |p, h| on!(h, REQUEST_EVENT(m) => p.out.events_again(h.link, h.peer, m)),
        ..COMMANDS
    },
];

const TUNE: Said = Said {
    act: |p, h| {
        let text = "no tune is played: the vehicle has nothing that sounds".to_owned();
        p.out.say(h.at, Severity::Warning, text);
        true
    },
    ..COMMANDS
};

/// The row of a message. `None`: nobody thought of it.
pub(crate) fn row(id: u32) -> Option<&'static Said> {
    SAID.binary_search_by_key(&id, |row| row.id).ok().and_then(|n| SAID.get(n))
}

/// Whether a message only looks.
pub(crate) fn looks(id: u32, message: &MavMessage) -> bool {
    row(id).is_some_and(|row| match row.permit {
        Permit::Look => true,
        Permit::Command => false,
        Permit::Asks(asks) => asks(message),
    })
}

fn denied(heard: &Heard<'_>, command: u16) -> Option<MavMessage> {
    Some(command_ack(heard.peer, command, MavResult::MAV_RESULT_DENIED))
}

fn no_mission(heard: &Heard<'_>, kind: u8) -> Option<MavMessage> {
    Some(ack(heard.peer, kind, MavMissionResult::MAV_MISSION_DENIED, 0))
}

impl Act<'_> {
    /// Does what a message asks for that is for us or for everyone. `false`: it is ignored.
    pub(crate) fn obey(&mut self, heard: &Heard<'_>) -> bool {
        row(heard.id).is_some_and(|row| (row.act)(self, heard))
    }

    /// What is answered to who may only look.
    pub(crate) fn refusal_of(&mut self, heard: &Heard<'_>) -> Option<MavMessage> {
        row(heard.id).and_then(|row| (row.refused)(self, heard))
    }

    fn refuse_parameter(&mut self, heard: &Heard<'_>, m: &PARAM_SET_DATA) -> MavMessage {
        // Clients that do not know PARAM_ERROR read the refusal from the old value.
        let read = PARAM_REQUEST_READ_DATA {
            param_index: -1,
            target_system: self.out.own.system_id,
            target_component: self.out.own.component_id,
            param_id: m.param_id,
        };
        self.stations.parameter_read(heard.link, heard.peer, &read, self.out);
        MavMessage::PARAM_ERROR(PARAM_ERROR_DATA {
            param_index: -1,
            target_system: heard.peer.0,
            target_component: heard.peer.1,
            param_id: m.param_id,
            error: MavParamError::MAV_PARAM_ERROR_PERMISSION_DENIED,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stations::services::STORAGE_RESET;
    use haltere_dialect::mav_stream::name_of_id;

    #[test]
    fn prop_rows_stand_by_number_and_are_called_as_the_dialect_does() {
        assert!(SAID.windows(2).all(|pair| pair[0].id < pair[1].id));
        for row in SAID {
            assert_eq!(name_of_id(row.id), Some(row.name));
            assert!(super::row(row.id).is_some_and(|found| std::ptr::eq(found, row)));
        }
    }

    #[test]
    fn prop_who_may_only_look_is_never_refused_what_everybody_may() {
        let reads = |param1| ordered::asks(512, param1); // MAV_CMD_REQUEST_MESSAGE
        assert!(
            reads(0.0) && reads(f32::NAN) && !ordered::asks(400, 0.0) && !ordered::asks(9, 0.0)
        );
        assert!(ordered::asks(245, 0.0) && !ordered::asks(245, STORAGE_RESET));
        assert!(!looks(31_337, &MavMessage::LOG_ERASE(Default::default())));
    }
}
