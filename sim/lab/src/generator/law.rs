//! Laws that are drawn: what an effect depends on stays, how it does is drawn from a family.
//!
//! The strength of an effect is `k(x) (1 + (y - 1) / 5)` times its size. `x` is its argument over a usual value, `k` has a shape and
//! is 1 at `x = 1`, `y` is a second argument. At 100 Hz the effect is set anew with the strength of the moment, so that every law of
//! `effects` becomes a family without a second text of it.

use std::f64::consts::PI;

use haltere_core::frames::G_MPS2;
use nalgebra::Vector3;

use super::effects::{Deviations, Hall, Set, Spec};
use super::noise::Noise;

/// Share of the strength that the second argument has.
const SECOND: f64 = 0.2;
/// Least and largest factor on a strength.
const FACTOR: [f64; 2] = [0.2, 2.5];
/// Lag that a hysteresis remembers by, s.
const MEMORY_S: f64 = 0.6;
/// Size of A8 up to which its sign is drawn.
const EITHER_SIGN: f64 = 0.1;

/// What a strength depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Argument {
    /// Speed, over 0.8 m/s.
    Speed,
    /// Height, over 1 m.
    Height,
    /// Supply, over 7.4 V; ten times as steep.
    Voltage,
    /// Time, over 45 s.
    Time,
    /// Way from the middle of the room, over 1.2 m.
    Place,
    /// Heading against a drawn one: 0 to 2.
    Heading,
    /// Flap rate over that of hover; five times as steep.
    Flapping,
    /// Rate of turn, over 0.5 rad/s.
    Turning,
}

/// All of them.
pub const ARGUMENTS: [Argument; 8] = [
    Argument::Speed,
    Argument::Height,
    Argument::Voltage,
    Argument::Time,
    Argument::Place,
    Argument::Heading,
    Argument::Flapping,
    Argument::Turning,
];

/// How it depends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Not at all.
    Steady,
    /// `x^p`.
    Power(f64),
    /// `(1 + s) / (1 + s x)`: less of more.
    Saturation(f64),
    /// `(o + x) / (o + 1)`.
    Offset(f64),
    /// A smooth step at a place, of a width.
    Threshold(f64, f64),
    /// More while `x` rises than while it falls.
    Hysteresis(f64),
    /// `1 + g (t / 45 s - 1)`.
    Growth(f64),
}

/// The moment.
#[derive(Debug, Clone, Copy, Default)]
pub struct Moment {
    /// Time, s.
    pub t_s: f64,
    /// Position, m.
    pub pos_E_m: Vector3<f64>,
    /// Speed, m/s.
    pub speed_mps: f64,
    /// Heading, rad.
    pub yaw_rad: f64,
    /// Rate of turn, rad/s.
    pub turn_radps: f64,
    /// Supply, V.
    pub supply_v: f64,
    /// Flap rate over that of hover.
    pub flap: f64,
    /// Middle of the room, m.
    pub middle_NE_m: [f64; 2],
}

impl Argument {
    fn of(self, m: &Moment, heading_rad: f64) -> f64 {
        let x = match self {
            Self::Speed => m.speed_mps / 0.8,
            Self::Height => -m.pos_E_m.z / 1.0,
            Self::Voltage => 1.0 + 10.0 * (m.supply_v / 7.4 - 1.0),
            Self::Time => m.t_s / 45.0,
            Self::Place => {
                (m.pos_E_m.x - m.middle_NE_m[0]).hypot(m.pos_E_m.y - m.middle_NE_m[1]) / 1.2
            }
            Self::Heading => 1.0 + (m.yaw_rad - heading_rad).cos(),
            Self::Flapping => 1.0 + 5.0 * (m.flap - 1.0),
            Self::Turning => m.turn_radps / 0.5,
        };
        x.clamp(0.1, 3.0)
    }
}

/// A law: a shape of an argument, and a second argument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Law {
    /// What it depends on.
    pub argument: Argument,
    /// How.
    pub shape: Shape,
    /// What else, at a fifth of the strength.
    pub second: Option<Argument>,
    /// Heading that counts, rad.
    pub heading_rad: f64,
}

