//! The clock of a truth against the companion's, from how the vehicle moved: nobody sets the two by hand.
//!
//! ```text
//! t = h − a − b (h − h̄)        a: offset, s; b: drift; h̄: middle of what both tell, s
//! r(h) = p̂(h) − R(ψ) p(t) − c   p̂: estimate, p: truth, Earth frame, m; ψ, c: a turn about the vertical and a shift
//! ```
//!
//! First the speeds are laid over one another at every offset, which no turn or shift of the frames moves; the likeliest
//! offsets of normal speeds are those with the largest `−n ln(1 − ρ²)`, ρ their correlation over n steps. From each the
//! sum of `r²` is made least by Gauss and Newton, residuals weighed by Huber; the one that explains most is taken. ψ and c
//! are found with it, so that frames that differ are not taken for a clock. **Left out.** A lag of the estimate itself
//! is part of the offset: no track can tell the two apart.

mod descent;
mod frames;
mod misnamed;
mod speeds;

use std::fmt;

use nalgebra::Vector3;
use serde::Serialize;

use haltere_core::measure::ReferencePose;
use haltere_core::time::HostTime;
use haltere_log::import::truth::{PositionNames, TruePose};

pub use descent::aloft;
use descent::{Fit, fit};
pub use frames::Frames;
pub use misnamed::Misnamed;
use misnamed::OtherAxes;
use speeds::{Speeds, beside, overlaid};

/// Steps over which speeds are taken and laid over one another, s: a vehicle changes its speed in some tenths.
const STEP_S: f64 = 0.2;
/// Positions are taken between poses no farther apart than this, s.
pub const GAP_S: f64 = 0.25;
/// Longest track and flight that are laid over one another, s: three hours each take some seconds.
const LONGEST_S: f64 = 10_800.0;
/// From this speed on it moves, m/s: twice what an estimate that stands trembles by.
const MOVES_MPS: f64 = 0.2;
/// It must move so long in what both tell, s: a take-off and one leg.
const LEAST_MOVING_S: f64 = 5.0;
/// Least correlation of the speeds (judgement: 0.89 on two simulated flights of 35 s; flights of others were not measured).
const LEAST_CORRELATION: f64 = 0.7;
/// Offsets that are tried to the end, and how far they lie apart, s.
const TRIED: usize = 6;
const APART_S: f64 = 1.0;
/// Two offsets fit alike where the second leaves less than this times the residual of the first.
const ALIKE: f64 = 1.5;
/// Largest standard error that is taken, s: at 1 m/s half of the best error on record, 0.06 m.
const MOST_STD_S: f64 = 0.03;

/// Where the estimate had the vehicle: host time, s since the log began; position, Earth frame, m; speed, m/s.
#[derive(Debug, Clone, Copy)]
pub struct Flown {
    pub at_s: f64,
    pub pos_E_m: Vector3<f64>,
    pub speed_mps: f64,
}

/// What leads from the truth's clock to the companion's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Clock {
    /// Companion's time less the truth's in the middle of the flight, s; the companion's counts from the log's beginning.
    pub offset_s: f64,
    /// Its standard error, s.
    pub std_offset_s: f64,
    /// By how much faster the companion's runs, parts per million.
    pub drift_ppm: f64,
    /// Its standard error, parts per million.
    pub std_drift_ppm: f64,
    /// Middle of the flight, s since the log began.
    pub middle_s: f64,
    /// Correlation of the speeds there.
    pub correlation: f64,
}

