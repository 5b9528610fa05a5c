//! The way down without an estimate: level, by thrust model and barometer.
//!
//! **Law.** Height h and sinking speed w are carried on by the thrust that was sent, and drawn to the
//! barometer, with a third state b for what the thrust model gets wrong:
//!
//! ```text
//! dh/dt = −w + 3 ω e             e = h_baro − h
//! dw/dt = g (1 − u) − d w + b − 3 ω² e
//! db/dt = −ω³ e
//! u     = 1 − d w*/g + (w − w*) K          w* the speed wanted
//! ```
//! u thrust over the thrust that hovers (`hover`), d vertical drag, 1/s. Without a barometer e = 0 and u is
//! [`BLIND_SHARE`]: a model that is wrong by 3 % would hover for ever if it were believed.
//!
//! **Late links.** w is the model's, so that the gain K closes no loop over the link; what does is the observer, at
//! ω: its corrections arrive with 37 degrees less of phase where barometer and thrust are 0.4 s late each.
//!
//! **Source.** Vertical balance as in `hover`; a Luenberger observer with three equal poles. **Validity.**
//! Nearly level; a barometer whose error moves slower than 1/ω. Attitude is the board's.

use haltere_core::frames::G_MPS2;

/// Vertical drag, 1/s: middle of its range (VEHICLE.md).
const DRAG_PER_S: f64 = 0.8;
/// Poles of the observer, 1/s: slower than the noise of a barometer in the wash of wings, faster than the
/// way down.
const POLES_RADPS: f64 = 0.8;
/// Speed that is wanted high above the floor, near it, m/s, and where "near" begins, m.
const SINK_MPS: f64 = 0.8;
const SINK_SLOW_MPS: f64 = 0.45;
const SLOW_BELOW_M: f64 = 1.2;
/// Thrust share per error of the sinking speed, 1/(m/s).
const GAIN_S_PER_M: f64 = 0.12;
/// Bounds of the thrust share. The lower one is far below what a sound vehicle needs: ground effect, a
/// draught from below and a hover thrust that was learned from a wrong estimate all carry.
const SHARES: [f64; 2] = [0.6, 1.05];
/// The upper one while the link is late …
const LATE_MOST: f64 = 1.0;
/// … and near the floor, where the ground effect carries a fifth more, while no accelerometer tells of the floor, or what
/// is sent comes late.
const MOST_LOW: f64 = 0.84;
/// Share without a barometer. With a drag of 0.65 to 1 1/s a deficit of 8 % sinks at 0.8 to 1.2 m/s.
const BLIND_SHARE: f64 = 0.92;
/// Where the accelerometer does not tell of the floor either, so much of the share is taken away per second from the
/// moment on in which the floor may have come, down to what the ground effect hardly throws up ([`MOST_LOW`]); and from
/// the moment on in which it should have come, down to the least with which a search for the floor ends. That only from so
/// low, m, that a descent which is slower than this, m/s, falls no more than half a metre then.
const BLIND_PER_S: f64 = 0.15;
const BLIND_LEAST: f64 = 0.55;
const BLIND_FROM_M: f64 = 1.5;
const BLIND_MPS: f64 = 0.65;
/// A vehicle that rises when the way down begins comes to its speed upward times this higher, s: h = h₀ + T w₀, with T below
/// the time constant 1/d of the drag (1.5 s for 0.65 1/s), since thrust falls short of the weight as well. In lockstep
/// 1.26 m/s carried it 1.35 m further.
const RISES_FOR_S: f64 = 1.2;
/// Largest error of the thrust model that is believed, m/s².
const BIAS_MPS2: f64 = 4.0;
/// A barometer that says this much else than expected is not believed, m.
const BELIEF_M: f64 = 3.0;
/// … unless it stays there for so long, s.
const DISBELIEF_S: f64 = 1.0;
/// Share of thrust taken away with every search in vain, and most of it: what hovers near the floor is
/// carried by the ground effect.
const PUSH: f64 = 0.04;
const PUSH_MOST: f64 = 0.16;
/// A barometer that was silent for longer is none, s.
const SILENT_S: f64 = 0.5;
/// Slowest descent for working out when the floor must have come, m/s, and the time to gather speed, s: a
/// cut too early is a fall, one too late costs seconds on the floor.
const SLOWEST_MPS: f64 = 0.35;
/// … over a late link, where no faster one is wanted than near the floor.
const SLOWEST_LATE_MPS: f64 = 0.25;
const START_S: f64 = 2.0;
/// The height at its beginning may be wrong by this, m.
const MARGIN_M: f64 = 0.3;
/// Above this height by a barometer that lives the floor need not have come, m.
const HIGH_M: f64 = 0.6;
/// With such a barometer it may take so many times longer.
const BARO_SLACK: f64 = 4.0;
/// Longest descent, s: 15 m at the slowest.
pub(crate) const LONGEST_S: f64 = 40.0;
/// Near the floor the ground effect can carry a small deficit. In the end thrust goes down to nothing
/// within this time, s.
const FADE_S: f64 = 3.0;
/// Below this height by its own account the floor is felt for, m.
const FEEL_BELOW_M: f64 = 0.8;
/// Slower than this it hardly sinks, m/s.
const HELD_UP_MPS: f64 = 0.2;

