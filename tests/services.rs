//! Files, logs, metadata and what is kept: a core in lockstep, with a disk in a temporary folder.
//! Outside of `src/` because it joins layers that must not know one another.

use haltere_dialect::mav::haltere::{
    FILE_TRANSFER_PROTOCOL_DATA, LOG_ERASE_DATA, LOG_REQUEST_DATA_DATA, LOG_REQUEST_LIST_DATA,
    MavMessage, MavMissionResult, MavParamType, PARAM_SET_DATA,
};

use haltere::sources::stored;
use haltere::store::{NoPrograms, Store};
use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavResult};
use haltere_model::PlantConfig;
use haltere_model::lockstep::{Ground, Lockstep};
use haltere_pilot::PilotConfig;
use haltere_pilot::services::crc32;

const PATIENCE_US: u64 = 2_000_000;

/// A world whose disk is a folder.
fn world_on(folder: &std::path::Path, seed: u64) -> Lockstep {
    let plant = PlantConfig::hall(seed);
    let survey = plant.survey.clone();
    let pilot = PilotConfig { store: true, ..PilotConfig::default() };
    let own = folder.join("logs/own.mcap");
    let programs = Box::new(NoPrograms);
    let store = Store::new(&folder.join("state"), &folder.join("logs"), Some(&own), programs);
    let disk = Box::new(move |task: &_| store.work(task).map_err(|(fault, _)| fault));
    Lockstep::new(plant, pilot, &survey).unwrap().with_disk(disk)
}

fn fly_for(world: &mut Lockstep, seconds: f64) {
    world.run_until(world.t_us() + (seconds * 1e6) as u64);
}

/// Up, a side of a square, and down again.
fn plan() -> Vec<MISSION_ITEM_INT_DATA> {
    let item = |command, north: i32, z| MISSION_ITEM_INT_DATA {
        command,
        frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        x: north * 10_000,
        y: 50_000,
        z,
        param4: f32::NAN,
        ..Default::default()
    };
    vec![
        item(MavCmd::MAV_CMD_NAV_TAKEOFF as u16, 5, -1.2),
        item(MavCmd::MAV_CMD_NAV_WAYPOINT as u16, 6, -1.2),
        item(MavCmd::MAV_CMD_NAV_LAND as u16, 6, 0.0),
    ]
}

/// A small FTP client.
struct Client {
    seq: u16,
}

#[derive(Debug, Clone)]
struct Reply {
    seq: u16,
    session: u8,
    opcode: u8,
    complete: bool,
    offset: u32,
    data: Vec<u8>,
}

const ACK: u8 = 128;
const NAK: u8 = 129;

fn reply(m: &MavMessage) -> Option<Reply> {
    let MavMessage::FILE_TRANSFER_PROTOCOL(m) = m else { return None };
    let p = &m.payload;
    Some(Reply {
        seq: u16::from_le_bytes([p[0], p[1]]),
        session: p[2],
        opcode: p[3],
        complete: p[6] != 0,
        offset: u32::from_le_bytes([p[8], p[9], p[10], p[11]]),
        data: p[12..12 + usize::from(p[4])].to_vec(),
    })
}

