//! Scores a sealed suite: every case is answered, the answers are written down, and only then the
//! keys are opened and compared with their committed hashes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use haltere_gap::attribute::{AttributeError, Attribution, Settings};
use haltere_gap::bank::library::{self, find};
use haltere_gap::bank::make_bank::BankSize;
use haltere_gap::bank::workshop::WorkshopError;
use haltere_gap::flight::seal;
use haltere_gap::scene::Told;
use haltere_gap::shrink::Shrink;
use haltere_log::replay::ReplayError;
use haltere_model::effects::EffectSpec;

use crate::score::{Case, Score, Truth, score};

pub(super) mod hall;
mod shrunk;

use hall::{Hall, own};
use shrunk::shrunk;

/// Why a suite cannot be scored.
#[derive(Debug, thiserror::Error)]
pub enum BlindError {
    /// A file of the suite.
    #[error("{}: cannot be read: {why}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// A key that is not the one that was committed.
    #[error("{}: the key has SHA-256 {found}, committed was {expected}", path.display())]
    Seal {
        /// Which.
        path: PathBuf,
        /// As found.
        found: String,
        /// As committed.
        expected: String,
    },
    /// A log.
    #[error(transparent)]
    Log(#[from] ReplayError),
    /// The bank.
    #[error(transparent)]
    Workshop(#[from] WorkshopError),
    /// Learning.
    #[error(transparent)]
    Learn(#[from] AttributeError),
    /// Nothing to score.
    #[error("{}: no case to score with these choices", .0.display())]
    Empty(PathBuf),
}

/// What to score.
#[derive(Debug, Clone)]
pub struct Choice {
    /// Only the fixed tenth.
    pub tenth: bool,
    /// The lockbox too.
    pub lockbox: bool,
    /// Only so many accepted flights, and none that are kept for limits; absent: all.
    pub references: Option<usize>,
    /// Measure shrink on the held-out flights.
    pub shrink: bool,
    /// Effects that are taken out of the library.
    pub withheld: Vec<String>,
    /// Size of the banks.
    pub size: BankSize,
    /// Choices of the attribution.
    pub settings: Settings,
    /// Answers of another method, scored in place of our own (see [`crate::outside`]).
    pub outside: Option<PathBuf>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Suite {
    pub(super) generator: String,
    pub(super) all_keys_sha256: String,
    pub(super) cases: Vec<Entry>,
    pub(super) commissioning: Vec<Public>,
    pub(super) calibration: Vec<Public>,
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct Entry {
    pub(super) id: String,
    pub(super) mission: String,
    pub(super) log: String,
    pub(super) held_out_log: Option<String>,
    pub(super) tenth: bool,
    pub(super) lockbox: bool,
    pub(super) key_sha256: String,
}

#[derive(Debug, Deserialize)]
pub(super) struct Public {
    pub(super) diagnostic: String,
    pub(super) held_out: String,
    pub(super) plain: String,
}

#[derive(Debug, Deserialize)]
pub(super) struct Key {
    pub(super) class: String,
    pub(super) effects: Vec<KeyEffect>,
}

#[derive(Debug, Deserialize)]
pub(super) struct KeyEffect {
    pub(super) id: String,
    pub(super) block: String,
    pub(super) parameters: BTreeMap<String, f64>,
    pub(super) anchor: Option<u8>,
}

/// One answer, as it was given before the key was opened.
#[derive(Debug, Clone, Serialize)]
pub struct Answer {
    /// Id of the case.
    pub id: String,
    /// Anchors by kind of error.
    pub anchors: BTreeMap<String, u8>,
    /// The verdict; absent when the log could not be judged.
    pub attribution: Option<Attribution>,
    /// Why there is no verdict.
    pub fault: Option<String>,
}

/// Result of a scoring run.
#[derive(Debug, Serialize)]
pub struct BlindResult {
    /// Generator of the suite.
    pub generator: String,
    /// Hash over all keys.
    pub all_keys_sha256: String,
    /// Cases scored.
    pub cases: usize,
    /// Cases whose log could not be judged.
    pub faults: Vec<String>,
    /// Reference flights behind the floor.
    pub references: usize,
    /// Scores.
    pub score: Score,
    /// The right anchor among single effects of one anchor.
    pub anchor_hits: usize,
    /// Of how many.
    pub anchor_of: usize,
    /// Shrink, pooled over single effects that were named, right or wrong.
    pub shrink: Option<Shrink>,
    /// The same with the true effect, fitted: what was attainable.
    pub attainable: Option<Shrink>,
    /// Scores of plain flights.
    pub plain: Option<Score>,
    /// Time per case, s, without making banks.
    pub seconds_per_case: f64,
    /// Time for banks and learning, s.
    pub seconds_learning: f64,
    /// With no effect and all nominal constants retuned: the peer.
    pub retuned: Option<Shrink>,
    /// One held-out flight each: truth, what was named, distance before, with what was named, with the
    /// true effect, retuned.
    pub shrink_flights: Vec<(String, String, [f64; 4])>,
    /// Of the effects that were named, those that helped at no size when flown.
    pub unhelpful: usize,
    /// Every answer, and the class of its case.
    pub answers: Vec<(Answer, String)>,
}

pub(super) fn read<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<(T, Vec<u8>), BlindError> {
    let fail = |why: String| BlindError::File { path: path.to_owned(), why };
    let bytes = std::fs::read(path).map_err(|e| fail(e.to_string()))?;
    let value = serde_json::from_slice(&bytes).map_err(|e| fail(e.to_string()))?;
    Ok((value, bytes))
}

/// Scores the suite in `dir`. `tell` hears what goes on.
pub fn run(
    dir: &Path,
    banks: &Path,
    told: &Told,
    choice: &Choice,
    tell: &(impl Fn(String) + Sync),
) -> Result<BlindResult, BlindError> {
    let (suite, _): (Suite, _) = read(&dir.join("cases.json"))?;
    let mut chosen: Vec<Entry> = suite
        .cases
        .iter()
        .filter(|c| (!choice.tenth || c.tenth) && (!c.lockbox || choice.lockbox))
        .filter(|c| dir.join(&c.log).exists())
        .cloned()
        .collect();
    if chosen.is_empty() {
        return Err(BlindError::Empty(dir.to_owned()));
    }
    chosen.sort_by(|a, b| a.mission.cmp(&b.mission).then(a.id.cmp(&b.id)));
    let library: Vec<&'static EffectSpec> = library::standard()
        .into_iter()
        .filter(|spec| !choice.withheld.iter().any(|id| id == spec.id))
        .collect();

    let given = match &choice.outside {
        Some(file) => outside(file, &chosen)?,
        None => {
            let hall = Hall { dir, banks, told, choice, suite: &suite, library: &library };
            own(&hall, &chosen, tell)?
        }
    };
    let Given { answers, seen, references_used, judging_s, learning_s } = given;

    // From here on the keys are open.
    let keys: Vec<Key> = chosen.iter().map(|case| open(dir, case)).collect::<Result<_, _>>()?;
    let held_out = if choice.shrink {
        Some(shrunk(dir, told, &suite.commissioning, &chosen, &keys, &answers, &seen, tell)?)
    } else {
        None
    };
    let scored = |plain: bool| -> Option<Score> {
        let cases: Vec<Case<'_>> = keys
            .iter()
            .zip(&answers)
            .filter(|(key, _)| (key.class == "plain") == plain)
            .filter_map(|(key, answer)| {
                Some(Case {
                    truth: truth(key, &library),
                    verdict: answer.attribution.as_ref()?,
                    blocks: named_blocks(answer, &library),
                })
            })
            .collect();
        (!cases.is_empty()).then(|| score(&cases))
    };
    let (anchor_hits, anchor_of) = anchors(&keys, &answers);
    let [shrink, attainable, retuned] =
        held_out.as_ref().map_or([None; 3], |s| [Some(s.named), Some(s.right), Some(s.retuned)]);
    let (unhelpful, shrink_flights) =
        held_out.map_or((0, Vec::new()), |s| (s.unhelpful, s.flights));
    Ok(BlindResult {
        generator: suite.generator,
        all_keys_sha256: suite.all_keys_sha256,
        cases: answers.len(),
        faults: answers
            .iter()
            .filter_map(|a| a.fault.as_ref().map(|why| format!("{}: {why}", a.id)))
            .collect(),
        references: references_used,
        score: scored(false).unwrap_or_default(),
        anchor_hits,
        anchor_of,
        shrink,
        attainable,
        retuned,
        shrink_flights,
        unhelpful,
        plain: scored(true),
        seconds_per_case: judging_s / answers.len().max(1) as f64,
        seconds_learning: learning_s,
        answers: answers.into_iter().zip(keys.into_iter().map(|k| k.class)).collect(),
    })
}

/// All answers, before any key is opened.
struct Given {
    answers: Vec<Answer>,
    /// Statistics of the diagnosed and of the held-out flight, where shrink is asked for.
    seen: Vec<Option<[Vec<f64>; 2]>>,
    references_used: usize,
    judging_s: f64,
    learning_s: f64,
}

/// Answers of another method; a case that it leaves out counts as not judged.
fn outside(file: &Path, chosen: &[Entry]) -> Result<Given, BlindError> {
    let fail = |why: String| BlindError::File { path: file.to_owned(), why };
    let text = std::fs::read_to_string(file).map_err(|e| fail(e.to_string()))?;
    let lines = crate::outside::read(&text).map_err(fail)?;
    let answers = chosen
        .iter()
        .map(|case| match lines.iter().find(|line| line.id == case.id) {
            None => Ok(Answer::fault(&case.id, "no answer".into())),
            Some(line) => Ok(Answer {
                id: case.id.clone(),
                anchors: line.anchors.clone(),
                attribution: Some(line.attribution().map_err(fail)?),
                fault: None,
            }),
        })
        .collect::<Result<Vec<_>, BlindError>>()?;
    Ok(Given {
        seen: vec![None; answers.len()],
        answers,
        references_used: 0,
        judging_s: 0.0,
        learning_s: 0.0,
    })
}

pub(super) fn open(dir: &Path, case: &Entry) -> Result<Key, BlindError> {
    let path = dir.join("key").join(format!("{}.json", case.id));
    let (key, bytes): (Key, _) = read(&path)?;
    let found = seal::digest(&bytes);
    if found == case.key_sha256 {
        Ok(key)
    } else {
        Err(BlindError::Seal { path, found, expected: case.key_sha256.clone() })
    }
}

fn truth(key: &Key, library: &[&'static EffectSpec]) -> Truth {
    let known = |id: &str| library.iter().find(|spec| spec.id == id);
    match &key.effects[..] {
        [] => Truth::NoGap,
        [one] => match known(&one.id) {
            None => Truth::Unknown { name: one.id.clone() },
            Some(spec) => Truth::Single {
                id: one.id.clone(),
                block: one.block.clone(),
                theta: spec
                    .parameters
                    .iter()
                    .map(|p| one.parameters.get(p.name).copied().unwrap_or(f64::NAN))
                    .collect(),
            },
        },
        [a, b, ..] => Truth::Pair { ids: [a.id.clone(), b.id.clone()] },
    }
}

/// Blocks of the effects that were named.
fn named_blocks(answer: &Answer, library: &[&'static EffectSpec]) -> Vec<String> {
    let Some(attribution) = &answer.attribution else { return Vec::new() };
    attribution
        .outcome
        .effects()
        .iter()
        .filter_map(|e| library.iter().find(|spec| spec.id == e.id))
        .map(|spec| spec.block.name().to_owned())
        .collect()
}

/// Right anchors among single effects of one anchor that were named.
fn anchors(keys: &[Key], answers: &[Answer]) -> (usize, usize) {
    let (mut hits, mut of) = (0, 0);
    for (key, answer) in keys.iter().zip(answers) {
        let [effect] = &key.effects[..] else { continue };
        let slot = find(&effect.id).and_then(EffectSpec::anchor_slot);
        let (Some(slot), Some(anchor)) = (slot, effect.anchor) else { continue };
        of += 1;
        hits += usize::from(answer.anchors.get(slot) == Some(&anchor));
    }
    (hits, of)
}

#[cfg(test)]
mod tests;
