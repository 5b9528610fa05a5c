//! What a board's firmware is like: how it is recognised, in which mode it obeys, what it streams.
//!
//! All numbers were seen on the wire of ArduCopter 4.8.0-dev and PX4 1.17.0 in software-in-the-loop
//! or read in their sources (docs/BOARDS.md says which).

use crate::config::BoardProfile;

/// `MAV_AUTOPILOT` of the two firmwares (common.xml).
const AUTOPILOT_ARDUPILOT: u8 = 3;
const AUTOPILOT_PX4: u8 = 12;

/// A firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Firmware {
    /// Obeys setpoints while it is armed; no modes, no parameters.
    Generic,
    /// PX4, commanded in OFFBOARD.
    Px4,
    /// ArduPilot's copter, commanded in GUIDED_NOGPS.
    ArduPilot,
    /// A Crazyflie over CRTP; obeys whenever it may fly.
    Crazyflie,
}

/// The mode in which a board obeys our setpoints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ControlMode {
    /// Name for people.
    pub name: &'static str,
    /// Bits of `HEARTBEAT.custom_mode` that tell, and what they are then.
    pub mask: u32,
    pub value: u32,
    /// Second and third parameter of MAV_CMD_DO_SET_MODE.
    pub command: [f32; 2],
    /// The board is asked again after this time, s: its heartbeat must have had time to agree.
    pub ask_again_s: f64,
    /// Another mode in the heartbeat for so long means that control is lost, s. PX4's heartbeat comes
    /// at 1 Hz and after a gap in the stream it returns by itself; ArduPilot's comes at 10 Hz and it
    /// never does.
    pub grace_s: f64,
}

/// GUIDED_NOGPS.
const ARDUPILOT_MODE: ControlMode = ControlMode {
    name: "GUIDED_NOGPS",
    mask: u32::MAX,
    value: 20,
    command: [20.0, 0.0],
    ask_again_s: 1.0,
    grace_s: 0.35,
};
/// OFFBOARD: main mode 6 in bits 16 to 23.
const PX4_MODE: ControlMode = ControlMode {
    name: "OFFBOARD",
    mask: 0x00FF_0000,
    value: 6 << 16,
    command: [6.0, 0.0],
    ask_again_s: 1.5,
    grace_s: 2.5,
};

impl Firmware {
    /// By `HEARTBEAT.autopilot`.
    pub fn from_autopilot(autopilot: u8) -> Self {
        match autopilot {
            AUTOPILOT_ARDUPILOT => Firmware::ArduPilot,
            AUTOPILOT_PX4 => Firmware::Px4,
            _ => Firmware::Generic,
        }
    }

    /// What is flown with: as configured, else as recognised.
    pub fn in_force(profile: BoardProfile, autopilot: u8) -> Self {
        match profile {
            BoardProfile::Auto => Self::from_autopilot(autopilot),
            BoardProfile::Generic => Firmware::Generic,
            BoardProfile::Px4 => Firmware::Px4,
            BoardProfile::Ardupilot => Firmware::ArduPilot,
            BoardProfile::Crazyflie => Firmware::Crazyflie,
        }
    }

