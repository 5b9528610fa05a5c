//! Range bias of each anchor, as states beside the nine: what multipath and obstacles do to a path.
//!
//! **Equation.** A difference of distances reads `z = |p − b| − |p − a| + β_b − β_a + noise`, with
//! `β_j = w_j + c_j` for each anchor j. `w` wanders, a Gauss-Markov process in time and in distance
//! flown, because what an obstacle does to a path depends on where the tag is; `c` stays
//! (antenna, survey):
//!
//! ```text
//! w ← φ w,   var w ← φ² var w + σ² (1 − φ²),   φ = exp(−t (1/τ + |v|/ℓ))
//! ```
//!
//! An error that two pairs share is then explained by the anchor they share, with opposite signs,
//! and not by a position; one that lasts is not averaged away as if it were new at each packet.
//! **Hidden anchors.** Below `hidden_below_m` the floor hides anchors that hang lower than
//! `low_anchor_m`: their σ is `hidden_std_m` there (recorded: +3 to +4 m on all four low anchors of a
//! vehicle that stands, gone within the first half metre).
//!
//! **Symbols.** β, w, c range bias, m; σ one sigma of w, m; τ s; ℓ m; t step, s; v m/s. A common bias
//! of all anchors cancels in each difference and stays at its prior. **Source.** Per-anchor bias
//! found in the recordings of UTIL (docs/ESTIMATOR.md); Gauss-Markov states as in Maybeck,
//! "Stochastic models, estimation and control" 1, 1979, section 4.11. **Left out.** That a blocked
//! path is only ever longer: the states are normal, their sign is free.

use nalgebra::Vector3;

use super::config::AnchorBias;
use super::error_state::{ATT, POS, STATES, StateVec, Transition, VEL};

/// One sigma of the bias of an anchor that is left out, m: recorded were 2.5 m behind metal and 3 to 4 m
/// on the floor (docs/ESTIMATOR.md).
pub const FREE_M: f64 = 3.0;
/// Anchors that have a bias; of further ones it counts as noise.
pub const MOST_ANCHORS: usize = 16;
/// States at most: one that wanders and one that stays for each anchor, and the gyroscope's (`gyro_bias.rs`).
const MOST: usize = 2 * MOST_ANCHORS + 3;

/// One number for each bias state.
pub type BiasVec = [f64; MOST];
/// Zero for each.
pub const NO_BIASES: BiasVec = [0.0; MOST];

/// Bias states, their covariance, and their ties to the nine: of the anchors and of the gyroscope.
#[derive(Debug, Clone, PartialEq)]
pub struct Biases {
    /// Anchors with a bias; 0: the plain nine-state filter.
    anchors: usize,
    /// States of the gyroscope, none or three.
    pub(super) gyro: usize,
    /// Values, m; of the gyroscope rad/s.
    pub(super) value: BiasVec,
    /// Covariance with the nine states, a row for each bias.
    pub(super) cross: [[f64; STATES]; MOST],
    /// Covariance among themselves.
    pub(super) own: [[f64; MOST]; MOST],
}

/// The two anchors of a difference, by their place in the survey.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pair {
    /// Anchor that is subtracted.
    pub a: usize,
    /// Anchor that is added.
    pub b: usize,
}

/// How the biases move in a step.
#[derive(Debug, Clone, Copy)]
pub struct Wander<'a> {
    /// Step, s.
    pub dt_s: f64,
    /// Speed, m/s.
    pub speed_mps: f64,
    /// One sigma of the bias of the low anchors, m, where the floor hides them.
    pub hidden_std_m: Option<f64>,
    /// Heights of the anchors, m.
    pub anchors_m: &'a [f64],
    /// Variance factor of each anchor (`quality.rs`).
    pub factors: &'a [f64],
    /// The slow one (`bias_level.rs`).
    pub levels: &'a [f64; MOST_ANCHORS],
    /// Which anchors are left out (`isolation.rs`): nothing is learned from them.
    pub left_out: &'a [bool; MOST_ANCHORS],
}

