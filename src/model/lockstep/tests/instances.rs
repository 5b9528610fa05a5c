//! Several devices of a kind on one board, and what the board tells of its motors and servos.

use haltere_dialect::mav::haltere::{
    BATTERY_STATUS_DATA, HIGHRES_IMU_DATA, HighresImuUpdatedFlags, MavBatteryFunction, MavMessage,
    RAW_IMU_DATA,
};
use haltere_dialect::mav_stream::{self, MavSplitter};

use super::boards::{arm_patiently, assert_said, board, land, pass, said};
use super::*;
use crate::board::Firmware;
use crate::faults::Fault;
use haltere_core::topics::Topic;
use haltere_pilot::LinkId;

/// Something else of the board, after each message of one id.
fn beside(msg_id: u32, mut message: impl FnMut(u64) -> MavMessage + Send + 'static) -> Damage {
    let mut splitter = MavSplitter::new();
    Box::new(move |t_us, link, bytes| {
        if link != LinkId::Board || bytes.is_empty() {
            return;
        }
        splitter.push(&std::mem::take(bytes));
        while let Some(frame) = splitter.next() {
            let Ok(frame) = frame else { continue };
            bytes.extend_from_slice(frame.raw);
            if frame.header.msg_id == msg_id {
                mav_stream::encode(bytes, 1, 1, frame.header.sequence, &message(t_us));
            }
        }
    })
}

fn pack(id: u8, function: MavBatteryFunction, supply_v: f64) -> MavMessage {
    let mut voltages = [u16::MAX; 10];
    voltages[0] = (supply_v * 1e3) as u16;
    MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
        id,
        battery_function: function as u8,
        voltages,
        current_battery: -1,
        battery_remaining: -1,
        ..Default::default()
    })
}

/// Records of the core while it flies on.
fn records(world: &mut Lockstep, seconds: f64) -> Vec<Topic> {
    world.pilot_mut().drain_topics(|_| {});
    fly_for(world, seconds);
    let mut all = Vec::new();
    world.pilot_mut().drain_topics(|topic| all.push(topic));
    all
}

#[test]
fn regress_a_full_second_pack_does_not_hide_the_empty_one_that_flies() {
    use MavBatteryFunction as F;
    // The board's own says that it drives all; or says nothing, and the id decides.
    for function in [F::MAV_BATTERY_FUNCTION_AVIONICS, F::MAV_BATTERY_FUNCTION_ALL] {
        let world = world(51).with_damage(beside(147, move |_| pack(1, function, 8.3)));
        let (mut world, mut ground) = hovering(world);
        assert_said(&mut world, &mut ground, &["battery 0 is flown on, not 1"]);
        let all = records(&mut world, 1.0);
        let flown = all.iter().filter_map(|t| match t {
            Topic::Battery(b) => Some(b.supply_v),
            _ => None,
        });
        assert!(
            flown.clone().count() >= 9 && flown.clone().all(|v| v < 8.25),
            "{:?}",
            flown.max_by(f64::total_cmp)
        );
        let others = all.iter().filter(
            |t| matches!(t, Topic::OtherBattery(o) if o.id == 1 && o.sample.supply_v == 8.3),
        );
        assert!(others.count() >= 9, "recorded");
        // The flight pack gives way: critical is 6.0 V.
        world.plant_mut().inject(Fault::BatteryDrop(2.2)).unwrap();
        until(&mut world, Mode::Land, 5.0);
        until(&mut world, Mode::Disarmed, 20.0);
        let texts = said(&mut world, &mut ground);
        assert!(!world.truth().crashed && world.truth().on_ground, "{texts:#?}");
    }
}

#[test]
fn regress_an_empty_second_pack_ends_no_flight() {
    let empty = |_| pack(1, MavBatteryFunction::MAV_BATTERY_FUNCTION_AVIONICS, 5.1);
    let (mut world, mut ground) = hovering(world(52).with_damage(beside(147, empty)));
    pass(&mut world, &mut ground, 5.0);
    assert_eq!(world.pilot().mode(), Mode::Hold, "{:#?}", said(&mut world, &mut ground));
    land(&mut world, &mut ground);
}

