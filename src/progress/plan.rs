//! The stages of a command, so that one figure says how long all of it still takes.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// A stage that took less than this share of what was expected had been done before, and says nothing of the machine.
const DONE_BEFORE: f64 = 0.1;

/// Stages in their order, and which of them is under way. One for each process: a command has one terminal.
static PLAN: Mutex<Option<Plan>> = Mutex::new(None);

struct Plan {
    /// Name, and how long it takes on two cores of some years ago, s.
    stages: Vec<(&'static str, f64)>,
    at: usize,
    began: Instant,
    /// Expected and true length of the stages that are over, s.
    expected_s: f64,
    took_s: f64,
}

/// What stands before and after the figures of a stage.
pub(super) struct Place {
    /// `[3/6] `, or nothing where there is no plan.
    pub number: String,
    /// What this stage usually takes, and those that follow, s; `None`: there is no plan.
    pub usual_s: Option<[f64; 2]>,
}

fn plan() -> MutexGuard<'static, Option<Plan>> {
    PLAN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// States the stages of a command with their usual lengths, s. A plan that is there stays: what is called by another
/// command is a part of that one.
pub fn stages(stages: &[(&'static str, f64)]) {
    plan().get_or_insert_with(|| Plan {
        stages: stages.to_vec(),
        at: 0,
        began: Instant::now(),
        expected_s: 0.0,
        took_s: 0.0,
    });
}

/// A stage begins: the next one of this name. What stands before it in the plan is over.
pub(super) fn begin(name: &str) {
    if let Some(plan) = plan().as_mut() {
        plan.begin(name);
    }
}

/// Where in the plan the stage under way is.
pub(super) fn place(name: &str) -> Place {
    plan()
        .as_ref()
        .and_then(|plan| plan.place(name))
        .unwrap_or(Place { number: String::new(), usual_s: None })
}

impl Plan {
    fn begin(&mut self, name: &str) {
        let ahead = self.stages.iter().skip(self.at).position(|(known, _)| *known == name);
        let Some(ahead) = ahead.filter(|ahead| *ahead > 0) else { return };
        let took_s = self.began.elapsed().as_secs_f64();
        let expected_s = self.stages[self.at].1;
        if took_s > DONE_BEFORE * expected_s {
            self.took_s += took_s;
            self.expected_s += expected_s;
        }
        self.at += ahead;
        self.began = Instant::now();
    }

    fn place(&self, name: &str) -> Option<Place> {
        let (known, own_s) = self.stages.get(self.at)?;
        if *known != name {
            return None;
        }
        // How slow this machine is, as far as it is known.
        let slow = if self.expected_s > 0.0 { self.took_s / self.expected_s } else { 1.0 };
        let after_s: f64 = self.stages[self.at + 1..].iter().map(|(_, s)| s * slow).sum();
        let number = format!("[{}/{}] ", self.at + 1, self.stages.len());
        Some(Place { number, usual_s: Some([own_s * slow, after_s]) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_stages_count_up_and_what_is_left_out_is_over() {
        let stages = vec![("flights", 10.0), ("bank", 80.0), ("sizes", 20.0), ("shrink", 5.0)];
        let (began, none) = (Instant::now(), 0.0);
        let mut plan = Plan { stages, at: 0, began, expected_s: none, took_s: none };
        let place = plan.place("flights").unwrap();
        assert_eq!((place.number.as_str(), place.usual_s), ("[1/4] ", Some([10.0, 105.0])));
        assert!(plan.place("sizes").is_none(), "not under way");
        plan.begin("sizes");
        let place = plan.place("sizes").unwrap();
        assert_eq!((place.number.as_str(), place.usual_s), ("[3/4] ", Some([20.0, 5.0])));
        plan.begin("flights");
        assert_eq!(plan.at, 2, "never back");
    }
}
