//! What stations command, one row a command: who may, whether it steers the board, what a shadow does, what is done.
//!
//! A command that stands in no row is for commanders alone, is kept from a board that we steer, and is answered as
//! unsupported.

use haltere_dialect::mav::haltere::{
    COMMAND_INT_DATA, COMMAND_LONG_DATA, MavCmd, MavFrame, MavResult,
};
use haltere_dialect::mav::known;

use haltere_core::time::HostTime;

use super::act::{Act, Heard, Permit};
use crate::flight::arming::SHADOW_WORDS;
use crate::flight::modes::{Event, Mode};
use crate::flight::place::{Kind, Location};
use crate::out::voice::Severity;
use crate::stations::commands::{Answer, Request, refuse};
use crate::stations::services::STORAGE_RESET;
use crate::stations::streams;

/// A command of a station.
pub struct Order {
    /// Which.
    pub command: MavCmd,
    /// Who may; it may depend on the first parameter.
    pub permit: Permit<fn(f32) -> bool>,
    /// Whether it is kept from the board while we steer.
    pub steers: Steers,
    /// It arms, moves or breaks something: refused in words beside a vehicle that somebody else flies.
    pub refused_in_shadow: bool,
    /// Done by a service, which answers by itself and looks at no frame. `false`: it is not for the service.
    serve: Option<fn(&mut Act<'_>, HostTime, &Request) -> bool>,
    /// Done by us. `None`: unsupported.
    act: Option<fn(&mut Act<'_>, HostTime, &Request) -> Answer>,
}

impl Order {
    /// Whether anything is done.
    pub fn is_done(&self) -> bool {
        self.serve.is_some() || self.act.is_some()
    }
}

/// Whether a command steers the board, or takes from us what it streams.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Steers {
    /// No: it asks for something.
    No,
    /// Yes, or nobody knows.
    Yes,
    /// It changes the rate of the message that its first parameter names: yes for those that we need.
    Rate,
}

const ASKS: Order = Order {
    command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
    permit: Permit::Look,
    steers: Steers::No,
    refused_in_shadow: false,
    serve: None,
    act: None,
};
const COMMANDS: Order = Order { permit: Permit::Command, steers: Steers::Yes, ..ASKS };
const MOVES: Order = Order { refused_in_shadow: true, ..COMMANDS };

/// All commands that are more than unsupported.
pub static ORDERS: &[Order] = &[
    Order {
        command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        act: Some(|p, at, r| p.arm_disarm(at, r)),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_DO_FLIGHTTERMINATION,
        act: Some(|p, at, r| p.terminate(at, r)),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_NAV_TAKEOFF,
        act: Some(|p, at, r| p.command_takeoff(at, r)),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_NAV_TAKEOFF_LOCAL,
        act: Some(|p, at, r| p.takeoff_to(at, Kind::Local, r)),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_NAV_LAND,
        act: Some(|p, at, r| p.command_land(at, r)),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_NAV_LAND_LOCAL,
        act: Some(|p, at, _| p.land_here(at)),
        ..MOVES
    },
    // MAVProxy's `land`. Without a landing sequence in the mission a landing begins here.
    Order {
        command: MavCmd::MAV_CMD_DO_LAND_START,
        act: Some(|p, at, _| p.land_here(at)),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH,
        act: Some(|p, at, _| p.ask(at, Event::ReturnAsked, &[Mode::Return])),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_NAV_LOITER_UNLIM,
        act: Some(|p, at, _| p.ask(at, Event::HoldAsked, &[Mode::Hold])),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_DO_SET_MODE,
        act: Some(|p, at, r| p.do_set_mode(at, r)),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_DO_SET_STANDARD_MODE,
        act: Some(|p, at, r| p.do_set_standard_mode(at, r)),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_MISSION_START,
        act: Some(|p, at, r| p.start_mission(at, r)),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_DO_PAUSE_CONTINUE,
        act: Some(|p, at, r| p.pause_or_go_on(at, r)),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_DO_REPOSITION,
        act: Some(|p, at, r| p.reposition(at, r)),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_DO_CHANGE_SPEED,
        act: Some(|p, _, r| p.change_speed(r.number(1))),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT,
        act: Some(|p, _, r| p.set_current_item(r.number(0))),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_CONDITION_YAW,
        act: Some(|p, _, r| p.turn(r.params.map(f64::from))),
        ..MOVES
    },
    Order {
        command: MavCmd::MAV_CMD_INJECT_FAILURE,
        act: Some(|p, at, r| p.inject_failure(at, r)),
        ..MOVES
    },
    // Unsupported here, and in a shadow refused in words.
    Order { command: MavCmd::MAV_CMD_DO_MOTOR_TEST, ..MOVES },
    Order { command: MavCmd::MAV_CMD_DO_SET_ACTUATOR, ..MOVES },
    Order { command: MavCmd::MAV_CMD_DO_SET_SERVO, ..MOVES },
    Order { command: MavCmd::MAV_CMD_ACTUATOR_TEST, ..MOVES },
    Order { command: MavCmd::MAV_CMD_NAV_VTOL_TAKEOFF, ..MOVES },
    Order { command: MavCmd::MAV_CMD_NAV_VTOL_LAND, ..MOVES },
    Order { command: MavCmd::MAV_CMD_OVERRIDE_GOTO, ..MOVES },
    Order { command: MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION, ..MOVES },
    Order { command: MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, ..MOVES },
    Order {
        command: MavCmd::MAV_CMD_DO_SET_HOME,
        act: Some(|p, at, r| p.command_home(at, r)),
        ..COMMANDS
    },
    Order {
        command: MavCmd::MAV_CMD_DO_SET_GLOBAL_ORIGIN,
        act: Some(|p, at, r| p.command_origin(at, r)),
        ..COMMANDS
    },
    Order {
        command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        steers: Steers::Rate,
        act: Some(|p, at, r| p.stations.set_interval(at, r, p.out)),
        ..ASKS
    },
    Order {
        command: MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL,
        act: Some(|p, _, r| p.stations.send_interval(r.link, r.number(0), p.out)),
        ..ASKS
    },
    Order {
        command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
        serve: Some(|p, at, r| p.stations.metadata_asked(at, r, p.out)),
        act: Some(|p, at, r| p.request_message(at, r)),
        ..ASKS
    },
    Order {
        command: MavCmd::MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
        act: Some(|p, at, r| {
            p.send_telemetry(at, r.link, streams::AUTOPILOT_VERSION);
            Ok(MavResult::MAV_RESULT_ACCEPTED)
        }),
        ..ASKS
    },
    Order { command: MavCmd::MAV_CMD_REQUEST_PROTOCOL_VERSION, ..ASKS },
    Order { command: MavCmd::MAV_CMD_GET_HOME_POSITION, ..ASKS },
    Order {
        command: MavCmd::MAV_CMD_PREFLIGHT_STORAGE,
        permit: Permit::Asks(|param1| param1 != STORAGE_RESET),
        serve: Some(|p, at, r| p.stations.storage_asked(at, r, p.out)),
        ..COMMANDS
    },
    Order {
        command: MavCmd::MAV_CMD_RUN_PREARM_CHECKS,
        serve: Some(|p, at, r| p.checks_asked(at, r)),
        ..COMMANDS
    },
    Order {
        command: MavCmd::MAV_CMD_USER_4,
        // Names of programs.
        permit: Permit::Asks(|param1| param1 == 0.0),
        serve: Some(|p, at, r| {
            p.program_command(at, r.client(), r.params[0]);
            true
        }),
        ..COMMANDS
    },
];

/// The row of a command. `None`: unsupported, and for commanders alone.
pub(crate) fn row(command: MavCmd) -> Option<&'static Order> {
    ORDERS.iter().find(|row| row.command == command)
}

