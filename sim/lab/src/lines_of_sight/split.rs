//! Pair residuals of one window, split into a part per anchor.
//!
//! `r_ab = b_b - b_a + c_ab`: `b` how much too long each anchor's path is, `c` what belongs to the pair
//! alone (GAP.md 2.4). `b` by least absolute deviations (reweighted least squares), so that one bad
//! pair does not smear; only differences are seen, so the median of `b` is zero: fewer than half of
//! the anchors may be blocked at a time.

use nalgebra::{DMatrix, DVector};

/// Deviation below which a pair counts in full, m: white error of a pair's median.
const FULL_M: f64 = 0.05;
/// Rounds of reweighting: the answer stands to a millimetre.
const ROUNDS: usize = 12;
/// Anchors that must hang together by pairs for a split.
const LEAST_ANCHORS: usize = 5;

/// Residual of a pair: median over a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairResidual {
    /// Index of the anchor that is subtracted.
    pub a: usize,
    /// Index of the anchor that is added.
    pub b: usize,
    /// Measured less true difference of distance, m.
    pub median_m: f64,
    /// Readings in it.
    pub n: f64,
}

/// Parts of a window.
#[derive(Debug, Clone, PartialEq)]
pub struct Parts {
    /// Per anchor, m; `None` when it was not heard together with most others.
    pub anchor_m: Vec<Option<f64>>,
    /// Largest deviation of a pair from its anchors' parts, m.
    pub pair_m: f64,
}

/// Splits; `None` when too few anchors hang together.
pub fn split(pairs: &[PairResidual], anchors: usize) -> Option<Parts> {
    let member = largest_component(pairs, anchors);
    let index: Vec<usize> = (0..anchors).filter(|i| member[*i]).collect();
    if index.len() < LEAST_ANCHORS {
        return None;
    }
    let place = |anchor: usize| index.iter().position(|i| *i == anchor);
    let inside: Vec<(usize, usize, &PairResidual)> =
        pairs.iter().filter_map(|p| Some((place(p.a)?, place(p.b)?, p))).collect();
    let k = index.len();
    let mut weight: Vec<f64> = inside.iter().map(|(.., p)| p.n).collect();
    let mut part = DVector::<f64>::zeros(k);
    for _ in 0..ROUNDS {
        // Ones fix the sum, which no difference sees.
        let mut normal = DMatrix::<f64>::from_element(k, k, 1.0);
        let mut right = DVector::<f64>::zeros(k);
        for ((a, b, pair), w) in inside.iter().zip(&weight) {
            normal[(*a, *a)] += w;
            normal[(*b, *b)] += w;
            normal[(*a, *b)] -= w;
            normal[(*b, *a)] -= w;
            right[*b] += w * pair.median_m;
            right[*a] -= w * pair.median_m;
        }
        part = normal.cholesky()?.solve(&right);
        for ((a, b, pair), w) in inside.iter().zip(&mut weight) {
            let off = (pair.median_m - (part[*b] - part[*a])).abs();
            *w = pair.n * FULL_M / off.max(FULL_M);
        }
    }
    let mut sorted: Vec<f64> = part.iter().copied().collect();
    sorted.sort_by(f64::total_cmp);
    let median = 0.5 * (sorted[(k - 1) / 2] + sorted[k / 2]);
    let pair_m = inside
        .iter()
        .map(|(a, b, pair)| (pair.median_m - (part[*b] - part[*a])).abs())
        .fold(0.0, f64::max);
    let anchor_m = (0..anchors).map(|i| place(i).map(|at| part[at] - median)).collect();
    Some(Parts { anchor_m, pair_m })
}

/// Membership of the largest set of anchors that hang together.
fn largest_component(pairs: &[PairResidual], anchors: usize) -> Vec<bool> {
    let mut label: Vec<usize> = (0..anchors).collect();
    // As many sweeps as a chain is long.
    for _ in 0..anchors {
        for pair in pairs {
            if let (Some(&a), Some(&b)) = (label.get(pair.a), label.get(pair.b)) {
                let low = a.min(b);
                label[pair.a] = low;
                label[pair.b] = low;
            }
        }
    }
    let size = |l: usize| label.iter().filter(|x| **x == l).count();
    let best = (0..anchors).max_by_key(|l| size(*l)).unwrap_or(0);
    label.iter().map(|l| *l == best).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(b: &[f64], wrong_pair: Option<f64>) -> Vec<PairResidual> {
        let n = b.len();
        (0..n)
            .map(|a| {
                let next = (a + 1) % n;
                let pair = if a == 3 { wrong_pair.unwrap_or(0.0) } else { 0.0 };
                PairResidual { a, b: next, median_m: b[next] - b[a] + pair, n: 40.0 }
            })
            .collect()
    }

    #[test]
    fn prop_a_blocked_anchor_keeps_its_part_and_the_others_none() {
        let mut b = [0.0; 8];
        b[2] = 1.7;
        let parts = split(&ring(&b, None), 8).unwrap();
        for (i, part) in parts.anchor_m.iter().enumerate() {
            assert!((part.unwrap() - b[i]).abs() < 0.01, "{i} {part:?}");
        }
        assert!(parts.pair_m < 0.01);
    }

    #[test]
    fn prop_a_bad_pair_among_all_pairs_stays_with_the_pair() {
        let mut pairs = Vec::new();
        for a in 0..8 {
            for b in a + 1..8 {
                let off = if (a, b) == (1, 6) { 3.0 } else { 0.0 };
                pairs.push(PairResidual { a, b, median_m: off, n: 8.0 });
            }
        }
        let parts = split(&pairs, 8).unwrap();
        assert!((parts.pair_m - 3.0).abs() < 0.05, "{}", parts.pair_m);
        assert!(parts.anchor_m.iter().flatten().all(|p| p.abs() < 0.05));
    }

    #[test]
    fn prop_anchors_that_do_not_hang_together_are_not_judged() {
        let b = [0.0; 8];
        let pairs: Vec<_> =
            ring(&b, None).into_iter().filter(|p| ![p.a, p.b].contains(&7)).collect();
        assert_eq!(split(&pairs, 8).unwrap().anchor_m[7], None);
        assert_eq!(split(&pairs[..3], 8), None);
        assert_eq!(split(&[], 8), None);
    }
}
