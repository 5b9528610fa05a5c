//! What clients say: frames of the links to stations, setpoints and goals among them. The rows of messages are in
//! `said`, those of commands in `ordered`.

use haltere_dialect::mav::haltere::{
    MANUAL_CONTROL_DATA, MISSION_ITEM_DATA, MISSION_ITEM_INT_DATA, MavCmd, MavMissionResult,
    MavMissionType, SET_POSITION_TARGET_GLOBAL_INT_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use haltere_dialect::mav_stream;

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;

use super::act::Act;
use super::act::Heard;
use super::said;
use crate::flight::modes::Mode;
use crate::flight::place::Location;
use crate::flight::setpoint::{Owner, Setpoint, setpoint_from_global};
use crate::navigation::reference;
use crate::out::losses::count_frame;
use crate::out::voice::Severity;
use crate::stations::commands::Request;
use crate::stations::mission_transfer::ack;
use crate::view::view;

/// `current` of a mission item that is a goal for now, and one of which only the height counts:
/// ArduPilot's older way to fly to a point, which DroneKit uses.
const GUIDED_POINT: u8 = 2;
const GUIDED_HEIGHT: u8 = 3;

impl Act<'_> {
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
                self.stations.tell_lost(at, link, self.out);
                self.out.tell_recording(at, link);
            }
            let peer = (header.system_id, header.component_id);
            let decoded = frame.decode();
            let target = decoded.as_ref().map_or((0, 0), mav_stream::target);
            let passed = self.route_from_ground(at, index, &frame, decoded.as_ref().ok(), target);
            if decoded.is_ok() {
                let waits = said::row(header.msg_id).is_some_and(|row| row.waits);
                let out = &mut *self.out;
                self.stations.note_addressee(at, index, target, waits, passed, out);
            }
            match decoded {
                Ok(_) if !self.is_for_us(target) => {
                    self.out.lose(link, DropReason::MavWrongPeer, 1);
                }
                Ok(message) => {
                    let id = header.msg_id;
                    self.hear(&Heard { at, link, peer, id, message: &message }, target);
                }
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
    fn hear(&mut self, heard: &Heard<'_>, target: (u8, u8)) {
        let Heard { at, link, peer, .. } = *heard;
        let looks = said::looks(heard.id, heard.message);
        if !self.stations.may_say(link, peer.0, looks) {
            self.out.lose(link, DropReason::NotPermitted, 1);
            if let Some(answer) = self.refusal_of(heard) {
                self.out.message(link, &answer);
            }
            self.stations.note_refused(at, (link, peer), target, self.out);
        } else if !self.obey(heard) {
            self.out.lose(link, DropReason::MavIgnored, 1);
        }
    }

    /// A pose of motion capture.
    pub(crate) fn take_reference(&mut self, heard: &Heard<'_>) -> bool {
        match reference::from_message(heard.message) {
            Some(Ok(pose)) => {
                // A ground station's clock is not ours: true when it came.
                let pose = pose.stamped(heard.at, heard.at);
                self.navigation.estimator.reference(&pose); // fuses only if it is configured to
                self.out.record(|| Topic::Reference(pose));
            }
            Some(Err(())) => self.out.lose(heard.link, DropReason::BadValue, 1),
            None => return false,
        }
        true
    }

    /// The sticks of a joystick.
    pub(crate) fn joystick(&mut self, heard: &Heard<'_>, sticks: &MANUAL_CONTROL_DATA) {
        let (view, out) = (view!(self, heard.at), &mut *self.out);
        self.flight.manual_control(&view, (heard.link, heard.peer), sticks, out);
    }

    /// A setpoint of an offboard client. While one flies, another is not listened to.
    pub(crate) fn take_setpoint(
        &mut self,
        heard: &Heard<'_>,
        message: Result<SET_POSITION_TARGET_LOCAL_NED_DATA, String>,
    ) {
        let (at, from): (HostTime, Owner) = (heard.at, (heard.link, heard.peer));
        let limit_s = self.config.limits.offboard_loss_s;
        let is_fresh = |s: &Setpoint| at.seconds_since(s.received_at) < limit_s;
        let flying = self.flight.mode == Mode::Offboard;
        let last = self.flight.guidance.setpoint.as_ref().filter(|s| flying || is_fresh(s));
        let other = last.is_some_and(|s| flying && is_fresh(s) && s.owner != Some(from));
        let checked = match message {
            Ok(_) if other => Err("setpoint refused: another client flies".to_owned()),
            // Nothing is held before it flies: what came on the floor would lead back there.
            Ok(m) => Setpoint::from_wire(&m, self.estimate, last.filter(|_| flying), at),
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
                self.stations.tell_unobeyed(at, self.flight, self.out);
            }
            Err(why) => self.out.refuse_setpoint(at, from.0, why),
        }
    }

    pub(crate) fn take_global_setpoint(
        &mut self,
        heard: &Heard<'_>,
        m: &SET_POSITION_TARGET_GLOBAL_INT_DATA,
    ) {
        let local = setpoint_from_global(m, self.origin);
        self.take_setpoint(heard, local);
    }

    pub(crate) fn guided_item(&mut self, heard: &Heard<'_>, m: &MISSION_ITEM_DATA) -> bool {
        let [x, y, z] = [m.x, m.y, m.z].map(f64::from);
        let location = Location::Float { x, y, z, frame: Some(m.frame) };
        self.fly_to_item(heard, m.current, location)
    }

    pub(crate) fn guided_item_int(&mut self, heard: &Heard<'_>, m: &MISSION_ITEM_INT_DATA) -> bool {
        let location = Location::Int { x: m.x, y: m.y, z: f64::from(m.z), frame: m.frame };
        self.fly_to_item(heard, m.current, location)
    }

    /// A goal written as a mission item. `false`: it is none.
    fn fly_to_item(&mut self, heard: &Heard<'_>, current: u8, location: Location) -> bool {
        if current != GUIDED_POINT && current != GUIDED_HEIGHT {
            return false;
        }
        let Heard { at, link, peer, .. } = *heard;
        let height_only = current == GUIDED_HEIGHT;
        let command = MavCmd::MAV_CMD_DO_REPOSITION;
        let request = Request { link, peer, command, params: [f32::NAN; 4], location };
        let answer = self.stations.wanted(self.origin, &request).and_then(|wanted| {
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
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Bench;
    use crate::config::PilotConfig;
    use crate::input::LinkId;
    use crate::stations::clients::NO_SHELL;
    use haltere_dialect::mav::haltere::{
        COMMAND_INT_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MISSION_CLEAR_ALL_DATA,
        MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MISSION_REQUEST_LIST_DATA, MavParamError,
        MavResult, PARAM_SET_DATA,
    };
    use haltere_dialect::mav::haltere::{MavMessage, SERIAL_CONTROL_DATA, SerialControlFlag};

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
        let is_ours = |m: &SERIAL_CONTROL_DATA| m.data.starts_with(NO_SHELL);
        let refused = |m: &MavMessage| matches!(m, MavMessage::SERIAL_CONTROL(m) if is_ours(m));
        assert!(heard.iter().any(refused), "{heard:?}");
    }
}
