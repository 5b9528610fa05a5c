//! Configuration of the controller: version, switches, limits, trims; its parts check themselves.

use serde::{Deserialize, Serialize};

use crate::checks::Problems;
use crate::control::drag::{DragConfig, TESTED_LEAN_DEG};
use crate::control::gains::ControlGains;
use crate::control::ground::GroundConfig;
use crate::control::voltage::VoltageConfig;

/// The two versions of the source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Version {
    /// The cascade alone: no feed-forward, constant base thrust, no ground correction; in the
    /// filter constant UWB noise and no drag.
    Raw,
    /// The cascade with every enhancement.
    #[default]
    Modified,
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

/// Configuration of the controller, key `control`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ControlConfig {
    /// `raw` or `modified`; decides every switch below that is not set, and the two of the filter.
    pub version: Version,
    /// Drag feed-forward: set to switch it alone, whatever the version.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drag_feed_forward: Option<bool>,
    /// Base thrust over battery voltage: set to switch it alone, whatever the version.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub voltage_base_thrust: Option<bool>,
    /// Ground-effect correction: set to switch it alone, whatever the version.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground_correction: Option<bool>,
    /// `off`, `geometric` or `drag_aware`; not set: `off` in raw, `drag_aware` in modified.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tilt_compensation: Option<TiltCompensation>,
    /// Drag term in the filter's prediction: set to switch it alone, whatever the version.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub filter_drag: Option<bool>,
    /// UWB noise that depends on height: set to switch it alone, whatever the version.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variable_uwb_noise: Option<bool>,
    /// Errors of the UWB learned by anchor in flight, one set for all rooms: set to switch it alone, whatever the version.
    /// What `[estimator]` says of them otherwise than by default stays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub learned_uwb_errors: Option<bool>,
    /// How fast an output fades from its old value to the law's after a switch of a command axis
    /// between position and velocity, and after a handover: time constant. s
    pub switch_fade_s: f64,
    /// Limits of setpoints and outputs.
    pub limits: LimitsConfig,
    /// Trims of the servos.
    pub trims: TrimConfig,
    /// Gains of the loops, the same in both versions.
    pub gains: ControlGains,
    /// Drag feed-forward.
    pub drag: DragConfig,
    /// Base thrust over battery voltage.
    pub voltage: VoltageConfig,
    /// Ground-effect correction.
    pub ground: GroundConfig,
}

/// Limits, key `control.limits`. Defaults: public firmware of the vehicle, except tilt and vertical
/// speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LimitsConfig {
    /// Horizontal speed setpoint, as a vector. m/s
    pub horizontal_mps: f64,
    /// Vertical speed setpoint, up and down. Firmware 1; the step tests of 2 m spend most of their
    /// time at that limit, and thrust (0.48 to 1.43 of the weight) brakes from 2 within 0.4 m. m/s
    pub vertical_mps: f64,
    /// Lean from the vertical, roll and pitch as a vector, trims not counted. With firmware's 30,
    /// drag of 4.2 1/s allows 1.35 m/s forward; 2 m/s need 41, and the source tested to 52. deg
    pub tilt_deg: f64,
    /// Largest lean the integrators may hold, per axis. deg
    pub lean_integral_deg: f64,
    /// Least thrust in flight. frac
    pub thrust_min_frac: f64,
    /// Most thrust in flight. frac
    pub thrust_max_frac: f64,
    /// Largest thrust the integrator may hold, either sign. frac
    pub thrust_integral_frac: f64,
    /// Largest climb or sink rate the position integrator may hold. m/s
    pub vertical_integral_mps: f64,
    /// Rate at which the yaw setpoint follows the command. deg/s
    pub yaw_rate_degps: f64,
    /// Largest factor on thrust from tilt compensation; its inverse is the smallest. frac
    pub tilt_compensation_max_frac: f64,
}

impl Default for LimitsConfig {
    fn default() -> Self {
        Self {
            horizontal_mps: 2.0,
            vertical_mps: 2.0,
            tilt_deg: 45.0,
            // Enough to hold 1 m/s against drag without feed-forward (23 deg).
            lean_integral_deg: 25.0,
            // 20000 and 60000 of 65535 counts.
            thrust_min_frac: 0.305,
            thrust_max_frac: 0.916,
            // Constant base thrust is 0.11 short at 6.3 V and 0.08 over at 8.4 V; twice that.
            thrust_integral_frac: 0.25,
            vertical_integral_mps: 0.3,
            yaw_rate_degps: 60.0,
            // 1/cos 37 deg: more than the default tilt limit asks for.
            tilt_compensation_max_frac: 1.25,
        }
    }
}

