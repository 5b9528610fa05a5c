//! From the types we compute with to the types on disk, written out by hand.

use super::channels::Decoded;
use super::pb;
use haltere_core::drops::Drops;
use haltere_core::estimate;
use haltere_core::frames::{B, E, Rot, Vec3};
use haltere_core::topics::Topic;

impl Decoded {
    /// A record of the core as it stands in a log.
    pub fn from_topic(topic: &Topic) -> Self {
        match topic {
            Topic::Imu(imu) => Decoded::Imu(pb::Imu {
                valid_at_us: imu.valid_at.as_us(),
                received_at_us: imu.received_at.as_us(),
                acc_b_mps2: vec3(imu.acc_B_mps2),
                rate_b_radps: vec3(imu.rate_B_radps),
            }),
            Topic::Uwb(uwb) => Decoded::Uwb(pb::Uwb {
                valid_at_us: uwb.tdoa.valid_at.as_us(),
                received_at_us: uwb.tdoa.received_at.as_us(),
                anchor_a: u32::from(uwb.tdoa.anchor_a.0),
                anchor_b: u32::from(uwb.tdoa.anchor_b.0),
                distance_diff_m: uwb.tdoa.distance_diff_m,
                std_m: uwb.tdoa.std_m,
                innovation_m: uwb.innovation_m,
                var_innovation_m2: uwb.var_innovation_m2,
                test_ratio: uwb.test_ratio,
                fused: uwb.fused,
            }),
            Topic::Estimate(estimate) => Decoded::Estimate(estimate_message(estimate)),
            Topic::Control(control) => Decoded::Control(pb::Control {
                at_us: control.at.as_us(),
                pos_setpoint_north_m: control.pos_setpoint_E_m[0],
                pos_setpoint_east_m: control.pos_setpoint_E_m[1],
                pos_setpoint_down_m: control.pos_setpoint_E_m[2],
                vel_setpoint_e_mps: vec3(control.vel_setpoint_E_mps),
                roll_rad: control.roll_rad,
                pitch_rad: control.pitch_rad,
                yaw_rad: control.yaw_rad,
                roll_ff_rad: control.roll_ff_rad,
                pitch_ff_rad: control.pitch_ff_rad,
                thrust_frac: control.thrust_frac,
                thrust_base_frac: control.thrust_base_frac,
                thrust_feedback_frac: control.thrust_feedback_frac,
                ground_factor: control.ground_factor,
                hover_factor: Some(control.hover_factor),
                tilt_factor: Some(control.tilt_factor),
                yaw_board_offset_rad: control.yaw_board_offset_rad,
                velocity_cut: control.saturation.velocity,
                tilt_cut: control.saturation.tilt,
                thrust_cut_high: control.saturation.thrust_high,
                thrust_cut_low: control.saturation.thrust_low,
            }),
            Topic::Shadow(shadow) => {
                let [roll_rad, pitch_rad, yaw_rad] = shadow.attitude.euler_rad();
                let theirs = shadow.theirs.map(|(attitude, _)| attitude.euler_rad());
                Decoded::Shadow(pb::Shadow {
                    at_us: shadow.at.as_us(),
                    q_board: quaternion(shadow.attitude),
                    roll_rad,
                    pitch_rad,
                    yaw_rad,
                    thrust_frac: shadow.thrust_frac,
                    place_e_m: vec3(shadow.place_E_m),
                    theirs_roll_rad: theirs.map(|e| e[0]),
                    theirs_pitch_rad: theirs.map(|e| e[1]),
                    theirs_yaw_rad: theirs.map(|e| e[2]),
                    theirs_thrust_frac: shadow.theirs.map(|(_, frac)| frac),
                })
            }
            Topic::Battery(battery) => Decoded::Battery(pb::Battery {
                received_at_us: battery.received_at.as_us(),
                supply_v: battery.supply_v,
                current_a: battery.current_a,
                remaining_frac: battery.remaining_frac,
            }),
            Topic::OtherBattery(other) => Decoded::OtherBattery(pb::OtherBattery {
                received_at_us: other.sample.received_at.as_us(),
                id: u32::from(other.id),
                function: u32::from(other.function),
                supply_v: other.sample.supply_v,
                current_a: other.sample.current_a,
                remaining_frac: other.sample.remaining_frac,
            }),
            Topic::Servos(servos) => Decoded::Servos(pb::Servos {
                received_at_us: servos.received_at.as_us(),
                port: u32::from(servos.port),
                output: servos.outputs().to_vec(),
            }),
            Topic::BoardAttitude(board) => {
                let [roll_rad, pitch_rad, yaw_rad] = board.attitude.euler_rad();
                Decoded::BoardAttitude(pb::BoardAttitude {
                    valid_at_us: board.valid_at.as_us(),
                    received_at_us: board.received_at.as_us(),
                    q_board: quaternion(board.attitude),
                    roll_rad,
                    pitch_rad,
                    yaw_rad,
                })
            }
            Topic::Baro(baro) => Decoded::Baro(pb::Baro {
                valid_at_us: baro.valid_at.as_us(),
                received_at_us: baro.received_at.as_us(),
                pressure_pa: baro.pressure_pa,
            }),
            Topic::Mag(mag) => Decoded::Mag(pb::Mag {
                valid_at_us: mag.valid_at.as_us(),
                received_at_us: mag.received_at.as_us(),
                field_b_tesla: vec3(mag.field_B_tesla),
            }),
            Topic::Reference(reference) => Decoded::Reference(pb::Reference {
                valid_at_us: reference.valid_at.as_us(),
                received_at_us: reference.received_at.as_us(),
                pos_e_m: vec3(reference.pos_E_m),
                q_eb: reference.attitude.and_then(quaternion),
            }),
            Topic::Mode(mode) => Decoded::Mode(pb::Mode {
                at_us: mode.at.as_us(),
                mode: mode.mode.to_owned(),
                armed: mode.armed,
                cause: mode.cause.clone(),
            }),
            Topic::Text(text) => Decoded::Text(pb::Text {
                at_us: text.at.as_us(),
                severity: u32::from(text.severity),
                text: text.text.clone(),
            }),
            Topic::Health(health) => Decoded::Health(pb::Health {
                at_us: health.at.as_us(),
                drops: drop_messages(&health.drops),
                deadline_misses: health.deadline_misses,
                control_steps: health.control_steps,
                uwb_age_s: health.uwb_age_s,
                imu_age_s: health.imu_age_s,
                std_board_clock_s: health.std_board_clock_s,
                left_out: u32::from(health.left_out),
            }),
        }
    }
}

