//! What errors of ranging look like where the truth is known: recorded flights beside simulated ones.

use std::collections::BTreeMap;
use std::fmt::Write;

use crate::paths::mission;
use crate::util_flights::file::{Event, Flight, Sample};
use haltere_core::frames::{E, Vec3};
use haltere_core::measure::{AnchorId, ReferencePose};
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_model::PlantConfig;
use haltere_model::effects::{EffectConfig, EffectSet};
use haltere_model::lockstep::{Lockstep, fly_watched};
use haltere_pilot::PilotConfig;
use nalgebra::{DMatrix, DVector};

/// Above this height of the tag a flight is judged in the air, m: as the estimator's page.
const AIR_M: f64 = 0.5;
/// Longest gap between poses, s.
const GAP_S: f64 = 0.1;
/// Errors of a pair are averaged over this, s, to see what wanders below what is white.
const BIN_S: f64 = 0.25;
/// Least samples of a bin, and bins of a pair.
const LEAST: usize = 3;
/// Anchors below this are low, m.
const LOW_M: f64 = 1.0;
/// Of a normal distribution: standard deviation over median absolute deviation.
const MAD_TO_STD: f64 = 1.4826;
/// Corners of the simulated flights from the middle, m: 1.5 m away, as the recorded circles.
const ROUND: [[f64; 2]; 6] =
    [[1.5, 0.0], [0.75, 1.3], [-0.75, 1.3], [-1.5, 0.0], [-0.75, -1.3], [0.75, -1.3]];
/// How many of them are flown: twice round, and back to the first.
const FLOWN: usize = 13;
/// Longest simulated flight, s.
const LIMIT_S: f64 = 150.0;
/// Heights of the tag between which the floor is judged, m.
pub const BANDS_M: [[f64; 2]; 6] =
    [[-1.0, 0.05], [0.05, 0.1], [0.1, 0.15], [0.15, 0.3], [0.3, 1.0], [1.0, 9.0]];

/// Errors of ranging in one flight.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct Ranging {
    /// Which flight.
    pub flight: String,
    /// TDOA in the air of which the truth is known.
    pub samples: usize,
    /// Share of TDOA larger than the separation of their anchors: they are refused by every filter, and left out below.
    pub impossible: f64,
    /// Mean speed in the air, m/s.
    pub speed_mps: f64,
    /// From sample to sample of a pair, one sigma, m.
    pub white_m: f64,
    /// Median of a pair over the flight, root mean square over the pairs, m.
    pub constant_m: f64,
    /// What wanders about that median, robust sigma, m.
    pub wander_m: f64,
    /// It has half of its correlation after this time, s.
    pub half_s: f64,
    /// Share of samples that are off by more than 0.5 and 1 m.
    pub beyond: [f64; 2],
    /// Longest time that a pair is off by more than 0.5 m, s.
    pub longest_s: f64,
    /// How much too far the low anchors read, against the high ones, by height of the tag (`BANDS_M`), m.
    pub low_m: [Option<f64>; 6],
}

/// One TDOA and its error.
struct One {
    t_s: f64,
    pair: (AnchorId, AnchorId),
    error_m: f64,
    height_m: f64,
}

/// Judges a flight. `p_BT_B_m`: its tag.
pub fn ranging(flight: &Flight, p_BT_B_m: [f64; 3]) -> Ranging {
    let track = track(flight, p_BT_B_m);
    let (all, impossible) = errors(flight, &track);
    let air: Vec<&One> = all.iter().filter(|one| one.height_m > AIR_M).collect();
    let mut pairs: BTreeMap<_, Vec<&One>> = BTreeMap::new();
    air.iter().for_each(|one| pairs.entry(one.pair).or_default().push(one));
    let (mut steps, mut medians, mut wander, mut longest_s) = (vec![], vec![], vec![], 0f64);
    for ones in pairs.values() {
        let close = ones.windows(2).filter(|w| w[1].t_s - w[0].t_s < GAP_S);
        steps.extend(close.map(|w| (w[1].error_m - w[0].error_m).abs()));
        let bins = bins(ones);
        if bins.len() < LEAST {
            continue;
        }
        let middle = median(bins.iter().map(|(_, e)| *e).collect());
        medians.push(middle);
        longest_s = longest_s.max(longest_run_s(&bins));
        wander.push(bins.iter().map(|(k, e)| (*k, e - middle)).collect::<Vec<_>>());
    }
    let wander_m = MAD_TO_STD * median(wander.iter().flatten().map(|(_, e)| e.abs()).collect());
    let share = |limit: f64| {
        air.iter().filter(|one| one.error_m.abs() > limit).count() as f64 / air.len().max(1) as f64
    };
    Ranging {
        flight: flight.name.clone(),
        samples: air.len(),
        impossible,
        speed_mps: speed_mps(&track),
        white_m: MAD_TO_STD * median(steps) / std::f64::consts::SQRT_2,
        constant_m: (medians.iter().map(|m| m * m).sum::<f64>() / medians.len().max(1) as f64)
            .sqrt(),
        wander_m,
        half_s: half_s(&wander, 3.0 * wander_m),
        beyond: [share(0.5), share(1.0)],
        longest_s,
        low_m: BANDS_M.map(|band| low_m(flight, &all, band)),
    }
}

