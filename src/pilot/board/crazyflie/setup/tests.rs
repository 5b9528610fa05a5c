//! Setting a Crazyflie up, question by question.

use haltere_dialect::crtp::memory::MemoryInfo;
use haltere_dialect::crtp::toc::TocItem;

use super::*;

const LOG: [(&str, &str, Kind); 12] = [
    ("acc", "x", Kind::F32),
    ("other", "x", Kind::U8),
    ("stateEstimateZ", "quat", Kind::U32),
    ("supervisor", "info", Kind::U16),
    ("tdoa2", "d7-0", Kind::F32),
    ("tdoa2", "d0-1", Kind::F32),
    ("tdoa2", "d1-2", Kind::F32),
    ("tdoa2", "d2-3", Kind::F32),
    ("tdoa2", "d3-4", Kind::F32),
    ("tdoa2", "d4-5", Kind::F32),
    ("tdoa2", "d5-6", Kind::F32),
    ("tdoa2", "d6-7", Kind::F32),
];

/// A board that keeps `yawMode` as it was, and whose `posSet` has 32 bits.
#[derive(Default)]
struct Board {
    values: [i64; SETTINGS.len()],
    /// Variables of each log block.
    blocks: [Option<usize>; 3],
    checksum: u32,
    /// It says that its tables are longer by so much, and has no name of this setting.
    longer: u16,
    lacks: &'static str,
    no_deck: bool,
    writes: usize,
}

fn kind_of(name: &str) -> Kind {
    if name == "posSet" { Kind::U32 } else { Kind::U8 }
}

impl Board {
    fn log(&mut self, control: LogControl) -> LogOutcome {
        let (block, done) = match control {
            LogControl::Create(block, variables) => {
                let of = &mut self.blocks[usize::from(block)];
                let had = of.replace(variables.as_slice().len());
                (block, if had.is_some() { Err(17) } else { Ok(()) })
            }
            LogControl::Append(block, variables) => {
                *self.blocks[usize::from(block)].as_mut().unwrap() += variables.as_slice().len();
                (block, Ok(()))
            }
            LogControl::Start(block, _) => (block, Ok(())),
            _ => {
                self.blocks = [None; 3];
                (0, Ok(()))
            }
        };
        let refusal = |number| haltere_dialect::crtp::refusal::Refusal::outcome(number);
        LogOutcome { command: control.command(), block, outcome: done.or_else(refusal) }
    }

    fn answer(&mut self, request: &ToBoard<'_>) -> Packet {
        let position = AnchorPosition { position_m: [1.0, 2.0, 3.0], valid: true }.bytes();
        let message = match *request {
            ToBoard::Platform(PlatformRequest::Protocol) => {
                FromBoard::Platform(PlatformAnswer::Protocol(12))
            }
            ToBoard::Platform(_) => FromBoard::Platform(PlatformAnswer::Firmware("2026.08")),
            ToBoard::Toc(table, TocRequest::Info) => {
                let count = if table == Table::Log { LOG.len() } else { SETTINGS.len() } as u16;
                let (count, crc) = (count + self.longer, self.checksum);
                FromBoard::Toc(table, TocAnswer::Info { count, crc, limits: None })
            }
            ToBoard::Toc(table, TocRequest::Item(id)) => {
                let n = usize::from(id);
                let item = match table {
                    Table::Log => LOG.get(n).map(|(group, name, kind)| (kind.log(), *group, *name)),
                    Table::Parameters => SETTINGS.get(n).map(|(name, _)| {
                        let name = if *name == self.lacks { "another" } else { *name };
                        (kind_of(name).parameter() | 0x20, GROUP, name)
                    }),
                };
                let item = item.map(|(code, group, name)| TocItem { id, code, group, name });
                FromBoard::Toc(table, item.map_or(TocAnswer::NoItem, TocAnswer::Item))
            }
            ToBoard::Parameter(ParameterRequest::SetByName { group, name, kind, value }) => {
                assert_eq!(kind, kind_of(name));
                self.writes += 1;
                let n = SETTINGS.iter().position(|(of, _)| *of == name).unwrap();
                if name != "yawMode" {
                    self.values[n] = value.f64() as i64;
                }
                FromBoard::Parameter(ParameterAnswer::SetByName { group, name, outcome: Ok(()) })
            }
            ToBoard::Parameter(ParameterRequest::Read(id)) => {
                let n = usize::from(id);
                let kind = kind_of(SETTINGS[n].0);
                let raw = kind.write(Value::Int(self.values[n])).unwrap();
                let value = Ok(&raw[..kind.width()]);
                return FromBoard::Parameter(ParameterAnswer::Read(id, value)).encode().unwrap();
            }
            ToBoard::Memory(MemoryRequest::Count) => {
                FromBoard::Memory(MemoryAnswer::Count(if self.no_deck { 1 } else { 2 }))
            }
            ToBoard::Memory(MemoryRequest::Info(n)) => {
                let kind = if n == 1 { loco::TYPE } else { 0 };
                let info = MemoryInfo { kind, size: 0, serial: &[0; 8] };
                FromBoard::Memory(MemoryAnswer::Info(n, Some(info)))
            }
            ToBoard::Memory(MemoryRequest::Read { memory, address, .. }) => {
                FromBoard::Memory(MemoryAnswer::Read { memory, address, outcome: Ok(&position) })
            }
            ToBoard::Log(control) => FromBoard::Log(self.log(control)),
            _ => panic!("{request:?}"),
        };
        message.encode().unwrap()
    }
}

