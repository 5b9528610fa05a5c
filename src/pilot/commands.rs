//! What clients command, and what they are answered.

use haltere_dialect::mav::haltere::{
    AUTOPILOT_VERSION_DATA, COMMAND_ACK_DATA, MESSAGE_INTERVAL_DATA, MavCmd, MavFrame, MavMessage,
    MavProtocolCapability, MavResult,
};

use crate::estimate::Health;
use crate::frames::Vec3;
use crate::time::HostTime;

use super::modes::{Event, Mode};
use super::{LinkId, OWN, Pilot, Severity};

/// Magic number that forces a disarm in the air (common.xml, MAV_CMD_COMPONENT_ARM_DISARM).
const FORCE_DISARM: f32 = 21196.0;

/// Who waits for the answer of the board.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asker {
    link: LinkId,
    peer: (u8, u8),
    arm: bool,
}

/// A command, from either message.
pub(super) struct Request {
    pub link: LinkId,
    pub peer: (u8, u8),
    pub command: MavCmd,
    pub params: [f32; 4],
    /// x, y, z: the last three fields, in metres when the frame is local.
    pub point: [f64; 3],
    pub frame: Option<MavFrame>,
}

/// Answer to a command: the result, and what people are told when it is refused.
type Answer = Result<MavResult, (MavResult, String)>;

fn refuse(result: MavResult, text: impl Into<String>) -> Answer {
    Err((result, text.into()))
}

impl Pilot {
    pub(super) fn answer(&mut self, at: HostTime, request: Request) {
        let (result, why) = match self.command(at, &request) {
            Ok(MavResult::MAV_RESULT_IN_PROGRESS) => return, // answered when the board has
            Ok(result) => (result, None),
            Err((result, why)) => (result, Some(why)),
        };
        self.send_ack(request.link, request.peer, request.command, result);
        if let Some(why) = why {
            self.say(at, Severity::Warning, why);
        }
    }

