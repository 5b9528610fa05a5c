//! Where the gap lies: the blocks that can be its cause, and apart from them those where what follows from it shows.
//!
//! A block is loud by its own statistics alone, which compare its logged output with what its nominal model makes of its
//! logged input. That is not yet a cause: position, speed and the bias of the IMU in these residuals come from one smoother,
//! so that a fault of one sensor is heard in its neighbours as well. Which of the loud blocks a change has to be made in so
//! that the others fall silent is what the library knows: each effect belongs to one block (docs/EFFECTS.md), and its
//! simulated flights hold its echoes in all. So blocks are ordered by the probability that the cause is one of theirs,
//! the sum over their effects, and loudness decides between equals. Controller, estimator and mission are our own software:
//! on a log that replays they did what they were told, and are never first.

use serde::Serialize;

use crate::attribute::Attribution;
use crate::bank::{Bank, Draw};
use crate::flight::statistics::{ANCHOR_SLOTS, specs};
use crate::outcome::Outcome;
use crate::shrink::{median, medians, scales};
use haltere_core::measure::AnchorId;
use haltere_log::replay::{Report, Verdict};
use haltere_model::effects::{ALL, Block, Choice, EffectSpec, Kind};

/// Blocks below this many sigma, and this probability, are not shown as places of the gap.
pub(crate) const LOUD_SIGMA: f64 = 3.0;
const LIKELY: f64 = 0.05;

/// What a block has to do with the gap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// It can be the cause.
    Cause,
    /// It shows what the cause did.
    Consequence,
}

/// A block that the gap shows in.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Where {
    /// Name of the block.
    pub block: String,
    /// Channel of its loudest statistic.
    pub channel: String,
    /// Anchor, where it is one that sticks out.
    pub anchor: Option<u8>,
    /// The loudest statistic, which names its regime.
    pub regime: String,
    /// Sigma above the null flights.
    pub score: f64,
    /// Cause or consequence.
    pub part: Part,
    /// Probability that the cause is an effect of this block, given that it is one of the library.
    pub probability: f64,
}

/// What of a flight its places are told by.
#[derive(Debug, Clone, Copy)]
pub struct Heard<'a> {
    /// In the order of [`specs`].
    pub statistics: &'a [f64],
    /// The worst anchor by each kind of [`ANCHOR_SLOTS`].
    pub worst: &'a [AnchorId],
    /// The survey, ascending, as effects count it; empty: not known.
    pub surveyed: &'a [AnchorId],
}

/// Puts every effect of one anchor at the anchor that stands out most by its kind of error: the statistics that sizes are
/// fitted to are sorted by how much each anchor stands out, and do not know which one that is.
pub(crate) fn take_anchors(attribution: &mut Attribution, heard: Heard<'_>) {
    let put = |id: &str, theta: &mut [f64], theta_90: &mut [[f64; 2]]| {
        let Some((k, slot)) = spec(id).and_then(anchor_parameter) else { return };
        let slot = ANCHOR_SLOTS.iter().position(|own| *own == slot);
        let worst = slot.and_then(|slot| heard.worst.get(slot));
        let Some(place) = heard.surveyed.iter().position(|id| Some(id) == worst) else { return };
        theta.iter_mut().skip(k).take(1).for_each(|value| *value = place as f64);
        theta_90.iter_mut().skip(k).take(1).for_each(|ends| *ends = [place as f64; 2]);
    };
    for candidate in &mut attribution.candidates {
        put(&candidate.id, &mut candidate.theta, &mut candidate.theta_90);
    }
    for pair in &mut attribution.pairs {
        pair.ids.iter().zip(&mut pair.theta).for_each(|(id, theta)| put(id, theta, &mut []));
    }
    for named in attribution.outcome.effects_mut() {
        put(&named.id, &mut named.theta, &mut named.theta_90);
    }
}

/// Where among its parameters an effect chooses an anchor, and the kind of error that this anchor shows.
fn anchor_parameter(spec: &EffectSpec) -> Option<(usize, &'static str)> {
    spec.parameters.iter().enumerate().find_map(|(k, p)| match p.kind {
        Kind::Which(Choice::Anchor(slot)) => Some((k, slot)),
        _ => None,
    })
}

