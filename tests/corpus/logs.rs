//! Logs without schemas, of some hundred bytes, whose records claim anything: the largest and the smallest
//! numbers, times that run backwards, no numbers at all.

use haltere_log::record::pb;

/// Times and counts that go wrong most easily.
const WHOLE: [u64; 9] =
    [0, 1, 1_000_000, 1_010_000, 1 << 31, 1 << 63, u64::MAX - 9_999, u64::MAX - 1, u64::MAX];
/// Numbers that go wrong most easily.
const REAL: [f64; 12] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.6,
    7.4,
    1e9,
    f64::MIN_POSITIVE,
    f64::MAX,
    f64::MIN,
    f64::INFINITY,
    f64::NAN,
];

/// A log in the making.
pub struct Maker {
    bytes: Vec<u8>,
    channels: Vec<&'static str>,
}

impl Maker {
    /// With its head; the companion started at `start_us`.
    pub fn new(start_us: u64, started_unix_us: i64) -> Self {
        let mut log = Self { bytes: mcap::MAGIC.to_vec(), channels: Vec::new() };
        let anchors = (0..8_u32).map(|id| {
            let far = |bit: u32, m: f64| if id & bit != 0 { m } else { 0.0 };
            let pos_e_m = Some(pb::Vec3 { x: far(1, 6.0), y: far(2, 6.0), z: -far(4, 3.0) });
            pb::SurveyedAnchor { id, pos_e_m }
        });
        let session = pb::Session {
            started_unix_us,
            pilot_started_us: start_us,
            anchors: anchors.collect(),
            ..pb::Session::default()
        };
        log.put("/config", start_us, &session);
        log
    }

    /// One record more.
    pub fn put(&mut self, channel: &'static str, at_us: u64, message: &impl prost::Message) {
        let id = match self.channels.iter().position(|c| *c == channel) {
            Some(id) => id as u16,
            None => {
                let id = self.channels.len() as u16;
                self.channels.push(channel);
                let mut body = id.to_le_bytes().to_vec();
                body.extend([0; 2]);
                for text in [channel, "protobuf"] {
                    body.extend((text.len() as u32).to_le_bytes());
                    body.extend(text.as_bytes());
                }
                body.extend([0; 4]);
                self.record(0x04, &body);
                id
            }
        };
        let mut body = id.to_le_bytes().to_vec();
        body.extend([0; 4]);
        let at_ns = at_us.wrapping_mul(1000);
        body.extend(at_ns.to_le_bytes());
        body.extend(at_ns.to_le_bytes());
        body.extend(message.encode_to_vec());
        self.record(0x05, &body);
    }

    fn record(&mut self, opcode: u8, body: &[u8]) {
        self.bytes.push(opcode);
        self.bytes.extend((body.len() as u64).to_le_bytes());
        self.bytes.extend(body);
    }

    /// Closed properly.
    pub fn finish(mut self) -> Vec<u8> {
        self.record(0x0F, &[0; 4]);
        self.bytes.extend(mcap::MAGIC);
        self.bytes
    }
}

/// A log of two flights that was closed: with index and tail, in small chunks, without schemas.
pub fn flights() -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(300));
    let mut log =
        options.create(std::io::Cursor::new(Vec::new())).expect("memory takes everything");
    let anchors = (0..8_u32).map(|id| {
        let far = |bit: u32, m: f64| if id & bit != 0 { m } else { 0.0 };
        let pos_e_m = Some(pb::Vec3 { x: far(1, 6.0), y: far(2, 6.0), z: -far(4, 3.0) });
        pb::SurveyedAnchor { id, pos_e_m }
    });
    let session = pb::Session { anchors: anchors.collect(), ..pb::Session::default() };
    let channels = ["/config", "/wake", "/mode", "/hole"].map(|name| {
        log.add_channel(0, name, "protobuf", &Default::default()).expect("a name of its own")
    });
    let mut put = |channel: usize, at_us: u64, message: &[u8]| {
        let time = at_us * 1000;
        let head = mcap::records::MessageHeader {
            channel_id: channels[channel],
            sequence: 0,
            log_time: time,
            publish_time: time,
        };
        log.write_to_known_channel(&head, message).expect("memory takes everything");
    };
    use prost::Message as _;
    put(0, 0, &session.encode_to_vec());
    let modes = ["disarmed", "arming", "takeoff", "land", "disarmed"];
    for (n, mode) in (1..).zip(modes.iter().chain(&modes[1..])) {
        let at_us = n * 1_000_000;
        put(1, at_us, &pb::Wake { sequence: n, host_time_us: at_us }.encode_to_vec());
        let mode = pb::Mode { at_us, mode: (*mode).to_owned(), ..pb::Mode::default() };
        put(2, at_us, &mode.encode_to_vec());
        put(3, at_us, &pb::Hole { lost_topics: 1, ..pb::Hole::default() }.encode_to_vec());
    }
    log.finish().expect("memory takes everything");
    log.into_inner().into_inner()
}

