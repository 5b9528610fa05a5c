//! Drag feed-forward: the lean that holds a velocity against drag, known before an error shows.
//!
//! **Equation.** The source writes `v(θ) = a + b·e^(−c·θ)` and starts from a = −90, b = 90,
//! c = 0.3. Read literally, with θ in degrees and v in m/s, one degree of nose-down is then worth
//! 31 m/s. The numbers make sense the other way round, as the angle in degrees over the speed:
//!
//! ```text
//! θ(v) = a + b·e^(−c·v)        1 m/s: −23.3°,  2 m/s: −40.6°
//! ```
//!
//! which is drag, linear in body velocity: along body x thrust drops out of the balance and
//! `g·sin θ = k·u`, `u = v·cos θ` leave `tan θ = k·v/g`; with k = 4.2 1/s that is 23.2° and 40.6°.
//! Both readings are here, see [`DragReading`]; the first is the default.
//!
//! **Sign.** In both readings θ is the pitch that flies forward, so it is negative. Called *lean*
//! below is −θ ≥ 0: towards the motion. `pitch_ff = −lean(v_x)`, `roll_ff = +lean(v_y)`, odd in v.
//!
//! **Symbols.** v speed along one heading axis, m/s; θ, a, b degrees and c s/m in the first
//! reading; a, b m/s and c 1/degree in the second.
//!
//! **Source.** The source's drag law; drag 4.2 and 1.9 1/s from published fits on recorded flights
//! (3.4 to 4.2 forward, 1.85 to 2.1 sideways). **Validity.** Drag linear up to about 2 m/s; angles
//! tested to 52°. **Left out.** Wind, turning, drag of climbing.

use serde::{Deserialize, Serialize};

use crate::checks::Problems;
use crate::choices;

/// Largest lean the source tested, degrees: nothing here or above asks for more.
pub const TESTED_LEAN_DEG: f64 = 52.0;
/// Below this speed an offset of the law at rest (a + b ≠ 0) is faded in, m/s: an odd function
/// with a jump at zero would rattle the attitude in hover. Half the velocity noise of the filter.
const FADE_MPS: f64 = 0.1;
/// Largest offset of the law at rest that a fit may leave, degrees.
const MAX_OFFSET_DEG: f64 = 5.0;
/// The lean at 1 m/s must lie in here, degrees: 1° is drag of 0.17 1/s, 45° of 9.8 1/s.
const LEAN_AT_1_MPS_DEG: std::ops::RangeInclusive<f64> = 1.0..=45.0;

/// Which way the source's saturating exponential is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DragReading {
    /// Angle in degrees over speed in m/s: the reading in which the source's numbers make sense.
    #[default]
    AngleOfVelocity,
    /// Speed in m/s over angle in degrees, as printed; inverted for use.
    VelocityOfAngle,
}

crate::keys! {
    /// θ(v) = a + b·e^(−c·v), angle in degrees (negative leans into the motion), speed in m/s.
    #[derive(Copy)]
    pub struct AngleOfVelocity whole {
        /// Angle approached at high speed, negative.
        a_deg: f64 = -90.0, [-ASYMPTOTE_MOST_DEG..=0.0, "deg"];
        /// What is missing from it at rest: −a, unless a fit says otherwise.
        b_deg: f64 = 90.0, [0.0..=ASYMPTOTE_MOST_DEG, "deg"];
        /// How fast the angle is approached.
        c_s_per_m: f64 = 0.3, [0.001..=5.0, "s/m"];
    }
}

crate::keys! {
    /// v(θ) = a + b·e^(−c·θ), speed in m/s, angle in degrees (negative leans into the motion).
    ///
    /// a < 0, b > 0, c > 0: speed grows ever faster with lean (as `tan` does). a > 0, b < 0, c < 0:
    /// speed saturates at a; at and beyond that speed the lean is the configured limit.
    #[derive(Copy)]
    pub struct VelocityOfAngle whole {
        /// Constant part.
        a_mps: f64 = -2.5544, [-100.0..=100.0, "m/s"];
        /// Exponential part: −a, unless a fit says otherwise.
        b_mps: f64 = 2.5544, [-100.0..=100.0, "m/s"];
        /// Exponent per degree.
        c_per_deg: f64 = 0.01425, [-1.0..=1.0, "1/deg"];
    }
}

impl AngleOfVelocity {
    /// Lean at this speed (≥ 0), degrees, without limits.
    pub fn lean_deg(&self, speed_mps: f64) -> f64 {
        -(self.a_deg + self.b_deg * (-self.c_s_per_m * speed_mps).exp())
    }
}

