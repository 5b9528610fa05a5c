//! Frames that are for others: between stations, and where wanted between stations and board.
//!
//! They pass as they came, with their sender's sequence number and signature, also those that our
//! dialect does not know. No frame goes back to where its sender was heard, so two ways to one
//! station make no loop; nor is one passed on again within 0.8 s (`passed_on`), so a bridge between two endpoints
//! multiplies nothing.

use haltere_dialect::mav_stream::MavFrame;
use haltere_dialect::signing::SIGNATURE_BYTES;

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use super::Stations;
use super::endpoint::Routing;
use crate::board::link::BoardLink;
use crate::input::LinkId;
use crate::out::Out;

/// Number of the board's system, where it may be reached from the ground.
pub(crate) fn routed_board(routing: Routing, link: &BoardLink, out: &Out) -> Option<u8> {
    let board = link.system_id()?;
    (routing == Routing::Board && board != out.own.system_id).then_some(board)
}

impl Stations {
    /// Passes on a frame from the board's line, unless it is one of those we asked for.
    pub(crate) fn route_from_board(
        &mut self,
        at: HostTime,
        routing: Routing,
        link: &BoardLink,
        frame: &MavFrame<'_>,
        out: &mut Out,
    ) {
        let Some(board) = routed_board(routing, link, out) else { return };
        if link.is_own_stream(frame.header.msg_id) {
            return;
        }
        let target = frame.decode().map_or((0, 0), |m| haltere_dialect::mav_stream::target(&m));
        if target.0 == board {
            return;
        }
        let again = out.passed_on.is_again(at, frame.raw);
        let passed = self.route_to_stations(None, frame, target, again, out);
        out.note_passed(at, LinkId::Board, frame, again, passed);
    }

    /// Passes a frame on to the stations that it is for. Whether there are any; `again`: it went already.
    pub(crate) fn route_to_stations(
        &mut self,
        from: Option<usize>,
        frame: &MavFrame<'_>,
        target: (u8, u8),
        again: bool,
        out: &mut Out,
    ) -> bool {
        let header = frame.header;
        let mut passed = false;
        for n in 0..self.grounds.len() {
            let ground = &self.grounds[n];
            let wanted = out.is_open(ground.link)
                && Some(n) != from
                && !ground.has_heard(header.system_id, header.component_id)
                && (target.0 == 0 || ground.has_heard_system(target.0));
            if !wanted {
                continue;
            }
            passed = true;
            if again {
                break;
            }
            let link = ground.link;
            if !ground.streams.has_room() {
                // The line is full: what is not ours goes first.
                out.lose(link, DropReason::OutputQueueFull, 1);
                continue;
            }
            out.raw(link, frame.raw);
            self.grounds[n].counts.routed += 1;
            self.settle(n, out);
        }
        passed
    }

    /// Books what was queued for a link.
    pub(crate) fn settle(&mut self, n: usize, out: &mut Out) {
        let Some(ground) = self.grounds.get_mut(n) else { return };
        let sent = out.take_sent(ground.link);
        let refused = out.take_refused(ground.link);
        out.lose(ground.link, DropReason::OutputQueueFull, refused);
        let signatures =
            if ground.endpoint.signs { SIGNATURE_BYTES as u64 * sent.frames } else { 0 };
        ground.streams.spend(sent.bytes.saturating_add(signatures as usize));
        ground.counts.sent = ground.counts.sent.saturating_add(sent.frames);
        ground.counts.sent_B = ground.counts.sent_B.saturating_add(sent.bytes as u64);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

    use super::*;
    use crate::Pilot;
    use crate::flight::modes::Mode;
    use haltere_dialect::mav::haltere::{
        COMMAND_LONG_DATA, MavCmd, MavMessage, PARAM_REQUEST_LIST_DATA,
    };

    use super::super::endpoint::Endpoint;
    use crate::config::PilotConfig;
    use crate::input::Input;
    use haltere_core::frames::Vec3;
    use haltere_core::measure::AnchorId;
    use haltere_core::survey::Survey;
    use haltere_dialect::mav::haltere::{HEARTBEAT_DATA, MavModeFlag};
    use haltere_dialect::mav_stream;

    fn pilot(routing: Routing) -> Pilot {
        let corner = |i: u8| {
            let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
        };
        let survey = Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        let config =
            PilotConfig { routing, endpoints: vec![Endpoint::default(); 2], ..Default::default() };
        let mut pilot = Pilot::new(config, survey, HostTime::from_us(1_000_000));
        for n in 0..2 {
            pilot.handle(HostTime::from_us(1_000_000), Input::LinkUp { link: LinkId::Ground(n) });
        }
        pilot.drain_output(|_, _| {});
        pilot
    }

    /// What comes out on each link when these bytes come in on one.
    fn pass(pilot: &mut Pilot, link: LinkId, bytes: &[u8]) -> Vec<(LinkId, Vec<u8>)> {
        pass_at(pilot, HostTime::from_us(1_001_000), link, bytes)
    }

    fn pass_at(
        pilot: &mut Pilot,
        at: HostTime,
        link: LinkId,
        bytes: &[u8],
    ) -> Vec<(LinkId, Vec<u8>)> {
        pilot.handle(at, Input::Bytes { link, bytes });
        let mut out = Vec::new();
        pilot.drain_output(|link, bytes| out.push((link, bytes.to_vec())));
        out
    }

    /// No two frames of a sender are alike within 256.
    fn sequence() -> u8 {
        static NEXT: AtomicU8 = AtomicU8::new(0);
        NEXT.fetch_add(1, Relaxed)
    }

    fn frame(system: u8, component: u8, message: &MavMessage) -> Vec<u8> {
        let mut bytes = Vec::new();
        mav_stream::encode(&mut bytes, system, component, sequence(), message);
        bytes
    }

    /// Of an id that no dialect of ours has.
    fn unknown(system: u8, component: u8) -> Vec<u8> {
        let mut bytes = Vec::new();
        mav_stream::encode_payload(&mut bytes, system, component, sequence(), 31_337, &[1, 2, 3]);
        bytes
    }

    fn beat(autopilot_id: u8) -> Vec<u8> {
        let base_mode = MavModeFlag::empty();
        let beat = HEARTBEAT_DATA { base_mode, ..Default::default() };
        frame(autopilot_id, 1, &MavMessage::HEARTBEAT(beat))
    }

    fn arm(system: u8) -> Vec<u8> {
        command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, system)
    }

