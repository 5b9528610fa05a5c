//! Survey check on the floor: an anchor whose time differences do not fit those of all the others.
//!
//! A standing vehicle measures `d_ab = |p − p_b| + β_b − |p − p_a| − β_a` for many pairs; medians of the
//! last [`KEPT`] of each are fitted by position p, a common bias of the low anchors (which the floor may
//! hide: +3 to +4 m was recorded), and a bias β of each anchor, by Gauss-Newton with the priors below.
//! For each anchor the bias is then asked without its prior: value b and variance v, so
//!
//! ```text
//! doubt = b² / (v + σ_β²),   1/v = 1/P_ββ − 1/σ_β²,   b = v β / P_ββ
//! ```
//!
//! is how much of the misfit this anchor alone explains, in units of what is usual. The worst one is set
//! free and the rest fitted again: only if the others then fit one another is it the anchor. If they fit no place even then,
//! several are at fault at once, as when two are exchanged in the survey. What is seen
//! is the error along the line of sight; an anchor that stands wrong across it fits as well as before. An
//! anchor behind metal looks the same as one with a wrong survey, and is as bad to take off with.

use nalgebra::{SMatrix, SVector, Vector3};

use crate::measure::{AnchorId, Tdoa};
use crate::survey::Survey;

/// Anchors that take part.
const MOST: usize = 16;
/// Values of a pair of which the median is taken: half a second of TDoA2.
const KEPT: usize = 25;
/// A pair with fewer says nothing.
const LEAST_KEPT: u32 = 9;
/// Fewer anchors leave nothing to find one out by: 6 differences, of which a position takes 3 and the
/// floor 1.
const LEAST_ANCHORS: usize = 7;
/// One sigma of a median of a pair, m.
const STD_PAIR_M: f64 = 0.1;
/// One sigma of the range bias of an anchor, m: multipath near the floor (0.2 to 0.5 m per pair).
const STD_BIAS_M: f64 = 0.3;
/// One sigma of the common bias of the low anchors, m.
const STD_HIDDEN_M: f64 = 3.0;
/// One sigma of the height at which the vehicle stands, m: on the floor, on a table, in a hand.
const STD_HEIGHT_M: f64 = 1.0;
/// One sigma of the bias of an anchor that is set free, m.
const STD_FREE_M: f64 = 30.0;
/// Anchors below this may be hidden by the floor, m (`AnchorBias::low_anchor_m`).
const LOW_ANCHOR_M: f64 = 0.6;
/// Steps of the fit, and the longest of them, m.
const STEPS: usize = 20;
const LONGEST_STEP_M: f64 = 1.0;
const SETTLED_M: f64 = 1e-4;
/// Unknowns: position, common bias, biases.
const SIZE: usize = 4 + MOST;
const HIDDEN: usize = 3;
const BIASES: usize = 4;

/// Doubt from which an anchor is named. Simulated halls: 0.8 at most without a fault, 2.4 to 8 for an
/// anchor 1 m off along the line of sight and a vehicle in the middle, less in a corner of the room;
/// recordings in free rooms: up to 1.2.
const NAMED_DOUBT: f64 = 2.0;
/// With the anchor set free the others must be this sound.
const OTHERS_DOUBT: f64 = 1.0;
/// Even with the worst anchor set free the others fit no place: one of them reads as if it were 0.6 m off. Simulated halls:
/// 0.3 at most without a fault, 15 and more with the two that the fault campaign exchanges; recordings: 0.1 at most …
const NOWHERE_DOUBT: f64 = 4.0;
/// … and over a floor that hides the low anchors 7.5, or 29 beside metal: there it must read as if it were 1 m off.
const NOWHERE_HIDDEN_DOUBT: f64 = 10.0;
/// A floor that hides the low anchors by more than this, m, hides faults too: nothing is concluded.
pub const MOST_HIDDEN_M: f64 = 1.0;

/// What the check found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnchorFit {
    /// Common bias of the low anchors, m.
    pub hidden_m: f64,
    /// Anchors that took part.
    pub anchors: usize,
    /// The anchor that fits worst.
    pub worst: AnchorId,
    /// By how much it reads too far, m.
    pub range_bias_m: f64,
    /// How much of the misfit it explains, in units of what is usual.
    pub doubt: f64,
    /// Largest doubt among the others once it is set free.
    pub others_doubt: f64,
}

impl AnchorFit {
    /// Whether the worst anchor is at fault, by at least so much, m.
    pub fn is_at_fault(&self, least_m: f64) -> bool {
        self.doubt > NAMED_DOUBT
            && self.others_doubt < OTHERS_DOUBT
            && self.range_bias_m.abs() >= least_m
            && self.hidden_m.abs() < MOST_HIDDEN_M
    }