/// Every recorded flight, and simulated ones in each room of the simulator.
pub fn beside_simulated(flights: &[Flight]) -> anyhow::Result<Vec<Ranging>> {
    let mut rows: Vec<_> = flights.iter().map(|f| ranging(f, f.p_BT_B_m())).collect();
    for (name, text) in ROOMS {
        for seed in SEEDS {
            let plant = room(text, seed)?;
            let tag_B_m = plant.vehicle.body.tag_B_m;
            let flight = simulated(&format!("simulated, {name}, seed {seed}"), plant)?;
            // Where the survey check saw a cabinet before the take-off nothing flew.
            rows.extend(Some(ranging(&flight, tag_B_m)).filter(|row| row.samples > 0));
        }
    }
    Ok(rows)
}

/// Seeds of the simulated flights.
const SEEDS: std::ops::Range<u64> = 40..43;
/// Rooms of the simulator: the default one, and a scenario.
pub const ROOMS: [(&str, &str); 2] =
    [("hall", ""), ("cluttered", include_str!("../../../scenarios/cluttered.toml"))];

/// What of a scenario changes ranging.
#[derive(serde::Deserialize)]
struct Room {
    #[serde(default)]
    effects: EffectConfig,
}

/// The hall with what a scenario does to ranging.
pub fn room(scenario: &str, seed: u64) -> anyhow::Result<PlantConfig> {
    let scenario: Room = toml::from_str(scenario)?;
    let effects = EffectSet::from_config(&scenario.effects)?;
    Ok(PlantConfig { effects, ..PlantConfig::hall(seed) })
}

/// A simulated flight as a recording of one: round the middle of a room, at the height and distance of the recorded
/// ones. The filter that flies has no part in it but that it steers.
pub fn simulated(name: &str, plant: PlantConfig) -> anyhow::Result<Flight> {
    let survey = plant.survey.clone();
    let mut pilot = PilotConfig::default();
    pilot.flight.gear_height_m = plant.vehicle.body.gear_m;
    pilot.estimator.rest_height_m = Some(plant.vehicle.body.gear_m);
    let mut world = Lockstep::new(plant, pilot, &survey)?;
    let mut events = Vec::new();
    let watch = |world: &mut Lockstep| {
        let truth = world.truth();
        let at = world.host_now();
        world.pilot_mut().drain_topics(|topic| {
            if let Topic::Uwb(record) = topic {
                let sample = Sample::Tdoa(record.tdoa);
                events.push(Event { at: record.tdoa.valid_at, sample });
            }
        });
        let pose = ReferencePose {
            valid_at: at,
            received_at: at,
            pos_E_m: truth.pos_E_m,
            attitude: Some(truth.R_EB),
        };
        events.push(Event { at, sample: Sample::Pose(pose) });
    };
    let corners: Vec<_> = ROUND.into_iter().cycle().take(FLOWN).collect();
    fly_watched(&mut world, &mission(&corners), LIMIT_S, watch)?;
    Ok(Flight { name: name.to_owned(), survey, events })
}

/// Where the tag was: seconds and Earth frame, m.
fn track(flight: &Flight, p_BT_B_m: [f64; 3]) -> Vec<(f64, Vec3<E>)> {
    let lever = p_BT_B_m;
    let poses = flight.events.iter().filter_map(|event| match &event.sample {
        Sample::Pose(pose) => Some(pose),
        _ => None,
    });
    poses
        .map(|pose| {
            // Without attitude the vehicle is taken as level: a lever of 9 cm at 10 degrees is 1.6 cm.
            let offset = match pose.attitude {
                Some(R_EB) => R_EB * Vec3::new(lever[0], lever[1], lever[2]),
                None => Vec3::new(0.0, 0.0, lever[2]),
            };
            (pose.valid_at.seconds_since(HostTime::from_us(0)), pose.pos_E_m + offset)
        })
        .collect()
}

