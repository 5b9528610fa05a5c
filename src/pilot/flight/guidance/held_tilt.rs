//! An angle step within a mission: a tilt is held in place of what the position loop wants.

use super::{Carrot, Guidance, News, Now};
use crate::flight::tilt_step::{Progress, TiltRun, TiltStep};
use haltere_core::control::{AxisCommand, Command, HeldTilt, TiltAxis};
use haltere_core::estimate::Estimate;
use haltere_core::frames::Vec3;

impl Guidance {
    /// The command of a held tilt: along its axis the vehicle goes as it goes, across it the line is
    /// kept on which the step began.
    pub(super) fn keep_line(&self, command: &mut Command, held: HeldTilt, estimate: &Estimate) {
        let Some([north, east]) = self.tilt.as_ref().and_then(TiltRun::start_NE_m) else { return };
        let (sin_yaw, cos_yaw) = estimate.R_EB.yaw_rad().sin_cos();
        let along = match held.axis {
            TiltAxis::Pitch => [cos_yaw, sin_yaw],
            TiltAxis::Roll => [-sin_yaw, cos_yaw],
        };
        let pos = estimate.pos_E_m;
        let gone_m = (pos.x() - north) * along[0] + (pos.y() - east) * along[1];
        command.axes[0] = AxisCommand::Position_m(north + gone_m * along[0]);
        command.axes[1] = AxisCommand::Position_m(east + gone_m * along[1]);
        let vel = estimate.vel_E_mps();
        let speed_mps = vel.x() * along[0] + vel.y() * along[1];
        command.vel_ff_E_mps = Vec3::new(speed_mps * along[0], speed_mps * along[1], 0.0);
    }

    /// An angle step; `true` when it is over.
    pub(super) fn tilt_step(&mut self, step: &TiltStep, now: &Now<'_>, news: &mut News) -> bool {
        let run = self.tilt.get_or_insert_with(|| TiltRun::new(now.at));
        let (progress, because) = run.step(step, &self.envelope, now);
        let item = self.current_item;
        news.warning = because.map(|why| {
            format!("item {item}: {} {why}", step.name(), item = item.saturating_add(1))
        });
        match progress {
            Progress::Wait => false,
            Progress::Hold(stop_E_m) => {
                self.carrot = Carrot::resting(stop_E_m);
                news.held = Some(HeldTilt { axis: step.axis, angle_rad: step.angle_rad });
                false
            }
            Progress::Brake(stop_E_m) => {
                self.carrot = Carrot::resting(stop_E_m);
                false
            }
            Progress::Done => true,
            Progress::Refused(why) => {
                news.warning = Some(format!(
                    "item {item}: {} refused: {why}",
                    step.name(),
                    item = item.saturating_add(1)
                ));
                self.refused = true;
                true
            }
        }
    }
}
