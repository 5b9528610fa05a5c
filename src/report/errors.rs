//! Errors of a flight: estimate against truth, truth against command, by path and axis.
//!
//! Which path a control step belongs to is read from the setpoint in the log, not from clocks of the
//! ground station: a leg begins when the setpoint leaves the point before it and ends when the
//! setpoint arrives at its own point. **Step metric**: a step is judged from the moment its setpoint
//! jumps over a window of [`STEP_WINDOW_S`], on the axis that was stepped; the rise is part of it, so
//! a perfect vehicle does not score zero.

use crate::report::flight::Flight;
use haltere_core::frames::{E, Vec3};
use haltere_core::time::HostTime;
use haltere_core::topics::ControlRecord;
use haltere_pilot::Mode;

/// A leg shorter than this is none, s: an item that is done at once.
const LEAST_LEG_S: f64 = 0.1;
/// Name of all legs together.
const WHOLE: &str = "whole flight";

/// Window over which a step is judged, s. Longer than any settling seen, so that steps of 1 m and
/// of 2 m are judged alike.
pub const STEP_WINDOW_S: f64 = 10.0;

/// A setpoint this close to a point of the plan is at it, m: ten times the wire's resolution.
const AT_POINT_M: f64 = 1e-3;

/// Names of the axes of frame E in tables.
pub const AXES: [&str; 3] = ["x", "y", "z"];

/// How a path is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathKind {
    /// A jump of the setpoint along one axis: 0 north, 1 east, 2 down.
    Step {
        /// The axis.
        axis: usize,
    },
    /// A line that the setpoint moves along.
    Shape,
}

/// One leg of the plan, in the order of flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Leg {
    /// Name of the path it belongs to and how that is judged; `None`: on the way, not judged.
    pub path: Option<(String, PathKind)>,
    /// Where the setpoint arrives, Earth frame, m.
    pub to_E_m: Vec3<E>,
}

/// A path as flown.
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    /// Name.
    pub name: String,
    /// How it is judged.
    pub kind: PathKind,
    /// Begin and end of each time it was flown.
    pub spans: Vec<(HostTime, HostTime)>,
}

/// Mean absolute error, root mean square, standard deviation and largest of one signed error.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spread {
    /// Samples.
    pub count: u32,
    sum: f64,
    sum_abs: f64,
    sum_squares: f64,
    worst: f64,
}

impl Spread {
    fn add(&mut self, error: f64) {
        if error.is_finite() {
            self.count += 1;
            self.sum += error;
            self.sum_abs += error.abs();
            self.sum_squares += error * error;
            self.worst = self.worst.max(error.abs());
        }
    }

    /// Mean absolute error.
    pub fn mae(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum_abs / f64::from(self.count))
    }

    /// Root mean square.
    pub fn rms(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.sum_squares / f64::from(self.count)).sqrt())
    }

    /// The largest, without its sign.
    pub fn worst(&self) -> Option<f64> {
        (self.count > 0).then_some(self.worst)
    }

    /// Standard deviation of the error about its mean.
    pub fn std(&self) -> Option<f64> {
        (self.count > 0).then(|| {
            let n = f64::from(self.count);
            let mean = self.sum / n;
            (self.sum_squares / n - mean * mean).max(0.0).sqrt()
        })
    }
}

/// Errors on one axis of one path.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisErrors {
    /// Name of the path.
    pub path: String,
    /// How it is judged.
    pub kind: PathKind,
    /// Axis of frame E: 0 north, 1 east, 2 down.
    pub axis: usize,
    /// True minus commanded position, m.
    pub position_m: Spread,
    /// True velocity minus the velocity setpoint of the cascade, m/s.
    pub velocity_mps: Spread,
    /// Estimated minus true position, m.
    pub estimate_position_m: Spread,
    /// Estimated minus true velocity, m/s.
    pub estimate_velocity_mps: Spread,
}

/// A point of the plan that the setpoint never reached.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "the setpoint never came to point {number} of {of} of the plan ({name}): the flight was cut short"
)]
pub struct NotFlown {
    /// Counted from 1.
    pub number: usize,
    /// Points in the plan.
    pub of: usize,
    /// Path it belongs to.
    pub name: String,
}

