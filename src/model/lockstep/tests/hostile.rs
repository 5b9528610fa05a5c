//! Nonsense on every link: nothing panics, memory stays bounded, a flight goes on.

use std::sync::{Arc, Mutex};

use super::*;
use crate::board::Firmware;
use haltere_core::time::HostTime;
use haltere_pilot::{Input, LinkId, Pilot};

#[test]
fn prop_hostile_bytes_on_the_ground_link_change_nothing() {
    let path = |hostile: bool| {
        let mut world = world(31);
        let mut rng = Stream::new(31, "hostile ground");
        let mut ground = Ground::new();
        ground.upload(&mut world, &square());
        arm(&mut world, &mut ground);
        ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
        // From here on nothing is asked any more.
        let mut path = Vec::new();
        let mut bytes = Vec::new();
        for _ in 0..4000 {
            if hostile {
                bytes.clear();
                for _ in 0..(rng.uniform() * 300.0) as usize {
                    let byte = (rng.uniform() * 256.0) as u8;
                    // Markers, our own ids and short lengths are what gets furthest.
                    bytes.push(match byte % 8 {
                        0 => 0xFD,
                        1 => 0xFE,
                        2 => 1,
                        _ => (rng.uniform() * 256.0) as u8,
                    });
                }
                world.ground_in_at(0, &bytes);
            }
            fly_for(&mut world, 0.01);
            path.push((world.pilot().mode(), world.truth().pos_E_m));
        }
        path
    };
    let (quiet, hostile) = (path(false), path(true));
    assert!(quiet.iter().any(|(mode, _)| *mode == Mode::Mission));
    assert!(quiet == hostile, "the flight was changed");
}

/// A link's bytes as they were recorded, by link.
struct Recorded {
    tag: Vec<u8>,
    board: Vec<u8>,
    ground: Vec<u8>,
}

fn recorded(firmware: Firmware) -> Recorded {
    let heard = Arc::new(Mutex::new((Vec::new(), Vec::new())));
    let into = heard.clone();
    let mut plant = PlantConfig::hall(41);
    plant.board.firmware = firmware;
    let (pilot, survey) = (pilot_config(&plant), plant.survey.clone());
    let world = Lockstep::new(plant, pilot, &survey).unwrap();
    let world = world.with_damage(Box::new(move |_, link, bytes| {
        let mut heard = into.lock().unwrap();
        match link {
            LinkId::Tag => heard.0.extend_from_slice(bytes),
            LinkId::Board => heard.1.extend_from_slice(bytes),
            LinkId::Ground(_) => {}
        }
    }));
    let (mut world, mut ground) = hovering(world);
    fly_for(&mut world, 15.0);
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
    until(&mut world, Mode::Disarmed, 20.0);
    let (tag, board) = heard.lock().unwrap().clone();
    // What a client could say: commands of all kinds with all kinds of numbers.
    let mut ground = Vec::new();
    let mut rng = Stream::new(41, "commands");
    for sequence in 0..600u16 {
        client_says(&mut rng, sequence as u8, &mut ground);
    }
    Recorded { tag, board, ground }
}

fn wild(rng: &mut Stream) -> f32 {
    const SHARP: [f32; 14] = [
        0.0,
        1.0,
        -1.0,
        2.0,
        5.0,
        -1.5,
        1e-30,
        1e30,
        -1e30,
        21196.0,
        393_216.0,
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
    ];
    SHARP[(rng.uniform() * 14.0) as usize]
}

