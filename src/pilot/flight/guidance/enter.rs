//! What a mode begins with: where the carrot is put, and which leg it starts on.

use super::{Carrot, Guidance};
use crate::flight::fence::Fence;
use crate::flight::modes::Mode;
use crate::flight::setpoint::rests_at_E_m;
use haltere_core::estimate::Estimate;
use haltere_core::frames::Vec3;
use haltere_core::time::HostTime;

impl Guidance {
    /// Called once when a mode begins.
    pub fn enter(&mut self, mode: Mode, estimate: &Estimate, fence: &Fence, at: HostTime) {
        self.ramp.rest();
        self.entered_at = at;
        self.arrived_at = None;
        self.tilt = None;
        match mode {
            Mode::Spool => {
                let here = Vec3::new(estimate.pos_E_m.x(), estimate.pos_E_m.y(), 0.0);
                self.home_is_here(here);
                self.carrot = Carrot::resting(here);
                self.yaw_rad = estimate.R_EB.yaw_rad();
                self.set_leg_speed(None);
            }
            Mode::Takeoff => {
                let mut target = self.carrot.pos_E_m.to_array();
                target[2] = -self.takeoff_height_m;
                self.carrot.target_E_m = Vec3::from_array(target);
            }
            Mode::Hold
                // A leg that has arrived is held where it ends: no step from estimate noise.
                if (!self.carrot.has_arrived() || self.is_far_from_carrot(estimate)) => {
                    self.carrot = Carrot::resting(self.envelope.volume.clamp(rests_at_E_m(estimate)));
                }
            Mode::Mission => {
                self.item_started = false;
                self.set_leg_speed(None);
                self.start_from_here(estimate);
            }
            Mode::Goto => self.start_from_here(estimate),
            Mode::Return => {
                self.set_leg_speed(None);
                let present = self.carrot.pos_E_m.z().min(estimate.pos_E_m.z());
                let height = present.min(-self.config.return_height_m);
                self.carrot = Carrot::resting(self.envelope.volume.clamp(estimate.pos_E_m));
                let refuge = self.nearest_refuge_NE_m(estimate.pos_E_m, fence);
                self.no_way_home = refuge.is_none();
                if let Some([north, east]) = refuge {
                    self.fly_to(Vec3::new(north, east, height), None);
                }
            }
            Mode::Land
                if (self.is_far_from_carrot(estimate) || !self.carrot.has_arrived()) => {
                    // Outside of the walls it comes down inside.
                    self.carrot = Carrot::resting(self.envelope.volume.clamp(estimate.pos_E_m));
                }
            _ => {}
        }
    }

    /// A leg that begins after a landing or a disturbance begins where the vehicle is.
    fn start_from_here(&mut self, estimate: &Estimate) {
        if self.is_far_from_carrot(estimate) {
            self.carrot = Carrot::resting(self.envelope.volume.clamp(estimate.pos_E_m));
        }
    }
}
