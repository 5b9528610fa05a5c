//! Blocked lines of sight between tag and anchors, from recorded flights with motion capture.
//!
//! A blocked path is longer, so every pair with that anchor is off, by the same amount and with the
//! sign of the anchor in the pair. Residuals of TDOA against geometry are taken as medians per pair
//! over sliding windows, split into anchor parts (`split.rs`), and a part above the limit over
//! several windows names the anchor, with time and place.

pub mod report;
pub mod split;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use nalgebra::Vector3;
use serde::Serialize;

use crate::util_flights::file::{Flight, Sample};
use haltere_core::frames::{B, E, Rot, Vec3, body_from_flu, survey_from_earth};
use haltere_core::measure::{AnchorId, ReferencePose};
use haltere_core::time::HostTime;
use split::{PairResidual, split};

/// Length of a window, s: some 45 readings of each pair in TDOA2, 8 in TDOA3.
const WINDOW_S: f64 = 1.0;
/// Windows follow one another by this, s.
const HOP_S: f64 = 0.5;
/// Windows in a row that must be above the limit.
const LEAST_WINDOWS: usize = 2;
/// Readings of a pair below which its median says nothing.
const LEAST_READINGS: usize = 5;
/// Below this height the low anchors are hidden by the floor, m (README of the recordings).
const HEIGHT_M: f64 = 0.4;
/// The pose is stamped this late, s (authors' figure).
const POSE_LATE_S: f64 = 0.010;
/// Poses farther apart than this are not bridged, s.
const BRIDGE_S: f64 = 0.1;
/// Side of a place, m (GAP.md 2.4).
const VOXEL_M: f64 = 0.5;
/// Margin over the greatest part in clear flights.
const MARGIN: f64 = 1.2;
/// Least limit, m: constant of a pair 0.06 m and four sigmas of 0.06 m that wander (README of the
/// recordings: constant 0.06 m, wandering 0.04 m at best, white 0.05 to 0.07 m).
const LEAST_LIMIT_M: f64 = 0.3;

/// Part of an anchor above which its line of sight counts as blocked.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Limit {
    /// The limit, m.
    pub limit_m: f64,
    /// Where it comes from.
    pub from: &'static str,
}

impl Default for Limit {
    /// 1.2 times the greatest part of any anchor in the clear flights `const1-trial1-tdoa2` (0.15 m)
    /// and `apr26-traj02-tdoa2` (0.85 m, a vehicle whose antenna is shaded by itself), and below the
    /// 1.5 to 2 m that a metal box in the way brings.
    fn default() -> Self {
        Self { limit_m: 1.0, from: "1.2 times the greatest part in two clear flights of UTIL" }
    }
}

impl Limit {
    /// From flights that are known to be clear.
    pub fn from_clear(flights: &[Flight]) -> Self {
        let greatest_m = flights
            .iter()
            .flat_map(windows)
            .flat_map(|w| w.part_m.into_iter().flatten())
            .fold(0.0, f64::max);
        Self {
            limit_m: (MARGIN * greatest_m).max(LEAST_LIMIT_M),
            from: "1.2 times the greatest part in the reference flights",
        }
    }
}

/// First word of the verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// No anchor's part exceeds the limit.
    NoGap,
    /// One anchor.
    Named,
    /// More than one anchor.
    Several,
    /// Too few windows in which the anchors hang together.
    NotTestable,
}

impl Outcome {
    /// Exit code.
    pub fn exit_code(self) -> u8 {
        match self {
            Outcome::NoGap => 0,
            Outcome::Named => 10,
            Outcome::Several => 12,
            Outcome::NotTestable => 20,
        }
    }
}

/// A blocked line of sight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Blocked {
    /// The anchor.
    pub anchor: u8,
    /// Where it stands, survey frame, m.
    pub anchor_U_m: [f64; 3],
    /// Greatest part, m.
    pub greatest_m: f64,
    /// Median part while blocked, m.
    pub median_m: f64,
    /// Time blocked, s, and as share of the judged time.
    pub blocked_s: f64,
    /// The share.
    pub share: f64,
    /// From and to, s since the beginning of the recording.
    pub times_s: Vec<[f64; 2]>,
    /// Middle of the tag's places while blocked, survey frame, m.
    pub place_U_m: [f64; 3],
    /// Places of half a metre that were visited, and how many of them blocked in most passes.
    pub places_visited: usize,
    /// Blocked ones.
    pub places_blocked: usize,
}

/// The answer for one flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Watched {
    /// Name of the file.
    pub flight: String,
    /// First word.
    pub outcome: Outcome,
    /// The limit.
    #[serde(flatten)]
    pub limit: Limit,
    /// Blocked lines, worst first.
    pub blocked: Vec<Blocked>,
    /// Greatest part of each anchor, m; `null`: never heard with the others.
    pub greatest_m: BTreeMap<u8, Option<f64>>,
    /// Greatest deviation of a pair that is no anchor's, m.
    pub pair_m: f64,
    /// Windows judged.
    pub windows: usize,
    /// Readings without a pose or anchor.
    pub skipped: usize,
}

