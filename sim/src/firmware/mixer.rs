//! From the motors of a quadrotor to wings: four outputs of a linear X mixer are one collective and three
//! moments, and those are what the wings are told. So an unmodified firmware flies the vehicle.

use haltere_core::frames::G_MPS2;
use haltere_model::Vehicle;
use haltere_model::wings::ActuatorCommand;

/// Largest difference of throttle from the mean, either wing: as the own board's mixer.
const DIFFERENCE_LIMIT_FRAC: f64 = 0.3;
/// Flap lag that is led away in roll, and what is left of it, s: as the own board's mixer. A firmware made
/// for propellers cannot lead by so much.
const LEAD_S: [f64; 2] = [0.08, 0.02];

/// What the firmware's mixer was told: collective 0 to 1, moments −1 to 1 about forward, right, down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demand {
    pub collective: f64,
    pub moment_B: [f64; 3],
}

impl Demand {
    /// Of the motors of a quadrotor X, 0 to 1: front right and rear left turn counter-clockwise, front left
    /// and rear right clockwise, seen from above. A moment of one moves each motor by a half.
    pub fn of_quad_x([front_right, rear_left, front_left, rear_right]: [f64; 4]) -> Self {
        let mean = |a: f64, b: f64, c: f64, d: f64| (a + b + c + d) / 4.0;
        Self {
            collective: mean(front_right, rear_left, front_left, rear_right),
            // More on the left: right wing down. More in front: nose up. A propeller that turns
            // counter-clockwise turns the body clockwise: nose right.
            moment_B: [
                2.0 * mean(front_left, rear_left, -front_right, -rear_right),
                2.0 * mean(front_left, front_right, -rear_left, -rear_right),
                2.0 * mean(front_right, rear_left, -front_left, -rear_right),
            ],
        }
    }
}

/// The wings' end. A moment of one is the whole travel of its actuator.
#[derive(Debug)]
pub struct Mixer {
    dihedral_rad: f64,
    yaw_servo_rad: f64,
    lagged: f64,
}

impl Mixer {
    pub fn new(vehicle: &Vehicle) -> Self {
        Self {
            dihedral_rad: vehicle.pitch_servo.limit_deg.to_radians(),
            yaw_servo_rad: vehicle.yaw_servo.limit_deg.to_radians(),
            lagged: 0.0,
        }
    }

    /// What the wings are told, `dt_s` after the last time.
    pub fn wings(&mut self, demand: Demand, dt_s: f64) -> ActuatorCommand {
        if demand.collective <= 0.0 {
            self.lagged = 0.0;
            return ActuatorCommand::default();
        }
        let [roll, pitch, yaw] = demand.moment_B;
        let difference = roll * DIFFERENCE_LIMIT_FRAC;
        let [lag_s, left_s] = LEAD_S;
        self.lagged += (1.0 - (-dt_s / left_s).exp()) * (difference - self.lagged);
        let lead = (lag_s / left_s - 1.0) * (difference - self.lagged);
        let limit = DIFFERENCE_LIMIT_FRAC;
        let difference = (difference + lead).clamp(-limit, limit);
        // At the end of the throttle range, roll comes before height.
        let mean = demand.collective.clamp(difference.abs(), 1.0 - difference.abs());
        ActuatorCommand {
            flap_frac: [mean + difference, mean - difference],
            dihedral_rad: pitch.clamp(-1.0, 1.0) * self.dihedral_rad,
            yaw_servo_rad: yaw.clamp(-1.0, 1.0) * self.yaw_servo_rad,
        }
    }
}

/// Angular acceleration in hover that a moment of one gives, rad/s², about forward, right, down: what the
/// gains of a firmware are found with.
pub fn authority_radps2(vehicle: &Vehicle, supply_v: f64) -> [f64; 3] {
    let (w, [jx, jy, jz]) = (&vehicle.wings, vehicle.body.inertia_kgm2);
    let weight_n = vehicle.body.mass_kg * G_MPS2;
    let roll_n = w.thrust_n_per_hz * w.flap_hz_per_v * supply_v * DIFFERENCE_LIMIT_FRAC;
    let pitch_arm_m = w.centre_m - w.cop_m * w.hinge_m / w.link_m;
    let yaw_arm_m = w.centre_m * w.root_m / w.link_m;
    let travel = |deg: f64| deg.to_radians().sin();
    [
        2.0 * w.centre_m * roll_n / jx,
        weight_n * pitch_arm_m * travel(vehicle.pitch_servo.limit_deg) / jy,
        weight_n * yaw_arm_m * travel(vehicle.yaw_servo.limit_deg) / jz,
    ]
}

#[cfg(test)]
mod tests {
    use haltere_model::wings::{Actuation, thrust_wrench};

    use super::*;

    #[test]
    fn prop_each_moment_of_the_mixer_turns_the_vehicle_its_way() {
        // What a firmware's X mixer makes of a demand (BOARDS.md: order and sense of its motors).
        let motors = |roll: f64, pitch: f64, yaw: f64| {
            let of = |r: f64, p: f64, y: f64| 0.6 + 0.5 * (r * roll + p * pitch + y * yaw);
            [of(-1.0, 1.0, 1.0), of(1.0, -1.0, 1.0), of(1.0, 1.0, -1.0), of(-1.0, -1.0, -1.0)]
        };
        let vehicle = Vehicle::default();
        for axis in 0..3 {
            let mut moment = [0.0; 3];
            moment[axis] = 0.2;
            let demand = Demand::of_quad_x(motors(moment[0], moment[1], moment[2]));
            assert!((demand.collective - 0.6).abs() < 1e-9, "{demand:?}");
            for (found, put_in) in demand.moment_B.into_iter().zip(moment) {
                assert!((found - put_in).abs() < 1e-9, "{demand:?}");
            }
            let c = Mixer::new(&vehicle).wings(demand, 1.0);
            let a = Actuation {
                flap_hz: [0.0; 2],
                dihedral_rad: c.dihedral_rad,
                yaw_servo_rad: c.yaw_servo_rad,
            };
            let torque = thrust_wrench(&vehicle, c.flap_frac, &a).torque_B_nm;
            assert_eq!(torque.iamax(), axis, "{torque:?}");
            assert!(torque[axis] > 0.0, "{torque:?}");
        }
    }

    #[test]
    fn prop_standing_motors_let_the_wings_stand() {
        let mut mixer = Mixer::new(&Vehicle::default());
        let demand = Demand::of_quad_x([0.0; 4]);
        assert_eq!(mixer.wings(demand, 0.001), ActuatorCommand::default());
        let full = mixer.wings(Demand::of_quad_x([1.0, 0.0, 0.0, 1.0]), 0.001);
        assert!(full.flap_frac.iter().all(|f| (0.0..=1.0).contains(f)), "{full:?}");
    }

    #[test]
    fn val_authority_is_that_of_the_wings() {
        // By hand from VEHICLE.md's numbers: 2·0.08·0.04·2.724·7.4·0.3/5.6e-4, 1.0·0.0706·sin 18°/3.4e-4,
        // 1.0·0.0288·sin 45°/3.6e-4.
        let [roll, pitch, yaw] = authority_radps2(&Vehicle::default(), 7.4);
        assert!(
            (roll - 69.1).abs() < 0.5 && (pitch - 64.1).abs() < 0.5 && (yaw - 56.6).abs() < 0.5
        );
    }
}
