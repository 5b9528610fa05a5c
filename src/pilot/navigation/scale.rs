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
//! two. It is judged against what was usual in this flight in free air, since the thrust that hovers is hardly known before
//! it was learned. Where the board is known to obey late, e is also formed with the thrust of 0.15 s before, and the
//! larger one counts: a loop that swings over a late board reads no more than it sent.
//!
//! **Where the floor may be.** Below a height the floor may carry, and a reading counts only beyond what a touch-down makes
//! of it, 1.3 g. Where the estimate had the standing vehicle high up, or has it stay up while the thrust lets it fall, it does
//! not know the floor, and the vehicle does not slow down for it: all of its sinking may end at once there. Low-passed like f,
//! that is
//!
//! ```text
//! f ≤ g + w / T_f                   T_f time constant of the low-pass, s
//! ```
//! at most, and only more than that counts; w is that of the fall which the thrust allows, since the estimate is what is in doubt.
//! How far it fell unseen, v being the estimate's sinking speed:
//!
//! ```text
//! du/dt = w − v − u / T_u,  u ≥ 0   T_u how long an estimate is led astray before the thrust tells no more, s
//! ```
//!
//! Only a sensor that reads too much is looked for: nothing in the air carries so much more than the thrust, while less
//! lift than was sent is what damage makes as well (`lift_differs`).
//!
//! **Source.** Vertical balance as in `hover`; lag and drag from VEHICLE.md. **Validity.** Flight in free air, leaning
//! little. On the floor, which carries, a sensor that is right reads g and no more.

use haltere_core::frames::G_MPS2;

use super::Navigation;
use crate::flight::modes::Mode;
use crate::view::{HOVER_BOUNDS, View};

/// Lag of the wings, s, vertical drag, 1/s (middle of its range, VEHICLE.md), and the low-pass that the force has gone through, s.
pub(crate) const WINGS_S: f64 = 0.08;
pub(crate) const DRAG_PER_S: f64 = 0.8;
const FILTER_S: f64 = 0.15;
/// How long what it fell unseen is remembered, s: a thrust that is 3 % off what hovers makes 0.4 m/s of it in the end, and
/// so 0.4 m; a low hover among echoes was led 0.7 m down in 1 s.
const UNSEEN_S: f64 = 1.0;
/// What is usual is averaged over this time, s, once the vehicle is in free air. It begins, with the weight of a second,
/// with the least of the ratio, low-passed over wing beats, until then: a floor only adds to the force. Before the thrust that hovers is
/// learned it may be off by as much as the bounds of that.
const USUAL_S: f64 = 5.0;
const BEGIN_S: f64 = 1.0;
const BEATS_S: f64 = 0.3;
const USUAL: [f64; 2] = [1.0 / HOVER_BOUNDS[1], 1.0 / HOVER_BOUNDS[0]];
/// Ratio, over the usual one, that no sensor which is right has.
pub(crate) const MOST_RATIO: f64 = 1.33;
/// … and where a client or a joystick flies: thrown from wall to wall by leaning and pulling it reaches 1.4, a sensor that
/// reads twice the force 2, of which little may be waited for: it falls to the floor in half a second.
const MOST_RATIO_THROWN: f64 = 1.55;
/// Least force expected that is divided by, m/s².
const LEAST_MPS2: f64 = 0.2 * G_MPS2;
/// Where the floor may carry it must read more than this, m/s²: a touch-down of 0.4 m/s reads less.
const CARRIED_MPS2: f64 = 1.3 * G_MPS2;
/// Higher it flies freely, m, and in a landing, which ends on the floor and on tables, as long as it never came lower. There
/// neither estimate nor barometer is a witness of the height: of landings of `haltere-lab paper` that the floor carried
/// both had some 0.6 m, and the estimate rose again from there to 0.9 m, with 1.5 times the force of the thrust.
const CLEAR_M: f64 = 0.5;
const CLEAR_LANDING_M: f64 = 0.8;
/// More lean is not looked at, as its cosine (30 degrees), nor what follows it within this time, s: three times the
/// low-pass.
const LEVEL_COS: f64 = 0.866;
const AFTER_LEAN_S: f64 = 0.45;
/// A board whose attitude follows later than this, s, obeys late: 0.2 s in the nominal vehicle …
const PROMPT_S: f64 = 0.3;
/// … and may do so by as much as this and fly all the same: control steps of 10 ms.
const LATE_STEPS: usize = 15;
/// A pause of the loop, s: what was thought of the fall meanwhile is not true.
const PAUSE_S: f64 = 0.05;