impl Law {
    /// Draws one of an argument.
    pub fn drawn(argument: Argument, rng: &mut Noise) -> Self {
        let shape = match rng.below(7) {
            0 => Shape::Steady,
            1 => Shape::Power(rng.between(-0.5, 0.8)),
            2 => Shape::Saturation(rng.between(0.3, 1.5)),
            3 => Shape::Offset(rng.between(0.3, 1.5)),
            4 => Shape::Threshold(rng.between(0.6, 1.2), rng.between(0.15, 0.4)),
            5 => Shape::Hysteresis(rng.between(0.15, 0.4)),
            _ => Shape::Growth(rng.between(-0.4, 0.6)),
        };
        let second = (rng.uniform() < 0.4).then(|| ARGUMENTS[rng.below(ARGUMENTS.len())]);
        let heading_rad = rng.between(-PI, PI);
        Self { argument, shape, second: second.filter(|s| *s != argument), heading_rad }
    }

    /// Factor on the strength; `lagged` is the argument a moment ago.
    fn factor(&self, m: &Moment, lagged: f64) -> f64 {
        let x = self.argument.of(m, self.heading_rad);
        let step = |x: f64, at: f64, width: f64| 1.0 / (1.0 + (-(x - at) / width).exp());
        let k = match self.shape {
            Shape::Steady => 1.0,
            Shape::Power(p) => x.powf(p),
            Shape::Saturation(s) => (1.0 + s) / (1.0 + s * x),
            Shape::Offset(o) => (o + x) / (o + 1.0),
            Shape::Threshold(at, width) => step(x, at, width) / step(1.0, at, width),
            Shape::Hysteresis(share) => 1.0 + share * ((x - lagged) / 0.1).tanh(),
            Shape::Growth(g) => 1.0 + g * (m.t_s / 45.0 - 1.0),
        };
        let second = self.second.map_or(1.0, |a| a.of(m, self.heading_rad));
        (k * (1.0 + SECOND * (second - 1.0))).clamp(FACTOR[0], FACTOR[1])
    }
}

/// What an effect of the library depends on.
pub fn argument_of(id: &str) -> Argument {
    match id {
        "A1" | "A2" | "A3" => Argument::Speed,
        "A5" | "A7" | "A8" | "A9" | "U6" => Argument::Height,
        "A6" | "A10" | "U1" | "U2" | "U5" | "U9" | "U10" => Argument::Place,
        "A4" | "P2" | "P4" | "P6" | "M3" | "M6" | "L6" => Argument::Flapping,
        "P1" | "P3" | "P5" | "L3" => Argument::Voltage,
        "L1" | "L4" | "L5" => Argument::Turning,
        "U3" | "H1" => Argument::Heading,
        _ => Argument::Time,
    }
}

/// Memory of an argument, for hysteresis.
#[derive(Debug, Clone, Copy, Default)]
struct Memory(Option<f64>);

impl Memory {
    fn lagged(&mut self, x: f64, dt_s: f64) -> f64 {
        let before = *self.0.get_or_insert(x);
        self.0 = Some(before + (x - before) * (dt_s / MEMORY_S).min(1.0));
        before
    }
}

/// An effect by a law of its own.
#[derive(Debug, Clone)]
pub struct Cause {
    spec: &'static Spec,
    size: f64,
    unit: f64,
    seed: u64,
    law: Law,
    memory: Memory,
}

impl Cause {
    /// Of a size in the unit of the published vehicle, which is `unit` of this one's; signs, directions and places are drawn from
    /// `seed`.
    pub fn new(spec: &'static Spec, size: f64, unit: f64, seed: u64, law: Law) -> Self {
        Self { spec, size, unit, seed, law, memory: Memory::default() }
    }

