//! The generator's inner-loop board: attitude and rate in cascade at 500 Hz, its failsafe, its mixer.
//!
//! ```text
//! e = 2 log(q⁻¹ q_set)      ω_set = K_a e      α = K_r (ω_set - ω) + h
//! h' = (H K_r K_a (e - e_fast) - h) / τ_h      e_fast: what a recent change of the setpoint explains
//! ```
//! Profile `generic` of INTERFACES.md: arms on command, obeys while armed, 0.5 s after the last
//! setpoint levels and descends for 3 s, then cuts.

use nalgebra::{UnitQuaternion, Vector3};

use super::craft::{Craft, SERVO_LIMIT_RAD};
use super::dynamics::Order;
use super::effects::Deviations;

/// Period of the loops, s.
pub const PERIOD_S: f64 = 0.002;
/// Setpoints are obeyed for this long, then it descends for so long, s, at this share of thrust.
const OBEY_S: f64 = 0.5;
const DESCEND_S: f64 = 3.0;
const DESCEND_FACTOR: f64 = 0.83;
/// Largest error per axis, rad, and largest hold, rad/s².
const ERROR_RAD: [f64; 3] = [0.6, 0.6, 0.4];
const HOLD_RADPS2: f64 = 28.0;
/// The setpoint that counts for the hold follows with this time constant, s.
const FAST_S: f64 = 0.2;
/// Largest difference of throttle.
const DIFFERENCE: f64 = 0.28;

/// A setpoint.
#[derive(Debug, Clone, Copy)]
pub struct Setpoint {
    /// Attitude in the board's frame.
    pub q: UnitQuaternion<f64>,
    /// Collective throttle.
    pub thrust: f64,
}

/// The board's flying part.
#[derive(Debug, Clone)]
pub struct Pilotage {
    /// Whether motors may run.
    pub armed: bool,
    setpoint: Option<Setpoint>,
    age_s: f64,
    mean_thrust: f64,
    level: Option<UnitQuaternion<f64>>,
    slow_q: Option<UnitQuaternion<f64>>,
    gyro: Vector3<f64>,
    hold: Vector3<f64>,
    lead: f64,
    /// What the actuators are told.
    pub order: Order,
}

impl Default for Pilotage {
    fn default() -> Self {
        Self {
            armed: false,
            setpoint: None,
            age_s: 0.0,
            mean_thrust: 0.0,
            level: None,
            slow_q: None,
            gyro: Vector3::zeros(),
            hold: Vector3::zeros(),
            lead: 0.0,
            order: Order::default(),
        }
    }
}

impl Pilotage {
    /// Whether it flies without its companion.
    pub fn alone(&self) -> bool {
        self.level.is_some()
    }
    /// Motors may run from now on.
    pub fn arm(&mut self) {
        if !self.armed {
            *self = Self { armed: true, ..Self::default() };
        }
    }
    /// Motors off.
    pub fn disarm(&mut self) {
        *self = Self::default();
    }
    /// A new setpoint.
    pub fn take(&mut self, setpoint: Setpoint) {
        self.setpoint = Some(setpoint);
        self.age_s = 0.0;
    }

    /// One turn of the loops. `believed`: attitude that the board knows; `supply_v` as measured.
    pub fn turn(
        &mut self,
        craft: &Craft,
        believed: &UnitQuaternion<f64>,
        rate: &Vector3<f64>,
        supply_v: f64,
        d: &Deviations,
    ) {
        self.gyro += (rate - self.gyro) * (PERIOD_S / (craft.gyro_s + PERIOD_S));
        let Some(target) = self.target(believed) else {
            self.rest();
            return;
        };
        if target.thrust <= 0.0 {
            self.rest();
            return;
        }
        self.order = self.fly(craft, believed, &target, supply_v, d);
    }

    fn rest(&mut self) {
        self.order = Order::default();
        self.hold = Vector3::zeros();
        self.lead = 0.0;
        self.slow_q = None;
    }