/// Numbers by a seed; the same on every computer.
pub struct Dice(pub u64);

impl Dice {
    /// One of the first `n` numbers, from 0.
    pub fn roll(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        ((self.0 >> 33) as usize) % n
    }

    fn whole(&mut self) -> u64 {
        WHOLE[self.roll(WHOLE.len())]
    }

    fn real(&mut self) -> f64 {
        REAL[self.roll(REAL.len())]
    }

    fn maybe(&mut self) -> Option<f64> {
        (self.roll(3) > 0).then(|| self.real())
    }

    fn vec3(&mut self) -> Option<pb::Vec3> {
        (self.roll(4) > 0).then(|| pb::Vec3 { x: self.real(), y: self.real(), z: self.real() })
    }

    fn quaternion(&mut self) -> Option<pb::Quaternion> {
        (self.roll(4) > 0).then(|| pb::Quaternion {
            w: self.real(),
            x: self.real(),
            y: self.real(),
            z: self.real(),
        })
    }

    /// A time: anything, or a step after the last one, of which fits and spectra are made.
    fn time(&mut self, steady: bool, last_us: &mut u64) -> u64 {
        *last_us = if steady { last_us.wrapping_add(4_000) } else { self.whole() };
        *last_us
    }
}

/// Kinds of record that [`any`] makes.
pub const KINDS: usize = 20;

/// A log of `count` records, of all kinds or of the one that is named; `steady`: at even times.
pub fn any(seed: u64, count: usize, kind: Option<usize>, steady: bool) -> Vec<u8> {
    let mut dice = Dice(seed);
    let start_us = dice.whole();
    let unix_us = [0, 1_795_269_763_000_000, i64::MAX, i64::MIN][dice.roll(4)];
    let mut log = Maker::new(start_us, unix_us);
    let mut last_us = start_us;
    for n in 0..count {
        let at = dice.time(steady, &mut last_us);
        let sequence = if dice.roll(4) > 0 { n as u64 + 1 } else { dice.whole() };
        // A flight has control steps, or its report and its fits are empty.
        let what = kind.map_or_else(|| dice.roll(KINDS), |kind| if n % 4 == 3 { 7 } else { kind });
        put(&mut log, &mut dice, what, at, sequence);
    }
    log.finish()
}

