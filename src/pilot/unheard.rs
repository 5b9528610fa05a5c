//! Who speaks and is not heard, in words, once: whoever means well would wait for ever otherwise.
//!
//! What signatures, places and addresses keep out stands in `voice` and `losses`. Here is the rest: bytes that are no
//! MAVLink, frames of another dialect, and requests for a system that nobody is.

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_dialect::mav::haltere::MavMessage;

use super::clients::is_command;
use super::{LinkId, Pilot, Severity};

/// Bytes that are no frame: as many as no noise makes before a station has said a word.
const MOST_NOISE_BYTES: u64 = 1000;
/// Frames with a wrong checksum: so many a bad line has now and then.
const MOST_DAMAGED: u64 = 10;

/// What was told: link and reason, each once.
pub(super) type Told = Vec<(LinkId, DropReason)>;

impl Pilot {
    /// Something of a link was thrown away.
    pub(super) fn tell_unheard(&mut self, at: HostTime, link: LinkId, reason: DropReason) {
        let LinkId::Ground(n) = link else { return };
        let number = self.grounds.get(usize::from(n)).map_or(0, |ground| ground.endpoint_number);
        let count = self.drops_of(link).count(reason);
        let heard =
            self.grounds.get(usize::from(n)).is_some_and(|ground| ground.counts.received > 0);
        let what = match reason {
            DropReason::MavGarbageByte if count >= MOST_NOISE_BYTES && !heard => {
                "what comes is no MAVLink: look at the station's protocol, and at the speed of the line"
            }
            DropReason::MavBadChecksum if count >= MOST_DAMAGED => {
                "frames with a wrong checksum are not heard: a bad line, or a station with another dialect"
            }
            DropReason::MavIncompatible => {
                "frames that ask for a feature we do not have are not heard: look at the station's version"
            }
            DropReason::InputQueueFull => "a station sends more at once than is taken in",
            _ => return,
        };
        self.tell_once(at, link, reason, format!("ground.endpoints[{number}]: {what}"));
    }

    /// A message was for another system, and nobody was there to pass it on to.
    pub(super) fn tell_misaddressed(
        &mut self,
        at: HostTime,
        link: LinkId,
        (system, component): (u8, u8),
        (msg_id, message): (u32, Option<&MavMessage>),
    ) {
        let asks = is_command(msg_id) || message.is_some_and(asks);
        if system == self.own.system_id || !asks {
            return;
        }
        let text = format!(
            "link {}: a station asks system {system}, component {component}, which is not here: this vehicle is system \
             {}, component {}",
            link.number(),
            self.own.system_id,
            self.own.component_id
        );
        self.tell_once(at, link, DropReason::MavWrongPeer, text);
    }

    fn tell_once(&mut self, at: HostTime, link: LinkId, reason: DropReason, text: String) {
        if !self.unheard_told.contains(&(link, reason)) {
            self.unheard_told.push((link, reason));
            self.say(at, Severity::Warning, text);
        }
    }
}

/// Whether a sender waits for something.
fn asks(message: &MavMessage) -> bool {
    matches!(
        message,
        MavMessage::SET_MODE(_)
            | MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)
            | MavMessage::SET_POSITION_TARGET_GLOBAL_INT(_)
            | MavMessage::MANUAL_CONTROL(_)
            | MavMessage::PARAM_REQUEST_LIST(_)
            | MavMessage::PARAM_REQUEST_READ(_)
            | MavMessage::PARAM_SET(_)
            | MavMessage::MISSION_COUNT(_)
            | MavMessage::MISSION_REQUEST_LIST(_)
            | MavMessage::MISSION_CLEAR_ALL(_)
            | MavMessage::FILE_TRANSFER_PROTOCOL(_)
    )
}

#[cfg(test)]
mod tests {
    use super::super::{Input, PilotConfig};
    use super::*;
    use haltere_core::frames::Vec3;
    use haltere_core::measure::AnchorId;
    use haltere_core::survey::Survey;
    use haltere_core::topics::Topic;
    use haltere_dialect::mav::haltere::{COMMAND_LONG_DATA, HEARTBEAT_DATA};
    use haltere_dialect::mav_stream::encode;

    fn pilot() -> Pilot {
        let corner = |i: u8| {
            let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
        };
        let survey = Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        Pilot::new(PilotConfig::default(), survey, AT)
    }

    const AT: HostTime = HostTime::from_us(1_000_000);
    const LINK: LinkId = LinkId::Ground(0);

    fn told(pilot: &mut Pilot) -> Vec<String> {
        let mut texts = Vec::new();
        pilot.drain_topics(|topic| {
            if let Topic::Text(text) = topic {
                texts.push(text.text);
            }
        });
        texts
    }

    #[test]
    fn regress_what_is_not_heard_is_told_once_in_words() {
        use DropReason as D;
        for (reason, count, words) in [
            (D::MavGarbageByte, 2000, Some("no MAVLink")),
            (D::MavGarbageByte, 20, None),
            (D::MavBadChecksum, 20, Some("another dialect")),
            (D::MavBadChecksum, 2, None),
            (D::MavIncompatible, 1, Some("station's version")),
            (D::InputQueueFull, 1, Some("more at once")),
        ] {
            let mut pilot = pilot();
            pilot.handle(AT, Input::LinkUp { link: LINK });
            told(&mut pilot);
            for _ in 0..3 {
                pilot.handle(AT, Input::Lost { link: LINK, reason, count });
            }
            let told = told(&mut pilot);
            match words {
                None => assert!(told.is_empty(), "{told:?}"),
                Some(words) => {
                    assert_eq!(told.len(), 1, "{reason:?}: {told:?}");
                    assert!(told[0].contains(words), "{told:?}");
                }
            }
        }
    }

    /// A station that was set to another vehicle's id waited for ever.
    #[test]
    fn regress_a_request_for_a_system_that_nobody_is_is_told_once() {
        let mut pilot = pilot();
        pilot.handle(AT, Input::LinkUp { link: LINK });
        let say = |pilot: &mut Pilot, message: &MavMessage, sequence| {
            let mut bytes = Vec::new();
            encode(&mut bytes, 255, 190, sequence, message);
            pilot.handle(AT, Input::Bytes { link: LINK, bytes: &bytes });
        };
        say(&mut pilot, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()), 0);
        told(&mut pilot);
        for sequence in 1..4 {
            let command =
                COMMAND_LONG_DATA { target_system: 7, target_component: 1, ..Default::default() };
            say(&mut pilot, &MavMessage::COMMAND_LONG(command), sequence);
        }
        let told = told(&mut pilot);
        assert_eq!(told.len(), 1, "{told:?}");
        assert!(told[0].contains("asks system 7, component 1"), "{told:?}");
        assert!(told[0].contains("this vehicle is system 1, component 1"), "{told:?}");
    }
}
