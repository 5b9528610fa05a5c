//! A ground station in memory: sends commands and missions, reads the answers.

use haltere_dialect::mav::haltere::{
    COMMAND_ACK_DATA, MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MavCmd, MavMessage,
    MavMissionResult, MavMissionType, MavResult,
};
use haltere_dialect::mav::{LOCAL_PER_M, command_int, command_long, known};
use haltere_dialect::mav_stream::{self, MavSplitter};

use super::{Lockstep, World};

/// System id of a ground station, and component id, as QGroundControl's.
const SYSTEM: u8 = 255;
const COMPONENT: u8 = 190;
/// System and component of the vehicle.
pub const VEHICLE: (u8, u8) = (1, 1);
/// An answer must come within this simulated time, µs.
const PATIENCE_US: u64 = 5_000_000;

/// Whether a command is answered for good.
fn is_answer(ack: &COMMAND_ACK_DATA, command: MavCmd) -> bool {
    ack.command == command as u16 && ack.result != MavResult::MAV_RESULT_IN_PROGRESS as u8
}

/// The station.
#[derive(Debug)]
pub struct Ground {
    endpoint: u8,
    system_id: u8,
    splitter: MavSplitter,
    sequence: u8,
    /// Messages that came and were not asked for yet, oldest first.
    inbox: Vec<MavMessage>,
    /// Texts that came.
    pub texts: Vec<String>,
    text: String,
    /// Number of the newest heartbeat's custom mode.
    pub custom_mode: Option<u32>,
}

impl Default for Ground {
    fn default() -> Self {
        Self::new()
    }
}

impl Ground {
    /// A station that has heard nothing.
    pub fn new() -> Self {
        Self::at_endpoint(0, SYSTEM)
    }

    /// A station with an id of its own at any ground endpoint.
    pub fn at_endpoint(endpoint: u8, system_id: u8) -> Self {
        Self {
            endpoint,
            system_id,
            splitter: MavSplitter::new(),
            sequence: 0,
            inbox: Vec::new(),
            texts: Vec::new(),
            text: String::new(),
            custom_mode: None,
        }
    }

    /// Sends one message.
    pub fn send<W: World>(&mut self, world: &mut Lockstep<W>, message: &MavMessage) {
        let mut bytes = Vec::new();
        mav_stream::encode(&mut bytes, self.system_id, COMPONENT, self.sequence, message);
        self.sequence = self.sequence.wrapping_add(1);
        world.ground_in_at(self.endpoint, &bytes);
    }

    /// Takes in what the vehicle sent.
    pub fn listen<W: World>(&mut self, world: &mut Lockstep<W>) {
        self.splitter.push(world.ground_out_of(self.endpoint));
        world.clear_ground_out_of(self.endpoint);
        while let Some(next) = self.splitter.next() {
            let Ok(frame) = next else { continue };
            let Ok(message) = frame.decode() else { continue };
            match message {
                MavMessage::STATUSTEXT(m) => {
                    let end = m.text.iter().position(|c| *c == 0);
                    self.text.push_str(&String::from_utf8_lossy(&m.text[..end.unwrap_or(50)]));
                    if m.id == 0 || end.is_some() {
                        self.texts.push(std::mem::take(&mut self.text));
                    }
                }
                MavMessage::HEARTBEAT(m) => self.custom_mode = Some(m.custom_mode),
                // Streams would fill the inbox; whoever wants them reads the core.
                MavMessage::COMMAND_ACK(_)
                | MavMessage::MISSION_ACK(_)
                | MavMessage::MISSION_REQUEST_INT(_)
                | MavMessage::MISSION_ITEM_REACHED(_)
                | MavMessage::MISSION_REQUEST(_)
                | MavMessage::MISSION_COUNT(_)
                | MavMessage::MISSION_ITEM(_)
                | MavMessage::MISSION_ITEM_INT(_)
                | MavMessage::PARAM_VALUE(_)
                | MavMessage::PARAM_ERROR(_)
                | MavMessage::PARAM_EXT_ACK(_)
                | MavMessage::COMPONENT_METADATA(_)
                | MavMessage::COMPONENT_INFORMATION(_)
                | MavMessage::LOG_ENTRY(_)
                | MavMessage::LOG_DATA(_)
                | MavMessage::EVENT(_)
                | MavMessage::CURRENT_EVENT_SEQUENCE(_)
                | MavMessage::RESPONSE_EVENT_ERROR(_)
                | MavMessage::SYSTEM_TIME(_)
                | MavMessage::FENCE_STATUS(_)
                | MavMessage::FILE_TRANSFER_PROTOCOL(_) => self.inbox.push(message),
                _ => {}
            }
        }
    }

