//! What clients say: frames of the ground endpoints, setpoints among them. The commands are in
//! `commands`, what is fetched and stored in `services`.

use haltere_dialect::mav::haltere::{
    MavCmd, MavMessage, MavMissionResult, MavMissionType, SERIAL_CONTROL_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA, SerialControlFlag,
};
use haltere_dialect::mav::known;
use haltere_dialect::mav_stream::{self};

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use super::commands::Request;
use super::mission_transfer::ack;
use super::streams;
use crate::Pilot;
use crate::flight::modes::Mode;
use crate::flight::place::{Location, WIRE_DEG};
use crate::flight::setpoint::{Owner, Setpoint, setpoint_from_global};
use crate::input::LinkId;
use crate::navigation::reference;
use crate::out::Out;
use crate::out::losses::count_frame;
use crate::out::voice::Severity;

/// What a shell says.
const NO_SHELL: &[u8] = b"haltere has no shell\r\n";
/// COMMAND_LONG and COMMAND_INT.
const COMMAND_LONG_ID: u32 = 76;
const COMMAND_INT_ID: u32 = 75;
/// `current` of a mission item that is a goal for now, and one of which only the height counts:
/// ArduPilot's older way to fly to a point, which DroneKit uses.
const GUIDED_POINT: u8 = 2;
const GUIDED_HEIGHT: u8 = 3;

/// Whether a message of this id carries a command.
pub(crate) fn is_command(msg_id: u32) -> bool {
    matches!(msg_id, COMMAND_LONG_ID | COMMAND_INT_ID)
}

impl Out {
    /// SERIAL_CONTROL: there is no shell, and whoever opens one reads so.
    fn refuse_shell(&mut self, link: LinkId, peer: (u8, u8), m: &SERIAL_CONTROL_DATA) {
        if m.flags.contains(SerialControlFlag::SERIAL_CONTROL_FLAG_REPLY) {
            return;
        }
        let mut data = [0; 70];
        data[..NO_SHELL.len()].copy_from_slice(NO_SHELL);
        let answer = MavMessage::SERIAL_CONTROL(SERIAL_CONTROL_DATA {
            device: m.device,
            flags: SerialControlFlag::SERIAL_CONTROL_FLAG_REPLY,
            count: NO_SHELL.len() as u8,
            data,
            target_system: peer.0,
            target_component: peer.1,
            ..Default::default()
        });
        self.message(link, &answer);
    }
}

impl Pilot {
    pub(crate) fn ground_bytes(&mut self, at: HostTime, n: u8, bytes: &[u8]) {
        let index = usize::from(n);
        let Some(ground) = self.stations.grounds.get_mut(index) else { return };
        if !self.out.is_open(ground.link) {
            ground.begin_anew(at);
            self.out.opens(ground.link, ground.wants_events());
        }
        ground.heard_at = at;
        ground.counts.received_B = ground.counts.received_B.saturating_add(bytes.len() as u64);
        ground.splitter.push(bytes);
        self.out.answering = true;
        self.ground_frames(at, index);
        self.out.answering = false;
    }

