//! Timeline: the records of a flight on one even grid, averaged over whole wing beats.
//!
//! The wing beat shakes the IMU with up to several g near 13 Hz (VEHICLE.md). A Hann window of two
//! beats has no delay, and zeros at the beat and at every harmonic of it.

use nalgebra::{UnitQuaternion, Vector3};

use crate::flight::trace::Trace;
use haltere_core::frames::wrap_pi_rad;
use haltere_core::time::HostTime;

/// Step of the grid, s.
pub const STEP_S: f64 = 0.04;
/// Half width of the window over the IMU, s: two beats of 12.75 Hz in all.
const HALF_WINDOW_S: f64 = 0.078;
/// Shortest flight that is looked at, s.
const LEAST_SPAN_S: f64 = 8.0;
/// Feet at least this high: flying, m. Lower, the floor may carry.
const FLYING_M: f64 = 0.06;
/// Throttle above which the vehicle may be in the air.
const LEAST_THRUST_FRAC: f64 = 0.3;

/// Why nothing can be observed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotObservable {
    /// A kind of record is missing.
    #[error("the trace holds {found} {what}, at least {needed} needed")]
    Missing {
        /// What is missing.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many are needed.
        needed: usize,
    },
    /// Too short.
    #[error("the flight lasts {span_s:.1} s, at least {LEAST_SPAN_S} s needed")]
    TooShort {
        /// How long it lasts, s.
        span_s: f64,
    },
}

/// The flight on the grid. All vectors have the same length.
#[derive(Debug, Clone, Default)]
pub struct Timeline {
    /// Time of the first point.
    pub start: HostTime,
    /// Time since the first point, s.
    pub t_s: Vec<f64>,
    /// Specific force, body, m/s².
    pub acc_B_mps2: Vec<Vector3<f64>>,
    /// Rate, body, rad/s.
    pub rate_B_radps: Vec<Vector3<f64>>,
    /// Attitude as the board believes it, from the board's north.
    pub board: Vec<UnitQuaternion<f64>>,
    /// Its Euler angles, yaw unwrapped, rad.
    pub euler_rad: Vec<[f64; 3]>,
    /// Setpoints of roll, pitch, yaw as the board got them, yaw unwrapped, rad.
    pub setpoint_rad: Vec<[f64; 3]>,
    /// Angle from room north to the board's north as the pilot believed, rad.
    pub north_rad: Vec<f64>,
    /// Throttle sent.
    pub thrust_frac: Vec<f64>,
    /// Supply voltage as told, V.
    pub supply_v: Vec<f64>,
    /// Position as the pilot's filter believed, Earth, m.
    pub pos_E_m: Vec<Vector3<f64>>,
    /// Commanded position, Earth, m; NaN on an axis in velocity.
    pub target_E_m: Vec<Vector3<f64>>,
    /// In the air.
    pub flying: Vec<bool>,
}

impl Timeline {
    /// From the first step to the end of the landing, or `until_s` into the mission.
    pub fn new(trace: &Trace, until_s: Option<f64>) -> Result<Self, NotObservable> {
        for (what, found, needed) in [
            ("IMU samples", trace.imu.len(), 500),
            ("control steps", trace.controls.len(), 500),
            ("estimates", trace.estimates.len(), 500),
            ("attitudes of the board", trace.attitudes.len(), 100),
            ("TDOA", trace.uwb.len(), 100),
            ("battery samples", trace.batteries.len(), 5),
            ("anchors", trace.survey.ids().len(), 5),
        ] {
            if found < needed {
                return Err(NotObservable::Missing { what, found, needed });
            }
        }
        let start = trace.controls[0].at;
        let end = trace.looked_at_until(until_s).unwrap_or(start);
        let span_s = end.seconds_since(start);
        if !(LEAST_SPAN_S..3600.0).contains(&span_s) {
            return Err(NotObservable::TooShort { span_s });
        }
        let n = (span_s / STEP_S) as usize;
        let mut line = Self { start, ..Self::default() };
        line.t_s = (0..n).map(|k| k as f64 * STEP_S).collect();
        line.average_imu(trace);
        line.attitudes(trace);
        line.controls(trace);
        line.states(trace);
        Ok(line)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.t_s.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.t_s.is_empty()
    }

    /// Place of a time on the grid: point at or before it, and share of the step after it.
    pub fn place(&self, at: HostTime) -> Option<(usize, f64)> {
        let x = at.seconds_since(self.start) / STEP_S;
        (x >= 0.0 && x < (self.len() - 1) as f64).then(|| (x as usize, x.fract()))
    }

