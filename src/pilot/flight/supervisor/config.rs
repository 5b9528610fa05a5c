//! Section `[supervisor]`: from when on something is wrong, and what is then done where there is a choice.

use super::reaction::Action;
use haltere_core::checks::Problems;

haltere_core::keys! {
    /// `[supervisor]`. Silences of UWB, board and client, and the voltages, stand in `[limits]`.
    pub struct SupervisorConfig {
        /// Silence of the IMU that ends position control.
        ///
        /// docs/SAFETY.md says what is done about this and what follows. Where there is a choice: "tell" (people are
        /// told), "hold", "return" (fly home and land), "land".
        imu_loss_s: f64 = 0.2, [0.05..=2.0, "s"], SUP_IMU_LOSS_T(23, AtOnce);
        /// Time for which an IMU may repeat itself to the last bit in flight.
        imu_frozen_s: f64 = 0.2, [0.05..=2.0, "s"], SUP_IMU_FRZ_T(24, AtOnce);
        /// Horizontal position sigma at which UWB that is late counts as lost.
        uwb_loss_std_m: f64 = 0.8, [0.1..=2.0, "m"], SUP_UWB_LOSS_STD(25, AtOnce);
        /// Silence after which an anchor counts as gone.
        anchor_silent_s: f64 = 1.0, [0.2..=10.0, "s"], SUP_ANC_SIL_T(27, AtOnce);
        /// Anchors that must be heard to arm and to fly on; never more than there are.
        anchors_least: u8 = 5, [4.0..=16.0], SUP_ANC_LEAST(28, AtOnce);
        /// Misfit of an anchor on the floor with which nothing takes off; half of it is told.
        ///
        /// It is by how much its time differences miss those of the others.
        anchor_misfit_m: f64 = 0.6, [0.3..=100.0, "m"], SUP_ANC_MISFIT(26, AtOnce);
        /// Share of UWB measurements beyond the gate at which the estimate counts as diverged.
        divergence_share: f64 = 0.8, [0.3..=1.0], SUP_DIV_SHARE(29, AtOnce);
        /// How long it must be so.
        divergence_s: f64 = 1.0, [0.1..=10.0, "s"], SUP_DIV_T(30, AtOnce);
        /// Angle between our vertical and the board's at which ours is not believed.
        attitude_difference_deg: f64 = 20.0, [10.0..=90.0, "deg"], SUP_ATT_DIFF(31, AtOnce);
        /// Difference between estimated and barometric height that people are told of.
        height_difference_m: f64 = 1.5, [0.5..=20.0, "m"], SUP_HGT_DIFF(32, AtOnce);
        /// Silence of all stations that have sent heartbeats.
        ground_loss_s: f64 = 5.0, [2.0..=120.0, "s"], SUP_GND_LOSS_T(33, AtOnce);
        /// What is then done.
        ground_loss: Action = Action::Tell, SUP_GND_LOSS(34, AtOnce);
        /// What is done when a client's velocity setpoints stop.
        offboard_loss: Action = Action::Hold, ~[1.0..=3.0], SUP_OFB_LOSS(35, AtOnce);
        /// What is done below limits.battery_low_v.
        battery_low: Action = Action::Tell, SUP_BAT_LOW(36, AtOnce, "What is done below LIM_BAT_LOW.");
        /// What is done when the time left is down to what it takes to get home and down.
        battery_home: Action = Action::Return, SUP_BAT_HOME(37, AtOnce);
        /// Time that is then still to be left on the floor.
        battery_reserve_s: f64 = 15.0, [0.0..=300.0, "s"], SUP_BAT_RESERVE(38, AtOnce);
        /// How far beyond the volume or a fence the hard wall stands.
        wall_hard_m: f64 = 0.5, [0.1..=10.0, "m"], SUP_WALL_HARD(39, AtOnce);
        /// What is done there.
        ///
        /// Each goes back inside.
        wall_hard: Action = Action::Land, SUP_WALL_ACT(40, AtOnce);
        /// Largest tilt.
        tilt_most_deg: f64 = 70.0, [55.0..=90.0, "deg"], SUP_TILT_MOST(41, AtOnce);
        /// Largest speed.
        speed_most_mps: f64 = 6.0, [2.0..=20.0, "m/s"], SUP_SPD_MOST(42, AtOnce);
        /// Largest distance from the point that is held or flown to.
        off_course_m: f64 = 2.0, [0.5..=20.0, "m"], SUP_OFF_COURSE(43, AtOnce);
        /// Longest pause of the control loop.
        loop_gap_s: f64 = 0.4, [0.1..=5.0, "s"], SUP_LOOP_GAP_T(44, AtOnce);
        /// Whether a joystick that is moved takes over.
        stick_takeover: bool = false, SUP_STICKS(45, AtOnce);
    } rules renewed;
}

impl SupervisorConfig {
    fn renewed(&self, key: &str, problems: &mut Problems) {
        if self.offboard_loss == Action::Tell {
            problems.say(format!(
                "{key}.offboard_loss = \"tell\": a velocity that nobody renews cannot go on; write \
                 \"hold\", \"return\" or \"land\""
            ));
        }
    }
}
