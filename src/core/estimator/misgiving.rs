//! Why an estimate is not good: its health, with the reason.

use std::fmt;

use super::Estimator;
use super::isolation::LEAST_ANCHORS;
use super::state::{POS, State};
use crate::estimate::Health;
use crate::measure::AnchorId;
use crate::time::HostTime;

// Chosen by judgement unless it is said otherwise; how often they warn, in vain and in time, is in docs/ESTIMATOR.md
// (*Warnings before the estimate is wrong*).

/// Age of the newest fused TDOA, s: some hundred measurements missed at the usual 400 a second; after 2 s without
/// any the recorded flights are off by 0.9 m at worst with IMU.
const DEGRADED_AGE_S: f64 = 0.3;
const LOST_AGE_S: f64 = 2.0;
/// After a loss in the air the estimate is not good for so long, s: position and velocity find back at once, a tilt that has drifted
/// takes longer. After 10 s without UWB the recorded flights were more than 1 m off for up to 3 s from there.
const RETURNS_S: f64 = 5.0;
/// One sigma of the position, m: from here on an error of 1 m is within 2.5 sigma. At 0.6 m one anchor that was moved by 1 m made 1.7 s
/// of more than 1 m on a recorded flight without a warning; at 0.4 m those flights are warned of in the air
/// no more often, and standing before the take-off it is 0.07 to 0.23 m with IMU, so that arming is refused no more often.
const DEGRADED_STD_POS_M: f64 = 0.4;
const LOST_STD_POS_M: f64 = 2.0;
/// Share of the recent measurements beyond the gate: an anchor that is wrong spoils a quarter of the pairs of eight.
const DEGRADED_SHARE: f64 = 0.4;
/// An anchor is heard for so long after its newest measurement, s.
const HEARD_S: f64 = 1.0;

/// What speaks against an estimate. Its text is what people are told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Misgiving {
    /// No start values yet.
    NotAligned,
    /// Nothing has been fused for a while.
    NothingFused {
        /// Time since the newest measurement, s; infinite before the first.
        age_s: f64,
    },
    /// Measurements have come back after a loss in the air.
    Returns {
        /// For so long, s.
        since_s: f64,
    },
    /// The position is hardly known.
    Uncertain {
        /// Its largest sigma, m.
        std_m: f64,
    },
    /// The same while the floor hides low anchors: so it is at each take-off among anchors on the floor, for two seconds.
    FloorHides {
        /// Its largest sigma, m.
        std_m: f64,
    },
    /// An anchor is left out because it does not fit the others.
    LeftOut(AnchorId),
    /// One that is wrong would not be found out.
    FewAnchors {
        /// Heard within the last second.
        heard: usize,
        /// Needed.
        least: usize,
    },
    /// The anchors do not fit one another, and none of them can be named that is alone at fault.
    Contradiction {
        /// By how much the position may be off, Earth frame, m.
        shift_E_m: [f64; 3],
    },
    /// Measurements do not fit the filter, which has begun to doubt itself.
    DoesNotFit {
        /// Share of the recent ones beyond the gate.
        share: f64,
    },
    /// Most anchors have been much worse than usual: it is more likely the filter that is wrong.
    ManySuspects,
}

impl fmt::Display for Misgiving {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotAligned => write!(f, "not aligned"),
            Self::NothingFused { age_s } if age_s.is_finite() => {
                write!(f, "no UWB measurement used for {age_s:.1} s")
            }
            Self::NothingFused { .. } => write!(f, "no UWB measurement used yet"),
            Self::Returns { since_s } => {
                write!(
                    f,
                    "UWB measurements are back for {since_s:.1} s, it settles for {RETURNS_S} s"
                )
            }
            Self::Uncertain { std_m } => {
                write!(f, "position sigma {std_m:.1} m, at most {DEGRADED_STD_POS_M}")
            }
            Self::FloorHides { std_m } => {
                write!(f, "the floor hides the low anchors, position sigma {std_m:.1} m")
            }
            Self::LeftOut(id) => write!(f, "anchor {} does not fit the others", id.0),
            Self::FewAnchors { heard, least } => {
                write!(f, "{heard} anchors heard, {least} needed to find a wrong one")
            }
            Self::DoesNotFit { share } => {
                write!(f, "{:.0} % of the UWB measurements do not fit", 100.0 * share)
            }
            Self::Contradiction { shift_E_m } => {
                let axes = ["N", "E", "height"].into_iter().zip(shift_E_m);
                let worst = axes.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
                let (axis, by_m) = worst.map_or(("", 0.0), |(axis, by_m)| (axis, by_m.abs()));
                write!(
                    f,
                    "the anchors contradict one another, none of them alone is at fault: {axis} may be {by_m:.1} m off"
                )
            }
            Self::ManySuspects => write!(f, "most anchors read far worse than usual"),
        }
    }
}