/// A descent under way.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Descent {
    /// Height above the floor, m, and sinking speed, m/s, by its own account.
    pub height_m: f64,
    pub sink_mps: f64,
    bias_mps2: f64,
    /// Height at its beginning, m: as measured, and the most that it may rise to.
    known_m: f64,
    from_m: f64,
    elapsed_s: f64,
    /// Barometric height minus ours, at the first sample, m: only differences are used.
    zero_m: Option<f64>,
    baro_age_s: f64,
    last_baro_m: Option<f64>,
    /// For how long the barometer has not been believed, s.
    disbelief_s: f64,
    /// Thrust share that is taken away because the floor was felt for and not found.
    push: f64,
    /// The link is late now.
    pub late: bool,
    /// Nothing tells of the floor: by the accelerometer.
    pub numb: bool,
    /// Share that is taken away since the floor should have come.
    taken: f64,
}

impl Descent {
    /// From a height above the floor, m, with a sinking speed, m/s.
    pub fn begin(height_m: f64, sink_mps: f64) -> Self {
        let height_m = if height_m.is_finite() { height_m.max(0.0) } else { 0.0 };
        let sink_mps = if sink_mps.is_finite() { sink_mps.clamp(-2.0, 2.0) } else { 0.0 };
        let from_m = height_m + RISES_FOR_S * (-sink_mps).max(0.0);
        let known_m = from_m;
        Self { height_m, sink_mps, known_m, from_m, baro_age_s: f64::INFINITY, ..Self::default() }
    }

    /// It may rise with this speed, m/s, whatever was measured when it began.
    pub fn may_rise(&mut self, up_mps: f64) {
        self.from_m = self.from_m.max(self.height_m + RISES_FOR_S * up_mps);
    }

    /// A barometric height, m, from any zero.
    pub fn baro(&mut self, height_m: f64, dt_s: f64) {
        // A sensor that works never says the same to the last bit for long.
        if self.last_baro_m.replace(height_m) == Some(height_m) {
            return;
        }
        let zero_m = *self.zero_m.get_or_insert(height_m - self.height_m);
        let e_m = height_m - zero_m - self.height_m;
        if e_m.abs() > BELIEF_M || !e_m.is_finite() {
            // A spike passes. What stays is another zero, or a height that is not what it was taken for:
            // from here on its changes count.
            self.disbelief_s += dt_s.clamp(0.0, 0.1);
            if self.disbelief_s > DISBELIEF_S {
                self.zero_m = Some(height_m - self.height_m);
                self.disbelief_s = 0.0;
            }
            return;
        }
        self.disbelief_s = 0.0;
        self.baro_age_s = 0.0;
        let dt_s = dt_s.clamp(0.0, 0.1);
        let w = POLES_RADPS;
        self.height_m += 3.0 * w * e_m * dt_s;
        self.sink_mps -= 3.0 * w * w * e_m * dt_s;
        self.bias_mps2 = (self.bias_mps2 - w * w * w * e_m * dt_s).clamp(-BIAS_MPS2, BIAS_MPS2);
    }

    /// Thrust over the hover thrust for the next step. `None`: it is over, the floor must have come.
    pub fn step(&mut self, dt_s: f64) -> Option<f64> {
        self.elapsed_s += dt_s;
        self.baro_age_s += dt_s;
        // Over a late link there is no time to brake.
        let fast = self.height_m > SLOW_BELOW_M && !self.late;
        let wanted_mps = if fast { SINK_MPS } else { SINK_SLOW_MPS };
        let share = if self.baro_age_s < SILENT_S {
            let held = 1.0 - (DRAG_PER_S * wanted_mps - self.bias_mps2) / G_MPS2;
            (held + GAIN_S_PER_M * (self.sink_mps - wanted_mps)).clamp(SHARES[0], self.most_share())
        } else {
            BLIND_SHARE
        };
        let has_come = |from_m: f64| self.elapsed_s > from_m / BLIND_MPS;
        if self.numb && self.baro_age_s >= SILENT_S && has_come(self.known_m) {
            let surely = self.known_m < BLIND_FROM_M && has_come(self.from_m);
            let most = if surely { f64::INFINITY } else { BLIND_SHARE - MOST_LOW };
            self.taken = (self.taken + BLIND_PER_S * dt_s).min(most.max(self.taken));
            if share - self.taken < BLIND_LEAST {
                return None;
            }
        }
        let share = (share - self.push - self.taken).max(BLIND_LEAST);
        let acc_mps2 = G_MPS2 * (1.0 - share) - DRAG_PER_S * self.sink_mps + self.bias_mps2;
        self.sink_mps += acc_mps2 * dt_s;
        self.height_m -= self.sink_mps * dt_s;
        let fade = 1.0 - (self.elapsed_s - self.longest_s()).max(0.0) / FADE_S;
        (fade > 0.0).then_some(share * fade)
    }

