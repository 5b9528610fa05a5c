//! What of the vehicle meets the floor when it is not upright: corners of the gear, wing tips, head.
//!
//! Each point is a spring with a damper along the normal, and Coulomb friction made smooth across it:
//!
//! ```text
//! p = x + R r      w = v + R (ω × r)      d = max(p_z, 0)        depth, z down
//! N = max(k d + c w_z, 0)  for d > 0      F = −N ẑ − μ N w_xy / max(|w_xy|, w₀)
//! ```
//!
//! | symbol | unit | meaning |
//! |---|---|---|
//! | r | m | the point, body frame, from the centre of mass |
//! | k, c | N/m, N·s/m | spring and damper: some mm under the weight, half of critical at the mass that the point feels |
//! | μ | 1 | friction of rubber on wood, of `flight.rs` |
//! | w₀ | m/s | below this speed friction is a damper |
//!
//! The step of the plant is cut into [`PARTS`]: the stiffest point then turns by 0.1 rad a part. **Source.** Places: half width and
//! height of the gear, half the span of 0.49 m and the centre of pressure of the wings, the head as far above the
//! centre of mass as the gear is below (VEHICLE.md; gear width assumed). **Left out.** Wings that bend or are held up by
//! what they meet; air between wing and floor; walls.

use nalgebra::{Matrix3, Vector3};

use crate::body::Body;
use crate::vehicle::Vehicle;

/// Friction of the landing gear on the floor. Assumed: rubber on wood.
pub(super) const FRICTION: f64 = 0.6;
/// Half width of the landing gear, m: holds a tilting moment of the normal force times this.
pub(super) const GEAR_HALF_WIDTH_M: f64 = 0.06;

/// Parts of a step in which something touches.
pub(super) const PARTS: usize = 4;
/// Half of the span, m.
const HALF_SPAN_M: f64 = 0.245;
/// Springs and dampers of gear and head, and of the tips, which bend.
const BODY: [f64; 2] = [400.0, 2.5];
const TIP: [f64; 2] = [100.0, 0.9];
/// Friction is a damper below this speed, m/s.
const CREEP_MPS: f64 = 0.1;

/// Within this time the gear takes the sinking speed away, s: it gives by some mm, and boards low-pass their
/// accelerometer at 20 to 30 Hz. The body itself is stopped at once; the accelerometer feels it spread over this.
const JOLT_S: f64 = 0.01;

/// One point.
#[derive(Debug, Clone, Copy)]
struct Point {
    r_B_m: Vector3<f64>,
    spring_n_per_m: f64,
    damper_ns_per_m: f64,
}

/// All points of a vehicle.
#[derive(Debug, Clone)]
pub(super) struct Contact {
    points: [Point; 7],
    /// No point is farther from the centre of mass, m.
    reach_m: f64,
    /// Cosine of the tilt beyond which it does not come upright by its weight.
    pub tip_cos: f64,
    /// Speed that the gear has taken away and the accelerometer has not felt yet, m/s.
    jolt_mps: f64,
}

impl Contact {
    pub fn new(vehicle: &Vehicle) -> Self {
        let [gear_m, half_m] = [vehicle.body.gear_m, GEAR_HALF_WIDTH_M];
        let cg_B_m = Vector3::from(vehicle.body.cg_B_m);
        let point = |place: [f64; 3], [spring_n_per_m, damper_ns_per_m]: [f64; 2]| Point {
            r_B_m: Vector3::from(place) - cg_B_m,
            spring_n_per_m,
            damper_ns_per_m,
        };
        let points = [
            point([half_m, half_m, gear_m], BODY),
            point([half_m, -half_m, gear_m], BODY),
            point([-half_m, half_m, gear_m], BODY),
            point([-half_m, -half_m, gear_m], BODY),
            point([0.0, HALF_SPAN_M, -vehicle.wings.cop_m], TIP),
            point([0.0, -HALF_SPAN_M, -vehicle.wings.cop_m], TIP),
            point([0.0, 0.0, -gear_m], BODY),
        ];
        let reach_m = points.iter().map(|p| p.r_B_m.norm()).fold(0.0, f64::max);
        Self {
            points,
            reach_m,
            tip_cos: gear_m.max(1e-3) / gear_m.max(1e-3).hypot(half_m),
            jolt_mps: 0.0,
        }
    }

    /// The gear has stopped this sinking speed, m/s.
    pub fn stop(&mut self, sink_mps: f64) {
        self.jolt_mps += sink_mps;
    }

    /// Upward acceleration by which the gear stops the vehicle, as it is felt in the next step of `dt_s`, m/s².
    pub fn jolt_mps2(&mut self, dt_s: f64) -> f64 {
        let felt_mps = self.jolt_mps * (1.0 - (-dt_s / JOLT_S).exp());
        self.jolt_mps -= felt_mps;
        felt_mps / dt_s
    }