/// Blocks of the gap that a bank explains so.
pub fn places(attribution: &Attribution, heard: Heard<'_>, bank: &Bank) -> Vec<Where> {
    let sigma = scales(&bank.jitter);
    let middle = medians(&bank.jitter);
    let gap = attribution.outcome != Outcome::NoMaterialGap;
    let mut places: Vec<Where> = Block::CHAIN
        .into_iter()
        .filter_map(|block| {
            let loud = attribution.blocks.iter().find(|b| b.block == block.name());
            let score = loud.map_or(0.0, |b| b.sigma);
            let probability = if gap { probability(attribution, block) } else { 0.0 };
            let of = |id: &str| block_of(id) == Some(block);
            let named = attribution.outcome.effects().iter().any(|e| of(&e.id));
            if score < LOUD_SIGMA && probability < LIKELY && !named {
                return None;
            }
            let own = specs().iter().enumerate().filter(|(_, s)| s.block == block);
            let loudest = own
                .filter_map(|(j, s)| {
                    let z = (heard.statistics.get(j)? - middle.get(j)?) / sigma.get(j)?;
                    z.is_finite().then_some((z.abs(), s))
                })
                .max_by(|a, b| a.0.total_cmp(&b.0));
            let spec = loudest.map(|(_, spec)| spec);
            let regime = spec.map_or_else(String::new, |s| s.name.clone());
            let loudest =
                || (block == Block::Uwb).then(|| anchor_of(&regime, heard.worst)).flatten();
            Some(Where {
                block: block.name().to_owned(),
                channel: spec.map_or_else(String::new, |s| format!("{:?}", s.channel)),
                anchor: named_anchor(attribution, block, heard.surveyed).or_else(loudest),
                regime,
                score,
                part: if block.is_consequence() { Part::Consequence } else { Part::Cause },
                probability,
            })
        })
        .collect();
    let named = |p: &Where| {
        let of = |id: &str| block_of(id).is_some_and(|b| b.name() == p.block);
        attribution.outcome.effects().iter().position(|e| of(&e.id)).unwrap_or(usize::MAX)
    };
    // Blocks that are all but ruled out are equals.
    let likely = |p: &Where| if p.probability < LIKELY { 0.0 } else { p.probability };
    places.sort_by(|a, b| {
        let consequence = |p: &Where| p.part == Part::Consequence;
        consequence(a)
            .cmp(&consequence(b))
            .then(named(a).cmp(&named(b)))
            .then(likely(b).total_cmp(&likely(a)))
            .then(b.score.total_cmp(&a.score))
    });
    places
}

/// Where an effect shows in the flights of a bank: by how many sigma of healthy ones its middle flight differs from the
/// same flight without it, in the loudest statistic of each block. Empty: the bank has no flight of it.
pub fn signature(bank: &Bank, id: &str) -> Vec<(Block, f64)> {
    let sigma = scales(&bank.jitter);
    let draws = bank.effects.iter().find(|e| e.id == id).map_or(&[][..], |e| &e.draws[..]);
    let loudest = |draw: &Draw, block: Block| {
        let twin = bank.jitter.get(draw.twin)?;
        let own = specs().iter().enumerate().filter(|(_, spec)| spec.block == block);
        let off = own.filter_map(|(j, _)| {
            let z = (draw.statistics.get(j)? - twin.get(j)?) / sigma.get(j)?;
            z.is_finite().then_some(z.abs())
        });
        off.reduce(f64::max)
    };
    let middle = |block| {
        let mut all: Vec<f64> = draws.iter().filter_map(|draw| loudest(draw, block)).collect();
        (block, median(&mut all))
    };
    Block::CHAIN.into_iter().map(middle).filter(|(_, z)| z.is_finite()).collect()
}

/// Probability of a block: of all its effects together.
fn probability(attribution: &Attribution, block: Block) -> f64 {
    let own = |id: &str| block_of(id) == Some(block);
    attribution.candidates.iter().filter(|c| own(&c.id)).fold(0.0, |sum, c| sum + c.posterior)
}

/// The anchor that an effect which is named for this block is at.
fn named_anchor(attribution: &Attribution, block: Block, anchors: &[AnchorId]) -> Option<u8> {
    attribution.outcome.effects().iter().find_map(|named| {
        let spec = spec(&named.id).filter(|spec| spec.block == block)?;
        let (k, _) = anchor_parameter(spec)?;
        anchors.get(spec.parameters.get(k)?.told(*named.theta.get(k)?) as usize).map(|id| id.0)
    })
}

/// The anchor behind a statistic that is sorted by anchors.
fn anchor_of(name: &str, worst: &[AnchorId]) -> Option<u8> {
    let slot = ANCHOR_SLOTS.iter().position(|slot| name.contains(slot))?;
    worst.get(slot).map(|id| id.0)
}

fn spec(id: &str) -> Option<&'static EffectSpec> {
    ALL.iter().find(|spec| spec.id == id)
}

fn block_of(id: &str) -> Option<Block> {
    spec(id).map(|spec| spec.block)
}

/// Blocks that replay exonerates: with their logged inputs they do again, to the last bit, what they did.
pub(super) fn exonerated(replay: &Report) -> Vec<String> {
    let same = replay.verdict == Verdict::Identical;
    let own = Block::CHAIN.into_iter().filter(|block| same && block.is_consequence());
    own.map(|block| block.name().to_owned()).collect()
}
