//! Who may look and who may command, through the whole core.

use haltere_dialect::mav::haltere::{
    COMMAND_LONG_DATA, FILE_TRANSFER_PROTOCOL_DATA, LOG_ERASE_DATA, MISSION_CLEAR_ALL_DATA,
    MISSION_COUNT_DATA, MISSION_REQUEST_LIST_DATA, MavCmd, MavFtpErr, MavFtpOpcode, MavMessage,
    MavMissionResult, MavParamError, MavResult, PARAM_REQUEST_LIST_DATA, PARAM_SET_DATA,
    SET_MODE_DATA,
};
use haltere_dialect::mav_stream::{self, MavSplitter};

use haltere_core::drops::DropReason;

use super::*;
use crate::Pilot;
use crate::config::PilotConfig;
use crate::input::Input;
use crate::stations::endpoint::Endpoint;
use haltere_core::frames::Vec3;
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;

fn id(name: &str) -> [u8; 16] {
    std::array::from_fn(|i| name.as_bytes().get(i).copied().unwrap_or(0))
}

/// Two links: on the first only 255 may command, on the second everybody.
fn pilot() -> Pilot {
    let corner = |i: u8| {
        let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
        (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
    };
    let survey = Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
    let strict = Endpoint { commanders: [255].into_iter().collect(), ..Endpoint::default() };
    let config =
        PilotConfig { endpoints: vec![strict, Endpoint::default()], ..PilotConfig::default() };
    let mut pilot = Pilot::new(config, survey, HostTime::from_us(1_000_000));
    for n in 0..2 {
        pilot.handle(HostTime::from_us(1_000_000), Input::LinkUp { link: LinkId::Ground(n) });
    }
    pilot.drain_output(|_, _| {});
    pilot
}

/// What is answered on the same link.
fn answers(pilot: &mut Pilot, n: u8, system: u8, message: &MavMessage) -> Vec<MavMessage> {
    let mut bytes = Vec::new();
    mav_stream::encode(&mut bytes, system, 190, 0, message);
    let link = LinkId::Ground(n);
    pilot.handle(pilot.clock.now, Input::Bytes { link, bytes: &bytes });
    let mut splitter = MavSplitter::new();
    pilot.drain_output(|to, bytes| {
        if to == link {
            splitter.push(bytes);
        }
    });
    let mut found = Vec::new();
    while let Some(next) = splitter.next() {
        found.push(next.unwrap().decode().unwrap());
    }
    found
}

fn command(command: MavCmd, param1: f32) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: command as u16,
        param1,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    })
}

fn is_denied(answers: &[MavMessage]) -> bool {
    answers.iter().any(
        |m| matches!(m, MavMessage::COMMAND_ACK(ack) if ack.result == MavResult::MAV_RESULT_DENIED as u8),
    )
}

#[test]
fn prop_only_commanders_command_and_refusals_are_answered() {
    let mut pilot = pilot();
    let arm = command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0);
    // Without a board nobody arms; but some are refused for who they are.
    assert!(is_denied(&answers(&mut pilot, 0, 254, &arm)));
    assert_eq!(pilot.drops()[2].count(DropReason::NotPermitted), 1);
    assert!(!is_denied(&answers(&mut pilot, 0, 255, &arm)));
    assert!(!is_denied(&answers(&mut pilot, 1, 254, &arm)));
    assert_eq!(pilot.drops()[2].count(DropReason::NotPermitted), 1);

    let count = MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
        count: 3,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    });
    let clear = MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
        target_system: 1,
        target_component: 1,
        ..Default::default()
    });
    for message in [&count, &clear] {
        let got = answers(&mut pilot, 0, 254, message);
        let denied = |m: &MavMessage| matches!(m, MavMessage::MISSION_ACK(ack) if ack.mavtype == MavMissionResult::MAV_MISSION_DENIED as u8);
        assert!(got.iter().any(denied), "{got:?}");
    }
    let set = MavMessage::PARAM_SET(PARAM_SET_DATA {
        param_value: 2.0,
        target_system: 1,
        target_component: 1,
        param_id: id("FLT_TKO_HGT").into(),
        ..Default::default()
    });
    let got = answers(&mut pilot, 0, 254, &set);
    assert!(got.iter().any(|m| matches!(m, MavMessage::PARAM_ERROR(e)
        if e.error == MavParamError::MAV_PARAM_ERROR_PERMISSION_DENIED)));
    let old = PilotConfig::default().flight.takeoff_height_m as f32;
    assert!(got.iter().any(|m| matches!(m, MavMessage::PARAM_VALUE(v) if v.param_value == old)));
    // Silent, and without effect.
    for message in [
        MavMessage::SET_MODE(SET_MODE_DATA { target_system: 1, ..Default::default() }),
        MavMessage::LOG_ERASE(LOG_ERASE_DATA { target_system: 1, target_component: 1 }),
    ] {
        assert_eq!(answers(&mut pilot, 0, 254, &message), []);
    }
    let mut tasks = 0;
    pilot.drain_file_requests(|_| tasks += 1);
    assert_eq!(tasks, 0, "nothing was asked of the disk");
}

