//! An anchor that does not fit in flight is found and left out: it moved, or metal stands before it.
//!
//! Fault detection and exclusion on residuals. Each difference of distances gives one equation in the
//! error δp of the estimated position and the range biases β of its two anchors,
//!
//! ```text
//! r = z − (|p̂ − b| − |p̂ − a|) = h δp + β_b − β_a + noise,   h = ∂z/∂p
//! ```
//!
//! with p̂ from the filter and without the biases that the filter has learned: they may have swallowed
//! the fault. Normal equations of the last `memory_s` are kept with fading weights. For each anchor the
//! bias is asked without its prior, value b and variance v, and its doubt `b² / (v + σ_β²)` is how much it
//! explains in units of what is usual, as in the check on the floor (`anchor_check.rs`). The worst anchor is set
//! free; only if the others then fit one another, for `confirm_s`, is it left out: its bias becomes free in the
//! filter, the position moves by δp, what the other biases have swallowed is forgotten. It comes back when it has
//! fitted for a while, or when the vehicle has landed.
//!
//! Two that are blocked at once can share their misfit with the position until none of them alone is doubted. For each pair,
//! b and V being the values, m, and covariance, m², of both biases without their priors, β and P the same with them,
//!
//! ```text
//! doubt = bᵀ (V + σ_β² I)⁻¹ b,   V⁻¹ = P⁻¹ − I/σ_β²,   b = V P⁻¹ β
//! ```
//!
//! is what both explain. Where somebody must be at fault, one or a pair, and nobody can be left out for it, that much is
//! told: the anchors contradict one another, and the position is δp elsewhere if it is those that explain most.
//!
//! Below [`LEAST_ANCHORS`] nothing can be found out, and integrity is not to be had: the
//! estimator's health is degraded then.
//!
//! **Symbols.** r, δp, β m, frame `E`. **Source.** Parkinson and Axelrad, "Autonomous GPS integrity monitoring
//! using the pseudorange residual", Navigation 35(2), 1988, for snapshots; the fading window, the pairs and the
//! priors on the biases are ours. **Left out.** Two anchors that fail at once are told, not left out: of eight too few
//! would remain to say that it is these.

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

use super::anchor_check::doubt;
use super::bias::{MOST_ANCHORS, Pair};
use super::config::Isolation as Config;
use crate::time::HostTime;

const SIZE: usize = 3 + MOST_ANCHORS;
pub(super) type Normal = SMatrix<f64, SIZE, SIZE>;
type Unknowns = SVector<f64, SIZE>;

/// Fewer anchors do not find one out: of 6 differences a position takes 3 and the suspect 1, and the
/// two that are left must speak against every other suspect.
pub const LEAST_ANCHORS: usize = 7;
/// Time between two judgements, s: a few in the time of confirmation.
const INTERVAL_S: f64 = 0.1;
/// One sigma of the mean of a pair over the memory, m: the wandering part of its error (`bias.rs`), which
/// such a mean does not average away; the check on the floor has 0.1 for its medians.
const STD_PAIR_M: f64 = 0.15;
/// One sigma of the filter's position, m: chosen larger than any error that was seen before a fix.
const STD_POSITION_M: f64 = 5.0;
/// One sigma of a bias that is free in the fit, m: as good as none.
const STD_FREE_M: f64 = 30.0;
/// Fewer equations say nothing: chosen, a twentieth of a second of TDoA2.
const LEAST_EQUATIONS: f64 = 20.0;
/// Somebody is at fault from so many times the doubt from which one is suspected, whether one can be named or not:
/// from 1.5 to 3 times warned alike on the recorded flights with a fault in them (2026-11-23; no command repeats it).
const CONTRADICTED: f64 = 2.0;
/// … and a pair from so many times: of 1.25, 1.5 and 2 the one that warned most of two blocked anchors, and of sound recorded flights
/// for half a per cent of their time more (`haltere-lab recorded DIR --faults`).
const PAIR_CONTRADICTED: f64 = 1.25;
/// Doubt below which one that is left out fits: its error is no larger than is usual.
const FITS_DOUBT: f64 = 1.0;
/// An anchor counts as heard with this share of an equal part of the equations: chosen, so that one that
/// falls silent is gone after 1.6 memories.
const HEARD_SHARE: f64 = 0.2;

/// An anchor is to be left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeaveOut {
    /// Its place in the survey.
    pub rank: usize,
    /// By how much it reads too far, m.
    pub bias_m: f64,
    /// Where the position is, minus where the filter has it, Earth frame, m.
    pub shift_E_m: Vector3<f64>,
    /// Largest sigma of that, m.
    pub std_m: f64,
}

