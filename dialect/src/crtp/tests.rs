//! Laws of the packets, and golden ones.
//!
//! Golden packets are put together by hand from the documents and sources that the files of this folder name. What
//! other programs send is in `tests_recorded.rs`.

use proptest::prelude::*;

use super::localization::anchor_position;
use super::loco::AnchorPosition;
use super::memory::{MAX_READ, MemoryInfo};
use super::packet::{MAX_PACKET, MAX_PAYLOAD};
use super::refusal::Refusal;
use super::supervisor::SupervisorBits;
use super::toc::TocItem;
use super::value::{Kind, Value};
use super::*;
use crate::crtp::log::{MAX_VARIABLES, Variable, Variables};

fn variables(of: &[(u16, Kind)]) -> Variables {
    let mut variables = Variables::default();
    for (id, kind) in of {
        assert!(variables.push(Variable { id: *id, kind: *kind }));
    }
    variables
}

fn refusal(byte: u8) -> Refusal {
    Refusal::outcome(byte).unwrap_err()
}

fn says(bytes: &[u8], message: ToBoard<'_>) {
    let packet = Packet::read(bytes).unwrap();
    assert_eq!(ToBoard::decode(&packet), Ok(message));
    assert_eq!(message.encode().unwrap().bytes(), bytes, "{message:?}");
}

fn answers(bytes: &[u8], message: FromBoard<'_>) {
    let packet = Packet::read(bytes).unwrap();
    assert_eq!(FromBoard::decode(&packet), Ok(message));
    assert_eq!(message.encode(), Some(packet), "{message:?}");
}

#[test]
fn val_packets_to_the_board_by_the_documents() {
    says(b"\xFD\x00", ToBoard::Link(Link::Source(&[0])));
    says(b"\xDD\x00", ToBoard::Platform(PlatformRequest::Protocol));
    says(b"\xDC\x01\x00", ToBoard::Platform(PlatformRequest::Arm(false)));
    says(b"\x5C\x03", ToBoard::Toc(Table::Log, TocRequest::Info));
    says(b"\x2C\x02\x34\x01", ToBoard::Toc(Table::Parameters, TocRequest::Item(0x134)));
    says(b"\x5D\x05", ToBoard::Log(LogControl::Reset));
    let block = variables(&[(9, Kind::F16), (0x104, Kind::U8), (7, Kind::F32)]);
    let create = b"\x5D\x06\x01\x88\x09\x00\x11\x04\x01\x77\x07\x00";
    says(create, ToBoard::Log(LogControl::Create(1, block)));
    let more = variables(&[(0x42, Kind::U16)]);
    says(b"\x5D\x07\x01\x22\x42\x00", ToBoard::Log(LogControl::Append(1, more)));
    says(b"\x5D\x03\x01\x0A", ToBoard::Log(LogControl::Start10Ms(1, 10)));
    says(b"\x5D\x08\x02\x05\x00", ToBoard::Log(LogControl::Start(2, 5)));
    says(b"\x2D\x04\x01", ToBoard::Parameter(ParameterRequest::Read(0x104)));
    says(b"\x2F\x07\x04\x01", ToBoard::Parameter(ParameterRequest::ExtendedType(0x104)));
    let (group, name) = ("flightmode", "stabModeYaw");
    let by_name = ParameterRequest::SetByName { group, name, kind: Kind::U8, value: Value::Int(1) };
    says(b"\x2F\0flightmode\0stabModeYaw\0\x08\x01", ToBoard::Parameter(by_name));
    says(b"\x9C\x0C", ToBoard::Supervisor(SupervisorRequest::Bits));
    says(b"\x9D\x01\x01", ToBoard::Supervisor(SupervisorRequest::Arm(true)));
    says(b"\x9D\x03", ToBoard::Supervisor(SupervisorRequest::EmergencyStop));
    says(b"\x6D\x03", ToBoard::Localization(Localization::EmergencyStop));
    says(b"\x4C\x02\x01", ToBoard::Memory(MemoryRequest::Info(1)));
    let read = MemoryRequest::Read { memory: 2, address: loco::position(1), len: 13 };
    says(b"\x4D\x02\x00\x21\x00\x00\x0D", ToBoard::Memory(read));
    let climb = Setpoint::Attitude { roll_deg: 1.0, pitch_deg: -2.0, yaw: 0.0, thrust: 40_000 };
    says(b"\x3C\0\0\x80\x3F\0\0\0\xC0\0\0\0\0\x40\x9C", ToBoard::Setpoint(climb));
    says(b"\x7C\x00", ToBoard::Setpoint(Setpoint::Stop));
    says(b"\x7D\x00\0\0\0\0", ToBoard::Setpoint(Setpoint::Yield(0)));
}

