//! The survey against the time differences of a vehicle that stands: who is told, and what forbids arming.

use haltere_core::estimator::{AnchorCheck, AnchorFit, MOST_HIDDEN_M};
use haltere_core::measure::{AnchorId, Tdoa};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;

use super::Navigation;
use crate::config::PilotConfig;
use crate::flight::modes::Mode;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::view::View;

/// The check is made so often, s.
const INTERVAL_S: f64 = 0.5;
/// An anchor is named when so many checks in a row name it.
const NAMED_TIMES: u32 = 3;
/// It is told from this share of the refusal on.
const TOLD_SHARE: f64 = 0.5;
/// A floor that adds more than this to the low anchors is none, m: recorded were metres on one floor, and they went
/// with the first half metre of height; a survey with floor and ceiling exchanged has six in a hall.
const MOST_FLOOR_M: f64 = 2.5;

/// What is known about the survey.
#[derive(Debug)]
pub(crate) struct SurveyCheck {
    check: AnchorCheck,
    /// Whether anything was collected since the vehicle last flew.
    is_filled: bool,
    checked_at: Option<HostTime>,
    /// The anchor that was last named, how far off it reads, m, and how often in a row.
    named: Option<(AnchorId, f64, u32)>,
    /// Misfit that forbids arming, m.
    most_m: f64,
    told: Option<AnchorId>,
    /// What the floor adds to the low anchors, m, and how often in a row too much.
    floor_m: f64,
    floor_times: u32,
    floor_told: bool,
    /// How often in a row no place fitted at all.
    nowhere_times: u32,
}

impl SurveyCheck {
    pub fn new(config: &PilotConfig, survey: &Survey) -> Self {
        Self {
            check: AnchorCheck::new(survey, &config.estimator.range_bias_m),
            is_filled: false,
            checked_at: None,
            named: None,
            most_m: config.supervisor.anchor_misfit_m,
            told: None,
            floor_m: 0.0,
            floor_times: 0,
            floor_told: false,
            nowhere_times: 0,
        }
    }

    /// A measurement came.
    pub fn note(&mut self, tdoa: &Tdoa, mode: Mode) {
        if !mode.has_thrust() {
            self.check.note(tdoa);
            self.is_filled = true;
        }
    }

    /// Why nothing may take off, if so.
    pub fn refusal(&self) -> Option<String> {
        if self.floor_times >= NAMED_TIMES {
            return self.doubt();
        }
        if self.nowhere_times >= NAMED_TIMES {
            return Some(NOWHERE.to_owned());
        }
        let (anchor, bias_m) = self.misfit()?;
        (bias_m.abs() >= self.most_m).then(|| words(anchor, bias_m))
    }

    /// The anchor that is told, and by how much it reads too far, m.
    fn misfit(&self) -> Option<(AnchorId, f64)> {
        let (anchor, bias_m, times) = self.named?;
        (times >= NAMED_TIMES).then_some((anchor, bias_m))
    }

    /// What people who come later are told as well.
    pub fn doubt(&self) -> Option<String> {
        let floor_m = self.floor_m;
        if floor_m.abs() <= MOST_HIDDEN_M {
            return None;
        }
        let meaning = if self.floor_times >= NAMED_TIMES {
            format!(", {MOST_FLOOR_M} m at most: check which anchors are low")
        } else {
            " here: the survey cannot be checked before the take-off".to_owned()
        };
        Some(format!("the floor adds {floor_m:+.1} m to the low anchors{meaning}"))
    }

    fn take(&mut self, fit: Option<AnchorFit>) {
        self.floor_m = fit.map_or(0.0, |fit| fit.hidden_m);
        let too_much = self.floor_m.abs() > MOST_FLOOR_M;
        self.floor_times = if too_much { self.floor_times.saturating_add(1) } else { 0 };
        let nowhere = fit.is_some_and(|fit| fit.fits_nowhere());
        self.nowhere_times = if nowhere { self.nowhere_times.saturating_add(1) } else { 0 };
        let found = fit.filter(|fit| fit.is_at_fault(TOLD_SHARE * self.most_m));
        self.named = found.map(|fit| match self.named {
            Some((anchor, _, times)) if anchor == fit.worst => {
                (anchor, fit.range_bias_m, times.saturating_add(1))
            }
            _ => (fit.worst, fit.range_bias_m, 1),
        });
    }
}

impl Navigation {
    /// Once a control step.
    pub(crate) fn check_survey(&mut self, view: &View<'_>, out: &mut Out) {
        let at = view.at;
        let all = &mut self.survey_check;
        if view.mode.has_thrust() {
            if std::mem::take(&mut all.is_filled) {
                all.check.clear();
                (all.named, all.told) = (None, None);
                (all.floor_m, all.floor_times, all.nowhere_times) = (0.0, 0, 0);
            }
            return;
        }
        if all.checked_at.is_some_and(|t| at.seconds_since(t) < INTERVAL_S) {
            return;
        }
        all.checked_at = Some(at);
        // A station may have changed it.
        all.most_m = view.config.supervisor.anchor_misfit_m;
        let fit = all.check.judge(view.config.flight.gear_height_m);
        all.take(fit);
        if let Some(text) = all.doubt()
            && !std::mem::replace(&mut all.floor_told, true)
        {
            out.say(at, Severity::Warning, text);
            return;
        }
        if let Some((anchor, bias_m)) = all.misfit()
            && all.told.replace(anchor) != Some(anchor)
        {
            out.say(at, Severity::Warning, words(anchor, bias_m));
        }
    }
}

/// A filter that learns the errors of anchors would make such a survey fit, until it flies.
const NOWHERE: &str = "several anchors do not fit one another, whichever is left out: check which are exchanged in the \
                       survey, and their lines of sight";

fn words(anchor: AnchorId, bias_m: f64) -> String {
    let way = if bias_m > 0.0 { "far" } else { "near" };
    format!(
        "anchor {anchor} does not fit the others: it reads {:.2} m too {way}; check its place in the survey \
         and its line of sight",
        bias_m.abs()
    )
}
