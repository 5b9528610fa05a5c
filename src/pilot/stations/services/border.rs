//! The border to the rest of the core: all that the services take from it, or change in it.

use haltere_core::geo::LocalOrigin;

use crate::Pilot;
use crate::flight::tilt_step::Envelope;
use crate::input::LinkId;
use crate::stations::Stations;
use crate::stations::endpoint::Identity;
use haltere_core::control::{Handover, margins};

impl Stations {
    /// Whether a link shows the identity `px4`.
    pub(super) fn is_px4(&self, link: LinkId) -> bool {
        self.endpoint_on(link).identity == Identity::Px4
    }

    /// What the line of a link carries, bytes/s; `None`: more than we ever send.
    pub(super) fn line_Bps(&self, link: LinkId) -> Option<f64> {
        let LinkId::Ground(n) = link else { return None };
        self.grounds.get(usize::from(n))?.streams.line_Bps()
    }
}

impl Pilot {
    /// Where the room lies on Earth.
    pub(crate) fn local_origin(&self) -> Option<LocalOrigin> {
        Some(self.origin)
    }

    /// A value of the configuration changed: everything that has a copy takes it over. Outputs of
    /// the controller go on from where they are and fade to the new law.
    pub(super) fn configuration_changed(&mut self) {
        let envelope = Envelope::of(&self.config, &self.survey);
        self.flight.guidance.reconfigure(
            self.config.flight.clone(),
            envelope,
            self.config.control.limits.horizontal_mps,
        );
        let record = &self.flight.control;
        let from = self.flight.mode.has_thrust().then_some(Handover {
            roll_rad: record.roll_rad,
            pitch_rad: record.pitch_rad,
            yaw_rad: record.yaw_rad,
            thrust_frac: record.thrust_frac,
        });
        self.flight.controller.retune(self.config.control.clone(), from.as_ref());
        self.flight.gains_refusal = margins::refusal(&self.config.control);
    }
}
