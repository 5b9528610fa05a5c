//! What recorded sensors told against motion capture, as means over short stretches: pairs of anchors, accelerometer and gyroscope of
//! UTIL, thrust of the Flapper.

use std::collections::BTreeMap;

use crate::util_flights::file::{Flight, Sample};
use haltere_core::frames::{B, E, Vec3, gravity_E_mps2};
use haltere_core::measure::ReferencePose;
use haltere_core::time::HostTime;
use haltere_log::import::{Recording, motion};
use nalgebra::Vector3;

use crate::lines_of_sight::{Path, readings};

/// Length of a stretch: of readings of UWB, of the accelerometer, of the gyroscope, of thrust, s.
const UWB_S: f64 = 1.0;
const ACC_S: f64 = 2.0;
const GYRO_S: f64 = 0.2;
const THRUST_S: f64 = 5.0;
/// Readings of a pair of which a median is told.
const LEAST_READINGS: usize = 3;
/// Half of the time over which a speed is taken from two places, s.
const SPEED_S: f64 = 0.1;

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Channel {
    /// A pair of anchors by their places in the survey: distance to the second less that to the first.
    Pair(usize, usize),
    /// The vertical of the accelerometer.
    Acc,
    /// An axis of the gyroscope.
    Gyro(usize),
    /// Thrust.
    Thrust,
}

/// One mean.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Of what.
    pub channel: Channel,
    /// When, s since the first event.
    pub at_s: f64,
    /// Measured less what motion capture says.
    pub residual: f64,
    /// Where the tag was.
    pub pos_E_m: Vector3<f64>,
    /// What motion capture says, of a voltage its inverse: what a scale works on.
    pub base: f64,
}

/// All of a flight of UTIL.
pub fn of_flight(flight: &Flight) -> Vec<Point> {
    let mut all = pairs(flight);
    let begin = flight.events.first().map_or(HostTime::from_us(0), |event| event.at);
    if flight.has_imu() {
        all.extend(inertial(flight, begin, &Path::of(flight).poses));
    }
    all
}

fn pairs(flight: &Flight) -> Vec<Point> {
    type Key = (i64, usize, usize);
    let mut stretches: BTreeMap<Key, Vec<(f64, Vector3<f64>)>> = BTreeMap::new();
    for reading in readings(flight).0 {
        let (a, b, sign) = match reading.a < reading.b {
            true => (reading.a, reading.b, 1.0),
            false => (reading.b, reading.a, -1.0),
        };
        let stretch = (reading.at_s / UWB_S).floor() as i64;
        let told = stretches.entry((stretch, a, b)).or_default();
        told.push((sign * reading.residual_m, reading.pos_E_m));
    }
    let whole = stretches.into_iter().filter(|(_, told)| told.len() >= LEAST_READINGS);
    whole
        .map(|((stretch, a, b), mut told)| {
            let mean = told.iter().map(|(_, pos)| pos).sum::<Vector3<f64>>() / told.len() as f64;
            told.sort_by(|a, b| a.0.total_cmp(&b.0));
            Point {
                channel: Channel::Pair(a, b),
                at_s: (stretch as f64 + 0.5) * UWB_S,
                residual: told[told.len() / 2].0,
                pos_E_m: mean,
                base: 0.0,
            }
        })
        .collect()
}

/// The pose nearest to a time.
fn pose_at(poses: &[(f64, ReferencePose)], at_s: f64) -> Option<&ReferencePose> {
    let next = poses.partition_point(|(t_s, _)| *t_s < at_s);
    let (t_s, pose) = poses.get(next)?;
    (t_s - at_s < SPEED_S).then_some(pose)
}

fn inertial(flight: &Flight, begin: HostTime, poses: &[(f64, ReferencePose)]) -> Vec<Point> {
    let flown = readings(flight).0;
    let [Some(first), Some(last)] = [flown.first(), flown.last()] else { return Vec::new() };
    let in_air = |at_s: &f64| (first.at_s..=last.at_s).contains(at_s);
    let mut acc: BTreeMap<i64, Vec<Vec3<E>>> = BTreeMap::new();
    let mut gyro: BTreeMap<i64, Vec<Vec3<B>>> = BTreeMap::new();
    for event in &flight.events {
        let at_s = event.at.seconds_since(begin);
        if !in_air(&at_s) {
            continue;
        }
        match event.sample {
            Sample::Acc(force) => {
                if let Some(R_EB) = pose_at(poses, at_s).and_then(|pose| pose.attitude) {
                    acc.entry((at_s / ACC_S).floor() as i64).or_default().push(R_EB * force);
                }
            }
            Sample::Gyro(rate) => {
                gyro.entry((at_s / GYRO_S).floor() as i64).or_default().push(rate)
            }
            _ => {}
        }
    }
    let speed = |at_s: f64| {
        let ends = pose_at(poses, at_s - SPEED_S).zip(pose_at(poses, at_s + SPEED_S));
        ends.map(|(from, to)| (to.pos_E_m - from.pos_E_m) * (0.5 / SPEED_S))
    };
    let mut all = Vec::new();
    for (stretch, forces) in acc {
        let at_s = stretch as f64 * ACC_S;
        let Some((from, to)) = speed(at_s).zip(speed(at_s + ACC_S)) else { continue };
        let down = forces.iter().map(Vec3::z).sum::<f64>() / forces.len() as f64;
        let true_down = (to.z() - from.z()) / ACC_S - gravity_E_mps2().z();
        let (channel, residual) = (Channel::Acc, down - true_down);
        let pos_E_m = Vector3::zeros();
        all.push(Point { channel, at_s, residual, pos_E_m, base: true_down });
    }
    for (stretch, rates) in gyro {
        let at_s = stretch as f64 * GYRO_S;
        let ends = pose_at(poses, at_s).zip(pose_at(poses, at_s + GYRO_S));
        let attitudes = ends.and_then(|(from, to)| from.attitude.zip(to.attitude));
        let Some((from, to)) = attitudes else { continue };
        let turned = (from.raw().inverse() * to.raw()).scaled_axis() / GYRO_S;
        let sum = rates.iter().fold(Vector3::zeros(), |sum, rate| sum + rate.raw());
        let mean = sum / rates.len() as f64;
        for axis in 0..3 {
            all.push(Point {
                channel: Channel::Gyro(axis),
                at_s,
                residual: mean[axis] - turned[axis],
                pos_E_m: Vector3::zeros(),
                base: turned[axis],
            });
        }
    }
    all
}

/// Thrust of the Flapper: logarithm of specific force over command and voltage.
pub fn of_recording(flight: &Recording) -> Vec<Point> {
    let (samples, _) = motion::samples(flight);
    let whole = samples.chunk_by(|a, b| (a.t_s / THRUST_S).floor() == (b.t_s / THRUST_S).floor());
    whole
        .filter_map(|samples| {
            let n = samples.len() as f64;
            let mean =
                |of: &dyn Fn(&motion::Sample) -> f64| samples.iter().map(of).sum::<f64>() / n;
            let supply_v = mean(&|s| s.supply_v);
            let told = mean(&|s| s.command_frac) * supply_v;
            let force = -mean(&|s| s.force_B_mps2.z());
            let at_s = samples.first()?.t_s;
            (force > 0.0 && told > 0.0).then(|| Point {
                channel: Channel::Thrust,
                at_s,
                residual: (force / told).ln(),
                pos_E_m: Vector3::zeros(),
                base: 1.0 / supply_v,
            })
        })
        .collect()
}