/// Why no clock was found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NoClock {
    /// Nothing to compare.
    #[error(
        "{what} lasts {found_s:.0} s, allowed {LEAST_MOVING_S:.0} to {LONGEST_S:.0} s; give the whole flight, and little else"
    )]
    Length {
        /// Estimate or truth.
        what: &'static str,
        /// How long.
        found_s: f64,
    },
    /// It stood.
    #[error(
        "the vehicle did not move enough: {found_s:.1} s faster than {MOVES_MPS} m/s in what estimate and truth both tell, \
         at least {LEAST_MOVING_S:.0} s needed; fly a leg there and back, or give the truth on the companion's clock (`host_time_us`)"
    )]
    TooStill {
        /// How long it moved.
        found_s: f64,
    },
    /// Speeds do not agree anywhere.
    #[error(
        "at no offset do the speeds of estimate and truth agree: correlation {found:.2} at best, at least \
         {LEAST_CORRELATION} needed; is the truth of this flight?"
    )]
    NothingAgrees {
        /// The best.
        found: f64,
    },
    /// No metres, or other axes.
    #[error("{0}")]
    Misnamed(Box<Misnamed>),
    /// A path that repeats.
    #[error(
        "two offsets fit alike, {first_s:.2} s and {second_s:.2} s: the path repeats itself; give a truth that holds take-off or \
         landing, or the companion's clock (`host_time_us`)"
    )]
    Repeats {
        /// The better one, s.
        first_s: f64,
        /// The other one, s.
        second_s: f64,
    },
    /// Not well enough.
    #[error(
        "the offset is known to {std_s:.3} s only, at most {MOST_STD_S} s allowed; fly farther or faster, or give the truth on the \
         companion's clock (`host_time_us`)"
    )]
    Vague {
        /// Standard error.
        std_s: f64,
    },
}

impl Clock {
    /// The same pose on the companion's clock; `None` before the log began.
    pub fn pose(&self, pose: &TruePose, log_start: HostTime) -> Option<ReferencePose> {
        let drift = self.drift_ppm * 1e-6;
        // t = h − a − b (h − h̄), solved for h.
        let at_s = (pose.t_s + self.offset_s - drift * self.middle_s) / (1.0 - drift);
        ((0.0..LONGEST_S * 2.0).contains(&at_s))
            .then(|| reference(pose, log_start.offset_us((at_s * 1e6).round() as i64)))
    }
}

impl fmt::Display for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { offset_s, std_offset_s, drift_ppm, std_drift_ppm, middle_s, correlation } = self;
        write!(
            f,
            "{offset_s:+.3} s (sigma {std_offset_s:.3}) from the truth's to the log's at {middle_s:.0} s, which runs \
             {drift_ppm:+.0} ppm (sigma {std_drift_ppm:.0}) faster; speeds correlate by {correlation:.2}"
        )
    }
}

/// A pose at a host time.
pub fn reference(pose: &TruePose, at: HostTime) -> ReferencePose {
    ReferencePose { valid_at: at, received_at: at, pos_E_m: pose.pos_E_m, attitude: pose.attitude }
}