impl Client {
    fn packet(
        &mut self,
        opcode: u8,
        session: u8,
        offset: u32,
        size: u8,
        data: &[u8],
    ) -> MavMessage {
        self.seq = self.seq.wrapping_add(1);
        let mut payload = [0; 251];
        payload[0..2].copy_from_slice(&self.seq.to_le_bytes());
        payload[2] = session;
        payload[3] = opcode;
        payload[4] = if data.is_empty() { size } else { data.len() as u8 };
        payload[8..12].copy_from_slice(&offset.to_le_bytes());
        payload[12..12 + data.len()].copy_from_slice(data);
        MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
            target_network: 0,
            target_system: 1,
            target_component: 1,
            payload,
        })
    }

    fn ask(
        &mut self,
        world: &mut Lockstep,
        ground: &mut Ground,
        opcode: u8,
        session: u8,
        offset: u32,
        data: &[u8],
    ) -> Reply {
        let packet = self.packet(opcode, session, offset, 239, data);
        ground.send(world, &packet);
        let seq = self.seq.wrapping_add(1);
        ground
            .wait_for(world, PATIENCE_US, |m| reply(m).filter(|r| r.seq == seq))
            .unwrap_or_else(|| panic!("no answer to opcode {opcode}"))
    }

    /// The whole file, read one by one.
    fn read(&mut self, world: &mut Lockstep, ground: &mut Ground, path: &str) -> Vec<u8> {
        let open = self.ask(world, ground, 4, 0, 0, path.as_bytes());
        assert_eq!(open.opcode, ACK, "{path}: {open:?}");
        let size = u32::from_le_bytes(open.data[..4].try_into().unwrap());
        let mut bytes = Vec::new();
        loop {
            let piece = self.ask(world, ground, 5, open.session, bytes.len() as u32, &[]);
            if piece.opcode == NAK {
                assert_eq!(piece.data, [6], "end of file");
                break;
            }
            bytes.extend(piece.data);
        }
        assert_eq!(bytes.len() as u32, size);
        assert_eq!(self.ask(world, ground, 1, open.session, 0, &[]).opcode, ACK);
        bytes
    }

    /// The whole file, in bursts.
    fn burst(&mut self, world: &mut Lockstep, ground: &mut Ground, path: &str) -> Vec<u8> {
        let open = self.ask(world, ground, 4, 0, 0, path.as_bytes());
        let size = u32::from_le_bytes(open.data[..4].try_into().unwrap());
        let mut bytes = Vec::new();
        while (bytes.len() as u32) < size {
            let packet = self.packet(15, open.session, bytes.len() as u32, 239, &[]);
            ground.send(world, &packet);
            loop {
                let piece = ground.wait_for(world, PATIENCE_US, reply).expect("a piece");
                assert_eq!(piece.opcode, ACK);
                assert_eq!(piece.offset as usize, bytes.len());
                self.seq = piece.seq;
                bytes.extend(piece.data);
                if piece.complete {
                    break;
                }
            }
        }
        self.ask(world, ground, 1, open.session, 0, &[]);
        bytes
    }
}

#[test]
fn prop_metadata_is_where_the_message_says_and_fits_its_checksum() {
    let folder = tempfile::tempdir().unwrap();
    let mut world = world_on(folder.path(), 1);
    let mut ground = Ground::new();
    let params = [397.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_REQUEST_MESSAGE, params);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    let (uri, crc) = ground
        .take(|m| match m {
            MavMessage::COMPONENT_METADATA(m) => Some((*m.uri, m.file_crc)),
            _ => None,
        })
        .unwrap();
    let uri = String::from_utf8_lossy(&uri).trim_end_matches('\0').to_owned();
    let path = uri.strip_prefix("mftp://").unwrap();
    let mut client = Client { seq: 0 };
    let general = client.burst(&mut world, &mut ground, path);
    assert_eq!(crc32(&general, 0), crc);
    let general: serde_json::Value = serde_json::from_slice(&general).unwrap();
    let entry = &general["metadataTypes"][0];
    let path = entry["uri"].as_str().unwrap().strip_prefix("mftp://").unwrap().to_owned();
    let parameters = client.burst(&mut world, &mut ground, &path);
    assert_eq!(parameters, client.read(&mut world, &mut ground, &path));
    assert_eq!(entry["fileCrc"], crc32(&parameters, 0));
    let found = client.ask(&mut world, &mut ground, 14, 0, 0, path.as_bytes());
    assert_eq!(found.data, crc32(&parameters, 0).to_le_bytes());
}

#[test]
fn prop_files_go_up_and_down_and_a_repeated_request_is_answered_again() {
    let folder = tempfile::tempdir().unwrap();
    let mut world = world_on(folder.path(), 1);
    let mut ground = Ground::new();
    let mut client = Client { seq: 7 };
    let (w, g) = (&mut world, &mut ground);
    let bytes: Vec<u8> = (0..5000_u32).flat_map(|n| n.to_le_bytes()).collect();
    let open = client.ask(w, g, 6, 0, 0, b"/missions/a.toml");
    assert_eq!(open.opcode, ACK);
    for (n, piece) in bytes.chunks(200).enumerate() {
        let written = client.ask(w, g, 7, open.session, n as u32 * 200, piece);
        assert_eq!(written.opcode, ACK);
    }
    // Not there before the session ends.
    assert!(!folder.path().join("state/missions/a.toml").exists());
    assert_eq!(client.ask(w, g, 1, open.session, 0, &[]).opcode, ACK);
    assert_eq!(std::fs::read(folder.path().join("state/missions/a.toml")).unwrap(), bytes);
    assert_eq!(client.read(w, g, "/missions/a.toml"), bytes);
    assert_eq!(client.burst(w, g, "/missions/a.toml"), bytes);
    let crc = client.ask(w, g, 14, 0, 0, b"/missions/a.toml");
    assert_eq!(crc.data, crc32(&bytes, 0).to_le_bytes());
    let list = client.ask(w, g, 3, 0, 0, b"/missions");
    assert_eq!(list.data, b"Fa.toml\t20000\0");
    assert_eq!(client.ask(w, g, 3, 0, 1, b"/missions").data, [6]);
    let root = client.ask(w, g, 3, 0, 0, b"/");
    assert!(root.data.starts_with(b"Dlogs\0Dmissions\0Fgeneral.json\t"));
    // The same request twice: the same answer, and the file is removed once.
    let packet = client.packet(8, 0, 0, 0, b"/missions/a.toml");
    for _ in 0..2 {
        g.send(w, &packet);
        let answer = g.wait_for(w, PATIENCE_US, reply).expect("an answer");
        assert_eq!(answer.opcode, ACK);
    }
    assert_eq!(client.ask(w, g, 4, 0, 0, b"/missions/a.toml").data, [10]);
}