/// What thrust alone makes of the force.
#[derive(Debug, Clone, Copy)]
struct Expected {
    wings: f64,
    sink_mps: f64,
    force_mps2: f64,
}

impl Expected {
    fn new(share: f64) -> Self {
        Self { wings: share, sink_mps: 0.0, force_mps2: G_MPS2 * share }
    }

    fn step(&mut self, share: f64, dt_s: f64) {
        let weight = |time_s: f64| dt_s / (time_s + dt_s);
        self.wings += (share - self.wings) * weight(WINGS_S);
        let force_mps2 = G_MPS2 * self.wings + DRAG_PER_S * self.sink_mps;
        self.sink_mps += (G_MPS2 - force_mps2) * dt_s;
        self.force_mps2 += (force_mps2 - self.force_mps2) * weight(FILTER_S);
    }
}

/// A control step.
#[derive(Debug, Clone, Copy)]
struct Step {
    /// Specific force upwards, low-passed, m/s².
    force_mps2: f64,
    /// Thrust over the one that hovers.
    share: f64,
    /// Sinking speed by the estimate, m/s.
    sink_mps: f64,
    /// Nothing but air carries it.
    free: bool,
    /// The estimate has it above the floor all the same: where that is nobody knows, nor slows down for it.
    floor_unknown: bool,
    /// It leans little, and is not held down.
    level: bool,
    /// The board's attitude shows that it obeys late.
    late: bool,
    /// Ratio, over the usual one, that is too much.
    most_ratio: f64,
}

/// What is followed.
#[derive(Debug, Default)]
pub(crate) struct Scale {
    /// By the thrust as it was sent, and as if it were obeyed late.
    expected: Option<[Expected; 2]>,
    /// The last shares, in a ring, and how many were taken in.
    shares: [f64; LATE_STEPS],
    taken: usize,
    /// The board was once seen to obey late.
    obeys_late: bool,
    /// Until the vehicle is in free air: the ratio, low-passed.
    slow: Option<f64>,
    usual: Option<f64>,
    free_s: f64,
    /// How long it will still not be looked at, s.
    leaned_s: f64,
    /// How low the landing under way has come by the estimate, m.
    lowest_m: Option<f64>,
    /// How high the estimate had the vehicle when it last stood, m.
    stood_m: f64,
    /// How far the thrust let it fall that the estimate did not see, m.
    unseen_m: f64,
    /// Specific force over the expected one, over the usual.
    pub ratio: f64,
    pub wrong: bool,
}

impl Scale {
    fn step(&mut self, step: Step, dt_s: f64) {
        let Step { force_mps2, share, sink_mps, free, floor_unknown, level, late, most_ratio } =
            step;
        self.obeys_late |= late;
        if !force_mps2.is_finite() || !share.is_finite() {
            return;
        }
        let slot = self.taken % LATE_STEPS;
        let late_share = match self.taken {
            0 => share,
            1..LATE_STEPS => self.shares[0],
            _ => self.shares[slot],
        };
        self.shares[slot] = share;
        self.taken += 1;
        let [at_once, later] = self.expected.get_or_insert([Expected::new(share); 2]);
        at_once.step(share, dt_s);
        later.step(late_share, dt_s);
        let unseen_mps = at_once.sink_mps - sink_mps - self.unseen_m / UNSEEN_S;
        self.unseen_m = (self.unseen_m + unseen_mps * dt_s).max(0.0);
        let most_mps2 = if self.obeys_late { later.force_mps2 } else { 0.0 };
        let expected_mps2 = at_once.force_mps2.max(most_mps2).max(LEAST_MPS2);
        self.leaned_s = if level { self.leaned_s - dt_s } else { AFTER_LEAN_S };
        if self.leaned_s > 0.0 {
            self.wrong = false;
            return;
        }
        let ratio = force_mps2 / expected_mps2;
        let known = self.usual.filter(|_| free || self.free_s > 0.0);
        // What a weak pack or worn wings carry less is no reason to call a full thrust too much.
        self.ratio = ratio / known.unwrap_or(1.0).max(1.0);
        // A floor that nobody knows may end all of the sinking at once (*Where the floor may be*).
        let met_mps2 = if floor_unknown { G_MPS2 + at_once.sink_mps / FILTER_S } else { 0.0 };
        self.wrong = self.ratio > most_ratio && (free || force_mps2 > CARRIED_MPS2.max(met_mps2));
        self.learn(ratio.clamp(USUAL[0], USUAL[1]), free, dt_s);
    }

