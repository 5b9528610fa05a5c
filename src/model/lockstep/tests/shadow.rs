//! Two companions on one vehicle: one flies, the other is its shadow. Whatever stations order, the shadow sends
//! nothing that arms or moves, and says what it would have sent.

use std::sync::{Arc, Mutex};

use haltere_dialect::mav::haltere::{
    COMMAND_LONG_DATA, MavMessage, PARAM_SET_DATA, SET_ATTITUDE_TARGET_DATA, SET_MODE_DATA,
};
use haltere_dialect::mav::known;
use haltere_dialect::mav_stream::{self, MavSplitter};

use super::*;
use crate::lockstep::{HOST_START_US, fly};
use haltere_core::time::HostTime;
use haltere_core::topics::{ShadowRecord, Topic};
use haltere_pilot::{Endpoint, Input, LinkId, Pilot, Routing};

/// The second companion, and all that it sent, to the board and to its station.
struct Beside {
    pilot: Pilot,
    to_board: Vec<u8>,
    sent: Vec<(u64, LinkId, Vec<u8>)>,
    records: Vec<ShadowRecord>,
    controls: usize,
}

impl Beside {
    fn input(&mut self, t_us: u64, input: Input<'_>) {
        self.pilot.handle(HostTime::from_us(HOST_START_US + t_us), input);
        let Self { pilot, to_board, sent, records, controls } = self;
        pilot.drain_output(|link, bytes| {
            sent.push((t_us, link, bytes.to_vec()));
            if link == LinkId::Board {
                to_board.extend_from_slice(bytes);
            }
        });
        pilot.drain_topics(|topic| match topic {
            Topic::Shadow(record) => records.push(record),
            Topic::Control(_) => *controls += 1,
            _ => {}
        });
    }

    /// Every message that it sent on a link.
    fn messages(&self, link: LinkId) -> Vec<MavMessage> {
        let mut splitter = MavSplitter::new();
        let mut all = Vec::new();
        for (_, _, bytes) in self.sent.iter().filter(|(_, l, _)| *l == link) {
            splitter.push(bytes);
            while let Some(next) = splitter.next() {
                all.push(next.unwrap().decode().unwrap());
            }
        }
        all
    }

    fn said(&self) -> Vec<String> {
        let text = |m: MavMessage| match m {
            MavMessage::STATUSTEXT(m) => Some(String::from_utf8_lossy(&*m.text).into_owned()),
            _ => None,
        };
        self.messages(LinkId::Ground(0)).into_iter().filter_map(text).collect()
    }

    fn order(&mut self, t_us: u64, message: &MavMessage) {
        let mut bytes = Vec::new();
        mav_stream::encode(&mut bytes, 255, 190, 0, message);
        self.input(t_us, Input::Bytes { link: LinkId::Ground(0), bytes: &bytes });
    }
}

fn command(command: MavCmd, target: u8, params: [f32; 3]) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: command as u16,
        param1: params[0],
        param2: params[1],
        param3: params[2],
        target_system: target,
        target_component: 1,
        ..Default::default()
    })
}

/// What a station may think of, to the shadow and through it to the board.
fn orders(board: u8) -> Vec<MavMessage> {
    let mut all = vec![
        MavMessage::SET_MODE(SET_MODE_DATA {
            custom_mode: 2 << 24 | 4 << 16,
            ..Default::default()
        }),
        MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
            target_system: board,
            target_component: 1,
            thrust: 1.0,
            ..Default::default()
        }),
        MavMessage::PARAM_SET(PARAM_SET_DATA {
            target_system: board,
            target_component: 1,
            param_id: (*b"GUID_OPTIONS\0\0\0\0").into(),
            ..Default::default()
        }),
    ];
    for target in [1, board] {
        all.extend([
            command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, target, [1.0, 0.0, 0.0]),
            command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, target, [0.0, 21196.0, 0.0]),
            command(MavCmd::MAV_CMD_DO_FLIGHTTERMINATION, target, [1.0, 0.0, 0.0]),
            command(MavCmd::MAV_CMD_DO_SET_MODE, target, [1.0, 4.0, 6.0]),
            command(MavCmd::MAV_CMD_NAV_TAKEOFF, target, [0.0, 0.0, 0.0]),
            command(MavCmd::MAV_CMD_NAV_LAND, target, [0.0, 0.0, 0.0]),
            command(MavCmd::MAV_CMD_INJECT_FAILURE, target, [101.0, 1.0, 0.0]),
        ]);
    }
    all
}