#[test]
fn prop_what_is_not_allowed_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut world = world_on(folder.path(), 1);
    let mut ground = Ground::new();
    let mut client = Client { seq: 0 };
    let (w, g) = (&mut world, &mut ground);
    for (opcode, path, code) in [
        (4, "@PARAM/other.pck", 10),
        (4, "/../etc/passwd", 10),
        (4, "/logs/../state/mission.plan", 10),
        (4, "/missions/none", 10),
        (3, "/etc", 10),
        (6, "/logs/new.mcap", 9),
        (6, "/general.json", 9),
        (8, "/logs/own.mcap", 9),
        (9, "/missions/folder", 9),
        (10, "/missions", 9),
        (12, "/missions/a", 9),
        (13, "/missions/a", 9),
        (16, "/", 7),
        (99, "/", 7),
    ] {
        let answer = client.ask(w, g, opcode, 0, 0, path.as_bytes());
        assert_eq!((answer.opcode, answer.data.as_slice()), (NAK, &[code][..]), "{opcode} {path}");
    }
    assert_eq!(client.ask(w, g, 5, 0, 0, &[]).data, [4], "no session");
    assert_eq!(client.ask(w, g, 1, 200, 0, &[]).data, [4]);
    // Sessions are bounded, and a reset frees them.
    for _ in 0..6 {
        assert_eq!(client.ask(w, g, 4, 0, 0, b"/general.json").opcode, ACK);
    }
    assert_eq!(client.ask(w, g, 4, 0, 0, b"/general.json").data, [5]);
    assert_eq!(client.ask(w, g, 2, 0, 0, &[]).opcode, ACK);
    let open = client.ask(w, g, 4, 0, 0, b"/general.json");
    assert_eq!(open.opcode, ACK);
    // One that nobody uses ends by itself.
    fly_for(w, 61.0);
    assert_eq!(client.ask(w, g, 5, open.session, 0, &[]).data, [4]);
    // Files are bounded.
    let open = client.ask(w, g, 6, 0, 0, b"/missions/big");
    assert_eq!(client.ask(w, g, 7, open.session, 200_000, b"x").data, [1]);
}

#[test]
fn prop_a_client_may_choose_the_id_of_its_session() {
    let folder = tempfile::tempdir().unwrap();
    let mut world = world_on(folder.path(), 1);
    let mut ground = Ground::new();
    let mut client = Client { seq: 0 };
    let (w, g) = (&mut world, &mut ground);
    let first = client.ask(w, g, 4, 31, 0, b"/general.json");
    assert_eq!((first.opcode, first.session), (ACK, 31));
    // Taken: another one is given.
    let second = client.ask(w, g, 4, 31, 0, b"@PARAM/param.pck?withdefaults=1");
    assert!(second.opcode == ACK && second.session != 31);
    assert_eq!(client.ask(w, g, 5, second.session, 0, &[]).data[..2], [0x1C, 0x67]);
    assert_eq!(client.ask(w, g, 5, 31, 0, &[]).data[..1], *b"{");
    assert_eq!(client.ask(w, g, 1, 31, 0, &[]).opcode, ACK);
    assert_eq!(client.ask(w, g, 5, 31, 0, &[]).data, [4]);
    // Of another client's it knows nothing.
    let mut other = Ground::at_endpoint(0, 77);
    let same = Client { seq: 100 }.ask(w, &mut other, 4, second.session, 0, b"/general.json");
    assert_eq!((same.opcode, same.session), (ACK, second.session));
}

