//! What the board says that is not so: a heartbeat, a pack that it does not fly on, its heading.

use haltere_dialect::mav::haltere::{
    BATTERY_STATUS_DATA, HEARTBEAT_DATA, MavBatteryFunction, MavMessage, MavModeFlag,
};

use nalgebra::{Matrix3, UnitQuaternion};

use crate::board::Board;

/// Lies in force.
#[derive(Debug, Clone, Default)]
pub(super) struct Lies {
    /// Heartbeats that still say disarmed.
    beats: u32,
    /// Voltage of a second pack, V.
    second_pack_v: Option<f64>,
    heading_off_rad: f64,
    /// What is said of the attitude is turned by this, body frame.
    turn: Option<UnitQuaternion<f64>>,
}

impl Lies {
    /// What its north is off by, rad: a heading that reads too far clockwise is a north that lies as far to the
    /// other side.
    pub fn heading_off_rad(&self) -> f64 {
        -self.heading_off_rad
    }
}

/// Id of the second pack.
const SECOND_PACK: u8 = 1;

impl Board {
    /// So many heartbeats say that it is disarmed, the first one at once.
    pub fn lie_disarmed(&mut self, beats: u32) {
        self.lies.beats = beats;
        self.streams.beat_now();
    }

    /// Tells a second pack of this voltage as well, V; `None`: no more.
    pub fn tell_second_pack(&mut self, volt: Option<f64>) {
        self.lies.second_pack_v = volt;
    }

    /// Its heading is off by this, clockwise, rad.
    pub fn turn_heading(&mut self, angle_rad: f64) {
        self.lies.heading_off_rad = angle_rad;
    }

    /// Says an attitude that is turned by this, in the body frame.
    pub fn turn_attitude(&mut self, matrix: &[[f64; 3]; 3]) {
        let rows = Matrix3::from_fn(|i, j| matrix[i][j]);
        self.lies.turn = (rows != Matrix3::identity()).then(|| UnitQuaternion::from_matrix(&rows));
    }

    /// The attitude as it is said.
    pub(super) fn said_attitude(&self) -> UnitQuaternion<f64> {
        self.lies.turn.map_or(self.believed, |turn| self.believed * turn)
    }

    /// The heartbeat as it is said.
    pub(super) fn said_beat(&mut self, beat: HEARTBEAT_DATA) -> HEARTBEAT_DATA {
        if self.lies.beats == 0 {
            return beat;
        }
        self.lies.beats -= 1;
        let base_mode = beat.base_mode - MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        HEARTBEAT_DATA { base_mode, ..beat }
    }

    /// What is said of the second pack, in the form of the first one: that of the avionics.
    pub(super) fn second_pack(&self, first: &MavMessage) -> Option<MavMessage> {
        let MavMessage::BATTERY_STATUS(first) = first else { return None };
        let mut voltages = [u16::MAX; 10];
        voltages[0] = (self.lies.second_pack_v? * 1000.0).clamp(0.0, 65534.0) as u16; // mV
        Some(MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
            id: SECOND_PACK,
            battery_function: MavBatteryFunction::MAV_BATTERY_FUNCTION_AVIONICS as u8,
            voltages,
            current_battery: -1,
            battery_remaining: -1,
            ..first.clone()
        }))
    }
}
