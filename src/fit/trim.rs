//! `haltere fit trim`: the trimming procedure of the source on a flight log.
//!
//! Finds the longest stretch of the log in which one point was held, leaves out the settling, and
//! hands the control steps of it to [`trims_from_hover`].

use crate::report::flight::Flight;
use haltere_core::control::drag::DragConfig;
use haltere_core::control::trim::{HoverSample, TrimRefusal, Trims, trims_from_hover};
use haltere_core::estimate::Estimate;
use haltere_core::frames::{B, E, Rot};
use haltere_core::topics::ControlRecord;

/// Time after the setpoint came to rest that is left out, s: two time constants of the velocity
/// integrators.
const SETTLE_S: f64 = 4.0;
/// A setpoint that moves less than this from step to step rests, m.
const REST_M: f64 = 1e-6;
/// Control steps farther apart than this are two stretches, s.
const GAP_S: f64 = 0.2;

/// Why a log gives no trims.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrimError {
    /// Nothing was held.
    #[error(
        "no stretch in which one point was held for more than {SETTLE_S} s: fly a hover of 30 s"
    )]
    NoHover,
    /// The procedure refuses the hover.
    #[error(transparent)]
    Refused(#[from] TrimRefusal),
}

/// Trims from the longest hover of a flight.
pub fn fit(flight: &Flight, drag: &DragConfig) -> Result<Trims, TrimError> {
    let steps = longest_hover(&flight.controls);
    let (Some(first), Some(last)) = (steps.first(), steps.last()) else {
        return Err(TrimError::NoHover);
    };
    if last.at.seconds_since(first.at) < SETTLE_S {
        return Err(TrimError::NoHover);
    }
    let mut estimates = flight.estimates.iter().peekable();
    let mut samples = Vec::with_capacity(steps.len());
    for step in steps.iter().filter(|s| s.at.seconds_since(first.at) >= SETTLE_S) {
        while estimates.next_if(|e| e.at < step.at).is_some() {}
        if let Some(estimate) = estimates.peek() {
            samples.push(sample(step, estimate));
        }
    }
    Ok(trims_from_hover(&samples, drag)?)
}

fn sample(step: &ControlRecord, estimate: &Estimate) -> HoverSample {
    let yaw_estimate_rad = estimate.R_EB.yaw_rad();
    let heading = Rot::<E, B>::from_euler_rad(0.0, 0.0, yaw_estimate_rad);
    let s = step.saturation;
    HoverSample {
        at: step.at,
        roll_rad: step.roll_rad,
        pitch_rad: step.pitch_rad,
        yaw_rad: step.yaw_rad,
        yaw_estimate_rad,
        vel_heading_mps: (heading.inverse() * estimate.vel_E_mps()).to_array(),
        saturated: s.tilt || s.thrust_high || s.thrust_low,
    }
}

/// The longest run of control steps with one commanded position.
fn longest_hover(controls: &[ControlRecord]) -> &[ControlRecord] {
    let mut best = 0..0;
    let mut start = 0;
    for i in 0..controls.len() {
        let goes_on = i > start && {
            let (before, now) = (&controls[i - 1], &controls[i]);
            let rests = before
                .pos_setpoint_E_m
                .iter()
                .zip(now.pos_setpoint_E_m)
                .all(|(a, b)| matches!((a, b), (Some(a), Some(b)) if (a - b).abs() < REST_M));
            rests && (0.0..GAP_S).contains(&now.at.seconds_since(before.at))
        };
        if !goes_on {
            start = i;
        }
        if i + 1 - start > best.len() {
            best = start..i + 1;
        }
    }
    &controls[best]
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::time::HostTime;

    fn step(i: u64, north_m: f64) -> ControlRecord {
        ControlRecord {
            at: HostTime::from_us(i * 10_000),
            pos_setpoint_E_m: [Some(north_m), Some(0.0), Some(-1.0)],
            ..Default::default()
        }
    }

    #[test]
    fn prop_the_longest_rest_is_found() {
        let mut controls: Vec<_> = (0..100).map(|i| step(i, 0.0)).collect();
        controls.extend((100..400).map(|i| step(i, 0.01 * (i - 100) as f64)));
        controls.extend((400..900).map(|i| step(i, 3.0)));
        let hover = longest_hover(&controls);
        assert_eq!(hover.len(), 500);
        assert_eq!(hover[0].at, HostTime::from_us(400 * 10_000));
        assert!(longest_hover(&[]).is_empty());
    }

    #[test]
    fn prop_a_log_without_hover_says_so() {
        let flight = Flight {
            controls: (0..300).map(|i| step(i, i as f64)).collect(),
            ..Default::default()
        };
        assert_eq!(fit(&flight, &DragConfig::default()), Err(TrimError::NoHover));
    }
}