/// Whether a command only asks, so that everybody may send it.
pub(crate) fn asks(command: u16, param1: f32) -> bool {
    known(command).and_then(row).is_some_and(|row| match row.permit {
        Permit::Look => true,
        Permit::Command => false,
        Permit::Asks(asks) => asks(param1),
    })
}

impl Act<'_> {
    pub(crate) fn command_long(&mut self, heard: &Heard<'_>, m: &COMMAND_LONG_DATA) {
        let location = Location::Float {
            x: f64::from(m.param5),
            y: f64::from(m.param6),
            z: f64::from(m.param7),
            frame: None,
        };
        let params = [m.param1, m.param2, m.param3, m.param4];
        self.answer(heard, m.command, params, location);
    }

    pub(crate) fn command_int(&mut self, heard: &Heard<'_>, m: &COMMAND_INT_DATA) {
        let location = Location::Int { x: m.x, y: m.y, z: f64::from(m.z), frame: m.frame };
        let params = [m.param1, m.param2, m.param3, m.param4];
        self.answer(heard, m.command, params, location);
    }

    /// Does what a client commands, by number, and answers whatever it is.
    fn answer(&mut self, heard: &Heard<'_>, number: u16, params: [f32; 4], location: Location) {
        let Heard { at, link, peer, .. } = *heard;
        let request =
            known(number).map(|command| Request { link, peer, command, params, location });
        if let Some(request) = &request
            && let Some(serve) = row(request.command).and_then(|row| row.serve)
            && serve(self, at, request)
        {
            return;
        }
        let unknown_frame = matches!(
            location,
            Location::Int { frame, .. } if known::<MavFrame>(frame).is_none()
        );
        let answer = match request {
            _ if unknown_frame => Ok(MavResult::MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME),
            Some(request) => self.command(at, &request),
            None => Ok(MavResult::MAV_RESULT_UNSUPPORTED),
        };
        let (result, why) = match answer {
            Ok(MavResult::MAV_RESULT_IN_PROGRESS) => return, // answered when the board has
            Ok(result) => (result, None),
            Err((result, why)) => (result, Some(why)),
        };
        self.out.acknowledge(heard.client(), number, result);
        if let Some(why) = why {
            self.out.say(at, Severity::Warning, why);
        }
    }

    fn command(&mut self, at: HostTime, request: &Request) -> Answer {
        let row = row(request.command);
        if self.config.flight.shadow && row.is_some_and(|row| row.refused_in_shadow) {
            return refuse(MavResult::MAV_RESULT_DENIED, format!("refused: {SHADOW_WORDS}"));
        }
        match row.and_then(|row| row.act) {
            Some(act) => act(self, at, request),
            None => Ok(MavResult::MAV_RESULT_UNSUPPORTED),
        }
    }

    /// Whether a command must not reach the board while we steer.
    pub(crate) fn steers(&self, command: MavCmd, param1: f32) -> bool {
        match row(command).map_or(Steers::Yes, |row| row.steers) {
            Steers::No => false,
            Steers::Yes => true,
            Steers::Rate => {
                // The cast saturates; NaN is 0, the heartbeat, which nobody may slow either.
                let is_free = param1 > 0.0 && !self.board.link.is_own_stream(param1 as u32);
                !is_free
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_command_has_one_row() {
        for order in ORDERS {
            assert!(row(order.command).is_some_and(|found| std::ptr::eq(found, order)));
        }
    }

    /// What everybody may send without a permit does not steer the board either, but for rates.
    #[test]
    fn prop_what_everybody_may_does_not_steer() {
        for order in ORDERS.iter().filter(|order| matches!(order.permit, Permit::Look)) {
            assert!(order.steers != Steers::Yes && !order.refused_in_shadow, "{:?}", order.command);
        }
    }
}
