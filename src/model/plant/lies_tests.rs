//! What is said on the wires that is not so.

use haltere_dialect::mav::haltere::{HEARTBEAT_DATA, MavCmd, MavMessage, MavModeFlag};

use super::rig::Rig;
use crate::effects::EffectSet;
use crate::faults::{Fault, SecondVoice};

/// Armed, IMU, attitude and battery on the line, and what is heard in so many seconds after the fault.
fn heard(fault: Fault, seconds: f64) -> Vec<MavMessage> {
    let mut rig = Rig::new(EffectSet::none());
    rig.arm();
    for id in [31.0, 105.0, 147.0] {
        rig.command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [id, 100_000.0, 0.0]);
    }
    rig.run(0.2);
    rig.heard.clear();
    rig.plant.inject(fault).unwrap();
    rig.run(seconds);
    rig.heard
}

fn armed_beats(heard: &[MavMessage]) -> Vec<bool> {
    let is_armed =
        |m: &HEARTBEAT_DATA| m.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
    heard
        .iter()
        .filter_map(|m| match m {
            MavMessage::HEARTBEAT(m) => Some(is_armed(m)),
            _ => None,
        })
        .collect()
}

#[test]
fn prop_so_many_heartbeats_say_disarmed_the_first_at_once() {
    assert_eq!(armed_beats(&heard(Fault::FalseBeats(1), 0.1)), [false]);
    assert_eq!(armed_beats(&heard(Fault::FalseBeats(1), 2.1)), [false, true, true]);
    assert_eq!(armed_beats(&heard(Fault::FalseBeats(2), 2.1)), [false, false, true]);
}

#[test]
fn prop_a_second_board_says_that_it_stands_disarmed() {
    let only_beats = heard(Fault::SecondBoard(Some(SecondVoice::Heartbeat)), 1.5);
    assert!(armed_beats(&only_beats).contains(&false) && armed_beats(&only_beats).contains(&true));
    let imu = |heard: &[MavMessage]| {
        heard.iter().filter(|m| matches!(m, MavMessage::HIGHRES_IMU(_))).count()
    };
    assert!(imu(&only_beats) < 20);
    let all = heard(Fault::SecondBoard(Some(SecondVoice::Everything)), 1.5);
    assert!(imu(&all) > 300, "its own 250 Hz come on top: {}", imu(&all));
}

#[test]
fn prop_a_second_pack_is_told_beside_the_first() {
    let heard = heard(Fault::SecondPack(Some(5.1)), 1.0);
    let packs = |id: u8| {
        let of_id = move |m: &MavMessage| match m {
            MavMessage::BATTERY_STATUS(m) if m.id == id => Some(m.voltages[0]),
            _ => None,
        };
        heard.iter().filter_map(of_id).collect::<Vec<_>>()
    };
    assert!(packs(1).len() >= 9 && packs(1).iter().all(|mv| *mv == 5100), "{:?}", packs(1));
    assert!(packs(0).len() == packs(1).len() && packs(0).iter().all(|mv| *mv > 7000));
}

#[test]
fn prop_a_heading_that_is_off_reads_clockwise() {
    let heard = heard(Fault::HeadingOff(0.5), 0.5);
    let yaw = |m: &MavMessage| match m {
        MavMessage::ATTITUDE_QUATERNION(m) => Some(2.0 * m.q4.atan2(m.q1)),
        _ => None,
    };
    let last = heard.iter().rev().find_map(yaw);
    assert!(last.is_some_and(|yaw| (yaw - 0.5).abs() < 1e-3), "{last:?}");
}

#[test]
fn prop_a_broken_leg_shows_where_it_stands() {
    let mut rig = Rig::new(EffectSet::none());
    rig.run(0.5);
    let lean = |rig: &Rig| rig.plant.truth().R_EB.raw().to_rotation_matrix().matrix()[(2, 2)];
    assert!(lean(&rig) > 0.999);
    rig.plant.inject(Fault::GearLeg(true)).unwrap();
    let least = (0..50).fold(1.0, |least: f64, _| {
        rig.run(0.02);
        least.min(lean(&rig))
    });
    assert!(least < 0.7, "{least}");
}
