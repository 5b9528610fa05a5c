//! What is asked and set at connecting, one question after the other, each repeated until it is answered.
//!
//! Version and tag; both tables of names; what a legacy setpoint means (`flightmode.*`: angles, an absolute yaw, no
//! hold of height or position), read, where it is something else set by name, and read back; where the anchors say they
//! are; the log blocks. After a silence all of it is asked again, but for tables whose checksum is the one that is known.

use haltere_core::time::HostTime;
use haltere_dialect::crtp::loco::{self, AnchorPosition};
use haltere_dialect::crtp::log::{LogControl, LogOutcome};
use haltere_dialect::crtp::memory::{MemoryAnswer, MemoryRequest};
use haltere_dialect::crtp::packet::Packet;
use haltere_dialect::crtp::parameter::{ParameterAnswer, ParameterRequest};
use haltere_dialect::crtp::platform::{PlatformAnswer, PlatformRequest};
use haltere_dialect::crtp::toc::{Table, TocAnswer, TocItem, TocRequest};
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
pub(crate) const ANCHORS: u8 = 8;
/// A question that was sent so often without an answer, 2 s of it, has none.
const MOST_TIMES: u32 = 20;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Question {
    Protocol,
    Firmware,
    Count(Table),
    Name(Table, u16),
    /// The value of a setting; whether it was set by us.
    Value(usize, bool),
    Set(usize),
    Memories,
    Memory(u8),
    Anchor(u8),
    Reset,
    Fill(u8, u8),
    Start(u8),
}

/// A table as it was told: items, and checksum.
type Known = Option<(u16, u32)>;

/// Goes through them.
#[derive(Debug)]
pub(crate) struct Setup {
    next: Option<Question>,
    asked: Asked<Question>,
    /// The tables that are being read, and those that were read to the end.
    tables: [Known; 2],
    read: [Known; 2],
    settings: [Option<(u16, Kind)>; SETTINGS.len()],
    memories: u8,
    loco: Option<u8>,
    /// Nothing is written while it flies.
    flies: bool,
    is_again: bool,
    /// Only the anchors are asked.
    anchors_alone: bool,
    /// Of the board.
    pub protocol: Option<u32>,
    pub firmware: String,
    pub ids: Ids,
    /// Where the anchors say they are.
    pub anchors: [Option<AnchorPosition>; ANCHORS as usize],
    /// They were asked; taken by who tells it.
    pub anchors_read: bool,
    /// What is not as it must be to fly, with the way out.
    pub refused: Vec<String>,
    /// What else people should know; taken by who tells it.
    pub told: Vec<String>,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            next: Some(Question::Protocol),
            asked: Asked::default(),
            tables: [None; 2],
            read: [None; 2],
            settings: [None; SETTINGS.len()],
            memories: 0,
            loco: None,
            flies: false,
            is_again: false,
            anchors_alone: false,
            protocol: None,
            firmware: String::new(),
            ids: Ids::default(),
            anchors: [None; ANCHORS as usize],
            anchors_read: false,
            refused: Vec::new(),
            told: Vec::new(),
        }
    }
}

impl Setup {
    /// Whether everything was asked and answered; that anchors are asked again does not count.
    pub fn is_done(&self) -> bool {
        self.next.is_none() || self.anchors_alone
    }

    /// Whether this is the first time through.
    pub fn is_first(&self) -> bool {
        !self.is_again
    }

    /// Asks the anchors again, where some have not said where they are.
    pub fn ask_anchors(&mut self) {
        let asks = self.next.is_none() && self.loco.is_some();
        if asks && self.anchors.iter().any(Option::is_none) {
            self.anchors_alone = true;
            self.go_on(Some(Question::Anchor(0)));
        }
    }

    /// Whether its firmware is older than what is promised. What somebody has built has no such tag.
    pub fn is_old(&self) -> bool {
        let mut parts = self.firmware.split(|c: char| !c.is_ascii_digit());
        let mut part = || parts.next()?.parse::<u32>().ok();
        matches!((part(), part()), (Some(year), Some(month)) if [year, month] < OLDEST)
    }

    /// How far it is, for people.
    pub fn progress(&self) -> String {
        match self.next {
            Some(Question::Name(table, id)) => {
                let count = self.tables[table as usize].map_or(0, |(count, _)| count);
                format!("name {id} of {count} in its table of {}", words(table))
            }
            Some(question) => what(question).to_owned(),
            None => "done".to_owned(),
        }
    }

    /// Begins anew: it was silent, or has restarted. In the air nothing is written.
    pub fn again(&mut self, flies: bool) {
        self.asked.forget();
        self.next = Some(Question::Protocol);
        self.is_again |= self.read[1].is_some();
        (self.flies, self.anchors_alone) = (flies, false);
        self.refused.clear();
    }