/// The anchors do not fit one another.
#[derive(Debug, Clone, Copy)]
struct Contradicted {
    since: HostTime,
    /// For long enough.
    lasts: bool,
    /// Where the position is, minus where the filter has it, if it is those that explain most, Earth frame, m.
    shift_E_m: Vector3<f64>,
}

/// The equations of the last while, and who is left out.
#[derive(Debug, Clone)]
pub struct Isolation {
    normal: Box<Normal>,
    right: Unknowns,
    equations: f64,
    judged_at: Option<HostTime>,
    /// Who may be at fault, and since when.
    suspect: Option<(usize, HostTime)>,
    /// Since when somebody is.
    contradicted: Option<Contradicted>,
    /// Who is left out.
    out: [bool; MOST_ANCHORS],
    /// Since when one that is left out fits.
    fits_since: [Option<HostTime>; MOST_ANCHORS],
}

impl Default for Isolation {
    fn default() -> Self {
        Self {
            normal: Box::new(Normal::zeros()),
            right: Unknowns::zeros(),
            equations: 0.0,
            judged_at: None,
            suspect: None,
            contradicted: None,
            out: [false; MOST_ANCHORS],
            fits_since: [None; MOST_ANCHORS],
        }
    }
}

impl Isolation {
    /// Takes an equation.
    #[inline]
    pub fn note(&mut self, pair: Pair, h: &Vector3<f64>, residual_m: f64) {
        if pair.a >= MOST_ANCHORS || pair.b >= MOST_ANCHORS {
            return;
        }
        let row = [(0, h.x), (1, h.y), (2, h.z), (3 + pair.a, -1.0), (3 + pair.b, 1.0)];
        for (k, h_k) in row {
            self.right[k] += h_k * residual_m;
            for (l, h_l) in row {
                self.normal[(k, l)] += h_k * h_l;
            }
        }
        self.equations += 1.0;
    }

    /// Forgets the equations; who is left out stays so.
    pub fn clear(&mut self) {
        self.normal.fill(0.0);
        self.right.fill(0.0);
        self.equations = 0.0;
        self.suspect = None;
        self.contradicted = None;
    }

    /// Whether the anchors have contradicted one another for a while, and none could be left out for it: by how much the
    /// position may be off, Earth frame, m.
    #[inline]
    pub fn contradicted_by_E_m(&self) -> Option<Vector3<f64>> {
        self.contradicted.filter(|all| all.lasts).map(|all| all.shift_E_m)
    }

    /// Whether an anchor is left out.
    #[inline]
    pub fn is_out(&self, rank: usize) -> bool {
        self.out.get(rank).copied().unwrap_or(false)
    }

    /// Who is, by their place in the survey.
    pub fn left_out(&self) -> &[bool; MOST_ANCHORS] {
        &self.out
    }

    /// Forgets everything.
    pub fn restart(&mut self) {
        self.clear();
        self.judged_at = None;
        self.out = [false; MOST_ANCHORS];
        self.fits_since = [None; MOST_ANCHORS];
    }

    /// Judges, when it is time to: who is to be left out now. One that fits again is taken back here. Least and
    /// most by which the position can be elsewhere: a vehicle that has landed among hidden anchors once fitted
    /// best 7.6 m above the floor, one of them left out.
    #[inline]
    pub fn judge(
        &mut self,
        config: &Config,
        at: HostTime,
        reach_E_m: &[Vector3<f64>; 2],
    ) -> Option<LeaveOut> {
        let Some(judged_at) = self.judged_at else {
            self.judged_at = Some(at);
            return None;
        };
        let since_s = at.seconds_since(judged_at);
        if since_s < INTERVAL_S {
            return None;
        }
        self.judged_at = Some(at);
        let action = self.look(config, at, reach_E_m);
        let fade = (-since_s / config.memory_s).exp();
        *self.normal *= fade;
        self.right *= fade;
        self.equations *= fade;
        action
    }

