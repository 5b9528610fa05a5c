//! One question under way: sent, repeated until it is answered.
//!
//! The board's receive task blocks where a port's queue of 16 is full (crazyflie-firmware 2a18fc29, `crtp.c`), and no
//! setpoint passes then: a port has one question under way, and while the vehicle flies none.

use haltere_core::time::HostTime;

/// A question that is not answered is sent again after this, µs: twelve times the 8 ms in which 95 % of round trips must
/// end (crazyflie-testing bf7c5e3).
const AGAIN_US: i64 = 100_000;

/// The question of one port.
#[derive(Debug)]
pub(crate) struct Asked<Q> {
    question: Option<Q>,
    next_at: HostTime,
    times: u32,
}

impl<Q> Default for Asked<Q> {
    fn default() -> Self {
        Self { question: None, next_at: HostTime::default(), times: 0 }
    }
}

impl<Q: Copy + PartialEq> Asked<Q> {
    /// The question to be sent now: the one under way where its time is over, else the next one.
    pub fn due(&mut self, at: HostTime, next: impl FnOnce() -> Option<Q>) -> Option<Q> {
        if self.question.is_none() {
            (self.question, self.times, self.next_at) = (next(), 0, at);
        }
        if at < self.next_at {
            return None;
        }
        let question = self.question?;
        self.times += 1;
        self.next_at = at.offset_us(AGAIN_US);
        Some(question)
    }

    /// The question under way.
    pub fn under_way(&self) -> Option<Q> {
        self.question
    }

    /// Whether the question under way is to be sent again.
    pub fn is_due_again(&self, at: HostTime) -> bool {
        self.question.is_some() && self.times > 0 && at >= self.next_at
    }

    /// How often the question under way was sent.
    pub fn times(&self) -> u32 {
        self.times
    }

    /// Asks nothing more.
    pub fn forget(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(1_000_000 + ms * 1000)
    }

    #[test]
    fn prop_a_lost_question_is_asked_again() {
        let mut asked = Asked::default();
        let mut left = vec![2, 1];
        assert_eq!(asked.due(at(0), || left.pop()), Some(1));
        assert_eq!(asked.due(at(99), || left.pop()), None, "one at a time");
        assert_eq!(asked.due(at(100), || left.pop()), Some(1));
        assert_eq!((asked.times(), asked.is_due_again(at(200))), (2, true));
        asked.forget();
        assert_eq!(asked.due(at(110), || left.pop()), Some(2));
        asked.forget();
        assert_eq!(asked.due(at(300), || left.pop()), None);
    }
}
