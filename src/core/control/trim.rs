//! The trimming procedure: from a hover to the trims that make level flight level.
//!
//! The vehicle hovers on the spot for some tens of seconds. What the controller had to send for
//! that, on average, is what has to be sent when level is wanted: its feedback, integrators and the
//! trims in force are all inside the setpoint, so new trims come out absolute, not as a change.
//!
//! **Equations.** In each block of 3 s, `roll = mean(φ_sent) − φ_drag`, `pitch = mean(θ_sent) −
//! θ_drag`, `yaw = mean(wrap(ψ_sent − ψ))`, where φ_drag, θ_drag are the drag law at the mean
//! velocity of the block: a slow drift needs a lean of its own, which is no trim. A trim is the
//! mean over n blocks.
//!
//! **Standard error.** Samples at 100 Hz follow one another (the loops swing over seconds), so
//! the error is that of the block means, `s/√n`; a block is longer than a swing. What neighbouring
//! blocks share makes it a tenth too small for swings of half a second.
//!
//! **Left out.** A steady draught leans the vehicle as a wrong trim does; hover twice with opposite
//! headings to tell them apart.

use std::fmt::{self, Display, Formatter};

use serde::Serialize;

use crate::control::config::{MAX_TRIM_DEG, MAX_YAW_TRIM_DEG};
use crate::control::drag::DragConfig;
use crate::frames::wrap_pi_rad;
use crate::time::HostTime;

/// Length of a block whose mean counts as one independent reading, s.
const BLOCK_S: f64 = 3.0;
/// Fewest blocks: with five the standard error itself is known within a third.
const MIN_BLOCKS: usize = 5;
/// Two samples farther apart than this are not one hover, s.
const MAX_GAP_S: f64 = 0.2;
/// Largest root mean square of horizontal and of vertical speed in a hover, m/s: twice what a
/// hover shows (0.15 m/s with UWB).
const MAX_RMS_MPS: f64 = 0.3;
/// Largest mean horizontal speed, m/s: beyond, it is a flight.
const MAX_DRIFT_MPS: f64 = 0.1;
/// Largest step of the mean setpoint from the first to the second half, degrees: beyond, the
/// integrators had not settled.
const MAX_HALVES_DEG: f64 = 2.0;

/// One control step of a hover.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoverSample {
    /// When.
    pub at: HostTime,
    /// Roll setpoint as sent, trims included, rad.
    pub roll_rad: f64,
    /// Pitch setpoint as sent, trims included, rad.
    pub pitch_rad: f64,
    /// Yaw setpoint as sent, trims included, rad.
    pub yaw_rad: f64,
    /// Yaw as estimated, rad.
    pub yaw_estimate_rad: f64,
    /// Estimated velocity forward, right, down in the heading frame, m/s.
    pub vel_heading_mps: [f64; 3],
    /// Whether tilt or thrust was cut in this step.
    pub saturated: bool,
}

/// One trim with its standard error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Trim {
    /// Value for the configuration, deg.
    pub value_deg: f64,
    /// One sigma of it, deg.
    pub std_deg: f64,
}

/// Result of the procedure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Trims {
    /// For `control.trims.roll_deg`.
    pub roll: Trim,
    /// For `control.trims.pitch_deg`.
    pub pitch: Trim,
    /// For `control.trims.yaw_deg`.
    pub yaw: Trim,
    /// Length of the hover used, s.
    pub hover_s: f64,
    /// Blocks averaged.
    pub blocks: usize,
}

/// Why a log gives no trims.
#[derive(Debug, Clone, PartialEq)]
pub enum TrimRefusal {
    /// Too short.
    TooShort {
        /// Length, s.
        found_s: f64,
        /// Least length, s.
        needed_s: f64,
    },
    /// Samples are missing or run backwards.
    Gap {
        /// Their distance, s.
        gap_s: f64,
        /// Where, from the first sample, s.
        after_s: f64,
    },
    /// A sample holds NaN or infinity.
    NotANumber {
        /// Where, from the first sample, s.
        after_s: f64,
    },
    /// It moves.
    Moves {
        /// Which speed.
        what: &'static str,
        /// Its size, m/s.
        found_mps: f64,
        /// Largest, m/s.
        allowed_mps: f64,
    },
    /// Limits cut the setpoint.
    Saturated {
        /// Samples at a limit.
        found: usize,
        /// All samples.
        samples: usize,
    },
    /// Setpoints wander.
    NotSettled {
        /// Which angle.
        axis: &'static str,
        /// By how much, deg.
        found_deg: f64,
    },
    /// More than a trim may be.
    TooLarge {
        /// Which trim.
        axis: &'static str,
        /// Its value, deg.
        found_deg: f64,
        /// Largest, deg.
        allowed_deg: f64,
    },
}