fn put(log: &mut Maker, dice: &mut Dice, what: usize, at: u64, sequence: u64) {
    let d = dice;
    match what {
        0 => log.put("/wake", at, &pb::Wake { sequence, host_time_us: at }),
        1 => {
            let hole = pb::Hole {
                from_us: d.whole(),
                to_us: d.whole(),
                first_sequence: d.whole(),
                last_sequence: d.whole(),
                lost_raw: d.whole(),
                lost_topics: d.whole(),
            };
            log.put("/hole", at, &hole);
        }
        2 => {
            let raw = pb::RawBytes { sequence, host_time_us: at, data: vec![0xFD; d.roll(40)] };
            log.put(["/in/board", "/in/tag", "/out/ground/0", "/out/board"][d.roll(4)], at, &raw);
        }
        3 => {
            let lost = pb::Lost {
                sequence,
                host_time_us: at,
                link: d.whole() as u32,
                reason: "tag_bad_length".to_owned(),
                count: d.whole(),
            };
            log.put("/in/lost", at, &lost);
        }
        4 => {
            let unix_us = d.whole() as i64;
            log.put("/in/calendar", at, &pb::Calendar { sequence, host_time_us: at, unix_us });
        }
        5 => {
            let event = pb::LinkEvent {
                sequence,
                host_time_us: at,
                link: d.roll(4) as u32,
                kind: d.roll(3) as i32,
            };
            log.put("/in/event", at, &event);
        }
        6 => {
            let file = pb::FileAnswer {
                sequence,
                host_time_us: at,
                ticket: d.whole() as u32,
                fault: d.roll(6) as u32,
                data: vec![7; d.roll(20)],
            };
            log.put("/in/file", at, &file);
        }
        7 => {
            let control = pb::Control {
                at_us: at,
                pos_setpoint_north_m: d.maybe(),
                pos_setpoint_east_m: d.maybe(),
                pos_setpoint_down_m: d.maybe(),
                vel_setpoint_e_mps: d.vec3(),
                roll_rad: d.real(),
                pitch_rad: d.real(),
                yaw_rad: d.real(),
                thrust_frac: d.real(),
                thrust_base_frac: d.real(),
                yaw_board_offset_rad: d.real(),
                hover_factor: d.maybe(),
                tilt_factor: d.maybe(),
                tilt_cut: d.roll(2) > 0,
                ..pb::Control::default()
            };
            log.put("/control", at, &control);
        }
        8 => {
            let estimate = pb::Estimate {
                at_us: at,
                pos_e_m: d.vec3(),
                vel_b_mps: d.vec3(),
                q_eb: d.quaternion(),
                std_pos_e_m: d.vec3(),
                health: d.roll(4) as i32,
                ..pb::Estimate::default()
            };
            log.put("/estimate", at, &estimate);
        }
        9 | 10 => {
            let (acc_b_mps2, rate_b_radps) = (d.vec3(), d.vec3());
            let imu = pb::Imu { valid_at_us: at, received_at_us: at, acc_b_mps2, rate_b_radps };
            log.put("/imu", at, &imu);
        }
        11 => {
            let uwb = pb::Uwb {
                valid_at_us: at,
                received_at_us: d.whole(),
                anchor_a: d.roll(300) as u32,
                anchor_b: d.roll(9) as u32,
                distance_diff_m: d.real(),
                std_m: d.maybe(),
                innovation_m: d.real(),
                var_innovation_m2: d.real(),
                test_ratio: d.real(),
                fused: d.roll(2) > 0,
            };
            log.put("/uwb", at, &uwb);
        }
        12 => {
            let battery = pb::Battery {
                received_at_us: at,
                supply_v: d.real(),
                current_a: d.maybe(),
                remaining_frac: d.maybe(),
            };
            log.put("/battery", at, &battery);
        }
        13 => {
            let board = pb::BoardAttitude {
                valid_at_us: at,
                received_at_us: d.whole(),
                q_board: d.quaternion(),
                ..pb::BoardAttitude::default()
            };
            log.put("/board_attitude", at, &board);
        }
        14 => {
            let reference = pb::Reference {
                valid_at_us: at,
                received_at_us: d.whole(),
                pos_e_m: d.vec3(),
                q_eb: d.quaternion(),
            };
            log.put("/reference", at, &reference);
        }
        15 => {
            let mode = ["mission", "takeoff", "land", "", "a\"b,<c>"][d.roll(5)].to_owned();
            let mode = pb::Mode { at_us: at, mode, armed: d.roll(2) > 0, cause: "\n".to_owned() };
            log.put("/mode", at, &mode);
        }
        16 => {
            let severity = d.whole() as u32;
            log.put("/text", at, &pb::Text { at_us: at, severity, text: "ä\0<".to_owned() });
        }
        17 => {
            let drops = (0..d.roll(4)).map(|_| pb::Drop {
                link: d.whole() as u32,
                reason: "tag_garbage_byte".to_owned(),
                count: d.whole(),
            });
            let health = pb::Health {
                at_us: at,
                drops: drops.collect(),
                deadline_misses: d.whole(),
                control_steps: d.whole(),
                uwb_age_s: d.maybe(),
                imu_age_s: d.maybe(),
                std_board_clock_s: d.maybe(),
                left_out: d.whole() as u32,
            };
            log.put("/health", at, &health);
        }
        18 => {
            let glue = pb::Glue {
                at_us: at,
                wake_ups: d.whole(),
                late_wake_ups: d.whole(),
                worst_lateness_s: d.real(),
            };
            log.put("/glue", at, &glue);
        }
        _ => {
            let mag =
                pb::Mag { valid_at_us: at, received_at_us: d.whole(), field_b_tesla: d.vec3() };
            log.put("/mag", at, &mag);
        }
    }
}
