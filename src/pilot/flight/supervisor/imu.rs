//! The IMU: silent, saying the same again and again, noise, or another thrust than the one that was sent.

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;

use super::condition::{Condition, Number, ROW, Watched};
use super::envelope::LEAP;
use super::reaction::Reaction;
use super::scale::SCALE;
use super::slip::SLIP;
use crate::Pilot;
use crate::flight::modes::Mode;
use crate::out::voice::Severity;
use haltere_core::frames::G_MPS2;
use haltere_core::measure::ImuSample;
use haltere_core::time::HostTime;

/// Longest interval between two samples that counts as one of repetition, s.
const LONGEST_S: f64 = 0.1;

/// Time over which noise is told from motion, s: four wing beats, and 70 samples of three axes.
const ROUGH_FILTER_S: f64 = 0.3;
/// For how long it must look like noise, s.
const ROUGH_LASTS_S: f64 = 0.3;
/// Share of white noise that is noise. Over these times 64 whole healthy flights in the other simulator, whose gears
/// shake the board as well, had 0.56 at most, and white noise never less than 0.86 in two minutes.
const ROUGH_RATIO: f64 = 0.7;
/// Noise that matters, m/s² and rad/s, all axes together.
const ROUGH_ACC_MPS2: f64 = 8.0;
const ROUGH_RATE_RADPS: f64 = 1.0;
/// At longer intervals wing beats themselves look like noise, s.
const ROUGH_INTERVAL_S: f64 = 0.006;
/// Weight of the newest interval in the mean.
const INTERVAL_WEIGHT: f64 = 0.02;
/// Time constant of the difference between accelerometer and thrust, s.
const LIFT_FILTER_S: f64 = 1.0;
/// Difference that no flight has, m/s².
const LIFT_MOST_MPS2: f64 = 3.5;
/// … and so much more for each share of the hover thrust that it was commanded away from it, m/s²: in fast
/// climbs and descents drag and the bend of the thrust curve are in the difference.
const LIFT_SLOPE_MPS2: f64 = 20.0;
/// It is looked at below this angle, 20 degrees, and so long after a larger one, s: the
/// speed that it brought decays by drag and by the position loop.
const LIFT_LEVEL_COS: f64 = 0.94;
const LIFT_AFTER_S: f64 = 1.0;
/// Below this height the floor may carry, m.
const LIFT_CLEAR_M: f64 = 0.5;

/// Whether a signal is noise from sample to sample, by the ratio of von Neumann: mean squared difference of
/// neighbours over twice the variance. White noise has 1; a motion that is sampled often enough has little.
#[derive(Debug, Default, Clone, Copy)]
struct Roughness {
    mean: [f64; 3],
    variance: f64,
    half_step2: f64,
}

impl Roughness {
    fn note(&mut self, now: [f64; 3], was: [f64; 3], dt_s: f64) {
        self.note_over(ROUGH_FILTER_S, now, was, dt_s);
    }

    fn note_over(&mut self, filter_s: f64, now: [f64; 3], was: [f64; 3], dt_s: f64) {
        let weight = dt_s / (filter_s + dt_s);
        let (mut spread, mut step) = (0.0, 0.0);
        for i in 0..3 {
            self.mean[i] += (now[i] - self.mean[i]) * weight;
            spread += (now[i] - self.mean[i]).powi(2);
            step += 0.5 * (now[i] - was[i]).powi(2);
        }
        self.variance += (spread - self.variance) * weight;
        self.half_step2 += (step - self.half_step2) * weight;
    }

    fn is_noise(&self, least_std: f64) -> bool {
        self.variance > least_std * least_std && self.half_step2 > ROUGH_RATIO * self.variance
    }
}

/// How long each triple has repeated itself, and how rough it is.
#[derive(Debug, Default)]
pub(crate) struct Repetition {
    last: Option<ImuSample>,
    /// How long accelerometer and gyroscope have repeated themselves, s.
    pub acc_s: f64,
    rate_s: f64,
    rough_acc: Roughness,
    rough_rate: Roughness,
    /// Mean interval, s.
    interval_s: f64,
}

