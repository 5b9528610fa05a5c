//! Two boards with the factory's number on one port, and one board behind a router that changes its port.

use core::net::SocketAddr;

use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream;

use super::boards::{arm_patiently, assert_said, in_hover, land, pass, said};
use super::*;
use crate::Plant;
use crate::board::Firmware;
use crate::faults::{Fault, FaultKind};
use haltere_pilot::{Input, LinkId};

fn address(port: u16) -> SocketAddr {
    SocketAddr::from(([10, 0, 0, 3], port))
}

fn at_address(world: &mut Lockstep, port: u16) {
    world.input(Input::Peer { link: LinkId::Board, address: address(port) });
}

/// A hall whose board speaks over UDP, from port 1.
fn over_udp(seed: u64, firmware: Firmware) -> Lockstep {
    let mut world = super::boards::board(firmware, seed, |_, _| {});
    at_address(&mut world, 1);
    world
}

/// Another vehicle on the floor, whose board speaks from port 2.
struct Second {
    plant: Plant,
    began_us: u64,
}

impl Second {
    fn new(world: &Lockstep, seed: u64) -> Self {
        let mut plant = Plant::new(PlantConfig::hall(seed)).unwrap();
        // It streams, by order of whoever flew it last.
        for id in [105.0, 31.0, 147.0] {
            let message = haltere_dialect::mav::haltere::COMMAND_LONG_DATA {
                command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16,
                param1: id,
                param2: 10_000.0,
                target_system: 1,
                target_component: 1,
                ..Default::default()
            };
            let mut bytes = Vec::new();
            mav_stream::encode(&mut bytes, 1, 191, 0, &MavMessage::COMMAND_LONG(message));
            plant.board_input(&bytes);
        }
        Self { plant, began_us: world.t_us() }
    }

    /// Both go on.
    fn pass(&mut self, world: &mut Lockstep, ground: &mut Ground, seconds: f64) {
        let end_us = world.t_us() + (seconds * 1e6) as u64;
        while world.t_us() < end_us {
            fly_for(world, 0.002);
            self.plant.advance_to(world.t_us() - self.began_us);
            let bytes = std::mem::take(self.plant.board_output());
            if !bytes.is_empty() {
                at_address(world, 2);
                world.input(Input::Bytes { link: LinkId::Board, bytes: &bytes });
                at_address(world, 1);
            }
            ground.listen(world);
        }
    }
}

#[test]
fn regress_a_board_whose_port_changes_in_hover_is_flown_on() {
    for firmware in [Firmware::Generic, Firmware::Px4, Firmware::Ardupilot] {
        let (mut world, mut ground) = in_hover(over_udp(41, firmware));
        assert_eq!(world.pilot().board_address(), Some(address(1)));
        for port in [2, 3] {
            // What is sent to the old port goes nowhere.
            at_address(&mut world, port);
            world.plant_mut().inject(Fault::ToBoard(FaultKind::Off)).unwrap();
            let began_us = world.t_us();
            while world.pilot().board_address() != Some(address(port)) {
                world.step();
                assert!(world.t_us() - began_us < 350_000, "{firmware:?}");
            }
            assert!(world.t_us() - began_us >= 290_000, "not while the old one may still speak");
            world.plant_mut().inject(Fault::ToBoard(FaultKind::Healthy)).unwrap();
            pass(&mut world, &mut ground, 4.0);
            let texts = said(&mut world, &mut ground);
            assert_eq!(world.pilot().mode(), Mode::Hold, "{firmware:?}: {texts:#?}");
            assert!((world.truth().height_m - 1.2).abs() < 0.6, "{:?} {texts:#?}", world.truth());
        }
        assert_said(&mut world, &mut ground, &["10.0.0.3:2", "10.0.0.3:3", "same by its clock"]);
        land(&mut world, &mut ground);
    }
}

#[test]
fn regress_a_second_board_in_flight_is_named_and_not_heard() {
    for after_s in [0.0, 0.3, 0.77] {
        let (mut world, mut ground) = in_hover(over_udp(42, Firmware::Generic));
        fly_for(&mut world, after_s);
        let mut second = Second::new(&world, 43);
        second.pass(&mut world, &mut ground, 6.0);
        let texts = said(&mut world, &mut ground);
        assert_eq!(world.pilot().mode(), Mode::Hold, "{texts:#?}");
        let error_m = world.truth().pos_E_m - haltere_core::frames::Vec3::new(5.0, 5.0, -1.2);
        assert!(error_m.norm() < 0.5, "{error_m:?} {texts:#?}");
        assert_said(&mut world, &mut ground, &["a second board with system id 1", "10.0.0.3:2"]);
        assert_eq!(world.pilot().board_address(), Some(address(1)));
        land(&mut world, &mut ground);
    }
}

/// Its address falls silent for good; the other one must not be taken for it, though it speaks.
#[test]
fn prop_a_second_board_does_not_take_the_place_of_one_that_is_lost_in_flight() {
    let (mut world, mut ground) = in_hover(over_udp(44, Firmware::Generic));
    let mut second = Second::new(&world, 45);
    world.plant_mut().inject(Fault::BoardLink(FaultKind::Off)).unwrap();
    // While it comes down without a board.
    second.pass(&mut world, &mut ground, 3.5);
    assert_eq!(world.pilot().board_address(), Some(address(1)));
    assert_said(&mut world, &mut ground, &["board silent"]);
    assert!(!second.plant.truth().armed);
}

#[test]
fn prop_nothing_is_armed_while_two_boards_speak() {
    let mut world = over_udp(46, Firmware::Generic);
    let mut ground = Ground::new();
    let mut second = Second::new(&world, 47);
    second.pass(&mut world, &mut ground, 8.0);
    let arming = MavMessage::COMMAND_LONG(haltere_dialect::mav::haltere::COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM as u16,
        param1: 1.0,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    });
    ground.send(&mut world, &arming);
    second.pass(&mut world, &mut ground, 1.0);
    assert_said(&mut world, &mut ground, &["arming refused", "second board", "10.0.0.3"]);
    assert!(!world.truth().armed && world.pilot().mode() == Mode::Disarmed);
    // Switched off it is in nobody's way.
    pass(&mut world, &mut ground, 4.0);
    arm_patiently(&mut world, &mut ground, 10.0);
}

/// On the floor a board that is gone makes room for another one, with another clock.
#[test]
fn prop_on_the_floor_another_board_may_come_after_the_first_is_gone() {
    let mut world = over_udp(48, Firmware::Generic);
    let mut ground = Ground::new();
    pass(&mut world, &mut ground, 8.0);
    world.plant_mut().inject(Fault::BoardReboot).unwrap();
    at_address(&mut world, 7);
    pass(&mut world, &mut ground, 2.0);
    assert_eq!(world.pilot().board_address(), Some(address(1)));
    pass(&mut world, &mut ground, 4.0);
    assert_eq!(world.pilot().board_address(), Some(address(7)));
    assert_said(&mut world, &mut ground, &["10.0.0.3:1 is gone", "10.0.0.3:7"]);
    arm_patiently(&mut world, &mut ground, 20.0);
}
