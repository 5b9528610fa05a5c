//! The search for the PID gains: once, for version `raw`, on seeds that no score is taken on.
//!
//! Both versions then fly the gains found here, so `modified` gains nothing from a badly tuned
//! `raw`.
//!
//! **Cost.** Per axis: the metric of the step tests itself, mean |truth - command| over the window
//! divided by the size of the step, averaged over seeds and both sizes, plus what the vehicle
//! overshoots by more than [`OVERSHOOT_SHARE`] of the step: rooms have walls, and people stand next
//! to the vehicle. It is the **worst over [`crate::variation::VARIATIONS`]** of the vehicle, not the value at the
//! nominal one. A search at the nominal plant alone ends where that one plant just does not
//! oscillate; its gains have no margin, and nobody would fly them. The variations are what every
//! vehicle of this kind may bring (a slow board, a late link, drag of other wings, a spent battery,
//! a heading that is not north) and the classic gain margin of 6 dB on each loop.
//!
//! Margins are taken with a filter that knows drag. The filter of `raw` does not, so it takes any
//! lean for a velocity that is not there, and to a loop that looks like damping. Gains that live on
//! this error swing as soon as the estimate is right.
//!
//! A flight that crashes or leaves its programme costs [`FAILED`]. Landing is no part of it.
//!
//! **Search.** x, y and z are searched side by side, each with its gains and its cost: steps go along
//! one axis at a time. On each an evolution strategy (1 + λ) with a step length that is raised after
//! a success and lowered after failure (Rechenberg's rule); gains are varied in logarithm where
//! their scale is one. What one axis finds may hurt another (a vehicle that swings in x sinks), so
//! the set that results is flown again, together and axis by axis, and kept if the sum falls.
//!
//! **Left alone.** `pos_xy_d_frac` and `pos_z_d_frac`, which away from limits only rescale the
//! others (`P·e - d·v` is a smaller P behind a velocity loop of gain `1 + d`), and the filter of D.

use rand::RngExt;
use rand::SeedableRng;
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;

use crate::steps::{SIZES_M, StepScore, mean_of};
use crate::variation::Variation;
use haltere_core::control::{ControlGains, Tunable};

/// Cost of a flight that failed: worse than standing still, which costs 1.
pub const FAILED: f64 = 2.0;
/// Overshoot that is free, share of the step: the usual 10 %.
const OVERSHOOT_SHARE: f64 = 0.10;
/// Children of a generation.
const CHILDREN: usize = 6;
/// Step length at the start, in natural logarithms or shares of the range.
const STEP: f64 = 0.25;
const STEP_RANGE: [f64; 2] = [0.01, 0.5];
/// Factors on the step length (Rechenberg's one-fifth rule for λ children).
const LONGER: f64 = 1.3;
const SHORTER: f64 = 0.85;

/// Gains of each axis, by name.
const AXIS_GAINS: [&[&str]; 3] = [
    &["pos_x_p_per_s", "vel_x_p_rad_per_mps", "vel_x_i_rad_per_m", "vel_x_d_rad_per_mps2"],
    &["pos_y_p_per_s", "vel_y_p_rad_per_mps", "vel_y_i_rad_per_m", "vel_y_d_rad_per_mps2"],
    &[
        "pos_z_p_per_s",
        "pos_z_i_per_s2",
        "vel_z_p_frac_per_mps",
        "vel_z_i_frac_per_m",
        "vel_z_d_frac_per_mps2",
    ],
];

/// Cost of the scores of one flight, per axis.
pub fn cost(scores: &[StepScore]) -> [f64; 3] {
    std::array::from_fn(|axis| {
        let share = |size_m: f64| {
            let mean = |pick: fn(&StepScore) -> f64| mean_of(scores, axis, size_m, pick);
            let error = mean(|s| s.position_mae_m).map_or(FAILED, |e| e / size_m);
            let overshoot = mean(|s| s.overshoot_m).map_or(FAILED, |o| o / size_m);
            error + (overshoot - OVERSHOOT_SHARE).max(0.0)
        };
        SIZES_M.into_iter().map(share).sum::<f64>() / SIZES_M.len() as f64
    })
}

/// How the worst vehicle fares, per axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Worst {
    /// Its cost.
    pub cost: f64,
    /// Its place in the list of variations.
    pub variation: usize,
}

/// Where the search stands.
#[derive(Debug, Clone)]
pub struct Progress {
    /// Generation, from 1.
    pub generation: usize,
    /// The best gains.
    pub gains: ControlGains,
    /// Their cost, per axis.
    pub best: [Worst; 3],
    /// Step lengths, per axis.
    pub step: [f64; 3],
}