#[test]
fn val_packets_of_the_board_by_the_documents() {
    answers(b"\x00ready\n", FromBoard::Console(b"ready\n"));
    answers(
        b"\xFDBitcraze Crazyflie\0\0\0\0\0\0\0\0\0\0\0\0",
        FromBoard::Link(Link::Source(&link::SOURCE)),
    );
    answers(b"\xDD\x00\x0C\0\0\0", FromBoard::Platform(PlatformAnswer::Protocol(12)));
    let one_byte = Packet::read(b"\xDD\x00\x0C").unwrap();
    let protocol = FromBoard::Platform(PlatformAnswer::Protocol(12));
    assert_eq!(FromBoard::decode(&one_byte), Ok(protocol));
    let info = TocAnswer::Info { count: 300, crc: 0x0102_0304, limits: Some([16, 128]) };
    answers(b"\x50\x03\x2C\x01\x04\x03\x02\x01\x10\x80", FromBoard::Toc(Table::Log, info));
    let item = TocItem { id: 260, code: 0x78, group: "deck", name: "bcLoco" };
    assert_eq!(item.kind(Table::Parameters), Some(Kind::U8));
    assert!(item.is_extended() && item.is_read_only());
    answers(
        b"\x20\x02\x04\x01\x78deck\0bcLoco\0",
        FromBoard::Toc(Table::Parameters, TocAnswer::Item(item)),
    );
    let made = LogOutcome { command: 6, block: 1, outcome: Ok(()) };
    answers(b"\x5D\x06\x01\x00", FromBoard::Log(made));
    let full = LogOutcome { command: 7, block: 1, outcome: Err(refusal(7)) };
    assert_eq!(refusal(7).name(), "the block is full: 26 bytes");
    answers(b"\x5D\x07\x01\x07", FromBoard::Log(full));
    let row = LogRow { block: 1, time_ms: 0x03_0201, bytes: &[0x00, 0x3C, 0xFF] };
    let values: Vec<Value> = row.values(&[Kind::F16, Kind::I8]).unwrap().collect();
    assert_eq!(values, [Value::Float(1.0), Value::Int(-1)]);
    answers(b"\x52\x01\x01\x02\x03\x00\x3C\xFF", FromBoard::Row(row));
    let value = [0x00, 0x00, 0xC0, 0x3F];
    assert_eq!(Kind::F32.read(&value), Some(Value::Float(1.5)));
    answers(
        b"\x2D\x04\x00\x00\x00\x00\xC0\x3F",
        FromBoard::Parameter(ParameterAnswer::Read(4, Ok(&value))),
    );
    answers(
        b"\x2F\x07\x04\x00\x00\x01",
        FromBoard::Parameter(ParameterAnswer::ExtendedType(4, Ok(parameter::PERSISTENT))),
    );
    let (group, name) = ("flightmode", "stabModeYaw");
    answers(
        b"\x2F\0flightmode\0stabModeYaw\0\0",
        FromBoard::Parameter(ParameterAnswer::SetByName { group, name, outcome: Ok(()) }),
    );
    let bits = SupervisorBits::from_bits_retain(0x20E);
    answers(b"\x90\x8C\x0E\x02", FromBoard::Supervisor(SupervisorAnswer::Bits(bits)));
    let deck = MemoryInfo { kind: loco::TYPE, size: 0x1_1000, serial: &[0; 8] };
    answers(
        b"\x40\x02\x02\x13\x00\x10\x01\x00\0\0\0\0\0\0\0\0",
        FromBoard::Memory(MemoryAnswer::Info(2, Some(deck))),
    );
    let place = AnchorPosition { position_m: [1.5, -2.0, 0.5], valid: true };
    assert_eq!(AnchorPosition::read(&place.bytes()), Some(place));
    let read =
        MemoryAnswer::Read { memory: 2, address: loco::position(0), outcome: Ok(&place.bytes()) };
    answers(
        b"\x41\x02\x00\x20\x00\x00\x00\x00\x00\xC0\x3F\x00\x00\x00\xC0\x00\x00\x00\x3F\x01",
        FromBoard::Memory(read),
    );
}

