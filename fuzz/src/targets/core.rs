//! The pilot core on any bytes over any link, and the protocols of its services message by message.

use haltere_core::frames::Vec3;
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_dialect::mav_stream;
use haltere_pilot::services::{FileFault, FileRequest};
use haltere_pilot::{Endpoint, Input, LinkId, Pilot, PilotConfig, TagProtocol};

/// Most steps of one run, and most simulated time, µs: the rest of the input is not looked at. A hundred
/// control steps take as long as everything else together.
const MOST_STEPS: usize = 200;
const MOST_WAITED_US: i64 = 1_000_000;
/// Most bytes that one input may make the core send at once. A whole parameter list is paced; this is
/// everything that a single answer can be, for every link.
const MOST_OUT_B: usize = 256 * 1024;

/// Anchors in the corners of a hall.
pub fn hall() -> Survey {
    let corner = |i: u8| {
        let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
        (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
    };
    let corners: Vec<_> = (0..8).map(corner).collect();
    Survey::new(&corners).unwrap_or_else(|problems| panic!("{problems}"))
}

/// Reads an input piece by piece; zeros behind its end.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    fn take(&mut self, n: usize) -> &'a [u8] {
        let (piece, rest) = self.0.split_at(n.min(self.0.len()));
        self.0 = rest;
        piece
    }

    fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// A core with its links up, and the disk behind it.
struct Rig {
    pilot: Pilot,
    at: HostTime,
    /// What the disk is asked for and has not answered.
    tasks: Vec<FileRequest>,
    /// Of everything that it sent.
    hash: u64,
    waited_us: i64,
}

impl Rig {
    fn new(choice: u8) -> Self {
        let strict = Endpoint { commanders: [255].into_iter().collect(), ..Endpoint::default() };
        let slow = Endpoint { line_Bps: Some(5760.0), stations: 2, ..Endpoint::default() };
        let mut config = PilotConfig {
            endpoints: vec![Endpoint::default(), strict, slow],
            store: choice & 2 == 0,
            ..PilotConfig::default()
        };
        if choice & 1 != 0 {
            config.tag_protocol = TagProtocol::Mavlink;
        }
        if choice & 4 != 0 {
            config.routing = haltere_pilot::Routing::Board;
        }
        if choice & 8 != 0 {
            config.board_profile = haltere_pilot::BoardProfile::Crazyflie;
            config.tag_protocol = TagProtocol::Crazyflie;
        }
        let at = HostTime::from_us(1_000_000);
        let mut rig = Self {
            pilot: Pilot::new(config, hall(), at),
            at,
            tasks: Vec::new(),
            hash: 0,
            waited_us: 0,
        };
        for link in [LinkId::Tag, LinkId::Board, LinkId::Ground(0), LinkId::Ground(1)] {
            rig.feed(Input::LinkUp { link });
        }
        rig
    }

    fn feed(&mut self, input: Input<'_>) {
        self.pilot.handle(self.at, input);
        let (mut sent, mut hash) = (0, self.hash);
        self.pilot.drain_output(|link, bytes| {
            sent += bytes.len();
            for byte in bytes.iter().chain([&link.number()]) {
                hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
            }
        });
        self.hash = hash;
        assert!(sent <= MOST_OUT_B, "{sent} bytes for one input");
        self.pilot.drain_topics(|_| {});
        let tasks = &mut self.tasks;
        self.pilot.drain_file_requests(|task| tasks.push(task));
        assert!(tasks.len() <= 64, "{} tasks for the disk", tasks.len());
    }

    fn wait(&mut self, us: i64) {
        let us = us.min(MOST_WAITED_US - self.waited_us);
        self.waited_us += us;
        let until = self.at.offset_us(us);
        while self.pilot.next_deadline() <= until {
            self.at = self.at.max(self.pilot.next_deadline());
            self.feed(Input::Wake);
        }
        self.at = until;
    }

    fn answer(&mut self, which: u8, bytes: &[u8]) {
        if self.tasks.is_empty() {
            return;
        }
        let task = self.tasks.remove(usize::from(which) % self.tasks.len());
        let faults =
            [FileFault::NotFound, FileFault::Protected, FileFault::Full, FileFault::Failed];
        let result = match faults.get(usize::from(which >> 5)) {
            Some(fault) => Err(*fault),
            None => Ok(()),
        };
        self.feed(Input::File { ticket: task.ticket, result, bytes });
    }

