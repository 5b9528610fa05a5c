//! What became of the measurements of each pair of anchors.

use haltere_core::measure::AnchorId;
use haltere_core::topics::UwbRecord;

/// Pairs of anchors whose fate is followed. TDoA3 with 8 anchors has 56; bounds what a tag that
/// sends nonsense can make us store.
const MOST_PAIRS: usize = 256;

/// Fate of the measurements of one anchor pair.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PairStats {
    pub anchor_a: AnchorId,
    pub anchor_b: AnchorId,
    pub accepted: u32,
    pub rejected: u32,
    pub innovation_m: f64,
    pub test_ratio: f64,
}

/// Counts a measurement under its pair.
pub(crate) fn note_pair(pairs: &mut Vec<PairStats>, record: &UwbRecord) {
    let key = (record.tdoa.anchor_a, record.tdoa.anchor_b);
    let slot = match pairs.iter().position(|p| (p.anchor_a, p.anchor_b) == key) {
        Some(i) => i,
        None if pairs.len() < MOST_PAIRS => {
            pairs.push(PairStats {
                anchor_a: key.0,
                anchor_b: key.1,
                accepted: 0,
                rejected: 0,
                innovation_m: 0.0,
                test_ratio: 0.0,
            });
            pairs.len() - 1
        }
        None => return,
    };
    let pair = &mut pairs[slot];
    if record.fused {
        pair.accepted = pair.accepted.saturating_add(1);
    } else {
        pair.rejected = pair.rejected.saturating_add(1);
    }
    pair.innovation_m = record.innovation_m;
    pair.test_ratio = record.test_ratio;
}
