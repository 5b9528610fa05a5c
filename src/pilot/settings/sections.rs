//! The sections that concern links, files and timing.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::address::Address;
use crate::config::{BoardProfile, TagProtocol};
use crate::stations::guard::Signing;
use haltere_core::checks::Problems;
use haltere_core::keys::NoNumber;

haltere_core::keys! {
    /// `[tag]`: the UWB tag.
    pub struct TagConfig {
        /// Device of the UWB tag, for example "/dev/ttyACM0". "auto" takes the first USB device that says it is a Loco
        /// Positioning Node (0483:5740).
        port: TagPort = TagPort::Auto;
        /// "lps-sniffer": a Loco Positioning Node in sniffer mode. "mavlink": a tag that sends UWB_TDOA. "crazyflie": the
        /// Loco deck of a Crazyflie that is the board; it has no port.
        protocol: TagProtocol = TagProtocol::default();
        /// Speed of the line. A sniffer on USB ignores it.
        baud: u32 = 921_600, [9_600.0..=12_000_000.0, "baud"];
        /// Signatures of a tag that speaks MAVLink, as in `[ground]`: "off", "accept" or "require".
        signing: Signing = Signing::default();
    } rules port_and_protocol;
}

/// Device of the tag.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub enum TagPort {
    /// The first USB device that says it is a Loco Positioning Node.
    Auto,
    /// This device.
    Device(PathBuf),
}

impl From<String> for TagPort {
    fn from(text: String) -> Self {
        if text == "auto" { TagPort::Auto } else { TagPort::Device(text.into()) }
    }
}

impl From<TagPort> for String {
    fn from(port: TagPort) -> String {
        match port {
            TagPort::Auto => "auto".into(),
            TagPort::Device(path) => path.display().to_string(),
        }
    }
}

impl TagConfig {
    fn port_and_protocol(&self, key: &str, problems: &mut Problems) {
        if let TagPort::Device(path) = &self.port {
            if path.as_os_str().is_empty() {
                problems
                    .say(format!("{key}.port = \"\": write \"auto\" or the path of the device"));
            }
        } else if self.protocol == TagProtocol::Mavlink {
            problems.say(format!(
                "{key}.protocol = \"mavlink\": such a tag is not found by itself; name its device in \
                 {key}.port"
            ));
        }
    }
}

haltere_core::keys! {
    /// `[board]`: the inner-loop board.
    pub struct BoardConfig {
        /// The inner-loop board: serial:DEVICE:BAUD, udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT or
        /// tcpout:HOST:PORT; a Crazyflie: radio:0/80/2M/E7E7E7E7E7, crtpusb:auto, crtpudp:HOST:PORT.
        address: Address = Address::Serial { device: "/dev/serial0".into(), baud: 921_600 };
        /// What the board is: "auto" (as its heartbeat says), "px4" (commanded in OFFBOARD), "ardupilot" (in
        /// GUIDED_NOGPS), "generic" (arms on command, obeys SET_ATTITUDE_TARGET while armed; nothing is checked),
        /// "crazyflie" (or a Flapper's own board, over CRTP: docs/CRAZYFLIE.md).
        /// docs/BOARDS.md says what is checked of each and what you have to set.
        profile: BoardProfile = BoardProfile::default();
        /// Whether parameters of the board that forbid arming are set, and read back. false: they are named, with the
        /// value they need.
        set_parameters: bool = false;
        /// Angle from room north (x of the survey turned to NED) to the board's north at start, positive clockwise seen
        /// from above. It is estimated from then on.
        north_offset_deg: f64 = 0.0, [-180.0..=180.0, "deg"];
        /// Signatures, as in `[ground]`: "off", "accept" or "require". The board must hold the same key.
        signing: Signing = Signing::default();
    }
}

haltere_core::keys! {
    /// `[anchors]`: the survey.
    pub struct AnchorsConfig {
        /// The anchor survey, relative to this file. anchors.toml beside this sample shows the form.
        file: PathBuf = "anchors.toml".into();
    }
}

haltere_core::keys! {
    /// `[record]`: flight logs.
    pub struct RecordConfig {
        /// Whether flights are recorded.
        enabled: bool = true;
        /// Where logs go, relative to the working directory. Names are YYYYMMDD-HHMMSS-NN.mcap, in UTC.
        directory: PathBuf = "logs".into();
        /// While nobody flies, recording stops when less than this is free there: what is left is kept for flights; of
        /// a small disk a tenth at most. A flight is recorded down to the last 200 MB.
        reserve_gb: f64 = 1.0, [0.0..=MOST_GB, "GB"];
        /// What logs may take together before those go that hold neither a flight nor a mission or
        /// program that a station sent: the oldest first, closed ones of this recorder only, none younger than a day.
        /// Left out: nothing is ever removed.
        budget_gb: Option<f64> = None, [0.0..=MOST_GB, "GB"], {"20.0"};
        /// A log that is longer than this is closed while nobody flies, and followed by another one (docs/INTERFACES.md,
        /// section 5). A flight is never cut. 0: never. 1000 MB are over an hour on the bench, and leave 3 GB for a
        /// flight on FAT32.
        // Over an hour on the bench; the 4 GB of a FAT32 card leave room for hours of flight behind it.
        rotate_mb: f64 = 1000.0, [0.0..=MOST_GB * 1e3, "MB"];
    }
}

/// Larger disks than any companion has.
const MOST_GB: f64 = 100_000.0;

haltere_core::keys! {
    /// `[store]`: what is kept over a restart.
    pub struct StoreConfig {
        /// Where parameters, missions, fences and rally points that a ground station sets are kept, relative to the
        /// working directory. Mission files for stations lie in its folder "missions". "": nothing is kept.
        directory: PathBuf = "state".into();
    }
}

impl StoreConfig {
    /// Whether anything is kept.
    pub fn is_on(&self) -> bool {
        !self.directory.as_os_str().is_empty()
    }
}

haltere_core::keys! {
    /// `[timing]`: how hard the companion insists on its deadlines.
    pub struct TimingConfig {
        /// Run the pilot's thread under SCHED_FIFO where the system permits it (CAP_SYS_NICE, or rtprio in
        /// limits.conf). Without it a loaded computer is late by up to 35 ms.
        realtime: bool = true;
        /// Its priority there.
        // 99 belongs to the kernel's own watchdogs.
        priority: u8 = 50, [1.0..=98.0];
        /// Keep all memory resident (mlockall) where the system permits it.
        lock_memory: bool = true;
    }
}

impl NoNumber for TagPort {}