#[test]
fn prop_what_does_not_fit_is_not_sent() {
    let long = [7; MAX_PAYLOAD + 1];
    assert_eq!(ToBoard::Link(Link::Echo(&long)).encode(), None);
    assert!(ToBoard::Link(Link::Echo(&long[1..])).encode().is_some());
    let by_name = |name, kind, value| {
        let group = "flightmode";
        ToBoard::Parameter(ParameterRequest::SetByName { group, name, kind, value }).encode()
    };
    assert!(by_name("stabModeYaw", Kind::U8, Value::Int(255)).is_some());
    assert_eq!(by_name("stabModeYaw", Kind::U8, Value::Int(256)), None);
    assert_eq!(by_name("stabModeYaw", Kind::I8, Value::Int(-129)), None);
    assert_eq!(by_name("stabModeYaw", Kind::U8, Value::Float(1.0)), None);
    assert_eq!(by_name("stab\0Yaw", Kind::U8, Value::Int(1)), None);
    assert_eq!(by_name("aNameThatIsFarTooLong", Kind::U8, Value::Int(1)), None);
    let mut full = variables(&[(1, Kind::U8); MAX_VARIABLES]);
    assert!(!full.push(Variable { id: 1, kind: Kind::U8 }));
    assert!(ToBoard::Log(LogControl::Create(1, full)).encode().is_some());
    let reading =
        |len| ToBoard::Memory(MemoryRequest::Read { memory: 2, address: 0, len }).encode();
    assert!(reading(MAX_READ as u8).is_some());
    assert_eq!(reading(MAX_READ as u8 + 1), None);
    assert_eq!(Packet::read(&[]), Err(CrtpError::BadLength));
    assert_eq!(Packet::read(&[0; MAX_PACKET + 1]), Err(CrtpError::BadLength));
}

#[test]
fn prop_what_is_unknown_is_said_so() {
    let to_board = |bytes: &[u8]| ToBoard::decode(&Packet::read(bytes).unwrap()).map(|_| ());
    let from_board = |bytes: &[u8]| FromBoard::decode(&Packet::read(bytes).unwrap()).map(|_| ());
    // A port without a service; the planner; a row that a client sends.
    for header in [0x10, 0x80, 0x52] {
        assert_eq!(to_board(&[header, 0]), Err(CrtpError::UnknownPlace));
    }
    assert_eq!(from_board(&[0x30, 0]), Err(CrtpError::UnknownPlace));
    assert_eq!(to_board(&[0x70, 11]), Err(CrtpError::UnknownCommand(11)));
    assert_eq!(to_board(&[0x70]), Err(CrtpError::BadPayload));
    assert_eq!(to_board(&[0x70, 0, 0]), Err(CrtpError::BadPayload));
    assert_eq!(from_board(&[0x50, 2, 0, 0, 7, b'a', 0, b'b']), Err(CrtpError::BadPayload));
    assert_eq!(from_board(&[0x50, 2]), Ok(()));
}

/// What messages are made of.
#[derive(Debug, Clone)]
struct Parts {
    byte: u8,
    id: u16,
    word: u32,
    flag: bool,
    group: String,
    name: String,
    /// Of the shortest room that any message leaves.
    bytes: Vec<u8>,
    numbers: [f32; 7],
    variables: Variables,
    kind: Kind,
    raw: [u8; 4],
}

fn parts() -> impl Strategy<Value = Parts> {
    let kind = || (0..Kind::ALL.len()).prop_map(|n| Kind::ALL[n]);
    let numbers = prop::array::uniform7(-1000.0_f32..1000.0);
    let of = prop::collection::vec((any::<u16>(), kind()), 0..=MAX_VARIABLES);
    let names = ("[a-zA-Z]{1,8}", "[a-zA-Z0-9\\[\\]-]{0,12}");
    let bytes = prop::collection::vec(any::<u8>(), 0..=MAX_READ);
    let whole = (any::<u8>(), any::<u16>(), any::<u32>(), any::<bool>(), any::<[u8; 4]>());
    (whole, names, bytes, numbers, of, kind()).prop_map(
        |((byte, id, word, flag, raw), (group, name), bytes, numbers, of, kind)| {
            let variables = variables(&of);
            Parts { byte, id, word, flag, group, name, bytes, numbers, variables, kind, raw }
        },
    )
}

