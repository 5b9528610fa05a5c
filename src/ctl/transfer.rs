//! Missions, fences and rally points, up and down. Up: the count goes out, items go out as they are asked for, one
//! answer ends it. Down: the count is asked for, then each item.

use std::time::{Duration, Instant};

use haltere_dialect::mav::haltere::{
    MISSION_ACK_DATA, MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MISSION_REQUEST_INT_DATA,
    MISSION_REQUEST_LIST_DATA, MavMessage, MavMissionResult, MavMissionType,
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

    /// Replaces several of the vehicle's lists, in this order: all of them or none. What was replaced is put back when
    /// a later one is refused; the error is then that of the refusal, and `tell` hears how it stands.
    pub fn upload_plans(
        &mut self,
        lists: &[(MavMissionType, &[MISSION_ITEM_INT_DATA])],
        mut tell: impl FnMut(&str),
    ) -> Result<(), CtlError> {
        // What comes last is refused or in force: nothing is put back in its place.
        let before = lists.iter().rev().skip(1).rev();
        let before = before.map(|(kind, _)| Ok((*kind, self.download_plan(*kind)?)));
        let before = before.collect::<Result<Vec<_>, CtlError>>()?;
        for (n, (kind, items)) in lists.iter().enumerate() {
            let Err(refusal) = self.upload_plan(*kind, items) else { continue };
            for (kind, items) in before.iter().take(n).rev() {
                let name = name_of(*kind);
                match self.upload_plan(*kind, items) {
                    Ok(()) => {
                        tell(&format!("the {name} in force before is back ({} items)", items.len()))
                    }
                    Err(error) => {
                        tell(&format!("the {name} in force before could not be put back: {error}"))
                    }
                }
            }
            return Err(refusal);
        }
        Ok(())
    }

    /// The vehicle's mission, fence or rally points.
    pub fn download_plan(
        &mut self,
        kind: MavMissionType,
    ) -> Result<Vec<MISSION_ITEM_INT_DATA>, CtlError> {
        let (target_system, target_component) = self.target();
        let mut ask = MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
            target_system,
            target_component,
            mission_type: kind as u8,
        });
        let mut items = Vec::new();
        let mut count = None;
        let mut tries = 0;
        loop {
            if count == Some(items.len()) {
                self.send(&MavMessage::MISSION_ACK(MISSION_ACK_DATA {
                    target_system,
                    target_component,
                    mavtype: MavMissionResult::MAV_MISSION_ACCEPTED as u8,
                    mission_type: kind as u8,
                    opaque_id: 0,
                }))?;
                return Ok(items);
            }
            if count.is_some() {
                ask = MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
                    target_system,
                    target_component,
                    seq: items.len() as u16,
                    mission_type: kind as u8,
                });
            }
            if tries >= TRIES {
                return Err(CtlError::Timeout {
                    what: format!("the {} in force", name_of(kind)),
                    waited: RETRY_AFTER * TRIES,
                    texts: self.take_texts(),
                });
            }
            self.send(&ask)?;
            tries += 1;
            let deadline = Instant::now() + RETRY_AFTER;
            while Instant::now() < deadline {
                match self.next_message(deadline)? {
                    Some(MavMessage::MISSION_COUNT(told))
                        if told.mission_type == kind as u8 && count.is_none() =>
                    {
                        count = Some(usize::from(told.count));
                    }
                    Some(MavMessage::MISSION_ITEM_INT(item))
                        if item.mission_type == kind as u8
                            && usize::from(item.seq) == items.len() =>
                    {
                        items.push(item);
                    }
                    Some(MavMessage::MISSION_ACK(answer)) if answer.mission_type == kind as u8 => {
                        let texts = self.texts_after_refusal()?;
                        let result =
                            known(answer.mavtype).unwrap_or(MavMissionResult::MAV_MISSION_ERROR);
                        return Err(CtlError::MissionRefused { result, texts });
                    }
                    Some(_) => continue,
                    None => break,
                }
                tries = 0;
                break;
            }
        }
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

