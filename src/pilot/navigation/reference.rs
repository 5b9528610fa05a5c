//! Poses from motion capture, on any link: recorded as truth, fused only if configured.

use haltere_dialect::mav::haltere::{MavFrame, MavMessage};

use haltere_core::frames::{B, E, Rot, Vec3};
use haltere_core::measure::ReferencePose;
use haltere_core::time::HostTime;

/// A pose as its sender stamped it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WirePose {
    /// The sender's own clock, µs.
    pub time_usec: u64,
    pos_E_m: Vec3<E>,
    attitude: Option<Rot<E, B>>,
}

impl WirePose {
    /// With the time of validity on our clock.
    pub fn stamped(self, valid_at: HostTime, received_at: HostTime) -> ReferencePose {
        ReferencePose { valid_at, received_at, pos_E_m: self.pos_E_m, attitude: self.attitude }
    }
}

/// `None`: not such a message. `Err`: one with a value that is not a number or a frame of its own.
pub(crate) fn from_message(message: &MavMessage) -> Option<Result<WirePose, ()>> {
    let pose = match message {
        MavMessage::ATT_POS_MOCAP(m) => WirePose {
            time_usec: m.time_usec,
            pos_E_m: Vec3::from_array([m.x, m.y, m.z].map(f64::from)),
            attitude: Rot::from_wxyz(m.q.map(f64::from)),
        },
        MavMessage::VISION_POSITION_ESTIMATE(m) => {
            let euler = [m.roll, m.pitch, m.yaw].map(f64::from);
            WirePose {
                time_usec: m.usec,
                pos_E_m: Vec3::from_array([m.x, m.y, m.z].map(f64::from)),
                attitude: euler
                    .iter()
                    .all(|a| a.is_finite())
                    .then(|| Rot::from_euler_rad(euler[0], euler[1], euler[2])),
            }
        }
        MavMessage::ODOMETRY(m) => {
            if m.frame_id != MavFrame::MAV_FRAME_LOCAL_NED as u8 {
                return Some(Err(()));
            }
            WirePose {
                time_usec: m.time_usec,
                pos_E_m: Vec3::from_array([m.x, m.y, m.z].map(f64::from)),
                attitude: Rot::from_wxyz(m.q.map(f64::from)),
            }
        }
        _ => return None,
    };
    Some(if pose.pos_E_m.is_finite() { Ok(pose) } else { Err(()) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_dialect::mav::haltere::{ATT_POS_MOCAP_DATA, ODOMETRY_DATA};

    #[test]
    fn prop_bad_poses_are_refused() {
        let good = ATT_POS_MOCAP_DATA { x: 1.0, q: [1.0, 0.0, 0.0, 0.0], ..Default::default() };
        let pose = from_message(&MavMessage::ATT_POS_MOCAP(good.clone())).unwrap().unwrap();
        assert_eq!(pose.pos_E_m.x(), 1.0);
        assert!(pose.attitude.is_some());
        let nan = ATT_POS_MOCAP_DATA { y: f32::NAN, ..good };
        assert_eq!(from_message(&MavMessage::ATT_POS_MOCAP(nan)), Some(Err(())));
        let wrong_frame =
            ODOMETRY_DATA { frame_id: MavFrame::MAV_FRAME_LOCAL_FRD as u8, ..Default::default() };
        assert_eq!(from_message(&MavMessage::ODOMETRY(wrong_frame)), Some(Err(())));
    }
}
