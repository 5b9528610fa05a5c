//! The IMU: silent, saying the same again and again, noise, or another thrust than the one that was sent.

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;

use super::condition::{Condition, Number, ROW, Watched};
use super::envelope::LEAP;
use super::reaction::Reaction;
use super::scale::SCALE;
use super::slip::SLIP;
use crate::navigation::lift::LIFT_MOST_MPS2;
use crate::navigation::repetition::{ROUGH_LASTS_S, ROUGH_RATIO};
use crate::out::voice::Severity;
use crate::view::Sight;

impl Sight<'_> {
    /// For how long no sample came though we listened, s. What comes late is not silent.
    fn imu_silent_s(&self) -> f64 {
        if self.board.is_moving(self.view.at) {
            return 0.0;
        }
        let own_s = self.flight.supervisor.punctuality.own_silence_s(self.view.at);
        self.navigation.imu_age_s(self.view.at) - own_s - self.board.link.lateness().age_s()
    }

    /// Whether the accelerometer can be asked whether the vehicle falls.
    pub(crate) fn imu_is_alive(&self) -> bool {
        let c = &self.view.config.supervisor;
        self.imu_silent_s() <= c.imu_loss_s
            && self.navigation.repetition.longest_s() <= c.imu_frozen_s
            && ![NOISE, LIFT, SLIP, SCALE, LEAP]
                .iter()
                .any(|row| self.flight.supervisor.has(row.name))
    }
}

const SENSORS: S = S::MAV_SYS_STATUS_SENSOR_3D_GYRO.union(S::MAV_SYS_STATUS_SENSOR_3D_ACCEL);

/// Values without sense.
pub(super) const NOISE: Condition = Condition {
    name: "imu_noise",
    seen_by: "The readings of the accelerometer (over 8 m/s²) or of the gyroscope (over 1 rad/s) are noise from sample \
              to sample: the mean squared difference of neighbours is more than 70 % of that of white noise. IMUs \
              below 170 Hz are not judged. White noise of 40, 20 and 10 m/s² an axis was told after 0.35, 0.43 and \
              0.63 s (median of 200 onsets each), after 0.91 s at worst.",
    numbers: &[Number {
        key: "",
        value: |_| ROUGH_RATIO,
        unit: "",
        origin: "between the 0.56 that healthy flights of the other simulator had at most and the 0.86 that white \
                 noise has at least",
    }],
    lasts_s: |_| ROUGH_LASTS_S,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: IMU is noise",
    over: "",
    latched: true,
    health: SENSORS,
    severity: Severity::Emergency,
    is_seen: |sight| sight.navigation.repetition.noise().is_some(),
    words: |sight| format!("{} is noise", sight.navigation.repetition.noise().unwrap_or("IMU")),
    ..ROW
};

/// The specific force is not that of the thrust.
pub(super) const LIFT: Condition = Condition {
    name: "lift_differs",
    seen_by: "The specific force along body z, averaged over a second, differs from the thrust that was sent (over the \
              learned hover thrust): less lift than was sent by more than 3.5 m/s², or more lift by 3.5 m/s² and a \
              further 2 m/s² for each tenth of thrust commanded away from hover. The accelerometer is wrong, the wings \
              are damaged, or the board does not give what it is sent. It is looked at above 0.5 m, not in landings, \
              and not at a lean of more than 20 degrees.",
    numbers: &[Number {
        key: "",
        value: |_| LIFT_MOST_MPS2,
        unit: "m/s²",
        origin: "chosen: a third of the weight; the diagnostic flight of the simulator stays below",
    }],
    lasts_s: |_| 0.2,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: lift is not what was sent",
    over: "",
    latched: true,
    health: S::MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    severity: Severity::Emergency,
    is_seen: |sight| sight.navigation.lift.differs(),
    words: |sight| {
        let off_mps2 = sight.navigation.lift.off_mps2;
        format!("specific force is off by {off_mps2:+.1} m/s2 against the thrust sent")
    },
    ..ROW
};

/// No samples.
pub(super) const LOST: Condition = Condition {
    name: "imu_lost",
    seen_by: "No IMU sample came for `supervisor.imu_loss_s`. The 0.3 s in which a board that changed its port is not \
              heard ([second_board](#second_board)) do not count.",
    numbers: &[Number {
        key: "supervisor.imu_loss_s",
        value: |c| c.supervisor.imu_loss_s,
        unit: "s",
        origin: "50 samples; attitude by the last rate is then off by some 10 degrees",
    }],
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: no IMU",
    over: "IMU is back",
    health: SENSORS,
    severity: Severity::Emergency,
    is_seen: |sight| sight.imu_silent_s() > sight.view.config.supervisor.imu_loss_s,
    words: |sight| format!("no IMU for {:.1} s", sight.imu_silent_s().min(999.0)),
    ..ROW
};

/// The same sample for ever.
pub(super) const FROZEN: Condition = Condition {
    name: "imu_frozen",
    seen_by: "Accelerometer or gyroscope repeat all three values to the last bit for \
              `supervisor.imu_frozen_s`. In flight the wings shake both.",
    numbers: &[Number {
        key: "supervisor.imu_frozen_s",
        value: |c| c.supervisor.imu_frozen_s,
        unit: "s",
        origin: "50 samples and two wing beats",
    }],
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: IMU frozen",
    over: "IMU moves again",
    health: SENSORS,
    severity: Severity::Emergency,
    is_seen: |sight| {
        sight.navigation.repetition.longest_s() > sight.view.config.supervisor.imu_frozen_s
    },
    words: |sight| {
        let r = &sight.navigation.repetition;
        let what = if r.acc_s >= r.rate_s { "accelerometer" } else { "gyroscope" };
        format!("{what} repeats itself for {:.1} s", r.longest_s())
    },
    ..ROW
};
