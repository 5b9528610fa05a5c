//! First inputs for every target: what the encoders make, and files of the repository. The fuzzers go on
//! from there.

use std::fs;
use std::path::{Path, PathBuf};

use haltere::sources::stored;
use haltere_core::time::HostTime;
use haltere_dialect::lps::sniffer::{SnifferFrame, encode};
use haltere_dialect::mav_stream;
use haltere_dialect::signing::{self, SigningKey};
use haltere_log::record::{BuildIdentity, Recorder, Session};
use haltere_pilot::settings::Config;
use haltere_pilot::{Input, LinkId, Pilot};

/// Packets of a Crazyflie, one of each form.
const CRTP: [(&str, &[u8]); 16] = [
    ("table-info", b"P\x03,\x01\x04\x03\x02\x01\x10\x80"),
    ("table-item", b"\x20\x02\x04\x01xdeck\0bcLoco\0"),
    ("log-create", b"]\x06\x01\x88\x09\0\x11\x04\x01w\x07\0"),
    ("log-start", b"]\x08\x02\x05\0"),
    ("log-row", b"R\x01\x01\x02\x03\x05\x02"),
    ("set-by-name", b"/\0flightmode\0stabModeYaw\0\x08\x01"),
    ("set-by-name-done", b"/\0flightmode\0stabModeYaw\0\0"),
    ("extended-type", b"/\x07\x04\0\0\x01"),
    ("read", b"-\x04\0\0\0\0\xC0?"),
    ("attitude", b"<\0\0\x80?\0\0\0\xC0\0\0\0\0@\x9C"),
    ("memory-info", b"@\x02\x02\x13\0\x10\x01\0\0\0\0\0\0\0\0\0"),
    ("memory-read", b"A\x02\0\x20\0\0\0\0\0\xC0?\0\0\0\xC0\0\0\0?\x01"),
    ("bits", b"\x90\x8C\x0E\x02"),
    ("armed", b"\x91\x81\x01\x01"),
    ("protocol", b"\xDD\0\x0C\0\0\0"),
    ("pose", b"a\x08\0\0\x80?\0\0\x80?\0\0\x80?\0\0\x80?\0\0\x80?\0\0\x80?\0\0\x80?"),
];