/// A second IMU and barometer that read nonsense, by id and by message, on the floor or from the air on.
#[test]
fn regress_another_imu_or_barometer_is_not_mixed_with_the_first() {
    let wild = |t_us: u64| {
        let (a, p) = ((t_us % 7) as f32 * 3.0, 1100.0 - (t_us % 5) as f32 * 50.0);
        MavMessage::HIGHRES_IMU(HIGHRES_IMU_DATA {
            time_usec: 4_321_000 + t_us,
            id: 1,
            xacc: a,
            zacc: -2.0,
            zgyro: 2.0,
            abs_pressure: p,
            fields_updated: HighresImuUpdatedFlags::all(),
            ..Default::default()
        })
    };
    let raw = |t_us: u64| {
        MavMessage::RAW_IMU(RAW_IMU_DATA {
            time_usec: 4_321_000 + t_us,
            xacc: 900,
            zacc: 100,
            zgyro: 2000,
            ..Default::default()
        })
    };
    for from_s in [0.0, 12.0] {
        for message in [wild as fn(u64) -> MavMessage, raw] {
            let own_us = (from_s * 1e6) as u64;
            let quiet = MavMessage::HEARTBEAT(Default::default());
            // Before its time something that is nobody's.
            let damage =
                beside(105, move |t_us| if t_us >= own_us { message(t_us) } else { quiet.clone() });
            let (mut world, mut ground) = hovering(world(53).with_damage(damage));
            pass(&mut world, &mut ground, 4.0);
            let texts = said(&mut world, &mut ground);
            assert_eq!(world.pilot().mode(), Mode::Hold, "{texts:#?}");
            let error_m = world.truth().pos_E_m - haltere_core::frames::Vec3::new(5.0, 5.0, -1.2);
            assert!(error_m.norm() < 0.5, "{error_m:?} {texts:#?}");
            if matches!(message(0), MavMessage::HIGHRES_IMU(_)) {
                assert_said(&mut world, &mut ground, &["IMU 0 is flown on, not 1"]);
                assert_said(&mut world, &mut ground, &["barometer 0 is flown on, not 1"]);
            } else {
                let words = "IMU of message 105 is flown on, not 27";
                assert_said(&mut world, &mut ground, &[words]);
            }
            land(&mut world, &mut ground);
        }
    }
}

#[test]
fn prop_each_firmware_tells_what_its_motors_are_told() {
    for firmware in [Firmware::Generic, Firmware::Px4, Firmware::Ardupilot] {
        let mut world = board(firmware, 54, |_, _| {});
        let mut ground = Ground::new();
        pass(&mut world, &mut ground, 8.0);
        arm_patiently(&mut world, &mut ground, 60.0);
        let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.2];
        ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
        until(&mut world, Mode::Hold, 30.0);
        let all = records(&mut world, 2.0);
        let told: Vec<&[f32]> = all
            .iter()
            .filter_map(|t| match t {
                Topic::Servos(servos) => Some(servos.outputs()),
                _ => None,
            })
            .collect();
        assert!((18..=42).contains(&told.len()), "{firmware:?}: {} in 2 s", told.len());
        // Dihedral servo, left wing, yaw servo, right wing: the wings beat, the servos stand near their middle.
        for outputs in told {
            assert!(outputs.len() == 4, "{outputs:?}");
            assert!(outputs[1] > 1300.0 && outputs[3] > 1300.0, "{outputs:?}");
            assert!((outputs[0] - 1500.0).abs() < 300.0, "{outputs:?}");
        }
        // A station that asks is told the same.
        let ask = [36.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let answer = ground.command(&mut world, MavCmd::MAV_CMD_REQUEST_MESSAGE, ask);
        assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
        land(&mut world, &mut ground);
    }
}