fn client_says(rng: &mut Stream, sequence: u8, out: &mut Vec<u8>) {
    use haltere_dialect::mav::haltere::*;
    const COMMANDS: [MavCmd; 14] = [
        MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        MavCmd::MAV_CMD_NAV_TAKEOFF,
        MavCmd::MAV_CMD_NAV_LAND,
        MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH,
        MavCmd::MAV_CMD_DO_SET_MODE,
        MavCmd::MAV_CMD_MISSION_START,
        MavCmd::MAV_CMD_DO_PAUSE_CONTINUE,
        MavCmd::MAV_CMD_DO_REPOSITION,
        MavCmd::MAV_CMD_DO_CHANGE_SPEED,
        MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT,
        MavCmd::MAV_CMD_CONDITION_YAW,
        MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        MavCmd::MAV_CMD_REQUEST_MESSAGE,
        MavCmd::MAV_CMD_INJECT_FAILURE,
    ];
    let command = COMMANDS[(rng.uniform() * 14.0) as usize];
    let target = (1, 1);
    let message = match (rng.uniform() * 9.0) as u32 {
        0 | 1 => MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1: wild(rng),
            param2: wild(rng),
            param3: wild(rng),
            param4: wild(rng),
            param5: wild(rng),
            param6: wild(rng),
            param7: wild(rng),
            command: command as u16,
            target_system: target.0,
            target_component: target.1,
            confirmation: 0,
        }),
        2 => MavMessage::COMMAND_INT(COMMAND_INT_DATA {
            param1: wild(rng),
            param2: wild(rng),
            param3: wild(rng),
            param4: wild(rng),
            x: (wild(rng) * 1e4) as i32,
            y: (wild(rng) * 1e4) as i32,
            z: wild(rng),
            command: command as u16,
            target_system: target.0,
            target_component: target.1,
            frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
            current: 0,
            autocontinue: 0,
        }),
        3 => MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: wild(rng) as u16,
            target_system: target.0,
            target_component: target.1,
            mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION as u8,
            opaque_id: 0,
        }),
        4 => MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
            seq: wild(rng) as u16,
            param1: wild(rng),
            param2: wild(rng),
            param4: wild(rng),
            z: wild(rng),
            target_system: target.0,
            target_component: target.1,
            ..item(command, [5.0, 5.0, -1.0], 0.0)
        }),
        5 => MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
            seq: wild(rng) as u16,
            target_system: target.0,
            target_component: target.1,
            mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION as u8,
        }),
        6 => MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1: 0,
            ts1: (f64::from(wild(rng)) * 1e9) as i64,
            target_system: target.0,
            target_component: target.1,
        }),
        _ => MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
            x: wild(rng),
            y: wild(rng),
            z: wild(rng),
            vx: wild(rng),
            vy: wild(rng),
            vz: wild(rng),
            yaw: wild(rng),
            yaw_rate: wild(rng),
            type_mask: PositionTargetTypemask::from_bits_retain((rng.uniform() * 4096.0) as u16),
            coordinate_frame: [
                MavFrame::MAV_FRAME_LOCAL_NED,
                MavFrame::MAV_FRAME_BODY_FRD,
                MavFrame::MAV_FRAME_LOCAL_OFFSET_NED,
            ][(rng.uniform() * 3.0) as usize] as u8,
            target_system: target.0,
            target_component: target.1,
            ..Default::default()
        }),
    };
    haltere_dialect::mav_stream::encode(out, 255, 190, sequence, &message);
}

