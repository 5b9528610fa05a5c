//! Bitcraze's client and firmware, every packet that passed between them, when the recordings lie beside the
//! checkout.
//!
//! A recording holds records of a time, f64 s; `<` from the board or `>` to it; a length, u8; a packet.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::loco::AnchorPosition;
use super::supervisor::SupervisorBits;
use super::value::{Kind, Value};
use super::*;

/// The recorded runs with the number of their packets.
const RECORDINGS: [(&str, usize); 2] = [("cf2", 9784), ("flapper", 9997)];

fn folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/crazyflie/recordings");
    let found = folder.is_dir();
    if !found {
        // Past what the test runner holds back of tests that pass.
        let _ = writeln!(std::io::stderr(), "not checked: no recordings in {}", folder.display());
    }
    found.then_some(folder)
}

struct Record {
    to_board: bool,
    bytes: Vec<u8>,
    packet: Packet,
}

/// All packets of a run, to the last byte of its file.
fn records(folder: &Path, name: &str) -> Vec<Record> {
    let file = std::fs::read(folder.join(format!("{name}_2026.08_protocol12.crtp"))).unwrap();
    let mut rest = file.as_slice();
    let (mut records, mut last_s) = (Vec::new(), 0.0);
    while let Some((head, later)) = rest.split_first_chunk::<10>() {
        let [s0, s1, s2, s3, s4, s5, s6, s7, way, len] = *head;
        let at_s = f64::from_le_bytes([s0, s1, s2, s3, s4, s5, s6, s7]);
        assert!(at_s >= last_s && (way == b'<' || way == b'>'), "{name} at {at_s} s");
        let (bytes, later) = later.split_at(len.into());
        let packet = Packet::read(bytes).unwrap();
        records.push(Record { to_board: way == b'>', bytes: bytes.to_vec(), packet });
        (rest, last_s) = (later, at_s);
    }
    assert_eq!(rest, [], "{name} ends in a record");
    records
}

#[test]
fn val_every_recorded_packet_is_read_and_made_again() {
    let Some(folder) = folder() else { return };
    for (name, count) in RECORDINGS {
        let records = records(&folder, name);
        assert_eq!(records.len(), count, "{name}");
        let mut torn = Vec::new();
        for Record { to_board, bytes, packet } in &records {
            let told = format!("{packet:?}");
            if *to_board {
                let message = ToBoard::decode(packet).expect(&told);
                let again = message.encode().unwrap();
                // Byte for byte, with the link's bits.
                if again.bytes() != bytes {
                    torn.push((message, bytes.strip_prefix(again.bytes())));
                }
            } else {
                // The board leaves the link's two bits as they came, or empty.
                let message = FromBoard::decode(packet).expect(&told);
                assert_eq!(message.encode(), Some(*packet), "{message:?}");
            }
        }
        // Where the client's list is longer than a packet, it begins the tenth variable before it sees that.
        let [(ToBoard::Log(LogControl::Create(1, of)), rest)] = torn.as_slice() else {
            panic!("{name}: {torn:?}")
        };
        assert_eq!((of.as_slice().len(), *rest), (log::MAX_VARIABLES, Some(&[0x22][..])));
    }
}

/// Names by table and id, as `group.name` with the type's code.
fn tables(records: &[Record]) -> BTreeMap<(&'static str, u16), (u8, String)> {
    let (mut found, mut counts) = (BTreeMap::new(), Vec::new());
    for record in records.iter().filter(|record| !record.to_board) {
        let Ok(FromBoard::Toc(table, answer)) = FromBoard::decode(&record.packet) else { continue };
        let of = if table == Table::Log { "log" } else { "param" };
        match answer {
            TocAnswer::Info { count, limits, .. } => {
                assert_eq!(limits, (table == Table::Log).then_some([16, 128]));
                counts.push((of, count));
            }
            TocAnswer::Item(item) => {
                assert!(item.kind(table).is_some(), "{item:?}");
                let name = format!("{}.{}", item.group, item.name);
                found.insert((of, item.id), (item.code, name));
            }
            TocAnswer::NoItem => panic!("none was asked for that is not there"),
        }
    }
    assert_eq!(counts.len(), 2);
    for (of, count) in counts {
        let ids: Vec<u16> = found.keys().filter(|key| key.0 == of).map(|key| key.1).collect();
        assert_eq!(ids, (0..count).collect::<Vec<_>>(), "{of}");
    }
    found
}

