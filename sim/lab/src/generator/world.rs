//! A world that is drawn: vehicle, board, battery, room, radio, computer, and a law of its own for every effect.
//!
//! It is a seed and a page. Vehicles are spread about the published one by the laws of similar wings: with `s` its mass and `r`
//! its wing over the published one's, inertia goes with `s r²`, flap rate in hover with `√s / r²`, drag with `r³`, power with
//! `s^1.5 / r` (Pennycuick 1990), each times a number of its own. Ranges are judgement: what vehicles of this class are built like.

use super::computer::Computer;
use super::craft::Craft;
use super::effects::{Spec, known};
use super::law::{Cause, Law, Stranger, argument_of};
use super::noise::Noise;

/// Lightest and heaviest vehicle, kg.
const MASS_KG: [f64; 2] = [0.06, 0.25];
/// Share of boards without an integrator.
const NO_HOLD: f64 = 0.3;
/// Nominal voltage of the pack, V.
const PACK_V: f64 = 7.4;

/// A world.
#[derive(Debug, Clone)]
pub struct World {
    /// Its seed.
    pub seed: u64,
    /// The healthy vehicle.
    pub craft: Craft,
    /// Sides of the room and its ceiling, m.
    pub room_m: [f64; 3],
    /// The computer when it has nothing else to do.
    pub computer: Computer,
    /// A law for every effect of the library.
    pub laws: Vec<(&'static Spec, Law)>,
}

/// An hour in which flights are made.
#[derive(Debug, Clone)]
pub struct Session {
    /// The computer, with its other work.
    pub computer: Computer,
    /// The vehicle: another pack, another charge, the board's north as it woke up.
    pub craft: Craft,
    /// The place of take-off from the mark, m.
    pub beside_NE_m: [f64; 2],
}

impl World {
    /// Draws it.
    pub fn drawn(seed: u64) -> Self {
        let mut rng = Noise::new(seed, "world");
        let published = Craft::healthy(0.12, [0.0; 3]);
        let mass_kg = MASS_KG[0] * (MASS_KG[1] / MASS_KG[0]).powf(rng.uniform());
        let s = mass_kg / published.mass_kg;
        let r = s.cbrt() * rng.between(0.92, 1.1);
        let mut craft = published;
        let mut about = |value: &mut f64, factor: f64, low: f64, high: f64| {
            *value *= factor * rng.between(low, high);
        };
        let beats = s.sqrt() / (r * r);
        about(&mut craft.hover_hz, beats, 0.93, 1.07);
        let quick = craft.hover_hz / 12.75;
        about(&mut craft.hover_command_v, 1.0, 0.85, 1.1);
        about(&mut craft.wing_m, r, 0.95, 1.05);
        about(&mut craft.gear_m, r, 0.9, 1.15);
        for inertia in &mut craft.inertia_kgm2 {
            about(inertia, s * r * r, 0.85, 1.2);
        }
        about(&mut craft.lift_exponent, 1.0, 0.95, 1.3);
        about(&mut craft.gear_drag, 1.0, 0.0, 3.0);
        about(&mut craft.motor_s[0], 1.0 / quick, 0.8, 1.2);
        let up_s = craft.motor_s[0];
        craft.motor_s[1] = up_s;
        about(&mut craft.motor_s[1], 1.0, 1.0, 1.3);
        for drag in &mut craft.drag_per_s {
            about(drag, r.powi(3) / s * quick, 0.65, 1.4);
        }
        about(&mut craft.drag_bend_mps, 1.0, 0.6, 1.8);
        for damping in &mut craft.damping_per_s {
            about(damping, 1.0, 0.7, 1.4);
        }
        for lever in &mut craft.drag_lever_m {
            about(lever, r, 0.5, 1.3);
        }
        about(&mut craft.pitch_arm_m, r, 0.88, 1.12);
        about(&mut craft.yaw_arm_m, r, 0.88, 1.12);
        about(&mut craft.pitch_push, 1.0, 0.75, 1.25);
        for k in 0..2 {
            about(&mut craft.servo_radps[k], quick, 0.85, 1.3);
            about(&mut craft.servo_damping[k], 1.0, 0.85, 1.25);
        }
        about(&mut craft.cushion_m2, r * r, 0.5, 1.3);
        about(&mut craft.wing_height_m, r, 0.9, 1.15);
        about(&mut craft.power_w[0], s.powf(1.5) / r, 0.85, 1.2);
        about(&mut craft.power_w[1], 1.0, 0.6, 2.0);
        for ohm in &mut craft.resistance_ohm {
            about(ohm, 24.2 / craft.power_w[0], 0.6, 1.5);
        }
        about(&mut craft.polarisation_s, 1.0, 0.5, 4.0);
        for k in 0..3 {
            about(&mut craft.angle_per_s[k], 1.0, 0.85, 1.25);
            about(&mut craft.rate_per_s[k], 1.0, 0.85, 1.2);
        }
        about(&mut craft.hold_gain, 1.0, 0.5, 1.3);
        about(&mut craft.hold_s, 1.0, 0.6, 1.8);
        about(&mut craft.gyro_s, 1.0, 0.6, 1.6);
        about(&mut craft.lean_rad, 1.0, 0.5, 1.6);
        about(&mut craft.lean_s, 1.0, 0.6, 1.6);
        for shake in &mut craft.shake_mps2 {
            about(shake, 1.0, 0.6, 1.4);
        }
        about(&mut craft.shake_radps, 1.0, 0.6, 1.5);
        for metre in [&mut craft.uwb_m, &mut craft.field_m, &mut craft.floor_m] {
            about(metre, 1.0, 0.6, 1.4);
        }
        about(&mut craft.floor_height_m, 1.0, 0.8, 1.3);
        about(&mut craft.loss, 1.0, 0.3, 2.5);
        (craft.mass_kg, craft.stated_kg) = (mass_kg, mass_kg);
        let flies_s = rng.between(270.0, 450.0);
        craft.capacity_as = (craft.power_w[0] + craft.power_w[1]) / PACK_V * flies_s;
        if rng.uniform() < NO_HOLD {
            craft.hold_gain = 0.0;
        }
        craft.lead_s[0] = up_s * rng.between(0.85, 1.05);
        craft.setpoint_delay_s = rng.between(0.0, 0.015);
        craft.trim_rad = [0.03 * rng.between(-1.0, 1.0), 0.03 * rng.between(-1.0, 1.0)];
        craft.north_rad = rng.between(-0.12, 0.12);
        craft.antenna_B_m = [rng.between(-0.02, 0.02), 0.0, rng.between(-0.03, 0.0)];
        let room_m = [rng.between(5.4, 7.5), rng.between(5.4, 7.5), rng.between(2.8, 3.3)];
        let computer = Computer {
            poll_s: [0.002, 0.004, 0.008][rng.below(3)],
            line_s: [rng.between(0.0003, 0.0012), rng.between(0.0003, 0.0015)],
            ..Computer::default()
        };
        let laws = known()
            .map(|spec| {
                let mut rng = Noise::new(seed, &format!("law of {}", spec.id));
                (spec, Law::drawn(argument_of(spec.id), &mut rng))
            })
            .collect();
        Self { seed, craft, room_m, computer, laws }
    }

