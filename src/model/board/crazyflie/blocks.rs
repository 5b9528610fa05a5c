//! Log blocks: made, filled, started, and their rows.

use haltere_dialect::crtp::FromBoard;
use haltere_dialect::crtp::log::{self, LogControl, LogOutcome, LogRow, MAX_ROW};
use haltere_dialect::crtp::packet::Packet;
use haltere_dialect::crtp::refusal::Refusal;
use haltere_dialect::crtp::value::{Kind, Value};

/// `log.c`, `LOG_MAX_BLOCKS` and `LOG_MAX_OPS`, as the table tells them.
pub(super) const MOST_BLOCKS: usize = 16;
pub(super) const MOST_VARIABLES: usize = 128;

// C's error numbers as the board sends them.
const NO_ENTRY: u8 = 2;
const TOO_BIG: u8 = 7;
const NO_COMMAND: u8 = 8;
const NO_MEMORY: u8 = 12;
const EXISTS: u8 = 17;

struct Block {
    id: u8,
    variables: Vec<log::Variable>,
    /// Period, and when the next row is due, µs of the board's clock. `None`: stopped.
    runs: Option<(u64, u64)>,
}

impl Block {
    fn width(&self) -> usize {
        self.variables.iter().map(|v| v.kind.width()).sum()
    }
}

/// All blocks.
#[derive(Default)]
pub(super) struct Blocks(Vec<Block>);

pub(super) fn refused(number: u8) -> Result<(), Refusal> {
    Refusal::outcome(number)
}

impl Blocks {
    /// Whether there is any.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Obeys; `now_us` is the board's clock, `known` says whether there is a variable of this id.
    pub fn obey(
        &mut self,
        order: &LogControl,
        now_us: u64,
        known: impl Fn(u16) -> bool,
    ) -> LogOutcome {
        let (block, done) = match order {
            LogControl::Create(id, variables) => {
                (*id, self.create(*id, variables.as_slice(), known))
            }
            LogControl::Append(id, variables) => {
                (*id, self.append(*id, variables.as_slice(), known))
            }
            LogControl::Delete(id) => {
                let before = self.0.len();
                self.0.retain(|block| block.id != *id);
                (*id, if self.0.len() < before { Ok(()) } else { Err(NO_ENTRY) })
            }
            LogControl::Start(id, ms) => (*id, self.run(*id, u64::from(*ms), now_us)),
            LogControl::Start10Ms(id, tens) => (*id, self.run(*id, 10 * u64::from(*tens), now_us)),
            LogControl::Stop(id) => {
                let found = self.find(*id).map(|block| block.runs = None);
                (*id, found.ok_or(NO_ENTRY))
            }
            LogControl::Reset => {
                self.clear();
                (0, Ok(()))
            }
        };
        let outcome = done.or_else(refused);
        LogOutcome { command: order.command(), block, outcome }
    }

    /// The answer to a command that there is none of.
    pub fn unknown(command: u8, block: u8) -> LogOutcome {
        LogOutcome { command, block, outcome: refused(NO_COMMAND) }
    }

    fn find(&mut self, id: u8) -> Option<&mut Block> {
        self.0.iter_mut().find(|block| block.id == id)
    }

    fn create(
        &mut self,
        id: u8,
        variables: &[log::Variable],
        known: impl Fn(u16) -> bool,
    ) -> Result<(), u8> {
        if self.find(id).is_some() {
            return Err(EXISTS);
        }
        if self.0.len() >= MOST_BLOCKS {
            return Err(NO_MEMORY);
        }
        self.0.push(Block { id, variables: Vec::new(), runs: None });
        self.append(id, variables, known)
    }

    fn append(
        &mut self,
        id: u8,
        variables: &[log::Variable],
        known: impl Fn(u16) -> bool,
    ) -> Result<(), u8> {
        let before: usize = self.0.iter().map(|block| block.variables.len()).sum();
        let Some(block) = self.find(id) else { return Err(NO_ENTRY) };
        for (all, variable) in (before..).zip(variables) {
            if block.width() + variable.kind.width() > MAX_ROW {
                return Err(TOO_BIG);
            }
            if !known(variable.id) {
                return Err(NO_ENTRY);
            }
            if all >= MOST_VARIABLES {
                return Err(NO_MEMORY);
            }
            block.variables.push(*variable);
        }
        Ok(())
    }

    /// With a period of 0 there is one row, at once.
    fn run(&mut self, id: u8, period_ms: u64, now_us: u64) -> Result<(), u8> {
        let Some(block) = self.find(id) else { return Err(NO_ENTRY) };
        let period_us = period_ms * 1000;
        block.runs = Some((period_us, now_us + period_us));
        Ok(())
    }

    /// Rows that are due by `now_us` of the board's clock, in the order of their blocks.
    pub fn rows(
        &mut self,
        now_us: u64,
        value: impl Fn(u16) -> Option<Value>,
        mut out: impl FnMut(Packet),
    ) {
        for block in &mut self.0 {
            let Some((period_us, due_us)) = block.runs else { continue };
            if due_us > now_us {
                continue;
            }
            // A row is the last value of each variable: what fell due twice is not made up for.
            let late = (now_us - due_us).checked_div(period_us).unwrap_or(0);
            block.runs = (period_us > 0).then_some((period_us, due_us + (late + 1) * period_us));
            let mut bytes = Vec::with_capacity(MAX_ROW);
            for variable in &block.variables {
                let raw = value(variable.id).and_then(|value| cast(variable.kind, value));
                bytes.extend_from_slice(&raw.unwrap_or_default()[..variable.kind.width()]);
            }
            let time_ms = (due_us / 1000) as u32 & ((1 << log::TIME_BITS) - 1);
            let row = LogRow { block: block.id, time_ms, bytes: &bytes };
            if let Some(packet) = FromBoard::Row(row).encode() {
                out(packet);
            }
        }
    }
}

/// What C makes of a value of another type: cut to its width, fractions cut off.
fn cast(kind: Kind, value: Value) -> Option<[u8; 4]> {
    if let Some(bytes) = kind.write(value) {
        return Some(bytes);
    }
    Some((value.f64() as i64 as u32).to_le_bytes())
}
