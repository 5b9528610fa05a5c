//! `haltere-lab paper --identify`: gains of the source from its cells of `raw` alone; it states none.
//!
//! **K.** While a response does not overshoot, the mean velocity setpoint is K times the mean position error, and its
//! integral is the step: K = (vel + step/T)/pos with the two cells of a step and the window T.
//!
//! Both steps of an axis should give the same K; they do within 13 %.
//!
//! **P and I** of the velocity loop by flights of `raw` in the nominal world and on seeds of their own: for each window, with
//! K as its cells have it ([`K_OFF`]), the least misfit to the twelve cells, not far from a guess ([`FAR`]). The search walks from the vehicle's public firmware in
//! ever smaller steps. The window is the shortest whose misfit is at most [`MOST_MISFIT`]. Longer ones fit still better, since
//! with them responses may be slower: [`FOUND`] holds more than one, so that the page shows what every one predicts.
//! Nothing of `modified` or `paper` is flown or looked at.

use anyhow::{Result, bail};
use haltere::cli::print as say;
use haltere_core::control::drag::DragReading;
use haltere_core::control::{ControlConfig, ControlGains, Version, margins};
use haltere_model::PlantConfig;
use haltere_pilot::PilotConfig;
use rand::{RngExt as _, SeedableRng};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;

use super::table_3::{Cell, Flown, Quantity, WINDOWS_S, fly, misfit, misfit_of};
use crate::compare::in_plant;
use crate::steps::{AXES, SIZES_M};

/// K, P and I by axis: 1/s; rad per m/s and rad per m forward and right, share of thrust per m/s and per m up.
pub type Loops = [[f64; 3]; 3];

/// Sets that are flown: windows by their place in [`WINDOWS_S`], and loops. The guess near which the search begins, with a
/// misfit of 1.72 over 10 s; what the search finds there, 1.72 on its own seeds; and what it found with K free up to 15 %
/// beyond the cells, 1.70. The cells of `raw` do not tell them apart; `paper` swings in x with the last two.
pub const FOUND: [(usize, Loops); 3] = [
    (8, [[2.2, 0.21, 0.035], [2.0, 0.14, 0.035], [3.0, 0.374, 0.0632]]),
    (8, [[2.261, 0.267, 0.038], [1.897, 0.161, 0.043], [3.236, 0.365, 0.037]]),
    (8, [[3.161, 0.243, 0.030], [1.919, 0.151, 0.035], [3.056, 0.359, 0.029]]),
];
/// The one that stands for the source: chosen after all had been flown, since it flies every experiment.
pub const CHOSEN: usize = 0;
/// Its window.
pub const WINDOW: usize = FOUND[CHOSEN].0;
/// Misfit of `raw` that is good enough.
pub const MOST_MISFIT: f64 = 1.7;

/// Seeds of the search; no experiment is flown on them.
const SEEDS: std::ops::Range<u64> = 9_100..9_108;
/// Windows that are searched, by their place in [`WINDOWS_S`]: 10 and 12 s. In shorter ones the K
/// of z hardly fly, and the misfit is above the most (9 s: 1.9).
const SEARCHED: [usize; 2] = [8, 9];
/// What it costs to leave the start, by squared logarithm of P; a quarter of it for I. The cells of `raw` alone leave P and
/// how far K lies above its calm end open: see the second of [`FOUND`].
const FAR: f64 = 0.5;
/// K lies by this share below the less of what the cells say: they agree no better, responses do overshoot, which makes it
/// look larger, and this end is the calm one.
const K_OFF: f64 = 0.1;
/// P and I where it begins: a guess near the public firmware (crazyflie-firmware of 2022, platform_defaults_flapper.h:
/// PID_VEL_X_KP 15, Y 10 deg per m/s, KI 1); upward what flies.
const START: [[f64; 2]; 3] = [[0.21, 0.035], [0.14, 0.035], [0.3, 0.039]];
/// Spread of the rounds, in natural logarithms, and flights of each.
const SPREADS: [f64; 6] = [0.3, 0.3, 0.2, 0.2, 0.1, 0.1];
const FLIGHTS: usize = 24;
/// Sets of an axis that are flown again on all seeds: single flights flatter, and a set that falls once is none.
const FINALISTS: usize = 6;

/// The source's controller with these loops, P and I alone, and its law v(θ).
///
/// With a tilt limit of 45 deg `raw` sinks in steps, since nothing of it compensates tilt, and falls in one flight of five.
pub fn with(loops: &Loops, control: &ControlConfig, version: Version) -> ControlConfig {
    let [[k_x, p_x, i_x], [k_y, p_y, i_y], [k_z, p_z, i_z]] = *loops;
    let gains = ControlGains {
        pos_x_p_per_s: k_x,
        pos_y_p_per_s: k_y,
        pos_z_p_per_s: k_z,
        pos_z_i_per_s2: 0.0,
        vel_x_p_rad_per_mps: p_x,
        vel_x_i_rad_per_m: i_x,
        vel_x_d_rad_per_mps2: 0.0,
        vel_y_p_rad_per_mps: p_y,
        vel_y_i_rad_per_m: i_y,
        vel_y_d_rad_per_mps2: 0.0,
        vel_z_p_frac_per_mps: p_z,
        vel_z_i_frac_per_m: i_z,
        vel_z_d_frac_per_mps2: 0.0,
        ..control.gains
    };
    let mut control = ControlConfig { version, gains, ..control.clone() };
    control.limits.tilt_deg = 30.0;
    control.drag.reading = DragReading::VelocityOfAngle;
    control
}