    /// The packet to be sent now, when one is.
    pub fn due(&mut self, at: HostTime) -> Option<Packet> {
        let again = self.asked.is_due_again(at);
        if let (Some(Question::Fill(_, 1..)), true) = (self.asked.under_way(), again) {
            // Whether the board has added the names and its answer was lost nobody knows: a second time they would stand
            // there twice.
            self.go_on(Some(Question::Reset));
        } else if let (Some(question), true) = (self.asked.under_way(), again)
            && self.asked.times() >= MOST_TIMES
        {
            let next = self.unanswered(question);
            self.go_on(next);
        }
        let next = self.next;
        let question = self.asked.due(at, || next)?;
        self.request(question)?.encode()
    }

    /// What the board has answered.
    pub fn hear(&mut self, message: &FromBoard<'_>) {
        // A link that knows the table tells its names without being asked for each.
        let is_name = matches!(message, FromBoard::Toc(_, TocAnswer::Item(_)));
        let unasked = || self.next.filter(|next| is_name && matches!(next, Question::Name(..)));
        let Some(question) = self.asked.under_way().or_else(unasked) else { return };
        if let Some(next) = self.after(question, message) {
            self.go_on(next);
        }
    }

    fn go_on(&mut self, next: Option<Question>) {
        self.asked.forget();
        self.next = next;
    }

    fn tell(&mut self, text: String) {
        if !self.told.contains(&text) {
            self.told.push(text);
        }
    }

    /// What comes after a question that has no answer, which is told.
    fn unanswered(&mut self, question: Question) -> Option<Question> {
        let next = match question {
            // Nobody is there, which is told as such.
            Question::Protocol => return Some(question),
            Question::Firmware => Some(Question::Count(Table::Log)),
            Question::Name(table, id) => Some(self.name(table, id.saturating_add(1))),
            Question::Value(n, _) | Question::Set(n) => {
                let name = SETTINGS.get(n).map_or("", |(name, _)| name);
                self.refuse(format!("board does not answer about {GROUP}.{name}: restart it"));
                return Some(self.setting(n + 1));
            }
            Question::Memories | Question::Memory(_) | Question::Anchor(_) => self.after_anchors(),
            Question::Count(_) | Question::Reset | Question::Fill(..) | Question::Start(_) => {
                Some(Question::Protocol)
            }
        };
        self.tell(format!("board does not answer about {}: restart it", what(question)));
        next
    }

    fn refuse(&mut self, why: String) {
        if !self.refused.contains(&why) {
            self.refused.push(why);
        }
    }