    /// A session of it, by its number.
    pub fn session(&self, number: u64) -> Session {
        let mut rng = Noise::new(self.seed, &format!("session {number}"));
        let load = rng.uniform().powi(2);
        let mut craft = self.craft.clone();
        craft.charge_frac = rng.between(0.93, 1.0);
        craft.mass_kg *= 1.0 + 0.002 * rng.normal().clamp(-2.0, 2.0);
        craft.resistance_ohm[0] *= 1.0 + 0.05 * rng.normal().clamp(-2.0, 2.0);
        craft.loss *= 1.0 + load;
        craft.uwb_m *= rng.between(0.95, 1.06);
        craft.north_rad += 0.015 * rng.normal().clamp(-2.0, 2.0);
        let mut computer = self.computer;
        computer.busy_hz = 4.0 * load;
        computer.busy_s = rng.between(0.002, 0.012);
        computer.line_s[1] *= 1.0 + 2.0 * load * rng.uniform();
        let beside_NE_m = [rng.between(-0.1, 0.1), rng.between(-0.1, 0.1)];
        Session { computer, craft, beside_NE_m }
    }

    /// An effect at a size in the unit of the published vehicle, by the law of this world.
    pub fn cause(&self, spec: &'static Spec, size: f64, seed: u64) -> Option<Cause> {
        let (_, law) = self.laws.iter().find(|(own, _)| own.id == spec.id)?;
        let s = self.craft.stated_kg / 0.102;
        let unit = match spec.id {
            // Grams and newtons are felt beside the weight, ohms beside those of the motors, millimetres and lags beside the wing's.
            "I1" | "A10" => s,
            "P2" => 24.2 / self.craft.power_w[0],
            "I2" => self.craft.wing_m / 0.08,
            "P4" => self.craft.motor_s[0] / 0.082,
            _ => 1.0,
        };
        Some(Cause::new(spec, size, unit, seed, *law))
    }

    /// An effect that no library holds.
    pub fn stranger(&self, number: u64) -> Stranger {
        Stranger::drawn(&mut Noise::new(self.seed, &format!("stranger {number}")))
    }

    /// The page of the world.
    pub fn page(&self) -> String {
        use std::fmt::Write;
        let mut page = format!(
            "world {}\n{:#?}\nroom {:?} m\n{:?}\n",
            self.seed, self.craft, self.room_m, self.computer
        );
        for (spec, law) in &self.laws {
            let _ = writeln!(
                page,
                "{} {}: {:?} of {:?}, beside it {:?}",
                spec.id, spec.name, law.shape, law.argument, law.second
            );
        }
        page
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_world_is_its_seed_and_no_two_are_alike() {
        let [one, same, other] = [1, 1, 2].map(|seed| World::drawn(seed).page());
        assert_eq!(one, same);
        assert_ne!(one, other);
        for world in (0..200).map(World::drawn) {
            let craft = &world.craft;
            assert!((MASS_KG[0]..=MASS_KG[1]).contains(&craft.mass_kg), "{}", world.page());
            assert!(craft.cushion_m2 < 0.6 * craft.wing_height_m.powi(2), "{}", world.page());
            let [one, two] = [1, 2].map(|number| world.session(number).computer);
            assert_ne!(one, two);
        }
    }
}
