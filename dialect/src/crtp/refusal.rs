//! Why the board did not do what it was asked: one byte, of C's error numbers.

use std::num::NonZeroU8;

/// The byte, which is not 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refusal(pub NonZeroU8);

/// Those that present firmware sends. Source: `docs/functional-areas/crtp/crtp_error_numbers.md`; what each means
/// here is read from `log.c`, `param_logic.c` and `crtp_mem.c` (crazyflie-firmware 2a18fc29).
const NAMES: [(u8, &str); 8] = [
    (2, "there is no such block, variable or parameter"),
    (5, "the memory does not answer at this address"),
    (7, "the block is full: 26 bytes"),
    (8, "the command is unknown"),
    (12, "no room for another block or variable"),
    (13, "it can only be read"),
    (17, "the block exists already"),
    (22, "the type is another"),
];

impl Refusal {
    /// Of the byte that tells the outcome.
    pub fn outcome(byte: u8) -> Result<(), Self> {
        NonZeroU8::new(byte).map_or(Ok(()), |number| Err(Self(number)))
    }

    /// The byte that tells this outcome.
    pub fn byte(outcome: Result<(), Self>) -> u8 {
        outcome.err().map_or(0, |refusal| refusal.0.get())
    }

    /// In words.
    pub fn name(self) -> &'static str {
        let named = NAMES.iter().find(|(number, _)| *number == self.0.get());
        named.map_or("no reason we know", |(_, name)| name)
    }
}
