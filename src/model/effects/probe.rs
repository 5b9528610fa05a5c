//! Test support: one effect, built alone, and a state of hover to look at.

use nalgebra::Vector3;

use crate::effects::{Build, Effect, EffectSpec, State};
use crate::random::Stream;
use crate::room::Room;
use crate::tag::air::Packet;
use crate::vehicle::Vehicle;
use haltere_core::frames::G_MPS2;

/// The effect with its defaults, overridden by name.
pub fn build(spec: &EffectSpec, given: &[(&str, f64)]) -> Box<dyn Effect> {
    let value: Vec<f64> = spec
        .parameters
        .iter()
        .map(|p| given.iter().find(|(name, _)| *name == p.name).map_or(p.default, |(_, v)| *v))
        .collect();
    for (name, _) in given {
        assert!(spec.parameters.iter().any(|p| p.name == *name), "{spec:?} has no {name}");
    }
    build_values(spec, &value, &Vehicle::default())
}

/// The effect with these values.
pub fn build_values(spec: &EffectSpec, value: &[f64], vehicle: &Vehicle) -> Box<dyn Effect> {
    let nominal = Vehicle::default();
    let sites = sites();
    (spec.build)(Build {
        vehicle,
        nominal: &nominal,
        room: &Room::default(),
        sites_E_m: &sites,
        value,
        rng: Stream::new(1, spec.id),
    })
}

/// Eight anchors in the corners of the hall, the first four low.
pub fn sites() -> Vec<Vector3<f64>> {
    (0..8u8)
        .map(|i| {
            let at = |bit: u8, low: f64, high: f64| if i & bit == 0 { low } else { high };
            Vector3::new(at(1, 0.1, 9.9), at(2, 0.1, 9.9), at(4, -0.2, -6.8))
        })
        .collect()
}

/// Level hover in the middle of the hall, 1.2 m high.
pub fn hover() -> State {
    let v = Vehicle::default();
    State {
        t_s: 10.0,
        pos_E_m: Vector3::new(5.0, 5.0, -1.2),
        acc_B_mps2: Vector3::new(0.0, 0.0, -G_MPS2),
        flap_hz: [v.hover_hz(); 2],
        thrust_n: [0.5 * v.body.mass_kg * G_MPS2; 2],
        height_m: 1.2 - v.body.gear_m,
        supply_v: 7.4,
        current_a: 3.5,
        charge_frac: 0.8,
        on_ground: false,
        ..State::default()
    }
}

/// A packet from anchor `from` to a tag at `tag_E_m`.
pub fn packet(from: usize, tag_E_m: Vector3<f64>) -> Packet {
    Packet::new(from, &sites(), tag_E_m)
}

/// An exact reading of level hover.
pub fn reading() -> crate::effects::ImuReading {
    crate::effects::ImuReading {
        acc_B_mps2: Vector3::new(0.0, 0.0, -G_MPS2),
        rate_B_radps: Vector3::zeros(),
        pressure_pa: 101_325.0,
    }
}

/// The vehicle after the effect has edited it.
pub fn edited(spec: &EffectSpec, given: &[(&str, f64)]) -> Vehicle {
    let mut vehicle = Vehicle::default();
    build(spec, given).vehicle(&mut vehicle);
    vehicle
}