impl Estimator {
    /// What speaks against the estimate at `now`; `None`: it is good.
    pub fn misgiving(&self, now: HostTime) -> Option<Misgiving> {
        match &self.state {
            None => Some(Misgiving::NotAligned),
            Some(state) => self.speaks_against(state, now.max(self.at)).map(|(_, why)| why),
        }
    }

    pub(super) fn health(&self, state: &State, now: HostTime) -> Health {
        self.speaks_against(state, now).map_or(Health::Good, |(health, _)| health)
    }

    fn speaks_against(&self, state: &State, now: HostTime) -> Option<(Health, Misgiving)> {
        let age_s = self.aided.fused_at.map_or(f64::INFINITY, |at| now.seconds_since(at));
        let std_m = state.std3(POS).into_iter().fold(0.0, f64::max);
        let (old, uncertain) = (Misgiving::NothingFused { age_s }, Misgiving::Uncertain { std_m });
        let lost = [(age_s > LOST_AGE_S, old), (std_m > LOST_STD_POS_M, uncertain)];
        let floor_hides = self.floor_hides().then_some(Misgiving::FloorHides { std_m });
        let degraded = (age_s > DEGRADED_AGE_S).then_some(old);
        let is_uncertain = std_m > DEGRADED_STD_POS_M;
        let since_s = self.aided.returned_at.map_or(f64::INFINITY, |at| now.seconds_since(at));
        let returns = self.airborne && since_s < RETURNS_S;
        let lost = lost.into_iter().find(|(holds, _)| *holds).map(|(_, why)| (Health::Lost, why));
        // What is at fault says more than how uncertain the position is for it.
        let degraded = degraded
            .or(floor_hides.filter(|_| is_uncertain))
            .or_else(|| self.does_not_fit(now))
            .or(returns.then_some(Misgiving::Returns { since_s }))
            .or(is_uncertain.then_some(uncertain));
        lost.or(degraded.map(|why| (Health::Degraded, why)))
    }

    /// Something has been fused.
    pub(super) fn note_fused(&mut self, at: HostTime) {
        let lost = self.aided.fused_at.is_some_and(|before| at.seconds_since(before) > LOST_AGE_S);
        if lost && self.airborne {
            self.aided.returned_at = Some(at);
        }
        self.aided.fused_at = Some(at);
    }

    fn does_not_fit(&self, now: HostTime) -> Option<Misgiving> {
        if let Some(id) = self.left_out().next() {
            return Some(Misgiving::LeftOut(id));
        }
        let ids = self.anchors.survey.ids();
        let heard_at = |id: &AnchorId| self.intervals[usize::from(id.0)].0;
        let heard = ids.iter().filter(|id| now.seconds_since(heard_at(id)) < HEARD_S).count();
        let least = ids.len().min(LEAST_ANCHORS);
        if self.config.isolation.leave_out && heard < least {
            return Some(Misgiving::FewAnchors { heard, least });
        }
        let share = self.doubt.share();
        if share > DEGRADED_SHARE || self.doubt.is_active() {
            return Some(Misgiving::DoesNotFit { share });
        }
        let contradicted =
            self.isolation.contradicted_by_E_m().filter(|_| self.config.isolation.leave_out);
        if let Some(shift_E_m) = contradicted {
            return Some(Misgiving::Contradiction { shift_E_m: shift_E_m.into() });
        }
        self.most_are_suspect().then_some(Misgiving::ManySuspects)
    }
}