/// One random history. What came out of it: bytes sent, largest burst of one call.
fn ordeal(seed: u64, recorded: &Recorded) -> (usize, usize) {
    let mut rng = Stream::new(seed, "ordeal");
    let plant = PlantConfig::hall(seed);
    let config = pilot_config(&plant);
    let mut t_us: u64 = 100_000_000;
    let mut pilot = Pilot::new(config, plant.survey.clone(), HostTime::from_us(t_us));
    let mut cursors = [0_usize; 3];
    let (mut sent, mut burst) = (0, 0);
    for _ in 0..6000 {
        t_us = match (rng.uniform() * 400.0) as u32 {
            0 => t_us.saturating_sub((rng.uniform() * 3e6) as u64),
            1 => t_us + (rng.uniform() * 3e6) as u64,
            2 if rng.uniform() < 0.05 => t_us + 3_600_000_000,
            _ => t_us + (rng.uniform() * 4000.0) as u64,
        };
        let at = HostTime::from_us(t_us);
        let which = (rng.uniform() * 3.0) as usize;
        let link = [LinkId::Tag, LinkId::Board, LinkId::Ground(0)][which];
        let other = [LinkId::Ground(0), LinkId::Ground(1), LinkId::Ground(255), LinkId::Tag]
            [(rng.uniform() * 4.0) as usize];
        match (rng.uniform() * 100.0) as u32 {
            0 => pilot.handle(at, Input::LinkUp { link }),
            1 => pilot.handle(at, Input::LinkDown { link: other }),
            2 => {
                let reason = haltere_core::drops::DropReason::InputQueueFull;
                pilot.handle(at, Input::Lost { link: other, reason, count: u64::MAX });
            }
            3..30 => pilot.handle(at, Input::Wake),
            _ => {
                let source = [&recorded.tag, &recorded.board, &recorded.ground][which];
                let cursor = &mut cursors[which];
                match (rng.uniform() * 30.0) as u32 {
                    0 => *cursor = (rng.uniform() * source.len() as f64) as usize,
                    1 => *cursor = cursor.saturating_sub(200), // once more
                    _ => {}
                }
                let len = (rng.uniform() * 160.0) as usize;
                let end = (*cursor + len).min(source.len());
                let mut bytes = source[*cursor..end].to_vec();
                *cursor = if end == source.len() { 0 } else { end };
                if rng.uniform() < 0.1 && !bytes.is_empty() {
                    let i = (rng.uniform() * bytes.len() as f64) as usize;
                    bytes[i] ^= 1 << ((rng.uniform() * 8.0) as u32);
                }
                let link = if rng.uniform() < 0.02 { other } else { link };
                pilot.handle(at, Input::Bytes { link, bytes: &bytes });
            }
        }
        let mut out = 0;
        pilot.drain_output(|_, bytes| out += bytes.len());
        pilot.drain_topics(|_| {});
        sent += out;
        burst = burst.max(out);
        let deadline = pilot.next_deadline();
        assert!(deadline.seconds_since(at) <= 3601.0 * 6000.0);
        assert!(pilot.estimate().pos_E_m.is_finite());
        assert!(pilot.control_record().thrust_frac.is_finite());
    }
    (sent, burst)
}

#[test]
fn prop_no_history_of_inputs_panics_or_floods() {
    use rayon::prelude::*;
    let firmwares = [Firmware::Generic, Firmware::Px4, Firmware::Ardupilot];
    let recorded = firmwares.map(recorded);
    let of = |seed: u64| &recorded[(seed % 3) as usize];
    let results: Vec<_> = (0..72u64).into_par_iter().map(|seed| ordeal(seed, of(seed))).collect();
    let burst = results.iter().map(|(_, burst)| *burst).max().unwrap();
    let sent = results.iter().map(|(sent, _)| *sent).max().unwrap();
    println!("most sent {sent} bytes, largest burst {burst} bytes");
    // 160 bytes in can hold some ten short frames, each answered once; a wake sends each stream.
    assert!(burst < 8192, "{burst}");
    assert!(results.iter().all(|(sent, _)| *sent > 10_000), "nothing was alive");
}

#[test]
fn regress_a_leap_in_time_costs_no_time() {
    let plant = PlantConfig::hall(1);
    let at = HostTime::from_us(1_000_000);
    let mut pilot = Pilot::new(pilot_config(&plant), plant.survey.clone(), at);
    // A century at 100 Hz would be 3e11 turns of a loop; the end of the range would be endless.
    for t_us in [1_000_000 + 3_155_760_000_000_000, u64::MAX / 2, u64::MAX - 5, u64::MAX] {
        pilot.handle(HostTime::from_us(t_us), Input::Wake);
        pilot.drain_output(|_, _| {});
        pilot.drain_topics(|_| {});
    }
}