impl Display for TrimRefusal {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooShort { found_s, needed_s } => write!(
                f,
                "the hover lasts {found_s:.1} s, needed {needed_s} s: hover longer, or choose a longer part"
            ),
            Self::Gap { gap_s, after_s } => write!(
                f,
                "two samples are {gap_s:.3} s apart after {after_s:.1} s, allowed 0 to {MAX_GAP_S} s"
            ),
            Self::NotANumber { after_s } => {
                write!(
                    f,
                    "the sample {after_s:.1} s after the first holds a value that is no number"
                )
            }
            Self::Moves { what, found_mps, allowed_mps } => write!(
                f,
                "the log does not hover: {what} is {found_mps:.2} m/s, allowed 0 to {allowed_mps} m/s"
            ),
            Self::Saturated { found, samples } => write!(
                f,
                "tilt or thrust was at its limit in {found} of {samples} samples: what was sent is not \
                 what was needed; hover calmly"
            ),
            Self::NotSettled { axis, found_deg } => write!(
                f,
                "{axis} moves by {found_deg:.1} deg from the first half to the second, allowed \
                 {MAX_HALVES_DEG} deg: leave out the settling after take-off"
            ),
            Self::TooLarge { axis, found_deg, allowed_deg } => write!(
                f,
                "{axis} trim would be {found_deg:.1} deg, allowed {} to {allowed_deg} deg: mend the \
                 vehicle (servo arm, centre of mass, level of the board)",
                -allowed_deg
            ),
        }
    }
}

impl std::error::Error for TrimRefusal {}

/// Trims from a hover. `drag` is the law of the vehicle, used for the residual drift.
pub fn trims_from_hover(samples: &[HoverSample], drag: &DragConfig) -> Result<Trims, TrimRefusal> {
    let needed_s = BLOCK_S * MIN_BLOCKS as f64;
    let (Some(first), Some(last)) = (samples.first(), samples.last()) else {
        return Err(TrimRefusal::TooShort { found_s: 0.0, needed_s });
    };
    check_samples(samples, first.at)?;
    let hover_s = last.at.seconds_since(first.at);
    // A little slack: fifteen seconds of samples span one period less than fifteen seconds.
    let blocks = ((hover_s + 0.5 * MAX_GAP_S) / BLOCK_S).floor() as usize;
    if blocks < MIN_BLOCKS {
        return Err(TrimRefusal::TooShort { found_s: hover_s, needed_s });
    }
    check_hovers(samples)?;

    // Block means of roll, pitch, yaw, drift x and y.
    let mut sums = vec![[0.0f64; 5]; blocks];
    let mut counts = vec![0usize; blocks];
    for s in samples {
        let block = (s.at.seconds_since(first.at) / BLOCK_S) as usize;
        // What is left over after the last whole block is not used.
        let (Some(sum), Some(count)) = (sums.get_mut(block), counts.get_mut(block)) else {
            continue;
        };
        let yaw = wrap_pi_rad(s.yaw_rad - s.yaw_estimate_rad);
        let [v_x, v_y, _] = s.vel_heading_mps;
        for (slot, value) in sum.iter_mut().zip([s.roll_rad, s.pitch_rad, yaw, v_x, v_y]) {
            *slot += value;
        }
        *count += 1;
    }
    // The largest gap is a fraction of a block: no block is empty.
    // Drift is taken off block by block, so that its own uncertainty shows in the scatter.
    let readings: Vec<[f64; 3]> = sums
        .iter()
        .zip(&counts)
        .map(|(sum, n)| {
            let [roll, pitch, yaw, v_x, v_y] = sum.map(|v| v / (*n).max(1) as f64);
            [roll - drag.roll_ff_rad(v_y), pitch - drag.pitch_ff_rad(v_x), yaw]
        })
        .collect();
    let column = |i: usize| readings.iter().map(move |r| r[i]);

    let mut trims = [Trim { value_deg: 0.0, std_deg: 0.0 }; 3];
    let names = ["roll", "pitch", "yaw"];
    for (axis, trim) in trims.iter_mut().enumerate() {
        let mean = column(axis).sum::<f64>() / blocks as f64;
        let half = blocks / 2;
        let early = column(axis).take(half).sum::<f64>() / half as f64;
        let late = column(axis).skip(half).sum::<f64>() / (blocks - half) as f64;
        let found_deg = (late - early).to_degrees();
        if found_deg.abs() > MAX_HALVES_DEG {
            return Err(TrimRefusal::NotSettled { axis: names[axis], found_deg });
        }
        let var = column(axis).map(|v| (v - mean).powi(2)).sum::<f64>() / (blocks - 1) as f64;
        trim.value_deg = mean.to_degrees();
        trim.std_deg = (var / blocks as f64).sqrt().to_degrees();
        let allowed_deg = if axis == 2 { MAX_YAW_TRIM_DEG } else { MAX_TRIM_DEG };
        if trim.value_deg.abs() > allowed_deg {
            return Err(TrimRefusal::TooLarge {
                axis: names[axis],
                found_deg: trim.value_deg,
                allowed_deg,
            });
        }
    }
    let [roll, pitch, yaw] = trims;
    Ok(Trims { roll, pitch, yaw, hover_s, blocks })
}

