//! What a flight of the step tests says of table 3: errors of position and velocity in every window, and the rule that
//! takes one window for all cells.
//!
//! The source states no window. Ours is the one with the least sum of squared log ratios of ours to the source's over its
//! twelve cells of `raw`: nothing of `modified` is looked at.

use anyhow::{Context, Result, bail};
use haltere_model::lockstep::{Flight, Lockstep, World};
use serde::{Deserialize, Serialize};

use super::results::Spread;
use super::source;
use crate::compare::CENTRE_NE_M;
use crate::steps::{AXES, REST_S, SIZES_M, WINDOW_SAMPLES, begins, fly_steps, is_complete};

/// Windows that are looked at, s: from what holds a rise to what the flights hold.
pub const WINDOWS_S: [usize; 9] = [2, 3, 4, 5, 6, 7, 8, 9, 10];
/// Control steps in a second.
const PER_S: usize = 100;
/// Peaks of the velocity error count from here on, s: before, it is the jump of the setpoint, which no version takes away.
const PEAKS_FROM_S: usize = 1;

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Truth against command.
    Position,
    /// Truth against velocity setpoint.
    Velocity,
}

impl Quantity {
    /// Both, in the order of the tables.
    pub const ALL: [Self; 2] = [Self::Position, Self::Velocity];

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
        }
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Position => "m",
            Self::Velocity => "m/s",
        }
    }
}

/// A cell of table 3, of either version.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// Position or velocity.
    pub of: Quantity,
    /// 0 x, 1 y, 2 z.
    pub axis: usize,
    /// 0: 1 m, 1: 2 m.
    pub size: usize,
}

impl Cell {
    /// All twelve, by quantity, axis and size.
    pub fn all() -> impl Iterator<Item = Self> {
        Quantity::ALL.into_iter().flat_map(|of| {
            (0..AXES.len())
                .flat_map(move |axis| (0..SIZES_M.len()).map(move |size| Self { of, axis, size }))
        })
    }

    /// Such as "x 1 m, position".
    pub fn name(self) -> String {
        format!("{} {:.0} m, {}", AXES[self.axis], SIZES_M[self.size], self.of.name())
    }

    /// The source's: `raw`, then `modified`.
    pub fn source(self) -> [f64; 2] {
        source::TABLE_3[self.of as usize][self.size][self.axis]
    }
}

/// Errors of one step there and back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Mean of its absolute value, by window of [`WINDOWS_S`].
    pub mean: Vec<f64>,
    /// The same over the last seconds, when the response is over.
    pub rest: f64,
    /// Largest of it from a second after the step on.
    pub peak: f64,
}

/// What one flight showed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Flown {
    /// By quantity, axis and size.
    pub errors: Vec<Errors>,
}

impl Flown {
    /// Errors of a cell.
    pub fn of(&self, cell: Cell) -> &Errors {
        &self.errors[(cell.of as usize * AXES.len() + cell.axis) * SIZES_M.len() + cell.size]
    }

    /// Whether it holds a number for every cell and window.
    pub fn is_whole(&self) -> bool {
        let number = |v: &f64| v.is_finite() && *v > 0.0;
        self.errors.len() == Cell::all().count()
            && self.errors.iter().all(|e| {
                e.mean.len() == WINDOWS_S.len()
                    && e.mean.iter().all(number)
                    && number(&e.rest)
                    && number(&e.peak)
            })
    }
}

/// Flies the programme of steps in any world that is ready to take off.
pub fn fly<W: World>(world: &mut Lockstep<W>) -> Result<(Flown, Flight)> {
    let (scores, flight) = fly_steps(world, CENTRE_NE_M)?;
    if !is_complete(&scores) || flight.samples.iter().any(|s| s.truth.crashed) {
        bail!("{} steps flown; {}", scores.len(), flight.last_words());
    }
    let errors = Cell::all().map(|cell| errors(&flight, cell)).collect::<Result<_>>()?;
    Ok((Flown { errors }, flight))
}

