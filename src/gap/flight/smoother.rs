//! Smoother: where the vehicle was, by kinematics alone. No thrust, no drag, no model under test.
//!
//! ```text
//! p' = v      v' = Rz(β) R_board (f - b) + g      b' = w_b      β' = w_β
//! ```
//! `p`, `v` Earth (m, m/s); `f` specific force averaged over whole beats, body (m/s²); `b` its bias,
//! body, which also takes the lean of the board's attitude (m/s²); `β` angle from room north to the
//! board's north (rad). TDOA enter with Huber weights, gathered per step: they see the position
//! alone, so a step's measurements are one 3-vector. Near the floor the paths of low anchors are bent
//! (effect N17) and count little; air pressure then holds the height, less what it has wandered by since the rest
//! before the flight, as the TDOA above tell. Forward filter, then Rauch-Tung-Striebel (AIAA Journal 3, 1965) for the states alone:
//! `x_k = x⁺_k + C_k (x_k+1 - x⁻_k+1)`, `C_k = P⁺_k Fᵀ (P⁻_k+1)⁻¹`; nobody reads the smoothed covariance.
//! Units of noise below; valid for whatever the IMU can follow.

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use crate::flight::timeline::{STEP_S, Timeline};
use crate::flight::trace::Trace;
use haltere_core::frames::G_MPS2;
use haltere_core::topics::UwbRecord;

/// Number of states: p, v, b, β.
const N: usize = 10;
type Mat = SMatrix<f64, N, N>;
type Vec10 = SVector<f64, N>;
/// What b and β do to p and v in a step; the rest of a transition is the identity, and v that moves p for the step. Whole, those
/// of a flight were a third of what an observation asks of memory.
type Transition = SMatrix<f64, 6, 4>;

/// White noise of the averaged specific force, m/s²/√Hz: rest of the beat, errors of attitude.
const ACC_NOISE: f64 = 0.10;
/// Walk of the bias, m/s²/√s: the board's lean wanders by 0.4° in 15 s (effect N12).
const BIAS_WALK: f64 = 0.025;
/// Walk of the north, rad/√s.
const NORTH_WALK: f64 = 0.002;
/// One sigma of a TDOA, m: white and local part (effects N15, N16).
const STD_TDOA_M: f64 = 0.11;
/// Huber's limit in sigmas.
const HUBER: f64 = 2.0;
/// Anchors below this, and an antenna below that, m: such paths count by this factor.
const LOW_ANCHOR_M: f64 = 1.0;
pub(super) const LOW_TAG_M: f64 = 0.65;
const LOW_WEIGHT: f64 = 0.01;
/// One sigma of the height by air pressure over one step, m: white part 0.15 m, and its wander.
const STD_BARO_M: f64 = 0.4;
/// Time T in which its wander is followed where TDOA tell the height, s: `w' = (z_air - w - z)/T`, Earth z, m. Long beside its noise,
/// short beside weather and doors, which move it by half a metre in a minute (judgement).
const AIR_S: f64 = 5.0;
/// Points of the grid that the air pressure is averaged over, to either side: 0.5 s in all.
const BARO_HALF_WINDOW: usize = 6;
/// Pascal per metre of air at the ground, and samples at rest that are needed.
const PA_PER_M: f64 = 12.0;
const BARO_AT_REST: usize = 20;
/// One sigma at the start: m, m/s, m/s², rad.
const STD_START: [f64; 4] = [0.3, 0.05, 0.4, 0.25];

/// State at one point of the grid.
#[derive(Debug, Clone, Copy, Default)]
pub struct Smoothed {
    /// Position, Earth, m.
    pub pos_E_m: Vector3<f64>,
    /// Velocity, Earth, m/s.
    pub vel_E_mps: Vector3<f64>,
    /// Bias of the specific force, body, m/s².
    pub bias_B_mps2: Vector3<f64>,
    /// Angle from room north to the board's north, rad.
    pub north_rad: f64,
}

