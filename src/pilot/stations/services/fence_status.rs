//! Whether the vehicle is where it may be, for the health bit and for FENCE_STATUS: the fence that a
//! station drew, and the flight volume around everything.

use haltere_dialect::mav::haltere::{FENCE_STATUS_DATA, FenceBreach, FenceMitigate, MavMessage};

use haltere_core::estimate::Estimate;
use haltere_core::time::HostTime;

use crate::flight::Flight;
use crate::stations::Stations;

/// Height above the ceiling of the flight volume that is still no breach, m: the estimate's noise.
const CEILING_MARGIN_M: f64 = 0.5;

/// What became of the fence so far.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FenceWatch {
    is_outside: bool,
    count: u16,
    last: FenceBreach,
    last_at: HostTime,
}

impl Default for FenceWatch {
    fn default() -> Self {
        Self {
            is_outside: false,
            count: 0,
            last: FenceBreach::FENCE_BREACH_NONE,
            last_at: HostTime::default(),
        }
    }
}

impl Stations {
    /// FENCE_STATUS.
    pub(crate) fn fence_status(&self, flight: &Flight) -> MavMessage {
        let watch = &self.services.fence_watch;
        let held_back = flight.plans.held_back.is_some();
        MavMessage::FENCE_STATUS(FENCE_STATUS_DATA {
            breach_time: (watch.last_at.as_us() / 1000) as u32,
            breach_count: watch.count,
            breach_status: u8::from(watch.is_outside),
            breach_type: watch.last,
            breach_mitigation: if held_back {
                FenceMitigate::FENCE_MITIGATE_VEL_LIMIT
            } else {
                FenceMitigate::FENCE_MITIGATE_NONE
            },
        })
    }

    /// Once a control step.
    pub(crate) fn fence_tick(&mut self, at: HostTime, flight: &Flight, estimate: &Estimate) {
        let breach = breach(flight, estimate);
        let watch = &mut self.services.fence_watch;
        if let Some(breach) = breach
            && !watch.is_outside
        {
            watch.count = watch.count.saturating_add(1);
            watch.last = breach;
            watch.last_at = at;
        }
        watch.is_outside = breach.is_some();
    }
}

/// The border that the vehicle is beyond. On the floor it leaves nothing by being below its bottom, and where it was
/// put is looked at when it arms.
pub(crate) fn breach(flight: &Flight, estimate: &Estimate) -> Option<FenceBreach> {
    if !flight.mode.has_thrust() {
        return None;
    }
    let pos = estimate.pos_E_m;
    let volume = flight.guidance.volume();
    if -pos.z() > volume.height_m + CEILING_MARGIN_M {
        return Some(FenceBreach::FENCE_BREACH_MAXALT);
    }
    let inside = volume.contains_over(pos) && flight.plans.fence.contains([pos.x(), pos.y()]);
    (!inside).then_some(FenceBreach::FENCE_BREACH_BOUNDARY)
}