/// K of an axis by the cells of a version, 1/s: steps of 1 m and of 2 m.
pub fn position_gains(axis: usize, version: usize, window_s: f64) -> [f64; 2] {
    [0, 1].map(|size| {
        let [pos, vel] = Quantity::ALL.map(|of| Cell { of, axis, size }.source()[version]);
        (vel + SIZES_M[size] / window_s) / pos
    })
}

/// A set that was flown, and its misfit by axis.
type Tried = (Loops, [f64; 3]);

/// Searches and prints window by window: the loops and their misfit.
pub fn run(pilot: &PilotConfig) -> Result<bool> {
    let mut chosen = None;
    for window in SEARCHED {
        let window_s = WINDOWS_S[window];
        let Some((loops, cost)) = search(pilot, window) else {
            say(&format!("{window_s} s: does not fly\n"))?;
            continue;
        };
        let flights: Result<Vec<Flown>> = SEEDS.map(|seed| fly_one(pilot, &loops, seed)).collect();
        let sum = misfit(&flights?, window);
        say(&format!("{window_s} s: {loops:.3?}, misfit {sum:.2}, cost by axis {cost:.2?}\n"))?;
        if sum <= MOST_MISFIT && chosen.is_none() {
            chosen = Some((window_s, loops));
        }
    }
    let Some((window_s, loops)) = chosen else { bail!("no window has a misfit of {MOST_MISFIT}") };
    say(&format!("# {window_s} s\n[control.gains]\n"))?;
    say(&toml::to_string(&with(&loops, &pilot.control, Version::Raw).gains)?)?;
    Ok(true)
}

/// The best loops of a window.
fn search(pilot: &PilotConfig, window: usize) -> Option<Tried> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
    let one = SEEDS.start..SEEDS.start + 1;
    let start: Loops = [0, 1, 2].map(|axis| {
        let [a, b] = position_gains(axis, 0, WINDOWS_S[window] as f64);
        [(1.0 - K_OFF) * a.min(b), START[axis][0], START[axis][1]]
    });
    let mut all = flown(pilot, window, vec![start], one.clone());
    for spread in SPREADS {
        let best = best(&all)?;
        // One axis is moved at a time: what makes it swing shakes the others.
        let mut near = |moved: usize| -> Loops {
            let mut loops = best.0;
            for v in &mut loops[moved][1..] {
                *v *= (spread * rng.sample::<f64, _>(StandardNormal)).exp();
            }
            loops
        };
        let sets = (0..FLIGHTS).map(|k| near(k % AXES.len())).collect();
        all.extend(flown(pilot, window, sets, one.clone()));
    }
    let ranked = |axis: usize| {
        let mut order: Vec<&Tried> = all.iter().collect();
        order.sort_by(|a, b| a.1[axis].total_cmp(&b.1[axis]));
        order.iter().take(FINALISTS).map(|t| t.0[axis]).collect::<Vec<_>>()
    };
    let [x, y, z] = [0, 1, 2].map(ranked);
    let finalists = x.into_iter().zip(y).zip(z).map(|((x, y), z)| [x, y, z]).collect();
    let again = flown(pilot, window, finalists, SEEDS);
    // The best of each axis together, or else the best that flew together.
    let together = flown(pilot, window, vec![best(&again)?.0], SEEDS);
    let sum = |t: &Tried| t.1.iter().sum::<f64>();
    together.into_iter().chain(again).min_by(|a, b| sum(a).total_cmp(&sum(b)))
}

/// The best of each axis, and its misfit there.
fn best(all: &[Tried]) -> Option<Tried> {
    let of = |axis: usize| all.iter().min_by(|a, b| a.1[axis].total_cmp(&b.1[axis]));
    let [x, y, z] = [of(0)?, of(1)?, of(2)?];
    Some(([x.0[0], y.0[1], z.0[2]], [x.1[0], y.1[1], z.1[2]]))
}

/// Flies `raw` once.
fn fly_one(pilot: &PilotConfig, loops: &Loops, seed: u64) -> Result<Flown> {
    // Neither version may be refused for its margins, of which `paper` has less. That is calculated; it is not flown.
    if let Some(refusal) = margins::refusal(&with(loops, &pilot.control, Version::Paper)) {
        bail!("{refusal}");
    }
    let control = with(loops, &pilot.control, Version::Raw);
    Ok(fly(&mut in_plant(pilot, &control, PlantConfig::hall(seed))?)?.0)
}

/// Misfit of `raw` with each set over these seeds; a set that cannot fly the programme once is none.
fn flown(
    pilot: &PilotConfig,
    window: usize,
    sets: Vec<Loops>,
    seeds: std::ops::Range<u64>,
) -> Vec<Tried> {
    let of = |loops: Loops| -> Option<Tried> {
        let flights: Result<Vec<Flown>> =
            seeds.clone().map(|seed| fly_one(pilot, &loops, seed)).collect();
        let flights = flights.ok()?;
        let far = |axis: usize| {
            let [_, p, i] = loops[axis];
            let [p_0, i_0] = START[axis];
            FAR * (p / p_0).ln().powi(2) + 0.25 * FAR * (i / i_0).ln().powi(2)
        };
        Some((loops, [0, 1, 2].map(|axis| misfit_of(&flights, window, axis) + far(axis))))
    };
    sets.into_par_iter().filter_map(of).collect()
}