/// Errors of all TDOA between poses, pairs in ascending order, and the share that is impossible.
fn errors(flight: &Flight, track: &[(f64, Vec3<E>)]) -> (Vec<One>, f64) {
    let (mut out, mut impossible) = (Vec::new(), 0usize);
    for event in &flight.events {
        let Sample::Tdoa(tdoa) = &event.sample else { continue };
        let t_s = tdoa.valid_at.seconds_since(HostTime::from_us(0));
        let next = track.partition_point(|(t, _)| *t < t_s);
        let (Some(after), Some(before)) = (track.get(next), track.get(next.wrapping_sub(1))) else {
            continue;
        };
        let of_a = flight.survey.position_E_m(tdoa.anchor_a);
        let of_b = flight.survey.position_E_m(tdoa.anchor_b);
        let (Some(of_a), Some(of_b)) = (of_a, of_b) else { continue };
        let dt_s = after.0 - before.0;
        if dt_s > GAP_S || dt_s <= 0.0 {
            continue;
        }
        if tdoa.distance_diff_m.abs() > (of_a - of_b).norm() {
            impossible += 1;
            continue;
        }
        let share = (t_s - before.0) / dt_s;
        let tag_E_m = before.1 + (after.1 - before.1) * share;
        let error_m = tdoa.distance_diff_m - (tag_E_m - of_b).norm() + (tag_E_m - of_a).norm();
        let ascending = tdoa.anchor_a < tdoa.anchor_b;
        let pair =
            if ascending { (tdoa.anchor_a, tdoa.anchor_b) } else { (tdoa.anchor_b, tdoa.anchor_a) };
        let error_m = if ascending { error_m } else { -error_m };
        out.push(One { t_s, pair, error_m, height_m: -tag_E_m.z() });
    }
    let of = out.len() + impossible;
    (out, impossible as f64 / of.max(1) as f64)
}

/// Means of a pair, by number of the bin.
fn bins(ones: &[&One]) -> Vec<(i64, f64)> {
    let mut bins: BTreeMap<i64, Vec<f64>> = BTreeMap::new();
    for one in ones {
        bins.entry((one.t_s / BIN_S).floor() as i64).or_default().push(one.error_m);
    }
    // The median: one wild value is not what wanders.
    bins.into_iter().filter(|(_, e)| e.len() >= LEAST).map(|(k, e)| (k, median(e))).collect()
}

/// Longest run of bins beyond 0.5 m, s.
fn longest_run_s(bins: &[(i64, f64)]) -> f64 {
    let (mut longest, mut run, mut last) = (0, 0, i64::MIN);
    for (k, e) in bins {
        run = match (e.abs() > 0.5, *k == last + 1) {
            (true, true) => run + 1,
            (true, false) => 1,
            (false, _) => 0,
        };
        (longest, last) = (longest.max(run), *k);
    }
    f64::from(longest) * BIN_S
}

/// Lag at which the correlation of what wanders, cut at `most_m`, falls to one half, s; infinite where it never does.
fn half_s(wander: &[Vec<(i64, f64)>], most_m: f64) -> f64 {
    let mut before = 1.0;
    for lag in 1..=80 {
        let (mut sum, mut power, mut n) = (0.0, 0.0, 0usize);
        for bins in wander {
            let by_bin: BTreeMap<i64, f64> = bins.iter().copied().collect();
            for (k, e) in bins {
                if let Some(later) = by_bin.get(&(k + lag)) {
                    let [e, later] = [*e, *later].map(|v| v.clamp(-most_m, most_m));
                    (sum, power, n) =
                        (sum + e * later, power + 0.5 * (e * e + later * later), n + 1);
                }
            }
        }
        if n < 20 {
            break;
        }
        let r = sum / power.max(1e-12);
        if r < 0.5 {
            return BIN_S * (lag as f64 - (0.5 - r) / (before - r).max(1e-9));
        }
        before = r;
    }
    f64::INFINITY
}

