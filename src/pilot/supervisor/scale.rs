//! The scale of the accelerometer: specific force along body z over what the thrust that was sent makes of it.
//!
//! **Law.** From the thrust alone, whatever the sensor says:
//!
//! ```text
//! du/dt = (s − u) / T               s thrust sent over the thrust that hovers, T lag of the wings
//! e     = g u + d w                 specific force upwards that is expected
//! dw/dt = g − e                     w sinking speed, d vertical drag, 1/s
//! ratio = f / e                     both low-passed alike
//! ```
//! A sensor that reads twice the force makes the loop cut the thrust; f and e fall together, and their ratio stays
//! two. It is judged against what was usual in this flight, since the thrust that hovers is known to a fifth only.
//!
//! Only a sensor that reads too much is looked for: nothing in the air carries so much more than the thrust, while less
//! lift than was sent is what damage makes as well (`lift_differs`).
//!
//! **Source.** Vertical balance as in `hover`; lag and drag from VEHICLE.md. **Validity.** Flight in free air, leaning
//! little. On the floor, which carries, a sensor that is right reads g and no more.

use super::super::modes::Mode;
use super::super::{Pilot, Severity};
use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::frames::G_MPS2;
use crate::time::HostTime;

/// Lag of the wings, s, vertical drag, 1/s, and the low-pass that the force has gone through, s.
pub(super) const WINGS_S: f64 = 0.08;
pub(super) const DRAG_PER_S: f64 = 0.8;
const FILTER_S: f64 = 0.15;
/// What is usual is learned over this time, s, and within these bounds.
const USUAL_S: f64 = 5.0;
const USUAL: [f64; 2] = [0.75, 1.35];
/// Ratio, over the usual one, that no sensor which is right has.
const MOST_RATIO: f64 = 1.33;
/// Least force expected that is divided by, m/s².
const LEAST_MPS2: f64 = 0.2 * G_MPS2;
/// Where the floor may carry it must read more than this, m/s²: a touch-down of 0.4 m/s reads less.
const CARRIED_MPS2: f64 = 1.3 * G_MPS2;
/// Higher it flies freely, m, and in a landing, which ends on the floor and on tables, by the estimate alone: multipath
/// biases it by half a metre near the floor.
const CLEAR_M: f64 = 0.5;
const CLEAR_LANDING_M: f64 = 0.8;
/// More lean is not looked at, as its cosine (30 degrees).
const LEVEL_COS: f64 = 0.866;

/// What is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::pilot) struct Scale {
    begun: bool,
    share: f64,
    sink_mps: f64,
    expected_mps2: f64,
    usual: f64,
    /// Specific force over the expected one, over the usual.
    pub ratio: f64,
    free: bool,
    force_mps2: f64,
}

impl Default for Scale {
    fn default() -> Self {
        Self {
            begun: false,
            share: 1.0,
            sink_mps: 0.0,
            expected_mps2: G_MPS2,
            usual: 1.0,
            ratio: 1.0,
            free: false,
            force_mps2: G_MPS2,
        }
    }
}

impl Scale {
    /// A control step: specific force upwards, low-passed, m/s², thrust over the one that hovers, and whether
    /// nothing but air carries it.
    pub fn step(&mut self, force_mps2: f64, share: f64, free: bool, dt_s: f64) {
        if !force_mps2.is_finite() || !share.is_finite() {
            return;
        }
        if !std::mem::replace(&mut self.begun, true) {
            (self.share, self.expected_mps2) = (share, force_mps2.max(LEAST_MPS2));
        }
        let weight = |time_s: f64| dt_s / (time_s + dt_s);
        self.share += (share - self.share) * weight(WINGS_S);
        let expected_mps2 = G_MPS2 * self.share + DRAG_PER_S * self.sink_mps;
        self.sink_mps += (G_MPS2 - expected_mps2) * dt_s;
        self.expected_mps2 += (expected_mps2 - self.expected_mps2) * weight(FILTER_S);
        let ratio = force_mps2 / self.expected_mps2.max(LEAST_MPS2);
        self.ratio = ratio / self.usual;
        self.usual += (ratio.clamp(USUAL[0], USUAL[1]) - self.usual) * weight(USUAL_S);
        (self.free, self.force_mps2) = (free, force_mps2);
    }

    fn is_wrong(&self) -> bool {
        self.ratio > MOST_RATIO && (self.free || self.force_mps2 > CARRIED_MPS2)
    }
}