/// Finds when each path was flown. What was flown before the flight was cut short is returned too.
pub fn find_paths(plan: &[Leg], controls: &[ControlRecord]) -> (Vec<Path>, Result<(), NotFlown>) {
    let is_at = |record: &ControlRecord, point: Vec3<E>| {
        record.pos_setpoint_E_m.iter().zip(point.to_array()).all(|(setpoint, to)| {
            setpoint.is_some_and(|setpoint| (setpoint - to).abs() < AT_POINT_M)
        })
    };
    let mut paths: Vec<Path> = Vec::new();
    let mut cursor = 0;
    // When the setpoint left the point before this leg.
    let mut left_at = controls.first().map(|c| c.at);
    let mut before: Option<Vec3<E>> = None;
    for (i, leg) in plan.iter().enumerate() {
        if before.is_some_and(|point| (point - leg.to_E_m).norm() < AT_POINT_M) {
            continue;
        }
        let name = leg.path.as_ref().map_or("on the way", |(name, _)| name);
        let arrived = controls[cursor..].iter().position(|c| is_at(c, leg.to_E_m));
        let (Some(arrived), Some(from)) = (arrived, left_at) else {
            let missing = NotFlown { number: i + 1, of: plan.len(), name: name.to_string() };
            return (paths, Err(missing));
        };
        let arrived = cursor + arrived;
        let left = controls[arrived..].iter().position(|c| !is_at(c, leg.to_E_m));
        let left = left.map_or(controls.len() - 1, |n| arrived + n);
        if let Some((name, kind)) = &leg.path {
            let to = match kind {
                PathKind::Shape => controls[arrived].at,
                PathKind::Step { .. } => {
                    controls[left].at.min(from.offset_us((STEP_WINDOW_S * 1e6) as i64))
                }
            };
            let continues = i > 0 && plan[i - 1].path == leg.path && *kind == PathKind::Shape;
            match paths.iter_mut().find(|p| p.name == *name && p.kind == *kind) {
                Some(path) => match path.spans.last_mut() {
                    Some(last) if continues => last.1 = to,
                    _ => path.spans.push((from, to)),
                },
                None => {
                    paths.push(Path { name: name.clone(), kind: *kind, spans: vec![(from, to)] });
                }
            }
        }
        left_at = Some(controls[left].at);
        cursor = left;
        before = Some(leg.to_E_m);
    }
    (paths, Ok(()))
}

/// What was flown last as legs: all of it, then each mode under position control, a mission item by item. Items
/// count from 1.
pub fn legs(flight: &Flight) -> Vec<Path> {
    let flying = flight.flown_modes().filter(|(mode, ..)| mode.is_flying());
    let mut whole = Path { name: WHOLE.to_owned(), kind: PathKind::Shape, spans: Vec::new() };
    let mut legs: Vec<Path> = Vec::new();
    for (mode, from, to) in flying {
        whole.spans.push((from, to));
        let items = flight.reached.iter().filter(|(at, _)| *at > from && *at < to);
        let items = items.filter(|_| mode == Mode::Mission);
        let named = items.map(|(at, seq)| (format!("item {}", u32::from(*seq) + 1), *at));
        let mut from = from;
        for (name, to) in named.chain([(mode.name().to_owned(), to)]) {
            if to.seconds_since(from) >= LEAST_LEG_S {
                match legs.iter_mut().find(|leg| leg.name == name) {
                    Some(leg) => leg.spans.push((from, to)),
                    None => {
                        legs.push(Path { name, kind: PathKind::Shape, spans: vec![(from, to)] });
                    }
                }
                from = to;
            }
        }
    }
    if legs.len() > 1 {
        legs.insert(0, whole);
    }
    legs
}