impl Repetition {
    /// A sample came.
    pub fn note(&mut self, sample: &ImuSample) {
        if let Some(last) = &self.last {
            let dt_s = sample.valid_at.seconds_since(last.valid_at).clamp(0.0, LONGEST_S);
            let same = |now: [f64; 3], was: [f64; 3]| now == was;
            let acc = same(sample.acc_B_mps2.to_array(), last.acc_B_mps2.to_array());
            let rate = same(sample.rate_B_radps.to_array(), last.rate_B_radps.to_array());
            // Across a gap neighbours differ as those of noise do.
            if dt_s > 0.0 && dt_s < LONGEST_S {
                self.interval_s += (dt_s - self.interval_s) * INTERVAL_WEIGHT;
                let (now, was) = (sample.acc_B_mps2.to_array(), last.acc_B_mps2.to_array());
                self.rough_acc.note(now, was, dt_s);
                let (now, was) = (sample.rate_B_radps.to_array(), last.rate_B_radps.to_array());
                self.rough_rate.note(now, was, dt_s);
            }
            self.acc_s = if acc { self.acc_s + dt_s } else { 0.0 };
            self.rate_s = if rate { self.rate_s + dt_s } else { 0.0 };
        }
        self.last = Some(*sample);
    }

    /// Which of the two is noise, if the samples come often enough to tell.
    fn noise(&self) -> Option<&'static str> {
        if self.interval_s > ROUGH_INTERVAL_S {
            None
        } else if self.rough_acc.is_noise(ROUGH_ACC_MPS2) {
            Some("accelerometer")
        } else if self.rough_rate.is_noise(ROUGH_RATE_RADPS) {
            Some("gyroscope")
        } else {
            None
        }
    }

    fn longest_s(&self) -> f64 {
        self.acc_s.max(self.rate_s)
    }
}

/// Specific force along body z against the thrust that was sent.
#[derive(Debug, Default)]
pub(crate) struct Lift {
    /// Low-passed difference, measured minus sent, m/s².
    pub off_mps2: f64,
    /// Low-passed distance of the thrust from the one that hovers, share of it.
    away: f64,
    /// Time for which it is not looked at any more, s.
    leaned_s: f64,
}

impl Lift {
    /// A control step in free air: specific force, low-passed over wing beats, and thrust over the thrust
    /// that hovers.
    pub fn step(&mut self, acc_z_mps2: f64, share: f64, dt_s: f64) {
        let off_mps2 = acc_z_mps2 + G_MPS2 * share;
        if off_mps2.is_finite() {
            let weight = dt_s / (LIFT_FILTER_S + dt_s);
            self.off_mps2 += (off_mps2 - self.off_mps2) * weight;
            self.away += ((share - 1.0).abs() - self.away) * weight;
        }
    }

    /// Whether that is more than flying explains.
    fn differs(&self) -> bool {
        // Less lift than was sent is no matter of how much was sent: more was sent because it is less.
        let most_mps2 = LIFT_MOST_MPS2 + LIFT_SLOPE_MPS2 * self.away;
        self.off_mps2 > LIFT_MOST_MPS2 || self.off_mps2 < -most_mps2
    }
}

impl Pilot {
    /// Compares accelerometer and thrust where both should say the same: away from the floor, under our
    /// own control.
    pub(crate) fn watch_lift(&mut self, dt_s: f64) {
        let calm = self.flight.mode.is_flying()
            && self.flight.mode != Mode::Land
            && self.height_above_floor_m() > LIFT_CLEAR_M
            && self.board.link.obeys();
        let hover_frac = self.hover_thrust_frac() * self.flight.control.ground_factor;
        if !calm || hover_frac < 0.05 {
            self.flight.supervisor.lift = Lift::default();
            return;
        }
        // Leaning far it moves fast, along its own vertical axis too, and drag is as large as the difference
        // that is looked for: nothing is learned then.
        // By the board's account: ours may be what is wrong.
        let level = self.board.attitude.map_or(1.0, |board| board.attitude.matrix()[(2, 2)]);
        if level < LIFT_LEVEL_COS {
            self.flight.supervisor.lift.leaned_s = LIFT_AFTER_S;
            return;
        }
        self.flight.supervisor.lift.leaned_s -= dt_s;
        if self.flight.supervisor.lift.leaned_s > 0.0 {
            return;
        }
        // Low-passed as the force is.
        let share = self.navigation.touch.thrust_frac / hover_frac;
        self.flight.supervisor.lift.step(self.navigation.touch.acc_z_mps2, share, dt_s);
    }