/// Finds the clock. Both in the order of their times; `names`: of the truth's columns. What the columns do not hold that they are
/// named after is told before anything else: no offset fits such a truth.
pub fn find(flown: &[Flown], truth: &[TruePose], names: &PositionNames) -> Result<Clock, NoClock> {
    let estimated = Speeds::of_flown(flown)?;
    let true_speeds = Speeds::of_truth(truth)?;
    let mut lags = overlaid(&estimated, &true_speeds)?;
    lags.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    // At an offset where speeds do not agree no axes do.
    let agrees = lags.first().filter(|lag| lag.correlation >= LEAST_CORRELATION);
    let misnamed = agrees.and_then(|lag| Misnamed::of(beside(flown, truth, lag.offset_s), names));
    let misnamed = match misnamed {
        Some(misnamed) if misnamed.unit.is_some() => {
            return Err(NoClock::Misnamed(misnamed.into()));
        }
        misnamed => misnamed,
    };
    let mut tried: Vec<Fit> = Vec::new();
    let mut begun: Vec<f64> = Vec::new();
    for lag in &lags {
        if begun.len() == TRIED {
            break;
        }
        if begun.iter().all(|other| (other - lag.offset_s).abs() > APART_S) {
            begun.push(lag.offset_s);
            tried.extend(fit(flown, truth, lag));
        }
    }
    let found = lags.first().map_or(0.0, |lag| lag.correlation);
    tried.retain(|fit| fit.correlation >= LEAST_CORRELATION);
    tried.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    // Laps are their own mirror image half a lap later: where they fit as they are named, that is so.
    let as_named_m = tried.first().map_or(f64::INFINITY, |best| best.rms_m);
    let is_better = |axes: OtherAxes| axes.renamed_m * ALIKE < as_named_m;
    if let Some(misnamed) = misnamed.filter(|m| m.axes.is_some_and(is_better)) {
        return Err(NoClock::Misnamed(misnamed.into()));
    }
    let Some(best) = tried.first() else { return Err(NoClock::NothingAgrees { found }) };
    let other = tried.iter().skip(1).find(|fit| {
        (fit.clock.offset_s - best.clock.offset_s).abs() > APART_S / 2.0
            && fit.rms_m < ALIKE * best.rms_m
            && fit.points as f64 > 0.8 * best.points as f64
    });
    if let Some(other) = other {
        let (first_s, second_s) = (best.clock.offset_s, other.clock.offset_s);
        return Err(NoClock::Repeats { first_s, second_s });
    }
    if best.clock.std_offset_s > MOST_STD_S {
        return Err(NoClock::Vague { std_s: best.clock.std_offset_s });
    }
    Ok(best.clock)
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::frames::{E, Vec3};
    use haltere_log::import::truth::turns;
    use nalgebra::{Matrix3, Rotation3};

    /// Two minutes and a half that never repeat: stands, climbs, flies about, comes down.
    fn path(t_s: f64) -> Vector3<f64> {
        let flown_s = (t_s - 10.0).clamp(0.0, 130.0);
        let x = 2.0 * (0.31 * flown_s).sin() + (0.83 * flown_s).sin();
        let y = 1.5 * (0.47 * flown_s).sin() - 0.6 * (1.07 * flown_s).cos();
        let up_m = (0.8 * flown_s).min(1.5).min(0.6 * (130.0 - flown_s));
        Vector3::new(x, y, -up_m)
    }

    /// An error as of an estimate: some centimetres that stay for seconds.
    fn error(t_s: f64) -> Vector3<f64> {
        0.04 * Vector3::new((1.3 * t_s).sin(), (0.9 * t_s + 1.0).cos(), (1.7 * t_s).sin())
    }

    fn flown() -> Vec<Flown> {
        let velocity = |t_s: f64| (path(t_s + 0.01) - path(t_s - 0.01)) / 0.02;
        let steps = (0..15_000).map(|k| 0.01 * f64::from(k));
        let at = |at_s| Flown {
            at_s,
            pos_E_m: path(at_s) + error(at_s),
            speed_mps: velocity(at_s).norm(),
        };
        steps.map(at).collect()
    }

    /// The same at 100 Hz on a clock that is `offset_s` behind in the middle and slow by `drift`, turned and moved.
    fn truth(offset_s: f64, drift: f64, yaw_rad: f64) -> Vec<TruePose> {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -yaw_rad);
        let pose = |k: i32| {
            let h_s = 0.01 * f64::from(k) + 0.003;
            let p: Vec3<E> = Vec3::from_raw(turn * (path(h_s) - Vector3::new(0.5, -0.2, 0.1)));
            TruePose { t_s: h_s - offset_s - drift * (h_s - 75.0), pos_E_m: p, attitude: None }
        };
        (0..14_990).map(pose).collect()
    }

    fn clock_of(flown: &[Flown], truth: &[TruePose]) -> Result<Clock, NoClock> {
        find(flown, truth, &PositionNames::default())
    }

    /// A truth of the other hand was answered with "fly farther or faster", one with y up likewise.
    #[test]
    fn regress_axes_that_are_named_otherwise_are_told_before_anything_else() {
        let flight = flown();
        // Every tenth estimate shows as much.
        let few: Vec<Flown> = flight.iter().step_by(10).copied().collect();
        for turn in turns() {
            // A turn about the vertical that is no quarter is told as a turn.
            let is_turn = turn[(2, 2)] == 1.0 && turn.determinant() > 0.0;
            let cases = [(0.0, 1.0), (0.0, 1000.0), (0.1, 1.0), (-0.1, 1000.0)];
            for (yaw_rad, unit) in cases.into_iter().take(if is_turn { 2 } else { 4 }) {
                let mut truth = truth(3.7, 0.0, yaw_rad);
                for pose in &mut truth {
                    pose.pos_E_m = Vec3::from_raw(turn.transpose() * pose.pos_E_m.raw() * unit);
                }
                let found = clock_of(&few, &truth);
                if is_turn && unit == 1.0 {
                    // The clock is found whatever the turn, which is told of where the truth lies then.
                    let offset_s = found.unwrap().offset_s;
                    let names = PositionNames::default();
                    let told = Misnamed::of(beside(&few, &truth, offset_s), &names);
                    let told = told.and_then(|told| told.axes).map(|axes| axes.turn_EE);
                    assert_eq!(told, Some(turn).filter(|turn| *turn != Matrix3::identity()));
                    continue;
                }
                let Err(NoClock::Misnamed(found)) = found else { panic!("{turn} {found:?}") };
                let found_turn = found.axes.map_or_else(Matrix3::identity, |axes| axes.turn_EE);
                assert_eq!(found_turn, turn, "{yaw_rad} {unit}: {found}");
                assert_eq!(found.unit.is_some(), unit > 1.0, "{found}");
                let says = found.to_string();
                assert_eq!(says.contains("a mirror image"), turn.determinant() < 0.0, "{says}");
            }
        }
        // The other hand, as a survey of x, y and up has it.
        let mut mirrored = truth(3.7, 0.0, 0.0);
        for pose in &mut mirrored {
            pose.pos_E_m = Vec3::new(-pose.pos_E_m.x(), pose.pos_E_m.y(), pose.pos_E_m.z());
        }
        let says = clock_of(&flight, &mirrored).unwrap_err().to_string();
        assert!(says.contains("name its columns x,-y,z (one named with a minus"), "{says}");
        // A path up and down a line is its own mirror image: nothing is told of axes.
        let line = |t_s: f64| Vector3::new(path(t_s).x, 0.0, path(t_s).z);
        let pairs: Vec<_> =
            (0..1500).map(|k| 0.1 * f64::from(k)).map(|t| (line(t) + error(t), line(t))).collect();
        assert_eq!(Misnamed::of(pairs.iter().copied(), &PositionNames::default()), None);
    }

    #[test]
    fn prop_offset_and_drift_are_found_whatever_the_frames() {
        for offset_s in [0.0, 3.7, -3.7, 412.25, -1_763_999_999.5] {
            for (drift, yaw_rad) in [(0.0, 0.0), (1e-3, 0.0), (-1e-3, 0.4), (0.0, 3.0)] {
                let clock = clock_of(&flown(), &truth(offset_s, drift, yaw_rad)).unwrap();
                let off_s = clock.offset_s + drift * (clock.middle_s - 75.0) - offset_s;
                println!("{offset_s} {drift} {yaw_rad}: {off_s:.4}, {clock}");
                assert!(off_s.abs() < 0.005, "{clock:?}");
                let drift_off_ppm = (clock.drift_ppm - 1e6 * drift).abs();
                assert!(
                    drift_off_ppm < 200.0 && drift_off_ppm < 3.0 * clock.std_drift_ppm,
                    "{clock:?}"
                );
            }
        }
    }

    #[test]
    fn prop_a_pose_comes_back_to_its_time() {
        let truth = truth(3.7, 1e-3, 0.0);
        let clock = clock_of(&flown(), &truth).unwrap();
        let start = HostTime::from_us(5_000_000);
        for k in [1500, 7000, 13_000] {
            let at = clock.pose(&truth[k], start).unwrap().valid_at;
            let off_s = at.seconds_since(start) - (0.01 * k as f64 + 0.003);
            assert!(off_s.abs() < 0.01, "{k}: {off_s}");
        }
        let before = TruePose { t_s: -1e9, ..truth[0] };
        assert_eq!(clock.pose(&before, start), None);
    }

    #[test]
    fn prop_a_gap_in_the_truth_costs_nothing_but_its_poses() {
        let mut gap = truth(3.7, 0.0, 0.0);
        gap.retain(|pose| !(20.0..27.0).contains(&pose.t_s));
        let clock = clock_of(&flown(), &gap).unwrap();
        assert!((clock.offset_s - 3.7).abs() < 0.01, "{clock:?}");
    }

    #[test]
    fn prop_what_cannot_be_found_is_said_with_its_reason() {
        let flight = flown();
        let scaled = |factor: f64| {
            let mut truth = truth(3.7, 0.0, 0.0);
            truth.iter_mut().for_each(|pose| pose.pos_E_m = pose.pos_E_m * factor);
            truth
        };
        let still: Vec<TruePose> = truth(0.0, 0.0, 0.0)
            .into_iter()
            .map(|p| TruePose { pos_E_m: Vec3::zero(), ..p })
            .collect();
        let mut other = truth(0.0, 0.0, 0.0);
        for pose in &mut other {
            let t_s = 1.9 * pose.t_s;
            pose.pos_E_m =
                Vec3::new((0.9 * t_s).cos(), 2.0 * (0.23 * t_s).sin(), -(1.1 * t_s).sin());
        }
        for (truth, says) in [
            (scaled(1000.0), "in millimetres? name its columns x_mm"),
            (scaled(100.0), "in centimetres? name its columns x_cm"),
            (still, "did not move enough: 0.0 s"),
            (other, "is the truth of this flight?"),
            (Vec::new(), "the truth lasts 0 s"),
            (truth(0.0, 0.0, 0.0)[..300].to_vec(), "the truth lasts 3 s"),
        ] {
            let error = clock_of(&flight, &truth).unwrap_err().to_string();
            assert!(error.contains(says), "{says}: {error}");
        }
        assert!(
            clock_of(&[], &truth(0.0, 0.0, 0.0))
                .unwrap_err()
                .to_string()
                .contains("the estimate lasts")
        );
    }

    /// Laps alone, without take-off and landing, and a truth of some of them.
    #[test]
    fn prop_laps_that_look_alike_are_not_told_apart() {
        let lap = |t_s: f64| {
            let a = std::f64::consts::TAU * t_s / 8.0;
            Vector3::new(2.0 * a.sin(), (2.0 * a).sin(), -1.0)
        };
        let speed = |t_s: f64| (lap(t_s + 0.01) - lap(t_s - 0.01)).norm() / 0.02;
        let steps = (0..8000).map(|k| 0.01 * f64::from(k));
        let flight: Vec<Flown> = steps
            .map(|at_s| Flown { at_s, pos_E_m: lap(at_s) + error(at_s), speed_mps: speed(at_s) })
            .collect();
        let pose = |k: i32| {
            let t_s = 0.01 * f64::from(k);
            TruePose { t_s, pos_E_m: Vec3::from_raw(lap(t_s)), attitude: None }
        };
        let truth: Vec<TruePose> = (0..3000).map(pose).collect();
        let error = clock_of(&flight, &truth).unwrap_err();
        assert!(matches!(error, NoClock::Repeats { .. }), "{error}");
    }

    #[test]
    fn prop_frames_that_differ_are_found_and_nothing_is_found_of_nothing() {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.2);
        let shift = Vector3::new(0.3, -0.1, 0.05);
        let pairs: Vec<_> =
            (0..500).map(|k| path(0.1 * f64::from(k))).map(|t| (turn * t + shift, t)).collect();
        let frames = Frames::between(pairs.iter().copied()).unwrap();
        assert!((frames.yaw_rad.unwrap() - 0.2).abs() < 1e-9 && frames.fitted_rms_m < 1e-9);
        assert!((Vector3::from(frames.shift_E_m) - shift).norm() < 1e-9 && frames.rms_m > 0.2);
        assert!((frames.spread_factor - 1.0).abs() < 1e-9);
        assert_eq!(Frames::between(std::iter::empty()), None);
    }
}
