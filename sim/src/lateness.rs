//! How late a simulator was that stands in for tag and board: what was flown with it meanwhile is no flight of the vehicle.

use serde_json::{Value, json};

/// A wake-up later than this is felt, µs: the companion has taken another step meanwhile.
const FELT_US: u64 = 10_000;
/// So many of them explain a flight that went wrong: with one a millisecond, a tenth of a second.
const MANY: u64 = 100;

/// Late wake-ups of a loop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Lateness {
    times: u64,
    worst_us: u64,
}

impl Lateness {
    /// A wake-up, so late, µs.
    pub fn note(&mut self, late_us: u64) {
        self.times += u64::from(late_us > FELT_US);
        self.worst_us = self.worst_us.max(late_us);
    }

    /// What people are told, where it was so late that nothing can be said of the vehicle.
    pub fn not_judged(&self) -> Option<String> {
        (self.times >= MANY).then(|| {
            format!(
                "NOT JUDGED: the simulator itself was {} times late, by up to {:.2} s; end other work",
                self.times,
                self.worst_us as f64 * 1e-6
            )
        })
    }

    /// For scripts: `late`, `worst_late_s`, and `not_judged`, which is null where it kept its time.
    pub fn json(&self) -> Value {
        json!({
            "late": self.times,
            "worst_late_s": self.worst_us as f64 * 1e-6,
            "not_judged": self.not_judged(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_simulator_that_kept_its_time_judges_and_one_that_starved_does_not() {
        let mut lateness = Lateness::default();
        (0..100_000).for_each(|_| lateness.note(2_000));
        (0..MANY - 1).for_each(|_| lateness.note(30_000));
        assert_eq!(lateness.not_judged(), None);
        assert_eq!(lateness.json()["late"], MANY - 1);
        lateness.note(250_000);
        let words = lateness.not_judged().unwrap();
        assert!(
            words.starts_with("NOT JUDGED: the simulator itself was 100 times late"),
            "{words}"
        );
        assert!(words.contains("0.25 s") && words.ends_with("end other work"), "{words}");
    }
}