impl VelocityOfAngle {
    /// Speed that this lean (≥ 0, degrees) holds, m/s.
    pub fn speed_mps(&self, lean_deg: f64) -> f64 {
        self.a_mps + self.b_mps * (self.c_per_deg * lean_deg).exp()
    }

    /// Lean at this speed (≥ 0), degrees: the inverse of [`Self::speed_mps`]. Infinite at and
    /// beyond the asymptote, where no lean is enough; callers limit.
    pub fn lean_deg(&self, speed_mps: f64) -> f64 {
        let share = (speed_mps - self.a_mps) / self.b_mps;
        if share > 0.0 { share.ln() / self.c_per_deg } else { f64::INFINITY }
    }
}

crate::keys! {
    /// Parameters of the drag feed-forward, key `control.drag`.
    #[derive(Copy)]
    pub struct DragConfig {
        /// angle_of_velocity uses pitch and roll; velocity_of_angle uses pitch_inverse and roll_inverse.
        reading: DragReading = DragReading::AngleOfVelocity,
            DRG_READING(85, OnFloor, "Which of the two laws is used: DRG_PIT and DRG_ROL, or DRG_IPT and DRG_IRL.");
        /// Largest feed-forward angle per axis.
        limit_deg: f64 = 45.0, [0.0..=TESTED_LEAN_DEG, "deg"], DRG_LIMIT(98, OnFloor);
        /// Time constant of the low-pass between velocity setpoint and feed-forward.
        // About half the lag of attitude and body: fast enough to lead the velocity, slow
        // enough that a step of the setpoint does not throw the whole angle in one step.
        filter_s: f64 = 0.1, [0.0..=2.0, "s"], DRG_FILTER_T(99, OnFloor);
        /// Time constant of the velocity that the integrators expect of the feed-forward.
        ///
        /// They see the setpoint through this low-pass, or they would add up the same lean once more.
        // Closed velocity loop with feed-forward. In `closed_loop`, with gains found for raw:
        // 0 s overshoots (1 m steps 0.16 m mean error), 0.2 s does not (0.12 m), 0.6 s lags.
        integral_reference_s: f64 = 0.2, [0.0..=2.0, "s"], DRG_INT_REF_T(100, OnFloor);
    } sections {
        /// Forward: θ = a + b·e^(−c·v), the source's starting values.
        pitch: AngleOfVelocity,
            DRG_PIT_A(86, OnFloor, "Lean forward over speed v is a + b exp(-c v): a."),
            DRG_PIT_B(87, OnFloor, "Lean forward over speed v is a + b exp(-c v): b."),
            DRG_PIT_C(88, OnFloor, "Lean forward over speed v is a + b exp(-c v): c.");
        /// Sideways: as forward, with the smaller drag of that axis.
        // Same asymptote (thrust horizontal); c by least squares against atan(1.9·v/g) over
        // 0 to 2 m/s, largest error 0.3°: `val_roll_law_is_the_published_sideways_drag`.
        roll: AngleOfVelocity = AngleOfVelocity { a_deg: -90.0, b_deg: 90.0, c_s_per_m: 0.132 },
            DRG_ROL_A(89, OnFloor, "Lean sideways over speed v is a + b exp(-c v): a."),
            DRG_ROL_B(90, OnFloor, "Lean sideways over speed v is a + b exp(-c v): b."),
            DRG_ROL_C(91, OnFloor, "Lean sideways over speed v is a + b exp(-c v): c.");
        /// Forward in the other reading: v = a + b·e^(−c·θ).
        // v = g·tan θ/k grows ever faster, so a < 0 < c; a and c from atan(k·v/g) at 1 and
        // 2 m/s: `val_both_readings_hold_the_same_drag`.
        pitch_inverse: VelocityOfAngle,
            DRG_IPT_A(92, OnFloor, "Speed forward over lean q is a + b exp(-c q): a."),
            DRG_IPT_B(93, OnFloor, "Speed forward over lean q is a + b exp(-c q): b."),
            DRG_IPT_C(94, OnFloor, "Speed forward over lean q is a + b exp(-c q): c.");
        /// Sideways in the other reading.
        roll_inverse: VelocityOfAngle = VelocityOfAngle { a_mps: -13.151, b_mps: 13.151, c_per_deg: 0.0066837 },
            DRG_IRL_A(95, OnFloor, "Speed sideways over lean q is a + b exp(-c q): a."),
            DRG_IRL_B(96, OnFloor, "Speed sideways over lean q is a + b exp(-c q): b."),
            DRG_IRL_C(97, OnFloor, "Speed sideways over lean q is a + b exp(-c q): c.");
    } rules shapes;
}