    pub(crate) fn imu_age_s(&self, at: HostTime) -> f64 {
        self.navigation.last_imu.map_or(f64::INFINITY, |t| at.seconds_since(t))
    }

    /// For how long no sample came though we listened, s. What comes late is not silent.
    fn imu_silent_s(&self, at: HostTime) -> f64 {
        if self.board_is_moving(at) {
            return 0.0;
        }
        let own_s = self.flight.supervisor.punctuality.own_silence_s(at);
        self.imu_age_s(at) - own_s - self.board.link.lateness().age_s()
    }

    /// Whether the accelerometer can be asked whether the vehicle falls.
    pub(crate) fn imu_is_alive(&self, at: HostTime) -> bool {
        let c = &self.config.supervisor;
        self.imu_silent_s(at) <= c.imu_loss_s
            && self.flight.supervisor.repetition.longest_s() <= c.imu_frozen_s
            && ![NOISE, LIFT, SLIP, SCALE, LEAP]
                .iter()
                .any(|row| self.flight.supervisor.has(row.name))
    }
}

const SENSORS: S = S::MAV_SYS_STATUS_SENSOR_3D_GYRO.union(S::MAV_SYS_STATUS_SENSOR_3D_ACCEL);

/// Values without sense.
pub(super) const NOISE: Condition = Condition {
    name: "imu_noise",
    seen_by: "Accelerometer (over 8 m/s²) or gyroscope (over 1 rad/s) are noise from sample to sample: the \
              mean squared difference of neighbours is more than 70 % of what white noise has. Told only \
              of IMUs that come at 170 Hz or more. Accelerometers that turned from wing beats into white noise of \
              40, 20 and 10 m/s² an axis were told after 0.35, 0.43 and 0.63 s in the middle of 200 onsets each, \
              after 0.50, 0.61 and 0.91 s at worst.",
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
    is_seen: |pilot, _| pilot.flight.supervisor.repetition.noise().is_some(),
    words: |pilot, _| {
        format!("{} is noise", pilot.flight.supervisor.repetition.noise().unwrap_or("IMU"))
    },
    ..ROW
};

/// The specific force is not that of the thrust.
pub(super) const LIFT: Condition = Condition {
    name: "lift_differs",
    seen_by: "The specific force along body z, averaged over a second, differs from the thrust that was \
              sent (over the hover thrust that was learned): by more than 3.5 m/s² where there is less \
              lift than was sent, and, where there is more, by 2 m/s² more than that for each tenth of \
              thrust that was commanded away from the hover thrust. The accelerometer is wrong, the \
              wings are damaged, or the board does not give what it is sent. Looked at above 0.5 m, not \
              in landings, and not while it leans by more than 20 degrees.",
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
    is_seen: |pilot, _| pilot.flight.supervisor.lift.differs(),
    words: |pilot, _| {
        let off_mps2 = pilot.flight.supervisor.lift.off_mps2;
        format!("specific force is off by {off_mps2:+.1} m/s2 against the thrust sent")
    },
    ..ROW
};