    /// Most thrust share. What brakes when the vehicle has met the floor throws it up, since the cushion there carries a
    /// tenth more: by 0.8 m over a late link, by 0.5 m where no accelerometer tells of the floor.
    fn most_share(&self) -> f64 {
        let low = self.height_m < FEEL_BELOW_M;
        if low && (self.late || self.numb) {
            MOST_LOW
        } else if self.late {
            LATE_MOST
        } else {
            SHARES[1]
        }
    }

    /// When the floor must have come, s.
    fn longest_s(&self) -> f64 {
        // A barometer that lives and says that it is high up may be right.
        let high = self.baro_age_s < SILENT_S && self.height_m > HIGH_M;
        let slack = if high { BARO_SLACK } else { 1.0 };
        let slowest_mps = if self.late { SLOWEST_LATE_MPS } else { SLOWEST_MPS };
        (((self.from_m + MARGIN_M) / slowest_mps + START_S) * slack).min(LONGEST_S)
    }

    /// Whether something carries it that a descent in free air has not: with less than `least_share`, the share that
    /// holds it up there, it would sink faster.
    pub fn is_held_up(&self, share: f64, least_share: f64) -> bool {
        self.baro_age_s < SILENT_S && share < least_share && self.sink_mps < HELD_UP_MPS
    }

    /// The floor was felt for and the vehicle began to fall.
    pub fn floor_not_found(&mut self) {
        self.push = (self.push + PUSH).min(PUSH_MOST);
    }

