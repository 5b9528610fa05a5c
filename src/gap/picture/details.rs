//! Details of a flight that only pictures and the search for an onset need: residuals second by
//! second, what they may depend on, forces by place, and the mean residual of every pair of anchors.
//!
//! The same details of null flights ([`fly_nulls`]) are what they are compared with.

use std::sync::atomic::{AtomicUsize, Ordering};

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::bank::archive::Shelf;
use crate::bank::bank_file::{Row, from_disk, to_disk};
use crate::bank::fly::fly_observed_into;
use crate::bank::jitter::jittered;
use crate::bank::kept_file::Kind as KeptKind;
use crate::bank::library::with_effect;
use crate::flight::cells::{Cell, cells, channels};
use crate::flight::residuals::{Channel, Flight, force, uwb};
use crate::flight::statistics::statistics_by;
use crate::flight::timeline::{NotObservable, STEP_S};
use crate::flight::trace::Trace;
use crate::nominal::Nominal;
use crate::scene::Scene;
use haltere_core::measure::AnchorId;
use haltere_model::effects::EffectSpec;

/// Points of the grid in a second.
const PER_SECOND: usize = (1.0 / STEP_S + 0.5) as usize;
/// Fewest points of a second that say something: the battery talks at 10 Hz.
const LEAST_POINTS: usize = 3;
/// Fewest TDOA of a pair or of an anchor in a second.
const LEAST_TDOA: usize = 5;
/// Fewest points of a place, half a second.
const LEAST_PLACE_POINTS: usize = 12;

/// What is taken of a channel in a second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub enum Kind {
    /// Mean.
    Mean,
    /// Logarithm of the standard deviation.
    Spread,
}

/// One residual, second by second since the first step with thrust; NaN: not visited.
#[derive(Debug, Clone)]
pub struct Line {
    /// Channel.
    pub channel: Channel,
    /// Mean or spread.
    pub kind: Kind,
    /// All pairs with this anchor, signed.
    pub anchor: Option<AnchorId>,
    /// Unit of the channel, or ln of it.
    pub values: Vec<f64>,
}

impl Line {
    /// For people.
    pub fn name(&self) -> String {
        let of = match self.kind {
            Kind::Mean => "",
            Kind::Spread => " (spread)",
        };
        match self.anchor {
            Some(id) => format!("{:?} anchor {}{of}", self.channel, id.0),
            None => format!("{:?}{of}", self.channel),
        }
    }

    /// With its unit.
    pub fn label(&self) -> String {
        match self.kind {
            Kind::Mean => format!("{}, {}", self.name(), unit(self.channel)),
            Kind::Spread => format!("{}, ln {}", self.name(), unit(self.channel)),
        }
    }
}

/// Unit of a channel's residual.
pub fn unit(channel: Channel) -> &'static str {
    match channel {
        Channel::ForceX | Channel::ForceY | Channel::ForceZ | Channel::Bias => "m/s²",
        Channel::AttitudeRoll | Channel::AttitudePitch | Channel::Yaw | Channel::North => "rad",
        Channel::Gyro => "rad/s",
        Channel::Battery => "V",
        Channel::Current => "A",
        Channel::Uwb | Channel::Height => "m",
        Channel::Timing => "s",
        Channel::Loop => "1",
    }
}

/// What a residual may depend on, second by second.
#[derive(Debug, Clone)]
pub struct Regressor {
    /// Name with unit.
    pub name: &'static str,
    /// One a second.
    pub values: Vec<f64>,
}

/// Details of one flight.
#[derive(Debug, Clone)]
pub struct Details {
    /// Means by channel and regime, time, place, anchor.
    pub cells: Vec<Cell>,
    /// Residuals second by second.
    pub lines: Vec<Line>,
    /// What they may depend on.
    pub regressors: Vec<Regressor>,
    /// Mean horizontal force residual by voxel of the floor, north and east, m/s²; NaN: not visited.
    pub force_NE_mps2: Vec<[f64; 2]>,
    /// Mean residual of each pair of anchors, second minus first, m; NaN: not measured.
    pub pairs_m: Vec<(AnchorId, AnchorId, f64)>,
}

