//! Tag and board under one another's names: a line of which its own reader understands nothing is looked at with the
//! readers of what else could speak there.
//!
//! A serial device is found by its name, and names change with the order of plugging in. Without this the board is
//! missed, the anchors are not heard, and the advice is to look for them.

use haltere_dialect::lps::sniffer::SnifferDecoder;
use haltere_dialect::lps::text::TextDecoder;
use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::{MavSplitter, heartbeat_of};

use haltere_core::time::HostTime;

use super::Board;
use super::link::speaks_as_board;
use crate::config::TagProtocol;
use crate::input::LinkId;
use crate::out::Out;
use crate::out::voice::Severity;

/// Who speaks on a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Speaker {
    /// An autopilot, by its HEARTBEAT.
    Board,
    /// A node in sniffer mode, binary or as text.
    Sniffer,
    /// A tag by MAVLink.
    MavTag,
}

/// Every reader of a device, on one line.
#[derive(Debug, Clone, Default)]
pub struct Ear {
    mavlink: MavSplitter,
    sniffer: SnifferDecoder,
    text: TextDecoder,
    speaker: Option<Speaker>,
}

impl Ear {
    /// Takes bytes in. Whether it is now known who speaks, and was not before.
    pub fn hear(&mut self, bytes: &[u8]) -> bool {
        let before = self.speaker;
        self.mavlink.push(bytes);
        while let Some(next) = self.mavlink.next() {
            let Ok(frame) = next else { continue };
            if speaks_as_board(&frame, None) && heartbeat_of(&frame).is_some() {
                self.speaker = Some(Speaker::Board);
            } else if matches!(frame.decode(), Ok(MavMessage::UWB_TDOA(_))) {
                self.speaker = Some(Speaker::MavTag);
            }
        }
        self.sniffer.push(bytes);
        while let Some(next) = self.sniffer.next() {
            self.speaker = if next.is_ok() { Some(Speaker::Sniffer) } else { self.speaker };
        }
        self.text.push(bytes);
        while let Some(next) = self.text.next() {
            self.speaker = if next.is_ok() { Some(Speaker::Sniffer) } else { self.speaker };
        }
        self.speaker != before
    }

    /// Whether a tag speaks. MAVLink is not for its ears: some bytes of it are commands to a node, one ends its program.
    pub(crate) fn is_tag(&self) -> bool {
        matches!(self.speaker, Some(Speaker::Sniffer | Speaker::MavTag))
    }

    /// Forgets what it heard: the line's own reader understands it.
    fn rest(&mut self) {
        if self.speaker.is_some() {
            *self = Self::default();
        }
    }
}

/// The lines of tag and board.
#[derive(Debug, Clone, Default)]
pub struct Lines {
    /// On the tag's line.
    pub tag: Ear,
    /// On the board's line.
    pub board: Ear,
}

impl Lines {
    /// What is wrong with the lines that nobody's own reader understands, and the way out, for people. `None`: nobody
    /// is in a wrong place, or nobody was recognised.
    pub fn misplaced(&self, protocol: TagProtocol) -> Option<[&'static str; 2]> {
        use Speaker::{Board, MavTag, Sniffer};
        Some(match (self.tag.speaker, self.board.speaker, protocol) {
            (Some(Board), Some(Sniffer | MavTag), _) => [
                "tag and board are exchanged: the board speaks MAVLink on the tag's line, the tag on the board's",
                "exchange the devices in tag.port and board.address",
            ],
            (Some(Board), _, _) => [
                "a board speaks MAVLink on the tag's line",
                "check tag.port: it may be exchanged with board.address",
            ],
            (_, Some(Sniffer | MavTag), _) => [
                "a UWB tag speaks on the board's line, where MAVLink of a board is expected",
                "check board.address: it may be exchanged with tag.port",
            ],
            (Some(MavTag), _, TagProtocol::LpsSniffer) => {
                ["the tag speaks MAVLink, no sniffer", "set tag.protocol = \"mavlink\""]
            }
            (Some(Sniffer), _, TagProtocol::Mavlink) => {
                ["the tag is a sniffer, it speaks no MAVLink", "set tag.protocol = \"lps-sniffer\""]
            }
            _ => return None,
        })
    }
}

impl Board {
    /// Takes in bytes of tag or board as long as nothing on their line is understood, and tells who is recognised.
    /// `last_fused`: when a measurement of the tag last was.
    pub(crate) fn look_at_line(
        &mut self,
        at: HostTime,
        (link, bytes): (LinkId, &[u8]),
        last_fused: Option<HostTime>,
        protocol: TagProtocol,
        out: &mut Out,
    ) {
        // What CRTP says to ears for other languages is nothing.
        if self.link.is_crazyflie() {
            return;
        }
        let is_new = match link {
            LinkId::Tag if last_fused.is_none_or(|t| at.seconds_since(t) > SILENCE_S) => {
                self.lines.tag.hear(bytes)
            }
            LinkId::Board if self.link.silence_s(at).is_none_or(|s| s > SILENCE_S) => {
                self.lines.board.hear(bytes)
            }
            LinkId::Tag => return self.lines.tag.rest(),
            LinkId::Board => return self.lines.board.rest(),
            LinkId::Ground(_) => return,
        };
        if is_new
            && let Err(text) = self.check_lines(protocol)
            && out.may_echo(at)
        {
            out.say(at, Severity::Error, text);
        }
    }

    /// Whether tag and board are where they are looked for, as far as can be told.
    pub(crate) fn check_lines(&self, protocol: TagProtocol) -> Result<(), String> {
        let misplaced = self.lines.misplaced(protocol);
        misplaced.map_or(Ok(()), |[what, way_out]| Err(format!("{what}: {way_out}")))
    }
}

