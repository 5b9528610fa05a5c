//! Which anchors are heard.

use haltere_core::measure::{AnchorId, Tdoa};
use haltere_core::time::HostTime;

use super::Navigation;
use crate::view::View;

/// When each anchor was last part of a measurement.
#[derive(Debug)]
pub(crate) struct Anchors {
    heard_at: Box<[Option<HostTime>; 256]>,
}

impl Default for Anchors {
    fn default() -> Self {
        Self { heard_at: Box::new([None; 256]) }
    }
}

impl Anchors {
    /// A measurement came, whatever becomes of it.
    pub fn note(&mut self, tdoa: &Tdoa) {
        for AnchorId(id) in [tdoa.anchor_a, tdoa.anchor_b] {
            self.heard_at[usize::from(id)] = Some(tdoa.received_at);
        }
    }

    /// Silence of an anchor, s; `None`: never heard.
    pub fn silent_s(&self, AnchorId(id): AnchorId, at: HostTime) -> Option<f64> {
        self.heard_at[usize::from(id)].map(|t| at.seconds_since(t))
    }
}

impl Navigation {
    /// Anchors of the survey that are heard.
    pub(crate) fn anchors_alive(&self, view: &View<'_>) -> usize {
        let limit_s = view.config.supervisor.anchor_silent_s;
        let alive =
            |id: &&AnchorId| self.anchors.silent_s(**id, view.at).is_some_and(|s| s <= limit_s);
        view.survey.ids().iter().filter(alive).count()
    }

    pub(crate) fn uwb_age_s(&self, at: HostTime) -> f64 {
        self.last_fused.map_or(f64::INFINITY, |t| at.seconds_since(t))
    }
}