/// Trims of the servos, key `control.trims`: added to the attitude setpoint, so that level flight
/// is level. `haltere fit trims` finds them from a hover log.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrimConfig {
    /// Added to the roll setpoint. deg
    pub roll_deg: f64,
    /// Added to the pitch setpoint. deg
    pub pitch_deg: f64,
    /// Added to the yaw setpoint. deg
    pub yaw_deg: f64,
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
}

impl Default for ControlConfig {
    fn default() -> Self {
        Self {
            version: Version::Modified,
            drag_feed_forward: None,
            voltage_base_thrust: None,
            ground_correction: None,
            tilt_compensation: None,
            filter_drag: None,
            variable_uwb_noise: None,
            learned_uwb_errors: None,
            // One time constant of the closed velocity loop.
            switch_fade_s: 0.3,
            limits: LimitsConfig::default(),
            trims: TrimConfig::default(),
            gains: ControlGains::default(),
            drag: DragConfig::default(),
            voltage: VoltageConfig::default(),
            ground: GroundConfig::default(),
        }
    }
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
        let on = self.version == Version::Modified;
        Enhancements {
            drag_feed_forward: self.drag_feed_forward.unwrap_or(on),
            voltage_base_thrust: self.voltage_base_thrust.unwrap_or(on),
            ground_correction: self.ground_correction.unwrap_or(on),
            tilt_compensation: self.tilt_compensation.unwrap_or(if on {
                TiltCompensation::DragAware
            } else {
                TiltCompensation::Off
            }),
            filter_drag: self.filter_drag.unwrap_or(on),
            variable_uwb_noise: self.variable_uwb_noise.unwrap_or(on),
            learned_uwb_errors: self.learned_uwb_errors.unwrap_or(on),
        }
    }

    /// Says what is wrong with the values under `key` (usually `control`).
    pub fn check(&self, key: &str, problems: &mut Problems) {
        problems.range(format!("{key}.switch_fade_s"), self.switch_fade_s, 0.0..=5.0, "s");
        self.limits.check(&format!("{key}.limits"), problems);
        self.trims.check(&format!("{key}.trims"), problems);
        self.gains.check(&format!("{key}.gains"), problems);
        self.drag.check(&format!("{key}.drag"), problems);
        self.voltage.check(&format!("{key}.voltage"), problems);
        self.ground.check(&format!("{key}.ground"), problems);
    }
}

impl LimitsConfig {
    /// Says what is wrong with the values under `key`.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value, allowed, unit| {
            problems.range(format!("{key}.{name}"), value, allowed, unit);
        };
        range("horizontal_mps", self.horizontal_mps, 0.1..=4.0, "m/s");
        range("vertical_mps", self.vertical_mps, 0.1..=3.0, "m/s");
        range("tilt_deg", self.tilt_deg, 5.0..=TESTED_LEAN_DEG, "deg");
        range("lean_integral_deg", self.lean_integral_deg, 0.0..=45.0, "deg");
        range("thrust_min_frac", self.thrust_min_frac, 0.0..=0.5, "");
        range("thrust_max_frac", self.thrust_max_frac, 0.5..=1.0, "");
        range("thrust_integral_frac", self.thrust_integral_frac, 0.0..=0.5, "");
        range("vertical_integral_mps", self.vertical_integral_mps, 0.0..=1.0, "m/s");
        range("yaw_rate_degps", self.yaw_rate_degps, 1.0..=360.0, "deg/s");
        range("tilt_compensation_max_frac", self.tilt_compensation_max_frac, 1.0..=1.7, "");
        if self.lean_integral_deg > self.tilt_deg {
            problems.say(format!(
                "{key}.lean_integral_deg = {} exceeds {key}.tilt_deg = {}: an integrator that \
                 fills the whole limit leaves nothing to brake with",
                self.lean_integral_deg, self.tilt_deg
            ));
        }
    }
}

impl TrimConfig {
    /// Says what is wrong with the values under `key`.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        let small = -MAX_TRIM_DEG..=MAX_TRIM_DEG;
        problems.range(format!("{key}.roll_deg"), self.roll_deg, small.clone(), "deg");
        problems.range(format!("{key}.pitch_deg"), self.pitch_deg, small, "deg");
        let yaw = -MAX_YAW_TRIM_DEG..=MAX_YAW_TRIM_DEG;
        problems.range(format!("{key}.yaw_deg"), self.yaw_deg, yaw, "deg");
    }
}

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
            "version = \"paper\"",
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