    fn look(
        &mut self,
        config: &Config,
        at: HostTime,
        [least_E_m, most_E_m]: &[Vector3<f64>; 2],
    ) -> Option<LeaveOut> {
        if self.equations < LEAST_EQUATIONS {
            self.suspect = None;
            self.contradicted = None;
            return None;
        }
        let heard = self.heard();
        let anchors = heard.iter().filter(|h| **h).count();
        let first = self.fit(config, &heard, [None; 2])?;
        if let Some(rank) = self.back(config, &first, &heard, at) {
            self.out[rank] = false;
            self.fits_since[rank] = None;
            return None;
        }
        self.contradicted = self.contradiction(config, &first, &heard, at);
        let left = anchors - (0..MOST_ANCHORS).filter(|i| heard[*i] && self.out[*i]).count();
        let worst = first.worst(None).filter(|_| left >= LEAST_ANCHORS);
        let named = worst.filter(|w| first.doubts[*w] > config.doubt).and_then(|w| {
            let second = self.fit(config, &heard, [Some(w), None])?;
            let others = second.worst(Some(w)).map_or(0.0, |o| second.doubts[o]);
            let bias_m = second.x[3 + w];
            let shift_E_m = second.shift_E_m();
            let within = shift_E_m >= *least_E_m && shift_E_m <= *most_E_m;
            let alone = others < config.others_doubt && bias_m.abs() > config.least_m && within;
            alone.then_some((w, second))
        });
        let Some((rank, fitted)) = named else {
            self.suspect = None;
            return None;
        };
        match self.suspect {
            Some((same, since)) if same == rank => {
                if at.seconds_since(since) < config.confirm_s {
                    return None;
                }
            }
            _ => {
                self.suspect = Some((rank, at));
                return None;
            }
        }
        let shift_E_m = fitted.shift_E_m();
        // The equations are those of the position as it will be.
        self.right -= self.normal.fixed_columns::<3>(0) * shift_E_m;
        self.out[rank] = true;
        self.fits_since[rank] = None;
        self.suspect = None;
        self.contradicted = None;
        let std_m = fitted.position_var.diagonal().max().max(0.0).sqrt();
        Some(LeaveOut { rank, bias_m: fitted.x[3 + rank], shift_E_m, std_m })
    }

    /// Whether somebody must be at fault, one or a pair.
    fn contradiction(
        &self,
        config: &Config,
        first: &Fitted,
        heard: &[bool; MOST_ANCHORS],
        at: HostTime,
    ) -> Option<Contradicted> {
        let most = CONTRADICTED * config.doubt;
        let one = first.worst(None).filter(|w| first.doubts[*w] > most).map(|w| [Some(w), None]);
        let free = one.or_else(|| {
            let (pair, doubt) = first.worst_pair(heard, config.std_bias_m)?;
            (doubt > PAIR_CONTRADICTED * config.doubt).then_some(pair.map(Some))
        })?;
        let shift_E_m = self.fit(config, heard, free)?.shift_E_m();
        let since = self.contradicted.map_or(at, |before| before.since);
        let lasts = at.seconds_since(since) >= config.confirm_s;
        Some(Contradicted { since, lasts, shift_E_m })
    }

    /// One that is left out and has fitted for long enough.
    fn back(
        &mut self,
        config: &Config,
        fitted: &Fitted,
        heard: &[bool; MOST_ANCHORS],
        at: HostTime,
    ) -> Option<usize> {
        for rank in (0..MOST_ANCHORS).filter(|i| self.out[*i] && heard[*i]) {
            let fits = fitted.doubts[rank] < FITS_DOUBT;
            let since = &mut self.fits_since[rank];
            *since = if fits { since.or(Some(at)) } else { None };
            if since.is_some_and(|since| at.seconds_since(since) >= config.return_s) {
                return Some(rank);
            }
        }
        None
    }

    fn heard(&self) -> [bool; MOST_ANCHORS] {
        let mut heard = [false; MOST_ANCHORS];
        let weight = |i: usize| self.normal[(3 + i, 3 + i)];
        let known = (0..MOST_ANCHORS).filter(|i| weight(*i) > 0.0).count().max(1);
        let least = HEARD_SHARE * 2.0 * self.equations / known as f64;
        for (i, heard) in heard.iter_mut().enumerate() {
            *heard = weight(i) > least;
        }
        heard
    }

    fn fit(
        &self,
        config: &Config,
        heard: &[bool; MOST_ANCHORS],
        free: [Option<usize>; 2],
    ) -> Option<Fitted> {
        let anchors = heard.iter().filter(|h| **h).count();
        // A mean of the pairs, as many as there are anchors: errors of one pair stay for longer than the memory.
        let scale = anchors as f64 / (self.equations * STD_PAIR_M * STD_PAIR_M);
        let std_bias_m = |i: usize| {
            if free.contains(&Some(i)) || self.out[i] { STD_FREE_M } else { config.std_bias_m }
        };
        let mut information = *self.normal * scale;
        for k in 0..3 {
            information[(k, k)] += 1.0 / (STD_POSITION_M * STD_POSITION_M);
        }
        for i in 0..MOST_ANCHORS {
            let std_m = std_bias_m(i);
            information[(3 + i, 3 + i)] += 1.0 / (std_m * std_m);
        }
        let noted = (0..MOST_ANCHORS).rev().find(|i| self.normal[(3 + i, 3 + i)] > 0.0);
        let live = noted.map_or(3, |last| 3 + last + 1);
        let covariance = inverse(information.cholesky()?.l_dirty(), live);
        let x = covariance * self.right * scale;
        let mut doubts = [0.0; MOST_ANCHORS];
        for i in (0..MOST_ANCHORS).filter(|i| heard[*i]) {
            let std_m = std_bias_m(i);
            let var = covariance[(3 + i, 3 + i)];
            doubts[i] = doubt(x[3 + i], var, std_m, config.std_bias_m);
        }
        let position_var = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let bias_var = covariance.fixed_view::<MOST_ANCHORS, MOST_ANCHORS>(3, 3).into_owned();
        let out = self.out;
        x.iter().all(|v| v.is_finite()).then_some(Fitted { x, out, doubts, position_var, bias_var })
    }
}

