//! Which candidate belongs into the balance: forward selection judged by the unseen flight.
//!
//! A candidate is fitted on the fit flights together with the calibrations and what is already
//! credited. It is **credited** when, on blocks that the fit has not seen,
//! * its gain in squared residual is above zero with a block-bootstrap interval whose level is
//!   corrected for the number of candidates, over its axes and along one of them alone, and
//! * along that axis it is material: at least [`MATERIAL_MPS2`] and a tenth of the mean square.
//!
//! Unseen blocks are those of the held-out flights; without any, each block of the fit flights in
//! turn (and the caller must say that nothing unseen confirmed it).

use super::blocks::{Block, Fit, Interval, bootstrap, fit};
use super::terms::{Column, Sign, Term};

/// Least force that matters along each body axis, m/s²: half a degree of tilt forward and right, a
/// hundredth of the weight down (GAP.md 2.5 F: 0.5 deg, 1 % throttle).
pub const MATERIAL_MPS2: [f64; 3] = [0.0856, 0.0856, 0.0981];
/// Least share of the mean square that must go (GAP.md 2.5 F: a tenth).
const MATERIAL_SHARE: f64 = 0.1;
/// Share of reports that may credit an effect by chance.
const FALSE_NAMES: f64 = 0.05;
/// Level of the intervals that are printed.
pub const LEVEL: f64 = 0.95;
/// Effects at most.
const MOST_EFFECTS: usize = 4;

/// Blocks and columns of one question.
pub struct Question<'a> {
    /// Candidates.
    pub terms: &'a [Term],
    /// Every column: calibrations first, then the candidates' in their order.
    pub columns: &'a [Column],
    /// First column of each candidate.
    pub first: &'a [usize],
    /// Blocks to fit on.
    pub fit_on: &'a [Block],
    /// Blocks to judge on; empty: cross-validation.
    pub held_out: &'a [Block],
    /// Weight of each axis, s⁴/m².
    pub weight: [f64; 3],
}

/// What became of a candidate in one round.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Belongs into the balance.
    Credited,
    /// The flight does not excite it.
    NotTestable,
    /// Fits only with a sign that it cannot have.
    WrongSign,
    /// Does not help where it was not fitted.
    DoesNotHelp,
    /// Helps, but too little to matter.
    Immaterial,
}

/// Squared residuals of one unseen block, before and after.
#[derive(Debug, Clone, Copy)]
pub struct Unseen {
    n: f64,
    before: [f64; 3],
    after: [f64; 3],
}

/// One candidate in one round.
#[derive(Debug, Clone)]
pub struct Trial {
    /// Which candidate.
    pub term: usize,
    /// What became of it.
    pub verdict: Verdict,
    /// Columns that could be fitted.
    pub columns: Vec<usize>,
    /// Share of the mean square in its axes that goes on unseen blocks, with its interval.
    pub gain: Option<Interval>,
    unseen: Vec<Unseen>,
}

/// One effect taken into the balance.
#[derive(Debug, Clone)]
pub struct Step {
    /// The candidate.
    pub term: usize,
    /// Its columns.
    pub columns: Vec<usize>,
    /// Candidates that do as well on the unseen blocks.
    pub rivals: Vec<usize>,
}

/// The outcome of the search.
#[derive(Debug, Clone)]
pub struct Found {
    /// Effects in the order of taking.
    pub steps: Vec<Step>,
    /// Every candidate against the nominal balance alone.
    pub first_round: Vec<Trial>,
}