/// Error of a step over its longest window, sample by sample.
pub fn error(flight: &Flight, cell: Cell, start: usize, to: f64) -> Vec<f64> {
    let axis = cell.axis;
    let window = flight.samples.get(start..start + WINDOW_SAMPLES).unwrap_or_default();
    window
        .iter()
        .map(|s| match cell.of {
            Quantity::Position => (s.truth.pos_E_m[axis] - to).abs(),
            Quantity::Velocity => {
                (s.truth.vel_E_mps[axis] - s.control.vel_setpoint_E_mps[axis]).abs()
            }
        })
        .collect()
}

fn errors(flight: &Flight, cell: Cell) -> Result<Errors> {
    let begins = begins(flight, CENTRE_NE_M);
    let steps: Vec<Vec<f64>> = begins
        .iter()
        .filter(|(leg, _)| leg.axis == cell.axis && leg.size_m == SIZES_M[cell.size])
        .map(|(leg, start)| error(flight, cell, *start, leg.to_E_m[leg.axis]))
        .collect();
    if steps.is_empty() {
        bail!("{}: the step is missing", cell.name());
    }
    let over = |pick: &dyn Fn(&[f64]) -> f64| {
        steps.iter().map(|s| pick(s)).sum::<f64>() / steps.len() as f64
    };
    let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
    Ok(Errors {
        mean: WINDOWS_S.map(|w| over(&|s| mean(&s[..w * PER_S]))).to_vec(),
        rest: over(&|s| mean(&s[s.len() - (REST_S as usize) * PER_S..])),
        peak: over(&|s| s[PEAKS_FROM_S * PER_S..].iter().copied().fold(0.0, f64::max)),
    })
}

/// A cell over the repetitions, in a window.
pub fn spread(flown: &[Flown], cell: Cell, window: usize) -> Spread {
    Spread::of(flown.iter().map(|f| f.of(cell).mean[window]))
}

/// Error of `raw` over that of `modified` along an axis, repetition by repetition: mean of both sizes.
pub fn gain(raw: &[Flown], modified: &[Flown], of: Quantity, axis: usize, window: usize) -> Spread {
    let share = 1.0 / SIZES_M.len() as f64;
    Spread::of(raw.iter().zip(modified).map(|(raw, modified)| {
        let sizes = (0..SIZES_M.len()).map(|size| Cell { of, axis, size });
        sizes.map(|c| share * raw.of(c).mean[window] / modified.of(c).mean[window]).sum()
    }))
}

/// The source's.
pub fn gain_of_source(of: Quantity, axis: usize) -> f64 {
    let sizes = (0..SIZES_M.len()).map(|size| Cell { of, axis, size }.source());
    sizes.map(|[raw, modified]| raw / modified).sum::<f64>() / SIZES_M.len() as f64
}

/// Sum of the squared log ratios of ours to the source's over the cells of `raw`.
pub fn misfit(raw: &[Flown], window: usize) -> f64 {
    Cell::all().map(|c| (spread(raw, c, window).mean / c.source()[0]).ln().powi(2)).sum()
}

/// The window of the rule, by its place in [`WINDOWS_S`].
pub fn chosen(raw: &[Flown]) -> Result<usize> {
    (0..WINDOWS_S.len())
        .min_by(|a, b| misfit(raw, *a).total_cmp(&misfit(raw, *b)))
        .context("no windows")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As if the source had been flown, and averaged over this window.
    fn as_the_source(window_s: f64) -> Flown {
        let errors = Cell::all().map(|c| Errors {
            mean: WINDOWS_S.map(|w| c.source()[0] * window_s / w as f64).to_vec(),
            rest: 0.01,
            peak: 0.1,
        });
        Flown { errors: errors.collect() }
    }

    #[test]
    fn prop_the_rule_finds_the_window_of_the_source() {
        for (k, window_s) in WINDOWS_S.into_iter().enumerate() {
            let raw = [as_the_source(window_s as f64)];
            assert!(raw[0].is_whole());
            assert_eq!(chosen(&raw).unwrap(), k);
            assert!(misfit(&raw, k) < 1e-12);
        }
    }

    /// The issue's own figures, from the source's table.
    #[test]
    fn val_gains_of_the_source() {
        let of = |quantity, axis| (100.0 * gain_of_source(quantity, axis)).round() / 100.0;
        assert_eq!([0, 1].map(|a| of(Quantity::Position, a)), [1.65, 1.63]);
        assert_eq!([0, 1].map(|a| of(Quantity::Velocity, a)), [2.63, 2.52]);
    }
}