    /// Sets it as it is now.
    fn apply(&mut self, m: &Moment, dt_s: f64, hall: &Hall, d: &mut Deviations) -> Set {
        let lagged = self.memory.lagged(self.law.argument.of(m, self.law.heading_rad), dt_s);
        let strength = self.spec.strength(self.size) * self.law.factor(m, lagged);
        let mut size = self.spec.size(strength.min(self.spec.strongest()));
        if self.spec.id == "A8" {
            // A small one has either sign: one that grows keeps it.
            let small = self.size <= EITHER_SIGN;
            size = if small { size.min(EITHER_SIGN) } else { size.max(EITHER_SIGN * 1.001) };
        }
        self.spec.apply(size * self.unit, &mut Noise::new(self.seed, self.spec.id), hall, d)
    }
}

/// Where an effect that no library holds acts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum At {
    /// A force along a direction of the body, in weights.
    Force(Vector3<f64>),
    /// A moment about an axis of the body, in weights times wing.
    Twist(Vector3<f64>),
    /// The accelerometer, m/s².
    Accelerometer(Vector3<f64>),
    /// The gyroscope, rad/s.
    Gyroscope(Vector3<f64>),
    /// Bytes to the board, s.
    ToBoard(f64),
    /// Bytes of the tag, s.
    FromTag(f64),
}

/// An effect of the grammar: where it acts, what it depends on, how.
#[derive(Debug, Clone, Copy)]
pub struct Stranger {
    /// Where.
    pub at: At,
    /// By which law: less its value at the usual argument, so that it comes and goes.
    pub law: Law,
    memory: Memory,
}

/// What strangers do at a moment.
#[derive(Debug, Clone, Copy, Default)]
pub struct Strange {
    /// Force, body, N.
    pub force_B_n: Vector3<f64>,
    /// Moment, body, N·m.
    pub twist_B_nm: Vector3<f64>,
    /// Added to the accelerometer, m/s².
    pub acc_mps2: Vector3<f64>,
    /// Added to the gyroscope, rad/s.
    pub rate_radps: Vector3<f64>,
    /// Further delay to the board and from the tag, s.
    pub later_s: [f64; 2],
}

impl Stranger {
    /// Draws one from the grammar.
    pub fn drawn(rng: &mut Noise) -> Self {
        let direction = Vector3::from_fn(|_, _| rng.normal()).normalize();
        let at = match rng.below(6) {
            0 => At::Force(direction * rng.between(0.03, 0.1)),
            1 => At::Twist(direction * rng.between(0.03, 0.1)),
            2 => At::Accelerometer(direction * rng.between(0.4, 1.2)),
            3 => At::Gyroscope(direction * rng.between(0.02, 0.08)),
            4 => At::ToBoard(rng.between(0.03, 0.08)),
            _ => At::FromTag(rng.between(0.04, 0.1)),
        };
        // What grows with time in a sensor the library holds, and what is steady anywhere.
        let arguments: Vec<_> = ARGUMENTS.into_iter().filter(|a| *a != Argument::Time).collect();
        let argument = arguments[rng.below(arguments.len())];
        let shape = match rng.below(4) {
            0 => Shape::Power(rng.between(0.8, 2.0)),
            1 => Shape::Threshold(rng.between(0.9, 1.4), rng.between(0.05, 0.2)),
            2 => Shape::Hysteresis(rng.between(0.5, 1.0)),
            _ => Shape::Saturation(rng.between(1.0, 3.0)),
        };
        let heading_rad = rng.between(-PI, PI);
        let law = Law { argument, shape, second: None, heading_rad };
        Self { at, law, memory: Memory::default() }
    }

