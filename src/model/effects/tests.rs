//! What holds for every effect of the list.

use std::collections::BTreeSet;

use nalgebra::{UnitQuaternion, Vector3};

use super::*;
use crate::vehicle::Vehicle;

#[test]
fn prop_list_is_complete_and_says_everything() {
    let ids: BTreeSet<_> = ALL.iter().map(|s| s.id).collect();
    assert_eq!(ids.len(), ALL.len(), "ids are unique");
    // Ids of a letter are counted from one, without a gap.
    for id in &ids {
        let (letter, number) = id.split_at(1);
        let before = (1..number.parse().unwrap()).map(|k: usize| format!("{letter}{k}"));
        before.for_each(|id| assert!(ids.contains(id.as_str()), "{id}"));
    }
    for spec in ALL {
        assert_eq!(spec.id.starts_with('N'), spec.role == Role::Nominal, "{spec:?}");
        for text in [spec.name, spec.off, spec.source, spec.equation] {
            assert!(!text.is_empty(), "{spec:?}");
        }
        assert!(!spec.parameters.is_empty(), "{spec:?}");
        for p in spec.parameters {
            assert!(!p.doc.is_empty() && p.low < p.high, "{spec:?} {}", p.name);
            assert!((p.low..=p.high).contains(&p.default), "{spec:?} {}", p.name);
        }
    }
}

#[test]
fn prop_what_people_read_of_a_deviation_is_whole() {
    for spec in ALL {
        let Some(of) = spec.deviation() else { continue };
        for sentence in [of.verdict, of.apart] {
            assert!(sentence.ends_with('.') && !sentence.contains("  "), "{spec:?}: {sentence}");
        }
        // These stand after a colon.
        for part in [of.causes, of.remedy, of.shows] {
            assert!(!part.is_empty() && !part.ends_with('.'), "{spec:?}: {part}");
        }
        let slots = of.verdict.split('{').skip(1).filter_map(|rest| rest.split('}').next());
        for slot in slots.clone() {
            let fits = |p: &ParameterSpec| p.name == slot || (slot.is_empty() && p.ways.is_some());
            assert!(spec.parameters.iter().any(fits), "{spec:?}: {slot}");
        }
        for p in spec.parameters {
            let is_told = slots.clone().any(|slot| slot == p.name || slot.is_empty());
            assert!(is_told || p.kind != Kind::Component, "{spec:?}: {}", p.name);
            assert!(p.kind != Kind::Component || p.ways.is_some(), "{spec:?}: {}", p.name);
        }
        for id in of.looks_like {
            assert!(*id != spec.id && of.apart.contains(id), "{spec:?}: {id}");
            assert!(ALL.iter().any(|other| other.id == *id), "{spec:?}: {id}");
        }
    }
}

#[test]
fn prop_defaults_of_vehicle_parameters_are_those_of_the_vehicle() {
    let mut vehicle = Vehicle::default();
    for spec in ALL {
        for p in spec.parameters {
            if let Source::Vehicle(field) = p.source {
                assert_eq!(*field(&mut vehicle), p.default, "{spec:?} {}", p.name);
            }
        }
    }
}