/// One TDOA on the grid.
#[derive(Debug, Clone, Copy, Default)]
pub struct GridTdoa {
    /// Point of the grid at or before it, and share of the step.
    pub k: usize,
    /// Share of the step after that point.
    pub share: f64,
    /// Index of the subtracted and the added anchor in the survey's ids.
    pub a: usize,
    /// Added.
    pub b: usize,
    /// Measured, m.
    pub z_m: f64,
}

/// TDOA of known anchors on the grid, point by point; within one in the order in which they came.
pub fn grid_tdoa(trace: &Trace, line: &Timeline) -> Vec<GridTdoa> {
    let ids = trace.survey.ids();
    let mut index = [usize::MAX; 256];
    for (i, id) in ids.iter().enumerate() {
        index[usize::from(id.0)] = i;
    }
    let known = |r: &UwbRecord| {
        let (k, share) = line.place(r.tdoa.valid_at)?;
        let a = index[usize::from(r.tdoa.anchor_a.0)];
        let b = index[usize::from(r.tdoa.anchor_b.0)];
        let known = a < ids.len() && b < ids.len() && r.tdoa.distance_diff_m.is_finite();
        known.then_some(GridTdoa { k, share, a, b, z_m: r.tdoa.distance_diff_m })
    };
    // They come nearly in order: counted per point and put in place, twice through a list that is long.
    let mut next = vec![0; line.len() + 1];
    for m in trace.uwb.iter().filter_map(known) {
        next[m.k + 1] += 1;
    }
    for k in 1..next.len() {
        next[k] += next[k - 1];
    }
    let mut all = vec![GridTdoa::default(); next[line.len()]];
    for m in trace.uwb.iter().filter_map(known) {
        all[next[m.k]] = m;
        next[m.k] += 1;
    }
    all
}

/// What a smoothing did, step by step: enough to send another measurement through it.
#[derive(Debug, Default)]
pub struct Gains {
    /// Transition to the next point.
    step: Vec<Transition>,
    /// Gain of the step's position, and the inverse of its information.
    gain: Vec<Option<(SMatrix<f64, N, 3>, Matrix3<f64>)>>,
    /// Backward gain.
    back: Vec<Mat>,
    /// Weight of each TDOA, 1/m².
    weight: Vec<f64>,
}

impl Gains {
    /// By how much the smoothed position would move at each point if every TDOA changed, for `M` changes at
    /// once; a column of `right` is the sum of weight times gradient times change over a step's measurements.
    pub fn respond<const M: usize>(&self, right: &[SMatrix<f64, 3, M>]) -> Vec<SMatrix<f64, 3, M>> {
        let n = right.len().min(self.gain.len());
        let mut post = Vec::with_capacity(n);
        let mut x = SMatrix::<f64, N, M>::zeros();
        for (k, right) in right.iter().take(n).enumerate() {
            if k > 0 {
                x = apply(&self.step[k - 1], &x);
            }
            if let Some((gain, inverse)) = &self.gain[k] {
                x += gain * (inverse * right - x.fixed_rows::<3>(0));
            }
            post.push(x);
        }
        let mut out = vec![SMatrix::zeros(); n];
        for k in (0..n).rev() {
            if k + 1 < n {
                x = post[k] + self.back[k] * (x - apply(&self.step[k], &post[k]));
            }
            out[k] = x.fixed_rows::<3>(0).into_owned();
        }
        out
    }

    /// Weight of each TDOA of the list, 1/m².
    pub fn weights(&self) -> &[f64] {
        &self.weight
    }
}