#[test]
fn val_the_tables_are_those_that_were_written_down() {
    let Some(folder) = folder() else { return };
    for (name, _) in RECORDINGS {
        let found = tables(&records(&folder, name));
        assert_eq!(found.keys().filter(|key| key.0 == "log").count(), 441, "{name}");
        let listed =
            std::fs::read_to_string(folder.join(format!("{name}_2026.08_toc.tsv"))).unwrap();
        let rows = found
            .iter()
            .map(|((of, id), (code, name))| format!("{of}\t{id}\t0x{code:02X}\t{name}"));
        let mut rows: Vec<String> = rows.collect();
        let mut expected: Vec<String> = listed.lines().skip(1).map(str::to_owned).collect();
        rows.sort();
        expected.sort();
        let other = rows.iter().zip(&expected).find(|(row, expected)| row != expected);
        assert_eq!((other, rows.len()), (None, expected.len()), "{name}");
    }
}

/// All rows of all blocks: for each variable its values, and for each row its time and block.
#[derive(Default)]
struct Logged {
    values: BTreeMap<String, Vec<f64>>,
    rows: Vec<(u8, u32)>,
}

fn logged(records: &[Record]) -> Logged {
    let names = tables(records);
    let mut blocks: BTreeMap<u8, Vec<(String, Kind)>> = BTreeMap::new();
    let mut logged = Logged::default();
    for record in records {
        if record.to_board {
            if let Ok(ToBoard::Log(LogControl::Create(block, of) | LogControl::Append(block, of))) =
                ToBoard::decode(&record.packet)
            {
                let named = of.as_slice().iter().map(|v| (names[&("log", v.id)].1.clone(), v.kind));
                blocks.entry(block).or_default().extend(named);
            }
        } else if let Ok(FromBoard::Row(row)) = FromBoard::decode(&record.packet) {
            let kinds: Vec<Kind> = blocks[&row.block].iter().map(|(_, kind)| *kind).collect();
            let values = row.values(&kinds).expect("a row of its block");
            for ((name, _), value) in blocks[&row.block].iter().zip(values) {
                logged.values.entry(name.clone()).or_default().push(value.f64());
            }
            logged.rows.push((row.block, row.time_ms));
        }
    }
    logged
}

#[test]
fn val_rows_say_what_the_run_went_through() {
    let Some(folder) = folder() else { return };
    for (name, _) in RECORDINGS {
        let logged = logged(&records(&folder, name));
        let value = |name: &str| logged.values[name].as_slice();
        // Held at rest, for as long as the accelerometer was logged.
        assert!(value("acc.z").iter().all(|z| (z - 1.0).abs() < 0.01), "{name}");
        assert!(value("gyro.x").iter().all(|x| x.abs() < 0.1), "{name}");
        assert!(value("loco.mode").ends_with(&[2.0]), "{name}");
        assert!(value("pm.vbatMV").iter().any(|mv| (mv - 3900.0).abs() < 2.0), "{name}");
        // The same attitude in four numbers and packed into one.
        let parts = ["x", "y", "z", "w"].map(|c| value(&format!("stateEstimate.q{c}")));
        let packed = value("stateEstimateZ.quat");
        assert!(packed.len() > 280, "{name}");
        for (n, bits) in packed.iter().enumerate() {
            let unpacked = quaternion::unpack(*bits as u32);
            let off = parts.iter().zip(unpacked).map(|(part, q)| (part[n] - q).abs());
            assert!(off.fold(0.0, f64::max) < 0.002, "{name}: {unpacked:?}");
        }
        // Time goes on by the 10 ms that were asked for.
        for (at, later) in logged.rows.iter().zip(logged.rows.iter().skip(1)) {
            assert!(later.1 >= at.1, "{name}: {at:?} {later:?}");
        }
        let imu: Vec<u32> = logged.rows.iter().filter(|row| row.0 == 2).map(|row| row.1).collect();
        assert!(imu.windows(2).all(|pair| pair[1] - pair[0] == 10), "{name}");
        // Ready, deck dead, flying, and locked by the silence at the end.
        let seen: Vec<SupervisorBits> = value("supervisor.info")
            .iter()
            .map(|bits| SupervisorBits::from_bits_retain(*bits as u16))
            .collect();
        let mut expected = [0x20E, 0xA04, 0x20E, 0x21E].to_vec();
        expected.extend((name == "cf2").then_some(0x244));
        let mut rest = seen.iter();
        for bits in expected {
            assert!(rest.any(|seen| seen.bits() == bits), "{name}: {bits:#x} comes in its turn");
        }
        assert!(seen.iter().all(|bits| SupervisorBits::from_bits(bits.bits()).is_some()));
    }
}