    /// Name in texts; the same as the profile's.
    pub fn name(self) -> &'static str {
        match self {
            Firmware::Generic => "generic",
            Firmware::Px4 => "px4",
            Firmware::ArduPilot => "ardupilot",
            Firmware::Crazyflie => "crazyflie",
        }
    }

    /// The mode in which it obeys. `None`: whenever it is armed.
    pub fn control_mode(self) -> Option<&'static ControlMode> {
        match self {
            Firmware::Generic | Firmware::Crazyflie => None,
            Firmware::Px4 => Some(&PX4_MODE),
            Firmware::ArduPilot => Some(&ARDUPILOT_MODE),
        }
    }

    /// Whether it has parameters that must be right, a capability word and an attitude target.
    pub fn is_real(self) -> bool {
        self != Firmware::Generic
    }

    /// Setpoints must have streamed for this long before the mode is asked for, s. PX4 wants 1 s
    /// (documentation); twice that was flown.
    pub fn stream_first_s(self) -> f64 {
        if self == Firmware::Px4 { 2.0 } else { 0.0 }
    }

    /// Time that the motors spool up in after the first thrust (ArduPilot, MOT_SPOOL_TIME 0.5 s) or
    /// after arming (PX4, COM_SPOOLUP_TIME 1 s), s. Unless its parameter is known.
    pub fn spool_s(self) -> f64 {
        match self {
            Firmware::Generic | Firmware::Crazyflie => 0.0,
            Firmware::Px4 => 1.0,
            Firmware::ArduPilot => 0.5,
        }
    }

    /// Time for which motors stay off after arming, before they spool up, s. Seen with ArduCopter 4.6.3, whose source
    /// says 2 s and no parameter changes it.
    pub fn held_after_arming_s(self) -> f64 {
        if self == Firmware::ArduPilot { 2.0 } else { 0.0 }
    }

    /// How long the last setpoint is held when no other comes, s (INTERFACES.md section 2; for the real ones what
    /// `rules` sets). Unless its parameter is known.
    pub fn gives_up_s(self) -> f64 {
        if self == Firmware::Px4 { 0.3 } else { 0.5 }
    }

    /// How long arming is asked for again after refusals, s: 23 s after its start were seen until an
    /// ArduPilot's sensors had settled. Zero: a refusal is final.
    pub fn arming_patience_s(self) -> f64 {
        if self.is_real() { 30.0 } else { 0.0 }
    }

    /// Whether thrust of SET_ATTITUDE_TARGET reaches the motors of a vehicle of this `MAV_TYPE`. PX4
    /// passes it on to multirotors and helicopters only (seen: type 16, flapping wing, flew zero
    /// thrust without a word).
    pub fn passes_thrust_to(self, mavtype: u8) -> bool {
        // Quadrotor, coaxial, helicopter, hexarotor, octorotor, tricopter (common.xml, MAV_TYPE).
        self != Firmware::Px4 || matches!(mavtype, 2 | 3 | 4 | 13 | 14 | 15)
    }

    /// Name of a mode number for people.
    pub fn mode_name(self, custom_mode: u32) -> String {
        let known = match self {
            Firmware::Generic | Firmware::Crazyflie => None,
            Firmware::ArduPilot => match custom_mode {
                0 => Some("STABILIZE"),
                1 => Some("ACRO"),
                2 => Some("ALT_HOLD"),
                3 => Some("AUTO"),
                4 => Some("GUIDED"),
                5 => Some("LOITER"),
                6 => Some("RTL"),
                9 => Some("LAND"),
                16 => Some("POSHOLD"),
                17 => Some("BRAKE"),
                20 => Some("GUIDED_NOGPS"),
                21 => Some("SMART_RTL"),
                _ => None,
            },
            Firmware::Px4 => match (custom_mode >> 16 & 0xFF, custom_mode >> 24) {
                (1, _) => Some("MANUAL"),
                (2, _) => Some("ALTCTL"),
                (3, _) => Some("POSCTL"),
                (4, 2) => Some("TAKEOFF"),
                (4, 3) => Some("HOLD"),
                (4, 4) => Some("MISSION"),
                (4, 5) => Some("RETURN"),
                (4, 6) => Some("LAND"),
                (5, _) => Some("ACRO"),
                (6, _) => Some("OFFBOARD"),
                (7, _) => Some("STABILIZED"),
                _ => None,
            },
        };
        known.map_or_else(|| format!("mode {custom_mode}"), str::to_owned)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_modes_and_types_are_those_seen_on_the_wire() {
        let of = |firmware: Firmware, custom: u32| {
            firmware.control_mode().is_some_and(|m| custom & m.mask == m.value)
        };
        // BOARDS: OFFBOARD is 6/0, hold 4/3, return 4/5, land 4/6; GUIDED_NOGPS 20, LAND 9.
        assert!(of(Firmware::Px4, 6 << 16) && !of(Firmware::Px4, 4 << 16 | 6 << 24));
        assert!(of(Firmware::ArduPilot, 20) && !of(Firmware::ArduPilot, 9));
        assert_eq!(Firmware::Px4.mode_name(4 << 16 | 5 << 24), "RETURN");
        assert_eq!(Firmware::ArduPilot.mode_name(9), "LAND");
        assert_eq!(Firmware::Px4.mode_name(99 << 16), "mode 6488064");
        assert!(!Firmware::Px4.passes_thrust_to(16) && Firmware::Px4.passes_thrust_to(2));
        assert!(Firmware::ArduPilot.passes_thrust_to(16));
    }

    #[test]
    fn prop_recognised_unless_configured() {
        assert_eq!(Firmware::in_force(BoardProfile::Auto, 3), Firmware::ArduPilot);
        assert_eq!(Firmware::in_force(BoardProfile::Auto, 12), Firmware::Px4);
        assert_eq!(Firmware::in_force(BoardProfile::Auto, 0), Firmware::Generic);
        assert_eq!(Firmware::in_force(BoardProfile::Generic, 12), Firmware::Generic);
    }
}
