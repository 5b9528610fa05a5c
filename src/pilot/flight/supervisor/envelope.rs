//! Walls and the envelope of flight: where the vehicle is, how it leans, how fast it is.

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;

use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::flight::Flight;
use crate::flight::modes::Mode;
use crate::out::voice::Severity;
use crate::view::{Sight, View};
use haltere_core::estimate::Health;

/// The board's attitude may be this old to be asked for the tilt, s.
const ATTITUDE_AGE_S: f64 = 0.2;

/// Time over which a gain of speed is looked at, as control steps: 0.3 s.
const LEAP_STEPS: usize = 30;
/// Speed that no such vehicle gains in that time, m/s: free fall gains 2.9, twice the hover thrust as much upwards.
const LEAP_MPS: f64 = 4.0;

/// Estimated speeds of the last steps of flight.
#[derive(Debug, Default)]
pub(crate) struct Speed {
    last_mps: [f64; LEAP_STEPS],
    steps: usize,
    /// Gained over them, m/s.
    gained_mps: f64,
}

impl Speed {
    fn step(&mut self, speed_mps: f64) {
        let slot = &mut self.last_mps[self.steps % LEAP_STEPS];
        let was_mps = std::mem::replace(slot, speed_mps);
        self.gained_mps = if self.steps < LEAP_STEPS { 0.0 } else { speed_mps - was_mps };
        self.steps = self.steps.wrapping_add(1);
    }
}

impl Flight {
    /// Follows the estimated speed in flight.
    pub(crate) fn watch_speed(&mut self, view: &View<'_>) {
        if view.mode.is_flying() {
            self.supervisor.speed.step(view.estimate.vel_B_mps.norm());
        } else {
            self.supervisor.speed = Speed::default();
        }
    }
}

impl Sight<'_> {
    fn is_placed(&self) -> bool {
        matches!(self.view.estimate.health, Health::Good | Health::Degraded)
    }

    /// How far the vehicle is beyond the volume or the fence, m; 0 inside.
    fn beyond_m(&self) -> f64 {
        let pos = self.view.estimate.pos_E_m;
        let volume = self.flight.guidance.volume();
        let inside = volume.clamp(pos);
        let out = |a: f64, b: f64| (a - b).abs();
        // Below the lowest setpoint is the floor, not a wall.
        let up_m = (-pos.z() - volume.height_m).max(0.0);
        let volume_m = out(pos.x(), inside.x()).max(out(pos.y(), inside.y())).max(up_m);
        volume_m.max(self.fence.beyond_m([pos.x(), pos.y()]))
    }

    /// Tilt by the board, else by the estimate, rad.
    fn tilt_rad(&self) -> f64 {
        let cos = match self.board.attitude {
            Some(a) if self.view.at.seconds_since(a.received_at) < ATTITUDE_AGE_S => {
                a.attitude.matrix()[(2, 2)]
            }
            _ => self.view.estimate.R_EB.matrix()[(2, 2)],
        };
        cos.clamp(-1.0, 1.0).acos()
    }
}

fn words_of_place(sight: &Sight<'_>) -> String {
    let pos = sight.view.estimate.pos_E_m;
    format!(
        "{:.1} m outside at N {:.1} E {:.1} height {:.1} m",
        sight.beyond_m(),
        pos.x(),
        pos.y(),
        -pos.z()
    )
}

/// Outside.
pub(super) const SOFT: Condition = Condition {
    name: "wall_soft",
    seen_by: "The vehicle is outside of the volume (`limits.north_m`, `east_m`, `height_m`) or of the fence by more \
              than 0.2 m. Setpoints never are. A point outside of the volume is refused in words; a velocity towards a \
              wall is braked. What a fence forbids is neither flown to nor through, in any mode: legs, missions and \
              returns that would lead there are not begun, and any other way ends 0.25 m before it (\"held back by the \
              fence\"). A return takes the nearest of home and rally points to which a straight way is free; without \
              one, or held back for 3 s, it lands here.",
    numbers: &[Number { key: "", value: |_| 0.2, unit: "m", origin: "noise of the estimate" }],
    lasts_s: |_| 0.1,
    watched: Watched::Air,
    because: "outside of the walls",
    over: "inside the walls again",
    health: S::MAV_SYS_STATUS_GEOFENCE,
    severity: Severity::Warning,
    is_seen: |sight| sight.is_placed() && sight.beyond_m() > 0.2,
    words: words_of_place,
    ..ROW
};

/// Far outside.
pub(super) const HARD: Condition = Condition {
    name: "wall_hard",
    seen_by: "The vehicle is outside of the volume or of the fence by more than \
              `supervisor.wall_hard_m`. A landing goes back inside while it sinks.",
    numbers: &[Number {
        key: "supervisor.wall_hard_m",
        value: |c| c.supervisor.wall_hard_m,
        unit: "m",
        origin: "error of the estimate near the floor, as for FENCE_STATUS",
    }],
    lasts_s: |_| 0.1,
    watched: Watched::Air,
    wanted: |c| c.supervisor.wall_hard.reaction(),
    because: "beyond the hard wall",
    over: "inside the hard wall again",
    health: S::MAV_SYS_STATUS_GEOFENCE,
    severity: Severity::Critical,
    is_seen: |sight| {
        sight.is_placed() && sight.beyond_m() > sight.view.config.supervisor.wall_hard_m
    },
    words: words_of_place,
    ..ROW
};

