//! A flight beside its truth, where there is one: how far the estimate lay from where the vehicle was, and in which regime.
//!
//! Truth is motion capture that the companion recorded, or the file that the simulated endpoint writes. It is not
//! needed: where a gap lies and which effect causes it is found without it, by the same statistics for every flight. What it adds is the
//! figure that a smoother on the same radio cannot give: an error that all anchors share moves both.
//!
//! `e = x̂ + R̂ v̂ (t - t̂) - x`: `x` true position at `t`, `x̂` the nearest estimate, of `t̂`, both `E` m; `v̂` its velocity, `B` m/s;
//! `R̂` its attitude, from `B` to `E`. Truth is that of a marker or of the centre of mass: the arm between the two is left out.

use serde::Serialize;

use crate::flight::smoother::LOW_TAG_M;
use crate::flight::trace::Trace;
use haltere_core::frames::{E, Vec3};
use haltere_core::time::HostTime;

/// Position of the vehicle at a time, Earth frame, m.
pub type TruePoint = (HostTime, Vec3<E>);

/// An estimate this far from a point of truth does not stand beside it, s: two periods of the filter, which is recorded at 100 Hz
/// (judgement).
const FARTHEST_S: f64 = 0.02;
/// Lower than this it may stand, m: half of a vehicle of 0.3 m, on which a marker sits somewhere (judgement).
const ON_FLOOR_M: f64 = 0.15;
/// From this speed on it is under way, m/s: more than half of that of the legs of the standard flights, 0.8 m/s (judgement).
const FAST_MPS: f64 = 0.5;

/// Where errors are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Regime {
    /// In the air.
    All,
    /// Where the floor hides low anchors.
    Low,
    /// Above that, and slow.
    Slow,
    /// Above that, and under way.
    Fast,
}

impl Regime {
    fn holds(self, height_m: f64, speed_mps: f64) -> bool {
        let (low, fast) = (height_m < LOW_TAG_M, speed_mps >= FAST_MPS);
        match self {
            Self::All => true,
            Self::Low => low,
            Self::Slow => !low && !fast,
            Self::Fast => !low && fast,
        }
    }
}

/// Error of the estimate in one regime.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RegimeError {
    /// Where.
    pub regime: Regime,
    /// Points of truth.
    pub points: usize,
    /// Root of the mean squared distance, m.
    pub rms_m: f64,
    /// Mean of estimate minus truth, north, east, down, m.
    pub mean_NED_m: [f64; 3],
    /// Largest distance, m.
    pub worst_m: f64,
}

/// The same in every regime that was flown.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BesideTruth {
    /// Where the truth comes from.
    pub source: String,
    /// Regimes; the whole flight first.
    pub errors: Vec<RegimeError>,
}

/// Why there is nothing to say.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "{place}: holds no truth of this flight ({points} points, {beside} of them beside an estimate in the air); record motion \
     capture with the flight, or name a truth file of it"
)]
pub struct NoTruth {
    /// Where it was looked for.
    pub place: String,
    /// Points found.
    pub points: usize,
    /// Points that could be compared.
    pub beside: usize,
}

/// Compares in the air: between arming and disarming, off the floor. `source`: for people.
pub fn beside_truth(
    trace: &Trace,
    truth: &[TruePoint],
    source: &str,
) -> Result<BesideTruth, NoTruth> {
    let armed = |at: HostTime| {
        let before = trace.modes.iter().take_while(|mode| mode.at <= at);
        before.last().is_some_and(|mode| mode.armed)
    };
    // North, east, down, height and speed of each point that can be compared.
    let mut off: Vec<([f64; 3], f64, f64)> = Vec::new();
    for (at, pos_E_m) in truth {
        let next = trace.estimates.partition_point(|e| e.at < *at);
        let near = [next.checked_sub(1), Some(next)].into_iter().flatten();
        let nearest = near
            .filter_map(|k| trace.estimates.get(k))
            .min_by(|a, b| a.at.seconds_since(*at).abs().total_cmp(&b.at.seconds_since(*at).abs()));
        let Some(estimate) = nearest else { continue };
        let late_s = estimate.at.seconds_since(*at);
        let height_m = -pos_E_m.z();
        if late_s.abs() > FARTHEST_S || !armed(*at) || height_m < ON_FLOOR_M {
            continue;
        }
        // Both at the time of the truth.
        let vel_E_mps = estimate.R_EB * estimate.vel_B_mps;
        let there_m = estimate.pos_E_m.raw() - vel_E_mps.raw() * late_s;
        let error = there_m - pos_E_m.raw();
        off.push((error.into(), height_m, vel_E_mps.raw().norm()));
    }
    let error = |regime: Regime| -> Option<RegimeError> {
        let kept: Vec<[f64; 3]> =
            off.iter().filter(|(_, h, v)| regime.holds(*h, *v)).map(|(e, ..)| *e).collect();
        let n = kept.len() as f64;
        let length = |e: &[f64; 3]| e.iter().map(|v| v * v).sum::<f64>().sqrt();
        (!kept.is_empty()).then(|| RegimeError {
            regime,
            points: kept.len(),
            rms_m: (kept.iter().map(|e| length(e).powi(2)).sum::<f64>() / n).sqrt(),
            mean_NED_m: std::array::from_fn(|k| kept.iter().map(|e| e[k]).sum::<f64>() / n),
            worst_m: kept.iter().map(length).fold(0.0, f64::max),
        })
    };
    let regimes = [Regime::All, Regime::Low, Regime::Slow, Regime::Fast];
    let errors: Vec<RegimeError> = regimes.into_iter().filter_map(error).collect();
    if errors.is_empty() {
        let (place, points) = (source.to_owned(), truth.len());
        return Err(NoTruth { place, points, beside: off.len() });
    }
    Ok(BesideTruth { source: source.to_owned(), errors })
}