#[test]
fn prop_who_may_only_look_sees_everything() {
    let mut pilot = pilot();
    let looks = [
        command(MavCmd::MAV_CMD_REQUEST_MESSAGE, 148.0),
        command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, 30.0),
        MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
            target_system: 1,
            target_component: 1,
        }),
        MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
            target_system: 1,
            target_component: 1,
            ..Default::default()
        }),
    ];
    for message in &looks {
        answers(&mut pilot, 0, 254, message);
    }
    let ftp = |opcode: MavFtpOpcode| {
        let mut payload = [0; 251];
        payload[3] = opcode as u8;
        payload[4] = 1;
        payload[12] = b'/';
        MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
            target_network: 0,
            target_system: 1,
            target_component: 1,
            payload,
        })
    };
    let opcode = |answers: Vec<MavMessage>| {
        answers.into_iter().find_map(|m| match m {
            MavMessage::FILE_TRANSFER_PROTOCOL(m) => Some((m.payload[3], m.payload[12])),
            _ => None,
        })
    };
    let ack = MavFtpOpcode::MAV_FTP_OPCODE_ACK as u8;
    let listed = answers(&mut pilot, 0, 254, &ftp(MavFtpOpcode::MAV_FTP_OPCODE_LISTDIRECTORY));
    assert_eq!(opcode(listed).map(|(code, _)| code), Some(ack));
    assert_eq!(pilot.drops()[2].count(DropReason::NotPermitted), 0);
    for writes in [
        MavFtpOpcode::MAV_FTP_OPCODE_CREATEFILE,
        MavFtpOpcode::MAV_FTP_OPCODE_WRITEFILE,
        MavFtpOpcode::MAV_FTP_OPCODE_REMOVEFILE,
        MavFtpOpcode::MAV_FTP_OPCODE_OPENFILEWO,
        MavFtpOpcode::MAV_FTP_OPCODE_TRUNCATEFILE,
        MavFtpOpcode::MAV_FTP_OPCODE_RENAME,
    ] {
        let nak =
            (MavFtpOpcode::MAV_FTP_OPCODE_NAK as u8, MavFtpErr::MAV_FTP_ERR_FILEPROTECTED as u8);
        assert_eq!(opcode(answers(&mut pilot, 0, 254, &ftp(writes))), Some(nak), "{writes:?}");
    }
}

#[test]
fn prop_people_are_told_once_in_a_while() {
    let mut pilot = pilot();
    let arm = command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0);
    let mut texts = 0;
    for _ in 0..50 {
        let got = answers(&mut pilot, 0, 254, &arm);
        assert!(is_denied(&got));
        texts += got.iter().filter(|m| matches!(m, MavMessage::STATUSTEXT(_))).count();
    }
    assert!((1..=3).contains(&texts), "one text in up to three chunks, not {texts}");
}

#[test]
fn prop_warnings_are_bounded_and_counted() {
    let mut pilot = pilot();
    // Everybody may command on the second link; each of these is refused in words.
    let nonsense = command(MavCmd::MAV_CMD_DO_SET_MODE, 0.0);
    let mut texts = 0;
    for _ in 0..1000 {
        let got = answers(&mut pilot, 1, 254, &nonsense);
        assert!(is_denied(&got), "each is answered");
        texts += got.iter().filter(|m| matches!(m, MavMessage::STATUSTEXT(_))).count();
    }
    assert!(texts <= 31, "{texts}");
    let core = pilot.drops().len() - 1;
    assert!(pilot.drops()[core].count(DropReason::TextLimited) >= 960);
}

#[test]
fn prop_a_list_of_commanders_is_read_and_written() {
    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Holder {
        commanders: Commanders,
    }
    let read = |text: &str| toml::from_str::<Holder>(text).map_err(|e| e.to_string());
    let some: Commanders = [255, 1, 64].into_iter().collect();
    assert_eq!(read("commanders = [255, 64, 1]").unwrap().commanders, some);
    assert_eq!(read("commanders = \"255,1, 64\"").unwrap().commanders, some);
    assert_eq!(read("commanders = \"[255,1, 64]\"").unwrap().commanders, some);
    let all = read("commanders = \"all\"").unwrap();
    assert_eq!(all.commanders, Commanders::default());
    assert!(all.commanders.contains(0) && all.commanders.contains(255));
    let none = read("commanders = []").unwrap();
    assert!((0..=255).all(|id| !none.commanders.contains(id)));
    for holder in [all, none, Holder { commanders: some }] {
        assert_eq!(read(&toml::to_string(&holder).unwrap()), Ok(holder));
    }
    assert!(read("commanders = [256]").unwrap_err().contains("system id 256, allowed 0 to 255"));
    assert!(read("commanders = \"me\"").unwrap_err().contains("list of system ids"));
    assert_eq!(some.to_string(), "[1, 64, 255]");
}
