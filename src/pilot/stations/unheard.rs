//! Who speaks and is not heard, in words, once: whoever means well would wait for ever otherwise.
//!
//! What signatures, places and addresses keep out stands in `voice` and `losses`. Here is the rest: bytes that are no
//! MAVLink, frames of another dialect, and requests for a system that nobody is.
//!
//! Two vehicles that send to one port of a station each hear what it says to the other. That is no fault: a station that
//! speaks to us by our number knows us, and a system that was heard on the link is there.

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use super::Stations;
use crate::flight::Flight;
use crate::flight::modes::Mode;
use crate::input::LinkId;
use crate::out::Out;
use crate::out::voice::Severity;

/// Bytes that are no frame: as many as no noise makes before a station has said a word.
const MOST_NOISE_BYTES: u64 = 1000;
/// Frames with a wrong checksum: so many a bad line has now and then.
const MOST_DAMAGED: u64 = 10;

/// Setpoints may come for so long before the mode that follows them is asked for, s: PX4 wants a second of them.
const UNOBEYED_S: f64 = 2.0;

/// A station that knows us speaks to us within this time of a request for another system, s: three heartbeats.
const KNOWN_WITHIN_S: f64 = 3.0;

/// Whom those on a link speak to.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Addressees {
    /// Somebody spoke to us by our system id.
    us: bool,
    /// A system and component that is not here was asked for something, and when.
    other: Option<(HostTime, (u8, u8))>,
}

impl Stations {
    /// Takes note of whom a message is for. `waits`: its sender does, for an answer; `passed`: it went on to somebody.
    pub(crate) fn note_addressee(
        &mut self,
        at: HostTime,
        index: usize,
        target: (u8, u8),
        waits: bool,
        passed: bool,
        out: &mut Out,
    ) {
        let own_id = out.own.system_id;
        let Some(ground) = self.grounds.get_mut(index) else { return };
        if target.0 == own_id {
            ground.addressees = Addressees { us: true, other: None };
        } else if target.0 != 0 && !passed && !ground.addressees.us && waits {
            ground.addressees.other.get_or_insert((at, target));
        }
    }

    /// A station asked a system that is not here, and has not spoken to us since.
    pub(crate) fn tell_misaddressed(&mut self, at: HostTime, index: usize, out: &mut Out) {
        let own = out.own;
        let Some(ground) = self.grounds.get_mut(index) else { return };
        let other = ground.addressees.other;
        let Some((since, (system, component))) = other else { return };
        if at.seconds_since(since) < KNOWN_WITHIN_S {
            return;
        }
        ground.addressees.other = None;
        if ground.has_heard_system(system) {
            return;
        }
        let link = ground.link;
        let text = format!(
            "link {}: a station asks system {system}, component {component}, which is not here: this vehicle is system \
             {}, component {}",
            link.number(),
            own.system_id,
            own.component_id
        );
        out.tell_once(at, link, DropReason::MavWrongPeer, text);
    }

    /// Something of a link was thrown away.
    pub(crate) fn tell_unheard(
        &mut self,
        at: HostTime,
        link: LinkId,
        reason: DropReason,
        out: &mut Out,
    ) {
        let LinkId::Ground(n) = link else { return };
        let number = self.grounds.get(usize::from(n)).map_or(0, |ground| ground.endpoint_number);
        let count = out.drops_of(link).count(reason);
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
        out.tell_once(at, link, reason, format!("ground.endpoints[{number}]: {what}"));
    }

    /// A setpoint came. Who streams them in another mode waits for a vehicle that does not move.
    pub(crate) fn tell_unobeyed(&mut self, at: HostTime, flight: &Flight, out: &mut Out) {
        let follows =
            [Some(flight.mode), flight.guidance.next.mode()].contains(&Some(Mode::Offboard));
        if follows || flight.mode == Mode::Disarmed {
            self.unobeyed_since = None;
            return;
        }
        let since = *self.unobeyed_since.get_or_insert(at);
        let is_told = out.told.unobeyed_at.is_some_and(|told| told >= since);
        if at.seconds_since(since) >= UNOBEYED_S && !is_told {
            out.told.unobeyed_at = Some(at);
            let mode = flight.mode.name();
            let text = format!(
                "setpoints come and are not followed in mode {mode}: ask for OFFBOARD (DO_SET_MODE 1, 6)"
            );
            out.say(at, Severity::Warning, text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pilot;
    use crate::config::PilotConfig;
    use crate::input::Input;
    use haltere_core::frames::Vec3;
    use haltere_core::measure::AnchorId;
    use haltere_core::survey::Survey;
    use haltere_core::topics::Topic;
    use haltere_dialect::mav::haltere::{COMMAND_LONG_DATA, HEARTBEAT_DATA, MavMessage};
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

    /// What is said when a station, and whoever else speaks on its link, says this, each message 1 s after the one before.
    fn told_of(messages: &[(u8, MavMessage)]) -> Vec<String> {
        let mut pilot = pilot();
        pilot.handle(AT, Input::LinkUp { link: LINK });
        told(&mut pilot);
        let mut now = AT;
        for (n, (system, message)) in messages.iter().enumerate() {
            let mut bytes = Vec::new();
            encode(&mut bytes, *system, 190, n as u8, message);
            pilot.handle(now, Input::Bytes { link: LINK, bytes: &bytes });
            let next = now.offset_us(1_000_000);
            while pilot.next_deadline() <= next {
                now = pilot.next_deadline();
                pilot.handle(now, Input::Wake);
            }
            now = next;
        }
        let mut told = told(&mut pilot);
        told.retain(|text| text.contains("asks system"));
        told
    }

    fn heartbeat() -> MavMessage {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA::default())
    }

    fn command(target_system: u8) -> MavMessage {
        let command =
            COMMAND_LONG_DATA { target_system, target_component: 1, ..Default::default() };
        MavMessage::COMMAND_LONG(command)
    }

    /// A station that was set to another vehicle's id waited for ever.
    #[test]
    fn regress_a_request_for_a_system_that_nobody_is_is_told_once() {
        let mut said = vec![(255, heartbeat())];
        said.extend((0..12).map(|_| (255, command(7))));
        let told = told_of(&said);
        assert_eq!(told.len(), 1, "{told:?}");
        assert!(told[0].contains("asks system 7, component 1"), "{told:?}");
        assert!(told[0].contains("this vehicle is system 1, component 1"), "{told:?}");
        // Also where it asked once and waits.
        let waits = [command(7), heartbeat(), heartbeat(), heartbeat()].map(|m| (255, m));
        assert_eq!(told_of(&waits), told);
    }

    /// Each of two vehicles at one port of a station said that the other one is not there.
    #[test]
    fn regress_what_a_station_asks_another_vehicle_is_not_told() {
        // It speaks to both, to the other one first.
        let both = [command(2), heartbeat(), command(1), command(2), heartbeat(), heartbeat()];
        let both: Vec<_> = both.into_iter().cycle().take(30).map(|m| (255, m)).collect();
        assert_eq!(told_of(&both), [""; 0]);
        // The other one is heard on this link, as through a radio or a bridge.
        let mut heard = vec![(255, command(2)), (2, heartbeat())];
        heard.extend((0..8).map(|_| (255, command(2))));
        assert_eq!(told_of(&heard), [""; 0]);
    }
}