/// Smooths a flight that began at rest with its centre of mass at `rest_z_m`.
pub fn smooth(
    trace: &Trace,
    line: &Timeline,
    tdoa: &[GridTdoa],
    sites_E_m: &[Vector3<f64>],
    rest_z_m: f64,
) -> (Vec<Smoothed>, Gains) {
    let n = line.len();
    let mut x = Vec10::zeros();
    x.fixed_rows_mut::<3>(0).copy_from(&line.pos_E_m[0]);
    x[9] = line.north_rad.iter().sum::<f64>() / n as f64;
    let std = |i: usize| STD_START[i / 3];
    let mut P = Mat::from_diagonal(&Vec10::from_fn(|i, _| std(i).powi(2)));
    let mut prior = Vec::with_capacity(n);
    let mut post = Vec::with_capacity(n);
    let mut gains = Gains {
        step: Vec::with_capacity(n),
        gain: Vec::with_capacity(n),
        back: Vec::with_capacity(n),
        weight: vec![0.0; tdoa.len()],
    };
    let by_air_z_m = heights_by_air(trace, line, rest_z_m);
    let (mut m, mut wander_m) = (0, 0.0);
    for (k, by_air_z_m) in by_air_z_m.iter().enumerate() {
        if k > 0 {
            let P_post = P;
            let F = predict(&mut x, &mut P, line, k - 1);
            // C; where the prior is not positive, the later state says nothing about this one.
            let back = right_divide(apply(&F, &P_post).transpose(), &P);
            gains.back.push(back.unwrap_or_else(Mat::zeros));
            gains.step.push(F);
        }
        prior.push(x);
        let first = m;
        while m < tdoa.len() && tdoa[m].k <= k {
            m += 1;
        }
        let weights = &mut gains.weight[first..m];
        let by_air_z_m = by_air_z_m.map(|z_m| z_m - wander_m);
        let found = gather(&mut x, &mut P, &tdoa[first..m], sites_E_m, by_air_z_m, weights);
        if let Some(z_m) = by_air_z_m.filter(|_| -x[2] >= LOW_TAG_M) {
            wander_m += (z_m - x[2]) * STEP_S / AIR_S;
        }
        gains.gain.push(found);
        post.push(x);
    }
    let states = backward(&prior, &post, &gains);
    (states, gains)
}

/// Height by air pressure at each point of the grid, Earth z, m.
fn heights_by_air(trace: &Trace, line: &Timeline, rest_z_m: f64) -> Vec<Option<f64>> {
    let mut out = vec![None; line.len()];
    let rest: Vec<f64> =
        trace.baros.iter().filter(|s| s.valid_at < line.start).map(|s| s.pressure_pa).collect();
    if rest.len() < BARO_AT_REST {
        return out;
    }
    let rest_pa = rest.iter().sum::<f64>() / rest.len() as f64;
    let mut sums = vec![[0.0; 2]; line.len()];
    for s in &trace.baros {
        if let Some((k, _)) = line.place(s.valid_at) {
            sums[k][0] += rest_z_m + (s.pressure_pa - rest_pa) / PA_PER_M;
            sums[k][1] += 1.0;
        }
    }
    for (k, out) in out.iter_mut().enumerate() {
        let near = k.saturating_sub(BARO_HALF_WINDOW)..(k + BARO_HALF_WINDOW + 1).min(sums.len());
        let [sum, count] = sums[near].iter().fold([0.0; 2], |a, s| [a[0] + s[0], a[1] + s[1]]);
        *out = (count > 0.0).then(|| sum / count);
    }
    out
}