    fn command(command: MavCmd, param1: f32, system: u8) -> Vec<u8> {
        let message = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: command as u16,
            param1,
            target_system: system,
            target_component: 1,
            ..Default::default()
        });
        frame(255, 190, &message)
    }

    #[test]
    fn prop_unknown_frames_pass_between_stations_and_never_back() {
        let mut pilot = pilot(Routing::Stations);
        let bytes = unknown(255, 190);
        let went = pass(&mut pilot, LinkId::Ground(0), &bytes);
        assert_eq!(went, [(LinkId::Ground(1), bytes.clone())]);
        // The same sender on both links: a loop, or one station with two ways.
        pass(&mut pilot, LinkId::Ground(1), &unknown(255, 190));
        assert!(!pass(&mut pilot, LinkId::Ground(0), &bytes).contains(&(LinkId::Ground(1), bytes)));
        // What claims to be us goes nowhere.
        assert_eq!(pass(&mut pilot, LinkId::Ground(0), &unknown(1, 1)), []);
        let mut off = super::tests::pilot(Routing::Off);
        assert_eq!(pass(&mut off, LinkId::Ground(0), &unknown(255, 190)), []);
    }

    #[test]
    fn regress_a_bridge_between_two_endpoints_multiplies_nothing() {
        for routing in [Routing::Stations, Routing::Board] {
            let mut pilot = pilot(routing);
            pass(&mut pilot, LinkId::Board, &beat(2));
            let mut circles = 0;
            // More systems than a link remembers, so that it is not their address that ends it.
            for n in 0..60_u8 {
                let bytes = unknown(100 + n, 1);
                let at = |ms: u64| HostTime::from_us(2_000_000 + 10_000 * u64::from(n) + 1000 * ms);
                let mut line = 0;
                let mut comes = pass_at(&mut pilot, at(0), LinkId::Ground(0), &bytes);
                for ms in 1..9 {
                    // The bridge gives back on the other line whatever is not ours.
                    let went: Vec<_> = comes.iter().filter(|(_, b)| *b == bytes).collect();
                    let to_board = went.iter().filter(|(link, _)| *link == LinkId::Board).count();
                    assert_eq!(to_board, usize::from(ms == 1 && routing == Routing::Board));
                    let to_stations = went.len() - to_board;
                    assert_eq!(to_stations, usize::from(ms == 1), "{n} {ms}");
                    circles += to_stations;
                    line = 1 - line;
                    comes = pass_at(&mut pilot, at(ms), LinkId::Ground(line), &bytes);
                }
            }
            assert_eq!(circles, 60);
            let drops = pilot.drops();
            let again =
                |link: LinkId| drops[usize::from(link.number())].count(DropReason::MavAgain);
            assert!(again(LinkId::Ground(1)) > 0 || again(LinkId::Ground(0)) > 0);
            // A second later, as the line delays it, the same bytes are another frame.
            let bytes = unknown(99, 1);
            let at = |ms: u64| HostTime::from_us(9_000_000 + 1000 * ms);
            let went = |pilot: &mut Pilot, ms: u64| {
                let all = pass_at(pilot, at(ms), LinkId::Ground(0), &bytes);
                all.iter().filter(|(link, b)| *link == LinkId::Ground(1) && *b == bytes).count()
            };
            assert_eq!([0, 700, 950, 1100].map(|ms| went(&mut pilot, ms)), [1, 0, 1, 0]);
        }
    }

    #[test]
    fn prop_a_board_with_our_number_is_not_routed_and_the_parameter_is_named() {
        let mut pilot = pilot(Routing::Board);
        let said = pass(&mut pilot, LinkId::Board, &beat(1));
        let text: Vec<u8> = said.iter().flat_map(|(_, bytes)| bytes.clone()).collect();
        let text = String::from_utf8_lossy(&text).into_owned();
        for word in ["routing to the board refused", "MAV_SYS_ID", "SYSID_THISMAV"] {
            assert!(text.contains(word), "{word}: {text}");
        }
        let went = pass(&mut pilot, LinkId::Ground(0), &unknown(255, 190));
        assert!(went.iter().all(|(link, _)| *link != LinkId::Board));
        // Nor is it with routing off by default.
        assert_eq!(PilotConfig::default().routing, Routing::Stations);
    }

    #[test]
    fn prop_the_board_is_reached_but_not_steered_while_we_are_in_control() {
        let mut pilot = pilot(Routing::Board);
        pass(&mut pilot, LinkId::Board, &beat(2));
        // Both ways, what we know and what we do not.
        let bytes = unknown(2, 1);
        let went = pass(&mut pilot, LinkId::Board, &bytes);
        assert_eq!(went.iter().filter(|(_, b)| *b == bytes).count(), 2, "{went:?}");
        let to_board = |pilot: &mut Pilot, bytes: &[u8]| {
            let went = pass(pilot, LinkId::Ground(0), bytes);
            went.contains(&(LinkId::Board, bytes.to_vec()))
        };
        assert!(to_board(&mut pilot, &unknown(255, 190)));
        // On the floor the board is anybody's.
        assert!(to_board(&mut pilot, &arm(2)));
        pilot.flight.mode = Mode::Hold;
        assert!(!to_board(&mut pilot, &arm(2)));
        assert!(to_board(&mut pilot, &unknown(255, 190)));
        // What is for us stays with us.
        assert!(!to_board(&mut pilot, &arm(1)));
    }

    #[test]
    fn regress_while_we_steer_no_command_reaches_the_board_but_those_that_ask() {
        use MavCmd as C;
        let mut pilot = pilot(Routing::Board);
        pass(&mut pilot, LinkId::Board, &beat(2));
        pilot.flight.mode = Mode::Hold;
        let to_board = |pilot: &mut Pilot, bytes: &[u8]| {
            let went = pass(pilot, LinkId::Ground(0), bytes);
            went.contains(&(LinkId::Board, bytes.to_vec()))
        };
        for kept in [
            C::MAV_CMD_INJECT_FAILURE,
            C::MAV_CMD_DO_SET_MODE,
            C::MAV_CMD_DO_FLIGHTTERMINATION,
            C::MAV_CMD_DO_MOTOR_TEST,
            C::MAV_CMD_ACTUATOR_TEST,
            C::MAV_CMD_DO_PARACHUTE,
            C::MAV_CMD_DO_SET_RELAY,
            C::MAV_CMD_PREFLIGHT_STORAGE,
            C::MAV_CMD_PREFLIGHT_CALIBRATION,
            C::MAV_CMD_PREFLIGHT_SET_SENSOR_OFFSETS,
            C::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
        ] {
            assert!(!to_board(&mut pilot, &command(kept, 1.0, 2)), "{kept:?}");
        }
        // A number that the dialect has no name for.
        let mut payload = [0; 33];
        payload[28..32].copy_from_slice(&[0x35, 0xED, 2, 1]);
        let mut bytes = Vec::new();
        mav_stream::encode_payload(&mut bytes, 255, 190, sequence(), 76, &payload);
        assert!(!to_board(&mut pilot, &bytes));
        assert!(to_board(&mut pilot, &command(C::MAV_CMD_REQUEST_MESSAGE, 148.0, 2)));
        // Not the streams that we fly by: 105 is the IMU, 24 the satellite receiver.
        assert!(!to_board(&mut pilot, &command(C::MAV_CMD_SET_MESSAGE_INTERVAL, 105.0, 2)));
        assert!(to_board(&mut pilot, &command(C::MAV_CMD_SET_MESSAGE_INTERVAL, 24.0, 2)));
        let list = PARAM_REQUEST_LIST_DATA { target_system: 2, target_component: 1 };
        assert!(to_board(&mut pilot, &frame(255, 190, &MavMessage::PARAM_REQUEST_LIST(list))));
        let fast = MavMessage::RC_CHANNELS_OVERRIDE(Default::default());
        assert!(!to_board(&mut pilot, &frame(255, 190, &fast)));
        // On the floor it is anybody's again.
        pilot.flight.mode = Mode::Disarmed;
        assert!(to_board(&mut pilot, &command(C::MAV_CMD_PREFLIGHT_CALIBRATION, 1.0, 2)));
        assert!(to_board(&mut pilot, &command(C::MAV_CMD_INJECT_FAILURE, 1.0, 2)));
    }
}
