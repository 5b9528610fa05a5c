//! The vehicle file of a quadrotor: a rigid body with four motors that stand still in it.
//!
//! It is what the diagnosis without a simulator balances forces and moments with (`haltere gap diagnose --import`), and what
//! a Crazyflie's firmware can be flown on (`plant/rotors.rs`). A file of wings is [`crate::vehicle`].

use haltere_core::checks::Problems;
use haltere_core::checks::schema::Schema;
use haltere_core::frames::G_MPS2;
use nalgebra::Matrix4;
use serde::{Deserialize, Serialize};

/// How many motors a file must have: with four, every command is one thrust and three moments and nothing else.
pub const MOTORS: usize = 4;
/// Commands of a hovering vehicle are told apart from a mirrored or doubled motor by this least determinant of the balance.
const LEAST_DETERMINANT: f64 = 1e-3;
/// Lean at which the top speed is told, rad: 20 degrees, where a small quadrotor holds its height without effort.
const LEAN_RAD: f64 = 0.35;

/// Everything about a quadrotor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rotorcraft {
    /// Name in reports.
    pub name: String,
    /// Take-off mass, kg.
    pub mass_kg: f64,
    /// Moments of inertia about the body axes, kg·m².
    pub inertia_kgm2: [f64; 3],
    /// Drag over mass along the body axes, 1/s.
    pub drag_per_s: [f64; 3],
    /// Thrust of a motor.
    pub thrust: Thrust,
    /// The motors, in the order of the log.
    pub motor: Vec<Motor>,
}

/// Thrust of one motor: `full_n · u^command_exponent · (U/nominal_v)^voltage_exponent`, u the logged command of 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thrust {
    /// At full command and nominal voltage, N.
    pub full_n: f64,
    /// Pack voltage that `full_n` is said for, V.
    pub nominal_v: f64,
    /// Power of the logged command.
    pub command_exponent: f64,
    /// Power of the voltage; 0 where the firmware makes up for it before it logs the command.
    pub voltage_exponent: f64,
    /// Torque about the motor's axis over its thrust, m.
    pub torque_m: f64,
}

/// One motor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// Its place forward of the centre of mass, m.
    pub forward_m: f64,
    /// Its place to the right of it, m.
    pub right_m: f64,
    /// Which way the propeller turns, seen from above.
    pub turns: Turns,
}

/// Which way a propeller turns, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Turns {
    /// Clockwise: the body is turned counter-clockwise.
    Cw,
    /// Counter-clockwise.
    Ccw,
}

impl Rotorcraft {
    /// Whether a text is of a quadrotor, and not of wings.
    pub fn is_meant(text: &str) -> bool {
        text.parse::<toml::Table>().is_ok_and(|table| table.contains_key("motor"))
    }

    /// Reads a file and refuses what cannot be balanced; every reason at once.
    pub fn from_toml(text: &str) -> Result<Self, Problems> {
        let mut table: toml::Table =
            text.parse().map_err(|e: toml::de::Error| Problems::one(e.to_string()))?;
        if let Some(version) = table.remove(Schema::KEY) {
            let checked = Schema::VEHICLE.check_text(&version.to_string());
            checked.map_err(|e| Problems::one(e.to_string()))?;
        }
        let read: Self =
            table.try_into().map_err(|e: toml::de::Error| Problems::one(e.message()))?;
        let mut problems = Problems::new();
        read.check(&mut problems);
        problems.into_result().map(|()| read)
    }

    fn check(&self, problems: &mut Problems) {
        problems.range("mass_kg", self.mass_kg, 0.005..=50.0, "kg");
        for (axis, k) in ["x", "y", "z"].into_iter().zip(0..3) {
            problems.range(
                format_args!("inertia_kgm2.{axis}"),
                self.inertia_kgm2[k],
                1e-7..=10.0,
                "kg·m²",
            );
            problems.range(
                format_args!("drag_per_s.{axis}"),
                self.drag_per_s[k],
                0.0..=10.0,
                "1/s",
            );
        }
        let Thrust { full_n, nominal_v, command_exponent, voltage_exponent, torque_m } =
            self.thrust;
        problems.range("thrust.full_n", full_n, 1e-3..=500.0, "N");
        problems.range("thrust.nominal_v", nominal_v, 2.0..=60.0, "V");
        problems.range("thrust.command_exponent", command_exponent, 0.5..=3.0, "");
        problems.range("thrust.voltage_exponent", voltage_exponent, 0.0..=3.0, "");
        problems.range("thrust.torque_m", torque_m, 1e-4..=0.5, "m");
        for (k, motor) in self.motor.iter().enumerate() {
            for (key, value) in [("forward_m", motor.forward_m), ("right_m", motor.right_m)] {
                problems.range(format_args!("motor {}: {key}", k + 1), value, -2.0..=2.0, "m");
            }
        }
        match self.to_balance() {
            _ if self.motor.len() != MOTORS => problems.say(format!(
                "motor: {} are there, {MOTORS} are known; write one table [[motor]] each",
                self.motor.len()
            )),
            None => problems.say(
                "motor: these four places and directions cannot hold thrust, roll, pitch and yaw apart; of two motors that are \
                 neighbours one turns cw and one ccw",
            ),
            Some(_) => {}
        }
        let most_n = full_n * self.motor.len() as f64;
        if self.hover_frac() >= 1.0 {
            problems.say(format!(
                "thrust.full_n = {full_n}: all motors lift {most_n:.3} N, the weight is {:.3} N",
                self.weight_n()
            ));
        }
    }