    /// How low this landing has come, with the height of now, m.
    fn lowest_since_m(&mut self, height_m: f64) -> f64 {
        let lowest_m = self.lowest_m.map_or(height_m, |lowest_m| lowest_m.min(height_m));
        self.lowest_m = Some(lowest_m);
        lowest_m
    }

    fn learn(&mut self, ratio: f64, free: bool, dt_s: f64) {
        if free {
            self.free_s += dt_s;
            let usual = self.usual.get_or_insert(ratio);
            *usual += (ratio - *usual) * dt_s / (self.free_s + BEGIN_S).min(USUAL_S);
        } else if self.free_s == 0.0 {
            let slow = self.slow.get_or_insert(ratio);
            *slow += (ratio - *slow) * dt_s / (BEATS_S + dt_s);
            self.usual = Some(self.usual.map_or(*slow, |least| least.min(*slow)));
        }
    }
}

impl Navigation {
    /// Follows the scale wherever the loop flies, and what a descent would begin with.
    pub(crate) fn watch_scale(&mut self, view: &View<'_>, dt_s: f64) {
        let hover_frac = view.thrust.hover_frac * view.thrust.ground_factor;
        let obeys = view.board.obeys && !view.board.is_late;
        if view.stands {
            self.scale.stood_m = view.height_above_floor_m();
        }
        let stood_m = self.scale.stood_m;
        if !view.mode.is_flying() || !obeys || hover_frac < 0.05 || dt_s >= PAUSE_S {
            self.scale = Scale { stood_m, ..Scale::default() };
            self.before.forget();
            return;
        }
        let share = view.thrust.sent_frac / hover_frac;
        let (height_m, sink_mps) = (view.height_above_floor_m(), view.estimate.vel_E_mps().z());
        self.before.note(height_m, sink_mps, share, dt_s);
        let baro_m = self.baro_above_floor_m(view);
        let clear = match view.mode {
            // An estimate that is wrong on the floor is so before the take-off.
            Mode::Takeoff => baro_m.is_some_and(|baro_m| baro_m > CLEAR_M),
            // On the floor the estimate may rise again: what carries it is taken for thrust.
            Mode::Land => self.scale.lowest_since_m(height_m) > CLEAR_LANDING_M,
            _ => true,
        };
        if view.mode != Mode::Land {
            self.scale.lowest_m = None;
        }
        // Among echoes near the floor it stands on it at 1 m, and was led onto it at 0.9 m with 0.6 to 1 m/s. Where the filter
        // learned on the floor what they do there, it stands at 0 m, and the same happens from a low hover.
        let floor_m = if stood_m > CLEAR_M { stood_m } else { 0.0 };
        // An estimate that is led upwards meets the floor as well: the lower of the two heights counts.
        let low_m = baro_m.map_or(height_m, |baro_m| height_m.min(baro_m));
        let above_m = low_m - floor_m - self.scale.unseen_m;
        let level = view.board.attitude.map_or(1.0, |board| board.attitude.matrix()[(2, 2)]);
        let step = Step {
            force_mps2: -self.touch.acc_z_mps2,
            share,
            sink_mps,
            free: clear && above_m > CLEAR_M && self.touch.ceiling_frac.is_none(),
            floor_unknown: above_m <= CLEAR_M && (floor_m > 0.0 || height_m > CLEAR_M),
            // Held below what carries it meets the floor harder than any landing.
            level: level > LEVEL_COS && self.touch.low_frac.is_none(),
            late: view.board.response_lag_s.is_some_and(|lag_s| lag_s > PROMPT_S),
            most_ratio: match view.mode {
                Mode::Offboard | Mode::Manual => MOST_RATIO_THROWN,
                _ => MOST_RATIO,
            },
        };
        self.scale.step(step, dt_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hovering.
    const STEP: Step = Step {
        force_mps2: G_MPS2,
        share: 1.0,
        sink_mps: 0.0,
        free: true,
        floor_unknown: false,
        level: true,
        late: false,
        most_ratio: MOST_RATIO,
    };

    /// Control steps of 10 ms with a sensor that reads so many times the force, below a loop that answers what it reads
    /// with the opposite thrust. After how many it is wrong for 0.06 s, if ever.
    fn found_after(times: f64, step: Step) -> Option<usize> {
        let mut scale = Scale::default();
        let (mut share, mut wings, mut sink_mps, mut force_mps2) = (1.0_f64, 1.0, 0.0, G_MPS2);
        let mut wrong = 0;
        for n in 0..1000 {
            let times = if n < 500 { 1.0 } else { times };
            wings += (share - wings) * (0.01 / (WINGS_S + 0.01));
            let true_mps2 = G_MPS2 * wings + DRAG_PER_S * sink_mps;
            sink_mps += (G_MPS2 - true_mps2) * 0.01;
            force_mps2 += (times * true_mps2 - force_mps2) * (0.01 / (FILTER_S + 0.01));
            scale.step(Step { force_mps2, share, ..step }, 0.01);
            // An inner loop on what is read: half of the surplus is cut.
            share = (1.0 - 0.5 * (force_mps2 / G_MPS2 - 1.0)).clamp(0.3, 1.5);
            wrong = if scale.wrong { wrong + 1 } else { 0 };
            if wrong == 6 {
                return Some(n - 500);
            }
        }
        None
    }

    #[test]
    fn prop_a_loop_that_follows_the_reading_does_not_hide_its_scale() {
        assert_eq!(found_after(1.0, STEP), None);
        assert_eq!(found_after(1.15, STEP), None, "that much healthy flights have");
        for (times, most) in [(1.5, 35), (2.0, 20), (4.0, 12)] {
            let steps = found_after(times, STEP);
            assert!(steps.is_some_and(|n| n < most), "{times}: {steps:?}");
        }
    }

    #[test]
    fn prop_what_the_floor_carries_is_no_scale() {
        // Thrust goes down to nothing, and gravity is felt all the same.
        let mut scale = Scale::default();
        for n in 0..300 {
            let share = 1.0 - f64::from(n) * 0.003;
            scale.step(Step { share, free: false, ..STEP }, 0.01);
            assert!(!scale.wrong, "{share}");
        }
    }

    #[test]
    fn regress_a_floor_that_is_met_where_the_estimate_said_it_stood_is_no_scale() {
        let near = Step { free: false, floor_unknown: true, ..STEP };
        // It sinks with 0.4 of the thrust that hovers for 0.3 s, and stands.
        let (mut scale, mut force_mps2) = (Scale::default(), G_MPS2);
        let (mut wings, mut sink_mps) = (1.0_f64, 0.0_f64);
        let mut most_mps2 = 0.0_f64;
        for n in 0..100 {
            let share = if n < 30 { 1.0 } else { 0.4 };
            wings += (share - wings) * (0.01 / (WINGS_S + 0.01));
            let true_mps2 = if n < 60 {
                let air_mps2 = G_MPS2 * wings + DRAG_PER_S * sink_mps;
                sink_mps += (G_MPS2 - air_mps2) * 0.01;
                air_mps2
            } else {
                G_MPS2 + std::mem::take(&mut sink_mps) / 0.01
            };
            force_mps2 += (true_mps2 - force_mps2) * (0.01 / (FILTER_S + 0.01));
            scale.step(Step { force_mps2, share, ..near }, 0.01);
            most_mps2 = most_mps2.max(force_mps2);
            assert!(!scale.wrong, "{n}: {force_mps2}");
        }
        assert!(most_mps2 > CARRIED_MPS2, "{most_mps2}");
        // A sensor that reads too much in a hover is found all the same.
        for times in [1.5, 2.0, 4.0] {
            assert_eq!(found_after(times, near), found_after(times, Step { free: false, ..STEP }));
            assert!(found_after(times, near).is_some_and(|n| n < 35), "{times}");
        }
    }
}
