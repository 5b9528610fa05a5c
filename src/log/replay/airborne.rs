//! Whether the vehicle was in the air, as flown.
//!
//! A core of another build may act otherwise on the same inputs: refuse to arm, or land. Its filter must be told
//! all the same that the vehicle flew, since its inputs are those of the flight that took place.

use crate::record::LogReader;
use haltere_core::time::HostTime;
use haltere_pilot::Mode;

/// Changes of mode as the log has them. Empty: the core is left to itself.
#[derive(Debug, Default)]
pub(super) struct Airborne {
    modes: Vec<(HostTime, Option<Mode>)>,
    /// How many of them lie behind.
    passed: usize,
}

impl Airborne {
    /// Of a flight.
    pub fn flown(log: &LogReader) -> Self {
        let told = log.modes().into_iter();
        let modes = told.map(|m| (HostTime::from_us(m.at_us), Mode::from_name(&m.mode)));
        Self { modes: modes.collect(), passed: 0 }
    }

    /// What the filter must be told before the wake-up at `at`.
    pub fn told(&mut self, at: HostTime) -> Option<bool> {
        let before = self.passed;
        while self.modes.get(self.passed).is_some_and(|(since, _)| *since < at) {
            self.passed += 1;
        }
        let (_, mode) = self.modes.get(self.passed.checked_sub(1)?)?;
        match (*mode)? {
            // Once: from then on somebody else may fly it.
            Mode::Disarmed => (self.passed > before).then_some(false),
            // On the floor, or about to leave it.
            Mode::Arming | Mode::Idle | Mode::Spool | Mode::Disarming => None,
            _ => Some(true),
        }
    }
}