    /// Block of the chain in which it acts.
    pub fn block(&self) -> &'static str {
        match self.at {
            At::Force(_) => "aerodynamics",
            At::Twist(_) => "inner_loop",
            At::Accelerometer(_) | At::Gyroscope(_) => "imu",
            At::ToBoard(_) => "link",
            At::FromTag(_) => "timing",
        }
    }

    fn add(&mut self, m: &Moment, dt_s: f64, [kg, wing_m]: [f64; 2], sum: &mut Strange) {
        let lagged = self.memory.lagged(self.law.argument.of(m, self.law.heading_rad), dt_s);
        let k = self.law.factor(m, lagged);
        let come_and_go = k - 1.0;
        match self.at {
            At::Force(f) => sum.force_B_n += f * (kg * G_MPS2 * come_and_go),
            At::Twist(f) => sum.twist_B_nm += f * (kg * G_MPS2 * wing_m * come_and_go),
            At::Accelerometer(a) => sum.acc_mps2 += a * come_and_go,
            At::Gyroscope(w) => sum.rate_radps += w * come_and_go,
            // A delay is never negative.
            At::ToBoard(s) => sum.later_s[0] += s * come_and_go.max(0.0),
            At::FromTag(s) => sum.later_s[1] += s * come_and_go.max(0.0),
        }
    }
}

/// Everything that acts by laws of its own.
#[derive(Debug, Clone, Default)]
pub struct Drawn {
    /// Effects of the library.
    pub causes: Vec<Cause>,
    /// Others.
    pub strangers: Vec<Stranger>,
    /// The room.
    pub hall: Option<Hall>,
}

impl Drawn {
    /// Whether anything acts.
    pub fn any(&self) -> bool {
        !self.causes.is_empty() || !self.strangers.is_empty()
    }

    /// What deviates at a moment, `dt_s` after the last; `old` is what did then.
    pub(super) fn at(
        &mut self,
        m: &Moment,
        dt_s: f64,
        vehicle: [f64; 2],
        old: &Deviations,
    ) -> (Deviations, Strange) {
        let mut d = Deviations::default();
        if let Some(hall) = self.hall {
            for cause in &mut self.causes {
                cause.apply(m, dt_s, &hall, &mut d);
            }
        }
        d.go_on_from(old);
        let mut sum = Strange::default();
        for stranger in &mut self.strangers {
            stranger.add(m, dt_s, vehicle, &mut sum);
        }
        (d, sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every argument at its usual value, for a law of this heading.
    fn usual(heading_rad: f64) -> Moment {
        Moment {
            t_s: 45.0,
            pos_E_m: Vector3::new(1.2, 0.0, -1.0),
            speed_mps: 0.8,
            yaw_rad: heading_rad + 0.5 * PI,
            turn_radps: 0.5,
            supply_v: 7.4,
            flap: 1.0,
            middle_NE_m: [0.0; 2],
        }
    }

    #[test]
    fn prop_every_law_is_one_at_the_usual_moment_and_most_differ_elsewhere() {
        let mut rng = Noise::new(3, "laws");
        let mut differ = 0;
        for argument in ARGUMENTS.into_iter().flat_map(|argument| [argument; 20]) {
            let law = Law::drawn(argument, &mut rng);
            let m = usual(law.heading_rad);
            assert!((law.factor(&m, 1.0) - 1.0).abs() < 1e-9, "{law:?}");
            let far = Moment { t_s: 80.0, pos_E_m: m.pos_E_m * 1.8, speed_mps: 1.5, ..m };
            let far = Moment { yaw_rad: law.heading_rad, flap: 1.1, supply_v: 7.8, ..far };
            let x = argument.of(&far, law.heading_rad);
            differ += usize::from((law.factor(&far, x - 0.1) - 1.0).abs() > 0.05);
        }
        assert!(differ > 100, "{differ} of 160");
    }

    #[test]
    fn prop_a_stranger_comes_and_goes() {
        let mut rng = Noise::new(4, "strangers");
        for _ in 0..60 {
            let mut stranger = Stranger::drawn(&mut rng);
            let mut sum = Strange::default();
            let m = usual(stranger.law.heading_rad);
            stranger.add(&m, 0.01, [0.1, 0.08], &mut sum);
            let all = sum.force_B_n + sum.twist_B_nm + sum.acc_mps2 + sum.rate_radps;
            assert!(all.norm() + sum.later_s[0] + sum.later_s[1] < 1e-9, "{stranger:?}");
        }
    }
}
