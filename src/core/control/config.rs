//! Configuration of the controller: version, switches, limits, trims; its parts check themselves.

use serde::{Deserialize, Serialize};

use crate::checks::Problems;
use crate::choices;
use crate::control::drag::{DragConfig, TESTED_LEAN_DEG};
use crate::control::gains::ControlGains;
use crate::control::ground::GroundConfig;
use crate::control::voltage::VoltageConfig;
use crate::keys::{BY_VERSION, Kind, Value};

/// The two versions of the source, and what became of the second here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Version {
    /// The source's working implementation: PID, constant base thrust, and a filter of IMU and UWB with constant noise.
    Raw,
    /// Every enhancement of the source, and what was added to them here.
    #[default]
    Modified,
    /// The source's modified version as printed, and nothing else: of [`Self::Raw`] the UWB noise varies with height, drag
    /// is fed forward as it comes, base thrust follows the battery, and the floor is corrected for.
    Paper,
}

/// How thrust answers to tilt.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TiltCompensation {
    /// Not at all.
    Off,
    /// By 1/(cos roll · cos pitch): right while standing still, too much in steady flight, where
    /// drag acts along the tilted body axes and carries a part of the weight.
    Geometric,
    /// The same, less what drag carries at the estimated velocity (law of `control.drag`).
    DragAware,
}

crate::keys! {
    /// Configuration of the controller, key `control`.
    pub struct ControlConfig {
        /// Controller and filter: the source's without its enhancements, as printed (paper), or ours.
        ///
        /// It decides every switch below that is not set. raw and paper also leave out the board's vertical and the
        /// barometer, and paper the time constants of `[control.drag]`, whatever is said of them.
        version: Version = Version::Modified, CTL_VERSION(47, Restart);
        /// Drag feed-forward.
        ///
        /// Set to switch it alone, whatever the version.
        drag_feed_forward: Option<bool> = None, {"true"}, CTL_DRAG_FF(48, OnFloor);
        /// Base thrust over battery voltage.
        ///
        /// Set to switch it alone, whatever the version.
        voltage_base_thrust: Option<bool> = None, {"true"}, CTL_VOLT_BASE(49, OnFloor);
        /// Ground-effect correction.
        ///
        /// Set to switch it alone, whatever the version.
        ground_correction: Option<bool> = None, {"true"}, CTL_GND_CORR(50, OnFloor);
        /// How thrust answers to tilt.
        ///
        /// Not set: drag_aware in modified, else off.
        tilt_compensation: Option<TiltCompensation> = None, {"\"drag_aware\""}, CTL_TILT_COMP(51, OnFloor);
        /// Drag term in the filter's prediction.
        ///
        /// Set to switch it alone, whatever the version.
        filter_drag: Option<bool> = None, {"true"}, CTL_FLT_DRAG(52, Restart);
        /// UWB noise that depends on height.
        ///
        /// Set to switch it alone, whatever the version.
        variable_uwb_noise: Option<bool> = None, {"true"}, CTL_VAR_UWB(53, Restart);
        /// Errors of the UWB learned by anchor in flight.
        ///
        /// One set for all rooms in place of what `[estimator]` says of them by default. Set to switch it alone, whatever
        /// the version.
        // What `[estimator]` says of them otherwise than by default stays.
        learned_uwb_errors: Option<bool> = None, {"true"}, CTL_LEARN_UWB(54, Restart);
        /// How fast an output fades to the law's own after a switch: time constant.
        // One time constant of the closed velocity loop.
        switch_fade_s: f64 = 0.3, [0.0..=5.0, "s"], CTL_FADE_T(55, AtOnce);
    } sections {
        /// Limits of setpoints and outputs.
        limits: LimitsConfig;
        /// Trims of the servos.
        trims: TrimConfig;
        /// Gains of the loops, the same in both versions.
        gains: ControlGains;
        /// Drag feed-forward.
        drag: DragConfig;
        /// Base thrust over battery voltage.
        voltage: VoltageConfig;
        /// Ground-effect correction.
        ground: GroundConfig;
    }
}