/// What a list is called.
pub(super) fn name_of(kind: MavMissionType) -> &'static str {
    match kind {
        MavMissionType::MAV_MISSION_TYPE_FENCE => "fence",
        MavMissionType::MAV_MISSION_TYPE_RALLY => "rally points",
        _ => "mission",
    }
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;
    use std::sync::mpsc::channel;

    use super::*;
    use haltere_dialect::mav::haltere::HEARTBEAT_DATA;
    use haltere_dialect::mav_stream::{MavSplitter, encode};

    const FENCE: MavMissionType = MavMissionType::MAV_MISSION_TYPE_FENCE;
    const MISSION: MavMissionType = MavMissionType::MAV_MISSION_TYPE_MISSION;

    /// The new fence stayed when the mission of the same file was refused.
    #[test]
    fn regress_a_refused_mission_leaves_the_fence_that_was_in_force() {
        let vehicle = UdpSocket::bind("127.0.0.1:0").unwrap();
        let to = vehicle.local_addr().unwrap();
        vehicle.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        let (tell, seen) = channel();
        let (ends, ended) = channel::<()>();
        let item = |x| MISSION_ITEM_INT_DATA { x, mission_type: FENCE as u8, ..Default::default() };
        let old = item(1);
        let in_force = old.clone();
        let running = std::thread::spawn(move || {
            let mut splitter = MavSplitter::new();
            let mut buffer = [0; 2048];
            let mut sequence = 0_u8;
            while ended.try_recv() != Err(std::sync::mpsc::TryRecvError::Disconnected) {
                let Ok((n, from)) = vehicle.recv_from(&mut buffer) else { continue };
                splitter.push(&buffer[..n]);
                let mut answers = vec![MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                    autopilot: haltere_dialect::mav::haltere::MavAutopilot::MAV_AUTOPILOT_GENERIC
                        as u8,
                    ..Default::default()
                })];
                while let Some(frame) = splitter.next() {
                    let Ok(message) = frame.unwrap().decode() else { continue };
                    let ack = |result: MavMissionResult, mission_type| {
                        let mavtype = result as u8;
                        let data = MISSION_ACK_DATA { mavtype, mission_type, ..Default::default() };
                        MavMessage::MISSION_ACK(data)
                    };
                    match message {
                        MavMessage::MISSION_REQUEST_LIST(m) => {
                            answers.push(MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
                                count: 1,
                                mission_type: m.mission_type,
                                ..Default::default()
                            }));
                        }
                        MavMessage::MISSION_REQUEST_INT(_) => {
                            answers.push(MavMessage::MISSION_ITEM_INT(in_force.clone()));
                        }
                        MavMessage::MISSION_COUNT(m) if m.mission_type == MISSION as u8 => {
                            answers.push(ack(MavMissionResult::MAV_MISSION_INVALID, MISSION as u8));
                        }
                        MavMessage::MISSION_COUNT(m) => {
                            answers.push(MavMessage::MISSION_REQUEST_INT(
                                MISSION_REQUEST_INT_DATA {
                                    mission_type: m.mission_type,
                                    ..Default::default()
                                },
                            ));
                        }
                        MavMessage::MISSION_ITEM_INT(m) => {
                            tell.send(m.x).unwrap();
                            answers
                                .push(ack(MavMissionResult::MAV_MISSION_ACCEPTED, m.mission_type));
                        }
                        _ => {}
                    }
                }
                for answer in answers {
                    let mut bytes = Vec::new();
                    encode(&mut bytes, 1, 1, sequence, &answer);
                    sequence = sequence.wrapping_add(1);
                    vehicle.send_to(&bytes, from).unwrap();
                }
            }
        });
        let mut station = GroundStation::connect(&format!("udpout:{to}")).unwrap();
        let (fence, mission) = ([item(2)], [MISSION_ITEM_INT_DATA::default()]);
        let mut told = Vec::new();
        let refused = station.upload_plans(&[(FENCE, &fence), (MISSION, &mission)], |text| {
            told.push(text.to_owned())
        });
        assert!(matches!(refused, Err(CtlError::MissionRefused { .. })), "{refused:?}");
        assert_eq!(told, ["the fence in force before is back (1 items)"]);
        drop((station, ends));
        running.join().unwrap();
        // The new one, and the old one again.
        assert_eq!(seen.iter().collect::<Vec<_>>(), [2, old.x]);
    }
}