    fn request(&self, question: Question) -> Option<ToBoard<'static>> {
        Some(match question {
            Question::Protocol => ToBoard::Platform(PlatformRequest::Protocol),
            Question::Firmware => ToBoard::Platform(PlatformRequest::Firmware),
            Question::Count(table) => ToBoard::Toc(table, TocRequest::Info),
            Question::Name(table, id) => ToBoard::Toc(table, TocRequest::Item(id)),
            Question::Set(n) => {
                let ((name, value), (_, kind)) = (*SETTINGS.get(n)?, (*self.settings.get(n)?)?);
                let value = Value::Int(value.into());
                ToBoard::Parameter(ParameterRequest::SetByName { group: GROUP, name, kind, value })
            }
            Question::Value(n, _) => {
                ToBoard::Parameter(ParameterRequest::Read((*self.settings.get(n)?)?.0))
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
            (Question::Count(_) | Question::Name(..), FromBoard::Toc(of, answer)) => {
                self.after_toc(question, *of, answer)?
            }
            (Question::Set(_) | Question::Value(..), FromBoard::Parameter(answer)) => {
                self.after_parameter(question, answer)?
            }
            (_, FromBoard::Memory(answer)) => return self.after_memory(question, answer),
            (_, FromBoard::Log(outcome)) => return self.after_log(question, outcome),
            _ => return None,
        };
        Some(Some(next))
    }

    fn after_toc(
        &mut self,
        question: Question,
        of: Table,
        answer: &TocAnswer<'_>,
    ) -> Option<Question> {
        match (question, answer) {
            (Question::Count(table), TocAnswer::Info { count, crc, .. }) if table == of => {
                let told = Some((*count, *crc));
                self.tables[table as usize] = told;
                if self.read[table as usize] == told {
                    return Some(self.name(table, *count));
                }
                match table {
                    Table::Log => self.ids = Ids::default(),
                    Table::Parameters => self.settings = [None; SETTINGS.len()],
                }
                Some(self.name(table, 0))
            }
            (Question::Name(table, id), TocAnswer::Item(item)) if table == of && id == item.id => {
                self.learn(table, item);
                Some(self.name(table, id.saturating_add(1)))
            }
            (Question::Name(table, id), TocAnswer::NoItem) if table == of => {
                self.tell(format!(
                    "board has no item {id} in its table of {}, which it says is longer: flash it anew",
                    words(table)
                ));
                Some(self.name(table, u16::MAX))
            }
            _ => None,
        }
    }

    fn learn(&mut self, table: Table, item: &TocItem<'_>) {
        match table {
            Table::Log => self.ids.learn(item),
            Table::Parameters if item.group == GROUP => {
                let known = SETTINGS.iter().zip(&mut self.settings);
                for (_, setting) in known.filter(|((name, _), _)| *name == item.name) {
                    *setting = item.kind(table).map(|kind| (item.id, kind));
                }
            }
            Table::Parameters => {}
        }
    }

    fn name(&mut self, table: Table, id: u16) -> Question {
        if self.tables[table as usize].is_some_and(|(count, _)| id < count) {
            return Question::Name(table, id);
        }
        self.read[table as usize] = self.tables[table as usize];
        if table == Table::Log {
            return Question::Count(Table::Parameters);
        }
        for (name, _) in SETTINGS.iter().zip(&self.settings).filter(|(_, id)| id.is_none()) {
            let why = format!("board has no parameter {GROUP}.{}: {FLASH}", name.0);
            if !self.refused.contains(&why) {
                self.refused.push(why);
            }
        }
        self.setting(0)
    }

    /// The next of the settings that the firmware has.
    fn setting(&self, from: usize) -> Question {
        let mut known = self.settings.iter().enumerate().skip(from);
        // In the air rows are missed more than anchors are.
        let then = if self.flies { Question::Reset } else { Question::Memories };
        known.find(|(_, id)| id.is_some()).map_or(then, |(n, _)| Question::Value(n, false))
    }

    fn after_parameter(
        &mut self,
        question: Question,
        answer: &ParameterAnswer<'_>,
    ) -> Option<Question> {
        match (question, answer) {
            (Question::Set(n), ParameterAnswer::SetByName { group, name, outcome })
                if *group == GROUP && SETTINGS.get(n).is_some_and(|(of, _)| of == name) =>
            {
                let Err(why) = outcome else { return Some(Question::Value(n, true)) };
                self.refuse(format!("board refuses {group}.{name}: {}", why.name()));
                Some(self.setting(n + 1))
            }
            (Question::Value(n, was_set), ParameterAnswer::Read(id, outcome)) => {
                let (of, kind) = (*self.settings.get(n)?)?;
                if of != *id {
                    return None;
                }
                let (name, wanted) = *SETTINGS.get(n)?;
                let value = outcome.ok().and_then(|bytes| kind.read(bytes));
                if value == Some(Value::Int(wanted.into())) {
                    return Some(self.setting(n + 1));
                }
                if !was_set && !self.flies {
                    return Some(Question::Set(n));
                }
                self.refuse(format!(
                    "{GROUP}.{name} of the board did not become {wanted}: {FLASH}"
                ));
                Some(self.setting(n + 1))
            }
            _ => None,
        }
    }

    fn after_memory(
        &mut self,
        question: Question,
        answer: &MemoryAnswer<'_>,
    ) -> Option<Option<Question>> {
        Some(match (question, *answer) {
            (Question::Memories, MemoryAnswer::Count(count)) => {
                self.memories = count;
                Some(self.memory(0))
            }
            (Question::Memory(n), MemoryAnswer::Info(of, info)) if n == of => {
                if info.is_some_and(|info| info.kind == loco::TYPE) {
                    self.loco = Some(n);
                    return Some(Some(Question::Anchor(0)));
                }
                Some(self.memory(n.saturating_add(1)))
            }
            (Question::Anchor(n), MemoryAnswer::Read { memory, address, outcome })
                if self.loco == Some(memory) && address == loco::position(n) =>
            {
                let position = outcome.ok().and_then(AnchorPosition::read);
                *self.anchors.get_mut(usize::from(n))? = position.filter(|of| of.valid);
                if n + 1 < ANCHORS { Some(Question::Anchor(n + 1)) } else { self.after_anchors() }
            }
            _ => return None,
        })
    }

    fn after_anchors(&mut self) -> Option<Question> {
        self.anchors_read = true;
        (!std::mem::take(&mut self.anchors_alone)).then_some(Question::Reset)
    }

    fn memory(&mut self, n: u8) -> Question {
        if n < self.memories {
            return Question::Memory(n);
        }
        self.refuse("board has no memory of a Loco deck: plug the deck in, and restart it".into());
        Question::Reset
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
            self.refuse(format!("board refuses log block {block}: {}", why.name()));
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

/// Year and month of the oldest release that is promised: it sets log blocks up in milliseconds, and does not lock when it
/// is disarmed after a landing (PR 1426).
const OLDEST: [u32; 2] = [2024, 10];
/// The way out where a name is missing.
pub(crate) const FLASH: &str =
    "flash the vehicle, not the dongle or the anchors, with release 2024.10 or later";

fn words(table: Table) -> &'static str {
    match table {
        Table::Log => "log variables",
        Table::Parameters => "parameters",
    }
}

fn what(question: Question) -> &'static str {
    match question {
        Question::Protocol => "its protocol",
        Question::Firmware => "its firmware",
        Question::Count(table) | Question::Name(table, _) => words(table),
        Question::Value(..) | Question::Set(_) => "its parameters flightmode.*",
        Question::Memories | Question::Memory(_) | Question::Anchor(_) => "its memories",
        Question::Reset | Question::Fill(..) | Question::Start(_) => "its log blocks",
    }
}

#[cfg(test)]
mod tests;