choices!(DragReading: AngleOfVelocity "angle of velocity", VelocityOfAngle "velocity of angle");

/// Largest asymptote of a law of lean over speed, deg: half a turn, beyond which an angle names no other lean. A law that
/// needs more is a line over every lean that a vehicle flies.
pub const ASYMPTOTE_MOST_DEG: f64 = 180.0;

impl DragConfig {
    fn shapes(&self, key: &str, problems: &mut Problems) {
        for (name, law) in [("pitch", self.pitch), ("roll", self.roll)] {
            check_shape(&format!("{key}.{name}"), problems, |v| law.lean_deg(v));
        }
        for (name, law) in
            [("pitch_inverse", self.pitch_inverse), ("roll_inverse", self.roll_inverse)]
        {
            check_shape(&format!("{key}.{name}"), problems, |v| law.lean_deg(v));
        }
    }

    /// Feed-forward pitch for this velocity along heading x, rad.
    pub fn pitch_ff_rad(&self, vel_x_mps: f64) -> f64 {
        -self.lean_rad(0, vel_x_mps)
    }

    /// Feed-forward roll for this velocity along heading y, rad.
    pub fn roll_ff_rad(&self, vel_y_mps: f64) -> f64 {
        self.lean_rad(1, vel_y_mps)
    }

    /// Speed that a lean (≥ 0, rad) along heading axis x (0) or y (1) ends at, m/s: the law without
    /// limits, inverted. Infinite at and beyond its asymptote, 0 for NaN.
    pub fn speed_mps(&self, axis: usize, lean_rad: f64) -> f64 {
        if lean_rad.is_nan() {
            return 0.0;
        }
        let lean_deg = lean_rad.to_degrees();
        let by_angle = |law: &AngleOfVelocity| {
            let share = -(lean_deg + law.a_deg) / law.b_deg;
            if share > 0.0 { -share.ln() / law.c_s_per_m } else { f64::INFINITY }
        };
        let speed = match (self.reading, axis) {
            (DragReading::AngleOfVelocity, 0) => by_angle(&self.pitch),
            (DragReading::AngleOfVelocity, _) => by_angle(&self.roll),
            (DragReading::VelocityOfAngle, 0) => self.pitch_inverse.speed_mps(lean_deg),
            (DragReading::VelocityOfAngle, _) => self.roll_inverse.speed_mps(lean_deg),
        };
        if speed.is_nan() { 0.0 } else { speed.max(0.0) }
    }

    /// Lean towards the motion along heading axis x (0) or y (1), rad: odd in the velocity,
    /// limited, and 0 for NaN.
    pub fn lean_rad(&self, axis: usize, vel_mps: f64) -> f64 {
        let law = |speed: f64| match (self.reading, axis) {
            (DragReading::AngleOfVelocity, 0) => self.pitch.lean_deg(speed),
            (DragReading::AngleOfVelocity, _) => self.roll.lean_deg(speed),
            (DragReading::VelocityOfAngle, 0) => self.pitch_inverse.lean_deg(speed),
            (DragReading::VelocityOfAngle, _) => self.roll_inverse.lean_deg(speed),
        };
        if vel_mps.is_nan() {
            return 0.0;
        }
        let speed = vel_mps.abs();
        let mut lean_deg = law(speed);
        if speed < FADE_MPS {
            lean_deg -= law(0.0) * (1.0 - speed / FADE_MPS);
        }
        let lean_deg = if lean_deg.is_nan() { 0.0 } else { lean_deg.clamp(0.0, self.limit_deg) };
        lean_deg.to_radians().copysign(vel_mps)
    }
}