/// Parts in one window.
#[derive(Debug, Clone)]
struct Window {
    /// Number of the hop: windows in a row differ by one.
    index: usize,
    pos_E_m: Vector3<f64>,
    part_m: Vec<Option<f64>>,
    pair_m: f64,
}

/// Antenna seen from the vehicle's centre (README of the recordings); the April vehicle's is not
/// known.
fn lever_B_m(flight: &str) -> Vec3<B> {
    if flight.starts_with("apr") { Vec3::zero() } else { body_from_flu(-0.01245, 0.00127, 0.0908) }
}

/// Judges a flight.
pub fn watch(flight: &Flight, limit: &Limit) -> Watched {
    let ids = flight.survey.ids();
    let windows = windows(flight);
    let greatest = |at: usize| windows.iter().filter_map(|w| *w.part_m.get(at)?).reduce(f64::max);
    let mut blocked: Vec<Blocked> = ids
        .iter()
        .enumerate()
        .filter_map(|(at, id)| blocked(flight, &windows, at, *id, limit))
        .collect();
    blocked.sort_by(|a, b| b.blocked_s.total_cmp(&a.blocked_s));
    let outcome = match blocked.len() {
        _ if windows.len() < LEAST_WINDOWS => Outcome::NotTestable,
        0 => Outcome::NoGap,
        1 => Outcome::Named,
        _ => Outcome::Several,
    };
    Watched {
        flight: flight.name.clone(),
        outcome,
        limit: *limit,
        blocked,
        greatest_m: ids.iter().enumerate().map(|(at, id)| (id.0, greatest(at))).collect(),
        pair_m: windows.iter().map(|w| w.pair_m).fold(0.0, f64::max),
        windows: windows.len(),
        skipped: readings(flight).1,
    }
}

/// The line to one anchor, if it was blocked.
fn blocked(
    flight: &Flight,
    windows: &[Window],
    at: usize,
    id: AnchorId,
    limit: &Limit,
) -> Option<Blocked> {
    let part = |w: &Window| w.part_m.get(at).copied().flatten();
    // Runs of windows above the limit.
    let mut runs: Vec<Vec<&Window>> = Vec::new();
    for w in windows.iter().filter(|w| part(w).is_some_and(|p| p > limit.limit_m)) {
        match runs.last_mut() {
            Some(run) if run.last().is_some_and(|l| w.index == l.index + 1) => run.push(w),
            _ => runs.push(vec![w]),
        }
    }
    runs.retain(|run| run.len() >= LEAST_WINDOWS);
    let times_s: Vec<[f64; 2]> = runs
        .iter()
        .filter_map(|run| {
            let (first, last) = (run.first()?, run.last()?);
            Some([first.index as f64 * HOP_S, last.index as f64 * HOP_S + WINDOW_S])
        })
        .collect();
    let all: Vec<&Window> = runs.concat();
    let mut parts: Vec<f64> = all.iter().filter_map(|w| part(w)).collect();
    parts.sort_by(f64::total_cmp);
    let (greatest_m, median_m) = (*parts.last()?, *parts.get(parts.len() / 2)?);
    let n = all.len() as f64;
    let middle = all.iter().fold(Vector3::zeros(), |sum, w| sum + w.pos_E_m) / n;
    let mut places: BTreeMap<[i64; 3], [usize; 2]> = BTreeMap::new();
    for w in windows {
        let voxel = w.pos_E_m.map(|c| (c / VOXEL_M).floor() as i64);
        let count = places.entry(voxel.into()).or_default();
        count[0] += 1;
        count[1] += usize::from(all.iter().any(|b| b.index == w.index));
    }
    Some(Blocked {
        anchor: id.0,
        anchor_U_m: survey_from_earth(flight.survey.position_E_m(id)?).to_array(),
        greatest_m,
        median_m,
        blocked_s: n * HOP_S,
        share: n / windows.len() as f64,
        times_s,
        place_U_m: survey_from_earth(Vec3::from_raw(middle)).to_array(),
        places_visited: places.len(),
        places_blocked: places.values().filter(|[seen, bad]| 2 * bad > *seen).count(),
    })
}

/// A reading against geometry.
#[derive(Debug, Clone, Copy)]
pub struct Reading {
    /// When, s since the first event.
    pub at_s: f64,
    /// Places of its anchors in the survey.
    pub a: usize,
    /// The second.
    pub b: usize,
    /// Measured less what geometry says, m.
    pub residual_m: f64,
    /// Where the tag was.
    pub pos_E_m: Vector3<f64>,
}