    fn average_imu(&mut self, trace: &Trace) {
        let n = self.len();
        let mut acc = vec![Vector3::zeros(); n];
        let mut rate = vec![Vector3::zeros(); n];
        let mut weight = vec![0.0; n];
        for sample in &trace.imu {
            let t = sample.valid_at.seconds_since(self.start);
            let first = ((t - HALF_WINDOW_S) / STEP_S).ceil().max(0.0);
            let last = ((t + HALF_WINDOW_S) / STEP_S).floor().min(n as f64 - 1.0);
            if last < first {
                continue;
            }
            for k in first as usize..=last as usize {
                let x = (k as f64 * STEP_S - t) / HALF_WINDOW_S;
                let w = 0.5 + 0.5 * (std::f64::consts::PI * x).cos();
                weight[k] += w;
                acc[k] += sample.acc_B_mps2.raw() * w;
                rate[k] += sample.rate_B_radps.raw() * w;
            }
        }
        for k in 0..n {
            if weight[k] > 0.5 {
                acc[k] /= weight[k];
                rate[k] /= weight[k];
            } else if k > 0 {
                (acc[k], rate[k]) = (acc[k - 1], rate[k - 1]);
            }
        }
        (self.acc_B_mps2, self.rate_B_radps) = (acc, rate);
    }

    fn attitudes(&mut self, trace: &Trace) {
        let stamps = trace.attitudes.iter().map(|a| a.valid_at);
        let brackets = brackets(self.start, self.len(), stamps);
        self.board = brackets
            .iter()
            .map(|&(i, share)| {
                let a = trace.attitudes[i].attitude.raw();
                let b = trace.attitudes[(i + 1).min(trace.attitudes.len() - 1)].attitude.raw();
                a.try_slerp(&b, share, 1e-9).unwrap_or(a)
            })
            .collect();
        let mut yaw = None;
        self.euler_rad = self
            .board
            .iter()
            .map(|q| {
                let (roll, pitch, raw) = q.euler_angles();
                let last = *yaw.get_or_insert(raw);
                let next = last + wrap_pi_rad(raw - last);
                yaw = Some(next);
                [roll, pitch, next]
            })
            .collect();
    }

    fn controls(&mut self, trace: &Trace) {
        let stamps = trace.controls.iter().map(|c| c.at);
        let places = brackets(self.start, self.len(), stamps);
        let mut yaw = None;
        for (k, &(i, _)) in places.iter().enumerate() {
            let c = &trace.controls[i];
            let raw = c.yaw_rad - c.yaw_board_offset_rad;
            let last: f64 = *yaw.get_or_insert(self.euler_rad[k][2]);
            let next = last + wrap_pi_rad(raw - last);
            yaw = Some(next);
            self.setpoint_rad.push([c.roll_rad, c.pitch_rad, next]);
            self.north_rad.push(c.yaw_board_offset_rad);
            self.thrust_frac.push(c.thrust_frac);
            let at = |axis: usize| c.pos_setpoint_E_m[axis].unwrap_or(f64::NAN);
            self.target_E_m.push(Vector3::new(at(0), at(1), at(2)));
        }
        let stamps = trace.batteries.iter().map(|b| b.received_at);
        let value = |i: usize| trace.batteries[i.min(trace.batteries.len() - 1)].supply_v;
        self.supply_v = brackets(self.start, self.len(), stamps)
            .into_iter()
            .map(|(i, share)| value(i) + (value(i + 1) - value(i)) * share)
            .collect();
    }

    fn states(&mut self, trace: &Trace) {
        let stamps = trace.estimates.iter().map(|e| e.at);
        let places = brackets(self.start, self.len(), stamps);
        self.pos_E_m = places.iter().map(|&(i, _)| trace.estimates[i].pos_E_m.raw()).collect();
        let rest_m = -self.pos_E_m.first().map_or(0.0, |p| p.z);
        self.flying = (0..self.len())
            .map(|k| {
                -self.pos_E_m[k].z > rest_m.min(0.2) + FLYING_M
                    && self.thrust_frac[k] > LEAST_THRUST_FRAC
            })
            .collect();
    }
}

/// For every point of the grid the record at or before it, and the share of the way to the next.
fn brackets(
    start: HostTime,
    n: usize,
    stamps: impl Iterator<Item = HostTime>,
) -> Vec<(usize, f64)> {
    let t: Vec<f64> = stamps.map(|s| s.seconds_since(start)).collect();
    let mut i = 0;
    (0..n)
        .map(|k| {
            let at = k as f64 * STEP_S;
            while i + 1 < t.len() && t[i + 1] <= at {
                i += 1;
            }
            let share = match t.get(i + 1) {
                Some(next) if *next > t[i] => ((at - t[i]) / (next - t[i])).clamp(0.0, 1.0),
                _ => 0.0,
            };
            (i, share)
        })
        .collect()
}
