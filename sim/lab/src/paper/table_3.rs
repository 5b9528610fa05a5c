//! What a flight of the step tests says of table 3: errors of position and velocity in every window.

use anyhow::{Result, bail};
use haltere_model::lockstep::{Flight, Lockstep, Sample, World};
use serde::{Deserialize, Serialize};

use super::results::Spread;
use super::source;
use crate::compare::CENTRE_NE_M;
use crate::steps::{AXES, REST_S, SIZES_M, WINDOW_SAMPLES, begins, fly_steps, is_complete};

/// Windows that are looked at, s: from what holds a rise to twice what the flights hold.
pub const WINDOWS_S: [usize; 14] = [2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 16, 18, 20];
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
    // The landing is no part of it.
    let end = begins(&flight, CENTRE_NE_M).last().map_or(0, |(_, start)| start + WINDOW_SAMPLES);
    if !is_complete(&scores) || flight.samples[..end].iter().any(|s| s.truth.crashed) {
        bail!("{} steps flown; {}", scores.len(), flight.last_words());
    }
    let errors = Cell::all().map(|cell| errors(&flight, cell)).collect::<Result<_>>()?;
    Ok((Flown { errors }, flight))
}

/// Signed error of a step over all that was flown of it, sample by sample, of the truth or of the estimate.
pub fn signed(flight: &Flight, cell: Cell, start: usize, to: f64, estimate: bool) -> Vec<f64> {
    let axis = cell.axis;
    let window = flight.samples.get(start..start + WINDOW_SAMPLES).unwrap_or_default();
    let error = |s: &Sample| match (cell.of, estimate) {
        (Quantity::Position, false) => s.truth.pos_E_m[axis] - to,
        (Quantity::Position, true) => s.estimate.pos_E_m[axis] - to,
        (Quantity::Velocity, false) => s.truth.vel_E_mps[axis] - s.control.vel_setpoint_E_mps[axis],
        (Quantity::Velocity, true) => {
            s.estimate.vel_E_mps()[axis] - s.control.vel_setpoint_E_mps[axis]
        }
    };
    window.iter().map(error).collect()
}

/// The same of each response to a step of this cell.
fn responses(flight: &Flight, cell: Cell, estimate: bool) -> Result<Vec<Vec<f64>>> {
    let begins = begins(flight, CENTRE_NE_M);
    let of = begins.iter().filter(|(l, _)| l.axis == cell.axis && l.size_m == SIZES_M[cell.size]);
    let steps: Vec<Vec<f64>> =
        of.map(|(l, start)| signed(flight, cell, *start, l.to_E_m[l.axis], estimate)).collect();
    if steps.is_empty() {
        bail!("{}: the step is missing", cell.name());
    }
    Ok(steps)
}

/// Mean absolute error from the step on. Beyond what was flown it goes on as it ended.
fn mean_until(errors: &[f64], window_s: usize) -> f64 {
    let mean = |of: &[f64]| of.iter().map(|e| e.abs()).sum::<f64>() / of.len() as f64;
    let seen = (window_s * PER_S).min(errors.len());
    let share = seen as f64 / (window_s * PER_S) as f64;
    share * mean(&errors[..seen]) + (1.0 - share) * mean(rest(errors))
}

/// The end of a response.
fn rest(errors: &[f64]) -> &[f64] {
    &errors[errors.len() - (REST_S as usize) * PER_S..]
}

fn peak(errors: &[f64]) -> f64 {
    errors[PEAKS_FROM_S * PER_S..].iter().fold(0.0, |most, e| e.abs().max(most))
}

/// Means of the responses of several flights, there and back.
fn mean_responses(flights: &[Flight], cell: Cell) -> Result<Vec<Vec<f64>>> {
    let all: Vec<Vec<Vec<f64>>> =
        flights.iter().map(|f| responses(f, cell, false)).collect::<Result<_>>()?;
    let ways = all.iter().map(Vec::len).min().unwrap_or_default();
    let mean = |way: usize| {
        let at = |i: usize| all.iter().map(|f| f[way][i]).sum::<f64>() / all.len() as f64;
        (0..WINDOW_SAMPLES).map(at).collect()
    };
    Ok((0..ways).map(mean).collect())
}

/// Largest error of the mean of several flights, from a second after the step on.
pub fn peak_of_mean(flights: &[Flight], cell: Cell) -> Result<f64> {
    let means = mean_responses(flights, cell)?;
    Ok(means.iter().map(|m| peak(m)).sum::<f64>() / means.len() as f64)
}

fn errors(flight: &Flight, cell: Cell) -> Result<Errors> {
    let steps = responses(flight, cell, false)?;
    let over = |pick: &dyn Fn(&[f64]) -> f64| {
        steps.iter().map(|s| pick(s)).sum::<f64>() / steps.len() as f64
    };
    Ok(Errors {
        mean: WINDOWS_S.map(|w| over(&|s| mean_until(s, w))).to_vec(),
        rest: over(&|s| mean_until(rest(s), REST_S as usize)),
        peak: over(&peak),
    })
}

/// A cell in a window by three measures: truth and estimate of single responses, truth of their mean.
pub fn by_measure(flights: &[Flight], cell: Cell, window: usize) -> Result<[f64; 3]> {
    let of = |estimate: bool| -> Result<Vec<Vec<Vec<f64>>>> {
        flights.iter().map(|f| responses(f, cell, estimate)).collect()
    };
    let [truth, estimate] = [of(false)?, of(true)?];
    let mean = |all: &[Vec<f64>]| {
        all.iter().map(|s| mean_until(s, WINDOWS_S[window])).sum::<f64>() / all.len() as f64
    };
    let means = mean_responses(flights, cell)?;
    Ok([mean(&truth.concat()), mean(&estimate.concat()), mean(&means)])
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

/// Squared log ratio of ours to the source's.
pub fn off(ours: f64, source: f64) -> f64 {
    (ours / source).ln().powi(2)
}

/// Sum of [`off`] over the cells of `raw`.
pub fn misfit(raw: &[Flown], window: usize) -> f64 {
    (0..AXES.len()).map(|axis| misfit_of(raw, window, axis)).sum()
}

/// The same of an axis.
pub fn misfit_of(raw: &[Flown], window: usize, axis: usize) -> f64 {
    let cells = Cell::all().filter(|c| c.axis == axis);
    cells.map(|c| off(spread(raw, c, window).mean, c.source()[0])).sum()
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
    fn prop_the_source_has_no_misfit_to_itself() {
        for (k, window_s) in WINDOWS_S.into_iter().enumerate() {
            let raw = [as_the_source(window_s as f64)];
            assert!(raw[0].is_whole());
            assert!(misfit(&raw, k) < 1e-12);
            assert!((0..WINDOWS_S.len()).all(|w| w == k || misfit(&raw, w) > 0.1));
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
