//! Mission upload: the count goes out, items go out as they are asked for, one answer ends it.

use std::time::{Duration, Instant};

use haltere_dialect::mav::haltere::{
    MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MavMessage, MavMissionResult, MavMissionType,
};
use haltere_dialect::mav::known;

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
        let wires: Vec<_> =
            items.iter().zip(0..).map(|(item, seq)| item.to_wire(seq, system, component)).collect();
        self.upload_plan(MavMissionType::MAV_MISSION_TYPE_MISSION, &wires)
    }

    /// Replaces the vehicle's mission, its fence or its rally points; the items are addressed here.
    pub fn upload_plan(
        &mut self,
        kind: MavMissionType,
        items: &[MISSION_ITEM_INT_DATA],
    ) -> Result<(), CtlError> {
        let (target_system, target_component) = self.target();
        let count = MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: items.len() as u16,
            target_system,
            target_component,
            mission_type: kind as u8,
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
                    MavMessage::MISSION_REQUEST_INT(asked) if asked.mission_type == kind as u8 => {
                        asked.seq
                    }
                    MavMessage::MISSION_REQUEST(asked) if asked.mission_type == kind as u8 => {
                        asked.seq
                    }
                    MavMessage::MISSION_ACK(answer) if answer.mission_type == kind as u8 => {
                        return match known(answer.mavtype)
                            .unwrap_or(MavMissionResult::MAV_MISSION_ERROR)
                        {
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
                    last = MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
                        target_system,
                        target_component,
                        ..item.clone()
                    });
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