    /// Whether several anchors are at fault at once: no place of the vehicle and no single anchor explains what is measured.
    pub fn fits_nowhere(&self) -> bool {
        let hides = self.hidden_m.abs() >= MOST_HIDDEN_M;
        let most = if hides { NOWHERE_HIDDEN_DOUBT } else { NOWHERE_DOUBT };
        self.doubt > most && self.others_doubt > most
    }
}

/// The last values of a pair.
#[derive(Debug, Clone, Copy)]
struct Pair {
    kept: [f32; KEPT],
    seen: u32,
}

impl Pair {
    fn median(&self) -> Option<f64> {
        let n = (self.seen as usize).min(KEPT);
        if self.seen < LEAST_KEPT {
            return None;
        }
        let mut kept = self.kept;
        let used = kept.get_mut(..n)?;
        Some(f64::from(*used.select_nth_unstable_by(n / 2, f32::total_cmp).1))
    }
}

/// How much of a misfit an anchor alone explains, in units of what is usual (equation above): of a bias that
/// was fitted as `fitted_m` with variance `var`, m², under a prior of `prior_std_m`, where `usual_std_m` is
/// usual. Zero where the measurements say nothing of it.
pub(super) fn doubt(fitted_m: f64, var: f64, prior_std_m: f64, usual_std_m: f64) -> f64 {
    let own = 1.0 / var - 1.0 / (prior_std_m * prior_std_m);
    if own <= 1e-6 {
        return 0.0;
    }
    let bias_m = fitted_m / (var * own);
    bias_m * bias_m / (1.0 / own + usual_std_m * usual_std_m)
}

/// Collects while the vehicle stands, and judges.
#[derive(Debug, Clone)]
pub struct AnchorCheck {
    ids: Vec<AnchorId>,
    sites_E_m: Vec<Vector3<f64>>,
    /// Range bias of each that is known beforehand, m.
    known_m: Vec<f64>,
    /// Of the pair with places `a < b` in the survey at `a * MOST + b`.
    pairs: Vec<Pair>,
}

impl AnchorCheck {
    /// Knows nothing yet. Of larger surveys the first 16 anchors take part. `range_bias_m`: biases that are
    /// known beforehand, number of the anchor and m.
    pub fn new(survey: &Survey, range_bias_m: &[[f64; 2]]) -> Self {
        let sites = survey.ids().iter().filter_map(|id| Some((*id, survey.position_E_m(*id)?)));
        let (ids, sites_E_m): (Vec<AnchorId>, _) =
            sites.take(MOST).map(|(id, p)| (id, p.raw())).unzip();
        let bias_m = |id: &AnchorId| {
            let of = |[known, bias_m]: &[f64; 2]| (*known == f64::from(id.0)).then_some(*bias_m);
            range_bias_m.iter().find_map(of).unwrap_or(0.0)
        };
        let known_m = ids.iter().map(bias_m).collect();
        Self {
            ids,
            sites_E_m,
            known_m,
            pairs: vec![Pair { kept: [0.0; KEPT], seen: 0 }; MOST * MOST],
        }
    }

    /// Takes a measurement of a standing vehicle.
    pub fn note(&mut self, tdoa: &Tdoa) {
        let place = |id: AnchorId| self.ids.iter().position(|known| *known == id);
        let (Some(a), Some(b)) = (place(tdoa.anchor_a), place(tdoa.anchor_b)) else { return };
        let known_m = |at: usize| self.known_m.get(at).copied().unwrap_or(0.0);
        let diff_m = tdoa.distance_diff_m - known_m(b) + known_m(a);
        let (low, high, diff_m) = match a.cmp(&b) {
            std::cmp::Ordering::Less => (a, b, diff_m),
            std::cmp::Ordering::Greater => (b, a, -diff_m),
            std::cmp::Ordering::Equal => return,
        };
        if !diff_m.is_finite() {
            return;
        }
        if let Some(pair) = self.pairs.get_mut(low * MOST + high) {
            pair.kept[pair.seen as usize % KEPT] = diff_m as f32;
            // Counted round, so that it never ends: a full ring stays one.
            pair.seen = if pair.seen + 1 >= 2 * KEPT as u32 { KEPT as u32 } else { pair.seen + 1 };
        }
    }

    /// Forgets everything: the vehicle flew.
    pub fn clear(&mut self) {
        for pair in &mut self.pairs {
            pair.seen = 0;
        }
    }

    /// Judges what was collected, for a vehicle that may stand at `height_m`. `None`: too little is known.
    pub fn judge(&self, height_m: f64) -> Option<AnchorFit> {
        let first = self.fit(height_m, None)?;
        let worst = first.worst(None)?;
        let second = self.fit(height_m, Some(worst))?;
        let other = second.worst(Some(worst))?;
        Some(AnchorFit {
            hidden_m: second.x[HIDDEN],
            anchors: first.anchors,
            worst: *self.ids.get(worst)?,
            range_bias_m: second.x[BIASES + worst],
            doubt: first.doubts[worst],
            others_doubt: second.doubts[other],
        })
    }

