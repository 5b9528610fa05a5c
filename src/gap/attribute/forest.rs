//! The second voter: a forest of extremely randomised trees (Geurts, Ernst, Wehenkel 2006) on
//! standardised statistics. It knows no law of any signature and looks at one statistic at a time,
//! so it errs elsewhere than the surrogates do, and a statistic of another simulator that wanders
//! off spoils few of its questions.
//!
//! Each leaf holds the share of every class; a vote is the mean over the trees. The last class is
//! "no effect".

use rayon::prelude::*;

use crate::model::random::Stream;

/// Trees and questions: chosen for the time of learning (a few seconds a forest on two cores), not
/// by a search. Geurts et al. try the root of the number of statistics at a node, 16 here.
const TREES: usize = 120;
const QUESTIONS: usize = 40;
/// A node with fewer rows is a leaf: more than the copies of one draw.
const LEAST_ROWS: usize = 4;
/// Deepest node.
const DEEPEST: usize = 24;
/// Vote that every class has without a row.
const FLOOR: f64 = 0.002;

/// One row that teaches: standardised statistics and its class.
pub(super) type Row = (Vec<f32>, u16);

#[derive(Debug, Clone)]
enum Node {
    /// Statistic, limit, and the node for rows at or above it; those below are the next node.
    Ask(u16, f32, u32),
    /// Shares of the classes that occur.
    Leaf(Vec<(u16, f32)>),
}

/// The forest.
#[derive(Debug, Clone)]
pub(super) struct Forest {
    trees: Vec<Vec<Node>>,
    classes: usize,
}

impl Forest {
    /// Grows. `classes`: effects, and "no effect" last.
    pub fn new(rows: &[Row], classes: usize) -> Self {
        let trees = (0..TREES as u64)
            .into_par_iter()
            .map(|seed| {
                let mut nodes = Vec::new();
                let mut rng = Stream::new(seed, "forest");
                let mut places: Vec<u32> = (0..rows.len() as u32).collect();
                grow(rows, classes, &mut places, 0, &mut rng, &mut nodes);
                nodes
            })
            .collect();
        Self { trees, classes }
    }

    /// Share of the vote per class; sums to one.
    pub fn votes(&self, x: &[f32]) -> Vec<f64> {
        let mut votes = vec![FLOOR; self.classes];
        for tree in &self.trees {
            let mut at = 0;
            while let Some(Node::Ask(column, limit, above)) = tree.get(at) {
                let value = x.get(usize::from(*column)).copied().unwrap_or(0.0);
                at = if value >= *limit { *above as usize } else { at + 1 };
            }
            if let Some(Node::Leaf(shares)) = tree.get(at) {
                for (class, share) in shares {
                    if let Some(vote) = votes.get_mut(usize::from(*class)) {
                        *vote += f64::from(*share) / self.trees.len() as f64;
                    }
                }
            }
        }
        let total: f64 = votes.iter().sum();
        votes.iter().map(|v| v / total).collect()
    }
}

fn grow(
    rows: &[Row],
    classes: usize,
    places: &mut [u32],
    depth: usize,
    rng: &mut Stream,
    nodes: &mut Vec<Node>,
) {
    let mut counts = vec![0u32; classes];
    for place in places.iter() {
        counts[usize::from(rows[*place as usize].1)] += 1;
    }
    let pure = counts.iter().filter(|c| **c > 0).count() < 2;
    let question = if pure || places.len() < LEAST_ROWS || depth >= DEEPEST {
        None
    } else {
        ask(rows, classes, places, rng)
    };
    let Some((column, limit)) = question else {
        let total = places.len().max(1) as f32;
        let some = counts.iter().enumerate().filter(|(_, c)| **c > 0);
        nodes.push(Node::Leaf(some.map(|(k, c)| (k as u16, *c as f32 / total)).collect()));
        return;
    };
    let mut below = 0;
    for k in 0..places.len() {
        if rows[places[k] as usize].0[column] < limit {
            places.swap(k, below);
            below += 1;
        }
    }
    let here = nodes.len();
    nodes.push(Node::Ask(column as u16, limit, 0));
    let (low, high) = places.split_at_mut(below);
    grow(rows, classes, low, depth + 1, rng, nodes);
    let above = nodes.len() as u32;
    nodes[here] = Node::Ask(column as u16, limit, above);
    grow(rows, classes, high, depth + 1, rng, nodes);
}

/// The best of some random questions, by Gini impurity.
fn ask(rows: &[Row], classes: usize, places: &[u32], rng: &mut Stream) -> Option<(usize, f32)> {
    let width = rows.first().map_or(0, |r| r.0.len());
    let mut best: Option<(f64, usize, f32)> = None;
    let (mut low, mut all) = (vec![0u32; classes], vec![0u32; classes]);
    for place in places {
        all[usize::from(rows[*place as usize].1)] += 1;
    }
    let squares = |counts: &[u32]| counts.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>();
    for _ in 0..QUESTIONS {
        let column = ((rng.uniform() * width as f64) as usize).min(width.checked_sub(1)?);
        let values = places.iter().map(|p| rows[*p as usize].0[column]);
        let (least, most) =
            values.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if least >= most {
            continue;
        }
        let limit = least + (most - least) * rng.uniform() as f32;
        if limit <= least {
            continue;
        }
        low.fill(0);
        let mut below = 0u32;
        for place in places {
            let (x, class) = &rows[*place as usize];
            if x[column] < limit {
                low[usize::from(*class)] += 1;
                below += 1;
            }
        }
        let above = places.len() as f64 - f64::from(below);
        let high: f64 =
            all.iter().zip(&low).map(|(a, l)| f64::from(a - l).powi(2)).sum::<f64>() / above;
        // Larger is purer.
        let purity = squares(&low) / f64::from(below) + high;
        if best.is_none_or(|(b, ..)| purity > b) {
            best = Some((purity, column, limit));
        }
    }
    best.map(|(_, column, limit)| (column, limit))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three classes: each has its mean in a column of its own, the rest is noise.
    fn rows(seed: u64, count: usize) -> Vec<Row> {
        let mut rng = Stream::new(seed, "rows");
        (0..count)
            .map(|k| {
                let class = k % 3;
                let x = (0..8)
                    .map(|j| (rng.normal() + if j == class { 4.0 } else { 0.0 }) as f32)
                    .collect();
                (x, class as u16)
            })
            .collect()
    }

    #[test]
    fn val_classes_that_lie_apart_are_told_apart() {
        let forest = Forest::new(&rows(1, 300), 3);
        let unseen = rows(2, 300);
        let right = unseen
            .iter()
            .filter(|(x, class)| {
                let votes = forest.votes(x);
                let sum: f64 = votes.iter().sum();
                assert!((sum - 1.0).abs() < 1e-9);
                (0..3).all(|k| votes[k] <= votes[usize::from(*class)])
            })
            .count();
        // Bayes' rule gets 0.99 of these.
        assert!(right >= 285, "{right} of 300");
    }

    #[test]
    fn prop_nothing_to_learn_from_gives_equal_votes() {
        let votes = Forest::new(&[], 4).votes(&[1.0, f32::NAN]);
        assert!(votes.iter().all(|v| (v - 0.25).abs() < 1e-9), "{votes:?}");
    }
}