/// No samples.
pub(super) const LOST: Condition = Condition {
    name: "imu_lost",
    seen_by: "No IMU sample came for `supervisor.imu_loss_s`. Within 0.05 s after a pause of the \
              companion itself that pause does not count, nor do the 0.3 s in which a board that changed its port \
              is not heard yet ([second_board](#second_board)).",
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
    is_seen: |pilot, at| pilot.imu_silent_s(at) > pilot.config.supervisor.imu_loss_s,
    words: |pilot, at| format!("no IMU for {:.1} s", pilot.imu_silent_s(at).min(999.0)),
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
    is_seen: |pilot, _| {
        pilot.flight.supervisor.repetition.longest_s() > pilot.config.supervisor.imu_frozen_s
    },
    words: |pilot, _| {
        let r = &pilot.flight.supervisor.repetition;
        let what = if r.acc_s >= r.rate_s { "accelerometer" } else { "gyroscope" };
        format!("{what} repeats itself for {:.1} s", r.longest_s())
    },
    ..ROW
};

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.004;

    /// White noise of this standard deviation (numbers: splitmix64).
    fn white(std: f64) -> impl FnMut() -> f64 {
        let mut state = 1_u64;
        move || {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = state;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            let unit = ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64;
            std * 12.0_f64.sqrt() * (unit - 0.5)
        }
    }

    /// Shares of white noise over a minute, from the second second on.
    fn shares(mut sample: impl FnMut(f64) -> [f64; 3]) -> (f64, f64) {
        let mut rough = Roughness::default();
        let mut was = sample(0.0);
        let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
        for n in 1..15_000 {
            let t_s = f64::from(n) * DT_S;
            let now = sample(t_s);
            rough.note(now, was, DT_S);
            was = now;
            if t_s > 2.0 {
                let share = rough.half_step2 / rough.variance;
                (least, most) = (least.min(share), most.max(share));
            }
        }
        (least, most)
    }

    /// Wing beats of 13 Hz with their second harmonic, m/s².
    fn beats(t_s: f64) -> f64 {
        let turn = std::f64::consts::TAU * 13.0 * t_s;
        15.0 * turn.sin() + 8.0 * (2.0 * turn).sin()
    }

    /// How long after noise took the place of wing beats it is told, s: in the middle of 200 onsets, and at
    /// worst. Noise of this standard deviation an axis; time of the filter, for how long, share.
    fn told_after_s(std: f64, filter_s: f64, lasts_s: f64, ratio: f64) -> [f64; 2] {
        let mut noise = white(std);
        let mut delays: Vec<f64> = (0..200)
            .map(|n| {
                // Onsets all over a wing beat.
                let onset_s = 2.0 + f64::from(n) * 0.001_3;
                let mut rough = Roughness::default();
                let (mut was, mut since_s) = ([0.0; 3], None);
                for k in 0..2_000 {
                    let t_s = f64::from(k) * DT_S;
                    let now = if t_s < onset_s {
                        [beats(t_s), 0.3 * beats(t_s + 0.01), beats(t_s + 0.02)]
                    } else {
                        std::array::from_fn(|_| noise())
                    };
                    rough.note_over(filter_s, now, was, DT_S);
                    was = now;
                    let seen = rough.variance > ROUGH_ACC_MPS2.powi(2)
                        && rough.half_step2 > ratio * rough.variance;
                    since_s = seen.then(|| since_s.unwrap_or(t_s));
                    if since_s.is_some_and(|since_s| t_s - since_s >= lasts_s) {
                        return t_s - onset_s;
                    }
                }
                f64::INFINITY
            })
            .collect();
        delays.sort_by(f64::total_cmp);
        [delays[100], delays[199]]
    }

    /// The delays that docs/SAFETY.md gives. Printed beside them are those of the limits that the row had when it
    /// brought down healthy vehicles (filter of 0.15 s, 0.1 s long, share of 0.6): a third of these.
    #[test]
    fn golden_noise_is_told_as_soon_as_was_written_down() {
        for (std, found_s) in [(40.0, [0.35, 0.50]), (20.0, [0.43, 0.61]), (10.0, [0.63, 0.91])] {
            let delays_s = told_after_s(std, ROUGH_FILTER_S, ROUGH_LASTS_S, ROUGH_RATIO);
            let before_s = told_after_s(std, 0.15, 0.1, 0.6);
            println!("{std} m/s² an axis: {delays_s:.3?} s; before {before_s:.3?}");
            for (delay_s, found_s) in delays_s.into_iter().zip(found_s) {
                assert!((delay_s - found_s).abs() < 0.02, "{std} m/s²: {delays_s:?} s");
            }
        }
    }

    #[test]
    fn prop_white_noise_is_always_told_from_wing_beats_and_gears() {
        let mut noise = white(10.0);
        let (least, _) = shares(|_| std::array::from_fn(|_| noise()));
        assert!(least > ROUGH_RATIO, "{least}");
        let mut noise = white(2.0);
        let (_, most) = shares(|t_s| {
            let turn = std::f64::consts::TAU * 13.0 * t_s;
            let beat = 15.0 * turn.sin() + 8.0 * (2.0 * turn).sin();
            // What is left of a gear mesh far above half of the rate of samples.
            let gears = 4.0 * (std::f64::consts::TAU * 97.0 * t_s).sin();
            [beat + gears, gears + noise(), beat]
        });
        assert!(most < ROUGH_RATIO, "{most}");
    }
}
