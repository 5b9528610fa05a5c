//! What is asked and set at connecting, one question after the other, each repeated until it is answered.
//!
//! Version and tag; both tables of names; what a legacy setpoint means (`flightmode.*`: angles, an absolute yaw, no
//! hold of height or position), set by name and read back; where the anchors say they are; the log blocks.

use haltere_core::time::HostTime;
use haltere_dialect::crtp::loco::{self, AnchorPosition};
use haltere_dialect::crtp::log::{LogControl, LogOutcome};
use haltere_dialect::crtp::memory::{MemoryAnswer, MemoryRequest};
use haltere_dialect::crtp::packet::Packet;
use haltere_dialect::crtp::parameter::{ParameterAnswer, ParameterRequest};
use haltere_dialect::crtp::platform::{PlatformAnswer, PlatformRequest};
use haltere_dialect::crtp::toc::{Table, TocAnswer, TocRequest};
use haltere_dialect::crtp::value::{Kind, Value};
use haltere_dialect::crtp::{FromBoard, ToBoard};

use super::asked::Asked;
use super::blocks::{Ids, PERIODS_MS};

const GROUP: &str = "flightmode";
/// Names and values under which a legacy setpoint is roll, pitch and yaw as angles, and thrust (crazyflie-firmware
/// 2a18fc29, `crtp_commander_rpyt.c`).
const SETTINGS: [(&str, u8); 7] = [
    ("stabModeRoll", 1),
    ("stabModePitch", 1),
    ("stabModeYaw", 1),
    ("yawMode", 2),
    ("althold", 0),
    ("poshold", 0),
    ("posSet", 0),
];
/// Anchors of TDoA2.
const ANCHORS: u8 = 8;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Question {
    Protocol,
    Firmware,
    Count(Table),
    Name(Table, u16),
    Set(usize),
    Value(usize),
    Memories,
    Memory(u8),
    Anchor(u8),
    Reset,
    Fill(u8, u8),
    Start(u8),
}

/// Goes through them.
#[derive(Debug)]
pub(crate) struct Setup {
    next: Option<Question>,
    asked: Asked<Question>,
    counts: [u16; 2],
    settings: [Option<u16>; SETTINGS.len()],
    memories: u8,
    loco: Option<u8>,
    /// Of the board.
    pub protocol: Option<u32>,
    pub firmware: String,
    pub ids: Ids,
    /// Where the anchors say they are.
    pub anchors: [Option<AnchorPosition>; ANCHORS as usize],
    /// What was refused, or did not stay as it was set, in words.
    pub refused: Vec<String>,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            next: Some(Question::Protocol),
            asked: Asked::default(),
            counts: [0; 2],
            settings: [None; SETTINGS.len()],
            memories: 0,
            loco: None,
            protocol: None,
            firmware: String::new(),
            ids: Ids::default(),
            anchors: [None; ANCHORS as usize],
            refused: Vec::new(),
        }
    }
}

impl Setup {
    /// Whether everything was asked and answered.
    pub fn is_done(&self) -> bool {
        self.next.is_none()
    }

    /// Makes the log blocks anew: after a silence they may be gone.
    pub fn log_again(&mut self) {
        if self.is_done() {
            self.asked.forget();
            self.next = Some(Question::Reset);
        }
    }

    /// The packet to be sent now, when one is.
    pub fn due(&mut self, at: HostTime) -> Option<Packet> {
        let next = self.next;
        let question = self.asked.due(at, || next)?;
        self.request(question)?.encode()
    }

    /// What the board has answered.
    pub fn hear(&mut self, message: &FromBoard<'_>) {
        let Some(question) = self.asked.under_way() else { return };
        if let Some(next) = self.after(question, message) {
            self.asked.forget();
            self.next = next;
        }
    }