/// Searches from `start`. `fly` gives the cost per axis of gains on one variation and seed.
pub fn search(
    start: &ControlGains,
    variations: &[Variation],
    seeds: &[u64],
    generations: usize,
    fly: impl Fn(&ControlGains, &Variation, u64) -> [f64; 3] + Sync,
    mut tell: impl FnMut(&Progress),
) -> (ControlGains, [Worst; 3]) {
    // All flights of a generation at once: they are many and short.
    let evaluate = |sets: &[ControlGains]| -> Vec<[Worst; 3]> {
        let jobs: Vec<(usize, usize, u64)> = (0..sets.len())
            .flat_map(|g| (0..variations.len()).map(move |v| (g, v)))
            .flat_map(|(g, v)| seeds.iter().map(move |seed| (g, v, *seed)))
            .collect();
        let costs: Vec<[f64; 3]> =
            jobs.par_iter().map(|(g, v, seed)| fly(&sets[*g], &variations[*v], *seed)).collect();
        let per_variation = seeds.len();
        costs
            .chunks(per_variation * variations.len())
            .map(|of_set| {
                std::array::from_fn(|axis| {
                    of_set
                        .chunks(per_variation)
                        .map(|c| c.iter().map(|c| c[axis]).sum::<f64>() / per_variation as f64)
                        .enumerate()
                        .map(|(variation, cost)| Worst { cost, variation })
                        .max_by(|a, b| a.cost.total_cmp(&b.cost))
                        .unwrap_or(Worst { cost: FAILED, variation: 0 })
                })
            })
            .collect()
    };
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut best = *start;
    let mut worst = evaluate(&[best])[0];
    let mut step = [STEP; 3];
    for generation in 1..=generations {
        let children: Vec<ControlGains> =
            (0..CHILDREN).map(|_| vary(&best, step, &mut rng)).collect();
        let costs = evaluate(&children);
        let winners: [Option<usize>; 3] = std::array::from_fn(|axis| {
            (0..CHILDREN)
                .min_by(|a, b| costs[*a][axis].cost.total_cmp(&costs[*b][axis].cost))
                .filter(|i| costs[*i][axis].cost < worst[axis].cost)
        });
        for axis in 0..3 {
            step[axis] *= if winners[axis].is_some() { LONGER } else { SHORTER };
            step[axis] = step[axis].clamp(STEP_RANGE[0], STEP_RANGE[1]);
        }
        // All winners together, each alone, and the best child as it is.
        let with = |axes: &[usize]| -> ControlGains {
            let mut next = best.as_vector();
            for axis in axes {
                let Some(child) = winners[*axis].map(|i| children[i].as_vector()) else { continue };
                for (k, tunable) in ControlGains::TUNABLES.iter().enumerate() {
                    if AXIS_GAINS[*axis].contains(&tunable.name) {
                        next[k] = child[k];
                    }
                }
            }
            ControlGains::from_vector(next)
        };
        let total = |w: &[Worst; 3]| w.iter().map(|w| w.cost).sum::<f64>();
        if winners.iter().any(Option::is_some) {
            let sets = [with(&[0, 1, 2]), with(&[0]), with(&[1]), with(&[2])];
            let flown = evaluate(&sets);
            let candidates = sets.iter().zip(&flown).chain(children.iter().zip(&costs));
            let first = candidates.min_by(|a, b| total(a.1).total_cmp(&total(b.1)));
            if let Some((gains, cost)) = first.filter(|(_, cost)| total(cost) < total(&worst)) {
                best = *gains;
                worst = *cost;
            }
        }
        tell(&Progress { generation, gains: best, best: worst, step });
    }
    (best, worst)
}

fn vary(gains: &ControlGains, step: [f64; 3], rng: &mut Xoshiro256PlusPlus) -> ControlGains {
    let mut vector = gains.as_vector();
    for (value, tunable) in vector.iter_mut().zip(ControlGains::TUNABLES) {
        let Some(axis) = AXIS_GAINS.iter().position(|names| names.contains(&tunable.name)) else {
            continue;
        };
        // Half of the gains stay: single causes are found sooner.
        if rng.random_bool(0.5) {
            continue;
        }
        let draw: f64 = rng.sample(StandardNormal);
        let Tunable { low, high, log_scale, .. } = tunable;
        *value = if log_scale {
            *value * (step[axis] * draw).exp()
        } else {
            *value + step[axis] * draw * 0.3 * (high - low)
        }
        .clamp(low, high);
    }
    ControlGains::from_vector(vector)
}