/// The law must be near zero at rest, plausible at 1 m/s and rise from there.
fn check_shape(key: &str, problems: &mut Problems, lean_deg: impl Fn(f64) -> f64) {
    let at_rest = lean_deg(0.0);
    if at_rest.is_nan() || at_rest.abs() > MAX_OFFSET_DEG {
        problems.say(format!(
            "{key}: the law leans {at_rest:.3} deg at rest, allowed {} to {MAX_OFFSET_DEG} deg; \
             mend a and b (a + b is the value at rest)",
            -MAX_OFFSET_DEG
        ));
    }
    let at_1 = lean_deg(1.0);
    if !LEAN_AT_1_MPS_DEG.contains(&at_1) {
        problems.say(format!(
            "{key}: the law leans {at_1:.3} deg at 1 m/s, allowed {} to {} deg; \
             a = -90, b = 90, c = 0.3 belong to reading = \"angle_of_velocity\"",
            LEAN_AT_1_MPS_DEG.start(),
            LEAN_AT_1_MPS_DEG.end()
        ));
    }
    let at_2 = lean_deg(2.0);
    // Written so that NaN is refused too.
    if at_2.is_nan() || at_2 < at_1 {
        problems.say(format!(
            "{key}: the law leans {at_2:.3} deg at 2 m/s, less than {at_1:.3} deg at 1 m/s; \
             it must rise with speed"
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::G_MPS2;
    use proptest::prelude::*;

    /// Drag along heading x and y, 1/s: published fits.
    const DRAG_PER_S: [f64; 2] = [4.2, 1.9];

    fn balance_deg(drag_per_s: f64, speed_mps: f64) -> f64 {
        (drag_per_s * speed_mps / G_MPS2).atan().to_degrees()
    }

    #[test]
    fn prop_speed_is_the_inverse_of_lean_in_both_readings() {
        for reading in [DragReading::AngleOfVelocity, DragReading::VelocityOfAngle] {
            let drag = DragConfig { reading, ..Default::default() };
            for axis in [0, 1] {
                for v in [0.3, 1.0, 2.0] {
                    let back = drag.speed_mps(axis, drag.lean_rad(axis, v));
                    assert!((back - v).abs() < 1e-9, "{reading:?} {axis} {v} {back}");
                }
                assert_eq!(drag.speed_mps(axis, f64::NAN), 0.0);
            }
        }
        assert_eq!(DragConfig::default().speed_mps(0, 1.6), f64::INFINITY);
    }

    #[test]
    fn val_source_numbers_are_an_angle_over_speed() {
        let drag = DragConfig::default();
        // a = -90, b = 90, c = 0.3 worked by hand with e^-0.3 = 0.740818, e^-0.6 = 0.548812.
        for (v, deg) in [(0.0, 0.0), (0.5, 12.536), (1.0, 23.326), (2.0, 40.607)] {
            assert!((drag.pitch_ff_rad(v).to_degrees() + deg).abs() < 1e-3, "{v} m/s");
            assert!((drag.pitch_ff_rad(-v).to_degrees() - deg).abs() < 1e-3, "-{v} m/s");
            assert!((deg - balance_deg(4.2, v)).abs() < 0.5, "drag of 4.2 1/s at {v} m/s");
        }
    }

    #[test]
    fn val_roll_law_is_the_published_sideways_drag() {
        let error = |c: f64| {
            let law = AngleOfVelocity { a_deg: -90.0, b_deg: 90.0, c_s_per_m: c };
            let miss = |v: f64| law.lean_deg(v) - balance_deg(1.9, v);
            let grid = (0..=200).map(|i| miss(f64::from(i) * 0.01));
            grid.fold((0.0, 0.0f64), |(sum, worst), e| (sum + e * e, worst.max(e.abs())))
        };
        let best = (500..3000)
            .map(|i| f64::from(i) * 1e-4)
            .min_by(|l, r| error(*l).0.total_cmp(&error(*r).0))
            .expect("grid");
        assert!((best - DragConfig::default().roll.c_s_per_m).abs() < 5e-4, "{best}");
        assert!(error(best).1 < 0.31, "{} deg", error(best).1);
    }

    #[test]
    fn val_both_readings_hold_the_same_drag() {
        let angle = DragConfig::default();
        let speed = DragConfig { reading: DragReading::VelocityOfAngle, ..angle };
        for (axis, k) in DRAG_PER_S.into_iter().enumerate() {
            for v in [1.0, 2.0] {
                let lean = speed.lean_rad(axis, v).to_degrees();
                assert!((lean - balance_deg(k, v)).abs() < 0.01, "{lean}");
            }
            for i in 0..=20 {
                let v = f64::from(i) * 0.1;
                let gap = (speed.lean_rad(axis, v) - angle.lean_rad(axis, v)).to_degrees();
                assert!(gap.abs() < 1.2, "axis {axis}, {v} m/s: {gap} deg");
            }
        }
    }

    #[test]
    fn val_source_numbers_in_the_printed_reading_are_absurd_and_refused() {
        let literal = VelocityOfAngle { a_mps: -90.0, b_mps: 90.0, c_per_deg: 0.3 };
        assert!((literal.speed_mps(1.0) - 31.49).abs() < 0.01);
        let drag = DragConfig { pitch_inverse: literal, ..Default::default() };
        let mut problems = Problems::new();
        drag.check("control.drag", &mut problems);
        assert_eq!(problems.lines().len(), 1, "{problems}");
        assert!(problems.lines()[0].starts_with("control.drag.pitch_inverse: the law leans 0.03"));
    }

    #[test]
    fn prop_check_refuses_offsets_falling_laws_and_nan() {
        let base = DragConfig::default();
        let broken = [
            AngleOfVelocity { a_deg: -90.0, b_deg: 60.0, c_s_per_m: 0.3 },
            AngleOfVelocity { a_deg: 90.0, b_deg: -90.0, c_s_per_m: 0.3 },
            AngleOfVelocity { a_deg: -90.0, b_deg: 90.0, c_s_per_m: 0.0 },
            AngleOfVelocity { a_deg: f64::NAN, b_deg: 90.0, c_s_per_m: 0.3 },
        ];
        for pitch in broken {
            let mut problems = Problems::new();
            DragConfig { pitch, ..base }.check("drag", &mut problems);
            assert!(!problems.is_empty(), "{pitch:?}");
        }
        let mut problems = Problems::new();
        base.check("drag", &mut problems);
        assert!(problems.is_empty(), "{problems}");
    }

    #[test]
    fn prop_saturating_speed_gives_the_limit_at_and_beyond_its_asymptote() {
        let drag = DragConfig {
            reading: DragReading::VelocityOfAngle,
            // Saturates at 3 m/s; 25° hold 1.9 m/s.
            pitch_inverse: VelocityOfAngle { a_mps: 3.0, b_mps: -3.0, c_per_deg: -0.04 },
            ..Default::default()
        };
        let mut problems = Problems::new();
        drag.check("drag", &mut problems);
        assert!(problems.is_empty(), "{problems}");
        let limit = drag.limit_deg.to_radians();
        for v in [3.0 - 1e-15, 3.0, 3.0 + 1e-12, 50.0, f64::INFINITY] {
            assert!((drag.lean_rad(0, v) - limit).abs() < 1e-12, "{v}");
            assert!((drag.lean_rad(0, -v) + limit).abs() < 1e-12, "-{v}");
        }
        assert_eq!(drag.lean_rad(0, f64::NAN), 0.0);
    }

    #[test]
    fn prop_offset_at_rest_does_not_jump_between_directions() {
        let pitch = AngleOfVelocity { a_deg: -90.0, b_deg: 86.0, c_s_per_m: 0.3 };
        let drag = DragConfig { pitch, ..Default::default() };
        assert!(drag.lean_rad(0, 1e-6).abs() < 1e-4);
        assert!((drag.lean_rad(0, 1e-6) + drag.lean_rad(0, -1e-6)).abs() < 1e-15);
    }

    fn any_drag() -> impl Strategy<Value = DragConfig> {
        let number = prop::num::f64::ANY;
        (number, number, number, prop::bool::ANY, 0.0..52.0f64).prop_map(
            |(a, b, c, printed, limit_deg)| DragConfig {
                reading: if printed {
                    DragReading::VelocityOfAngle
                } else {
                    DragReading::AngleOfVelocity
                },
                pitch: AngleOfVelocity { a_deg: a, b_deg: b, c_s_per_m: c },
                roll: AngleOfVelocity { a_deg: a, b_deg: b, c_s_per_m: c },
                pitch_inverse: VelocityOfAngle { a_mps: a, b_mps: b, c_per_deg: c },
                roll_inverse: VelocityOfAngle { a_mps: a, b_mps: b, c_per_deg: c },
                limit_deg,
                filter_s: 0.1,
                integral_reference_s: 0.2,
            },
        )
    }

    proptest! {
        #[test]
        fn prop_inverse_undoes_the_law(
            lean in 0.0..45.0f64, a in 0.5..20.0f64, c in 0.002..0.05f64, saturating in prop::bool::ANY,
        ) {
            let sign = if saturating { 1.0 } else { -1.0 };
            let law = VelocityOfAngle { a_mps: sign * a, b_mps: -sign * a, c_per_deg: -sign * c };
            prop_assert!((law.lean_deg(law.speed_mps(lean)) - lean).abs() < 1e-6);
        }

        #[test]
        fn prop_any_parameters_any_speed_stay_finite_and_limited(
            drag in any_drag(), v in prop::num::f64::ANY,
        ) {
            for axis in 0..2 {
                let lean = drag.lean_rad(axis, v);
                prop_assert!(lean.is_finite() && lean.abs() <= drag.limit_deg.to_radians());
            }
        }
    }
}
