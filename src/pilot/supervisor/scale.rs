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
//! **Source.** Vertical balance as in `hover`; lag and drag from VEHICLE.md. **Validity.** Flight in free air, leaning
//! little. On the floor, which carries, a sensor that is right reads g and no more.

use super::super::modes::Mode;
use super::super::{Pilot, Severity};
use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::frames::G_MPS2;

/// Lag of the wings, s, vertical drag, 1/s, and the low-pass that the force has gone through, s.
const WINGS_S: f64 = 0.08;
const DRAG_PER_S: f64 = 0.8;
const FILTER_S: f64 = 0.15;
/// What is usual is learned over this time, s, and within these bounds.
const USUAL_S: f64 = 5.0;
const USUAL: [f64; 2] = [0.75, 1.35];
/// Ratios, over the usual one, that no sensor which is right has.
const RATIOS: [f64; 2] = [0.6, 1.4];
/// Least force expected that is divided by, m/s².
const LEAST_MPS2: f64 = 0.2 * G_MPS2;
/// Where the floor may carry it must read more than this, m/s²: a touch-down of 0.4 m/s reads less.
const CARRIED_MPS2: f64 = 1.3 * G_MPS2;
/// Higher it flies freely, m, and in a landing, which ends on the floor and on tables.
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
        let [least, most] = RATIOS;
        let too_much = self.ratio > most && (self.free || self.force_mps2 > CARRIED_MPS2);
        // A floor never makes it read less than the thrust.
        too_much || self.ratio < least
    }
}

impl Pilot {
    /// Follows the scale wherever the loop flies.
    pub(in crate::pilot) fn watch_scale(&mut self, dt_s: f64) {
        let hover_frac = self.hover_thrust_frac() * self.control.ground_factor;
        if !self.mode.is_flying() || !self.board.obeys() || hover_frac < 0.05 {
            self.supervisor.scale = Scale::default();
            return;
        }
        let level = self.board_attitude.map_or(1.0, |board| board.attitude.matrix()[(2, 2)]);
        if level < LEVEL_COS {
            return;
        }
        let clear_m = if self.mode == Mode::Land { CLEAR_LANDING_M } else { CLEAR_M };
        let free = self.height_above_floor_m() > clear_m;
        let share = self.control.thrust_frac / hover_frac;
        self.supervisor.scale.step(-self.touch.acc_z_mps2, share, free, dt_s);
    }
}

/// The accelerometer reads another scale.
pub(super) const SCALE: Condition = Condition {
    name: "force_scale",
    seen_by: "The specific force along body z, over the one that the thrust makes (with the lag of the wings and the \
              drag of the fall that the thrust allows), is more than 1.4 times or less than 0.6 times what is usual \
              in this flight. What the loop cuts because of a wrong reading is on both sides of the ratio. Below 0.5 m \
              (in landings 0.8 m) more only from 1.3 g on.",
    numbers: &[Number {
        key: "",
        value: |_| RATIOS[1],
        unit: "",
        origin: "chosen: between what 24 healthy flights in lockstep have at most (1.18) and a sensor that reads twice",
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
