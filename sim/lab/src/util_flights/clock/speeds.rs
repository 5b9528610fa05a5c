//! Speeds of estimate and truth laid over one another at every offset, and places of both beside one another at one.

use nalgebra::Vector3;

use haltere_log::import::truth::TruePose;

use super::{Flown, GAP_S, LEAST_MOVING_S, LONGEST_S, MOVES_MPS, NoClock, STEP_S};

/// Speeds in steps of [`STEP_S`]; nothing where nothing is known.
pub(super) struct Speeds {
    first_s: f64,
    mps: Vec<Option<f64>>,
}

impl Speeds {
    fn empty(what: &'static str, first_s: f64, last_s: f64) -> Result<Self, NoClock> {
        let found_s = last_s - first_s;
        if !(LEAST_MOVING_S..=LONGEST_S).contains(&found_s) {
            return Err(NoClock::Length { what, found_s });
        }
        Ok(Self { first_s, mps: vec![None; (found_s / STEP_S) as usize] })
    }

    pub(super) fn of_flown(flown: &[Flown]) -> Result<Self, NoClock> {
        let first_s = flown.first().map_or(0.0, |f| f.at_s);
        let mut speeds =
            Self::empty("the estimate", first_s, flown.last().map_or(0.0, |f| f.at_s))?;
        let mut sums = vec![(0.0, 0.0); speeds.mps.len()];
        for f in flown {
            if let Some((sum, n)) = sums.get_mut(((f.at_s - first_s) / STEP_S) as usize) {
                *sum += f.speed_mps;
                *n += 1.0;
            }
        }
        speeds.mps = sums.into_iter().map(|(sum, n)| (n > 0.0).then(|| sum / n)).collect();
        Ok(speeds)
    }

    pub(super) fn of_truth(truth: &[TruePose]) -> Result<Self, NoClock> {
        let first_s = truth.first().map_or(0.0, |p| p.t_s);
        let mut speeds = Self::empty("the truth", first_s, truth.last().map_or(0.0, |p| p.t_s))?;
        for (k, mps) in speeds.mps.iter_mut().enumerate() {
            *mps = position_and_velocity(truth, first_s + (k as f64 + 0.5) * STEP_S, STEP_S)
                .map(|(_, velocity)| velocity.norm());
        }
        Ok(speeds)
    }
}

/// Position and velocity over `span_s` about a time; nothing in a gap.
pub(super) fn position_and_velocity(
    truth: &[TruePose],
    t_s: f64,
    span_s: f64,
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let at = |t_s: f64| {
        let after = truth.partition_point(|p| p.t_s < t_s);
        let (b, a) = (truth.get(after)?, truth.get(after.checked_sub(1)?)?);
        let apart_s = b.t_s - a.t_s;
        let part = (t_s - a.t_s) / apart_s;
        let [p, q] = [a, b].map(|pose| pose.pos_E_m.raw());
        (apart_s <= GAP_S).then(|| p + (q - p) * part)
    };
    let [before, after] = [at(t_s - 0.5 * span_s)?, at(t_s + 0.5 * span_s)?];
    Some((at(t_s)?, (after - before) / span_s))
}

/// Speeds laid over one another at an offset.
#[derive(Debug, Clone, Copy)]
pub(super) struct Overlaid {
    pub(super) offset_s: f64,
    pub(super) correlation: f64,
    pub(super) gain: f64,
}

/// At every offset at which the vehicle moves long enough in both.
pub(super) fn overlaid(estimated: &Speeds, truth: &Speeds) -> Result<Vec<Overlaid>, NoClock> {
    let (n, m) = (estimated.mps.len() as isize, truth.mps.len() as isize);
    let mut found = Vec::new();
    let mut most_moving = 0usize;
    for lag in 1 - m..n {
        let (mut count, mut moving) = (0.0, 0usize);
        let [mut x, mut y, mut xx, mut yy, mut xy] = [0.0; 5];
        let (from, to) = (lag.max(0) as usize, (m + lag).min(n) as usize);
        let beside = &truth.mps[(from as isize - lag) as usize..];
        for (a, b) in estimated.mps[from..to].iter().zip(beside) {
            let (Some(a), Some(b)) = (a, b) else { continue };
            count += 1.0;
            moving += usize::from(*a > MOVES_MPS && *b > MOVES_MPS);
            x += a;
            y += b;
            xx += a * a;
            yy += b * b;
            xy += a * b;
        }
        most_moving = most_moving.max(moving);
        let var = (count * xx - x * x) * (count * yy - y * y);
        if moving as f64 * STEP_S < LEAST_MOVING_S || var <= 0.0 {
            continue;
        }
        let correlation = (count * xy - x * y) / var.sqrt();
        let gain = -count * (1.0 - correlation.max(0.0).powi(2)).max(1e-9).ln();
        let offset_s = lag as f64 * STEP_S + estimated.first_s - truth.first_s;
        found.push(Overlaid { offset_s, correlation, gain });
    }
    if found.is_empty() {
        return Err(NoClock::TooStill { found_s: most_moving as f64 * STEP_S });
    }
    Ok(found)
}

/// Places of the estimate beside those of the truth at an offset.
pub(super) fn beside<'a>(
    flown: &'a [Flown],
    truth: &'a [TruePose],
    offset_s: f64,
) -> impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> + Clone + 'a {
    flown.iter().filter_map(move |f| {
        let (p, _) = position_and_velocity(truth, f.at_s - offset_s, STEP_S)?;
        Some((f.pos_E_m, p))
    })
}