    fn send_ack(&mut self, link: LinkId, peer: (u8, u8), command: MavCmd, result: MavResult) {
        let message = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command,
            result,
            progress: 0,
            result_param2: 0,
            target_system: peer.0,
            target_component: peer.1,
        });
        self.out.message(link, OWN, &message);
    }

    /// The board has answered an arm or disarm command that a client waits for.
    pub(super) fn answer_arm_asker(&mut self, arm: bool, accepted: bool) {
        if let Some(asker) = self.arm_asker.take_if(|asker| asker.arm == arm) {
            let result = if accepted {
                MavResult::MAV_RESULT_ACCEPTED
            } else {
                MavResult::MAV_RESULT_FAILED
            };
            let command = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
            self.send_ack(asker.link, asker.peer, command, result);
        }
    }

    fn command(&mut self, at: HostTime, request: &Request) -> Answer {
        use MavResult as R;
        let p = request.params.map(f64::from);
        match request.command {
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => self.arm_disarm(at, request),
            MavCmd::MAV_CMD_NAV_TAKEOFF | MavCmd::MAV_CMD_NAV_TAKEOFF_LOCAL => {
                let local = request.frame == Some(MavFrame::MAV_FRAME_LOCAL_NED)
                    || request.command == MavCmd::MAV_CMD_NAV_TAKEOFF_LOCAL;
                let z = request.point[2];
                let height_m = if local { -z } else { z };
                let height_m = if height_m.is_finite() {
                    height_m
                } else {
                    self.config.flight.takeoff_height_m
                };
                self.ask_takeoff(at, height_m)
            }
            MavCmd::MAV_CMD_NAV_LAND | MavCmd::MAV_CMD_NAV_LAND_LOCAL => {
                self.ask(at, Event::LandAsked, &[Mode::Land, Mode::Descend])
            }
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => {
                self.ask(at, Event::ReturnAsked, &[Mode::Return])
            }
            MavCmd::MAV_CMD_DO_SET_MODE => {
                if p[0].is_nan() || (p[0] as u32) & 1 == 0 {
                    return refuse(R::MAV_RESULT_DENIED, "DO_SET_MODE without custom mode flag");
                }
                if !(p[1].is_finite() && p[1] >= 0.0) {
                    return refuse(R::MAV_RESULT_DENIED, "DO_SET_MODE without a mode");
                }
                // Both habits (GROUND.md): main and sub mode, or the whole number.
                let custom = if p[1] < 256.0 {
                    let sub = if p[2].is_finite() { p[2] as u32 & 0xFF } else { 0 };
                    (p[1] as u32) << 16 | sub << 24
                } else {
                    p[1] as u32
                };
                self.set_custom_mode(at, custom)
            }
            MavCmd::MAV_CMD_MISSION_START => {
                if p[0].is_finite() && p[0] > 0.0 {
                    self.set_current_item(p[0])?;
                }
                self.ask_mission(at)
            }
            MavCmd::MAV_CMD_DO_PAUSE_CONTINUE => {
                if p[0] == 0.0 {
                    self.ask(at, Event::HoldAsked, &[Mode::Hold])
                } else {
                    self.ask_mission(at)
                }
            }
            MavCmd::MAV_CMD_DO_REPOSITION => self.reposition(at, request),
            MavCmd::MAV_CMD_DO_CHANGE_SPEED => {
                if (0.05..=20.0).contains(&p[1]) {
                    self.guidance.set_leg_speed(Some(p[1]));
                } else if p[1] == -2.0 {
                    self.guidance.set_leg_speed(None);
                } else if p[1] != -1.0 {
                    // -1 is "no change".
                    return refuse(
                        R::MAV_RESULT_DENIED,
                        format!("speed = {} m/s, allowed 0.05 to 20 m/s, or -2 for default", p[1]),
                    );
                }
                Ok(R::MAV_RESULT_ACCEPTED)
            }
            MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT => {
                self.set_current_item(p[0])?;
                Ok(R::MAV_RESULT_ACCEPTED)
            }
            MavCmd::MAV_CMD_CONDITION_YAW => {
                if !p[0].is_finite() {
                    return refuse(R::MAV_RESULT_DENIED, "yaw is not a number");
                }
                let angle_rad = p[0].to_radians();
                let relative = p[3] == 1.0;
                let sign = if p[2] < 0.0 { -1.0 } else { 1.0 };
                let base_rad = if relative { self.estimate.R_EB.yaw_rad() } else { 0.0 };
                self.guidance.set_yaw(base_rad + if relative { sign } else { 1.0 } * angle_rad);
                Ok(R::MAV_RESULT_ACCEPTED)
            }
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
                let LinkId::Ground(n) = request.link else {
                    return Ok(R::MAV_RESULT_UNSUPPORTED);
                };
                let known = p[0] >= 0.0
                    && p[1].is_finite()
                    && self.grounds[usize::from(n)].set_interval(p[0] as u32, p[1], at);
                if known {
                    Ok(R::MAV_RESULT_ACCEPTED)
                } else {
                    refuse(R::MAV_RESULT_DENIED, format!("no stream of message {}", p[0]))
                }
            }
            MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL => {
                let LinkId::Ground(n) = request.link else {
                    return Ok(R::MAV_RESULT_UNSUPPORTED);
                };
                let msg_id = if p[0] >= 0.0 { p[0] as u32 } else { u32::MAX };
                let message = MavMessage::MESSAGE_INTERVAL(MESSAGE_INTERVAL_DATA {
                    message_id: msg_id as u16,
                    interval_us: self.grounds[usize::from(n)].interval_us(msg_id),
                });
                self.out.message(request.link, OWN, &message);
                Ok(R::MAV_RESULT_ACCEPTED)
            }
            MavCmd::MAV_CMD_REQUEST_MESSAGE => {
                let msg_id = if p[0] >= 0.0 { p[0] as u32 } else { u32::MAX };
                if msg_id == AUTOPILOT_VERSION_ID {
                    self.send_version(request.link);
                    return Ok(R::MAV_RESULT_ACCEPTED);
                }
                if self.send_telemetry(at, request.link, msg_id) {
                    Ok(R::MAV_RESULT_ACCEPTED)
                } else {
                    refuse(R::MAV_RESULT_UNSUPPORTED, format!("no message {} to send", p[0]))
                }
            }
            MavCmd::MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES => {
                self.send_version(request.link);
                Ok(R::MAV_RESULT_ACCEPTED)
            }
            MavCmd::MAV_CMD_INJECT_FAILURE => {
                let q = request.params;
                let params = [q[0], q[1], q[2], q[3], 0.0, 0.0, 0.0];
                self.board.send_command(request.command, params, &mut self.out);
                self.say(
                    at,
                    Severity::Warning,
                    format!("failure injected: unit {} type {}", p[0], p[1]),
                );
                Ok(R::MAV_RESULT_ACCEPTED)
            }
            _ => Ok(R::MAV_RESULT_UNSUPPORTED),
        }
    }

    fn arm_disarm(&mut self, at: HostTime, request: &Request) -> Answer {
        use MavResult as R;
        let arm = match request.params[0] {
            1.0 => true,
            0.0 => false,
            other => {
                return refuse(
                    R::MAV_RESULT_DENIED,
                    format!("arm = {other}, allowed 1 to arm or 0 to disarm"),
                );
            }
        };
        let asker = Asker { link: request.link, peer: request.peer, arm };
        if arm {
            if self.mode == Mode::Arming {
                // Asked again before the board has answered.
                self.arm_asker = Some(asker);
                return Ok(R::MAV_RESULT_IN_PROGRESS);
            }
            let ours = !matches!(self.mode, Mode::Disarmed | Mode::Disarming);
            if self.board.is_armed() && ours {
                return Ok(R::MAV_RESULT_ACCEPTED);
            }
            if let Err(why) = self.may_arm(at) {
                return refuse(
                    R::MAV_RESULT_TEMPORARILY_REJECTED,
                    format!("arming refused: {why}"),
                );
            }
            self.board.command_arm(true, false, at);
            self.arm_asker = Some(asker);
            self.fire(at, Event::ArmAsked);
            return Ok(R::MAV_RESULT_IN_PROGRESS);
        }
        if self.mode == Mode::Disarmed && !self.board.is_armed() {
            return Ok(R::MAV_RESULT_ACCEPTED);
        }
        let forced = request.params[1] == FORCE_DISARM;
        if self.mode == Mode::Disarming && !forced && self.board.is_commanding() {
            self.arm_asker = Some(asker);
            return Ok(R::MAV_RESULT_IN_PROGRESS);
        }
        // In the spool-up the floor still carries the vehicle.
        if self.mode.has_thrust() && self.mode != Mode::Spool && !forced {
            return refuse(
                R::MAV_RESULT_DENIED,
                "disarming in the air refused: land, or force it with 21196",
            );
        }
        self.arm_asker = Some(asker);
        if !self.fire(at, Event::DisarmAsked) || forced {
            self.board.command_arm(false, forced, at);
        }
        Ok(R::MAV_RESULT_IN_PROGRESS)
    }

    /// Asks for an event; modes in `already` count as granted.
    fn ask(&mut self, at: HostTime, event: Event, already: &[Mode]) -> Answer {
        if already.contains(&self.mode) || self.fire(at, event) {
            return Ok(MavResult::MAV_RESULT_ACCEPTED);
        }
        if matches!(event, Event::HoldAsked | Event::LandAsked) && !self.mode.has_thrust() {
            // On the floor it is granted: nothing moves, and a waiting take-off is called off.
            self.call_off_lift_off();
            return Ok(MavResult::MAV_RESULT_ACCEPTED);
        }
        let what = match event {
            Event::GotoAsked => "flying to a point",
            Event::MissionAsked => "mission",
            Event::OffboardAsked => "offboard",
            Event::ReturnAsked => "return",
            Event::HoldAsked => "hold",
            Event::LandAsked => "landing",
            _ => "this",
        };
        let mode = self.mode.name();
        let hint = if self.mode.has_thrust() { "" } else { ": take off first" };
        refuse(
            MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            format!("{what} refused while {mode}{hint}"),
        )
    }

    fn ask_takeoff(&mut self, at: HostTime, height_m: f64) -> Answer {
        let top_m = self.guidance.volume().height_m;
        if !(0.3..=top_m).contains(&height_m) {
            return refuse(
                MavResult::MAV_RESULT_DENIED,
                format!("take-off height = {height_m:.2}, allowed 0.3 to {top_m:.1} m"),
            );
        }
        match self.mode {
            Mode::Disarmed | Mode::Arming | Mode::Idle => {
                self.guidance.set_takeoff_height(height_m);
                self.guidance.mission_waits = false;
                self.lift_off_asked = true;
                if self.mode == Mode::Disarmed {
                    self.say(at, Severity::Info, "takes off when armed".to_owned());
                }
                Ok(MavResult::MAV_RESULT_ACCEPTED)
            }
            _ => refuse(
                MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                format!("take-off refused while {}", self.mode.name()),
            ),
        }
    }

    fn ask_mission(&mut self, at: HostTime) -> Answer {
        if self.mission.items.is_empty() {
            return refuse(MavResult::MAV_RESULT_DENIED, "no mission: upload one first");
        }
        if usize::from(self.guidance.current_item) >= self.mission.items.len() {
            self.guidance.set_current_item(0);
        }
        match self.mode {
            Mode::Disarmed | Mode::Arming | Mode::Idle => {
                let height_m =
                    self.mission.takeoff_height_m().unwrap_or(self.config.flight.takeoff_height_m);
                self.guidance.set_takeoff_height(height_m);
                self.guidance.mission_waits = true;
                self.lift_off_asked = true;
                Ok(MavResult::MAV_RESULT_ACCEPTED)
            }
            Mode::Spool | Mode::Takeoff => {
                self.guidance.mission_waits = true;
                Ok(MavResult::MAV_RESULT_ACCEPTED)
            }
            _ => self.ask(at, Event::MissionAsked, &[Mode::Mission]),
        }
    }

    pub(super) fn set_current_item(&mut self, index: f64) -> Answer {
        let count = self.mission.items.len();
        if !(index >= 0.0 && index < count as f64) {
            return refuse(
                MavResult::MAV_RESULT_DENIED,
                format!("mission item {index}: the mission has {count} items"),
            );
        }
        self.guidance.set_current_item(index as u16);
        Ok(MavResult::MAV_RESULT_ACCEPTED)
    }

    pub(super) fn set_custom_mode(&mut self, at: HostTime, custom_mode: u32) -> Answer {
        let is = |mode: Mode| custom_mode == mode.custom_mode();
        if is(Mode::Hold) {
            self.ask(at, Event::HoldAsked, &[Mode::Hold])
        } else if is(Mode::Mission) {
            self.ask_mission(at)
        } else if is(Mode::Takeoff) {
            self.ask_takeoff(at, self.config.flight.takeoff_height_m)
        } else if is(Mode::Return) {
            self.ask(at, Event::ReturnAsked, &[Mode::Return])
        } else if is(Mode::Land) {
            self.ask(at, Event::LandAsked, &[Mode::Land, Mode::Descend])
        } else if is(Mode::Offboard) {
            let limit_s = self.config.limits.offboard_loss_s;
            let fresh = self
                .guidance
                .setpoint
                .as_ref()
                .is_some_and(|s| at.seconds_since(s.received_at) < limit_s);
            if !fresh {
                return refuse(
                    MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                    "offboard refused: send setpoints first",
                );
            }
            self.refused_setpoint_told = false;
            self.ask(at, Event::OffboardAsked, &[Mode::Offboard])
        } else {
            refuse(MavResult::MAV_RESULT_DENIED, format!("no mode with number {custom_mode}"))
        }
    }

    fn reposition(&mut self, at: HostTime, request: &Request) -> Answer {
        use MavResult as R;
        let [x, y, z] = request.point;
        match request.frame {
            // Pause, as one client says it: no point at all.
            None if x.is_nan() && y.is_nan() && z.is_nan() => {
                self.ask(at, Event::HoldAsked, &[Mode::Hold])
            }
            Some(MavFrame::MAV_FRAME_LOCAL_NED) => {
                if self.estimate.health == Health::NotAligned {
                    return refuse(R::MAV_RESULT_TEMPORARILY_REJECTED, "estimator not aligned");
                }
                let point = Vec3::new(x, y, z);
                if !point.is_finite() || !self.guidance.volume().contains(point) {
                    return refuse(
                        R::MAV_RESULT_DENIED,
                        format!("N {x:.2} E {y:.2} height {:.2} m is outside the limits", -z),
                    );
                }
                let answer = self.ask(at, Event::GotoAsked, &[Mode::Goto])?;
                if self.mode == Mode::Goto {
                    let yaw = f64::from(request.params[3]);
                    self.guidance.fly_to(point, yaw.is_finite().then_some(yaw));
                }
                Ok(answer)
            }
            Some(_) => refuse(
                R::MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME,
                "point refused: only LOCAL_NED is supported",
            ),
            None => refuse(R::MAV_RESULT_COMMAND_INT_ONLY, "point refused: send COMMAND_INT"),
        }
    }

    fn send_version(&mut self, link: LinkId) {
        use MavProtocolCapability as C;
        let number = |text: &str| text.parse::<u32>().unwrap_or(0) & 0xFF;
        let flight_sw_version = number(env!("CARGO_PKG_VERSION_MAJOR")) << 24
            | number(env!("CARGO_PKG_VERSION_MINOR")) << 16
            | number(env!("CARGO_PKG_VERSION_PATCH")) << 8;
        let version = MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
            capabilities: C::MAV_PROTOCOL_CAPABILITY_MISSION_INT
                | C::MAV_PROTOCOL_CAPABILITY_COMMAND_INT
                | C::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
                | C::MAV_PROTOCOL_CAPABILITY_MAVLINK2,
            uid: 0,
            flight_sw_version,
            middleware_sw_version: 0,
            os_sw_version: 0,
            board_version: 0,
            vendor_id: 0,
            product_id: 0,
            flight_custom_version: [0; 8],
            middleware_custom_version: [0; 8],
            os_custom_version: [0; 8],
            uid2: [0; 18],
        });
        self.out.message(link, OWN, &version);
    }
}

/// AUTOPILOT_VERSION.
const AUTOPILOT_VERSION_ID: u32 = 148;
