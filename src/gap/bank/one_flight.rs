//! One flight of a bank: with jitter alone, or with an effect beside its twin.
//!
//! An effect that is too strong for the mission is drawn weaker until the mission is flown, and one that does nothing is drawn stronger.

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use haltere_model::effects::EffectSpec;
use serde::{Deserialize, Serialize};

use crate::bank::axis::Axis;
use crate::bank::fly::{NotFlown, fly_observed_into};
use crate::bank::jitter::jittered;
use crate::bank::library;
use crate::flight::statistics::statistics_of;
use crate::flight::trace::Trace;
use crate::nominal::Nominal;
use crate::scene::Scene;

/// Shares of the drawn size that are tried, largest first, until the mission is flown: steps of 0.7, down to
/// where A2 flies (its weakest plausible draw at 0.2 to 0.5; judgement).
const SHARES: [f64; 8] = [1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08];
/// Where the mission bears no plausible size at all, draws are spread over these shares of what it bears: another law of the
/// same effect may do as little at a size that is plausible. Chosen: 12 of 15 labelled flights with A2 are named
/// so, 7 without (sim/lab/RUNS.md, run 40).
const SPREAD: [f64; 4] = [1.0, 0.85, 0.7, 0.55];
/// An effect that moves all statistics together by less than this, in sigma of benign jitter, teaches nothing (judgement).
const SILENT: f64 = 1.0;
/// Times that a silent draw is made stronger: three quarters of the way to the strong end, where P5 does something (judgement).
const LOUDER: usize = 2;

/// Why a flight is not in the bank.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum End {
    /// The simulator refuses the vehicle or the effect.
    Refused,
    /// It was not armed or had no take-off.
    NotBegun,
    /// It fell.
    Crashed,
    /// Its mission did not come to its end: the supervisor landed it, or time was over.
    EndedEarly,
    /// The floor carried it during the mission.
    Carried,
    /// It cannot be observed.
    NotObservable,
}

impl End {
    /// What became of it, in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Refused => "refused by the simulator",
            Self::NotBegun => "did not take off",
            Self::Crashed => "crashed",
            Self::EndedEarly => "did not come to the end of the mission",
            Self::Carried => "sat on the floor during the mission",
            Self::NotObservable => "too short to be observed",
        }
    }
}

/// One flight with an effect.
#[derive(Debug, Clone)]
pub(super) struct Drawn {
    pub(super) seed: u64,
    /// Place of the effect in the library.
    pub(super) place: usize,
    pub(super) theta: Vec<f64>,
    /// Place among the draws of the effect.
    pub(super) number: usize,
    /// Place among the flown flights with jitter of the one with the same seed.
    pub(super) twin: usize,
}

/// A flight without the effect, and sigma of every statistic in benign jitter.
#[derive(Debug, Clone, Copy)]
pub(super) struct Silence<'a> {
    pub(super) row: &'a [f64],
    pub(super) sigmas: &'a [f64],
}

impl Silence<'_> {
    /// Whether a flight with the effect is the same, to less than anybody could see.
    pub(super) fn holds(&self, statistics: &[f64]) -> bool {
        let off = statistics.iter().zip(self.row).zip(self.sigmas);
        let squares = off.map(|((a, b), sigma)| ((a - b) / sigma).powi(2));
        squares.filter(|v| v.is_finite()).sum::<f64>() < SILENT * SILENT
    }
}

/// How strong an effect is at these parameters: the largest of its sizes as a share of its axis; `None` where nothing says how much.
fn size(theta: &[f64], axes: &[Axis]) -> Option<f64> {
    axes.iter().zip(theta).filter_map(|(axis, value)| axis.share(*value)).reduce(f64::max)
}

/// At which sizes an effect has done something so far, and at which it has not, whatever its other parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Heard {
    /// Largest size of a flight on which nothing happened.
    silent_at: f64,
    /// Smallest size of one on which something did.
    loud_at: f64,
}

impl Heard {
    pub(super) const NOTHING: Self = Self { silent_at: 0.0, loud_at: f64::INFINITY };

    fn note(&mut self, size: Option<f64>, silent: bool) {
        let Some(size) = size else { return };
        if silent {
            self.silent_at = self.silent_at.max(size);
        } else {
            self.loud_at = self.loud_at.min(size);
        }
    }

    /// Nothing happened at this size or a larger one, and nowhere did anything at a smaller one.
    fn foretells_silence(&self, size: Option<f64>) -> bool {
        size.is_some_and(|size| size <= self.silent_at && size < self.loud_at)
    }
}

/// Who flies.
pub(super) struct Hand<'a> {
    pub(super) scene: &'a Scene,
    pub(super) items: &'a [MISSION_ITEM_INT_DATA],
    pub(super) library: &'a [&'static EffectSpec],
    pub(super) nominal: Nominal,
}

