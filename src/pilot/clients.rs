//! What clients say: frames of the ground endpoints, setpoints among them. The commands are in
//! `commands`, what is fetched and stored in `services`.

use haltere_dialect::mav::haltere::{
    MavCmd, MavFrame, MavMessage, MavMissionResult, MavMissionType, MavResult,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use haltere_dialect::mav_stream::{self, MavLoss};

use haltere_core::drops::{DropReason, Drops};
use haltere_core::time::HostTime;

use super::commands::Request;
use super::mission_transfer::ack;
use super::modes::Mode;
use super::place::{Location, WIRE_DEG};
use super::setpoint::{Owner, Setpoint, setpoint_from_global};
use super::{LinkId, OWN, Pilot, Severity, reference};

/// HEARTBEAT and CURRENT_MODE.
const HEARTBEAT_ID: u32 = 0;
const CURRENT_MODE_ID: u32 = 436;
/// COMMAND_LONG, COMMAND_INT and COMMAND_ACK, for commands that the dialect has no name for.
const COMMAND_LONG_ID: u32 = 76;
const COMMAND_INT_ID: u32 = 75;
const COMMAND_ACK_ID: u32 = 77;
/// Where the number of the command stands in either message; behind it the target, then the frame.
const COMMAND_AT: usize = 28;
/// `current` of a mission item that is a goal for now, and one of which only the height counts:
/// ArduPilot's older way to fly to a point, which DroneKit uses.
const GUIDED_POINT: u8 = 2;
const GUIDED_HEIGHT: u8 = 3;

/// Whether a message of this id carries a command.
pub(super) fn is_command(msg_id: u32) -> bool {
    matches!(msg_id, COMMAND_LONG_ID | COMMAND_INT_ID)
}

/// Target of a command that does not decode.
fn command_target(payload: &[u8]) -> (u8, u8) {
    let byte = |i: usize| payload.get(i).copied().unwrap_or_default();
    (byte(COMMAND_AT + 2), byte(COMMAND_AT + 3))
}

/// Counts what a splitter lost.
pub(super) fn count_frame<T>(drops: &mut Drops, next: &Result<T, MavLoss>) {
    if let Err(loss) = next {
        match loss {
            MavLoss::GarbageBytes(n) => drops.add(DropReason::MavGarbageByte, *n as u64),
            MavLoss::BadChecksum { .. } => drops.add(DropReason::MavBadChecksum, 1),
            MavLoss::UnknownId { .. } => drops.add(DropReason::MavUnknownId, 1),
            MavLoss::Undecodable { .. } => drops.add(DropReason::MavUndecodable, 1),
            MavLoss::Incompatible => drops.add(DropReason::MavIncompatible, 1),
        }
    }
}

impl Pilot {
    pub(super) fn ground_bytes(&mut self, at: HostTime, n: u8, bytes: &[u8]) {
        let index = usize::from(n);
        let Some(ground) = self.grounds.get_mut(index) else { return };
        if !ground.is_open {
            ground.open(at);
        }
        ground.heard_at = at;
        ground.counts.received_B = ground.counts.received_B.saturating_add(bytes.len() as u64);
        ground.splitter.push(bytes);
        self.answering = true;
        self.ground_frames(at, index);
        self.answering = false;
    }

    pub(super) fn ground_frames(&mut self, at: HostTime, index: usize) {
        let link = self.grounds[index].link;
        // The splitter is taken out while its frames are handled by the rest of the core.
        let mut splitter = std::mem::take(&mut self.grounds[index].splitter);
        while let Some(next) = splitter.next() {
            count_frame(self.drops_of(link), &next);
            let Ok(frame) = next else { continue };
            let header = frame.header;
            let heard_before = self.grounds[index].has_heard(header.system_id, header.component_id);
            let missing =
                self.grounds[index].missing(header.system_id, header.component_id, header.sequence);
            self.drops_of(link).add(DropReason::MavSequenceGap, missing);
            if !heard_before {
                self.tell_lost(at, link);
                self.tell_recording(at, link);
            }
            let peer = (header.system_id, header.component_id);
            let decoded = frame.decode();
            let target = match &decoded {
                Ok(message) => mav_stream::target(message),
                Err(MavLoss::Undecodable { .. }) if is_command(header.msg_id) => {
                    command_target(frame.payload)
                }
                Err(_) => (0, 0),
            };
            let passed = self.route_from_ground(at, index, &frame, decoded.as_ref().ok(), target);
            match decoded {
                Ok(_) | Err(MavLoss::Undecodable { .. }) if !self.is_for_us(target) => {
                    self.drops_of(link).add(DropReason::MavWrongPeer, 1);
                    if !passed {
                        let what = (header.msg_id, decoded.as_ref().ok());
                        self.tell_misaddressed(at, link, target, what);
                    }
                }
                Ok(message) if self.is_refused(at, link, peer, &message) => {}
                Ok(message) => self.ground_message(at, link, peer, message),
                Err(MavLoss::Undecodable { .. }) if is_command(header.msg_id) => {
                    self.answer_unknown_command(link, peer, header.msg_id, frame.payload);
                }
                Err(loss) => count_frame::<()>(self.drops_of(link), &Err(loss)),
            }
        }
        // A new link has a splitter of its own only if it was opened meanwhile, which frames cannot.
        self.grounds[index].splitter = splitter;
    }

    /// A command number or frame that the dialect does not know makes the whole message undecodable,
    /// but its sender waits for an answer.
    fn answer_unknown_command(
        &mut self,
        link: LinkId,
        peer: (u8, u8),
        msg_id: u32,
        payload: &[u8],
    ) {
        // Trailing zeros are cut on the wire.
        let byte = |i: usize| payload.get(i).copied().unwrap_or_default();
        let number = [byte(COMMAND_AT), byte(COMMAND_AT + 1)];
        let unknown_frame =
            msg_id == COMMAND_INT_ID && byte(COMMAND_AT + 4) > MavFrame::MAV_FRAME_LOCAL_FLU as u8;
        let result = if unknown_frame {
            MavResult::MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME
        } else {
            MavResult::MAV_RESULT_UNSUPPORTED
        };
        // COMMAND_ACK: command u16, result u8, progress u8, result_param2 i32, target u8 u8.
        let fields = [number[0], number[1], result as u8, 0, 0, 0, 0, 0, peer.0, peer.1];
        self.out.payload(link, OWN, COMMAND_ACK_ID, &fields);
    }

    fn is_for_us(&self, (system, component): (u8, u8)) -> bool {
        (system == 0 || system == OWN.system_id)
            && (component == 0 || component == OWN.component_id)
    }

    /// One message that is for us or for everyone.
    fn ground_message(&mut self, at: HostTime, link: LinkId, peer: (u8, u8), message: MavMessage) {
        if self.service_message(at, link, peer, &message) {
            return;
        }
        match message {
            MavMessage::COMMAND_LONG(m) => self.answer(
                at,
                Request {
                    link,
                    peer,
                    command: m.command,
                    params: [m.param1, m.param2, m.param3, m.param4],
                    location: Location::Float {
                        x: f64::from(m.param5),
                        y: f64::from(m.param6),
                        z: f64::from(m.param7),
                        frame: None,
                    },
                },
            ),
            MavMessage::COMMAND_INT(m) => self.answer(
                at,
                Request {
                    link,
                    peer,
                    command: m.command,
                    params: [m.param1, m.param2, m.param3, m.param4],
                    location: Location::Int { x: m.x, y: m.y, z: f64::from(m.z), frame: m.frame },
                },
            ),
            MavMessage::SET_MODE(m) => {
                // No acknowledgement in this message: the heartbeat is the answer.
                if let Err((_, why)) = self.set_custom_mode(at, m.custom_mode) {
                    self.say(at, Severity::Warning, why);
                }
                self.send_telemetry(at, link, HEARTBEAT_ID);
                self.send_telemetry(at, link, CURRENT_MODE_ID);
            }
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) => {
                self.take_setpoint(at, (link, peer), Ok(m));
            }
            MavMessage::SET_POSITION_TARGET_GLOBAL_INT(m) => {
                let local = setpoint_from_global(&m, &self.origin);
                self.take_setpoint(at, (link, peer), local);
            }
            MavMessage::SET_ATTITUDE_TARGET(_) => {
                // A tilt without a position knows no walls: the limits of the volume could not hold.
                let why = "SET_ATTITUDE_TARGET refused: send positions or velocities".to_owned();
                self.refuse_setpoint(at, link, why);
            }
            MavMessage::MANUAL_CONTROL(m) => self.manual_control(at, (link, peer), &m),
            MavMessage::SET_GPS_GLOBAL_ORIGIN(m) => {
                let alt_m = f64::from(m.altitude) * 1e-3;
                if let Err((_, why)) = self.set_origin(at, m.latitude, m.longitude, alt_m) {
                    self.say(at, Severity::Warning, why);
                }
            }
            MavMessage::SET_HOME_POSITION(m) => {
                let [lat, lon] = [m.latitude, m.longitude].map(|w| f64::from(w) * WIRE_DEG);
                if let Err((_, why)) = self.set_home(at, self.room_from_deg(lat, lon)) {
                    self.say(at, Severity::Warning, why);
                }
            }
            MavMessage::REQUEST_DATA_STREAM(m) => {
                let rate_hz = f64::from(m.req_message_rate);
                if let Some(ground) = self.ground_mut(link) {
                    ground.streams.set_group(m.req_stream_id, rate_hz, m.start_stop == 1, at);
                }
            }
            MavMessage::MISSION_ITEM(m)
                if m.current == GUIDED_POINT || m.current == GUIDED_HEIGHT =>
            {
                let location = Location::Float {
                    x: f64::from(m.x),
                    y: f64::from(m.y),
                    z: f64::from(m.z),
                    frame: Some(m.frame),
                };
                let height_only = m.current == GUIDED_HEIGHT;
                self.guided_item(at, (link, peer), location, height_only);
            }
            MavMessage::MISSION_ITEM_INT(m)
                if m.current == GUIDED_POINT || m.current == GUIDED_HEIGHT =>
            {
                let z = f64::from(m.z);
                let location = Location::Int { x: m.x, y: m.y, z, frame: m.frame };
                let height_only = m.current == GUIDED_HEIGHT;
                self.guided_item(at, (link, peer), location, height_only);
            }
            MavMessage::TIMESYNC(m) if m.tc1 == 0 => {
                let mut echo = m;
                echo.tc1 = at.as_us().cast_signed().saturating_mul(1000);
                echo.target_system = peer.0;
                echo.target_component = peer.1;
                self.out.message(link, OWN, &MavMessage::TIMESYNC(echo));
            }
            MavMessage::PING(m) if m.target_system == 0 && m.target_component == 0 => {
                let mut echo = m;
                echo.target_system = peer.0;
                echo.target_component = peer.1;
                self.out.message(link, OWN, &MavMessage::PING(echo));
            }
            MavMessage::COMMAND_CANCEL(m) => self.cancel(at, link, peer, m.command),
            MavMessage::HEARTBEAT(_) => self.supervisor.heard.station_at = Some(at),
            other => match reference::from_message(&other) {
                Some(Ok(pose)) => {
                    // A ground station's clock is not ours: true when it came.
                    let pose = pose.stamped(at, at);
                    self.estimator.reference(&pose); // fuses only if it is configured to
                    self.record(|| haltere_core::topics::Topic::Reference(pose));
                }
                Some(Err(())) => self.drops_of(link).add(DropReason::BadValue, 1),
                None => self.drops_of(link).add(DropReason::MavIgnored, 1),
            },
        }
    }

    /// A setpoint of an offboard client. While one flies, another is not listened to.
    fn take_setpoint(
        &mut self,
        at: HostTime,
        from: Owner,
        message: Result<SET_POSITION_TARGET_LOCAL_NED_DATA, String>,
    ) {
        let limit_s = self.config.limits.offboard_loss_s;
        let is_fresh = |s: &Setpoint| at.seconds_since(s.received_at) < limit_s;
        let flying = self.mode == Mode::Offboard;
        let last = self.guidance.setpoint.as_ref().filter(|s| flying || is_fresh(s));
        let other = last.is_some_and(|s| flying && is_fresh(s) && s.owner != Some(from));
        let checked = match message {
            Ok(_) if other => Err("setpoint refused: another client flies".to_owned()),
            Ok(m) => Setpoint::from_wire(&m, &self.estimate, last, at),
            Err(why) => Err(why),
        };
        let volume = self.guidance.volume();
        let checked = checked.and_then(|setpoint| setpoint.check(volume).map(|()| setpoint));
        match checked {
            Ok(mut setpoint) => {
                setpoint.owner = Some(from);
                self.guidance.setpoint = Some(setpoint);
            }
            Err(why) => self.refuse_setpoint(at, from.0, why),
        }
    }

    /// A goal written as a mission item.
    fn guided_item(
        &mut self,
        at: HostTime,
        (link, peer): Owner,
        location: Location,
        height_only: bool,
    ) {
        let command = MavCmd::MAV_CMD_DO_REPOSITION;
        let request = Request { link, peer, command, params: [f32::NAN; 4], location };
        let answer = self.wanted(&request).and_then(|wanted| {
            let horizontal_m = wanted.horizontal_m.filter(|_| !height_only);
            self.go_to(at, horizontal_m, wanted.height_m, None)
        });
        let result = match answer {
            Ok(_) => MavMissionResult::MAV_MISSION_ACCEPTED,
            Err((_, why)) => {
                self.say(at, Severity::Warning, why);
                MavMissionResult::MAV_MISSION_DENIED
            }
        };
        let mission_type = MavMissionType::MAV_MISSION_TYPE_MISSION;
        self.out.message(link, OWN, &ack(peer, mission_type, result, 0));
    }
}
