//! Whether the board is armed, by the word of its heartbeats, of which a single one may be wrong.
//!
//! Setpoints that stop are a fall: one heartbeat that says disarmed, a damaged or a stranger's one, must not
//! end them. A person's kill switch must: it says so again a second later.

use haltere_core::time::HostTime;

/// Two heartbeats that say disarmed count when they are so far apart, s: half of the interval of a heartbeat at
/// 1 Hz, and more than what a wire can repeat.
const APART_S: f64 = 0.5;

/// What a heartbeat came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Said {
    /// It is armed now.
    Armed,
    /// It is disarmed now, beyond doubt.
    Disarmed,
    /// It says for the first time that it is not armed.
    Doubt,
    /// It says again that it is armed, after so many that denied it.
    ArmedAgain { denials: u32 },
}

/// What the heartbeats have said.
#[derive(Debug, Default)]
pub(super) struct ArmedWord {
    armed: bool,
    /// When it first denied to be armed since it last said that it is, and how often it did.
    denied: Option<(HostTime, u32)>,
    /// We asked it to disarm since we last asked it to arm.
    told_to_disarm: bool,
    /// It acknowledged that.
    acknowledged: bool,
}

impl ArmedWord {
    /// Whether it is taken for armed.
    pub fn is_armed(&self) -> bool {
        self.armed
    }

    /// Whether we asked it to disarm since we last asked it to arm.
    pub fn was_told_to_disarm(&self) -> bool {
        self.told_to_disarm
    }

    /// We ask it to arm, or to disarm.
    pub fn ordered(&mut self, arm: bool) {
        self.told_to_disarm = !arm;
        self.acknowledged = false;
    }

    /// It acknowledged a disarm command. `true`: it is disarmed now, it had said so.
    pub fn disarm_acknowledged(&mut self) -> bool {
        self.acknowledged = true;
        self.armed && self.denied.is_some() && self.end()
    }

    /// A heartbeat.
    pub fn heartbeat(&mut self, at: HostTime, armed: bool) -> Option<Said> {
        if armed {
            let denied = self.denied.take();
            if !std::mem::replace(&mut self.armed, true) {
                return Some(Said::Armed);
            }
            return denied.map(|(_, denials)| Said::ArmedAgain { denials });
        }
        if !self.armed {
            return None;
        }
        let (first, denials) = self.denied.get_or_insert((at, 0));
        *denials = denials.saturating_add(1);
        let (first, denials) = (*first, *denials);
        if self.acknowledged || at.seconds_since(first) >= APART_S {
            self.end();
            return Some(Said::Disarmed);
        }
        (denials == 1).then_some(Said::Doubt)
    }

    fn end(&mut self) -> bool {
        (self.armed, self.denied) = (false, None);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(1_000_000 + ms * 1000)
    }

    fn armed() -> ArmedWord {
        let mut word = ArmedWord::default();
        word.ordered(true);
        assert_eq!(word.heartbeat(at(0), false), None);
        assert_eq!(word.heartbeat(at(1), true), Some(Said::Armed));
        word
    }

    #[test]
    fn prop_one_word_is_doubted_and_two_apart_are_believed() {
        let mut word = armed();
        assert_eq!(word.heartbeat(at(1000), false), Some(Said::Doubt));
        assert_eq!(word.heartbeat(at(1200), false), None, "too soon after it");
        assert!(word.is_armed());
        assert_eq!(word.heartbeat(at(1500), false), Some(Said::Disarmed));
        assert!(!word.is_armed());
        // Armed by whom ever: that is for others to judge.
        assert_eq!(word.heartbeat(at(2000), true), Some(Said::Armed));
    }

    #[test]
    fn prop_what_was_denied_is_told_with_how_often() {
        for denials in 1..4u32 {
            let mut word = armed();
            for n in 0..denials {
                word.heartbeat(at(1000 + 100 * u64::from(n)), false);
            }
            assert_eq!(word.heartbeat(at(1900), true), Some(Said::ArmedAgain { denials }));
            assert_eq!(word.heartbeat(at(2000), true), None);
            // Each denial stands by itself again.
            assert_eq!(word.heartbeat(at(2900), false), Some(Said::Doubt));
        }
    }

    #[test]
    fn prop_after_an_acknowledged_disarm_one_word_is_enough() {
        let mut word = armed();
        word.ordered(false);
        assert!(!word.disarm_acknowledged() && word.is_armed());
        assert_eq!(word.heartbeat(at(1000), false), Some(Said::Disarmed));
        // Also where the heartbeat came before the answer.
        let mut word = armed();
        word.ordered(false);
        assert_eq!(word.heartbeat(at(1000), false), Some(Said::Doubt));
        assert!(word.disarm_acknowledged() && !word.is_armed());
        // An order to arm forgets both.
        word.ordered(true);
        word.heartbeat(at(2000), true);
        assert_eq!(word.heartbeat(at(3000), false), Some(Said::Doubt));
        assert!(!word.was_told_to_disarm());
    }
}