impl Question<'_> {
    /// Columns of the calibrations.
    pub fn calibrations(&self) -> Vec<usize> {
        (0..self.first.first().copied().unwrap_or(self.columns.len())).collect()
    }

    /// Searches.
    pub fn search(&self) -> Found {
        let mut active = self.calibrations();
        let mut steps: Vec<Step> = Vec::new();
        let mut first_round = Vec::new();
        while steps.len() < MOST_EFFECTS {
            let trials: Vec<Trial> = (0..self.terms.len())
                .filter(|t| steps.iter().all(|s| s.term != *t))
                .map(|t| self.attempt(t, &active))
                .collect();
            let loss = |trial: &Trial| self.unseen_loss(trial.unseen.iter());
            let best = trials
                .iter()
                .filter(|t| t.verdict == Verdict::Credited)
                .min_by(|a, b| loss(a).total_cmp(&loss(b)));
            let step = best.map(|best| Step {
                term: best.term,
                columns: best.columns.clone(),
                rivals: trials
                    .iter()
                    .filter(|t| t.term != best.term && t.verdict == Verdict::Credited)
                    .filter(|t| self.as_good(t, best))
                    .map(|t| t.term)
                    .collect(),
            });
            if steps.is_empty() {
                first_round = trials;
            }
            let Some(step) = step else { break };
            active.extend(&step.columns);
            active.sort_unstable();
            steps.push(step);
        }
        Found { steps, first_round }
    }

    fn unseen_loss<'b>(&self, unseen: impl Iterator<Item = &'b Unseen>) -> f64 {
        unseen.map(|u| (0..3).map(|a| self.weight[a] * u.after[a]).sum::<f64>()).sum()
    }

    /// Whether the unseen blocks cannot tell the rival from the best.
    fn as_good(&self, rival: &Trial, best: &Trial) -> bool {
        let pairs: Vec<(&Unseen, &Unseen)> = rival.unseen.iter().zip(&best.unseen).collect();
        let behind = |pairs: &[&(&Unseen, &Unseen)]| {
            Some(
                self.unseen_loss(pairs.iter().map(|p| p.0))
                    - self.unseen_loss(pairs.iter().map(|p| p.1)),
            )
        };
        bootstrap(0.0, &pairs, LEVEL, "rival", behind).low <= 0.0
    }

    /// Fits one candidate on top of the active columns and judges it.
    fn attempt(&self, term: usize, active: &[usize]) -> Trial {
        let first = self.first.get(term).copied().unwrap_or_default();
        let Some(spec) = self.terms.get(term) else {
            return Trial::without_fit(term, Verdict::NotTestable);
        };
        let mut columns: Vec<usize> = (first..first + spec.columns.len()).collect();
        // What the flight does not excite is left out of the candidate, and so is a parameter whose
        // sign cannot be: drag along one axis does not fall with drag along another.
        let all = |columns: &[usize]| {
            let mut all: Vec<usize> = active.iter().chain(columns).copied().collect();
            all.sort_unstable();
            all
        };
        columns.retain(|c| {
            let plausible = self.columns.get(*c).map_or(0.0, |c| c.plausible);
            let with = all(&[*c]);
            fit(self.fit_on, &with, self.weight).and_then(|f| f.of(*c)).is_some_and(|value| {
                let width = self.interval(&with, *c, value);
                width.high - width.low < 2.0 * plausible
            })
        });
        if columns.is_empty() {
            return Trial::without_fit(term, Verdict::NotTestable);
        }
        let fitted = loop {
            let Some(fitted) = fit(self.fit_on, &all(&columns), self.weight) else {
                return Trial::without_fit(term, Verdict::NotTestable);
            };
            let before = columns.len();
            columns.retain(|c| {
                let positive = self.columns.get(*c).is_some_and(|c| c.sign == Sign::Positive);
                !positive || fitted.of(*c).is_some_and(|v| v > 0.0)
            });
            if columns.is_empty() {
                return Trial::without_fit(term, Verdict::WrongSign);
            }
            if columns.len() == before {
                break fitted;
            }
        };
        let Some(unseen) = self.unseen(active, &fitted) else {
            return Trial::without_fit(term, Verdict::NotTestable);
        };
        let (verdict, gain) = judge(&unseen, spec.axes, self.weight, self.terms.len());
        Trial { term, verdict, columns, gain: Some(gain), unseen }
    }

    /// Interval of a parameter by refitting on blocks drawn with repetition.
    pub fn interval(&self, active: &[usize], column: usize, value: f64) -> Interval {
        bootstrap(value, self.fit_on, LEVEL, "parameter", |drawn| {
            fit(drawn.iter().copied(), active, self.weight)?.of(column)
        })
    }

    /// Squared residuals on blocks that neither fit has seen.
    fn unseen(&self, active: &[usize], with: &Fit) -> Option<Vec<Unseen>> {
        let row = |block: &Block, before: &Fit, after: &Fit| Unseen {
            n: block.n,
            before: std::array::from_fn(|a| block.square(a, before)),
            after: std::array::from_fn(|a| block.square(a, after)),
        };
        if !self.held_out.is_empty() {
            let before = fit(self.fit_on, active, self.weight)?;
            return Some(self.held_out.iter().map(|b| row(b, &before, with)).collect());
        }
        (0..self.fit_on.len())
            .map(|left| {
                let before = fit_without(self.fit_on, left, active, self.weight)?;
                let after = fit_without(self.fit_on, left, &with.active, self.weight)?;
                self.fit_on.get(left).map(|b| row(b, &before, &after))
            })
            .collect()
    }
}

/// Fit on all blocks but one.
pub fn fit_without(
    blocks: &[Block],
    left: usize,
    active: &[usize],
    weight: [f64; 3],
) -> Option<Fit> {
    let rest = blocks.iter().enumerate().filter(|(i, _)| *i != left).map(|(_, b)| b);
    fit(rest, active, weight)
}

impl Trial {
    fn without_fit(term: usize, verdict: Verdict) -> Self {
        Self { term, verdict, columns: Vec::new(), gain: None, unseen: Vec::new() }
    }
}

/// Verdict on unseen blocks, and the share of the mean square that goes.
fn judge(
    unseen: &[Unseen],
    axes: &[usize],
    weight: [f64; 3],
    candidates: usize,
) -> (Verdict, Interval) {
    let level = 1.0 - FALSE_NAMES / candidates.max(1) as f64;
    let sums = |blocks: &[&Unseen], axes: &[usize]| {
        blocks.iter().fold((0.0, 0.0), |(before, after), u| {
            let of = |v: &[f64; 3]| axes.iter().map(|a| weight[*a] * v[*a]).sum::<f64>();
            (before + of(&u.before), after + of(&u.after))
        })
    };
    let share = |blocks: &[&Unseen], axes: &[usize]| {
        let (before, after) = sums(blocks, axes);
        (before > 0.0).then(|| 1.0 - after / before)
    };
    let all: Vec<&Unseen> = unseen.iter().collect();
    let over = |axes: &[usize], level: f64| {
        let value = share(&all, axes).unwrap_or(0.0);
        bootstrap(value, unseen, level, "gain", |drawn| share(drawn, axes))
    };
    let shown = over(axes, LEVEL);
    let low = over(axes, level).low;
    if low.is_nan() || low <= 0.0 {
        return (Verdict::DoesNotHelp, shown);
    }
    let n: f64 = unseen.iter().map(|u| u.n).sum();
    let material = axes.iter().any(|a| {
        let before: f64 = unseen.iter().map(|u| u.before[*a]).sum();
        let after: f64 = unseen.iter().map(|u| u.after[*a]).sum();
        let force_mps2 = ((before - after).max(0.0) / n.max(1.0)).sqrt();
        force_mps2 >= MATERIAL_MPS2[*a]
            && before - after >= MATERIAL_SHARE * before
            && over(&[*a], level).low > 0.0
    });
    (if material { Verdict::Credited } else { Verdict::Immaterial }, shown)
}
