//! What people are told of the estimate.

use haltere_core::estimate::{Estimate, Health};
use haltere_core::estimator::Misgiving;

use super::Navigation;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::view::View;

/// A change between good and degraded is told at most this often, s.
const HEALTH_TELL_S: f64 = 2.0;

impl Navigation {
    /// Tells people which anchor is left out, and when it is heard again.
    pub(crate) fn watch_left_out(&self, view: &View<'_>, out: &mut Out) {
        let at = view.at;
        for rank in 0..out.told.left_out.len() {
            let is_out = self.estimator.is_left_out(rank);
            let Some(told) = out.told.left_out.get_mut(rank).filter(|told| **told != is_out) else {
                continue;
            };
            *told = is_out;
            let Some(id) = view.survey.ids().get(rank).map(|id| id.0) else { continue };
            if is_out {
                let text = format!("anchor {id} does not fit the others and is left out");
                out.say(at, Severity::Warning, text);
            } else {
                out.say(at, Severity::Info, format!("anchor {id} is heard again"));
            }
        }
    }

    /// Whether the estimate is good, or would be but for what it was before: one that settles is better than none.
    pub(crate) fn estimate_is_back(&self, estimate: &Estimate) -> bool {
        let why = self.estimator.misgiving(estimate.at);
        estimate.health == Health::Good || matches!(why, Some(Misgiving::Returns { .. }))
    }

    /// Tells people when the estimate gets worse or better, and why, calmly. Whether it has just begun.
    pub(crate) fn watch_health(&self, view: &View<'_>, out: &mut Out) -> bool {
        let at = view.at;
        let why = self.estimator.misgiving(at);
        // As it is at each take-off: a warning that always comes is not read.
        let health = match (view.estimate.health, why) {
            (Health::Degraded, Some(Misgiving::FloorHides { .. })) => Health::Good,
            (health, _) => health,
        };
        let was = out.told.health;
        if health == was {
            return false;
        }
        let small = |h| matches!(h, Health::Good | Health::Degraded);
        if small(was) && small(health) && at.seconds_since(out.told.health_at) < HEALTH_TELL_S {
            return false;
        }
        out.told.health = health;
        out.told.health_at = at;
        let pos = view.estimate.pos_E_m;
        let place = format!("N {:.2} E {:.2} height {:.2} m", pos.x(), pos.y(), -pos.z());
        let why = why.map_or(String::new(), |why| format!(": {why}"));
        let (severity, text) = match (was, health) {
            (Health::NotAligned, Health::Good | Health::Degraded) => {
                self.tell_magnetic_field(view, out);
                (Severity::Info, format!("estimator aligned at {place}"))
            }
            (_, Health::Good) => (Severity::Info, "estimate good again".to_owned()),
            (_, Health::Degraded) => {
                (Severity::Warning, format!("estimate degraded near {place}{why}"))
            }
            (_, Health::Lost) => (Severity::Critical, format!("estimate lost{why}")),
            (_, Health::NotAligned) => (Severity::Critical, "estimator starts anew".to_owned()),
        };
        out.say(at, severity, text);
        matches!((was, health), (Health::NotAligned, Health::Good | Health::Degraded))
    }
}