/// How much too far the low anchors read on average, m: the errors of the pairs are differences of one number for each
/// anchor, least squares with the high anchors' mean at zero. `None`: too few, or an anchor that nothing joins.
fn low_m(flight: &Flight, all: &[One], [from_m, to_m]: [f64; 2]) -> Option<f64> {
    let mut pairs: BTreeMap<_, Vec<f64>> = BTreeMap::new();
    for one in all.iter().filter(|one| (from_m..to_m).contains(&one.height_m)) {
        pairs.entry(one.pair).or_default().push(one.error_m);
    }
    pairs.retain(|_, errors| errors.len() >= 5);
    let ids = flight.survey.ids();
    let low = |id: AnchorId| flight.survey.position_E_m(id).is_some_and(|p| -p.z() < LOW_M);
    let highs = ids.iter().filter(|id| !low(**id)).count();
    if pairs.len() < ids.len().saturating_sub(1) || highs == 0 || highs == ids.len() {
        return None;
    }
    let mut rows = DMatrix::zeros(pairs.len() + 1, ids.len());
    let mut right = DVector::zeros(pairs.len() + 1);
    for (row, ((a, b), errors)) in pairs.into_iter().enumerate() {
        let place = |id| ids.iter().position(|other| *other == id);
        rows[(row, place(a)?)] = -1.0;
        rows[(row, place(b)?)] = 1.0;
        right[row] = median(errors);
    }
    let last = rows.nrows() - 1;
    for (column, id) in ids.iter().enumerate() {
        rows[(last, column)] = if low(*id) { 0.0 } else { 1.0 / highs as f64 };
    }
    let found = rows.svd(true, true).solve(&right, 1e-9).ok()?;
    let of_low: Vec<f64> =
        ids.iter().zip(found.iter()).filter(|(id, _)| low(**id)).map(|(_, n)| *n).collect();
    Some(of_low.iter().sum::<f64>() / of_low.len() as f64)
}

fn speed_mps(track: &[(f64, Vec3<E>)]) -> f64 {
    let air: Vec<_> = track.iter().filter(|(_, p)| -p.z() > AIR_M).collect();
    // Steps of 0.1 s and more: those of motion capture itself are its noise.
    let (mut path_m, mut time_s, mut from) = (0.0, 0.0, None::<&(f64, Vec3<E>)>);
    for pose in air {
        match from {
            Some(then) if pose.0 - then.0 < GAP_S => continue,
            Some(then) if pose.0 - then.0 < 1.0 => {
                path_m += (pose.1 - then.1).norm();
                time_s += pose.0 - then.0;
            }
            _ => {}
        }
        from = Some(pose);
    }
    path_m / f64::max(time_s, 1e-9)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

const ABOUT: &str = "\
# Ranging: what simulated errors are held against

Written by `haltere-lab recorded DIR --ranging > docs/RANGING.md`; do not edit by hand. DIR holds `full/` and `tdoa_pos/` of
UTIL (Zhao, Goudar, Qiao, Schoellig, IJRR 43(10), 2024), which is no part of this repository.

An error is a TDOA minus what the surveyed anchors and motion capture (in simulation: the truth) make of it. In the air:
tag above 0.5 m. *White*: from sample to sample of a pair, one sigma. *Constant*: the median of a pair over the flight,
root mean square over the pairs. *Wanders*: means over 0.25 s about that median, robust sigma; *half after*: the time in
which it loses half of its correlation. *Longest*: for so long one pair was off by more than 0.5 m. *Low anchors*: how much
too far those below 1 m read against the others, m, with the tag below 0.05 m, up to 0.1, 0.15, 0.3 and 1 m, and above. TDOA
that are larger than the separation of their anchors are impossible, refused by the filter, and left out.

The default hall of the simulator is a clear room: `const1` and `const2` without the constant. Its scenario `cluttered`
(`haltere-sim print scenario cluttered`) is the room of April and of `const4-trial3` and `trial5`: errors of 0.1 m that
stay, others that wander, metal cabinets before two anchors, a person who walks, and a floor that hides the low anchors.
The simulated errors still wander over twice the distance (some 0.9 m instead of 0.4 m), and where no cabinet stands in the
way they have thinner tails.
";

/// Prints flights beside each other.
pub fn print_ranging(out: &mut impl Write, rows: &[Ranging]) -> std::fmt::Result {
    writeln!(out, "{ABOUT}")?;
    writeln!(
        out,
        "| flight | speed, m/s | white, m | constant, m | wanders, m | half after, s | over 0.5 m, % | over 1 m, % | longest, s \
         | low anchors, m |\n|{}",
        "---|".repeat(10)
    )?;
    for row in rows {
        let low = row.low_m.map(|m| m.map_or("-".to_owned(), |m| format!("{m:+.2}"))).join(", ");
        let [half, one] = row.beyond.map(|share| 100.0 * share);
        writeln!(
            out,
            "| {} | {:.2} | {:.3} | {:.3} | {:.3} | {:.2} | {half:.1} | {one:.1} | {:.1} | {low} |",
            row.flight,
            row.speed_mps,
            row.white_m,
            row.constant_m,
            row.wander_m,
            row.half_s,
            row.longest_s
        )?;
    }
    Ok(())
}
