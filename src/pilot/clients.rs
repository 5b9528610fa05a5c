//! What clients say: frames of the ground endpoints, setpoints among them. The commands are in
//! `commands`, what is fetched and stored in `services`.

use haltere_dialect::mav::haltere::{MavMessage, MavResult};
use haltere_dialect::mav_stream::MavLoss;

use crate::drops::{DropReason, Drops};
use crate::time::HostTime;

use super::commands::Request;
use super::modes::Mode;
use super::setpoint::Setpoint;
use super::{LinkId, OWN, Pilot, Severity, reference};

/// COMMAND_INT in a local frame counts x and y in 0.1 mm.
const LOCAL_SCALE: f64 = 1e-4;
/// COMMAND_LONG, COMMAND_INT and COMMAND_ACK, for commands that the dialect has no name for.
const COMMAND_LONG_ID: u32 = 76;
const COMMAND_INT_ID: u32 = 75;
const COMMAND_ACK_ID: u32 = 77;

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
        if index >= self.grounds.len() {
            return;
        }
        self.grounds[index].heard_at = at;
        self.grounds[index].splitter.push(bytes);
        self.ground_frames(at, index);
    }

    pub(super) fn ground_frames(&mut self, at: HostTime, index: usize) {
        let link = self.grounds[index].link;
        // The splitter is taken out while its frames are handled by the rest of the core.
        let mut splitter = std::mem::take(&mut self.grounds[index].splitter);
        while let Some(next) = splitter.next() {
            count_frame(self.drops_of(link), &next);
            let Ok(frame) = next else { continue };
            let header = frame.header;
            let missing =
                self.grounds[index].missing(header.system_id, header.component_id, header.sequence);
            self.drops_of(link).add(DropReason::MavSequenceGap, missing);
            let peer = (header.system_id, header.component_id);
            match frame.decode() {
                Ok(message) => self.ground_message(at, link, peer, message),
                Err(MavLoss::Undecodable { .. })
                    if matches!(header.msg_id, COMMAND_LONG_ID | COMMAND_INT_ID) =>
                {
                    self.answer_unknown_command(link, peer, frame.payload);
                }
                Err(loss) => count_frame::<()>(self.drops_of(link), &Err(loss)),
            }
        }
        self.grounds[index].splitter = splitter;
    }

    /// A command number that the dialect does not know makes the whole message undecodable, but
    /// its sender waits for an answer. The number stands at byte 28 of either message.
    fn answer_unknown_command(&mut self, link: LinkId, peer: (u8, u8), payload: &[u8]) {
        // Trailing zeros are cut on the wire.
        let byte = |i: usize| payload.get(i).copied().unwrap_or_default();
        let number = [byte(28), byte(29)];
        let target = (byte(30), byte(31));
        if !self.is_for_us(target) {
            self.drops_of(link).add(DropReason::MavWrongPeer, 1);
            return;
        }
        // COMMAND_ACK: command u16, result u8, progress u8, result_param2 i32, target u8 u8.
        let unsupported = MavResult::MAV_RESULT_UNSUPPORTED as u8;
        let fields = [number[0], number[1], unsupported, 0, 0, 0, 0, 0, peer.0, peer.1];
        self.out.payload(link, OWN, COMMAND_ACK_ID, &fields);
    }

    fn is_for_us(&self, (system, component): (u8, u8)) -> bool {
        (system == 0 || system == OWN.system_id)
            && (component == 0 || component == OWN.component_id)
    }

    fn ground_message(&mut self, at: HostTime, link: LinkId, peer: (u8, u8), message: MavMessage) {
        if self.service_message(at, link, peer, &message) {
            return;
        }
        let target = match &message {
            MavMessage::COMMAND_LONG(m) => (m.target_system, m.target_component),
            MavMessage::COMMAND_INT(m) => (m.target_system, m.target_component),
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) => (m.target_system, m.target_component),
            MavMessage::SET_MODE(m) => (m.target_system, 0),
            _ => (0, 0),
        };
        if !self.is_for_us(target) {
            self.drops_of(link).add(DropReason::MavWrongPeer, 1);
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
                    point: [m.param5, m.param6, m.param7].map(f64::from),
                    frame: None,
                },
            ),
            MavMessage::COMMAND_INT(m) => self.answer(
                at,
                Request {
                    link,
                    peer,
                    command: m.command,
                    params: [m.param1, m.param2, m.param3, m.param4],
                    point: [
                        f64::from(m.x) * LOCAL_SCALE,
                        f64::from(m.y) * LOCAL_SCALE,
                        f64::from(m.z),
                    ],
                    frame: Some(m.frame),
                },
            ),
            MavMessage::SET_MODE(m) => {
                // No acknowledgement in this message: the heartbeat is the answer.
                if let Err((_, why)) = self.set_custom_mode(at, m.custom_mode) {
                    self.say(at, Severity::Warning, why);
                }
                self.send_telemetry(at, link, 0);
            }
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) => {
                let limit_s = self.config.limits.offboard_loss_s;
                let last = self.guidance.setpoint.as_ref().filter(|s| {
                    self.mode == Mode::Offboard || at.seconds_since(s.received_at) < limit_s
                });
                match Setpoint::from_wire(&m, &self.estimate, last, at) {
                    Ok(setpoint) => self.guidance.setpoint = Some(setpoint),
                    Err(why) => {
                        self.drops_of(link).add(DropReason::BadValue, 1);
                        if !self.refused_setpoint_told {
                            self.refused_setpoint_told = true;
                            self.say(at, Severity::Warning, why);
                        }
                    }
                }
            }
            MavMessage::TIMESYNC(m) if m.tc1 == 0 => {
                let mut echo = m;
                echo.tc1 = at.as_us().cast_signed().saturating_mul(1000);
                echo.target_system = peer.0;
                echo.target_component = peer.1;
                self.out.message(link, OWN, &MavMessage::TIMESYNC(echo));
            }
            MavMessage::PING(m) if m.target_system == 0 => {
                let mut echo = m;
                echo.target_system = peer.0;
                echo.target_component = peer.1;
                self.out.message(link, OWN, &MavMessage::PING(echo));
            }
            MavMessage::HEARTBEAT(_) => {}
            other => match reference::from_message(&other) {
                Some(Ok(pose)) => {
                    // A ground station's clock is not ours: true when it came.
                    let pose = pose.stamped(at, at);
                    self.estimator.reference(&pose); // fuses only if it is configured to
                    self.record(|| crate::topics::Topic::Reference(pose));
                }
                Some(Err(())) => self.drops_of(link).add(DropReason::BadValue, 1),
                None => self.drops_of(link).add(DropReason::MavIgnored, 1),
            },
        }
    }
}