/// One step of the state and its covariance; returns the transition.
fn predict(x: &mut Vec10, P: &mut Mat, line: &Timeline, k: usize) -> Transition {
    let dt = STEP_S;
    let p = x.fixed_rows::<3>(0).into_owned();
    let v = x.fixed_rows::<3>(3).into_owned();
    let b = x.fixed_rows::<3>(6).into_owned();
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), x[9]);
    // The middle of the step: the mean of both ends, whose noise the window has made smooth.
    let f = 0.5 * (line.acc_B_mps2[k] + line.acc_B_mps2[k + 1]) - b;
    let mid = line.board[k].nlerp(&line.board[k + 1], 0.5);
    let R = (turn * mid).to_rotation_matrix();
    let push = R * f;
    let a = push + Vector3::new(0.0, 0.0, G_MPS2);
    x.fixed_rows_mut::<3>(0).copy_from(&(p + v * dt + a * (0.5 * dt * dt)));
    x.fixed_rows_mut::<3>(3).copy_from(&(v + a * dt));
    let mut F = Transition::zeros();
    let by_north = Vector3::new(-push.y, push.x, 0.0);
    for i in 0..3 {
        for j in 0..3 {
            F[(i, j)] = -0.5 * dt * dt * R[(i, j)];
            F[(3 + i, j)] = -dt * R[(i, j)];
        }
        F[(i, 3)] = 0.5 * dt * dt * by_north[i];
        F[(3 + i, 3)] = dt * by_north[i];
    }
    // F (F P)ᵀ = F P Fᵀ, for P is symmetric.
    let mut Q = apply(&F, &apply(&F, P).transpose());
    for i in 0..3 {
        Q[(i, i)] += 1e-10;
        Q[(3 + i, 3 + i)] += ACC_NOISE.powi(2) * dt;
        Q[(6 + i, 6 + i)] += BIAS_WALK.powi(2) * dt;
    }
    Q[(9, 9)] += NORTH_WALK.powi(2) * dt;
    *P = 0.5 * (Q + Q.transpose());
    F
}

/// `F M`.
fn apply<const C: usize>(F: &Transition, M: &SMatrix<f64, N, C>) -> SMatrix<f64, N, C> {
    let mut out = *M;
    for c in 0..C {
        for i in 0..3 {
            let (mut p, mut v) = (STEP_S * M[(3 + i, c)], 0.0);
            for j in 0..4 {
                p += F[(i, j)] * M[(6 + j, c)];
                v += F[(3 + i, j)] * M[(6 + j, c)];
            }
            out[(i, c)] += p;
            out[(3 + i, c)] += v;
        }
    }
    out
}

/// `M P⁻¹` by Cholesky's factor of P, symmetric; `None` where P is not positive. Column by column of M, all rows at once: a
/// general solver took a tenth of the time of an observation.
fn right_divide(mut M: Mat, P: &Mat) -> Option<Mat> {
    let mut L = [[0.0; N]; N];
    let mut inverse = [0.0; N];
    for i in 0..N {
        for j in 0..=i {
            let known = L[i].iter().zip(&L[j]).take(j);
            let sum = known.fold(P[(i, j)], |sum, (a, b)| sum - a * b);
            if i > j {
                L[i][j] = sum * inverse[j];
            } else if sum > 0.0 {
                L[i][i] = sum.sqrt();
                inverse[i] = 1.0 / L[i][i];
            } else {
                return None;
            }
        }
    }
    // Y Lᵀ = M, then X L = Y.
    let columns = &mut M.data.0;
    let forward = (0..N).map(|i| (i, 0..i));
    let back = (0..N).rev().map(|i| (i, i + 1..N));
    for (i, others) in forward.chain(back) {
        let mut column = columns[i];
        for k in others {
            let share = L[i.max(k)][i.min(k)];
            for (value, of) in column.iter_mut().zip(&columns[k]) {
                *value -= share * of;
            }
        }
        columns[i] = column.map(|value| value * inverse[i]);
    }
    Some(M)
}

