//! Cost of the plant per step of 2 ms, as a flight would see it: all streams on, tag in binary.
//!
//! `cargo bench --bench plant`

use std::time::Instant;

use haltere_core::frames::{E, Vec3};
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;
use haltere_dialect::mav::haltere::{
    AttitudeTargetTypemask, COMMAND_LONG_DATA, MavCmd, MavMessage, SET_ATTITUDE_TARGET_DATA,
};
use haltere_dialect::mav_stream::encode;
use haltere_model::{EffectSet, Plant, PlantConfig};

const FLIGHT_S: u64 = 90;
const FLIGHTS: usize = 5;

fn survey() -> Survey {
    let anchors: Vec<_> = (0..8u8)
        .map(|i| {
            let at = |bit: u8, low: f64, high: f64| if i & bit == 0 { low } else { high };
            let pos_E_m = Vec3::<E>::new(at(1, 0.1, 9.9), at(2, 0.1, 9.9), at(4, -0.2, -6.8));
            (AnchorId(i), pos_E_m)
        })
        .collect();
    Survey::new(&anchors).expect("the corners of a hall are a good survey")
}

/// Flies for `FLIGHT_S` and returns time per step in nanoseconds and bytes produced.
fn fly(effects: &EffectSet) -> (f64, usize) {
    let mut config = PlantConfig::new(survey(), 1);
    config.effects = effects.clone();
    let mut plant = Plant::new(config).expect("a nominal plant");
    let mut out = Vec::new();
    let mut send = |plant: &mut Plant, message: &MavMessage| {
        out.clear();
        encode(&mut out, 1, 191, 0, message);
        plant.board_input(&out);
    };
    let command = |command, param1, param2| {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command,
            param1,
            param2,
            target_system: 1,
            target_component: 1,
            ..COMMAND_LONG_DATA::DEFAULT
        })
    };
    plant.tag_input(b"b");
    for (id, interval_us) in [(105.0, 4000.0), (31.0, 10_000.0), (147.0, 100_000.0)] {
        let ask = command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16, id, interval_us);
        send(&mut plant, &ask);
    }
    send(&mut plant, &command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM as u16, 1.0, 0.0));
    let begin = Instant::now();
    let mut bytes = 0;
    for tick in 1..=FLIGHT_S * 100 {
        let t = plant.truth();
        let place_E_m = Vec3::<E>::new(5.0, 5.0, -1.2);
        let e = (place_E_m - t.pos_E_m).raw() - t.vel_E_mps.raw();
        let pitch = -0.15 * e.x.clamp(-1.0, 1.0);
        let roll = 0.15 * e.y.clamp(-1.0, 1.0);
        let thrust = 4.73 / t.supply_v * (1.0 - 0.25 * e.z.clamp(-1.0, 1.0));
        let setpoint = MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
            q: [1.0, (0.5 * roll) as f32, (0.5 * pitch) as f32, 0.0],
            thrust: thrust as f32,
            target_system: 1,
            target_component: 1,
            type_mask: AttitudeTargetTypemask::from_bits_truncate(7),
            ..SET_ATTITUDE_TARGET_DATA::DEFAULT
        });
        send(&mut plant, &setpoint);
        plant.advance_to(tick * 10_000);
        bytes += plant.tag_output().len() + plant.board_output().len();
        plant.tag_output().clear();
        plant.board_output().clear();
    }
    let elapsed = begin.elapsed();
    assert!(!plant.truth().crashed, "the bench must measure a flight");
    (elapsed.as_nanos() as f64 / (FLIGHT_S * 500) as f64, bytes)
}

fn main() {
    for (name, effects) in [("no effects", EffectSet::none()), ("nominal", EffectSet::nominal())] {
        let mut best = f64::MAX;
        let mut bytes = 0;
        for _ in 0..FLIGHTS {
            let (ns, n) = fly(&effects);
            best = best.min(ns);
            bytes = n;
        }
        let flight_ms = best * (FLIGHT_S * 500) as f64 * 1e-6;
        let speed = FLIGHT_S as f64 * 1e3 / flight_ms;
        println!(
            "plant, {name}: {best:.0} ns per step, {flight_ms:.1} ms per {FLIGHT_S} s flight, \
             {speed:.0} x real time, {bytes} bytes"
        );
    }
}