impl Hand<'_> {
    /// Flies a draw: the parameters that were flown, and the statistics.
    ///
    /// A flight that is diagnosed came to its landing, or is looked at as far as it came. So must those of the
    /// bank: a vehicle on its side has statistics too, and they are the same for every effect that fells it. An
    /// effect too strong for the mission is drawn weaker until it is flown, and one that does nothing is drawn stronger.
    /// `heard`: of earlier draws of this effect; what is silent by them is not flown.
    pub(super) fn draw(
        &self,
        drawn: &Drawn,
        axes: &[Axis],
        silence: Silence<'_>,
        heard: &mut Heard,
        trace: &mut Trace,
    ) -> Option<(Vec<f64>, Vec<f64>)> {
        let spec = self.library[drawn.place];
        let mut fly = |theta: &[f64]| self.fly(drawn.seed, true, Some((spec, theta)), trace).ok();
        let mut theta = drawn.theta.clone();
        let mut left = LOUDER;
        while left > 0 && heard.foretells_silence(size(&theta, axes)) {
            theta = library::louder(&theta, axes);
            left -= 1;
        }
        let sized = |share: f64| match share {
            1.0 => theta.clone(),
            _ => library::at_share(spec, &theta, share),
        };
        let (share, mut row) =
            SHARES.iter().find_map(|share| Some((*share, fly(&sized(*share))?)))?;
        let mut flown = sized(share);
        let plausible = axes.iter().zip(&flown).all(|(axis, value)| axis.with(*value) == *axis);
        let part = SPREAD[drawn.number % SPREAD.len()];
        if !plausible && part < 1.0 {
            let weaker = sized(share * part);
            if let Some(other) = fly(&weaker) {
                (flown, row) = (weaker, other);
            }
        }
        loop {
            let silent = silence.holds(&row);
            heard.note(size(&flown, axes), silent);
            if !silent || left == 0 {
                break;
            }
            left -= 1;
            let louder = library::louder(&flown, axes);
            match fly(&louder) {
                Some(stronger) => (flown, row) = (louder, stronger),
                None => break,
            }
        }
        Some((flown, row))
    }

    /// Flies one flight. `jitter`: every flight of the bank but the seeds has it: an effect does not come on a perfect
    /// vehicle.
    pub(super) fn fly(
        &self,
        seed: u64,
        jitter: bool,
        effect: Option<(&EffectSpec, &[f64])>,
        trace: &mut Trace,
    ) -> Result<Vec<f64>, End> {
        let Self { scene, items, .. } = *self;
        let mut plant = scene.plant(seed);
        if jitter {
            plant = jittered(plant).map_err(|_| End::Refused)?;
        }
        if let Some((spec, theta)) = effect {
            plant.effects =
                library::with_effect(plant.effects, spec, theta).map_err(|_| End::Refused)?;
        }
        fly_observed_into(trace, scene, items, plant, scene.pilot.clone()).map_err(
            |why| match why {
                NotFlown::Plant(_) => End::Refused,
                NotFlown::Flight(_) => End::NotBegun,
            },
        )?;
        // A healthy vehicle that the floor carried for a while says nothing of healthy flight. With an effect it may
        // be the effect that set it down.
        let carried = effect.is_none() && trace.carried_s.is_some_and(|carried_s| carried_s > 0.0);
        if carried {
            return Err(End::Carried);
        }
        if !trace.came_as_far_as(scene.until_s) {
            return Err(if trace.crashed == Some(true) { End::Crashed } else { End::EndedEarly });
        }
        statistics_of(trace, &self.nominal).map_err(|_| End::NotObservable)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_flight_is_silent_when_no_statistic_moves_and_unknown_ones_do_not_count() {
        let silence = Silence { row: &[1.0, 2.0, f64::NAN], sigmas: &[0.1, 0.0, 1.0] };
        assert!(silence.holds(&[1.09, 2.0, 7.0]));
        assert!(!silence.holds(&[1.11, 2.0, 7.0]));
        assert!(!Silence { sigmas: &[0.1; 3], ..silence }.holds(&[1.08, 2.08, 7.0]), "together");
    }

    #[test]
    fn prop_silence_is_foretold_below_what_was_silent_and_never_above_what_was_heard() {
        let mut heard = Heard::NOTHING;
        assert!(!heard.foretells_silence(Some(0.1)), "nothing was flown");
        heard.note(Some(0.4), true);
        assert!(heard.foretells_silence(Some(0.4)) && !heard.foretells_silence(Some(0.5)));
        assert!(!heard.foretells_silence(None), "an effect without a size");
        heard.note(Some(0.2), false);
        assert!(heard.foretells_silence(Some(0.1)));
        assert!(!heard.foretells_silence(Some(0.3)), "weaker ones were heard elsewhere");
    }
}