/// Details of a flight.
pub fn details(trace: &Trace, nominal: &Nominal) -> Result<Details, NotObservable> {
    let f = Flight::new(trace, nominal)?;
    Ok(details_of(&f, &uwb::residuals(&f)))
}

/// Statistics of a flight with its details.
pub fn observed_in_detail(
    trace: &Trace,
    nominal: &Nominal,
) -> Result<(Vec<f64>, Details), NotObservable> {
    let f = Flight::new(trace, nominal)?;
    let rows = uwb::residuals(&f);
    Ok((statistics_by(&f, &rows), details_of(&f, &rows)))
}

fn details_of(f: &Flight<'_>, rows: &uwb::Rows) -> Details {
    let channels = channels(f, rows);
    let cells = cells(f, rows, &channels);
    let mut lines = Vec::new();
    for (channel, values) in channels {
        let (means, spreads) = by_second(&values);
        let line = |kind, values| Line { channel, kind, anchor: None, values };
        lines.push(line(Kind::Mean, means));
        if !matches!(channel, Channel::Battery | Channel::Current | Channel::Bias) {
            lines.push(line(Kind::Spread, spreads));
        }
    }
    lines.extend(anchor_lines(f, rows));
    Details {
        cells,
        lines,
        regressors: regressors(f),
        force_NE_mps2: forces(f),
        pairs_m: pairs(f, rows),
    }
}

/// Details of flights of the model with benign jitter, and with effects if any; lost ones are left
/// out. `progress`: done, of how many.
pub fn fly_nulls(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    effects: &[(&EffectSpec, &[f64])],
    seeds: std::ops::Range<u64>,
    progress: impl Fn(usize, usize) + Sync,
) -> Vec<Details> {
    let nominal = Nominal::of_scene(scene);
    let (done, of) = (AtomicUsize::new(0), (seeds.end - seeds.start) as usize);
    let fly = |trace: &mut Trace, seed: u64| {
        let mut plant = jittered(scene.plant(seed)).ok()?;
        for (spec, theta) in effects {
            plant.effects = with_effect(plant.effects, spec, theta).ok()?;
        }
        let flown = fly_observed_into(trace, scene, items, plant, scene.pilot.clone());
        let seen = flown.ok().and_then(|()| details(trace, &nominal).ok());
        progress(done.fetch_add(1, Ordering::Relaxed) + 1, of);
        seen
    };
    let trace = || Trace::new(scene.survey.clone());
    seeds.into_par_iter().map_init(trace, fly).flatten().collect()
}

const NULLS: KeptKind = KeptKind { what: "details of flights", magic: b"HALTSEEN", version: 1 };

/// Numbers of a flight's details: mean, root mean square and samples of the cells, lines, regressors, forces, pairs. What they are of is
/// the same for all flights of a mission.
#[derive(Serialize, Deserialize)]
struct OnDisk {
    cells: [Row; 3],
    lines: Vec<Row>,
    regressors: Vec<Row>,
    forces: [Row; 2],
    pairs: Row,
}

impl OnDisk {
    fn of(details: &Details) -> Self {
        let cells =
            |of: fn(&Cell) -> f64| to_disk(&details.cells.iter().map(of).collect::<Vec<_>>());
        let forces = |k: usize| {
            to_disk(&details.force_NE_mps2.iter().map(|force| force[k]).collect::<Vec<_>>())
        };
        Self {
            cells: [cells(|c| c.mean), cells(|c| c.rms), cells(|c| c.n_eff)],
            lines: details.lines.iter().map(|line| to_disk(&line.values)).collect(),
            regressors: details.regressors.iter().map(|r| to_disk(&r.values)).collect(),
            forces: [forces(0), forces(1)],
            pairs: to_disk(&details.pairs_m.iter().map(|pair| pair.2).collect::<Vec<_>>()),
        }
    }

