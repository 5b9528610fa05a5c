//! The stages of a command, so that one figure says how long all of it still takes.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// A stage that took less than this share of what was expected had been done before, and says nothing of the machine.
const DONE_BEFORE: f64 = 0.1;
/// Share of the whole for which the usual lengths speak against what this run has shown (judgement).
const TRUST: f64 = 0.3;

/// Stages in their order, and which of them is under way. One for each process: a command has one terminal.
static PLAN: Mutex<Option<Plan>> = Mutex::new(None);

struct Plan {
    /// Name, and how long it takes: as it took here the last time, else on two cores of some years ago, s.
    stages: Vec<(&'static str, f64)>,
    /// Under which each is kept.
    keys: Vec<String>,
    at: usize,
    began: Instant,
    /// Expected and true length of the stages that are over, s.
    expected_s: f64,
    took_s: f64,
    /// What each took here the last time; where it is kept.
    costs: BTreeMap<String, f64>,
    kept: PathBuf,
}

/// What stands before and after the figures of a stage.
pub(super) struct Place {
    /// `[3/6] `, or nothing where there is no plan.
    pub number: String,
    /// What all of it still takes, s; `None`: there is no plan.
    pub left_s: Option<f64>,
    /// Whether it is not known yet what had been done before.
    pub first: bool,
}

fn plan() -> MutexGuard<'static, Option<Plan>> {
    PLAN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// States the stages of a command with their usual lengths, s; `kept` is a file in which it is kept how long they took on
/// this computer. A plan that is there stays: what is called by another command is a part of that one.
pub fn stages(stages: &[(&'static str, f64)], kept: PathBuf) {
    plan().get_or_insert_with(|| Plan::new(stages, kept));
}

/// A stage begins: the next one of this name. What stands before it in the plan is over.
pub(super) fn begin(name: &str) {
    if let Some(plan) = plan().as_mut() {
        plan.begin(name);
    }
}

/// Where in the plan the stage under way is, of which a share is done.
pub(super) fn place(name: &str, share: f64) -> Place {
    plan().as_ref().and_then(|plan| plan.place(name, share)).unwrap_or(Place {
        number: String::new(),
        left_s: None,
        first: false,
    })
}

/// A stage of another size is another stage.
fn key((name, usual_s): (&str, f64)) -> String {
    format!("{name}, {usual_s:.0} s")
}

impl Plan {
    fn new(stages: &[(&'static str, f64)], kept: PathBuf) -> Self {
        let text = std::fs::read_to_string(&kept).unwrap_or_default();
        let costs: BTreeMap<String, f64> = serde_json::from_str(&text).unwrap_or_default();
        let here = |stage: &(&'static str, f64)| {
            let known = costs.get(&key(*stage)).copied();
            (stage.0, known.filter(|s| s.is_finite() && *s > 0.0).unwrap_or(stage.1))
        };
        Self {
            stages: stages.iter().map(here).collect(),
            keys: stages.iter().map(|stage| key(*stage)).collect(),
            at: 0,
            began: Instant::now(),
            expected_s: 0.0,
            took_s: 0.0,
            costs,
            kept,
        }
    }

    fn begin(&mut self, name: &str) {
        let ahead = self.stages.iter().skip(self.at).position(|(known, _)| *known == name);
        let Some(ahead) = ahead.filter(|ahead| *ahead > 0) else { return };
        self.over(self.began.elapsed().as_secs_f64());
        self.at += ahead;
        self.began = Instant::now();
    }

    /// The stage under way is over.
    fn over(&mut self, took_s: f64) {
        let expected_s = self.stages[self.at].1;
        if took_s > DONE_BEFORE * expected_s {
            self.took_s += took_s;
            self.expected_s += expected_s;
            self.costs.insert(self.keys[self.at].clone(), took_s);
            // Where it cannot be kept the next estimate is one of another computer.
            if let Ok(text) = serde_json::to_string(&self.costs) {
                let folder = self.kept.parent().map_or(Ok(()), std::fs::create_dir_all);
                let _ = folder.and_then(|()| std::fs::write(&self.kept, text));
            }
        }
    }

    fn place(&self, name: &str, share: f64) -> Option<Place> {
        self.stages.get(self.at).filter(|(known, _)| *known == name)?;
        let number = format!("[{}/{}] ", self.at + 1, self.stages.len());
        let left_s = Some(self.left_s(share, self.began.elapsed().as_secs_f64()));
        Some(Place { number, left_s, first: self.at == 0 })
    }

    /// What is left by its weights, times how slow this run is so far. A short stage says little of a long one: what was
    /// done counts for as much as it is of the whole, and the rest is taken for as it usually is.
    fn left_s(&self, share: f64, running_s: f64) -> f64 {
        let own_s = self.stages[self.at].1;
        let after_s: f64 = self.stages[self.at + 1..].iter().map(|(_, s)| s).sum();
        let whole_s: f64 = self.stages.iter().map(|(_, s)| s).sum();
        let trust_s = TRUST * whole_s;
        let slow =
            (self.took_s + running_s + trust_s) / (self.expected_s + share * own_s + trust_s);
        ((1.0 - share) * own_s + after_s) * slow
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAGES: [(&str, f64); 4] =
        [("flights", 10.0), ("bank", 80.0), ("sizes", 20.0), ("shrink", 5.0)];

    #[test]
    fn prop_stages_count_up_and_what_is_left_out_is_over() {
        let folder = tempfile::tempdir().unwrap();
        let mut plan = Plan::new(&STAGES, folder.path().join("stages.json"));
        let place = plan.place("flights", 0.0).unwrap();
        assert_eq!(place.number, "[1/4] ");
        assert!((place.left_s.unwrap() - 115.0).abs() < 1.0, "{:?}", place.left_s);
        assert!(plan.place("sizes", 0.0).is_none(), "not under way");
        plan.begin("sizes");
        let place = plan.place("sizes", 0.0).unwrap();
        assert_eq!(place.number, "[3/4] ");
        // What took no time had been done before, and says nothing of the machine.
        assert!((place.left_s.unwrap() - 25.0).abs() < 1.0, "{:?}", place.left_s);
        plan.begin("flights");
        assert_eq!(plan.at, 2, "never back");
    }

    /// From 265 s it went to 1299 s where one stage followed another.
    #[test]
    fn regress_the_time_left_does_not_jump() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("stages.json");
        // The short first stage takes five times as long as usual, the others as long as usual.
        let mut plan = Plan::new(&STAGES, file.clone());
        let took_s = [50.0, 80.0, 20.0, 5.0];
        let mut told: Vec<f64> = Vec::new();
        for (n, took_s) in took_s.into_iter().enumerate() {
            plan.at = n;
            for step in 0..=100 {
                let share = f64::from(step) * 0.01;
                told.push(plan.left_s(share, share * took_s));
            }
            plan.over(took_s);
        }
        let jump_s = told.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        assert!(jump_s < 10.0, "{jump_s} s from one line to the next");
        let most_s = told.iter().copied().fold(0.0, f64::max);
        assert!(most_s < 2.5 * told[0], "{most_s} s, {} s at the start", told[0]);
        assert_eq!(told.last(), Some(&0.0));
        // The next time it is known what the stages cost here.
        let again = Plan::new(&STAGES, file);
        let left_s = again.left_s(0.0, 0.0);
        assert!((left_s - took_s.iter().sum::<f64>()).abs() < 1e-9, "{left_s}");
    }
}