/// What becomes of the first answer to each question.
#[derive(Clone, Copy, PartialEq)]
enum First {
    Heard,
    /// The question is lost.
    Lost,
    /// The answer is.
    Unheard,
}

/// Runs to the end; the requests that were sent. Each answer comes twice.
fn run(setup: &mut Setup, board: &mut Board, first: First) -> usize {
    let mut sent = 0;
    for step in 0..4000_u64 {
        let Some(packet) = setup.due(HostTime::from_us(1_000_000 + step * 10_000)) else {
            assert!(first != First::Heard || setup.is_done(), "no answer was lost");
            continue;
        };
        sent += 1;
        let is_first = setup.asked.times() == 1;
        if is_first && first == First::Lost && !matches!(setup.next, Some(Question::Fill(_, 1..))) {
            continue;
        }
        let back = board.answer(&ToBoard::decode(&packet).unwrap());
        if is_first && first == First::Unheard && sent < 400 {
            continue;
        }
        for _ in 0..2 {
            setup.hear(&FromBoard::decode(&back).unwrap());
        }
    }
    sent
}

const STAYS: &str = "flightmode.yawMode of the board did not become 2";

#[test]
fn prop_a_board_is_set_up_with_each_request_or_its_answer_lost_once() {
    for first in [First::Heard, First::Lost, First::Unheard] {
        let (mut setup, mut board) = (Setup::default(), Board::default());
        run(&mut setup, &mut board, first);
        assert!(setup.is_done());
        assert_eq!((setup.protocol, setup.firmware.as_str()), (Some(12), "2026.08"));
        assert!(
            setup.refused.len() == 1 && setup.refused[0].starts_with(STAYS),
            "{:?}",
            setup.refused
        );
        assert_eq!(setup.told, [""; 0]);
        assert!(setup.anchors.iter().all(Option::is_some));
        assert_eq!(setup.ids.missing().count(), 16);
        // Not a name twice, whatever was lost: the block would be of another length.
        assert_eq!(board.blocks, [Some(1), Some(10), None]);
        // Anew, in the air: both tables are known, and nothing is written.
        let writes = board.writes;
        setup.again(true);
        // Version, tag, two checksums, seven values, a reset, two blocks made, one of them in two parts, and started.
        assert_eq!(run(&mut setup, &mut board, First::Heard), 17);
        assert_eq!((board.writes, setup.refused.len()), (writes, 1));
        // Another build: all of it.
        board.checksum = 5;
        setup.again(true);
        assert_eq!(run(&mut setup, &mut board, First::Heard), 17 + 19);
    }
}

#[test]
fn prop_what_is_missing_is_told_once_and_nothing_repeats_for_ever() {
    let (mut setup, mut board) = (Setup::default(), Board { longer: 9, ..Board::default() });
    run(&mut setup, &mut board, First::Heard);
    assert!(setup.is_done());
    assert_eq!(setup.told.len(), 2, "{:?}", setup.told);
    assert!(setup.told[0].contains("no item 12 in its table of log variables"), "{:?}", setup.told);
    let (mut setup, mut board) =
        (Setup::default(), Board { lacks: "stabModeYaw", no_deck: true, ..Board::default() });
    run(&mut setup, &mut board, First::Heard);
    let refused = setup.refused.join("; ");
    for words in ["no parameter flightmode.stabModeYaw: flash the vehicle", "memory of a Loco deck"]
    {
        assert!(refused.contains(words), "{refused}");
    }
    // A board that answers nothing but its protocol.
    let (mut setup, mut board) = (Setup::default(), Board::default());
    for step in 0..60_000_u64 {
        let Some(packet) = setup.due(HostTime::from_us(1_000_000 + step * 10_000)) else {
            continue;
        };
        let request = ToBoard::decode(&packet).unwrap();
        if request == ToBoard::Platform(PlatformRequest::Protocol) {
            setup.hear(&FromBoard::decode(&board.answer(&request)).unwrap());
        }
    }
    let told = setup.told.join("; ");
    assert!(told.contains("board does not answer about log variables: restart it"), "{told}");
    assert!(setup.told.len() <= 3, "{told}");
}

#[test]
fn prop_an_old_release_is_known_by_its_tag() {
    for (tag, is_old) in [
        ("2023.11", true),
        ("2024.09.1", true),
        ("2024.10", false),
        ("2026.08", false),
        ("2024.2 +17", true),
        ("main-1a2b3c", false),
        ("", false),
    ] {
        let setup = Setup { firmware: tag.to_owned(), ..Setup::default() };
        assert_eq!(setup.is_old(), is_old, "{tag}");
    }
}