impl Default for Biases {
    fn default() -> Self {
        Self {
            anchors: 0,
            gyro: 0,
            value: [0.0; MOST],
            cross: [[0.0; STATES]; MOST],
            own: [[0.0; MOST]; MOST],
        }
    }
}

impl Biases {
    /// Nothing known but the prior; `heights_m` of the anchors in the order of the survey.
    pub fn new(config: &AnchorBias, heights_m: &[f64], near_floor: bool) -> Self {
        let mut biases = Self::default();
        if !config.estimate {
            return biases;
        }
        biases.anchors = heights_m.len().min(MOST_ANCHORS);
        for (i, anchor_m) in heights_m.iter().take(MOST_ANCHORS).enumerate() {
            let hidden = near_floor && *anchor_m < config.low_anchor_m;
            let std_m = if hidden { config.hidden_std_m } else { config.std_m };
            biases.own[i][i] = std_m * std_m;
            let c = biases.anchors + i;
            biases.own[c][c] = config.constant_std_m * config.constant_std_m;
        }
        biases
    }

    /// Whether there is any.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.rows() == 0
    }

    /// Whether anchors have any.
    #[inline]
    pub fn of_anchors(&self) -> bool {
        self.anchors > 0
    }

    /// Number of states.
    #[inline]
    pub(super) fn rows(&self) -> usize {
        2 * self.anchors + self.gyro
    }

    /// The first state of the gyroscope.
    #[inline]
    pub(super) fn gyro_row(&self) -> usize {
        2 * self.anchors
    }

    /// Whether both anchors of a pair have one.
    #[inline]
    pub fn holds(&self, pair: Pair) -> bool {
        pair.a < self.anchors && pair.b < self.anchors
    }

    /// Bias of an anchor and its sigma, m.
    pub fn of(&self, anchor: usize) -> Option<(f64, f64)> {
        (anchor < self.anchors).then(|| {
            let (w, c) = (anchor, self.anchors + anchor);
            let var = self.own[w][w] + 2.0 * self.own[w][c] + self.own[c][c];
            (self.value[w] + self.value[c], var.max(0.0).sqrt())
        })
    }

    /// What the biases add to a difference of distances, m.
    #[inline]
    pub fn difference_m(&self, pair: Pair) -> f64 {
        if !self.holds(pair) {
            return 0.0;
        }
        let (n, Pair { a, b }) = (self.anchors, pair);
        self.value[b] + self.value[n + b] - self.value[a] - self.value[n + a]
    }

    /// Adds their part to `P Hᵀ` of the nine, makes their own, and returns their part of `H P Hᵀ`
    /// that is not in the nine's. `h` is the Jacobian to the nine.
    #[inline]
    pub fn project(
        &self,
        pair: Option<Pair>,
        h: &StateVec,
        pht: &mut StateVec,
        own: &mut BiasVec,
    ) -> f64 {
        let (n, rows) = (self.anchors, self.rows());
        // A measurement without biases still moves them through their ties.
        for (slot, row) in own.iter_mut().zip(&self.cross).take(rows) {
            *slot = dot9(row, h);
        }
        let mut var = 0.0;
        // A pair without biases is one that none has: of further anchors than there are states.
        if let Some(Pair { a, b }) = pair.filter(|pair| self.holds(*pair)) {
            for k in 0..STATES {
                pht[k] += self.cross[b][k] + self.cross[n + b][k]
                    - self.cross[a][k]
                    - self.cross[n + a][k];
            }
            for (slot, row) in own.iter_mut().zip(&self.own).take(rows) {
                *slot += row[b] + row[n + b] - row[a] - row[n + a];
            }
            var = own[b] + own[n + b] - own[a] - own[n + a];
        }
        var
    }

    /// `P ← P − (P Hᵀ)(P Hᵀ)ᵀ/S` and the correction, for the biases' part.
    #[inline]
    pub fn correct(&mut self, pht: &StateVec, own: &BiasVec, inverse: f64, innovation: f64) {
        let n = self.rows();
        let own = &own[..n];
        for (i, p) in own.iter().enumerate() {
            let scaled = p * inverse;
            for (c, x) in self.cross[i].iter_mut().zip(pht.iter()) {
                *c -= scaled * x;
            }
            for (o, x) in self.own[i].iter_mut().zip(own) {
                // The product of the two first, so that both halves round alike.
                *o -= (p * x) * inverse;
            }
            self.value[i] += scaled * innovation;
        }
    }

    /// Turns the ties to the attitude with it (`state.rs`).
    #[inline]
    pub fn turn(&mut self, J: &nalgebra::Matrix3<f64>) {
        let rows = self.rows();
        for row in self.cross.iter_mut().take(rows) {
            let turned = J * Vector3::new(row[ATT], row[ATT + 1], row[ATT + 2]);
            row[ATT..ATT + 3].copy_from_slice(turned.as_slice());
        }
    }

    /// Cuts the ties to three neighbouring states.
    pub fn untie(&mut self, start: usize) {
        let rows = self.rows();
        for row in self.cross.iter_mut().take(rows) {
            row[start..start + 3].fill(0.0);
        }
    }

    /// One step: the ties follow the nine, the biases wander.
    #[inline]
    pub fn propagate(&mut self, F: &Transition, config: &AnchorBias, step: &Wander<'_>) {
        let n = self.anchors;
        let usual =
            decay(step.dt_s * (1.0 / config.correlation_s + step.speed_mps / config.correlation_m));
        let quick = decay(step.dt_s / config.hidden_s);
        let mut phi = [1.0; MOST];
        let mut growth = [0.0; MOST_ANCHORS];
        for (i, grown) in growth.iter_mut().enumerate().take(n) {
            let var = config.std_m * config.std_m;
            let anchor_m = step.anchors_m.get(i).copied().unwrap_or_default();
            if step.left_out[i] {
                phi[i] = quick;
                *grown = FREE_M * FREE_M * (1.0 - quick * quick);
            } else if let Some(std_m) = step.hidden_std_m.filter(|_| anchor_m < config.low_anchor_m)
            {
                phi[i] = quick;
                *grown = std_m * std_m * (1.0 - quick * quick);
            } else {
                // What the floor did is gone as soon as the floor is.
                let was_hidden = self.own[i][i] > MUCH_MORE * var;
                phi[i] = if was_hidden { quick.min(usual) } else { usual };
                let factor = step.factors.get(i).copied().unwrap_or(1.0) * step.levels[i];
                *grown = var * factor * (1.0 - usual * usual);
            }
        }
        let rows = self.rows();
        for i in 0..rows {
            let row = &mut self.cross[i];
            let (x, v, d) = (
                Vector3::new(row[POS], row[POS + 1], row[POS + 2]),
                Vector3::new(row[VEL], row[VEL + 1], row[VEL + 2]),
                Vector3::new(row[ATT], row[ATT + 1], row[ATT + 2]),
            );
            let f = phi[i];
            let x = (x + F.xv * v + F.xd * d) * f;
            let v = (F.vv * v + F.vd * d) * f;
            let d = F.dd * d * f;
            row[POS..VEL].copy_from_slice(x.as_slice());
            row[VEL..ATT].copy_from_slice(v.as_slice());
            row[ATT..].copy_from_slice(d.as_slice());
            for (o, other) in self.own[i][..rows].iter_mut().zip(&phi) {
                *o *= f * other;
            }
            self.value[i] *= f;
        }
        for (i, grown) in growth.iter().enumerate().take(n) {
            self.own[i][i] += grown;
        }
    }

    /// `ŵ²` and `V − P` of what wanders of an anchor's bias, m²: what is found of it, and what is said to be found.
    /// Nothing for one that is left out, or that is less known than usual.
    #[inline]
    pub fn wandering_m2(
        &self,
        config: &AnchorBias,
        step: &Wander<'_>,
        anchor: usize,
    ) -> Option<(f64, f64)> {
        if anchor >= self.anchors || step.left_out[anchor] {
            return None;
        }
        let factor = step.factors.get(anchor).copied().unwrap_or(1.0) * step.levels[anchor];
        let known_m2 = config.std_m * config.std_m * factor - self.own[anchor][anchor];
        (known_m2 > 0.0).then(|| (self.value[anchor] * self.value[anchor], known_m2))
    }

    /// The anchors that the floor hides have this bias, m.
    pub fn set_hidden(&mut self, config: &AnchorBias, heights_m: &[f64], bias_m: f64) {
        for (value_m, anchor_m) in self.value.iter_mut().take(self.anchors).zip(heights_m) {
            if *anchor_m < config.low_anchor_m {
                *value_m = bias_m;
            }
        }
    }

    /// The part of an anchor's bias that wanders has this value, m; how well it is known stays.
    pub fn set_wandering(&mut self, anchor: usize, bias_m: f64) {
        if let Some(value_m) = self.value.get_mut(anchor).filter(|_| anchor < self.anchors) {
            *value_m = bias_m;
        }
    }

    /// Forgets what wanders; what stays is kept.
    pub fn restart(
        &mut self,
        config: &AnchorBias,
        heights_m: &[f64],
        near_floor: bool,
        left_out: &[bool; MOST_ANCHORS],
    ) {
        let n = self.anchors;
        for (i, anchor_m) in heights_m.iter().take(n).enumerate() {
            let hidden = near_floor && *anchor_m < config.low_anchor_m;
            let std_m = if hidden { config.hidden_std_m } else { config.std_m };
            let std_m = if left_out[i] { FREE_M } else { std_m };
            for j in 0..self.rows() {
                self.own[i][j] = 0.0;
                self.own[j][i] = 0.0;
            }
            self.own[i][i] = std_m * std_m;
            self.value[i] = 0.0;
            self.cross[i].fill(0.0);
        }
    }

    /// Whether every number is finite and no variance negative.
    pub fn is_sane(&self) -> bool {
        (0..self.rows()).all(|i| {
            self.value[i].is_finite() && self.own[i][i].is_finite() && self.own[i][i] > -1e-9
        })
    }

    /// The covariance of all states in one.
    #[cfg(test)]
    pub fn whole(&self, P: &super::error_state::Cov) -> nalgebra::DMatrix<f64> {
        let n = self.rows();
        nalgebra::DMatrix::from_fn(STATES + n, STATES + n, |i, j| {
            match (i.checked_sub(STATES), j.checked_sub(STATES)) {
                (None, None) => P[(i, j)],
                (Some(i), None) => self.cross[i][j],
                (None, Some(j)) => self.cross[j][i],
                (Some(i), Some(j)) => self.own[i][j],
            }
        })
    }

    /// Largest difference between the two halves of the covariance, m².
    #[cfg(test)]
    pub fn asymmetry(&self) -> f64 {
        let n = self.rows();
        (0..n)
            .flat_map(|i| (0..n).map(move |j| (i, j)))
            .map(|(i, j)| (self.own[i][j] - self.own[j][i]).abs())
            .fold(0.0, f64::max)
    }
}

/// Variance of a bias over its usual one from which it comes from the floor.
const MUCH_MORE: f64 = 4.0;

/// `exp(−x)`, x ≥ 0: rational to 3e-6 below 0.1, which is what the steps of a flight are.
#[inline]
fn decay(x: f64) -> f64 {
    if x < 0.1 {
        (1.0 - 0.5 * x + x * x / 12.0) / (1.0 + 0.5 * x + x * x / 12.0)
    } else {
        (-x).exp()
    }
}

#[inline]
fn dot9(row: &[f64; STATES], h: &StateVec) -> f64 {
    row.iter().zip(h.iter()).map(|(r, h)| r * h).sum()
}
