//! The sections that concern links, files and timing.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::address::Address;
use crate::config::{BoardProfile, TagProtocol};
use crate::stations::guard::Signing;
use haltere_core::checks::Problems;

/// `[tag]`: the UWB tag.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TagConfig {
    /// Device of the tag, or `auto`.
    pub port: TagPort,
    /// What the tag speaks.
    pub protocol: TagProtocol,
    /// Speed of the line, baud. A sniffer on USB ignores it.
    pub baud: u32,
    /// What is demanded of signatures.
    pub signing: Signing,
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

impl Default for TagConfig {
    fn default() -> Self {
        Self {
            port: TagPort::Auto,
            protocol: TagProtocol::default(),
            baud: 921_600,
            signing: Signing::default(),
        }
    }
}

impl TagConfig {
    pub(super) fn check(&self, key: &str, problems: &mut Problems) {
        problems.range(
            format_args!("{key}.baud"),
            f64::from(self.baud),
            9_600.0..=12_000_000.0,
            "baud",
        );
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

/// `[board]`: the inner-loop board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BoardConfig {
    /// Where it is.
    pub address: Address,
    /// What it obeys.
    pub profile: BoardProfile,
    /// Whether parameters of the board that are wrong for us may be set.
    pub set_parameters: bool,
    /// Angle from room north to the board's north at start, positive clockwise from above.
    pub north_offset_deg: f64,
    /// What is demanded of signatures.
    pub signing: Signing,
}

impl Default for BoardConfig {
    fn default() -> Self {
        Self {
            address: Address::Serial { device: "/dev/serial0".into(), baud: 921_600 },
            profile: BoardProfile::default(),
            set_parameters: false,
            north_offset_deg: 0.0,
            signing: Signing::default(),
        }
    }
}

impl BoardConfig {
    pub(super) fn check(&self, key: &str, problems: &mut Problems) {
        problems.range(
            format_args!("{key}.north_offset_deg"),
            self.north_offset_deg,
            -180.0..=180.0,
            "deg",
        );
    }
}

/// `[anchors]`: the survey.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AnchorsConfig {
    /// The anchor file, relative to the configuration file that names it.
    pub file: PathBuf,
}

impl Default for AnchorsConfig {
    fn default() -> Self {
        Self { file: "anchors.toml".into() }
    }
}

/// `[record]`: flight logs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecordConfig {
    /// Whether flights are recorded.
    pub enabled: bool,
    /// Where logs go, relative to the working directory.
    pub directory: PathBuf,
    /// Room that is kept for flights while nobody flies, GB.
    pub reserve_gb: f64,
    /// What logs may take together, GB, before those that hold neither a flight nor a program are removed. `None`:
    /// nothing is ever removed.
    pub budget_gb: Option<f64>,
    /// A log that is longer, MB, is followed by another one when nobody flies. 0: never.
    pub rotate_mb: f64,
}

impl Default for RecordConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            directory: "logs".into(),
            reserve_gb: 1.0,
            budget_gb: None,
            // Over an hour on the bench; the 4 GB of a FAT32 card leave room for hours of flight behind it.
            rotate_mb: 1000.0,
        }
    }
}

impl RecordConfig {
    pub(super) fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value| {
            problems.range(format_args!("{key}.{name}"), value, 0.0..=MOST_GB, "GB");
        };
        range("reserve_gb", self.reserve_gb);
        if let Some(budget_gb) = self.budget_gb {
            range("budget_gb", budget_gb);
        }
        problems.range(format_args!("{key}.rotate_mb"), self.rotate_mb, 0.0..=MOST_GB * 1e3, "MB");
    }
}

/// Larger disks than any companion has.
const MOST_GB: f64 = 100_000.0;

/// `[store]`: what is kept over a restart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StoreConfig {
    /// Folder of parameters, mission, fence, rally points and mission files, relative to the working
    /// directory. Empty: nothing is kept.
    pub directory: PathBuf,
}

impl Default for StoreConfig {
    fn default() -> Self {
        Self { directory: "state".into() }
    }
}

impl StoreConfig {
    /// Whether anything is kept.
    pub fn is_on(&self) -> bool {
        !self.directory.as_os_str().is_empty()
    }
}

/// `[timing]`: how hard the companion insists on its deadlines.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TimingConfig {
    /// Run the pilot's thread under SCHED_FIFO where the system permits it.
    pub realtime: bool,
    /// Its priority there.
    pub priority: u8,
    /// Keep all memory resident where the system permits it.
    pub lock_memory: bool,
}

impl Default for TimingConfig {
    fn default() -> Self {
        Self { realtime: true, priority: 50, lock_memory: true }
    }
}

impl TimingConfig {
    pub(super) fn check(&self, key: &str, problems: &mut Problems) {
        // 99 belongs to the kernel's own watchdogs.
        problems.range(format_args!("{key}.priority"), f64::from(self.priority), 1.0..=98.0, "");
    }
}