    pub(crate) fn ground_frames(&mut self, at: HostTime, index: usize) {
        let link = self.stations.grounds[index].link;
        // The splitter is taken out while its frames are handled by the rest of the core.
        let mut splitter = std::mem::take(&mut self.stations.grounds[index].splitter);
        while let Some(next) = splitter.next() {
            count_frame(self.out.drops_of(link), &next);
            let Ok(frame) = next else { continue };
            let header = frame.header;
            let heard_before =
                self.stations.grounds[index].has_heard(header.system_id, header.component_id);
            let missing = self.stations.grounds[index].missing(
                header.system_id,
                header.component_id,
                header.sequence,
            );
            self.out.lose(link, DropReason::MavSequenceGap, missing);
            if !heard_before {
                self.stations.tell_lost(at, link, &mut self.out);
                self.out.tell_recording(at, link);
            }
            let peer = (header.system_id, header.component_id);
            let decoded = frame.decode();
            let target = decoded.as_ref().map_or((0, 0), mav_stream::target);
            let passed = self.route_from_ground(at, index, &frame, decoded.as_ref().ok(), target);
            if let Ok(message) = &decoded {
                self.stations.note_addressee(
                    at,
                    index,
                    target,
                    (header.msg_id, message),
                    passed,
                    &mut self.out,
                );
            }
            match decoded {
                Ok(_) if !self.is_for_us(target) => {
                    self.out.lose(link, DropReason::MavWrongPeer, 1);
                }
                Ok(message) if self.is_refused(at, link, peer, &message) => {}
                Ok(message) => self.ground_message(at, link, peer, message),
                Err(loss) => count_frame::<()>(self.out.drops_of(link), &Err(loss)),
            }
        }
        // A new link has a splitter of its own only if it was opened meanwhile, which frames cannot.
        self.stations.grounds[index].splitter = splitter;
    }

    fn is_for_us(&self, (system, component): (u8, u8)) -> bool {
        (system == 0 || system == self.out.own.system_id)
            && (component == 0 || component == self.out.own.component_id)
    }