/// All TDOA of one step, and the height by air pressure (Earth z, m), as one information matrix on the position.
fn gather(
    x: &mut Vec10,
    P: &mut Mat,
    tdoa: &[GridTdoa],
    sites_E_m: &[Vector3<f64>],
    by_air_z_m: Option<f64>,
    weights: &mut [f64],
) -> Option<(SMatrix<f64, N, 3>, Matrix3<f64>)> {
    let p0 = x.fixed_rows::<3>(0).into_owned();
    let v0 = x.fixed_rows::<3>(3).into_owned();
    let P_pos = P.fixed_view::<3, 3>(0, 0).into_owned();
    let mut info = Matrix3::zeros();
    let mut right = Vector3::zeros();
    if let Some(z_m) = by_air_z_m {
        info[(2, 2)] += STD_BARO_M.powi(-2);
        right.z += (z_m - p0.z) * STD_BARO_M.powi(-2);
    }
    let is_low = |n: usize| -sites_E_m[n].z < LOW_ANCHOR_M;
    let near_floor = -p0.z < LOW_TAG_M;
    for (m, weight) in tdoa.iter().zip(weights) {
        let p = p0 + v0 * (m.share * STEP_S);
        let (h, predicted) = model(&p, &sites_E_m[m.a], &sites_E_m[m.b]);
        let r = m.z_m - predicted;
        let var = STD_TDOA_M.powi(2);
        let sigma = (var + h.dot(&(P_pos * h))).sqrt();
        let mut w = (HUBER * sigma / r.abs().max(1e-9)).min(1.0) / var;
        if near_floor && (is_low(m.a) || is_low(m.b)) {
            w *= LOW_WEIGHT;
        }
        *weight = w;
        info += h * h.transpose() * w;
        right += h * (w * r);
    }
    // The position that these measurements alone would shift to, with a little to be invertible.
    let info = info + Matrix3::identity() * 1e-6;
    let inverse = info.try_inverse()?;
    let gain = update(x, P, info, p0 + inverse * right)?;
    Some((gain, inverse))
}

/// Gradient on the position and value of `|p - b| - |p - a|`.
#[inline]
pub fn model(p: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> (Vector3<f64>, f64) {
    let (da, db) = (p - a, p - b);
    let (na, nb) = (da.norm().max(0.05), db.norm().max(0.05));
    (db / nb - da / na, nb - na)
}

/// A position with this information.
fn update(
    x: &mut Vec10,
    P: &mut Mat,
    info: Matrix3<f64>,
    pos_E_m: Vector3<f64>,
) -> Option<SMatrix<f64, N, 3>> {
    let R = info.try_inverse()?;
    let S = P.fixed_view::<3, 3>(0, 0) + R;
    let S_inverse = S.try_inverse()?;
    let PH = P.fixed_columns::<3>(0).into_owned();
    let K = PH * S_inverse;
    let r = pos_E_m - x.fixed_rows::<3>(0);
    *x += K * r;
    *P -= K * PH.transpose();
    *P = 0.5 * (*P + P.transpose());
    Some(K)
}

fn backward(prior: &[Vec10], post: &[Vec10], gains: &Gains) -> Vec<Smoothed> {
    let n = post.len();
    let mut out = vec![Smoothed::default(); n];
    let mut x = Vec10::zeros();
    for k in (0..n).rev() {
        x = match (gains.back.get(k), prior.get(k + 1)) {
            (Some(C), Some(x_prior)) => post[k] + C * (x - x_prior),
            _ => post[k],
        };
        out[k] = Smoothed {
            pos_E_m: x.fixed_rows::<3>(0).into_owned(),
            vel_E_mps: x.fixed_rows::<3>(3).into_owned(),
            bias_B_mps2: x.fixed_rows::<3>(6).into_owned(),
            north_rad: x[9],
        };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_right_division_is_that_of_a_general_solver_and_needs_a_positive_matrix() {
        let half =
            Mat::from_fn(|i, j| ((3 * i + 7 * j) as f64).sin() + if i == j { 2.0 } else { 0.0 });
        let P = half * half.transpose();
        let M = Mat::from_fn(|i, j| ((5 * i + 2 * j) as f64).cos());
        let X = right_divide(M, &P).unwrap();
        assert!((X * P - M).abs().max() < 1e-10, "{}", X * P - M);
        let general = P.cholesky().unwrap().solve(&M.transpose()).transpose();
        assert!((X - general).abs().max() < 1e-10);
        assert!(right_divide(M, &-P).is_none());
        let mut unknown = P;
        unknown[(4, 4)] = f64::NAN;
        assert!(right_divide(M, &unknown).is_none());
    }
}