/// Errors of each path: a step on its own axis, a shape on all three.
pub fn axis_errors(flight: &Flight, paths: &[Path]) -> Vec<AxisErrors> {
    let mut all = Vec::new();
    for path in paths {
        let axes = match path.kind {
            PathKind::Step { axis } => axis..axis + 1,
            PathKind::Shape => 0..3,
        };
        let first = all.len();
        all.extend(axes.map(|axis| AxisErrors {
            path: path.name.clone(),
            kind: path.kind,
            axis,
            position_m: Spread::default(),
            velocity_mps: Spread::default(),
            estimate_position_m: Spread::default(),
            estimate_velocity_mps: Spread::default(),
        }));
        for (from, to) in &path.spans {
            for control in flight.controls.iter().filter(|c| c.at >= *from && c.at <= *to) {
                let Some((pos_E_m, vel_E_mps)) = flight.truth_at(control.at) else { continue };
                for row in &mut all[first..] {
                    if let Some(setpoint_m) = control.pos_setpoint_E_m[row.axis] {
                        row.position_m.add(pos_E_m[row.axis] - setpoint_m);
                    }
                    if let Some(vel_E_mps) = vel_E_mps {
                        let setpoint_mps = control.vel_setpoint_E_mps[row.axis];
                        row.velocity_mps.add(vel_E_mps[row.axis] - setpoint_mps);
                    }
                }
            }
            for estimate in flight.estimates.iter().filter(|e| e.at >= *from && e.at <= *to) {
                let Some((pos_E_m, vel_E_mps)) = flight.truth_at(estimate.at) else { continue };
                let estimated_E_mps = estimate.vel_E_mps();
                for row in &mut all[first..] {
                    row.estimate_position_m.add(estimate.pos_E_m[row.axis] - pos_E_m[row.axis]);
                    if let Some(vel_E_mps) = vel_E_mps {
                        let error_mps = estimated_E_mps[row.axis] - vel_E_mps[row.axis];
                        row.estimate_velocity_mps.add(error_mps);
                    }
                }
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Setpoints at 100 Hz.
    fn controls(points: &[[f64; 3]]) -> Vec<ControlRecord> {
        let at = |i: usize| HostTime::from_us(1_000_000 + 10_000 * i as u64);
        let record = |(i, p): (usize, &[f64; 3])| ControlRecord {
            at: at(i),
            pos_setpoint_E_m: p.map(Some),
            ..Default::default()
        };
        points.iter().enumerate().map(record).collect()
    }

    fn leg(path: Option<(&str, PathKind)>, to: [f64; 3]) -> Leg {
        Leg { path: path.map(|(n, k)| (n.to_string(), k)), to_E_m: Vec3::from_array(to) }
    }

    #[test]
    fn prop_steps_and_shapes_are_found_in_the_setpoint() {
        let mut setpoints = vec![[0.0, 0.0, -1.0]; 100];
        setpoints.extend(vec![[1.0, 0.0, -1.0]; 1200]);
        setpoints.extend((1..=100).map(|i| [1.0, 0.01 * f64::from(i), -1.0]));
        setpoints.extend((1..=100).map(|i| [1.0 - 0.01 * f64::from(i), 1.0, -1.0]));
        setpoints.extend(vec![[0.0, 1.0, -1.0]; 50]);
        let step = Some(("step x", PathKind::Step { axis: 0 }));
        let shape = Some(("corner", PathKind::Shape));
        let plan = [
            leg(None, [0.0, 0.0, -1.0]),
            leg(step, [1.0, 0.0, -1.0]),
            leg(shape, [1.0, 1.0, -1.0]),
            leg(shape, [0.0, 1.0, -1.0]),
        ];
        let (paths, all) = find_paths(&plan, &controls(&setpoints));
        assert_eq!(all, Ok(()));
        let us = |i: u64| HostTime::from_us(1_000_000 + 10_000 * i);
        assert_eq!(paths.len(), 2);
        let window = (STEP_WINDOW_S * 100.0) as u64;
        assert_eq!(paths[0].spans, [(us(100), us(100 + window))]);
        assert_eq!(paths[1].spans, [(us(1300), us(1499))]);

        let (paths, all) = find_paths(&plan, &controls(&setpoints[..1350]));
        assert_eq!(paths.len(), 1);
        assert_eq!(all.unwrap_err().number, 3);
        assert!(find_paths(&plan, &[]).1.is_err());
    }

    #[test]
    fn prop_spread_is_mean_absolute_and_standard_deviation() {
        let mut spread = Spread::default();
        for e in [1.0, -1.0, 1.0, -1.0, f64::NAN] {
            spread.add(e);
        }
        assert_eq!((spread.count, spread.mae(), spread.std()), (4, Some(1.0), Some(1.0)));
        assert_eq!(Spread::default().mae(), None);
    }
}