/// Without anything that its own reader understands for so long a line is looked at with the others, s: longer than a
/// board or a tag of low rate pauses.
const SILENCE_S: f64 = 1.0;

#[cfg(test)]
mod tests {
    use haltere_dialect::lps::sniffer::{self, SnifferFrame};
    use haltere_dialect::lps::text;
    use haltere_dialect::mav::haltere::{HEARTBEAT_DATA, MavAutopilot, UWB_TDOA_DATA};
    use haltere_dialect::mav_stream;

    use super::*;
    use crate::Pilot;
    use crate::config::PilotConfig;
    use crate::input::Input;
    use haltere_core::frames::Vec3;
    use haltere_core::measure::AnchorId;
    use haltere_core::survey::Survey;
    use haltere_core::topics::Topic;

    /// A packet after `docs/INTERFACES.md`, as in the codec's own test of the format.
    const PACKET: [u8; 7] = [0x30, 0x05, 0, 0, 0, 0x80, 0];

    fn said_by(speaker: Speaker, as_text: bool) -> Vec<u8> {
        let (rx_ticks, payload) = (0x01_0203_040A, &PACKET[..]);
        let packet = SnifferFrame { rx_ticks, source: 10, destination: 0xFF, payload };
        let mut bytes = Vec::new();
        let message = match speaker {
            Speaker::Sniffer if as_text => {
                text::encode(&mut bytes, &packet);
                return bytes;
            }
            Speaker::Sniffer => {
                sniffer::encode(&mut bytes, &packet);
                return bytes;
            }
            Speaker::Board => MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC as u8,
                ..Default::default()
            }),
            Speaker::MavTag => MavMessage::UWB_TDOA(UWB_TDOA_DATA::default()),
        };
        mav_stream::encode(&mut bytes, 1, 1, 0, &message);
        bytes
    }

    /// What is told of these two, and why nothing arms.
    fn told(
        protocol: TagProtocol,
        tag: Option<Speaker>,
        board: Option<Speaker>,
        as_text: bool,
    ) -> (Vec<String>, String, u32) {
        let corner = |i: u8| {
            let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
        };
        let survey = Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        let config = PilotConfig { tag_protocol: protocol, ..PilotConfig::default() };
        let at = |ms: u64| HostTime::from_us(1_000_000 + ms * 1000);
        let mut pilot = Pilot::new(config, survey, at(0));
        let mut sent = 0;
        for ms in (0..3000).step_by(50) {
            for (link, speaker) in [(LinkId::Tag, tag), (LinkId::Board, board)] {
                let bytes = speaker.map(|speaker| said_by(speaker, as_text)).unwrap_or_default();
                // Cut anywhere, as a line does.
                for piece in bytes.chunks(11) {
                    pilot.handle(at(ms), Input::Bytes { link, bytes: piece });
                }
            }
            pilot.handle(at(ms), Input::Wake);
            pilot.drain_output(|link, _| sent += u32::from(link == LinkId::Board));
        }
        let mut texts = Vec::new();
        pilot.drain_topics(|topic| {
            if let Topic::Text(text) = topic {
                texts.push(text.text);
            }
        });
        (texts, pilot.sight(at(3000)).may_arm().unwrap_err(), sent)
    }

    /// The advice was to check the anchors and the speed.
    #[test]
    fn regress_tag_and_board_under_one_anothers_names_are_told() {
        use Speaker::{Board, MavTag, Sniffer};
        use TagProtocol::{LpsSniffer, Mavlink};
        let both = "tag and board are exchanged";
        let cases = [
            (LpsSniffer, Some(Board), Some(Sniffer), both),
            (Mavlink, Some(Board), Some(MavTag), both),
            (
                LpsSniffer,
                Some(Board),
                None,
                "a board speaks MAVLink on the tag's line: check tag.port",
            ),
            (Mavlink, Some(Board), Some(Board), "a board speaks MAVLink on the tag's line"),
            (LpsSniffer, None, Some(Sniffer), "a UWB tag speaks on the board's line"),
            (LpsSniffer, Some(Sniffer), Some(Sniffer), "a UWB tag speaks on the board's line"),
            (LpsSniffer, Some(MavTag), Some(Board), "set tag.protocol = \"mavlink\""),
            (Mavlink, Some(Sniffer), Some(Board), "set tag.protocol = \"lps-sniffer\""),
        ];
        for (protocol, tag, board, says) in cases {
            for as_text in [false, true] {
                let (texts, refusal, sent) = told(protocol, tag, board, as_text);
                let is_tag = matches!(board, Some(Sniffer | MavTag));
                assert_eq!(sent == 0, is_tag, "{tag:?} {board:?}: {sent} sent to the board's line");
                assert!(refusal.contains(says), "{tag:?} {board:?}: {refusal}");
                let count = texts.iter().filter(|text| text.contains(says)).count();
                assert_eq!(count, 1, "{tag:?} {board:?}: {texts:?}");
            }
        }
    }

    #[test]
    fn prop_lines_that_are_right_or_silent_are_not_told() {
        use Speaker::{Board, MavTag, Sniffer};
        use TagProtocol::{LpsSniffer, Mavlink};
        for (protocol, tag, board) in [
            (LpsSniffer, Some(Sniffer), Some(Board)),
            (Mavlink, Some(MavTag), Some(Board)),
            (LpsSniffer, None, Some(Board)),
            (LpsSniffer, Some(Sniffer), None),
            (LpsSniffer, None, None),
        ] {
            let (texts, refusal, _) = told(protocol, tag, board, false);
            for text in texts.iter().chain([&refusal]) {
                assert!(!text.contains("'s line") && !text.contains("protocol"), "{text}");
            }
        }
    }
}