/// Writes them into `fuzz/corpus`.
pub fn write() -> std::io::Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let write = |target: &str, name: &str, bytes: &[u8]| {
        // A whole log has its schemas in it; a cut one stands for it.
        if bytes.len() as u64 > super::MOST_INPUT_B {
            return Ok(());
        }
        let folder = root.join("fuzz/corpus").join(target);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join(name), bytes)
    };
    let mut tdoa2 = vec![0; 57];
    tdoa2[0] = 0x22;
    for (n, byte) in tdoa2.iter_mut().enumerate().skip(1) {
        *byte = n as u8;
    }
    let mut tdoa3 = vec![0x30, 5, 1, 2, 3, 4, 2, 0x81, 9, 8, 7, 6, 1, 1, 2, 4, 4, 4, 4];
    write("tdoa2", "seed-plain", &tdoa2)?;
    write("tdoa3", "seed-plain", &tdoa3)?;
    let position: Vec<u8> = [0xF0, 1]
        .into_iter()
        .chain([1.0_f32, 2.0, 3.0].into_iter().flat_map(f32::to_le_bytes))
        .collect();
    let sniffed = |source: u8, payload: &[u8]| {
        let mut bytes = Vec::new();
        encode(
            &mut bytes,
            &SnifferFrame { rx_ticks: 0x12_3456_789A, source, destination: 0xFF, payload },
        );
        bytes
    };
    let mut stream = vec![7];
    for source in 0..3 {
        stream.extend(sniffed(source, &tdoa2));
    }
    stream.extend(sniffed(4, &tdoa3));
    write("sniffer", "seed-binary", &stream)?;
    write("sniffer", "seed-text", b"\x09From 01 to FF @3412785634: 22010203\r\nFrom 02 to ff")?;
    tdoa2.extend(&position);
    tdoa3.extend(&position);
    write("tdoa2", "seed-position", &tdoa2)?;
    write("tdoa3", "seed-position", &tdoa3)?;

    for (name, packet) in CRTP {
        write("crtp", &format!("seed-{name}"), packet)?;
    }

    let frame = |id: u32, payload: &[u8]| {
        let mut bytes = Vec::new();
        mav_stream::encode_payload(&mut bytes, 255, 190, 3, id, payload);
        bytes
    };
    let beat = frame(0, &[0, 0, 0, 0, 6, 8, 0, 4, 3]);
    let key = SigningKey::new([1; 32]).expect("a key");
    let signed = signing::sign(&beat, &key, 1, 12_345).expect("a frame of ours");
    write("mavlink", "seed-frames", &[beat.clone(), vec![0xFE, 0, 1, 2], signed.clone()].concat())?;
    let mut setup = vec![0; 42];
    setup[8] = 1;
    setup[10..].fill(7);
    for choice in 0..9_u8 {
        let stream =
            [vec![choice, 64, 1], beat.clone(), signed.clone(), frame(256, &setup)].concat();
        write("signing", &format!("seed-{choice}"), &stream)?;
    }
    // What: low half 4 and up is a message, of the list of its target; then length, then payload.
    let step = |target: &str, name: &str, messages: &[(u8, Vec<u8>)]| {
        let mut bytes = vec![0];
        for (what, payload) in messages {
            bytes.extend([0x40 | what, payload.len() as u8]);
            if matches!(what & 0xF, 1 | 2) {
                bytes.push(0xFF);
            }
            bytes.extend(payload);
        }
        write(target, name, &bytes)
    };
    let text = |name: &str, n: usize| {
        let mut bytes = name.as_bytes().to_vec();
        bytes.resize(n, 0);
        bytes
    };
    // Messages 11 (index 0) to 15 wrap around the list of ids.
    step(
        "missions",
        "seed-upload",
        &[(11, vec![2, 0, 1, 1, 0]), (12, vec![0; 38]), (0, vec![]), (14, vec![1, 1, 0])],
    )?;
    let mut set = 1.5_f32.to_le_bytes().to_vec();
    set.extend([1, 1]);
    set.extend(text("FLT_TKO_HGT", 16));
    set.push(9);
    step("parameters", "seed-set", &[(5, set), (7, vec![1, 1]), (1, vec![]), (0, vec![])])?;
    let ftp = |opcode: u8, path: &str| {
        let mut payload = vec![0, 1, 1, 1, 0, 0, opcode, path.len() as u8, 0, 0, 0, 0, 0, 0, 0];
        payload.extend(path.as_bytes());
        (8, payload)
    };
    step(
        "ftp",
        "seed-files",
        &[
            ftp(3, "/"),
            ftp(4, "@PARAM/param.pck"),
            ftp(3, "/missions"),
            (1, b"a.toml\t5\t0\n".to_vec()),
            ftp(6, "/missions/a.toml"),
            ftp(15, ""),
        ],
    )?;
    let mut whole = vec![0x80];
    for bytes in [beat.clone(), frame(76, &[0; 33])] {
        whole.extend([0x24, bytes.len() as u8]);
        whole.extend(bytes);
    }
    whole.extend([0x07, 57, 1, 1, 2, 3, 4, 5]);
    whole.extend(&tdoa2[..57]);
    whole.extend([0x00, 200]);
    write("pilot", "seed-mixed", &whole)?;

    let samples: [PathBuf; 2] =
        ["haltere.toml", "anchors.toml"].map(|f| root.join("config").join(f));
    for sample in samples {
        let name = sample.file_stem().and_then(|n| n.to_str()).unwrap_or("file").to_owned();
        write("config", &format!("seed-{name}"), &fs::read(&sample)?)?;
    }
    let values: stored::Values = [("FLT_TKO_HGT".to_owned(), 1.2)].into();
    write("config", "seed-parameters", stored::to_text(&values).as_bytes())?;
    write(
        "mission_file",
        "seed-mission",
        b"[[item]]\ncommand = \"takeoff\"\nheight_m = 1.0\n\n[[item]]\ncommand = \"waypoint\"\nposition_m = [1.0, 2.0, 1.5]\n\n[[item]]\ncommand = \"land\"\n",
    )?;

    let mut hole = super::logs::Maker::new(1_000_000, 0);
    let largest = haltere_log::record::pb::Hole {
        from_us: u64::MAX,
        first_sequence: u64::MAX,
        last_sequence: u64::MAX,
        lost_raw: u64::MAX,
        lost_topics: u64::MAX,
        ..Default::default()
    };
    hole.put("/hole", u64::MAX, &largest);
    let wake = haltere_log::record::pb::Wake { sequence: u64::MAX, host_time_us: u64::MAX };
    hole.put("/wake", u64::MAX, &wake);
    write("log", "largest-numbers", &hole.finish())?;
    for seed in 0..8 {
        write("log", &format!("claims-{seed}"), &super::logs::any(seed, 30, None, seed & 1 > 0))?;
    }

    write("outline", "seed-flights", &super::logs::flights())?;

    // A short log of a core that hears noise.
    let folder = tempfile::tempdir()?;
    let at = HostTime::from_us(1_000_000);
    let config = Config::default();
    let session = Session {
        build: BuildIdentity::current(),
        started_unix_us: 0,
        pilot_started_at: at,
        config_toml: "[record]\nenabled = true\n".to_owned(),
        survey: crate::targets::core::hall(),
    };
    let mut recorder = Recorder::start(folder.path(), &session).map_err(std::io::Error::other)?;
    let mut pilot = Pilot::new(config.pilot(), crate::targets::core::hall(), at).without_topics();
    for n in 0..4_u64 {
        let at = HostTime::from_us(1_000_000 + n * 10_000);
        let input = if n == 1 {
            Input::Bytes { link: LinkId::Ground(0), bytes: &beat }
        } else {
            Input::Wake
        };
        recorder.input(at, input);
        pilot.handle(at, input);
        pilot.drain_output(|link, bytes| recorder.output(at, link, bytes));
        pilot.drain_topics(|topic| recorder.topic(at, topic));
    }
    let summary = recorder.finish();
    let path = summary.path.ok_or_else(|| std::io::Error::other("no log"))?;
    write("log", "seed-short", &fs::read(path)?)
}
