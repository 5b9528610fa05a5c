//! A Crazyflie in the plant: its wire, its deck, and the loops that it flies with.

use haltere_dialect::crtp::log::{LogControl, Variable, Variables};
use haltere_dialect::crtp::packet::Packet;
use haltere_dialect::crtp::setpoint::Setpoint;
use haltere_dialect::crtp::toc::{Table, TocAnswer, TocRequest};
use haltere_dialect::crtp::value::Kind;
use haltere_dialect::crtp::{FromBoard, ToBoard};

use super::rig::survey;
use crate::board::Firmware;
use crate::effects::EffectSet;
use crate::faults::{CrazyflieFault, Fault};
use crate::plant::{Plant, PlantConfig};
use haltere_core::frames::Vec3;
use haltere_core::measure::AnchorId;

const STEP_US: u64 = 10_000;

fn crazyflie() -> Plant {
    let mut config = PlantConfig::new(survey(), 7);
    config.effects = EffectSet::none();
    config.board.firmware = Firmware::Crazyflie;
    config.start_E_m = Vec3::new(3.0, 4.0, 0.0);
    config.board.crazyflie.radio.packets_hz = 0.0;
    let mut plant = Plant::new(config).unwrap();
    plant.advance_to(1_000_000);
    plant.board_output().clear();
    plant
}

/// Sends it, and what has come after one turn.
fn turn(plant: &mut Plant, message: &ToBoard<'_>) -> Vec<Packet> {
    let packet = message.encode().unwrap();
    let mut bytes = vec![packet.bytes().len() as u8];
    bytes.extend_from_slice(packet.bytes());
    plant.board_input(&bytes);
    plant.advance_to(plant.t_us() + STEP_US);
    let heard = std::mem::take(plant.board_output());
    let (mut rest, mut packets) = (heard.as_slice(), Vec::new());
    while let Some((len, later)) = rest.split_first() {
        let (packet, later) = later.split_at(usize::from(*len));
        packets.push(Packet::read(packet).unwrap());
        rest = later;
    }
    packets
}

fn id_of(plant: &mut Plant, group: &str, name: &str) -> u16 {
    let found = (0..200).find(|id| {
        let packets = turn(plant, &ToBoard::Toc(Table::Log, TocRequest::Item(*id)));
        packets.iter().any(|packet| match FromBoard::decode(packet) {
            Ok(FromBoard::Toc(_, TocAnswer::Item(item))) => {
                (item.group, item.name) == (group, name)
            }
            _ => false,
        })
    });
    found.unwrap()
}

#[test]
fn val_its_deck_measures_what_the_anchors_say() {
    let mut plant = crazyflie();
    assert!(plant.tag_output().is_empty(), "a deck has no line of its own");
    let id = id_of(&mut plant, "tdoa2", "d2-3");
    let mut variables = Variables::default();
    variables.push(Variable { id, kind: Kind::F32 });
    turn(&mut plant, &ToBoard::Log(LogControl::Create(1, variables)));
    turn(&mut plant, &ToBoard::Log(LogControl::Start(1, 10)));
    let mut told_m = f64::NAN;
    for _ in 0..20 {
        for packet in turn(&mut plant, &ToBoard::Log(LogControl::Stop(9))) {
            if let Ok(FromBoard::Row(row)) = FromBoard::decode(&packet) {
                told_m = row.values(&[Kind::F32]).unwrap().next().unwrap().f64();
            }
        }
    }
    let s = plant.truth();
    let tag_E_m = s.pos_E_m.raw() + s.R_EB.raw() * plant.antenna_B_m;
    let range_m = |id| (survey().position_E_m(AnchorId(id)).unwrap().raw() - tag_E_m).norm();
    let true_m = range_m(3) - range_m(2);
    assert!((told_m - true_m).abs() < 0.02, "{told_m} of {true_m}");
}

#[test]
fn prop_it_flies_on_its_setpoints_and_its_faults_are_its_own() {
    let mut plant = crazyflie();
    let ask = |plant: &mut Plant, s: f64, thrust| {
        let asked = Setpoint::Attitude { roll_deg: 0.0, pitch_deg: 0.0, yaw: 0.0, thrust };
        for _ in 0..(s * 100.0) as u32 {
            turn(plant, &ToBoard::Setpoint(asked));
        }
    };
    ask(&mut plant, 0.2, 0);
    assert!(plant.truth().armed, "it arms by itself");
    ask(&mut plant, 1.0, 50_000);
    let up = plant.truth();
    assert!(up.height_m > 0.1 && !up.crashed, "{up:?}");
    plant.inject(Fault::Crazyflie(CrazyflieFault::Lock)).unwrap();
    ask(&mut plant, 0.1, 50_000);
    assert!(!plant.truth().armed);
    let mut other = Plant::new(PlantConfig::new(survey(), 7)).unwrap();
    assert!(other.inject(Fault::Crazyflie(CrazyflieFault::Lock)).is_err());
}