#[test]
fn val_the_deck_knows_its_anchors() {
    let Some(folder) = folder() else { return };
    for (name, _) in RECORDINGS {
        let (mut ids, mut positions) = (Vec::new(), BTreeMap::new());
        for record in records(&folder, name).iter().filter(|record| !record.to_board) {
            match FromBoard::decode(&record.packet) {
                Ok(FromBoard::Memory(MemoryAnswer::Read { memory: 2, address, outcome })) => {
                    let bytes = outcome.unwrap();
                    if address == loco::HEARD {
                        ids = loco::anchors(bytes).to_vec();
                    } else {
                        positions.insert(address, AnchorPosition::read(bytes).unwrap());
                    }
                }
                Ok(FromBoard::Memory(MemoryAnswer::Info(2, info))) => {
                    assert_eq!(info.unwrap().kind, loco::TYPE);
                }
                _ => {}
            }
        }
        ids.sort_unstable();
        assert_eq!(ids, (0..8).collect::<Vec<u8>>(), "{name}");
        let addresses: Vec<u32> = ids.iter().map(|id| loco::position(*id)).collect();
        assert_eq!(positions.keys().copied().collect::<Vec<_>>(), addresses, "{name}");
        // Corners of a box of 4 m by 4 m by 2 m.
        for AnchorPosition { position_m: [x, y, z], valid } in positions.into_values() {
            assert!(valid && x.abs() == 2.0 && y.abs() == 2.0 && (z == 0.2 || z == 2.2), "{name}");
        }
    }
}

#[test]
fn val_text_ends_with_the_lock() {
    let Some(folder) = folder() else { return };
    let mut text = Vec::new();
    for record in records(&folder, "cf2") {
        if let (false, Ok(FromBoard::Console(piece))) =
            (record.to_board, FromBoard::decode(&record.packet))
        {
            text.extend_from_slice(piece);
        }
    }
    let text = String::from_utf8(text).unwrap();
    assert!(text.starts_with("---") && text.ends_with("SUP: Locked, reboot required\n"), "{text}");
    assert_eq!(text.matches("Self test passed!").count(), 1);
}

#[test]
fn val_a_parameter_by_name_and_by_id() {
    let Some(folder) = folder() else { return };
    for (name, _) in RECORDINGS {
        let records = records(&folder, name);
        let tables = tables(&records);
        let mut values = 0;
        for record in records.iter().filter(|record| !record.to_board) {
            match FromBoard::decode(&record.packet) {
                Ok(FromBoard::Parameter(ParameterAnswer::Read(id, Ok(bytes)))) => {
                    let (code, parameter) = &tables[&("param", id)];
                    let item = toc::TocItem { id, code: *code, group: "", name: parameter };
                    let kind = item.kind(Table::Parameters).unwrap();
                    let value =
                        kind.read(bytes).unwrap_or_else(|| panic!("{parameter}: {bytes:?}"));
                    if parameter == "flightmode.stabModeRoll" {
                        assert_eq!(value, Value::Int(1));
                    }
                    values += 1;
                }
                Ok(FromBoard::Parameter(ParameterAnswer::ExtendedType(id, answer))) => {
                    let (code, parameter) = &tables[&("param", id)];
                    let item = toc::TocItem { id, code: *code, group: "", name: parameter };
                    assert!(item.is_extended() && answer == Ok(parameter::PERSISTENT));
                }
                Ok(FromBoard::Parameter(answer)) => {
                    let (group, name) = ("flightmode", "stabModeYaw");
                    assert_eq!(answer, ParameterAnswer::SetByName { group, name, outcome: Ok(()) });
                }
                _ => {}
            }
        }
        assert_eq!(values, tables.keys().filter(|key| key.0 == "param").count(), "{name}");
    }
}