impl Pilot {
    /// Follows the scale wherever the loop flies, and what a descent would begin with.
    pub(in crate::pilot) fn watch_scale(&mut self, at: HostTime, dt_s: f64) {
        let hover_frac = self.hover_thrust_frac() * self.control.ground_factor;
        if !self.mode.is_flying() || !self.board.obeys() || hover_frac < 0.05 {
            self.supervisor.scale = Scale::default();
            self.supervisor.before.forget();
            return;
        }
        let share = self.control.thrust_frac / hover_frac;
        let (height_m, sink_mps) = (self.height_above_floor_m(), self.estimate.vel_E_mps().z());
        self.supervisor.before.note(height_m, sink_mps, share, dt_s);
        let level = self.board_attitude.map_or(1.0, |board| board.attitude.matrix()[(2, 2)]);
        // What comes late is not of the thrust that was sent last.
        if level < LEVEL_COS || self.board.lateness().is_late() {
            return;
        }
        let by_baro = || self.baro_above_floor_m(at).is_some_and(|baro_m| baro_m > CLEAR_M);
        let clear = match self.mode {
            // An estimate that is wrong on the floor is so before the take-off.
            Mode::Takeoff => by_baro(),
            Mode::Land => height_m > CLEAR_LANDING_M || by_baro(),
            _ => true,
        };
        let free = clear && height_m > CLEAR_M && self.touch.ceiling_frac.is_none();
        self.supervisor.scale.step(-self.touch.acc_z_mps2, share, free, dt_s);
    }
}

/// The accelerometer reads another scale.
pub(super) const SCALE: Condition = Condition {
    name: "force_scale",
    seen_by: "The specific force along body z, over the one that the thrust makes (with the lag of the wings and the \
              drag of the fall that the thrust allows), is more than 1.33 times what is usual in this flight. What the \
              loop cuts because of a wrong reading is on both sides of the ratio. Below 0.5 m (in landings 0.8 m, or \
              0.5 m where estimate and barometer agree; in take-offs by the barometer), and while the floor is felt for, only from 1.3 g on: there the \
              floor may carry. Not looked at while the board's link is late. The descent begins with height and speed of half a second \
              before, carried on by the thrust.",
    numbers: &[Number {
        key: "",
        value: |_| MOST_RATIO,
        unit: "",
        origin: "geometric middle of what 24 healthy flights in lockstep have at most (1.18) and a sensor that reads half as \
                 much again",
    }],
    lasts_s: |_| 0.06,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: accelerometer reads another scale",
    over: "",
    latched: true,
    health: haltere_dialect::mav::haltere::MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    severity: Severity::Emergency,
    is_seen: |pilot, _| pilot.supervisor.scale.is_wrong(),
    words: |pilot, _| {
        format!(
            "accelerometer reads {:.1} times the force of the thrust",
            pilot.supervisor.scale.ratio
        )
    },
    ..ROW
};

#[cfg(test)]
mod tests {
    use super::*;

    /// Control steps of 10 ms with a sensor that reads so many times the force, below a loop that answers what it reads
    /// with the opposite thrust. After how many it is wrong for 0.06 s, if ever.
    fn found_after(times: f64, free: bool) -> Option<usize> {
        let mut scale = Scale::default();
        let (mut share, mut wings, mut sink_mps, mut force_mps2) = (1.0_f64, 1.0, 0.0, G_MPS2);
        let mut wrong = 0;
        for n in 0..1000 {
            let times = if n < 500 { 1.0 } else { times };
            wings += (share - wings) * (0.01 / (WINGS_S + 0.01));
            let true_mps2 = G_MPS2 * wings + DRAG_PER_S * sink_mps;
            sink_mps += (G_MPS2 - true_mps2) * 0.01;
            force_mps2 += (times * true_mps2 - force_mps2) * (0.01 / (FILTER_S + 0.01));
            scale.step(force_mps2, share, free, 0.01);
            // An inner loop on what is read: half of the surplus is cut.
            share = (1.0 - 0.5 * (force_mps2 / G_MPS2 - 1.0)).clamp(0.3, 1.5);
            wrong = if scale.is_wrong() { wrong + 1 } else { 0 };
            if wrong == 6 {
                return Some(n - 500);
            }
        }
        None
    }

    #[test]
    fn prop_a_loop_that_follows_the_reading_does_not_hide_its_scale() {
        assert_eq!(found_after(1.0, true), None);
        assert_eq!(found_after(1.15, true), None, "that much healthy flights have");
        for (times, most) in [(1.5, 35), (2.0, 20), (4.0, 12)] {
            let steps = found_after(times, true);
            assert!(steps.is_some_and(|n| n < most), "{times}: {steps:?}");
        }
    }

    #[test]
    fn prop_what_the_floor_carries_is_no_scale() {
        // Thrust goes down to nothing, and gravity is felt all the same.
        let mut scale = Scale::default();
        for n in 0..300 {
            let share = 1.0 - f64::from(n) * 0.003;
            scale.step(G_MPS2, share, false, 0.01);
            assert!(!scale.is_wrong(), "{share}");
        }
    }
}