#[test]
fn prop_logs_are_listed_downloaded_and_erased() {
    let folder = tempfile::tempdir().unwrap();
    let logs = folder.path().join("logs");
    let mut world = world_on(folder.path(), 1);
    let mut ground = Ground::new();
    let (w, g) = (&mut world, &mut ground);
    let list = MavMessage::LOG_REQUEST_LIST(LOG_REQUEST_LIST_DATA {
        start: 0,
        end: 0xFFFF,
        target_system: 1,
        target_component: 1,
    });
    let entry = |m: &MavMessage| match m {
        MavMessage::LOG_ENTRY(e) => Some(e.clone()),
        _ => None,
    };
    g.send(w, &list);
    let none = g.wait_for(w, PATIENCE_US, entry).unwrap();
    assert_eq!((none.id, none.num_logs), (0, 0));
    std::fs::create_dir_all(&logs).unwrap();
    let bytes: Vec<u8> = (0..40_000_u32).map(|n| (n / 7) as u8).collect();
    std::fs::write(logs.join("a.mcap"), &bytes).unwrap();
    std::fs::write(logs.join("own.mcap"), b"now").unwrap();
    g.send(w, &list);
    let first = g.wait_for(w, PATIENCE_US, entry).unwrap();
    let second = g.wait_for(w, PATIENCE_US, entry).unwrap();
    assert_eq!((first.id, first.num_logs, first.size), (1, 2, 40_000));
    assert_eq!((second.id, second.last_log_num, second.size), (2, 2, 3));
    let ask = |id, ofs, count| {
        MavMessage::LOG_REQUEST_DATA(LOG_REQUEST_DATA_DATA {
            ofs,
            count,
            id,
            target_system: 1,
            target_component: 1,
        })
    };
    let data = |m: &MavMessage| match m {
        MavMessage::LOG_DATA(d) => Some((d.ofs, d.data[..usize::from(d.count)].to_vec())),
        _ => None,
    };
    g.send(w, &ask(1, 0, u32::MAX));
    let mut got = Vec::new();
    let start_us = w.t_us();
    while got.len() < bytes.len() {
        let (ofs, piece) = g.wait_for(w, PATIENCE_US, data).expect("data");
        assert_eq!(ofs as usize, got.len());
        // A shorter piece is the end, for clients.
        assert!(piece.len() == 90 || got.len() + piece.len() == bytes.len(), "{ofs}");
        got.extend(piece);
    }
    assert!(got == bytes);
    assert!(w.t_us() - start_us < 1_000_000, "{} us", w.t_us() - start_us);
    // A piece that was lost, beyond the end, a log that is not.
    g.send(w, &ask(1, 90, 90));
    assert_eq!(g.wait_for(w, PATIENCE_US, data), Some((90, bytes[90..180].to_vec())));
    g.send(w, &ask(1, 40_000, 90));
    assert_eq!(g.wait_for(w, PATIENCE_US, data), Some((40_000, vec![])));
    g.send(w, &ask(9, 0, 90));
    assert_eq!(g.wait_for(w, PATIENCE_US, data), Some((0, vec![])));
    let erase = LOG_ERASE_DATA { target_system: 1, target_component: 1 };
    g.send(w, &MavMessage::LOG_ERASE(erase));
    fly_for(w, 0.1);
    assert!(!logs.join("a.mcap").exists() && logs.join("own.mcap").exists());
}

/// What a station sets is there after a restart.
#[test]
fn prop_plans_and_parameters_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let mut world = world_on(folder.path(), 1);
    let mut ground = Ground::new();
    let accepted = Some(MavMissionResult::MAV_MISSION_ACCEPTED);
    assert_eq!(ground.upload(&mut world, &plan()), accepted);
    let id = world.pilot().mission().id;
    let mut name = [0; 16];
    name[..11].copy_from_slice(b"FLT_TKO_HGT");
    let set = PARAM_SET_DATA {
        param_value: 1.7,
        target_system: 1,
        target_component: 1,
        param_id: name.into(),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32 as u8,
    };
    ground.send(&mut world, &MavMessage::PARAM_SET(set));
    fly_for(&mut world, 0.1);
    let mut again = world_on(folder.path(), 1);
    fly_for(&mut again, 0.1);
    assert_eq!(again.pilot().mission().id, id);
    assert_eq!(again.pilot().mission().items.len(), 3);
    let path = stored::path(&folder.path().join("state"));
    let values = stored::from_text(&std::fs::read_to_string(path).unwrap());
    assert_eq!(values.unwrap()["FLT_TKO_HGT"], 1.7);
    // A damaged file is not used, and people are told.
    let plan = folder.path().join("state/mission.plan");
    let mut bytes = std::fs::read(&plan).unwrap();
    bytes[40] ^= 1;
    std::fs::write(&plan, bytes).unwrap();
    let mut third = world_on(folder.path(), 1);
    let mut ground = Ground::new();
    fly_for(&mut third, 0.1);
    ground.listen(&mut third);
    assert!(third.pilot().mission().items.is_empty());
    assert!(ground.texts.iter().any(|t| t.contains("mission not restored")), "{:?}", ground.texts);
}
