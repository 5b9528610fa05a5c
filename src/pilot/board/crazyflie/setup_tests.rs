use haltere_dialect::crtp::memory::MemoryInfo;
use haltere_dialect::crtp::toc::TocItem;

use super::*;

const LOG: [(&str, &str, Kind); 4] = [
    ("acc", "x", Kind::F32),
    ("other", "x", Kind::U8),
    ("stateEstimateZ", "quat", Kind::U32),
    ("supervisor", "info", Kind::U16),
];

/// A board that keeps `yawMode` as it was.
fn answer(request: &ToBoard<'_>) -> Packet {
    let position = AnchorPosition { position_m: [1.0, 2.0, 3.0], valid: true }.bytes();
    let message = match *request {
        ToBoard::Platform(PlatformRequest::Protocol) => {
            FromBoard::Platform(PlatformAnswer::Protocol(12))
        }
        ToBoard::Platform(_) => FromBoard::Platform(PlatformAnswer::Firmware("2026.08")),
        ToBoard::Toc(table, TocRequest::Info) => {
            let count = if table == Table::Log { LOG.len() } else { SETTINGS.len() } as u16;
            FromBoard::Toc(table, TocAnswer::Info { count, crc: 1, limits: None })
        }
        ToBoard::Toc(table, TocRequest::Item(id)) => {
            let n = usize::from(id);
            let (group, name, code) = match table {
                Table::Log => (LOG[n].0, LOG[n].1, LOG[n].2.log()),
                Table::Parameters => (GROUP, SETTINGS[n].0, Kind::U8.parameter()),
            };
            FromBoard::Toc(table, TocAnswer::Item(TocItem { id, code, group, name }))
        }
        ToBoard::Parameter(ParameterRequest::SetByName { group, name, .. }) => {
            FromBoard::Parameter(ParameterAnswer::SetByName { group, name, outcome: Ok(()) })
        }
        ToBoard::Parameter(ParameterRequest::Read(id)) => {
            let (name, value) = &SETTINGS[usize::from(id)];
            let value = if *name == "yawMode" { &0 } else { value };
            let value = Ok(std::slice::from_ref(value));
            return FromBoard::Parameter(ParameterAnswer::Read(id, value)).encode().unwrap();
        }
        ToBoard::Memory(MemoryRequest::Count) => FromBoard::Memory(MemoryAnswer::Count(2)),
        ToBoard::Memory(MemoryRequest::Info(n)) => {
            let kind = if n == 1 { loco::TYPE } else { 0 };
            let info = MemoryInfo { kind, size: 0, serial: &[0; 8] };
            FromBoard::Memory(MemoryAnswer::Info(n, Some(info)))
        }
        ToBoard::Memory(MemoryRequest::Read { memory, address, .. }) => {
            FromBoard::Memory(MemoryAnswer::Read { memory, address, outcome: Ok(&position) })
        }
        ToBoard::Log(control) => {
            let block = match control {
                LogControl::Create(block, _)
                | LogControl::Append(block, _)
                | LogControl::Start(block, _) => block,
                _ => 0,
            };
            let command = control.command();
            FromBoard::Log(LogOutcome { command, block, outcome: Ok(()) })
        }
        _ => panic!("{request:?}"),
    };
    message.encode().unwrap()
}

/// Runs to the end; the requests that were sent. With `losing` the first of each is lost, and each answer comes twice.
fn run(setup: &mut Setup, losing: bool) -> usize {
    let mut sent = 0;
    for step in 0..2000_u64 {
        let Some(packet) = setup.due(HostTime::from_us(1_000_000 + step * 10_000)) else {
            assert!(losing || setup.is_done(), "no answer was lost");
            continue;
        };
        sent += 1;
        if losing && setup.asked.times() == 1 {
            continue;
        }
        let back = answer(&ToBoard::decode(&packet).unwrap());
        for _ in 0..2 {
            setup.hear(&FromBoard::decode(&back).unwrap());
        }
    }
    sent
}

#[test]
fn prop_a_board_is_set_up_with_each_request_lost_once() {
    let [mut quiet, mut lossy] = [Setup::default(), Setup::default()];
    let sent = run(&mut quiet, false);
    assert_eq!(run(&mut lossy, true), 2 * sent);
    for setup in [&quiet, &lossy] {
        assert!(setup.is_done());
        assert_eq!((setup.protocol, setup.firmware.as_str()), (Some(12), "2026.08"));
        assert_eq!(setup.refused, ["flightmode.yawMode did not become 2"]);
        assert!(setup.anchors.iter().all(Option::is_some));
        assert_eq!(setup.ids.missing().count(), 24);
    }
    quiet.log_again();
    // A reset, and two blocks made and started.
    assert_eq!(run(&mut quiet, false), 5);
}
