//! The plant whole: determinism, hover, landing, effects.

use nalgebra::Vector3;

use super::rig::{Rig, hold};
use crate::effects::EffectSet;
use crate::faults::{Fault, FaultKind};
use haltere_core::frames::G_MPS2;

fn place() -> Vector3<f64> {
    Vector3::new(5.0, 5.0, -1.5)
}

#[test]
fn prop_rests_on_the_floor_without_drifting() {
    let mut rig = Rig::new(EffectSet::nominal());
    let before = rig.plant.truth();
    rig.run(5.0);
    let after = rig.plant.truth();
    assert_eq!(before.pos_E_m, after.pos_E_m);
    assert!(after.on_ground && after.landed && !after.crashed && !after.armed);
    assert!((after.acc_B_mps2.z() + G_MPS2).abs() < 1e-9);
}

#[test]
fn val_trim_hover_command_times_voltage_is_4_73() {
    let mut rig = Rig::new(EffectSet::nominal());
    assert!(rig.arm().is_some());
    rig.hover(8.0, place());
    let (mut sum, mut flap, mut n) = (0.0, 0.0, 0.0);
    rig.fly(20.0, |t| {
        let command = hold(t, place(), [0.0, 0.0]);
        sum += command[3] * t.supply_v;
        flap += 0.5 * (t.flap_hz[0] + t.flap_hz[1]);
        n += 1.0;
        command
    });
    // Recorded flights: within 1.5 %.
    assert!((sum / n / 4.73 - 1.0).abs() < 0.015, "{}", sum / n);
    assert!((flap / n - 12.75).abs() < 0.15, "{}", flap / n);
    assert!((rig.plant.truth().pos_E_m.raw() - place()).norm() < 0.15);
}

#[test]
fn prop_two_runs_are_equal_byte_for_byte() {
    let run = |seed| {
        let mut rig = Rig::with(EffectSet::nominal(), |c| c.seed = seed);
        rig.plant.tag_input(b"b");
        rig.arm();
        for id in [105.0, 31.0, 147.0] {
            rig.command(
                haltere_dialect::mav::haltere::MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                [id, 10_000.0, 0.0],
            );
        }
        rig.hover(4.0, place());
        (std::mem::take(rig.plant.tag_output()), rig.plant.truth(), format!("{:?}", rig.heard))
    };
    let (a, b, c) = (run(3), run(3), run(4));
    assert_eq!(a, b);
    assert_ne!(a.0, c.0);
    assert!(a.0.len() > 100_000 && a.2.len() > 100_000);
}

#[test]
fn prop_switching_one_effect_keeps_the_draws_of_the_others() {
    // With the body at rest, an effect on the anchors' paths must not change the IMU bytes.
    let run = |effects| {
        let mut rig = Rig::new(effects);
        rig.command(
            haltere_dialect::mav::haltere::MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            [105.0, 4000.0, 0.0],
        );
        rig.heard.clear();
        rig.run(2.0);
        format!("{:?}", rig.heard)
    };
    let without = run(EffectSet::nominal().without("N15").unwrap());
    assert_eq!(run(EffectSet::nominal()), without);
    assert_ne!(run(EffectSet::nominal().without("N11").unwrap()), without);
}

#[test]
fn val_forward_flight_feels_4_2_per_second_of_drag() {
    let mut effects = EffectSet::none();
    for id in ["N1", "N2", "N3", "N4", "N5", "N6"] {
        effects = effects.with(id, &[]).unwrap();
    }
    let mut rig = Rig::new(effects);
    rig.arm();
    rig.hover(6.0, place());
    let t = rig.fly(1.2, |t| [0.0, -0.3, 0.0, 4.73 / t.supply_v]);
    let v_B = t.R_EB.inverse() * t.vel_E_mps;
    // What the accelerometer feels along x is drag, and thrust leaned by the dihedral hinge.
    let lean_mps2 = t.thrust_n * 0.35 * t.dihedral_rad.sin() / 0.102;
    let cop_mps = v_B.x() - 0.027 * t.rate_B_radps.y();
    let rate = (lean_mps2 - t.acc_B_mps2.x()) / cop_mps;
    let expected = 0.0169 * (t.flap_hz[0] + t.flap_hz[1]) / 0.102;
    assert!(v_B.x() > 0.5 && (rate / expected - 1.0).abs() < 0.02, "{rate} {expected}");
    assert!((3.9..4.6).contains(&rate), "{rate}");
}