    /// Weight, N.
    pub fn weight_n(&self) -> f64 {
        self.mass_kg * G_MPS2
    }

    /// Mean distance of the motors from the axes of roll and of pitch, m.
    pub fn levers_m(&self) -> [f64; 2] {
        let mean = |of: fn(&Motor) -> f64| {
            self.motor.iter().map(|m| of(m).abs()).sum::<f64>() / self.motor.len().max(1) as f64
        };
        [mean(|m| m.right_m), mean(|m| m.forward_m)]
    }

    /// What the thrust of each motor, as a share of a quarter of the weight, adds to vertical force, roll, pitch and yaw. A
    /// row each: the force as a share of the weight, roll and pitch (right side down, nose up) of the weight at the mean lever, yaw
    /// (clockwise) of the weight at `torque_m`. `None` where four motors cannot hold them apart.
    pub fn to_balance(&self) -> Option<Matrix4<f64>> {
        let motors: [Motor; MOTORS] = self.motor.clone().try_into().ok()?;
        let [right_m, forward_m] = self.levers_m();
        let quarter = 1.0 / MOTORS as f64;
        let matrix = Matrix4::from_fn(|row, k| {
            let motor = motors[k];
            quarter
                * match row {
                    0 => 1.0,
                    1 => -motor.right_m / right_m,
                    2 => motor.forward_m / forward_m,
                    _ if motor.turns == Turns::Ccw => 1.0,
                    _ => -1.0,
                }
        });
        (matrix.determinant().abs() > LEAST_DETERMINANT).then_some(matrix)
    }

    /// Command in hover at the nominal voltage, of 1.
    pub fn hover_frac(&self) -> f64 {
        let each_n = self.weight_n() / self.motor.len().max(1) as f64;
        (each_n / self.thrust.full_n).powf(1.0 / self.thrust.command_exponent)
    }

    /// What follows from the numbers, in lines.
    pub fn meaning(&self) -> String {
        let reserve = self.thrust.full_n * self.motor.len() as f64 / self.weight_n();
        let [right_m, forward_m] = self.levers_m();
        // All thrust of one side against none of the other, and of one direction of turning, above hover's weight.
        let turn = |lever_m: f64, axis: usize| {
            self.weight_n() * lever_m * (reserve - 1.0).min(1.0) / self.inertia_kgm2[axis]
        };
        format!(
            "{}: every value is allowed\n\
             hover    {:.2} of the full command at {:.1} V; all motors lift {reserve:.1} times the weight\n\
             turns    {:.0}, {:.0}, {:.0} rad/s² at most about roll, pitch, yaw out of hover\n\
             top      {:.1} m/s forward at a lean of 20 degrees\n",
            self.name,
            self.hover_frac(),
            self.thrust.nominal_v,
            turn(right_m, 0),
            turn(forward_m, 1),
            turn(self.thrust.torque_m, 2),
            G_MPS2 * LEAN_RAD.tan() / self.drag_per_s[0].max(1e-3),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CRAZYFLIE: &str = include_str!("../../sim/rotorcraft/crazyflie-2.1.toml");

    #[test]
    fn val_a_crazyflie_hovers_as_its_firmware_says() {
        let vehicle = Rotorcraft::from_toml(CRAZYFLIE).unwrap();
        // 60 g of thrust at full command, 27 g of weight, thrust in proportion to the command.
        assert!((vehicle.hover_frac() - 0.45).abs() < 0.01, "{}", vehicle.hover_frac());
        assert!(Rotorcraft::is_meant(CRAZYFLIE) && !Rotorcraft::is_meant("[body]\nmass_kg = 0.1"));
        assert!(vehicle.meaning().contains("2.2 times the weight"), "{}", vehicle.meaning());
    }

    #[test]
    fn prop_one_motor_more_thrust_is_roll_pitch_and_yaw_alike() {
        let to = Rotorcraft::from_toml(CRAZYFLIE).unwrap().to_balance().unwrap();
        // Motor 3, behind on the left, turns as motor 1: it lifts the left side, lowers the nose, turns clockwise.
        let of_third = to * nalgebra::Vector4::new(0.0, 0.0, 1.0, 0.0);
        assert_eq!(of_third.as_slice(), [0.25, 0.25, -0.25, 0.25]);
    }

    #[test]
    fn prop_what_cannot_be_balanced_is_refused_with_every_reason() {
        let mut vehicle = Rotorcraft::from_toml(CRAZYFLIE).unwrap();
        vehicle.motor.iter_mut().for_each(|motor| motor.turns = Turns::Cw);
        vehicle.mass_kg = 27.0;
        let refused = Rotorcraft::from_toml(&toml::to_string(&vehicle).unwrap()).unwrap_err();
        let said = refused.to_string();
        assert!(
            said.contains("neighbours one turns cw") && said.contains("the weight is"),
            "{said}"
        );
        let newer = Rotorcraft::from_toml(&format!("schema_version = 9\n{CRAZYFLIE}")).unwrap_err();
        assert!(newer.to_string().contains("schema version 9"), "{newer}");
    }
}