/// Leans too much.
pub(super) const TILT: Condition = Condition {
    name: "tilt_high",
    seen_by: "The vehicle leans more than `supervisor.tilt_most_deg`, by the board's own attitude (by \
              the estimate where the board tells none).",
    numbers: &[Number {
        key: "supervisor.tilt_most_deg",
        value: |c| c.supervisor.tilt_most_deg,
        unit: "deg",
        origin: "largest lean asked for (52 deg tested by the source) and its overshoot",
    }],
    lasts_s: |_| 0.15,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "tilt too high",
    over: "tilt is low again",
    severity: Severity::Emergency,
    is_seen: |sight| sight.tilt_rad() > sight.view.config.supervisor.tilt_most_deg.to_radians(),
    words: |sight| format!("tilt {:.0} deg", sight.tilt_rad().to_degrees()),
    ..ROW
};

/// Too fast.
pub(super) const SPEED: Condition = Condition {
    name: "speed_high",
    seen_by: "The estimated speed is beyond `supervisor.speed_most_mps`.",
    numbers: &[Number {
        key: "supervisor.speed_most_mps",
        value: |c| c.supervisor.speed_most_mps,
        unit: "m/s",
        origin: "half as much again as the fastest tilt step (4.1 m/s in the simulator)",
    }],
    lasts_s: |_| 0.3,
    watched: Watched::Air,
    wanted: |_| Reaction::Land,
    because: "too fast",
    over: "slow again",
    severity: Severity::Critical,
    is_seen: |sight| {
        sight.view.estimate.vel_B_mps.norm() > sight.view.config.supervisor.speed_most_mps
    },
    words: |sight| format!("speed {:.1} m/s", sight.view.estimate.vel_B_mps.norm()),
    ..ROW
};

/// A speed that cannot be.
pub(super) const LEAP: Condition = Condition {
    name: "speed_leaps",
    seen_by: "The estimated speed has grown by more than such a vehicle gains in 0.3 s: the estimate is wrong, and no \
              landing is flown by it.",
    numbers: &[Number {
        key: "",
        value: |_| LEAP_MPS,
        unit: "m/s",
        origin: "derived: free fall, and twice the hover thrust upwards, gain 2.9 m/s in that time",
    }],
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: a speed that cannot be",
    over: "",
    latched: true,
    health: S::MAV_SYS_STATUS_AHRS,
    severity: Severity::Emergency,
    is_seen: |sight| sight.flight.supervisor.speed.gained_mps > LEAP_MPS,
    words: |sight| {
        format!("speed grew by {:.1} m/s in 0.3 s", sight.flight.supervisor.speed.gained_mps)
    },
    ..ROW
};

const OFF_COURSE: Number = Number {
    key: "supervisor.off_course_m",
    value: |c| c.supervisor.off_course_m,
    unit: "m",
    origin: "four times the lag at cruise speed",
};

/// Led away by a loop that flies in another room.
pub(super) const ASTRAY: Condition = Condition {
    name: "driven_away",
    seen_by: "The vehicle is farther than half of `supervisor.off_course_m` from where it should be, and a wrong room \
              of `room_differs` is likelier than every sound one: the loop itself may drive it, and a landing would \
              fly by it.",
    numbers: &[OFF_COURSE],
    lasts_s: |_| 0.3,
    watched: Watched::In(&[Mode::Takeoff, Mode::Hold, Mode::Goto, Mode::Mission, Mode::Return]),
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: the loop drives it away",
    over: "",
    latched: true,
    severity: Severity::Emergency,
    is_seen: |sight| {
        let most_m = 0.5 * sight.view.config.supervisor.off_course_m;
        sight.navigation.rooms.is_in_doubt()
            && sight.flight.guidance.off_course_m(sight.view.estimate).is_some_and(|m| m > most_m)
    },
    words: |sight| {
        let away_m = sight.flight.guidance.off_course_m(sight.view.estimate).unwrap_or_default();
        format!("{away_m:.1} m away, perhaps driven there: {}", sight.navigation.rooms.words())
    },
    ..ROW
};

/// Elsewhere than it should be.
pub(super) const COURSE: Condition = Condition {
    name: "off_course",
    seen_by: "The vehicle is farther than `supervisor.off_course_m` from the point that is held or that \
              moves along its leg: wind, damage, or a board that does not obey. Not looked at while \
              setpoints jump (cruise speed at the controller's limit) or a tilt step is flown.",
    numbers: &[OFF_COURSE],
    lasts_s: |_| 1.0,
    watched: Watched::In(&[Mode::Hold, Mode::Goto, Mode::Mission, Mode::Return]),
    wanted: |_| Reaction::Land,
    because: "off course",
    over: "on course again",
    severity: Severity::Critical,
    is_seen: |sight| {
        sight
            .flight
            .guidance
            .off_course_m(sight.view.estimate)
            .is_some_and(|m| m > sight.view.config.supervisor.off_course_m)
    },
    words: |sight| {
        let away_m = sight.flight.guidance.off_course_m(sight.view.estimate).unwrap_or_default();
        format!("{away_m:.1} m away from where it should be")
    },
    ..ROW
};