fn windows(flight: &Flight) -> Vec<Window> {
    let (readings, _) = readings(flight);
    let anchors = flight.survey.ids().len();
    let last_s = readings.last().map_or(0.0, |r| r.at_s);
    let mut found = Vec::new();
    for index in 0.. {
        let begin_s = index as f64 * HOP_S;
        if begin_s > last_s {
            break;
        }
        let from = readings.partition_point(|r| r.at_s < begin_s);
        let to = readings.partition_point(|r| r.at_s < begin_s + WINDOW_S);
        let Some(inside) = readings.get(from..to).filter(|r| !r.is_empty()) else { continue };
        let mut by_pair: BTreeMap<(usize, usize), Vec<f64>> = BTreeMap::new();
        for r in inside {
            // Both orders of a pair are one pair.
            let (pair, sign) = if r.a < r.b { ((r.a, r.b), 1.0) } else { ((r.b, r.a), -1.0) };
            by_pair.entry(pair).or_default().push(sign * r.residual_m);
        }
        let pairs: Vec<PairResidual> = by_pair
            .into_iter()
            .filter(|(_, values)| values.len() >= LEAST_READINGS)
            .map(|((a, b), mut values)| {
                values.sort_by(f64::total_cmp);
                let n = values.len();
                let median_m = 0.5 * (values[(n - 1) / 2] + values[n / 2]);
                PairResidual { a, b, median_m, n: n as f64 }
            })
            .collect();
        let Some(parts) = split(&pairs, anchors) else { continue };
        let sum = inside.iter().fold(Vector3::zeros(), |sum, r| sum + r.pos_E_m);
        found.push(Window {
            index,
            pos_E_m: sum / inside.len() as f64,
            part_m: parts.anchor_m,
            pair_m: parts.pair_m,
        });
    }
    found
}

/// Readings above the floor with their residuals, and how many had no pose or no anchor.
pub fn readings(flight: &Flight) -> (Vec<Reading>, usize) {
    let ids = flight.survey.ids();
    let begin = flight.events.first().map_or(HostTime::from_us(0), |e| e.at);
    let path = Path::of(flight);
    let mut found = Vec::new();
    let mut skipped = 0;
    for event in &flight.events {
        let Sample::Tdoa(tdoa) = event.sample else { continue };
        let at_s = event.at.seconds_since(begin);
        let place = |id: AnchorId| ids.iter().position(|i| *i == id);
        let tag = path.tag_at(at_s);
        let (Some(a), Some(b), Some(tag)) = (place(tdoa.anchor_a), place(tdoa.anchor_b), tag)
        else {
            skipped += 1;
            continue;
        };
        if -tag.z() < HEIGHT_M || a == b {
            continue;
        }
        let distance = |id| flight.survey.position_E_m(id).map(|anchor| (tag - anchor).norm());
        let (Some(to_a), Some(to_b)) = (distance(tdoa.anchor_a), distance(tdoa.anchor_b)) else {
            skipped += 1;
            continue;
        };
        let residual_m = tdoa.distance_diff_m - (to_b - to_a);
        found.push(Reading { at_s, a, b, residual_m, pos_E_m: tag.raw() });
    }
    (found, skipped)
}

/// Where a flight was, by motion capture.
pub struct Path {
    /// Poses by their time, s since the first event.
    pub poses: Vec<(f64, ReferencePose)>,
    lever_B: Vec3<B>,
}

impl Path {
    /// Of a flight.
    pub fn of(flight: &Flight) -> Self {
        let begin = flight.events.first().map_or(HostTime::from_us(0), |e| e.at);
        let poses = flight.events.iter().filter_map(|event| match event.sample {
            Sample::Pose(pose) => Some((event.at.seconds_since(begin) - POSE_LATE_S, pose)),
            _ => None,
        });
        Self { poses: poses.collect(), lever_B: lever_B_m(&flight.name) }
    }

    /// Antenna at a time, between two poses.
    pub fn tag_at(&self, at_s: f64) -> Option<Vec3<E>> {
        let poses = &self.poses;
        let after = poses.partition_point(|(t, _)| *t < at_s);
        let (t1, p1) = poses.get(after)?;
        let (t0, p0) = poses.get(after.checked_sub(1)?)?;
        if t1 - t0 > BRIDGE_S {
            return None;
        }
        let share = (at_s - t0) / (t1 - t0);
        let pos = p0.pos_E_m + (p1.pos_E_m - p0.pos_E_m) * share;
        // Without attitude: level, which is wrong by 9 mm per 0.1 rad of tilt.
        let nearest = if share < 0.5 { p0.attitude } else { p1.attitude };
        let R_EB = nearest.unwrap_or(Rot::identity());
        Some(pos + R_EB * self.lever_B)
    }
}