crate::keys! {
    /// Limits, key `control.limits`. Defaults: public firmware of the vehicle, except tilt and vertical
    /// speed.
    #[derive(Copy)]
    pub struct LimitsConfig {
        /// Horizontal speed setpoint, as a vector.
        horizontal_mps: f64 = 2.0, [0.1..=4.0, "m/s"], CLM_HOR_SPD(56, AtOnce);
        /// Vertical speed setpoint, up and down.
        // Firmware 1; the step tests of 2 m spend most of their time at that limit, and thrust (0.48 to 1.43 of the
        // weight) brakes from 2 within 0.4 m.
        vertical_mps: f64 = 2.0, [0.1..=3.0, "m/s"], CLM_VER_SPD(57, AtOnce);
        /// Lean from the vertical, roll and pitch as a vector, trims not counted.
        ///
        /// With 30 deg, drag of 4.2 1/s allows 1.35 m/s forward; 2 m/s need 41, and the source tested to 52 deg.
        tilt_deg: f64 = 45.0, [5.0..=TESTED_LEAN_DEG, "deg"], CLM_TILT(58, OnFloor);
        /// Largest lean the integrators may hold, per axis.
        // Enough to hold 1 m/s against drag without feed-forward (23 deg).
        lean_integral_deg: f64 = 25.0, [0.0..=45.0, "deg"],
            CLM_LEAN_INT(59, OnFloor, "Largest lean the integrators may hold, per axis. At most CLM_TILT.");
        /// Least thrust in flight, 0 to 1.
        // 20000 and 60000 of 65535 counts.
        thrust_min_frac: f64 = 0.305, [0.0..=0.5], CLM_THR_MIN(60, OnFloor);
        /// Most thrust in flight, 0 to 1.
        thrust_max_frac: f64 = 0.916, [0.5..=1.0], CLM_THR_MAX(61, OnFloor);
        /// Largest thrust the integrator may hold, either sign, 0 to 1.
        // Constant base thrust is 0.11 short at 6.3 V and 0.08 over at 8.4 V; twice that.
        thrust_integral_frac: f64 = 0.25, [0.0..=0.5], CLM_THR_INT(62, OnFloor);
        /// Largest climb or sink rate the position integrator may hold.
        vertical_integral_mps: f64 = 0.3, [0.0..=1.0, "m/s"], CLM_VER_INT(63, OnFloor);
        /// Rate at which the yaw setpoint follows the command.
        yaw_rate_degps: f64 = 60.0, [1.0..=360.0, "deg/s"], CLM_YAW_RATE(64, AtOnce);
        /// Largest factor on thrust from tilt compensation; its inverse is the smallest.
        // 1/cos 37 deg: more than the default tilt limit asks for.
        tilt_compensation_max_frac: f64 = 1.25, [1.0..=1.7], CLM_TILT_FACT(65, OnFloor);
    } rules joined;
}

crate::keys! {
    /// Trims of the servos, key `control.trims`: added to the attitude setpoint, so that level flight
    /// is level. `haltere fit trims` finds them from a hover log.
    #[derive(Copy)]
    pub struct TrimConfig {
        /// Added to the roll setpoint.
        roll_deg: f64 = 0.0, [-MAX_TRIM_DEG..=MAX_TRIM_DEG, "deg"], TRM_ROLL(66, AtOnce);
        /// Added to the pitch setpoint.
        pitch_deg: f64 = 0.0, [-MAX_TRIM_DEG..=MAX_TRIM_DEG, "deg"], TRM_PITCH(67, AtOnce);
        /// Added to the yaw setpoint.
        yaw_deg: f64 = 0.0, [-MAX_YAW_TRIM_DEG..=MAX_YAW_TRIM_DEG, "deg"], TRM_YAW(68, OnFloor);
    }
}

/// Largest trim in roll and pitch, deg: more is a vehicle to mend, not to trim (the pitch servo
/// moves 18 deg in all).
pub const MAX_TRIM_DEG: f64 = 10.0;
/// Largest trim in yaw, deg: half of what the yaw servo moves, rounded down.
pub const MAX_YAW_TRIM_DEG: f64 = 20.0;

/// Which enhancements are in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Enhancements {
    /// Drag feed-forward.
    pub drag_feed_forward: bool,
    /// Base thrust follows the battery voltage.
    pub voltage_base_thrust: bool,
    /// Ground-effect correction.
    pub ground_correction: bool,
    /// Answer of thrust to tilt.
    pub tilt_compensation: TiltCompensation,
    /// Drag term in the filter's prediction.
    pub filter_drag: bool,
    /// UWB noise that depends on height.
    pub variable_uwb_noise: bool,
    /// Errors of the UWB learned by anchor.
    pub learned_uwb_errors: bool,
    /// More than IMU and UWB in the filter, where it is told to fuse it: the board's vertical, the barometer.
    pub filter_aids: bool,
}

/// Share of the fastest speed that is asked of the vehicle for long: with the rest the position loop catches the point up.
const SUSTAINED_SHARE: f64 = 0.9;

impl ControlConfig {
    /// Horizontal speed that the limits on speed and lean let the vehicle keep up along a leg, whichever way it faces, m/s.
    pub fn sustained_mps(&self) -> f64 {
        let limits = &self.limits;
        let by_lean_mps = self.drag.speed_mps(0, limits.tilt_deg.to_radians());
        SUSTAINED_SHARE * limits.horizontal_mps.min(by_lean_mps)
    }

    /// Which enhancements version and switches leave on.
    pub fn enhancements(&self) -> Enhancements {
        let printed = self.version != Version::Raw;
        let ours = self.version == Version::Modified;
        let tilt = if ours { TiltCompensation::DragAware } else { TiltCompensation::Off };
        Enhancements {
            drag_feed_forward: self.drag_feed_forward.unwrap_or(printed),
            voltage_base_thrust: self.voltage_base_thrust.unwrap_or(printed),
            ground_correction: self.ground_correction.unwrap_or(printed),
            variable_uwb_noise: self.variable_uwb_noise.unwrap_or(printed),
            tilt_compensation: self.tilt_compensation.unwrap_or(tilt),
            filter_drag: self.filter_drag.unwrap_or(ours),
            learned_uwb_errors: self.learned_uwb_errors.unwrap_or(ours),
            filter_aids: ours,
        }
    }