    /// One message that is for us or for everyone.
    fn ground_message(&mut self, at: HostTime, link: LinkId, peer: (u8, u8), message: MavMessage) {
        if self.service_message(at, link, peer, &message) {
            return;
        }
        match message {
            MavMessage::COMMAND_LONG(m) => {
                let location = Location::Float {
                    x: f64::from(m.param5),
                    y: f64::from(m.param6),
                    z: f64::from(m.param7),
                    frame: None,
                };
                let params = [m.param1, m.param2, m.param3, m.param4];
                self.answer(at, (link, peer), m.command, params, location);
            }
            MavMessage::COMMAND_INT(m) => {
                let z = f64::from(m.z);
                let location = Location::Int { x: m.x, y: m.y, z, frame: m.frame };
                let params = [m.param1, m.param2, m.param3, m.param4];
                self.answer(at, (link, peer), m.command, params, location);
            }
            MavMessage::SET_MODE(m) => {
                // No acknowledgement in this message: the heartbeat is the answer.
                if let Err((_, why)) = self.set_custom_mode(at, m.custom_mode) {
                    self.out.say(at, Severity::Warning, why);
                }
                self.send_telemetry(at, link, streams::HEARTBEAT);
                self.send_telemetry(at, link, streams::CURRENT_MODE);
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
                    self.out.say(at, Severity::Warning, why);
                }
            }
            MavMessage::SET_HOME_POSITION(m) => {
                let [lat, lon] = [m.latitude, m.longitude].map(|w| f64::from(w) * WIRE_DEG);
                if let Err((_, why)) = self.set_home(at, self.room_from_deg(lat, lon)) {
                    self.out.say(at, Severity::Warning, why);
                }
            }
            MavMessage::REQUEST_DATA_STREAM(m) => {
                let rate_hz = f64::from(m.req_message_rate);
                let group = known(m.req_stream_id);
                if let (Some(ground), Some(group)) = (self.stations.ground_mut(link), group) {
                    ground.streams.set_group(group, rate_hz, m.start_stop == 1, at);
                    self.out.sends_events(link, ground.wants_events());
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
                self.out.message(link, &MavMessage::TIMESYNC(echo));
            }
            MavMessage::PING(m) if m.target_system == 0 && m.target_component == 0 => {
                let mut echo = m;
                echo.target_system = peer.0;
                echo.target_component = peer.1;
                self.out.message(link, &MavMessage::PING(echo));
            }
            MavMessage::COMMAND_CANCEL(m) => self.cancel(at, link, peer, m.command),
            MavMessage::RADIO_STATUS(m) => {
                if let Some(ground) = self.stations.ground_mut(link) {
                    ground.streams.radio(m.txbuf, at);
                }
            }
            MavMessage::PLAY_TUNE(_) | MavMessage::PLAY_TUNE_V2(_) => {
                let text = "no tune is played: the vehicle has nothing that sounds".to_owned();
                self.out.say(at, Severity::Warning, text);
            }
            MavMessage::SERIAL_CONTROL(m) => self.out.refuse_shell(link, peer, &m),
            MavMessage::HEARTBEAT(_) => self.flight.supervisor.heard.station_at = Some(at),
            other => match reference::from_message(&other) {
                Some(Ok(pose)) => {
                    // A ground station's clock is not ours: true when it came.
                    let pose = pose.stamped(at, at);
                    self.navigation.estimator.reference(&pose); // fuses only if it is configured to
                    self.out.record(|| haltere_core::topics::Topic::Reference(pose));
                }
                Some(Err(())) => self.out.lose(link, DropReason::BadValue, 1),
                None => self.out.lose(link, DropReason::MavIgnored, 1),
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
        let flying = self.flight.mode == Mode::Offboard;
        let last = self.flight.guidance.setpoint.as_ref().filter(|s| flying || is_fresh(s));
        let other = last.is_some_and(|s| flying && is_fresh(s) && s.owner != Some(from));
        let checked = match message {
            Ok(_) if other => Err("setpoint refused: another client flies".to_owned()),
            // Nothing is held before it flies: what came on the floor would lead back there.
            Ok(m) => Setpoint::from_wire(&m, &self.estimate, last.filter(|_| flying), at),
            Err(why) => Err(why),
        };
        let volume = self.flight.guidance.volume();
        let checked = checked.and_then(|setpoint| setpoint.check(volume).map(|()| setpoint));
        match checked {
            Ok(mut setpoint) => {
                setpoint.owner = Some(from);
                let before = self
                    .flight
                    .guidance
                    .setpoint
                    .filter(|s| is_fresh(s) && s.owner == setpoint.owner);
                setpoint.since = before.map_or(at, |s| s.since);
                self.flight.guidance.setpoint = Some(setpoint);
                self.tell_unobeyed(at);
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
                self.out.say(at, Severity::Warning, why);
                MavMissionResult::MAV_MISSION_DENIED
            }
        };
        let mission_type = MavMissionType::MAV_MISSION_TYPE_MISSION as u8;
        self.out.message(link, &ack(peer, mission_type, result, 0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Bench;
    use crate::config::PilotConfig;
    use haltere_dialect::mav::haltere::{
        COMMAND_INT_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MISSION_CLEAR_ALL_DATA,
        MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MISSION_REQUEST_LIST_DATA, MavParamError,
        MavResult, PARAM_SET_DATA,
    };

    /// Values that our dialect's enums do not have, as clients of other vehicles send them: the whole message was
    /// thrown away for one of them, and an upload hung for 7.5 s.
    #[test]
    fn regress_values_that_the_dialect_does_not_know_are_answered() {
        use MavMissionResult as M;
        let mut bench = Bench::new(PilotConfig::default());
        let mut result_of = |message| {
            bench.says(&message).into_iter().find_map(|m| match m {
                MavMessage::COMMAND_ACK(ack) => Some((ack.command, ack.result)),
                _ => None,
            })
        };
        let long = COMMAND_LONG_DATA { command: 42_999, ..Default::default() };
        let unsupported = MavResult::MAV_RESULT_UNSUPPORTED as u8;
        assert_eq!(result_of(MavMessage::COMMAND_LONG(long)), Some((42_999, unsupported)));
        let command = MavCmd::MAV_CMD_DO_REPOSITION as u16;
        let int = COMMAND_INT_DATA { command, frame: 99, ..Default::default() };
        let frame = MavResult::MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME as u8;
        assert_eq!(result_of(MavMessage::COMMAND_INT(int)), Some((command, frame)));

        let mut refused_with = |message| {
            bench.says(&message).into_iter().find_map(|m| match m {
                MavMessage::MISSION_ACK(ack) => Some((ack.mission_type, ack.mavtype)),
                _ => None,
            })
        };
        let waypoint = MavCmd::MAV_CMD_NAV_WAYPOINT as u16;
        for (command, frame, result) in [
            (83, 0, M::MAV_MISSION_UNSUPPORTED),
            (215, 0, M::MAV_MISSION_UNSUPPORTED),
            (217, 0, M::MAV_MISSION_UNSUPPORTED),
            (42_703, 0, M::MAV_MISSION_UNSUPPORTED),
            (waypoint, 99, M::MAV_MISSION_UNSUPPORTED_FRAME),
        ] {
            let count = MISSION_COUNT_DATA { count: 2, ..Default::default() };
            assert_eq!(refused_with(MavMessage::MISSION_COUNT(count)), None);
            let item = MISSION_ITEM_INT_DATA { command, frame, z: 1.0, ..Default::default() };
            let refused = refused_with(MavMessage::MISSION_ITEM_INT(item));
            assert_eq!(refused, Some((0, result as u8)), "{command} {frame}");
        }
        let no_list = Some((77, M::MAV_MISSION_UNSUPPORTED as u8));
        let mission_type = 77;
        let count = MISSION_COUNT_DATA { mission_type, count: 1, ..Default::default() };
        assert_eq!(refused_with(MavMessage::MISSION_COUNT(count)), no_list);
        let list = MISSION_REQUEST_LIST_DATA { mission_type, ..Default::default() };
        assert_eq!(refused_with(MavMessage::MISSION_REQUEST_LIST(list)), no_list);
        let clear = MISSION_CLEAR_ALL_DATA { mission_type, ..Default::default() };
        assert_eq!(refused_with(MavMessage::MISSION_CLEAR_ALL(clear)), no_list);

        for param_type in [0, 12] {
            let param_id = "FLT_TKO_HGT".into();
            let set = PARAM_SET_DATA { param_id, param_type, ..Default::default() };
            let mismatch = bench.says(&MavMessage::PARAM_SET(set)).into_iter().any(|m| {
                let wanted = MavParamError::MAV_PARAM_ERROR_TYPE_MISMATCH;
                matches!(m, MavMessage::PARAM_ERROR(e) if e.error == wanted)
            });
            assert!(mismatch, "{param_type}");
        }
        let beat = HEARTBEAT_DATA { mavtype: 250, autopilot: 250, ..Default::default() };
        bench.says(&MavMessage::HEARTBEAT(beat));
        assert_eq!(bench.pilot.flight.supervisor.heard.station_at, Some(bench.now));
        let lost = &bench.pilot.drops()[usize::from(LinkId::Ground(0).number())];
        assert_eq!(lost.count(DropReason::MavUndecodable), 0);
    }

    #[test]
    fn regress_a_tune_and_a_shell_are_answered() {
        let mut bench = Bench::new(PilotConfig::default());
        let tune = haltere_dialect::mav::haltere::PLAY_TUNE_V2_DATA {
            target_system: 1,
            format: 9,
            ..Default::default()
        };
        let heard = bench.says(&MavMessage::PLAY_TUNE_V2(tune));
        assert!(heard.iter().any(|m| matches!(m, MavMessage::STATUSTEXT(_))), "{heard:?}");
        let flags = SerialControlFlag::SERIAL_CONTROL_FLAG_RESPOND;
        let shell = SERIAL_CONTROL_DATA { device: 10, flags, count: 3, ..Default::default() };
        let heard = bench.says(&MavMessage::SERIAL_CONTROL(shell));
        let refused = |m: &MavMessage| matches!(m, MavMessage::SERIAL_CONTROL(m) if m.data.starts_with(NO_SHELL));
        assert!(heard.iter().any(refused), "{heard:?}");
    }
}