impl BesideTruth {
    /// One line for each regime.
    pub fn words(&self) -> Vec<String> {
        let line = |e: &RegimeError| {
            let [north, east, down] = e.mean_NED_m.map(|v| 100.0 * v);
            let name = match e.regime {
                Regime::Low => format!("below {LOW_TAG_M} m"),
                Regime::Slow => format!("slower than {FAST_MPS} m/s"),
                Regime::Fast => format!("from {FAST_MPS} m/s on"),
                Regime::All => format!("beside {}", self.source),
            };
            format!(
                "{name}: estimate off by {:.1} cm rms, mean N {north:+.1} E {east:+.1} D {down:+.1}, worst {:.1} cm ({} points)",
                100.0 * e.rms_m,
                100.0 * e.worst_m,
                e.points
            )
        };
        self.errors.iter().map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::missions;
    use crate::scene::Scene;
    use haltere_model::lockstep::{Lockstep, fly_watched};

    /// The plant knows where it was: the same figure must come out of the trace.
    #[test]
    fn val_the_error_of_an_estimate_is_that_of_the_simulator() {
        let scene = Scene::lab().unwrap();
        let mut lockstep =
            Lockstep::new(scene.plant(3), scene.pilot.clone(), &scene.survey).unwrap();
        let mut trace = Trace::new(scene.survey.clone());
        let mut truth: Vec<TruePoint> = Vec::new();
        let (mut squares, mut count) = (0.0, 0.0);
        fly_watched(&mut lockstep, &missions::plain(&scene), 60.0, |lockstep| {
            let (at, now) = (lockstep.host_now(), lockstep.truth());
            truth.push((at, now.pos_E_m));
            lockstep.pilot_mut().drain_topics(|topic| trace.take(topic));
            let flying =
                trace.modes.last().is_some_and(|m| m.armed) && -now.pos_E_m.z() >= ON_FLOOR_M;
            if let Some(last) = trace.estimates.last().filter(|_| flying) {
                squares += (last.pos_E_m.raw() - now.pos_E_m.raw()).norm_squared();
                count += 1.0;
            }
        })
        .unwrap();
        let found = beside_truth(&trace, &truth, "the simulator").unwrap();
        let all = &found.errors[0];
        let want_m = f64::sqrt(squares / count);
        assert!((all.rms_m - want_m).abs() < 0.02 * want_m, "{} m, {want_m} m", all.rms_m);
        let parts: usize = found.errors[1..].iter().map(|e| e.points).sum();
        assert_eq!(parts, all.points);
        // A truth that is moved by 0.3 m to the east is an estimate that is off by as much to the west.
        let moved: Vec<TruePoint> =
            truth.iter().map(|(at, p)| (*at, Vec3::new(p.x(), p.y() + 0.3, p.z()))).collect();
        let other = beside_truth(&trace, &moved, "the simulator").unwrap();
        let west_m = other.errors[0].mean_NED_m[1] - all.mean_NED_m[1];
        assert!((west_m + 0.3).abs() < 1e-9, "{west_m}");
    }

    #[test]
    fn prop_no_truth_is_said_and_not_taken_for_none_wrong() {
        let trace = Trace::new(Scene::lab().unwrap().survey);
        let points = [(HostTime::from_us(5), Vec3::new(0.0, 0.0, -1.0))];
        let error = beside_truth(&trace, &points, "flight.mcap").unwrap_err().to_string();
        assert!(error.contains("flight.mcap") && error.contains("1 points, 0 of them"), "{error}");
    }
}
