//! Mission upload: the count goes out, items go out as they are asked for, one answer ends it.

use std::time::{Duration, Instant};

use haltere_dialect::mav::haltere::{
    MISSION_COUNT_DATA, MavMessage, MavMissionResult, MavMissionType,
};

use super::CtlError;
use super::station::GroundStation;
use haltere_pilot::mission_file::Item;

/// Silence after which the last message is sent again (MAVLink mission protocol: 1.5 s).
const RETRY_AFTER: Duration = Duration::from_millis(1500);
/// Times that a message is sent.
const TRIES: u32 = 5;

impl GroundStation {
    /// Replaces the vehicle's mission.
    pub fn upload(&mut self, items: &[Item]) -> Result<(), CtlError> {
        let (system, component) = self.target();
        let count = MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: items.len() as u16,
            target_system: system,
            target_component: component,
            mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
            ..Default::default()
        });
        self.forget_texts();
        let mut last = count;
        let mut tries = 0;
        loop {
            self.send(&last)?;
            tries += 1;
            let deadline = Instant::now() + RETRY_AFTER;
            while Instant::now() < deadline {
                let Some(message) = self.next_message(deadline)? else { break };
                #[allow(deprecated)] // older vehicles ask in the old form
                let seq = match message {
                    MavMessage::MISSION_REQUEST_INT(asked) => asked.seq,
                    MavMessage::MISSION_REQUEST(asked) => asked.seq,
                    MavMessage::MISSION_ACK(answer) => {
                        return match answer.mavtype {
                            MavMissionResult::MAV_MISSION_ACCEPTED => Ok(()),
                            result => Err(CtlError::MissionRefused {
                                result,
                                texts: self.texts_after_refusal()?,
                            }),
                        };
                    }
                    _ => continue,
                };
                // An index we do not have is the vehicle's mistake; it will ask again or refuse.
                if let Some(item) = items.get(usize::from(seq)) {
                    last = MavMessage::MISSION_ITEM_INT(item.to_wire(seq, system, component));
                    tries = 0;
                    break;
                }
            }
            if tries >= TRIES {
                return Err(CtlError::Timeout {
                    what: "an answer to the mission upload".into(),
                    waited: RETRY_AFTER * TRIES,
                    texts: self.take_texts(),
                });
            }
        }
    }
}
