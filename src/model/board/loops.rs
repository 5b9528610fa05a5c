//! Attitude and rate loops, and the mixer.
//!
//! ```text
//! e     = 2 sgn(w) vec(q_believed⁻¹ q_set)                       attitude error, body, rad
//! h'    = Δq_set - h / τ_h                                       error that the last steps explain
//! b'    = (B (e - h) - b) / τ_b                                  boost at low frequency, usually not in yaw
//! α     = ω² (e + b) - 2 ζ ω ω_B                                 wanted angular acceleration
//! Δf    = J_x α_x / (2 l_w k)      with a lead (1 + τ s)/(1 + τ' s) against the flap lag
//! sin δ = J_y α_y / (T (l_w - l_z l_h / l_k))
//! sin ψ = J_z α_z l_k / (T l_w l_y)
//! ```
//! The boost is a leaky integrator, 1 + B times stiffer at rest: without it the drag above the centre
//! of mass would lean the vehicle by several degrees per m/s. A full integrator would hide servo trims;
//! the vehicle's public firmware has none. The board knows the vehicle as its maker does, not the
//! deviations.

use nalgebra::{UnitQuaternion, Vector3};

use crate::board::BoardSettings;
use crate::effects::{STEP_S, Setpoint};
use crate::vehicle::Vehicle;
use crate::wings::{ActuatorCommand, flap_target_hz};
use haltere_core::frames::G_MPS2;

/// Largest attitude error that the loops act on, rad, per axis: full authority, no more.
const ERROR_LIMIT_RAD: Vector3<f64> = Vector3::new(0.6, 0.6, 0.4);
/// What is left after 2 ms of an error that a step of the setpoint explains: 0.17 s, as the loop.
const EXPECTED_KEEP: f64 = 0.988_304;
/// Largest boost, rad.
const BOOST_LIMIT_RAD: f64 = 0.35;
/// Largest difference of throttle from the mean, either wing.
const DIFFERENCE_LIMIT_FRAC: f64 = 0.3;
/// Least share of the weight that the mixer divides by.
const LEAST_THRUST_SHARE: f64 = 0.4;

/// The loops.
#[derive(Debug, Clone)]
pub struct Loops {
    /// ω² and 2 ζ ω.
    angle_gain: Vector3<f64>,
    rate_gain: Vector3<f64>,
    vehicle: Vehicle,
    boost: Vector3<f64>,
    boost_gain: f64,
    boost_rad: Vector3<f64>,
    last_target: Option<UnitQuaternion<f64>>,
    expected_rad: Vector3<f64>,
    lead: f64,
    lead_decay: f64,
    lead_state: f64,
    least_thrust_n: f64,
    pitch_arm_m: f64,
    yaw_arm_m: f64,
    dihedral_limit_rad: f64,
    yaw_limit_rad: f64,
}

impl Loops {
    /// For this vehicle.
    pub fn new(settings: &BoardSettings, vehicle: &Vehicle) -> Self {
        let inner = vehicle.inner_loop.keeping(settings.kept);
        let w = Vector3::from(inner.frequency_radps);
        let z = Vector3::from(inner.damping);
        let [lag_s, left_s] = settings.lead_s;
        let wings = &vehicle.wings;
        // The airframe damps yaw by itself; the loop only adds what is missing.
        let beats = 2.0 * vehicle.hover_hz();
        let own_yaw = vehicle.drag.k_ns_per_m_hz[0] * wings.centre_m.powi(2) * beats
            / vehicle.body.inertia_kgm2[2];
        let mut rate_gain = w.component_mul(&z) * 2.0;
        rate_gain.z = (rate_gain.z - own_yaw).max(0.0);
        Self {
            angle_gain: w.component_mul(&w),
            rate_gain,
            boost: Vector3::new(inner.boost, inner.boost, inner.boost_yaw),
            boost_gain: 1.0 - (-STEP_S / inner.boost_s).exp(),
            boost_rad: Vector3::zeros(),
            last_target: None,
            expected_rad: Vector3::zeros(),
            lead: (lag_s / left_s - 1.0).max(0.0),
            lead_decay: 1.0 - (-STEP_S / left_s).exp(),
            lead_state: 0.0,
            least_thrust_n: LEAST_THRUST_SHARE * vehicle.body.mass_kg * G_MPS2,
            pitch_arm_m: wings.centre_m - wings.cop_m * wings.hinge_m / wings.link_m,
            yaw_arm_m: wings.centre_m * wings.root_m / wings.link_m,
            dihedral_limit_rad: vehicle.pitch_servo.limit_deg.to_radians(),
            yaw_limit_rad: vehicle.yaw_servo.limit_deg.to_radians(),
            vehicle: vehicle.clone(),
        }
    }