/// Every sample is a number and follows the one before.
fn check_samples(samples: &[HoverSample], start: HostTime) -> Result<(), TrimRefusal> {
    let mut before = start;
    for s in samples {
        let after_s = s.at.seconds_since(start);
        let gap_s = s.at.seconds_since(before);
        if !(0.0..=MAX_GAP_S).contains(&gap_s) {
            return Err(TrimRefusal::Gap { gap_s, after_s });
        }
        before = s.at;
        let [v_x, v_y, v_z] = s.vel_heading_mps;
        let values = [s.roll_rad, s.pitch_rad, s.yaw_rad, s.yaw_estimate_rad, v_x, v_y, v_z];
        if !values.iter().all(|v| v.is_finite()) {
            return Err(TrimRefusal::NotANumber { after_s });
        }
    }
    Ok(())
}

/// It stays where it is, and nothing was cut.
fn check_hovers(samples: &[HoverSample]) -> Result<(), TrimRefusal> {
    let n = samples.len() as f64;
    let mean = |f: &dyn Fn(&HoverSample) -> f64| samples.iter().map(f).sum::<f64>() / n;
    let horizontal = mean(&|s| s.vel_heading_mps[0].powi(2) + s.vel_heading_mps[1].powi(2)).sqrt();
    let vertical = mean(&|s| s.vel_heading_mps[2].powi(2)).sqrt();
    let drift = mean(&|s| s.vel_heading_mps[0]).hypot(mean(&|s| s.vel_heading_mps[1]));
    for (what, found_mps, allowed_mps) in [
        ("horizontal speed (root mean square)", horizontal, MAX_RMS_MPS),
        ("vertical speed (root mean square)", vertical, MAX_RMS_MPS),
        ("mean horizontal velocity", drift, MAX_DRIFT_MPS),
    ] {
        if found_mps > allowed_mps {
            return Err(TrimRefusal::Moves { what, found_mps, allowed_mps });
        }
    }
    let found = samples.iter().filter(|s| s.saturated).count();
    // One in a hundred is a gust; more means the mean is wrong.
    if found * 100 > samples.len() {
        return Err(TrimRefusal::Saturated { found, samples: samples.len() });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    const TRUE_DEG: [f64; 3] = [2.0, -3.5, 6.0];

    /// A hover of this length with noise that is correlated over half a second.
    fn hover(seconds: f64, seed: u64) -> Vec<HoverSample> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut swing = [0.0f64; 6];
        (0..(seconds * 100.0) as u64)
            .map(|i| {
                for s in &mut swing {
                    // First order, 0.5 s, one sigma 1.
                    *s = 0.98 * *s + 0.199 * 3f64.sqrt() * rng.random_range(-1.0..1.0);
                }
                let angle = |k: usize| (TRUE_DEG[k] + swing[k]).to_radians();
                HoverSample {
                    at: HostTime::from_us(5_000_000 + i * 10_000),
                    roll_rad: angle(0),
                    pitch_rad: angle(1),
                    yaw_rad: 3.1 + angle(2),
                    yaw_estimate_rad: 3.1,
                    vel_heading_mps: [0.05 * swing[3], 0.05 * swing[4], 0.05 * swing[5]],
                    saturated: false,
                }
            })
            .collect()
    }

    fn trims(samples: &[HoverSample]) -> Result<Trims, TrimRefusal> {
        trims_from_hover(samples, &DragConfig::default())
    }

    #[test]
    fn val_recovers_the_trims_and_its_sigma_covers_the_truth() {
        let (mut covered, mut of) = (0, 0);
        for seed in 0..200 {
            let t = trims(&hover(40.0, seed)).expect("a good hover");
            assert_eq!(t.blocks, 13);
            for (trim, truth) in [t.roll, t.pitch, t.yaw].into_iter().zip(TRUE_DEG) {
                assert!((trim.value_deg - truth).abs() < 0.8, "{trim:?}");
                of += 1;
                covered += usize::from((trim.value_deg - truth).abs() <= trim.std_deg);
            }
        }
        // 68 % of a normal law, less what 13 blocks and their correlation leave.
        let share = f64::from(u32::try_from(covered).expect("small")) / f64::from(of);
        assert!((0.55..0.75).contains(&share), "{share}");
    }

    #[test]
    fn prop_a_slow_drift_is_taken_off_by_the_drag_law() {
        let drag = DragConfig::default();
        let mut samples = hover(40.0, 1);
        let still = trims(&samples).expect("a good hover");
        for s in &mut samples {
            s.vel_heading_mps[0] += 0.06;
            s.vel_heading_mps[1] -= 0.06;
            s.pitch_rad += drag.pitch_ff_rad(0.06);
            s.roll_rad += drag.roll_ff_rad(-0.06);
        }
        let drifting = trims(&samples).expect("slow enough");
        assert!((drifting.roll.value_deg - still.roll.value_deg).abs() < 0.02);
        assert!((drifting.pitch.value_deg - still.pitch.value_deg).abs() < 0.02);
    }

    fn refused(change: impl Fn(&mut Vec<HoverSample>)) -> TrimRefusal {
        let mut samples = hover(20.0, 3);
        change(&mut samples);
        trims(&samples).expect_err("must refuse")
    }

    #[test]
    fn prop_logs_that_do_not_hover_are_refused_with_a_reason() {
        assert!(matches!(refused(|s| s.truncate(1400)), TrimRefusal::TooShort { .. }));
        assert!(matches!(refused(|s| s.clear()), TrimRefusal::TooShort { .. }));
        assert!(matches!(refused(|s| drop(s.drain(500..600))), TrimRefusal::Gap { .. }));
        assert!(matches!(refused(|s| s.swap(10, 50)), TrimRefusal::Gap { .. }));
        assert!(matches!(refused(|s| s[77].pitch_rad = f64::NAN), TrimRefusal::NotANumber { .. }));
        let moving = refused(|s| s.iter_mut().for_each(|s| s.vel_heading_mps[1] += 0.8));
        assert!(moving.to_string().contains("does not hover: horizontal speed"), "{moving}");
        let drifting = refused(|s| s.iter_mut().for_each(|s| s.vel_heading_mps[0] += 0.2));
        assert!(drifting.to_string().contains("mean horizontal velocity"), "{drifting}");
        let climbing = refused(|s| s.iter_mut().for_each(|s| s.vel_heading_mps[2] -= 0.5));
        assert!(climbing.to_string().contains("vertical speed"), "{climbing}");
        assert!(matches!(
            refused(|s| s.iter_mut().step_by(20).for_each(|s| s.saturated = true)),
            TrimRefusal::Saturated { .. }
        ));
        assert!(matches!(
            refused(|s| s.iter_mut().skip(1000).for_each(|s| s.roll_rad += 0.1)),
            TrimRefusal::NotSettled { axis: "roll", .. }
        ));
        assert!(matches!(
            refused(|s| s.iter_mut().for_each(|s| s.pitch_rad -= 0.2)),
            TrimRefusal::TooLarge { axis: "pitch", .. }
        ));
    }
}