    /// `like`: of any flight of the mission.
    fn details(self, like: &Details) -> Details {
        let [mean, rms, n_eff] = self.cells.map(from_disk);
        let [north, east] = self.forces.map(from_disk);
        let cells = like.cells.iter().zip(mean).zip(rms.into_iter().zip(n_eff));
        let lines = like.lines.iter().zip(self.lines);
        let regressors = like.regressors.iter().zip(self.regressors);
        let pairs = like.pairs_m.iter().zip(from_disk(self.pairs));
        Details {
            cells: cells.map(|((c, mean), (rms, n_eff))| Cell { mean, rms, n_eff, ..*c }).collect(),
            lines: lines.map(|(l, row)| Line { values: from_disk(row), ..l.clone() }).collect(),
            regressors: regressors
                .map(|(r, row)| Regressor { values: from_disk(row), name: r.name })
                .collect(),
            force_NE_mps2: north.into_iter().zip(east).map(|(n, e)| [n, e]).collect(),
            pairs_m: pairs.map(|((a, b, _), mean)| (*a, *b, mean)).collect(),
        }
    }
}

/// [`fly_nulls`] without effects, of a mission that every diagnosis flies alike: from the shelf where they were flown before. `like`:
/// details of any flight of the mission.
pub fn kept_nulls(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    like: &Details,
    seeds: std::ops::Range<u64>,
    shelf: &Shelf,
    progress: impl Fn(usize, usize) + Sync,
) -> Vec<Details> {
    let fly = || fly_nulls(scene, items, &[], seeds, progress).iter().map(OnDisk::of).collect();
    let kept: Vec<OnDisk> = shelf.kept(NULLS, scene, items, fly);
    kept.into_iter().map(|kept| kept.details(like)).collect()
}

/// Mean, and logarithm of the standard deviation, of every second.
fn by_second(values: &[f64]) -> (Vec<f64>, Vec<f64>) {
    values
        .chunks(PER_SECOND)
        .map(|chunk| {
            let known: Vec<f64> = chunk.iter().copied().filter(|v| v.is_finite()).collect();
            if known.len() < LEAST_POINTS {
                return (f64::NAN, f64::NAN);
            }
            let n = known.len() as f64;
            let mean = known.iter().sum::<f64>() / n;
            let var = known.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let least = f64::MIN_POSITIVE.max(1e-12 * mean * mean);
            (mean, 0.5 * (var + least).ln())
        })
        .unzip()
}

fn anchor_lines(f: &Flight<'_>, rows: &uwb::Rows) -> Vec<Line> {
    let seconds = f.len().div_ceil(PER_SECOND);
    let mut sums = vec![[0.0; 2]; seconds * f.ids.len()];
    for (m, r) in f.tdoa.iter().zip(&rows.r_m) {
        if !f.clear[m.k] {
            continue;
        }
        for (n, sign) in [(m.a, -1.0), (m.b, 1.0)] {
            let sum = &mut sums[n * seconds + m.k / PER_SECOND];
            sum[0] += sign * r.clamp(-1.0, 1.0);
            sum[1] += 1.0;
        }
    }
    let mean = |s: &[f64; 2]| if s[1] < LEAST_TDOA as f64 { f64::NAN } else { s[0] / s[1] };
    f.ids
        .iter()
        .zip(sums.chunks(seconds.max(1)))
        .map(|(id, sums)| Line {
            channel: Channel::Uwb,
            kind: Kind::Mean,
            anchor: Some(*id),
            values: sums.iter().map(mean).collect(),
        })
        .collect()
}

