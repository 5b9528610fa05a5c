//! The answers of this diagnosis, given before any key is opened. Flights of one mission share a bank; a
//! flight that ended early is judged by a bank of the part that it flew.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use haltere_gap::attribute::{Attribution, Attributor};
use haltere_gap::bank::LEAST_NULLS;
use haltere_gap::bank::make_bank::BankSize;
use haltere_gap::bank::workshop::Workshop;
use haltere_gap::diagnosis::{Observed, observed};
use haltere_gap::flight::logs::{self, Flown};
use haltere_gap::flight::statistics::ANCHOR_SLOTS;
use haltere_gap::scene::Told;
use haltere_model::effects::EffectSpec;

use super::{Answer, BlindError, Choice, Entry, Given, Public, Suite};

/// What flights of one mission, or of one part of it, are judged by.
pub(crate) struct Bench {
    pub workshop: Workshop,
    pub attributor: Attributor,
    /// Statistics of accepted flights, for the background and for the limits.
    pub references: Vec<Vec<f64>>,
    pub calibration: Vec<Vec<f64>>,
}

/// Where the suite is, and how it is scored.
pub(crate) struct Hall<'a> {
    pub dir: &'a Path,
    pub banks: &'a Path,
    pub told: &'a Told,
    pub choice: &'a Choice,
    pub suite: &'a Suite,
    pub library: &'a [&'static EffectSpec],
}

impl Hall<'_> {
    /// Bank and reference flights of the mission of `first`, as far as `until_s`.
    pub fn bench(
        &self,
        first: &Entry,
        until_s: Option<f64>,
        tell: &(impl Fn(String) + Sync),
    ) -> Result<Bench, BlindError> {
        let flown = logs::read(&self.dir.join(&first.log))?;
        let mut scene = flown.scene(self.told).for_bank(&flown.mission);
        scene.until_s = until_s;
        let part = until_s.map_or(String::new(), |s| format!(", its first {s:.0} s"));
        tell(format!("bank of the {} mission{part}", first.mission));
        let BankSize { seeds, jitter, draws } = self.choice.size;
        // A part serves one or two flights of the suite.
        let half = |n: usize| n.div_ceil(2).max(LEAST_NULLS);
        let size = match until_s {
            None => self.choice.size,
            Some(_) => BankSize { seeds: half(seeds), jitter: half(jitter), draws: half(draws) },
        };
        let workshop = Workshop::open(
            self.banks,
            scene,
            flown.mission,
            self.library.to_vec(),
            size,
            |done, of| {
                if done.is_multiple_of(100) || done == of {
                    tell(format!("bank: {done} of {of} flights"));
                }
            },
        )?;
        let accepted = |flights: &[Public], most: Option<usize>| -> Vec<Vec<f64>> {
            let plain = first.mission == "plain";
            let flights = flights.iter().take(most.unwrap_or(usize::MAX));
            let logs = flights.map(|c| if plain { &c.plain } else { &c.diagnostic });
            statistics(self.dir, logs, &workshop)
        };
        let references = accepted(&self.suite.commissioning, self.choice.references);
        let calibration = accepted(&self.suite.calibration, self.choice.references.and(Some(0)));
        let long = || tell(format!("learning, {} reference flights", references.len()));
        let attributor = workshop.learn(&references, &calibration, &self.choice.settings, long)?;
        Ok(Bench { workshop, attributor, references, calibration })
    }

    /// The answer to one case, and the statistics of the diagnosed and of the held-out flight.
    fn judge(&self, bench: &Bench, case: &Entry, flown: Flown) -> Judged {
        let observed = observed(flown, &bench.workshop.nominal);
        let diagnosed = observed.observation.as_ref().ok().map(|o| o.statistics.clone());
        let answer = answer(&case.id, &observed, |s| bench.attributor.attribute(s));
        // The model of the shrink flies whole missions.
        let whole = bench.workshop.scene.until_s.is_none() && self.choice.shrink;
        let held_out = case.held_out_log.as_ref().filter(|_| whole).and_then(|log| {
            statistics(self.dir, std::iter::once(log), &bench.workshop).into_iter().next()
        });
        Judged { answer, seen: diagnosed.zip(held_out).map(|(a, b)| [a, b]) }
    }
}

/// One case, answered.
struct Judged {
    answer: Answer,
    seen: Option<[Vec<f64>; 2]>,
}