/// Everything that an effect can touch, after it has touched it.
fn touched(effect: &mut dyn Effect, s: &State) -> String {
    let mut vehicle = Vehicle::default();
    effect.vehicle(&mut vehicle);
    let mut board = BoardSettings::default();
    effect.board(&mut board);
    let mut sites = probe::sites();
    effect.sites(&mut sites);
    let mut wind = Vector3::new(0.1, 0.2, 0.3);
    effect.wind(s, &mut wind);
    let q = UnitQuaternion::from_euler_angles(0.3, 0.2, 1.0);
    let mut setpoint = Setpoint { q, thrust_frac: 0.6 };
    effect.setpoint(s, &mut setpoint);
    let mut command =
        ActuatorCommand { flap_frac: [0.6, 0.7], dihedral_rad: 0.1, yaw_servo_rad: 0.2 };
    effect.command(s, &mut command);
    let mut actuation = Actuation { flap_hz: [12.0, 25.0], dihedral_rad: 0.1, yaw_servo_rad: 0.2 };
    effect.actuate(s, &mut actuation);
    let mut thrust = [0.4, 0.6];
    effect.thrust(s, &mut thrust);
    let mut wrench = Wrench::default();
    effect.wrench(s, &mut wrench);
    let mut report = Supply { volt: 7.0, current_a: 3.0, charge_frac: 0.5 };
    effect.battery_report(s, &mut report);
    let mut reading = probe::reading();
    effect.imu(s, &mut reading);
    let mut error = AttitudeError::default();
    effect.attitude(s, &mut error);
    let mut skew = [1e-6; 9];
    effect.clocks(s, &mut skew);
    let mut packet = probe::packet(0, Vector3::new(5.0, 5.0, -0.1));
    effect.air(s, &mut packet);
    let mut delivery = Delivery { cargo: Cargo::FromTag, delay_s: 0.001, lost: false };
    effect.link(s, &mut delivery);
    // The identity of some is a zero with a sign: adding zero makes them one.
    wrench.force_B_n.add_scalar_mut(0.0);
    wrench.torque_B_nm.add_scalar_mut(0.0);
    format!(
        "{vehicle:?} {board:?} {sites:?} {wind:?} {setpoint:?} {command:?} {actuation:?} {thrust:?} \
         {wrench:?} {report:?} {reading:?} {error:?} {skew:?} {packet:?} {delivery:?}"
    )
}

/// A lively state: every effect has something to act on.
fn lively() -> State {
    State {
        air_B_mps: Vector3::new(1.0, 0.5, 0.2),
        rate_B_radps: Vector3::new(0.5, 0.4, 0.3),
        height_m: 0.1,
        thrust_n: [0.4, 0.6],
        flap_cycles: 0.3,
        flap_hz: [12.0, 15.0],
        yaw_rad: 0.3,
        ..probe::hover()
    }
}

struct Nothing;
impl Effect for Nothing {}

#[test]
fn prop_off_values_are_the_identity() {
    let untouched = touched(&mut Nothing, &lively());
    for spec in ALL {
        let off: Vec<f64> = spec.parameters.iter().map(|p| p.off).collect();
        let mut effect = probe::build_values(spec, &off, &Vehicle::default());
        assert_eq!(touched(&mut *effect, &lively()), untouched, "{spec:?}");
    }
}

#[test]
fn prop_default_values_do_something() {
    let untouched = touched(&mut Nothing, &lively());
    // These act on the second and later calls, on events, or on stages that are not probed here; N20 to N24 where it is told.
    let late = [
        "N20", "N21", "N22", "N23", "N24", "N7", "P8", "U10", "N18", "U9", "T2", "T3", "P7", "A10",
        "A9", "M7",
    ];
    for spec in ALL.iter().filter(|s| !late.contains(&s.id)) {
        let values: Vec<f64> = spec.parameters.iter().map(|p| p.default).collect();
        let mut effect = probe::build_values(spec, &values, &Vehicle::default());
        assert_ne!(touched(&mut *effect, &lively()), untouched, "{spec:?}");
    }
}

#[test]
fn prop_every_stage_is_declared_by_the_effects_that_act_there() {
    // An effect acts only at stages that it declares: those without any only edit at the start.
    for spec in ALL {
        let values: Vec<f64> = spec.parameters.iter().map(|p| p.default).collect();
        let mut effect = probe::build_values(spec, &values, &Vehicle::default());
        let stages = effect.stages();
        let mut vehicle = Vehicle::default();
        let mut board = BoardSettings::default();
        let mut sites = probe::sites();
        effect.vehicle(&mut vehicle);
        effect.board(&mut board);
        effect.sites(&mut sites);
        let edits = vehicle != Vehicle::default()
            || board != BoardSettings::default()
            || sites != probe::sites();
        assert_ne!(edits, !stages.is_empty(), "{spec:?}: either edits or acts");
    }
}