#[test]
fn prop_a_shadow_sends_nothing_that_arms_or_moves_and_says_what_it_would() {
    const BOARD: u8 = 7;
    let mut plant = PlantConfig::hall(51);
    plant.board.system_id = BOARD;
    let survey = plant.survey.clone();
    let flies = pilot_config(&plant);
    let mut watches = pilot_config(&plant);
    watches.flight.shadow = true;
    watches.routing = Routing::Board;
    watches.board_set_parameters = true;
    watches.endpoints = vec![Endpoint::default()];
    let beside = Arc::new(Mutex::new(Beside {
        pilot: Pilot::new(watches, survey.clone(), HostTime::from_us(HOST_START_US)),
        to_board: Vec::new(),
        sent: Vec::new(),
        records: Vec::new(),
        controls: 0,
    }));
    for link in [LinkId::Tag, LinkId::Board, LinkId::Ground(0)] {
        beside.lock().unwrap().input(0, Input::LinkUp { link });
    }
    let (hears, speaks) = (beside.clone(), beside.clone());
    let mut next_order_us = 5_000_000;
    let mut due = Vec::new();
    let mut world = Lockstep::new(plant, flies, &survey)
        .unwrap()
        .with_damage(Box::new(move |t_us, link, bytes| {
            let mut beside = hears.lock().unwrap();
            if !matches!(link, LinkId::Ground(_)) {
                beside.input(t_us, Input::Bytes { link, bytes });
                beside.input(t_us, Input::Wake);
            }
        }))
        .with_happenings(Box::new(move |t_us, plant| {
            let mut beside = speaks.lock().unwrap();
            if t_us >= next_order_us {
                next_order_us += 200_000;
                if due.is_empty() {
                    due = orders(BOARD);
                }
                let order: MavMessage = due.pop().unwrap();
                beside.order(t_us, &order);
            }
            let bytes = std::mem::take(&mut beside.to_board);
            if !bytes.is_empty() {
                plant.board_input(&bytes);
            }
        }));
    let flight = fly(&mut world, &square(), 90.0).unwrap();
    assert!(flight.landed, "{:?}", flight.texts);
    assert_landed(&world, &flight.texts);

    let beside = beside.lock().unwrap();
    let mut kinds = std::collections::BTreeMap::new();
    for message in beside.messages(LinkId::Board) {
        let asks = match &message {
            MavMessage::COMMAND_LONG(m) => {
                assert!(
                    matches!(
                        known(m.command),
                        Some(
                            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL | MavCmd::MAV_CMD_REQUEST_MESSAGE
                        )
                    ),
                    "{m:?}"
                );
                "command"
            }
            MavMessage::HEARTBEAT(_) => "heartbeat",
            MavMessage::TIMESYNC(_) => "timesync",
            MavMessage::PARAM_REQUEST_READ(_) => "read",
            other => panic!("a shadow sent {other:?}"),
        };
        *kinds.entry(asks).or_insert(0) += 1;
    }
    assert!(kinds["heartbeat"] > 20 && kinds["timesync"] > 20, "{kinds:?}");
    // Refused in words.
    let said = beside.said();
    let told = |what: &str| said.iter().any(|t| t.contains(what));
    assert!(told("only watches") && told("shadow: armed by somebody else"), "{said:?}");
    // What it would send: for the whole flight, close to what the other sent where both hover.
    assert_eq!(beside.controls, 0, "nothing of it was flown");
    assert!(beside.records.len() > 1500, "{}", beside.records.len());
    let hover: Vec<f64> = flight
        .samples
        .iter()
        .filter(|s| s.mode == Mode::Mission && s.truth.vel_E_mps.norm() < 0.2)
        .filter_map(|s| {
            let at = HostTime::from_us(HOST_START_US + s.t_us);
            let near = |r: &&ShadowRecord| at.seconds_since(r.at).abs() < 0.011;
            let would = beside.records.iter().find(near)?;
            Some((would.thrust_frac - s.control.thrust_frac).abs())
        })
        .collect();
    let mean = hover.iter().sum::<f64>() / hover.len().max(1) as f64;
    println!("{kinds:?}; thrust in hover off by {mean:.3} on average of {}", hover.len());
    assert!(hover.len() > 100 && mean < 0.06, "{mean} of {}", hover.len());
    // Its estimate is that of the one who flies.
    let off_m = (beside.pilot.estimate().pos_E_m - world.pilot().estimate().pos_E_m).norm();
    assert!(off_m < 0.5, "{off_m} m");
    assert_eq!(beside.pilot.mode(), Mode::Disarmed);
}
