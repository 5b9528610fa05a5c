//! A value of the configuration that a station has set, in force in all parts.

use haltere_dialect::mav::haltere::PARAM_SET_DATA;

use haltere_core::control::{Handover, margins};
use haltere_core::geo::LocalOrigin;

use super::act::{Act, Heard};
use crate::flight::tilt_step::Envelope;

impl Act<'_> {
    /// PARAM_SET.
    pub(crate) fn set_parameter(&mut self, heard: &Heard<'_>, m: &PARAM_SET_DATA) {
        let (at, mode) = (heard.at, self.flight.mode);
        let change = self.stations.parameter_set(at, mode, heard.client(), m, self.out);
        if let Some(change) = change {
            change.put_in(self.config);
            self.configuration_changed();
        }
    }

    /// Where the room lies on Earth.
    pub(crate) fn local_origin(&self) -> Option<LocalOrigin> {
        Some(*self.origin)
    }

    /// A value of the configuration changed: everything that has a copy takes it over. Outputs of
    /// the controller go on from where they are and fade to the new law.
    pub(crate) fn configuration_changed(&mut self) {
        let envelope = Envelope::of(self.config, self.survey);
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