    fn fit(&self, height_m: f64, free: Option<usize>) -> Option<Fitted> {
        let mut buffer = [(0, 0, 0.0); MOST * (MOST - 1) / 2];
        let mut pairs = 0;
        let mut heard = [false; MOST];
        let known = self.pairs.iter().enumerate().filter_map(|(at, p)| Some((at, p.median()?)));
        for (slot, (at, diff_m)) in buffer.iter_mut().zip(known) {
            *slot = (at / MOST, at % MOST, diff_m);
            (heard[at / MOST], heard[at % MOST]) = (true, true);
            pairs += 1;
        }
        let medians = buffer.get(..pairs)?;
        let anchors = heard.iter().filter(|h| **h).count();
        if anchors < LEAST_ANCHORS {
            return None;
        }
        let std_bias_m = |i: usize| if free == Some(i) { STD_FREE_M } else { STD_BIAS_M };
        let mut x = SVector::<f64, SIZE>::zeros();
        let centre = self.sites_E_m.iter().sum::<Vector3<f64>>() / self.sites_E_m.len() as f64;
        x.fixed_rows_mut::<3>(0).copy_from(&Vector3::new(centre.x, centre.y, -height_m));
        let mut information = SMatrix::<f64, SIZE, SIZE>::identity();
        for _ in 0..STEPS {
            let mut A = SMatrix::<f64, SIZE, SIZE>::zeros();
            let mut b = SVector::<f64, SIZE>::zeros();
            for (i, j, measured_m) in medians {
                let (r, row) = self.residual(&x, *i, *j, *measured_m)?;
                let w = 1.0 / (STD_PAIR_M * STD_PAIR_M);
                for (k, h_k) in row {
                    b[k] += w * h_k * r;
                    for (l, h_l) in row {
                        A[(k, l)] += w * h_k * h_l;
                    }
                }
            }
            let mut prior = |at: usize, value: f64, std: f64| {
                let w = 1.0 / (std * std);
                A[(at, at)] += w;
                b[at] += w * (value - x[at]);
            };
            prior(2, -height_m, STD_HEIGHT_M);
            prior(HIDDEN, 0.0, STD_HIDDEN_M);
            for i in 0..MOST {
                prior(BIASES + i, 0.0, std_bias_m(i));
            }
            information = A;
            let step = A.cholesky()?.solve(&b);
            let moved_m = step.fixed_rows::<3>(0).amax();
            x += step * (LONGEST_STEP_M / moved_m.max(LONGEST_STEP_M));
            if moved_m < SETTLED_M {
                break;
            }
        }
        let covariance = information.cholesky()?.inverse();
        let mut doubts = [0.0; MOST];
        for i in (0..MOST).filter(|i| heard[*i]) {
            let var = covariance[(BIASES + i, BIASES + i)];
            doubts[i] = doubt(x[BIASES + i], var, std_bias_m(i), STD_BIAS_M);
        }
        x.iter().all(|v| v.is_finite()).then_some(Fitted { x, doubts, heard, anchors })
    }

    /// Measured minus predicted, and what of its row is not zero.
    fn residual(
        &self,
        x: &SVector<f64, SIZE>,
        a: usize,
        b: usize,
        measured_m: f64,
    ) -> Option<(f64, [(usize, f64); 6])> {
        let p = Vector3::new(x[0], x[1], x[2]);
        let (site_a, site_b) = (self.sites_E_m.get(a)?, self.sites_E_m.get(b)?);
        let (from_a, from_b) = (p - site_a, p - site_b);
        let (distance_a, distance_b) = (from_a.norm().max(0.05), from_b.norm().max(0.05));
        let hides = |site: &Vector3<f64>| f64::from(u8::from(-site.z < LOW_ANCHOR_M));
        let hidden = hides(site_b) - hides(site_a);
        let predicted_m =
            distance_b - distance_a + hidden * x[HIDDEN] + x[BIASES + b] - x[BIASES + a];
        let h = from_b / distance_b - from_a / distance_a;
        let row =
            [(0, h.x), (1, h.y), (2, h.z), (HIDDEN, hidden), (BIASES + b, 1.0), (BIASES + a, -1.0)];
        Some((measured_m - predicted_m, row))
    }
}

/// Result of one fit.
struct Fitted {
    x: SVector<f64, SIZE>,
    doubts: [f64; MOST],
    heard: [bool; MOST],
    anchors: usize,
}

impl Fitted {
    /// The anchor of the largest doubt, one of them left out.
    fn worst(&self, but: Option<usize>) -> Option<usize> {
        (0..MOST)
            .filter(|i| self.heard[*i] && but != Some(*i))
            .max_by(|i, j| self.doubts[*i].total_cmp(&self.doubts[*j]))
    }
}
