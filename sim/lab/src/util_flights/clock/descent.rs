//! Clock and frames together by Gauss and Newton, from an offset at which the speeds agree.

use nalgebra::{Matrix6, Rotation3, Vector3, Vector6};

use haltere_log::import::truth::TruePose;

use super::speeds::{Overlaid, position_and_velocity};
use super::{Clock, Flown, Frames, LEAST_MOVING_S, STEP_S};

/// How far the fit may lead from where it began, s.
const REACH_S: f64 = 1.0;
/// One sigma of the drift of a clock before anything is known: a crystal has 0.0001, a computer that is being set 0.0005.
const STD_DRIFT: f64 = 1e-3;
/// Errors of the estimate stay for so long, s, that only one value of each such time counts (what is measured on recordings:
/// 20 to 150 independent errors in flights of one to three minutes).
const STAYS_S: f64 = 2.0;
/// Estimates that are fitted lie so far apart, s.
const FIT_STEP_S: f64 = 0.1;
/// From this height on it is in the air, m, as in the figures of the page.
const ALOFT_M: f64 = 0.5;
/// Rounds of Gauss and Newton.
const ROUNDS: usize = 15;

/// Clock and frames that fit best near an offset.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    pub(super) clock: Clock,
    pub(super) rms_m: f64,
    pub(super) points: usize,
    pub(super) gain: f64,
    pub(super) correlation: f64,
}

pub(super) fn fit(flown: &[Flown], truth: &[TruePose], begin: &Overlaid) -> Option<Fit> {
    let found = descend(flown, truth, begin)?;
    let points = found.points;
    let clock = Clock {
        offset_s: found.params[0],
        std_offset_s: found.stds[0],
        drift_ppm: found.params[1] * 1e6,
        std_drift_ppm: found.stds[1] * 1e6,
        middle_s: found.middle_s,
        correlation: begin.correlation,
    };
    let gain = points as f64 * (found.spread_m / found.rms_m.max(1e-6)).ln();
    Some(Fit { clock, rms_m: found.rms_m, points, gain, correlation: begin.correlation })
}

struct Descended {
    /// Offset, s; drift; yaw, rad; shift, m.
    params: [f64; 6],
    stds: [f64; 6],
    middle_s: f64,
    rms_m: f64,
    spread_m: f64,
    points: usize,
}

/// Gauss and Newton on a b ψ c from an offset.
fn descend(flown: &[Flown], truth: &[TruePose], begin: &Overlaid) -> Option<Descended> {
    let inside = |f: &&Flown| {
        let t_s = f.at_s - begin.offset_s;
        truth.first().is_some_and(|p| p.t_s <= t_s) && truth.last().is_some_and(|p| t_s <= p.t_s)
    };
    let mut next_s = f64::NEG_INFINITY;
    let mut used: Vec<&Flown> = flown.iter().filter(inside).collect();
    let height_m = |f: &&Flown| {
        let (p, _) = position_and_velocity(truth, f.at_s - begin.offset_s, STEP_S)?;
        Some(truth.first()?.pos_E_m.z() - p.z)
    };
    used = aloft(used, height_m);
    used.retain(|f| {
        let due = f.at_s >= next_s;
        if due {
            next_s = f.at_s + FIT_STEP_S;
        }
        due
    });
    let middle_s = 0.5 * (used.first()?.at_s + used.last()?.at_s);
    let mut x = Vector6::new(begin.offset_s, 0.0, 0.0, 0.0, 0.0, 0.0);
    let mut last = None;
    for round in 0..ROUNDS {
        let seen: Vec<(&Flown, Vector3<f64>, Vector3<f64>)> = used
            .iter()
            .filter_map(|f| {
                let t_s = f.at_s - x[0] - x[1] * (f.at_s - middle_s);
                let (p, v) = position_and_velocity(truth, t_s, STEP_S)?;
                Some((*f, p, v))
            })
            .collect();
        if (seen.len() as f64) * FIT_STEP_S < LEAST_MOVING_S {
            return None;
        }
        if round == 0 {
            let frames = Frames::between(seen.iter().map(|(f, p, _)| (f.pos_E_m, *p)))?;
            (x[2], x[3], x[4], x[5]) = (
                frames.yaw_rad.unwrap_or(0.0),
                frames.shift_E_m[0],
                frames.shift_E_m[1],
                frames.shift_E_m[2],
            );
        }
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), x[2]);
        let shift = Vector3::new(x[3], x[4], x[5]);
        let residuals: Vec<Vector3<f64>> =
            seen.iter().map(|(f, p, _)| f.pos_E_m - turn * p - shift).collect();
        let mut sizes: Vec<f64> = residuals.iter().map(Vector3::norm).collect();
        let middle = sizes.len() / 2;
        let (_, typical_m, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
        let huber_m = (3.0 * *typical_m).max(1e-3);
        let (mut A, mut g, mut square, mut weights) =
            (Matrix6::zeros(), Vector6::zeros(), 0.0, 0.0);
        for ((f, p, v), r) in seen.iter().zip(&residuals) {
            let w = (huber_m / r.norm()).min(1.0);
            let (rv, rp) = (turn * v, turn * p);
            // ∂r/∂x, its columns for a, b, ψ and c.
            let columns = [
                rv,
                rv * (f.at_s - middle_s),
                Vector3::new(rp.y, -rp.x, 0.0),
                -Vector3::x(),
                -Vector3::y(),
                -Vector3::z(),
            ];
            for i in 0..6 {
                g[i] += w * columns[i].dot(r);
                for k in 0..6 {
                    A[(i, k)] += w * columns[i].dot(&columns[k]);
                }
            }
            square += w * r.norm_squared();
            weights += w;
        }
        // One axis; of errors that stay, one in each STAYS_S counts.
        let var = (square / (3.0 * weights)).max(1e-10) * (STAYS_S / FIT_STEP_S).max(1.0);
        A /= var;
        g /= var;
        A[(1, 1)] += STD_DRIFT.powi(-2);
        g[1] += STD_DRIFT.powi(-2) * x[1];
        // A vehicle that only climbs shows no turn.
        A[(2, 2)] += 1.0;
        let inverse = A.try_inverse()?;
        let step = inverse * g;
        x -= step;
        if !x.iter().all(|v| v.is_finite()) || (x[0] - begin.offset_s).abs() > REACH_S {
            return None;
        }
        let stds = std::array::from_fn(|i| inverse[(i, i)].max(0.0).sqrt());
        let mean = seen.iter().map(|(_, p, _)| *p).sum::<Vector3<f64>>() / seen.len() as f64;
        let spread = seen.iter().map(|(_, p, _)| (p - mean).norm_squared()).sum::<f64>();
        last = Some(Descended {
            params: x.into(),
            stds,
            middle_s,
            rms_m: (square / weights).sqrt(),
            spread_m: (spread / seen.len() as f64).sqrt(),
            points: seen.len(),
        });
        if step[0].abs() < 1e-6 && step[1].abs() < 1e-8 {
            break;
        }
    }
    last
}

/// Those in the air, by their height above where the truth begins, m: on the floor echoes bend an estimate. All of them where
/// few are.
pub fn aloft<T: Clone>(all: Vec<T>, height_m: impl Fn(&T) -> Option<f64>) -> Vec<T> {
    let high = |one: &&T| height_m(one).is_some_and(|height_m| height_m > ALOFT_M);
    let found: Vec<T> = all.iter().filter(high).cloned().collect();
    if found.len() >= all.len() / 10 { found } else { all }
}