fn regressors(f: &Flight<'_>) -> Vec<Regressor> {
    let hover_hz = f.nominal.vehicle.hover_hz();
    let clear = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
        let all: Vec<f64> =
            (0..f.len()).map(|k| if f.clear[k] { value(k) } else { f64::NAN }).collect();
        by_second(&all).0
    };
    let of = |name, value: &dyn Fn(usize) -> f64| Regressor { name, values: clear(value) };
    vec![
        of("forward speed × flap rate over hover, m/s", &|k| {
            f.vel_B_mps[k].x * f.flap_hz[k] / hover_hz
        }),
        of("sideways speed × flap rate over hover, m/s", &|k| {
            f.vel_B_mps[k].y * f.flap_hz[k] / hover_hz
        }),
        of("downward speed, m/s", &|k| f.vel_B_mps[k].z),
        of("horizontal speed, m/s", &|k| f.states[k].vel_E_mps.xy().norm()),
        of("height of the feet, m", &|k| f.height_m[k]),
        of("thrust over weight", &|k| f.thrust_ratio(k)),
        of("supply voltage, V", &|k| f.line.supply_v[k]),
        of("cosine of the heading", &|k| f.yaw_rad[k].cos()),
        of("sine of the heading", &|k| f.yaw_rad[k].sin()),
        of("yaw rate, rad/s", &|k| f.line.rate_B_radps[k].z),
        of("roll setpoint, rad", &|k| f.line.setpoint_rad[k][0]),
        of("pitch setpoint, rad", &|k| f.line.setpoint_rad[k][1]),
        of("place north, m", &|k| f.states[k].pos_E_m.x),
        of("place east, m", &|k| f.states[k].pos_E_m.y),
        of("time since take-off, s", &|k| f.line.t_s[k]),
    ]
}

/// Horizontal force residual by place, turned into the Earth frame.
fn forces(f: &Flight<'_>) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0; 3]; uwb::SIDE * uwb::SIDE];
    for (k, r) in force::residuals(f).iter().enumerate() {
        if !f.clear[k] || !r.iter().all(|v| v.is_finite()) {
            continue;
        }
        let (sin, cos) = f.yaw_rad[k].sin_cos();
        let sum = &mut sums[uwb::voxel(f, &f.states[k].pos_E_m)];
        sum[0] += cos * r.x - sin * r.y;
        sum[1] += sin * r.x + cos * r.y;
        sum[2] += 1.0;
    }
    sums.iter()
        .map(|s| {
            let visited = s[2] >= LEAST_PLACE_POINTS as f64;
            if visited { [s[0] / s[2], s[1] / s[2]] } else { [f64::NAN; 2] }
        })
        .collect()
}

fn pairs(f: &Flight<'_>, rows: &uwb::Rows) -> Vec<(AnchorId, AnchorId, f64)> {
    let n = f.ids.len();
    let mut sums = vec![[0.0; 2]; n * n];
    for (m, r) in f.tdoa.iter().zip(&rows.r_m) {
        if f.clear[m.k] {
            // Pairs are kept with the lower anchor first.
            let (a, b, sign) = if m.a < m.b { (m.a, m.b, 1.0) } else { (m.b, m.a, -1.0) };
            sums[a * n + b][0] += sign * r.clamp(-1.0, 1.0);
            sums[a * n + b][1] += 1.0;
        }
    }
    let mut out = Vec::new();
    for a in 0..n {
        for b in a + 1..n {
            let s = sums[a * n + b];
            let mean = if s[1] < 4.0 * LEAST_TDOA as f64 { f64::NAN } else { s[0] / s[1] };
            out.push((f.ids[a], f.ids[b], mean));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_seconds_are_means_and_unknown_ones_stay_unknown() {
        let mut values = vec![2.0; PER_SECOND];
        values.extend(vec![f64::NAN; PER_SECOND]);
        values.extend([1.0, 3.0, 1.0, 3.0, f64::NAN]);
        let (means, spreads) = by_second(&values);
        assert_eq!(means.len(), 3);
        assert!(
            (means[0] - 2.0).abs() < 1e-12 && means[1].is_nan() && (means[2] - 2.0).abs() < 1e-12
        );
        assert!(spreads[1].is_nan() && (spreads[2] - 0.5 * (4.0f64 / 3.0).ln()).abs() < 1e-9);
    }
}
