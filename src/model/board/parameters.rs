//! The board's parameters as both firmwares serve them: by name, one float field for every type.

use haltere_dialect::mav::haltere::{MavParamType, PARAM_VALUE_DATA};

use crate::board::firmware::{Firmware, Overrides};
use haltere_core::checks::Problems;

/// A parameter: name, default, whether it is an integer.
type Default = (&'static str, f64, bool);

/// Of ArduCopter 4.8: what a companion cares about, as the firmware ships, except GUID_OPTIONS, GUID_TIMEOUT,
/// ATC_ANGLE_BOOST and the watchdog, which are as docs/BOARDS.md wants them.
const ARDUPILOT: &[Default] = &[
    ("GUID_OPTIONS", 8.0, true),
    ("GUID_TIMEOUT", 0.5, false),
    ("FS_GCS_ENABLE", 5.0, true),
    ("FS_GCS_TIMEOUT", 2.0, false),
    ("MAV_GCS_SYSID", 1.0, true),
    ("FS_EKF_ACTION", 0.0, true),
    ("MOT_SPOOL_TIME", 0.5, false),
    ("ATC_ANGLE_BOOST", 0.0, true),
    ("DISARM_DELAY", 10.0, true),
    ("WP_SPD_UP", 2.5, false),
    ("WP_SPD_DN", 1.5, false),
];

/// Of PX4 1.17: the same, except the loss of setpoints and of remote control.
const PX4: &[Default] = &[
    ("COM_OF_LOSS_T", 0.3, false),
    ("COM_OBL_RC_ACT", 4.0, true),
    ("COM_RCL_EXCEPT", 4.0, true),
    ("NAV_DLL_ACT", 0.0, true),
    ("COM_SPOOLUP_TIME", 1.0, false),
    ("COM_DISARM_PRFLT", 10.0, false),
    ("MAV_TYPE", 2.0, true),
];

fn defaults(firmware: Firmware) -> &'static [Default] {
    match firmware {
        Firmware::Generic | Firmware::Crazyflie => &[],
        Firmware::Ardupilot => ARDUPILOT,
        Firmware::Px4 => PX4,
    }
}

#[derive(Debug, Clone)]
struct Entry {
    name: String,
    value: f64,
    whole: bool,
}

/// All of them.
#[derive(Debug, Clone)]
pub(super) struct Parameters {
    all: Vec<Entry>,
    bytewise: bool,
}

impl Parameters {
    /// The firmware's, with what the scenario changes. A name that is not the firmware's is another
    /// release's: `SYSID_MYGCS` replaces `MAV_GCS_SYSID`.
    pub fn new(firmware: Firmware, overrides: &Overrides) -> Self {
        let mut all: Vec<Entry> = defaults(firmware)
            .iter()
            .map(|(name, value, whole)| Entry {
                name: (*name).into(),
                value: *value,
                whole: *whole,
            })
            .collect();
        for (name, value) in overrides {
            match all.iter_mut().find(|e| e.name == *name) {
                Some(entry) => entry.value = *value,
                None => {
                    if name == "SYSID_MYGCS" {
                        all.retain(|e| e.name != "MAV_GCS_SYSID");
                    }
                    all.push(Entry { name: name.clone(), value: *value, whole: true });
                }
            }
        }
        Self { all, bytewise: firmware == Firmware::Px4 }
    }

    /// Says what no parameter can be.
    pub fn check(overrides: &Overrides, key: &str, problems: &mut Problems) {
        for (name, value) in overrides {
            if name.is_empty() || name.len() > 16 {
                problems.say(format!("{key}.{name}: names have 1 to 16 characters"));
            }
            problems.range(format_args!("{key}.{name}"), *value, -1e6..=1e6, "");
        }
    }

    /// Value of one that the board itself goes by.
    pub fn get(&self, name: &str) -> f64 {
        self.all.iter().find(|e| e.name == name).map_or(0.0, |e| e.value)
    }

    /// The system id whose heartbeat is watched.
    pub fn watched_system(&self) -> f64 {
        let of = |name| self.all.iter().find(|e| e.name == name).map(|e| e.value);
        of("MAV_GCS_SYSID").or(of("SYSID_MYGCS")).unwrap_or(0.0)
    }

    /// The message about one of them; `None`: no such name, and no answer.
    pub fn tell(&self, name: &[u8]) -> Option<PARAM_VALUE_DATA> {
        let index = self.all.iter().position(|e| e.name.as_bytes() == name)?;
        let entry = self.all.get(index)?;
        let (value, param_type) = match (entry.whole, self.bytewise) {
            (true, true) => {
                let bits = (entry.value as i32).cast_unsigned();
                (f32::from_bits(bits), MavParamType::MAV_PARAM_TYPE_INT32)
            }
            (true, false) => (entry.value as f32, MavParamType::MAV_PARAM_TYPE_INT32),
            (false, _) => (entry.value as f32, MavParamType::MAV_PARAM_TYPE_REAL32),
        };
        Some(PARAM_VALUE_DATA {
            param_value: value,
            param_count: self.all.len() as u16,
            param_index: index as u16,
            param_id: entry.name.as_str().into(),
            param_type: param_type as u8,
        })
    }

    /// Sets one. `false`: no such name, or no number.
    pub fn set(&mut self, name: &[u8], field: f32) -> bool {
        let bytewise = self.bytewise;
        let Some(entry) = self.all.iter_mut().find(|e| e.name.as_bytes() == name) else {
            return false;
        };
        let value = if entry.whole && bytewise {
            f64::from(field.to_bits().cast_signed())
        } else {
            f64::from(field)
        };
        if value.is_finite() {
            entry.value = value;
        }
        value.is_finite()
    }
}