    fn request(&self, question: Question) -> Option<ToBoard<'static>> {
        Some(match question {
            Question::Protocol => ToBoard::Platform(PlatformRequest::Protocol),
            Question::Firmware => ToBoard::Platform(PlatformRequest::Firmware),
            Question::Count(table) => ToBoard::Toc(table, TocRequest::Info),
            Question::Name(table, id) => ToBoard::Toc(table, TocRequest::Item(id)),
            Question::Set(n) => {
                let (name, value) = *SETTINGS.get(n)?;
                let value = Value::Int(value.into());
                let kind = Kind::U8;
                ToBoard::Parameter(ParameterRequest::SetByName { group: GROUP, name, kind, value })
            }
            Question::Value(n) => {
                ToBoard::Parameter(ParameterRequest::Read((*self.settings.get(n)?)?))
            }
            Question::Memories => ToBoard::Memory(MemoryRequest::Count),
            Question::Memory(n) => ToBoard::Memory(MemoryRequest::Info(n)),
            Question::Anchor(anchor) => ToBoard::Memory(MemoryRequest::Read {
                memory: self.loco?,
                address: loco::position(anchor),
                len: loco::POSITION_LEN,
            }),
            Question::Reset | Question::Fill(..) | Question::Start(_) => {
                ToBoard::Log(self.control(question)?)
            }
        })
    }

    fn control(&self, question: Question) -> Option<LogControl> {
        match question {
            Question::Reset => Some(LogControl::Reset),
            Question::Fill(block, 0) => Some(LogControl::Create(block, self.ids.part(block, 0)?)),
            Question::Fill(block, part) => {
                Some(LogControl::Append(block, self.ids.part(block, part)?))
            }
            Question::Start(block) => {
                Some(LogControl::Start(block, *PERIODS_MS.get(usize::from(block))?))
            }
            _ => None,
        }
    }

    /// What comes after this question if that is its answer; the answer is taken.
    fn after(&mut self, question: Question, answer: &FromBoard<'_>) -> Option<Option<Question>> {
        let next = match (question, answer) {
            (Question::Protocol, FromBoard::Platform(PlatformAnswer::Protocol(number))) => {
                self.protocol = Some(*number);
                Question::Firmware
            }
            (Question::Firmware, FromBoard::Platform(PlatformAnswer::Firmware(tag))) => {
                self.firmware = (*tag).to_owned();
                Question::Count(Table::Log)
            }
            (Question::Count(table), FromBoard::Toc(of, TocAnswer::Info { count, .. }))
                if table == *of =>
            {
                self.counts[usize::from(table == Table::Parameters)] = *count;
                self.name(table, 0)
            }
            (Question::Name(table, id), FromBoard::Toc(of, TocAnswer::Item(item)))
                if table == *of && id == item.id =>
            {
                match table {
                    Table::Log => self.ids.learn(item),
                    Table::Parameters if item.group == GROUP => {
                        let known = SETTINGS.iter().zip(&mut self.settings);
                        for (_, id) in known.filter(|((name, _), _)| *name == item.name) {
                            *id = Some(item.id);
                        }
                    }
                    Table::Parameters => {}
                }
                self.name(table, id.saturating_add(1))
            }
            (
                Question::Set(n),
                FromBoard::Parameter(ParameterAnswer::SetByName { group, name, outcome }),
            ) if *group == GROUP && SETTINGS.get(n).is_some_and(|(of, _)| of == name) => {
                if let Err(why) = outcome {
                    self.refused.push(format!("{group}.{name}: {}", why.name()));
                    self.set(n + 1)
                } else {
                    Question::Value(n)
                }
            }
            (Question::Value(n), FromBoard::Parameter(ParameterAnswer::Read(id, outcome)))
                if self.settings.get(n) == Some(&Some(*id)) =>
            {
                let (name, value) = *SETTINGS.get(n)?;
                if *outcome != Ok(&[value]) {
                    self.refused.push(format!("{GROUP}.{name} did not become {value}"));
                }
                self.set(n + 1)
            }
            (_, FromBoard::Memory(answer)) => self.after_memory(question, answer)?,
            (_, FromBoard::Log(outcome)) => return self.after_log(question, outcome),
            _ => return None,
        };
        Some(Some(next))
    }

    fn name(&self, table: Table, id: u16) -> Question {
        let [log, parameters] = self.counts;
        match table {
            Table::Log if id < log => Question::Name(table, id),
            Table::Log => Question::Count(Table::Parameters),
            Table::Parameters if id < parameters => Question::Name(table, id),
            Table::Parameters => self.set(0),
        }
    }

    /// The next of the settings that the firmware has.
    fn set(&self, from: usize) -> Question {
        let mut known = self.settings.iter().enumerate().skip(from);
        known.find(|(_, id)| id.is_some()).map_or(Question::Memories, |(n, _)| Question::Set(n))
    }

    fn after_memory(&mut self, question: Question, answer: &MemoryAnswer<'_>) -> Option<Question> {
        match (question, *answer) {
            (Question::Memories, MemoryAnswer::Count(count)) => {
                self.memories = count;
                Some(if count == 0 { Question::Reset } else { Question::Memory(0) })
            }
            (Question::Memory(n), MemoryAnswer::Info(of, info)) if n == of => {
                if info.is_some_and(|info| info.kind == loco::TYPE) {
                    self.loco = Some(n);
                    return Some(Question::Anchor(0));
                }
                let more = n.saturating_add(1) < self.memories;
                Some(if more { Question::Memory(n + 1) } else { Question::Reset })
            }
            (Question::Anchor(n), MemoryAnswer::Read { memory, address, outcome })
                if self.loco == Some(memory) && address == loco::position(n) =>
            {
                let position = outcome.ok().and_then(AnchorPosition::read);
                *self.anchors.get_mut(usize::from(n))? = position.filter(|of| of.valid);
                Some(if n + 1 < ANCHORS { Question::Anchor(n + 1) } else { Question::Reset })
            }
            _ => None,
        }
    }

    fn after_log(&mut self, question: Question, answer: &LogOutcome) -> Option<Option<Question>> {
        let control = self.control(question)?;
        let block = match question {
            Question::Reset => answer.block,
            Question::Fill(block, _) | Question::Start(block) => block,
            _ => return None,
        };
        if (answer.command, answer.block) != (control.command(), block) {
            return None;
        }
        // An answer that was lost: the block stands already (17).
        let stands = matches!(question, Question::Fill(_, 0)) && self.asked.times() > 1;
        if let Err(why) = answer.outcome
            && !(stands && why.0.get() == 17)
        {
            self.refused.push(format!("log block {block}: {}", why.name()));
        }
        Some(match question {
            Question::Reset => self.fill(0),
            Question::Fill(block, part) if self.ids.part(block, part + 1).is_some() => {
                Some(Question::Fill(block, part + 1))
            }
            Question::Fill(block, _) => Some(Question::Start(block)),
            _ => self.fill(block + 1),
        })
    }

    /// The next block that has any variables.
    fn fill(&self, from: u8) -> Option<Question> {
        let mut blocks = (from..).take(PERIODS_MS.len().saturating_sub(from.into()));
        blocks
            .find(|block| self.ids.part(*block, 0).is_some())
            .map(|block| Question::Fill(block, 0))
    }
}

#[cfg(test)]
#[path = "setup_tests.rs"]
mod tests;