impl Parts {
    fn requests(&self) -> Vec<ToBoard<'_>> {
        let Self { byte, id, word, flag, ref group, ref name, ref bytes, .. } = *self;
        let [x, y, z, a, b, c, d] = self.numbers;
        let value = self.kind.read(&self.raw[..self.kind.width()]).unwrap();
        // One that is no number is not equal to itself.
        let value = if value.f64().is_nan() { Value::Float(0.5) } else { value };
        let by_name = ParameterRequest::SetByName { group, name, kind: self.kind, value };
        let attitude = Setpoint::Attitude { roll_deg: x, pitch_deg: y, yaw: z, thrust: id };
        let mut all = vec![
            ToBoard::Setpoint(attitude),
            ToBoard::Setpoint(Setpoint::Stop),
            ToBoard::Setpoint(Setpoint::Yield(word)),
        ];
        let links = [Link::Echo(bytes), Link::Source(bytes), Link::Sink(bytes), Link::Null(bytes)];
        all.extend(links.map(ToBoard::Link));
        for table in [Table::Log, Table::Parameters] {
            let requests = [TocRequest::Info, TocRequest::Item(id)];
            all.extend(requests.map(|request| ToBoard::Toc(table, request)));
        }
        let controls = [
            LogControl::Create(byte, self.variables),
            LogControl::Append(byte, self.variables),
            LogControl::Delete(byte),
            LogControl::Start(byte, id),
            LogControl::Start10Ms(byte, id as u8),
            LogControl::Stop(byte),
            LogControl::Reset,
        ];
        for control in controls {
            let sent = ToBoard::Log(control).encode().unwrap();
            assert_eq!(sent.payload().first(), Some(&control.command()));
        }
        all.extend(controls.map(ToBoard::Log));
        let requests = [
            ParameterRequest::Read(id),
            ParameterRequest::Write(id, bytes),
            ParameterRequest::ExtendedType(id),
            by_name,
        ];
        all.extend(requests.map(ToBoard::Parameter));
        let position = [
            Localization::Position([x, y, z]),
            Localization::Pose([x, y, z], [a, b, c, d]),
            Localization::LppShort(byte, bytes),
            Localization::EmergencyStop,
        ];
        all.extend(position.map(ToBoard::Localization));
        let requests = [
            MemoryRequest::Count,
            MemoryRequest::Info(byte),
            MemoryRequest::Read { memory: byte, address: word, len: byte % (MAX_READ as u8 + 1) },
        ];
        all.extend(requests.map(ToBoard::Memory));
        let orders = [
            SupervisorRequest::Bits,
            SupervisorRequest::Arm(flag),
            SupervisorRequest::Recover,
            SupervisorRequest::EmergencyStop,
        ];
        all.extend(orders.map(ToBoard::Supervisor));
        let orders = [
            PlatformRequest::Protocol,
            PlatformRequest::Firmware,
            PlatformRequest::Device,
            PlatformRequest::Arm(flag),
            PlatformRequest::Recover,
        ];
        all.extend(orders.map(ToBoard::Platform));
        all
    }

    fn answers(&self) -> Vec<FromBoard<'_>> {
        let Self { byte, id, word, flag, ref group, ref name, ref bytes, .. } = *self;
        let outcome = Refusal::outcome(byte);
        let row = LogRow { block: byte, time_ms: word & 0xFF_FFFF, bytes };
        let localization = LppShortAnswer { anchor: byte, taken: flag };
        let mut all = vec![
            FromBoard::Console(bytes),
            FromBoard::Log(LogOutcome { command: id as u8, block: byte, outcome }),
            FromBoard::Row(row),
            FromBoard::Localization(localization),
        ];
        let links = [Link::Echo(bytes), Link::Source(bytes), Link::Sink(bytes), Link::Null(bytes)];
        all.extend(links.map(FromBoard::Link));
        for table in [Table::Log, Table::Parameters] {
            let limits = flag.then_some([byte, id as u8]);
            let answers = [
                TocAnswer::Info { count: id, crc: word, limits },
                TocAnswer::Item(TocItem { id, code: byte, group, name }),
                TocAnswer::NoItem,
            ];
            all.extend(answers.map(|answer| FromBoard::Toc(table, answer)));
        }
        let answers = [
            ParameterAnswer::Read(id, outcome.map(|()| bytes.as_slice())),
            ParameterAnswer::Written(id, bytes),
            ParameterAnswer::SetByName { group, name, outcome },
            ParameterAnswer::Updated(id, bytes),
            ParameterAnswer::ExtendedType(id, outcome.map(|()| word as u8)),
            ParameterAnswer::ExtendedType(id, Ok(byte)),
        ];
        all.extend(answers.map(FromBoard::Parameter));
        let info = MemoryInfo { kind: byte, size: word, serial: bytes.get(..12).unwrap_or(bytes) };
        let answers = [
            MemoryAnswer::Count(byte),
            MemoryAnswer::Info(byte, None),
            MemoryAnswer::Info(byte, Some(info)),
            MemoryAnswer::Read { memory: byte, address: word, outcome: Ok(bytes) },
            MemoryAnswer::Read { memory: byte, address: word, outcome: Err(refusal(5)) },
        ];
        all.extend(answers.map(FromBoard::Memory));
        let answers = [
            SupervisorAnswer::Bits(SupervisorBits::from_bits_retain(id)),
            SupervisorAnswer::Arm { done: flag, armed: byte & 1 != 0 },
            SupervisorAnswer::Recover { done: flag, recovered: byte & 1 != 0 },
        ];
        all.extend(answers.map(FromBoard::Supervisor));
        let answers = [
            PlatformAnswer::Protocol(word),
            PlatformAnswer::Firmware(name),
            PlatformAnswer::Device(group),
            PlatformAnswer::Arm { done: flag, armed: byte & 1 != 0 },
            PlatformAnswer::Recover { done: flag, recovered: byte & 1 != 0 },
        ];
        all.extend(answers.map(FromBoard::Platform));
        all
    }
}