/// Inverse of a matrix by its Cholesky factor, of which no more than the first `live` rows hold anything beside their diagonal. To
/// the last bit that of the general solver (nalgebra 0.35), whose sums are taken in the same order and by the same eights; what is
/// zero is left out, which of eight anchors is seven eighths.
pub(super) fn inverse(L: &Normal, live: usize) -> Normal {
    let mut covariance = Normal::zeros();
    for c in 0..SIZE {
        let end = if c < live { live } else { c + 1 };
        let x = &mut covariance.data.0[c];
        x[c] = 1.0;
        // L y = e, forward, then Lᵀ x = y, back.
        for i in c..end {
            let column = &L.data.0[i];
            x[i] /= column[i];
            let y = x[i];
            for (x, l) in x[i + 1..end].iter_mut().zip(&column[i + 1..end]) {
                *x -= y * l;
            }
        }
        for i in (0..end).rev() {
            let column = &L.data.0[i];
            let eights = (SIZE - 1 - i) / 8 * 8;
            let mut by_lane = [0.0; 8];
            let (mut rest, terms) = (0.0, column[i + 1..end].iter().zip(&x[i + 1..end]));
            let mut after = [0.0; 8];
            for (n, (l, x)) in terms.enumerate() {
                if n < eights {
                    by_lane[n % 8] += l * x;
                } else {
                    after[n - eights] = l * x;
                }
            }
            for n in 0..4 {
                rest += by_lane[n] + by_lane[n + 4];
            }
            let sum = after.iter().fold(rest, |sum, term| sum + term);
            x[i] = (x[i] - sum) / column[i];
        }
    }
    covariance
}

struct Fitted {
    x: Unknowns,
    out: [bool; MOST_ANCHORS],
    doubts: [f64; MOST_ANCHORS],
    position_var: Matrix3<f64>,
    bias_var: SMatrix<f64, MOST_ANCHORS, MOST_ANCHORS>,
}

impl Fitted {
    /// Where the position is, minus where the filter has it, m.
    fn shift_E_m(&self) -> Vector3<f64> {
        Vector3::new(self.x[0], self.x[1], self.x[2])
    }

    /// The anchor of the largest doubt among those that take part, one of them left out.
    fn worst(&self, but: Option<usize>) -> Option<usize> {
        (0..MOST_ANCHORS)
            .filter(|i| but != Some(*i) && !self.out[*i] && self.doubts[*i] > 0.0)
            .max_by(|i, j| self.doubts[*i].total_cmp(&self.doubts[*j]))
    }

    /// The two anchors that explain most together, and how much, in units of what is usual (equation above).
    fn worst_pair(
        &self,
        heard: &[bool; MOST_ANCHORS],
        usual_std_m: f64,
    ) -> Option<([usize; 2], f64)> {
        let usual = Matrix2::identity() * usual_std_m.powi(2);
        let part = |i: usize| heard[i] && !self.out[i];
        let doubt = |i: usize, j: usize| {
            let P = &self.bias_var;
            let both = Matrix2::new(P[(i, i)], P[(i, j)], P[(j, i)], P[(j, j)]);
            let information = both.try_inverse()?;
            let var = (information - usual.try_inverse()?).try_inverse()?;
            let bias_m = var * information * Vector2::new(self.x[3 + i], self.x[3 + j]);
            Some(bias_m.dot(&((var + usual).try_inverse()? * bias_m)))
        };
        (0..MOST_ANCHORS)
            .flat_map(|i| (i + 1..MOST_ANCHORS).map(move |j| [i, j]))
            .filter(|[i, j]| part(*i) && part(*j))
            .filter_map(|[i, j]| Some(([i, j], doubt(i, j).filter(|d| d.is_finite())?)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
    }
}