    /// Whether the floor may be near, so that it can be felt for.
    pub fn is_low(&self) -> bool {
        self.height_m < FEEL_BELOW_M || self.elapsed_s > 0.5 * self.longest_s()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Speed at the floor and time of the way down; `k` is the true hover thrust over the one believed,
    /// `baro`: what the barometer adds to the height at a time.
    fn fly(from_m: f64, k: f64, d: f64, baro: Option<fn(f64) -> f64>) -> (f64, f64) {
        fly_on(Descent::begin(from_m, 0.0), k, d, baro)
    }

    fn fly_on(mut descent: Descent, k: f64, d: f64, baro: Option<fn(f64) -> f64>) -> (f64, f64) {
        let from_m = descent.height_m;
        let (mut h, mut w, mut t, mut u) = (from_m, 0.0, 0.0, 1.0);
        while h > 0.0 {
            let low = descent.height_m < FEEL_BELOW_M && descent.baro_age_s < 0.4;
            let Some(share) = descent.step(0.01) else { return (w, t) };
            // The cushion of the floor carries a fifth more.
            assert!(!descent.numb || !low || share * 1.2 < 1.02, "{share}");
            if let Some(error) = baro {
                descent.baro(h + 101.0 + error(t), 0.01);
            }
            u += (share / k - u) * 0.1; // the lag of thrust
            w += 0.01 * (G_MPS2 * (1.0 - u) - d * w);
            h -= 0.01 * w;
            t += 0.01;
            assert!(t < 60.0);
        }
        (w, t)
    }

    #[test]
    fn prop_with_a_barometer_it_comes_down_gently_whatever_the_hover_thrust() {
        for from_m in [0.7, 1.2, 3.0, 6.0, 12.0] {
            for k in [0.9, 0.95, 1.0, 1.05, 1.1] {
                for d in [0.65, 0.8, 1.0] {
                    let (w, t) = fly(from_m, k, d, Some(|_| 0.0));
                    assert!((0.05..1.5).contains(&w), "{from_m} m, k {k}, d {d}: {w} m/s, {t} s");
                }
            }
        }
    }

    /// Speed at the floor and the fastest on the way, m/s, where thrust arrives so late at the board and the barometer
    /// so late from it, s.
    fn fly_late(from_m: f64, from_mps: f64, k: f64, late_s: [f64; 2]) -> (f64, f64) {
        let [mut thrusts, mut heights] = late_s
            .map(|s| std::collections::VecDeque::from(vec![None; (s * 100.0).round() as usize]));
        let mut descent = Descent::begin(from_m, from_mps);
        descent.late = late_s[0] + late_s[1] > 0.0;
        let (mut h, mut w, mut u, mut fastest) = (from_m, from_mps, 1.0, 0.0_f64);
        for n in 0..4000 {
            let Some(share) = descent.step(0.01) else { return (w, fastest) };
            thrusts.push_back(Some(share));
            // Until the first arrives the board flies what it was told before.
            let acts = thrusts.pop_front().flatten().unwrap_or(1.0);
            heights.push_back(Some(h + 0.001 * (f64::from(n) * 1.7).sin()));
            if let Some(seen_m) = heights.pop_front().flatten() {
                descent.baro(seen_m + 101.0, 0.01);
            }
            u += (acts / k - u) * 0.1;
            w += 0.01 * (G_MPS2 * (1.0 - u) - 0.8 * w);
            h -= 0.01 * w;
            fastest = fastest.max(w);
            if h <= 0.0 {
                return (w, fastest);
            }
        }
        panic!("{from_m} m, {from_mps} m/s, {k}, {late_s:?}: never down, {h} m");
    }

    #[test]
    fn regress_a_late_link_does_not_make_the_descent_swing() {
        let mut worst = (0.0_f64, 0.0_f64);
        for from_m in [0.7, 1.2, 3.0, 6.0] {
            for from_mps in [-0.5, 0.0, 0.8] {
                for k in [0.95, 1.0, 1.05] {
                    for late_s in
                        [[0.1, 0.0], [0.4, 0.0], [0.0, 0.4], [0.2, 0.2], [0.3, 0.3], [0.4, 0.4]]
                    {
                        let (w, fastest) = fly_late(from_m, from_mps, k, late_s);
                        let said =
                            format!("{from_m} m {from_mps} m/s {k} {late_s:?}: {w} {fastest}");
                        assert!(w < 1.5 && fastest < 1.7, "{said}");
                        worst = (worst.0.max(w), worst.1.max(fastest));
                    }
                }
            }
        }
        println!("at the floor {:.2} m/s at most, {:.2} on the way", worst.0, worst.1);
    }

    #[test]
    fn regress_where_no_accelerometer_tells_of_the_floor_it_does_not_throw_the_vehicle_up() {
        for from_m in [0.3, 1.2, 3.0] {
            for k in [0.95, 1.0, 1.05] {
                for d in [0.65, 0.8, 1.0] {
                    let descent = Descent { numb: true, ..Descent::begin(from_m, 0.0) };
                    let (w, t) = fly_on(descent, k, d, Some(|_| 0.0));
                    assert!((0.05..1.8).contains(&w), "{from_m} m, k {k}, d {d}: {w} m/s, {t} s");
                }
            }
        }
    }

    #[test]
    fn prop_a_barometer_that_errs_does_not_make_it_fall() {
        let errors: [fn(f64) -> f64; 4] = [
            |t| 0.2 * t,
            |t| -0.2 * t,
            |t| 0.5 * (1.5 * t).sin(),
            |t| if t > 1.0 { 40.0 } else { 0.0 },
        ];
        for (n, error) in errors.into_iter().enumerate() {
            for from_m in [1.2, 3.0] {
                let (w, t) = fly(from_m, 1.0, 0.8, Some(error));
                assert!((0.0..1.6).contains(&w), "error {n} from {from_m} m: {w} m/s after {t} s");
            }
        }
    }

    #[test]
    fn prop_without_a_barometer_the_thrust_model_brings_it_down() {
        for from_m in [0.3, 1.2, 3.0, 6.0] {
            for k in [0.98, 1.0, 1.03] {
                let (w, t) = fly(from_m, k, 0.8, None);
                assert!((0.2..1.8).contains(&w), "{from_m} m, k {k}: {w} m/s after {t} s");
            }
        }
    }

    #[test]
    fn prop_it_ends() {
        // On the floor all the while: the barometer says so, and the time is bounded.
        let mut descent = Descent::begin(3.0, 0.0);
        let mut t = 0.0_f64;
        while descent.step(0.01).is_some() {
            // Noise of a barometer that stays where it is.
            descent.baro(5.0 + 0.01 * (97.0 * t).sin(), 0.01);
            t += 0.01;
            assert!(t < 45.0);
        }
        assert!(Descent::begin(f64::NAN, f64::INFINITY).step(0.01).is_some());
    }

    #[test]
    fn prop_a_barometer_that_is_stuck_is_none() {
        let (mut stuck, mut blind) = (Descent::begin(2.0, 0.0), Descent::begin(2.0, 0.0));
        stuck.baro(3.0, 0.01);
        for n in 0..400 {
            stuck.baro(3.0, 0.01);
            let (a, b) = (stuck.step(0.01), blind.step(0.01));
            assert!(n < 60 || a == b, "{n}: {a:?} {b:?}");
        }
    }
}