    fn message(&mut self, link: LinkId, system: u8, id: u32, payload: &[u8]) {
        let mut bytes = Vec::new();
        mav_stream::encode_payload(&mut bytes, system, 190, 0, id, payload);
        self.feed(Input::Bytes { link, bytes: &bytes });
    }
}

/// Messages with these ids, answers of the disk and time, in any order.
fn protocol(data: &[u8], ids: &[u32]) {
    let mut reader = Reader(data);
    let mut rig = Rig::new(reader.byte() & !1);
    for _ in 0..MOST_STEPS {
        if reader.is_empty() {
            break;
        }
        let what = reader.byte();
        let length = usize::from(reader.byte());
        let link = LinkId::Ground(what >> 4 & 1);
        match what & 0xF {
            0 => rig.wait(i64::from(length as u8) * 1000),
            1 | 2 => {
                let which = reader.byte();
                let piece = reader.take(length);
                rig.answer(which, piece);
            }
            3 if what & 0x20 != 0 => rig.feed(Input::LinkDown { link }),
            3 => rig.feed(Input::LinkUp { link }),
            n => {
                let id = ids[usize::from(n) % ids.len()];
                let system = if what & 0x40 != 0 { 255 } else { 254 };
                let payload = reader.take(length);
                rig.message(link, system, id, payload);
            }
        }
    }
    rig.wait(200_000);
}

/// MISSION_COUNT, _ITEM_INT, _ITEM, _REQUEST_LIST, _REQUEST_INT, _REQUEST, _ACK, _CLEAR_ALL,
/// _SET_CURRENT, partial lists.
pub fn missions(data: &[u8]) {
    protocol(data, &[44, 73, 39, 43, 51, 40, 47, 45, 41, 37, 38]);
}

/// PARAM_SET, _REQUEST_READ, _REQUEST_LIST, PARAM_EXT_SET, and COMMAND_LONG, which resets them.
pub fn parameters(data: &[u8]) {
    protocol(data, &[23, 20, 21, 323, 76]);
}

/// FILE_TRANSFER_PROTOCOL and LOG_REQUEST_LIST, _DATA, _END, LOG_ERASE.
pub fn ftp(data: &[u8]) {
    protocol(data, &[110, 110, 110, 110, 117, 119, 122, 121]);
}

/// Anything on any link, in frames whose checksum is right and in bytes as they are; twice, with the
/// same outcome.
pub fn pilot(data: &[u8]) {
    let first = whole(data);
    if data.first().is_some_and(|choice| choice & 0x80 != 0) {
        assert_eq!(first, whole(data), "the same inputs, and another outcome");
    }
}

fn whole(data: &[u8]) -> u64 {
    let mut reader = Reader(data);
    let mut rig = Rig::new(reader.byte());
    for _ in 0..MOST_STEPS {
        if reader.is_empty() {
            break;
        }
        let what = reader.byte();
        let length = usize::from(reader.byte());
        let link = LinkId::from_number(what >> 4 & 7);
        match what & 0xF {
            0 => rig.wait(i64::from(length as u8) * 1000),
            1 => rig.wait(i64::from(length as u8) * 50),
            2 => {
                let which = reader.byte();
                let piece = reader.take(length);
                rig.answer(which, piece);
            }
            3 if what & 0x80 != 0 => rig.feed(Input::LinkDown { link }),
            3 => rig.feed(Input::LinkUp { link }),
            4..=6 => {
                let bytes = reader.take(length);
                rig.feed(Input::Bytes { link, bytes });
            }
            7 => {
                // A sniffer frame whose lengths fit.
                let source = reader.byte();
                let ticks = reader.take(5).to_vec();
                let payload = reader.take(length.min(128));
                let mut bytes = vec![0xBC];
                bytes.extend(ticks.iter().chain(std::iter::repeat(&0)).take(5));
                bytes.extend([source, 0xFF]);
                bytes.extend((payload.len() as u16).to_le_bytes());
                bytes.extend(payload);
                bytes.extend((payload.len() as u16).to_le_bytes());
                rig.feed(Input::Bytes { link: LinkId::Tag, bytes: &bytes });
            }
            _ => {
                let id = u32::from(u16::from_le_bytes([reader.byte(), reader.byte() & 0x3F]));
                let system = [255, 254, 1, 2][usize::from(what & 3)];
                let payload = reader.take(length);
                rig.message(link, system, id, payload);
            }
        }
    }
    rig.wait(50_000);
    rig.hash
}