#[test]
fn prop_battery_sags_in_4_to_6_minutes_of_flight() {
    let mut rig = Rig::new(EffectSet::nominal());
    rig.arm();
    let mut seconds = 0.0;
    while rig.hover(5.0, place()).supply_v > 6.4 && seconds < 600.0 {
        seconds += 5.0;
    }
    assert!((240.0..360.0).contains(&seconds), "{seconds}");
}

#[test]
fn prop_setpoints_stop_level_descend_cut() {
    let mut rig = Rig::new(EffectSet::nominal());
    rig.arm();
    rig.hover(8.0, place());
    rig.run(0.45);
    assert!(rig.plant.truth().height_m > 1.2, "flies on with the last setpoint");
    rig.run(1.0);
    let t = rig.plant.truth();
    assert!(t.armed && t.vel_E_mps.z() > 0.1 && t.vel_E_mps.z() < 1.6, "{t:?}");
    rig.run(4.0);
    let t = rig.plant.truth();
    assert!(!t.armed && t.on_ground && !t.crashed, "{t:?}");
}

#[test]
fn prop_forced_cut_in_the_air_is_a_crash() {
    let mut rig = Rig::new(EffectSet::nominal());
    rig.arm();
    rig.hover(8.0, place());
    rig.command(
        haltere_dialect::mav::haltere::MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        [0.0, 21196.0, 0.0],
    );
    rig.run(2.0);
    let t = rig.plant.truth();
    assert!(t.crashed && !t.armed && t.on_ground);
}

#[test]
fn prop_faults_do_what_they_say() {
    let mut rig = Rig::new(EffectSet::nominal());
    rig.plant.tag_input(b"b");
    rig.arm();
    rig.hover(6.0, place());
    let before = rig.plant.truth().supply_v;
    rig.plant.inject(Fault::BatteryDrop(0.6)).unwrap();
    rig.hover(0.5, place());
    assert!(rig.plant.truth().supply_v < before - 0.5);
    rig.plant.inject(Fault::TagSilent(true)).unwrap();
    rig.hover(0.1, place());
    rig.plant.tag_output().clear();
    rig.hover(0.5, place());
    assert!(rig.plant.tag_output().is_empty());
    rig.plant.inject(Fault::BoardLink(FaultKind::Off)).unwrap();
    rig.run(0.1);
    rig.heard.clear();
    rig.run(2.0);
    assert!(rig.heard.is_empty());
    assert!(rig.plant.inject(Fault::AnchorSilent { anchor: 99, silent: true }).is_err());
    let on = |id: &str, values| Fault::EffectOn { id: id.into(), values };
    rig.plant.inject(on("A5", vec![("north".into(), 0.5)])).unwrap();
    assert!(rig.plant.inject(on("I1", vec![])).is_err(), "mass cannot change in flight");
    assert!(rig.plant.inject(on("A5", vec![("nroth".into(), 0.5)])).is_err());
    rig.run(0.002);
    assert_eq!(rig.plant.truth().wind_E_mps.x(), 0.5);
    rig.plant.inject(Fault::EffectOff("A5".into())).unwrap();
    rig.run(0.002);
    assert_eq!(rig.plant.truth().wind_E_mps.x(), 0.0);
}

#[test]
fn prop_bad_configuration_is_refused_with_every_reason() {
    let mut config = super::PlantConfig::new(super::rig::survey(), 1);
    config.vehicle.body.mass_kg = -1.0;
    config.board.setpoint_timeout_s = f64::NAN;
    config.room.ceiling_m = 0.1;
    let says = super::Plant::new(config).err().unwrap();
    assert_eq!(says.lines().len(), 3, "{says}");
}
