//! What the magnetometer says at the start, for people: whether its heading is taken, and what a survey
//! of the room's field would write into the configuration.

use super::Navigation;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::view::View;

impl Navigation {
    /// Told once, when the filter has found its start; nothing where no magnetometer is asked for.
    pub(crate) fn tell_magnetic_field(&self, view: &View<'_>, out: &mut Out) {
        let at = view.at;
        let wanted = view.config.estimator.magnetometer;
        if !wanted.fuse {
            return;
        }
        let Some(field) = self.estimator.magnetic_field() else {
            let text = "estimator.magnetometer.fuse: the board sends no magnetic field, heading is the board's";
            out.say(at, Severity::Warning, text.to_owned());
            return;
        };
        let seen = format!(
            "magnetic field of {:.0} uT, dip {:.0} deg",
            field.strength_tesla() * 1e6,
            field.dip_rad().to_degrees()
        );
        let disturbance_frac = field.disturbance_frac(&wanted);
        if disturbance_frac <= wanted.most_disturbance_frac {
            let yaw_deg = view.estimate.R_EB.yaw_rad().to_degrees();
            out.say(at, Severity::Info, format!("{seen}: heading {yaw_deg:.0} deg is by it"));
        } else {
            let text = format!(
                "{seen}, {:.0} uT and {:.0} deg expected: heading is the board's",
                wanted.strength_ut, wanted.dip_deg
            );
            out.say(at, Severity::Warning, text);
        }
    }
}
