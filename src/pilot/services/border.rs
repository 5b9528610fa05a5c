//! The border to the rest of the core: all that the services take from it, or change in it.

use crate::geo::{Geodetic, LocalOrigin};

use super::super::tilt_step::Envelope;
use super::super::{LinkId, Pilot};
use crate::control::Handover;

/// Where the room is taken to lie until somebody says where: open sea, which nobody takes for the
/// true place, degrees north and east.
const STAND_IN_DEG: [f64; 2] = [0.5, 0.5];

/// The origin until it is set.
pub(super) fn stand_in_origin() -> Option<LocalOrigin> {
    let [lat_deg, lon_deg] = STAND_IN_DEG;
    LocalOrigin::new(Geodetic::from_deg(lat_deg, lon_deg, 0.0)?, 0.0)
}

impl Pilot {
    /// Where the room lies on Earth.
    pub(in super::super) fn local_origin(&self) -> Option<LocalOrigin> {
        stand_in_origin()
    }

    /// Whether a link shows the identity `px4`.
    pub(super) fn is_px4(&self, _link: LinkId) -> bool {
        false
    }

    /// What the line of a link carries, bytes/s; `None`: more than we ever send.
    pub(super) fn line_Bps(&self, _link: LinkId) -> Option<f64> {
        None
    }

    /// A value of the configuration changed: everything that has a copy takes it over. Outputs of
    /// the controller go on from where they are and fade to the new law.
    pub(super) fn configuration_changed(&mut self) {
        let envelope = Envelope::of(&self.config, &self.survey);
        self.guidance.reconfigure(
            self.config.flight.clone(),
            envelope,
            self.config.control.limits.horizontal_mps,
        );
        let record = &self.control;
        let from = self.mode.has_thrust().then_some(Handover {
            roll_rad: record.roll_rad,
            pitch_rad: record.pitch_rad,
            yaw_rad: record.yaw_rad,
            thrust_frac: record.thrust_frac,
        });
        self.controller.retune(self.config.control.clone(), from.as_ref());
    }
}