    /// Time constants of the velocity that is fed forward and of the one that integrators expect of it, s: the source has none.
    pub fn feed_forward_s(&self) -> [f64; 2] {
        let DragConfig { filter_s, integral_reference_s, .. } = self.drag;
        if self.version == Version::Paper { [0.0; 2] } else { [filter_s, integral_reference_s] }
    }
}

impl LimitsConfig {
    fn joined(&self, key: &str, problems: &mut Problems) {
        if self.lean_integral_deg > self.tilt_deg {
            problems.say(format!(
                "{key}.lean_integral_deg = {} exceeds {key}.tilt_deg = {}: an integrator that \
                 fills the whole limit leaves nothing to brake with",
                self.lean_integral_deg, self.tilt_deg
            ));
        }
    }
}

choices!(Version: Raw "raw", Modified "modified", Paper "paper");

impl Value for Option<TiltCompensation> {
    fn kind() -> Kind {
        Kind::Choice(&[
            (-1, "as the version has it"),
            (0, "off"),
            (1, "geometric"),
            (2, "drag aware"),
        ])
    }

    fn number(&self, part: usize, low: f64) -> f64 {
        self.map_or(BY_VERSION, |tilt| tilt.number(part, low))
    }

    fn set(&mut self, part: usize, number: f64, low: f64) {
        *self = (number >= 0.0).then(|| {
            let mut tilt = TiltCompensation::Off;
            tilt.set(part, number, low);
            tilt
        });
    }
}
choices!(TiltCompensation: Off "off", Geometric "geometric", DragAware "drag aware");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_defaults_pass_and_survive_toml() {
        let config = ControlConfig::default();
        let mut problems = Problems::new();
        config.check("control", &mut problems);
        assert!(problems.is_empty(), "{problems}");
        let text = toml::to_string(&config).expect("writes");
        assert_eq!(toml::from_str::<ControlConfig>(&text).expect("reads"), config);
    }

    #[test]
    fn prop_part_of_a_table_keeps_the_other_defaults_but_unknown_keys_are_refused() {
        let config: ControlConfig = toml::from_str(
            "version = \"raw\"\nground_correction = true\n[gains]\npos_x_p_per_s = 2.0\n",
        )
        .expect("reads");
        assert_eq!(config.gains.pos_x_p_per_s, 2.0);
        assert_eq!(config.gains.pos_y_p_per_s, ControlGains::default().pos_y_p_per_s);
        for unknown in [
            "speed = 1",
            "[limits]\ntilt = 1",
            "[gains]\nkp = 1",
            "[drag]\nk = 1",
            "[drag.pitch]\na_deg = -90.0\nb_deg = 90.0\nc_s_per_m = 0.3\nd = 1",
            "[voltage]\nx = 1",
            "[ground]\na = 0.2",
            "[trims]\nroll = 1",
            "version = \"printed\"",
        ] {
            assert!(toml::from_str::<ControlConfig>(unknown).is_err(), "{unknown}");
        }
    }

    #[test]
    fn prop_each_enhancement_switches_alone() {
        let raw = ControlConfig { version: Version::Raw, ..Default::default() };
        let none = raw.enhancements();
        assert!(
            !none.drag_feed_forward && !none.voltage_base_thrust && !none.ground_correction,
            "{none:?}"
        );
        let one = ControlConfig { voltage_base_thrust: Some(true), ..raw }.enhancements();
        assert_eq!(one, Enhancements { voltage_base_thrust: true, ..none });
        let all = ControlConfig::default().enhancements();
        let less = ControlConfig { drag_feed_forward: Some(false), ..Default::default() };
        assert_eq!(less.enhancements(), Enhancements { drag_feed_forward: false, ..all });
        let paper = ControlConfig { version: Version::Paper, ..Default::default() };
        let printed = Enhancements {
            drag_feed_forward: true,
            voltage_base_thrust: true,
            ground_correction: true,
            variable_uwb_noise: true,
            ..none
        };
        assert_eq!((paper.enhancements(), paper.feed_forward_s()), (printed, [0.0; 2]));
    }

    #[test]
    fn prop_every_bad_value_is_named() {
        let config = ControlConfig {
            limits: LimitsConfig {
                tilt_deg: 60.0,
                thrust_min_frac: f64::NAN,
                lean_integral_deg: 44.0,
                ..Default::default()
            },
            trims: TrimConfig { roll_deg: -11.0, ..Default::default() },
            switch_fade_s: -1.0,
            ..Default::default()
        };
        let mut problems = Problems::new();
        config.check("control", &mut problems);
        let said = problems.to_string();
        for key in ["limits.tilt_deg", "limits.thrust_min_frac", "trims.roll_deg", "switch_fade_s"]
        {
            assert!(said.contains(&format!("control.{key} = ")), "{said}");
        }
    }
}
