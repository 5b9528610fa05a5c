//! Section `[supervisor]`: from when on something is wrong, and what is then done where there is a choice.

use serde::{Deserialize, Serialize};

use super::reaction::Action;
use haltere_core::checks::Problems;

/// `[supervisor]`. Silences of UWB, board and client, and the voltages, stand in `[limits]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SupervisorConfig {
    /// Silence of the IMU that ends position control, s.
    pub imu_loss_s: f64,
    /// Time for which an IMU may repeat itself to the last bit, s.
    pub imu_frozen_s: f64,
    /// Position sigma at which UWB that is late counts as lost, m.
    pub uwb_loss_std_m: f64,
    /// Silence after which an anchor counts as gone, s.
    pub anchor_silent_s: f64,
    /// Anchors that must be heard.
    pub anchors_least: u8,
    /// Misfit of an anchor on the floor with which nothing takes off, m.
    pub anchor_misfit_m: f64,
    /// Share of measurements beyond the gate at which the estimate counts as diverged.
    pub divergence_share: f64,
    /// How long it must be so, s.
    pub divergence_s: f64,
    /// Angle between our vertical and the board's at which ours is not believed, deg.
    pub attitude_difference_deg: f64,
    /// Difference between estimated and barometric height that people are told of, m.
    pub height_difference_m: f64,
    /// Silence of all stations that have sent heartbeats, s.
    pub ground_loss_s: f64,
    /// What is then done.
    pub ground_loss: Action,
    /// What is done when a client's setpoints stop.
    pub offboard_loss: Action,
    /// What is done below `limits.battery_low_v`.
    pub battery_low: Action,
    /// What is done when the time left is down to what it takes to get home and down.
    pub battery_home: Action,
    /// Time that is then still to be left on the floor, s.
    pub battery_reserve_s: f64,
    /// How far beyond the volume or the fence the hard wall stands, m.
    pub wall_hard_m: f64,
    /// What is done there.
    pub wall_hard: Action,
    /// Largest tilt, deg.
    pub tilt_most_deg: f64,
    /// Largest speed, m/s.
    pub speed_most_mps: f64,
    /// Largest distance from what is held or flown to, m.
    pub off_course_m: f64,
    /// Longest pause of the control loop, s.
    pub loop_gap_s: f64,
    /// Whether a deflected joystick takes over.
    pub stick_takeover: bool,
}

impl Default for SupervisorConfig {
    fn default() -> Self {
        Self {
            imu_loss_s: 0.2,
            imu_frozen_s: 0.2,
            uwb_loss_std_m: 0.8,
            anchor_silent_s: 1.0,
            anchors_least: 5,
            anchor_misfit_m: 0.6,
            divergence_share: 0.8,
            divergence_s: 1.0,
            attitude_difference_deg: 20.0,
            height_difference_m: 1.5,
            ground_loss_s: 5.0,
            ground_loss: Action::Tell,
            offboard_loss: Action::Hold,
            battery_low: Action::Tell,
            battery_home: Action::Return,
            battery_reserve_s: 15.0,
            wall_hard_m: 0.5,
            wall_hard: Action::Land,
            tilt_most_deg: 70.0,
            speed_most_mps: 6.0,
            off_course_m: 2.0,
            loop_gap_s: 0.4,
            stick_takeover: false,
        }
    }
}

impl SupervisorConfig {
    /// Adds what is out of range to `problems`; `key` is the name of the section.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value, low, high, unit| {
            problems.range(format_args!("{key}.{name}"), value, low..=high, unit);
        };
        range("imu_loss_s", self.imu_loss_s, 0.05, 2.0, "s");
        range("imu_frozen_s", self.imu_frozen_s, 0.05, 2.0, "s");
        range("uwb_loss_std_m", self.uwb_loss_std_m, 0.1, 2.0, "m");
        range("anchor_silent_s", self.anchor_silent_s, 0.2, 10.0, "s");
        range("anchors_least", f64::from(self.anchors_least), 4.0, 16.0, "");
        range("anchor_misfit_m", self.anchor_misfit_m, 0.3, 100.0, "m");
        range("divergence_share", self.divergence_share, 0.3, 1.0, "");
        range("divergence_s", self.divergence_s, 0.1, 10.0, "s");
        range("attitude_difference_deg", self.attitude_difference_deg, 10.0, 90.0, "deg");
        range("height_difference_m", self.height_difference_m, 0.5, 20.0, "m");
        range("ground_loss_s", self.ground_loss_s, 2.0, 120.0, "s");
        range("battery_reserve_s", self.battery_reserve_s, 0.0, 300.0, "s");
        range("wall_hard_m", self.wall_hard_m, 0.1, 10.0, "m");
        range("tilt_most_deg", self.tilt_most_deg, 55.0, 90.0, "deg");
        range("speed_most_mps", self.speed_most_mps, 2.0, 20.0, "m/s");
        range("off_course_m", self.off_course_m, 0.5, 20.0, "m");
        range("loop_gap_s", self.loop_gap_s, 0.1, 5.0, "s");
        if self.offboard_loss == Action::Tell {
            problems.say(format!(
                "{key}.offboard_loss = \"tell\": a velocity that nobody renews cannot go on; write \
                 \"hold\", \"return\" or \"land\""
            ));
        }
    }
}