/// Reads a packet both ways: what is a message is one again after it was sent.
fn reads_the_same_again(packet: &Packet) {
    if let Ok(message) = ToBoard::decode(packet) {
        let sent = message.encode().expect("what fitted once fits again");
        assert_eq!(format!("{:?}", ToBoard::decode(&sent)), format!("{:?}", Ok::<_, ()>(message)));
    }
    if let Ok(message) = FromBoard::decode(packet) {
        let sent = message.encode().expect("what fitted once fits again");
        assert_eq!(
            format!("{:?}", FromBoard::decode(&sent)),
            format!("{:?}", Ok::<_, ()>(message))
        );
    }
}

fn every_beginning_reads(packet: &Packet) {
    assert_eq!(Packet::read(packet.bytes()).as_ref(), Ok(packet));
    for len in 1..packet.bytes().len() {
        reads_the_same_again(&Packet::read(&packet.bytes()[..len]).unwrap());
    }
}

proptest! {
    #[test]
    fn prop_what_is_said_is_heard(parts in parts()) {
        for message in parts.requests() {
            let packet = message.encode().expect("it fits");
            prop_assert_eq!(ToBoard::decode(&packet), Ok(message));
            every_beginning_reads(&packet);
        }
        for message in parts.answers() {
            let packet = message.encode().expect("it fits");
            prop_assert_eq!(FromBoard::decode(&packet), Ok(message));
            every_beginning_reads(&packet);
        }
    }

    #[test]
    fn prop_no_bytes_do_harm(
        bytes in prop::collection::vec(any::<u8>(), 0..40),
        near in prop::sample::select(vec![0x20, 0x23, 0x40, 0x41, 0x50, 0x51, 0x61, 0x71, 0x91, 0xD1_u8]),
        command in 0..16_u8,
    ) {
        prop_assert_eq!(Packet::read(&bytes).is_ok(), (1..=MAX_PACKET).contains(&bytes.len()));
        let _ = loco::anchors(&bytes);
        let _ = AnchorPosition::read(&bytes);
        let close: Vec<u8> = [near, command].into_iter().chain(bytes.iter().copied()).collect();
        for bytes in [&bytes, &close] {
            if let Ok(packet) = Packet::read(bytes) {
                reads_the_same_again(&packet);
            }
        }
    }

    #[test]
    fn prop_a_row_is_its_values(of in prop::collection::vec((0..Kind::ALL.len(), any::<[u8; 4]>()), 0..=6)) {
        let kinds: Vec<Kind> = of.iter().map(|(n, _)| Kind::ALL[*n]).collect();
        let pieces = of.iter().zip(&kinds).map(|((_, raw), kind)| &raw[..kind.width()]);
        let bytes: Vec<u8> = pieces.clone().flatten().copied().collect();
        let row = LogRow { block: 1, time_ms: 5, bytes: &bytes };
        let values: Vec<Value> = row.values(&kinds).expect("as long as they are").collect();
        let expected: Vec<Value> =
            pieces.zip(&kinds).map(|(bytes, kind)| kind.read(bytes).unwrap()).collect();
        prop_assert_eq!(format!("{values:?}"), format!("{expected:?}"));
        let longer: Vec<Kind> = kinds.into_iter().chain([Kind::U8]).collect();
        prop_assert!(row.values(&longer).is_none());
    }

    #[test]
    fn prop_an_anchor_is_where_it_was_told(position_m in prop::array::uniform3(-100.0_f32..100.0), valid: bool) {
        let place = AnchorPosition { position_m, valid };
        prop_assert_eq!(AnchorPosition::read(&place.bytes()), Some(place));
        let told = anchor_position(position_m);
        prop_assert_eq!(told[0], 1);
        prop_assert_eq!(&told[1..], &place.bytes()[..12]);
    }
}