    fn target(&mut self, believed: &UnitQuaternion<f64>) -> Option<Setpoint> {
        let setpoint = self.setpoint.filter(|_| self.armed)?;
        self.age_s += PERIOD_S;
        if self.age_s < OBEY_S {
            self.level = None;
            self.mean_thrust += PERIOD_S * (setpoint.thrust - self.mean_thrust);
            return Some(setpoint);
        }
        if self.age_s > OBEY_S + DESCEND_S {
            self.disarm();
            return None;
        }
        let level = *self.level.get_or_insert_with(|| {
            let yaw = believed.euler_angles().2;
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw)
        });
        let flies = setpoint.thrust > 0.0;
        let thrust = if flies { DESCEND_FACTOR * self.mean_thrust } else { 0.0 };
        Some(Setpoint { q: level, thrust })
    }

    fn fly(
        &mut self,
        craft: &Craft,
        believed: &UnitQuaternion<f64>,
        target: &Setpoint,
        supply_v: f64,
        d: &Deviations,
    ) -> Order {
        let q_set = d.inner_loop.limited(target.q);
        let slow = self.slow_q.get_or_insert(q_set);
        *slow = slow.nlerp(&q_set, PERIOD_S / (FAST_S + PERIOD_S));
        let e = (believed.inverse() * q_set).scaled_axis();
        let lasting = (believed.inverse() * *slow).scaled_axis();
        let throttle = steps(target.thrust, d.unknown.throttle_steps);
        let soft = d.inner_loop.slow;
        let mut alpha = Vector3::zeros();
        for i in 0..3 {
            let typo = if i == 2 { 1.0 + d.unknown.yaw_gain } else { 1.0 };
            let (ka, kr) = (craft.angle_per_s[i] * soft, craft.rate_per_s[i] * soft * typo);
            let limit = ERROR_RAD[i];
            if i < 2 {
                let want = craft.hold_gain * kr * ka * lasting[i].clamp(-limit, limit);
                self.hold[i] += (want - self.hold[i]) * (PERIOD_S / craft.hold_s);
                self.hold[i] = self.hold[i].clamp(-HOLD_RADPS2, HOLD_RADPS2);
            }
            alpha[i] = kr * (ka * e[i].clamp(-limit, limit) - self.gyro[i]) + self.hold[i];
        }
        // The maker's vehicle: nominal inertia, hover law, arms.
        let weight_n = craft.weight_n();
        let hover = craft.hover_command_v / supply_v.max(3.0);
        let thrust_n = (weight_n * throttle / hover).max(0.4 * weight_n);
        let roll_n = craft.inertia_kgm2[0] * alpha.x / (2.0 * craft.wing_m);
        let wanted = hover * roll_n / (0.5 * weight_n);
        let [lag_s, left_s] = craft.lead_s;
        self.lead += (wanted - self.lead) * (PERIOD_S / (left_s + PERIOD_S));
        let difference = wanted + (lag_s / left_s - 1.0) * (wanted - self.lead);
        let difference = difference.clamp(-DIFFERENCE, DIFFERENCE);
        let mean = throttle.clamp(difference.abs(), 1.0 - difference.abs());
        let lever = |moment_nm: f64, arm_m: f64, limit: f64| {
            (moment_nm / (thrust_n * arm_m)).clamp(-0.95, 0.95).asin().clamp(-limit, limit)
        };
        let [pitch, yaw] = SERVO_LIMIT_RAD;
        Order {
            throttle: [mean + difference, mean - difference],
            dihedral_rad: lever(craft.inertia_kgm2[1] * alpha.y, craft.pitch_arm_m, pitch),
            yaw_rad: lever(craft.inertia_kgm2[2] * alpha.z, craft.yaw_arm_m, yaw),
        }
    }
}

fn steps(throttle: f64, steps: f64) -> f64 {
    if steps > 0.0 { (throttle * steps).round() / steps } else { throttle }
}
