//! Which firmware the board plays, and which of its unkind manners are on.
//!
//! Each was seen on the wire of the real thing (docs/BOARDS.md) or is what a careless set-up of it does.
//! What a firmware does by nature (modes, parameters, silent drops) has no switch.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use haltere_core::checks::Problems;

/// A firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Firmware {
    /// `generic` of INTERFACES.md section 2.
    #[default]
    Generic,
    /// PX4, obeying in OFFBOARD.
    Px4,
    /// ArduPilot's copter, obeying in GUIDED_NOGPS.
    Ardupilot,
    /// A Crazyflie with a Loco deck, over CRTP.
    Crazyflie,
}

/// Manners that a board of either real firmware can have. Off by default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Manners {
    /// For so long after its boot it refuses to arm, s, with changing reasons (ArduPilot: 20 seen).
    pub settling_s: f64,
    /// So long after its boot the mode switch of a remote control overrides the mode, s. 0: never.
    pub mode_override_s: f64,
    /// HIGHRES_IMU is not known, only RAW_IMU and SCALED_IMU in whole milli-g and mrad/s.
    pub no_highres_imu: bool,
    /// Fastest rate that is granted, Hz; others are refused. 0: the firmware's own.
    pub fastest_hz: f64,
    /// Streams come with only every so-manieth message of what was granted. 1: all.
    pub decimation: u32,
    /// Every third echo of a parameter that was set does not come.
    pub lost_echoes: bool,
    /// Thrust of setpoints is taken and not passed on, whatever the heartbeat says.
    pub no_thrust: bool,
    /// Speed of its serial line, baud, both ways. 0: no limit.
    pub baud: u32,
}

impl Default for Manners {
    fn default() -> Self {
        Self {
            settling_s: 0.0,
            mode_override_s: 0.0,
            no_highres_imu: false,
            fastest_hz: 0.0,
            decimation: 1,
            lost_echoes: false,
            no_thrust: false,
            baud: 0,
        }
    }
}

impl Manners {
    pub(super) fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value: f64, low: f64, high: f64, unit: &str| {
            problems.range(format_args!("{key}.{name}"), value, low..=high, unit);
        };
        range("settling_s", self.settling_s, 0.0, 600.0, "s");
        range("mode_override_s", self.mode_override_s, 0.0, 600.0, "s");
        range("fastest_hz", self.fastest_hz, 0.0, 1000.0, "Hz");
        range("decimation", f64::from(self.decimation), 1.0, 100.0, "");
        range("baud", f64::from(self.baud), 0.0, 12_000_000.0, "baud");
    }
}

/// Parameters that are not the firmware's defaults, by name.
pub type Overrides = BTreeMap<String, f64>;