    /// Forgets the past: motors stand.
    pub fn reset(&mut self) {
        self.lead_state = 0.0;
        self.boost_rad = Vector3::zeros();
        self.last_target = None;
        self.expected_rad = Vector3::zeros();
    }

    /// One turn.
    #[inline]
    pub fn step(
        &mut self,
        believed: &UnitQuaternion<f64>,
        target: &Setpoint,
        rate_B_radps: Vector3<f64>,
        supply_v: f64,
    ) -> ActuatorCommand {
        let q = believed.inverse() * target.q;
        let sign = if q.w < 0.0 { -2.0 } else { 2.0 };
        let e = q.imag() * sign;
        let e = e.zip_map(&ERROR_LIMIT_RAD, |e, limit| e.clamp(-limit, limit));
        let moved = self.last_target.map_or(Vector3::zeros(), |last| {
            let d = last.inverse() * target.q;
            d.imag() * if d.w < 0.0 { -2.0 } else { 2.0 }
        });
        self.last_target = Some(target.q);
        self.expected_rad = (self.expected_rad + moved) * EXPECTED_KEEP;
        let lasting = e - self.expected_rad;
        self.boost_rad += (lasting.component_mul(&self.boost) - self.boost_rad) * self.boost_gain;
        self.boost_rad.apply(|b| *b = b.clamp(-BOOST_LIMIT_RAD, BOOST_LIMIT_RAD));
        let e = e + self.boost_rad;
        let acc = self.angle_gain.component_mul(&e) - self.rate_gain.component_mul(&rate_B_radps);
        let [jx, jy, jz] = self.vehicle.body.inertia_kgm2;
        let wings = &self.vehicle.wings;

        let hz = flap_target_hz(wings, target.thrust_frac, supply_v);
        let thrust_n =
            (2.0 * wings.thrust_n_per_hz * hz + wings.thrust_offset_n).max(self.least_thrust_n);

        let difference_hz = jx * acc.x / (2.0 * wings.centre_m * wings.thrust_n_per_hz);
        self.lead_state += self.lead_decay * (difference_hz - self.lead_state);
        let difference_hz = difference_hz + self.lead * (difference_hz - self.lead_state);
        let difference = (difference_hz / (wings.flap_hz_per_v * supply_v.max(3.0)))
            .clamp(-DIFFERENCE_LIMIT_FRAC, DIFFERENCE_LIMIT_FRAC);
        // At the end of the throttle range, roll comes before height.
        let mean = target.thrust_frac.clamp(difference.abs(), 1.0 - difference.abs());

        // asin(x) = x to 2 % within the travel of the dihedral; the loop takes up the rest.
        let dihedral = jy * acc.y / (thrust_n * self.pitch_arm_m);
        let yaw = jz * acc.z / (thrust_n * self.yaw_arm_m);
        ActuatorCommand {
            flap_frac: [mean + difference, mean - difference],
            dihedral_rad: dihedral.clamp(-self.dihedral_limit_rad, self.dihedral_limit_rad),
            yaw_servo_rad: yaw.clamp(-self.yaw_limit_rad, self.yaw_limit_rad),
        }
    }
}

impl Loops {
    /// Travel of dihedral and yaw servo to either side, rad.
    pub fn limits_rad(&self) -> [f64; 2] {
        [self.dihedral_limit_rad, self.yaw_limit_rad]
    }

    /// Dihedral and yaw servo as shares of their travel.
    pub fn travel(&self, c: &ActuatorCommand) -> [f64; 2] {
        [c.dihedral_rad / self.dihedral_limit_rad, c.yaw_servo_rad / self.yaw_limit_rad]
    }
}