    /// Whether a point is below the floor.
    pub fn touches(&self, x_E: &Vector3<f64>, R_EB: &Matrix3<f64>) -> bool {
        x_E.z > -self.reach_m && self.points.iter().any(|p| x_E.z + (R_EB * p.r_B_m).z > 0.0)
    }

    /// Force, Earth frame, N, and torque about the centre of mass, body frame, N·m.
    pub fn wrench(&self, body: &Body, R_EB: &Matrix3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let mut sum = (Vector3::zeros(), Vector3::zeros());
        for point in &self.points {
            let depth_m = body.x_E.z + (R_EB * point.r_B_m).z;
            if depth_m <= 0.0 {
                continue;
            }
            let w_E = body.v_E + R_EB * body.w_B().cross(&point.r_B_m);
            let normal_n =
                (point.spring_n_per_m * depth_m + point.damper_ns_per_m * w_E.z).max(0.0);
            let grip = FRICTION * normal_n / w_E.xy().norm().max(CREEP_MPS);
            let force_E_n = Vector3::new(-grip * w_E.x, -grip * w_E.y, -normal_n);
            sum.0 += force_E_n;
            sum.1 += point.r_B_m.cross(&R_EB.tr_mul(&force_E_n));
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::super::Plant;
    use super::super::rig::Rig;
    use crate::effects::EffectSet;
    use haltere_core::frames::G_MPS2;

    /// A vehicle without thrust, let go at a lean.
    fn dropped(roll_rad: f64, pitch_rad: f64, height_m: f64) -> Plant {
        let mut plant = Rig::new(EffectSet::none()).plant;
        plant.body.q_EB = UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, 0.3);
        plant.body.x_E.z = -height_m;
        plant.body.restart();
        plant.observe();
        plant
    }

    /// Energy, J.
    fn energy_j(plant: &Plant) -> f64 {
        let mass_kg = plant.vehicle.body.mass_kg;
        let body = &plant.body;
        let moving_j = 0.5 * mass_kg * body.v_E.norm_squared() + body.spin_energy_j();
        moving_j - mass_kg * G_MPS2 * body.x_E.z
    }

    #[test]
    fn prop_what_tips_over_lies_still_and_gains_no_energy() {
        for (roll_deg, pitch_deg) in [
            (60.0, 0.0),
            (-75.0, 0.0),
            (0.0, 80.0),
            (0.0, -65.0),
            (50.0, 50.0),
            (120.0, 10.0),
            (178.0, 3.0),
        ] {
            let (roll_rad, pitch_rad) = (f64::to_radians(roll_deg), f64::to_radians(pitch_deg));
            let mut plant = dropped(roll_rad, pitch_rad, 0.3);
            let start_j = energy_j(&plant);
            for step in 1..=3000 {
                plant.advance_to(step * super::super::STEP_US);
                assert!(energy_j(&plant) < start_j + 1e-3, "{roll_deg} {pitch_deg}: {step}");
            }
            let truth = plant.truth();
            let tilt_deg = truth.R_EB.matrix()[(2, 2)].acos().to_degrees();
            println!("{roll_deg} {pitch_deg}: rests at {tilt_deg:.0} deg, {:?}", truth.pos_E_m);
            assert!(truth.on_ground, "{truth:?}");
            assert!(truth.vel_E_mps.norm() < 0.02, "{roll_deg} {pitch_deg}: {truth:?}");
            assert!(truth.rate_B_radps.norm() < 0.1, "{roll_deg} {pitch_deg}: {truth:?}");
            // The floor carries it, whatever its attitude.
            let felt = truth.R_EB * truth.acc_B_mps2;
            assert!((felt.z() + G_MPS2).abs() < 0.2, "{felt:?}");
        }
    }

    #[test]
    fn prop_it_lies_on_its_front_where_gear_and_head_hold_it() {
        // Corners of the gear at (0.06, 0.12), head at (0, -0.12): 14 degrees beyond level. Sideways the wings bring it
        // upright.
        let mut plant = dropped(0.0, -1.4, 0.2);
        plant.advance_to(6_000_000);
        let tilt_deg = plant.truth().R_EB.matrix()[(2, 2)].acos().to_degrees();
        assert!((tilt_deg - 104.0).abs() < 2.0, "{tilt_deg}");
    }

    #[test]
    fn prop_upright_nothing_is_changed() {
        // Below the lean beyond which its weight does not right it, the gear stands as it always did.
        let mut plant = dropped(0.3, 0.2, 0.2);
        plant.advance_to(2_000_000);
        let truth = plant.truth();
        assert!(truth.R_EB.matrix()[(2, 2)] > 0.9999 && truth.on_ground && !truth.crashed);
    }
}