/// Answers of this diagnosis, in the order of `chosen`.
pub(super) fn own(
    hall: &Hall<'_>,
    chosen: &[Entry],
    tell: &(impl Fn(String) + Sync),
) -> Result<Given, BlindError> {
    let mut judged: Vec<Option<Judged>> = chosen.iter().map(|_| None).collect();
    let (mut learning_s, mut judging_s) = (0.0, 0.0);
    let mut references_used = 0;
    for mission in ["diagnostic", "plain"] {
        // Flights that ended early wait for a bank of the part that they flew.
        let mut waiting: Vec<(Option<f64>, Vec<usize>)> =
            vec![(None, (0..chosen.len()).filter(|k| chosen[*k].mission == mission).collect())];
        while let Some((until_s, places)) = waiting.pop() {
            let Some(first) = places.first().map(|k| &chosen[*k]) else { continue };
            let started = Instant::now();
            let bench = hall.bench(first, until_s, tell)?;
            references_used = references_used.max(bench.references.len());
            learning_s += started.elapsed().as_secs_f64();
            let started = Instant::now();
            for (done, k) in places.iter().enumerate() {
                let case = &chosen[*k];
                match logs::read(&hall.dir.join(&case.log)) {
                    Err(error) => {
                        let answer = Answer::fault(&case.id, error.to_string());
                        judged[*k] = Some(Judged { answer, seen: None });
                    }
                    Ok(flown) => {
                        let own_part = flown.scene(hall.told).until_s;
                        if own_part == until_s || !flown.faults.is_empty() {
                            judged[*k] = Some(hall.judge(&bench, case, flown));
                        } else {
                            match waiting.iter_mut().find(|(until, _)| *until == own_part) {
                                Some((_, group)) => group.push(*k),
                                None => waiting.push((own_part, vec![*k])),
                            }
                        }
                    }
                }
                if (done + 1).is_multiple_of(10) || done + 1 == places.len() {
                    let each_s = started.elapsed().as_secs_f64() / (done + 1) as f64;
                    let left_s = each_s * (places.len() - done - 1) as f64;
                    tell(format!("{} of {} cases, {left_s:.0} s left", done + 1, places.len()));
                }
            }
            judging_s += started.elapsed().as_secs_f64();
        }
    }
    let missing = |case: &Entry| Judged {
        answer: Answer::fault(
            &case.id,
            format!("mission {}: not one of the suite's", case.mission),
        ),
        seen: None,
    };
    let all = chosen.iter().zip(judged).map(|(case, j)| j.unwrap_or_else(|| missing(case)));
    let (answers, seen) = all.map(|j| (j.answer, j.seen)).unzip();
    Ok(Given { answers, seen, references_used, judging_s, learning_s })
}

pub(crate) fn statistics<'a>(
    dir: &Path,
    logs: impl Iterator<Item = &'a String>,
    workshop: &Workshop,
) -> Vec<Vec<f64>> {
    use rayon::prelude::*;
    let paths: Vec<PathBuf> = logs.map(|log| dir.join(log)).collect();
    paths
        .par_iter()
        .filter_map(|path| {
            let flown = logs::read(path).ok()?;
            if !flown.trace.came_as_far_as(workshop.scene.until_s) {
                return None;
            }
            let seen = observed(flown, &workshop.nominal);
            seen.observation.ok().map(|o| o.statistics)
        })
        .collect()
}

impl Answer {
    pub(super) fn fault(id: &str, why: String) -> Self {
        Self { id: id.to_owned(), anchors: BTreeMap::new(), attribution: None, fault: Some(why) }
    }
}

fn answer(id: &str, seen: &Observed, attribute: impl Fn(&[f64]) -> Attribution) -> Answer {
    if let Some(fault) = seen.flown.faults.first() {
        return Answer::fault(id, fault.clone());
    }
    match &seen.observation {
        Err(why) => Answer::fault(id, why.clone()),
        Ok(observation) => Answer {
            id: id.to_owned(),
            anchors: ANCHOR_SLOTS
                .iter()
                .zip(&observation.anchors)
                .map(|(slot, anchor)| ((*slot).to_owned(), anchor.0))
                .collect(),
            attribution: Some(attribute(&observation.statistics)),
            fault: None,
        },
    }
}