    /// The first message that `pick` accepts; everything before it stays.
    pub fn take<T>(&mut self, mut pick: impl FnMut(&MavMessage) -> Option<T>) -> Option<T> {
        let (index, found) =
            self.inbox.iter().enumerate().find_map(|(i, m)| Some((i, pick(m)?)))?;
        self.inbox.remove(index);
        Some(found)
    }

    /// Flies on until `pick` accepts a message.
    pub fn wait_for<W: World, T>(
        &mut self,
        world: &mut Lockstep<W>,
        patience_us: u64,
        mut pick: impl FnMut(&MavMessage) -> Option<T>,
    ) -> Option<T> {
        let end = world.t_us() + patience_us;
        loop {
            self.listen(world);
            if let Some(found) = self.take(&mut pick) {
                return Some(found);
            }
            if world.t_us() >= end {
                return None;
            }
            world.step();
        }
    }

    /// Sends a command and waits for its answer. `None`: none came.
    pub fn command<W: World>(
        &mut self,
        world: &mut Lockstep<W>,
        command: MavCmd,
        params: [f32; 7],
    ) -> Option<MavResult> {
        self.send(world, &command_long(VEHICLE, command, &params, 0));
        self.wait_for(world, PATIENCE_US, |m| match m {
            MavMessage::COMMAND_ACK(ack) if is_answer(ack, command) => known(ack.result),
            _ => None,
        })
    }

    /// Flies to a point in the Earth frame, m.
    pub fn goto<W: World>(
        &mut self,
        world: &mut Lockstep<W>,
        pos_E_m: [f64; 3],
    ) -> Option<MavResult> {
        let command = MavCmd::MAV_CMD_DO_REPOSITION;
        let params = [f32::NAN, 1.0, f32::NAN, f32::NAN];
        let [x, y] = [pos_E_m[0], pos_E_m[1]].map(|m| (m * LOCAL_PER_M) as i32);
        self.send(world, &command_int(VEHICLE, command, params, (x, y, pos_E_m[2] as f32)));
        self.wait_for(world, PATIENCE_US, |m| match m {
            MavMessage::COMMAND_ACK(ack) if ack.command == command as u16 => known(ack.result),
            _ => None,
        })
    }

    /// Uploads a mission. Sequence numbers are filled in.
    pub fn upload<W: World>(
        &mut self,
        world: &mut Lockstep<W>,
        items: &[MISSION_ITEM_INT_DATA],
    ) -> Option<MavMissionResult> {
        let mission_type = MavMissionType::MAV_MISSION_TYPE_MISSION;
        let count = MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: u16::try_from(items.len()).ok()?,
            target_system: 1,
            target_component: 1,
            mission_type: mission_type as u8,
            opaque_id: 0,
        });
        self.send(world, &count);
        enum Step {
            Item(u16),
            Done(MavMissionResult),
        }
        loop {
            let step = self.wait_for(world, PATIENCE_US, |m| match m {
                MavMessage::MISSION_REQUEST_INT(r) => Some(Step::Item(r.seq)),
                MavMessage::MISSION_ACK(ack) => known(ack.mavtype).map(Step::Done),
                _ => None,
            })?;
            match step {
                Step::Done(result) => return Some(result),
                Step::Item(seq) => {
                    let item = items.get(usize::from(seq))?;
                    let message = MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
                        seq,
                        target_system: 1,
                        target_component: 1,
                        mission_type: mission_type as u8,
                        ..item.clone()
                    });
                    self.send(world, &message);
                }
            }
        }
    }
}