fn estimate_message(estimate: &estimate::Estimate) -> pb::Estimate {
    let [roll_rad, pitch_rad, yaw_rad] = estimate.R_EB.euler_rad();
    pb::Estimate {
        at_us: estimate.at.as_us(),
        pos_e_m: vec3(estimate.pos_E_m),
        vel_b_mps: vec3(estimate.vel_B_mps),
        q_eb: quaternion(estimate.R_EB),
        roll_rad,
        pitch_rad,
        yaw_rad,
        rate_b_radps: vec3(estimate.rate_B_radps),
        vel_e_mps: vec3(estimate.vel_E_mps()),
        std_pos_e_m: vec3(estimate.std_pos_E_m),
        std_vel_b_mps: vec3(estimate.std_vel_B_mps),
        std_att_b_rad: vec3(estimate.std_att_B_rad),
        uwb_noise_factor: estimate.uwb_noise_factor,
        health: match estimate.health {
            estimate::Health::NotAligned => pb::estimate::Health::NotAligned,
            estimate::Health::Good => pb::estimate::Health::Good,
            estimate::Health::Degraded => pb::estimate::Health::Degraded,
            estimate::Health::Lost => pb::estimate::Health::Lost,
        }
        .into(),
    }
}

/// The disk form of losses by link number.
fn drop_messages(drops: &[(u8, Drops)]) -> Vec<pb::Drop> {
    drops
        .iter()
        .flat_map(|(link, drops)| {
            drops.iter().map(|(reason, count)| pb::Drop {
                link: u32::from(*link),
                reason: reason.name().to_owned(),
                count,
            })
        })
        .collect()
}

pub(super) fn vec3<F>(v: Vec3<F>) -> Option<pb::Vec3> {
    Some(pb::Vec3 { x: v.x(), y: v.y(), z: v.z() })
}

fn quaternion(R: Rot<E, B>) -> Option<pb::Quaternion> {
    let [w, x, y, z] = R.to_wxyz();
    Some(pb::Quaternion { w, x, y, z })
}
