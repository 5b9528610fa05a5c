//! Motion of the generator's vehicle: wing-beat resolved forces, quaternion, Runge-Kutta 4 at 2 kHz.
//!
//! ```text
//! f'  = (κ u V - f - b f²) / τ                       motor and gear of each wing, Hz
//! T   = ½ W (f/f_h)^n (1 + m₁ cos θ + m₂ cos(2θ+φ))  thrust of a wing within its beat, θ' = 2π f
//! F_i = -m k_i v_i (f̄/f_h) / √(1 + v²/v_b²)          drag
//! q'  = ½ q ⊗ ω      J ω' = M - ω × J ω              attitude
//! c   = 1 / (1 - (R/4)² / z²)                        cushion over the floor (Cheeseman, Bennett 1955)
//! ```
//! The floor is four feet on damped springs with smooth friction. Written against the published
//! numbers of the vehicle, not against the nominal model: no line is shared with it.

use haltere_core::frames::G_MPS2;
use nalgebra::{Quaternion, SVector, UnitQuaternion, Vector3};
use std::f64::consts::TAU;

use super::craft::{Craft, SERVO_LIMIT_RAD};
use super::effects::Deviations;

/// Modulation of thrust within the beat: first and second harmonic, phase of the second.
const BEAT: [f64; 3] = [0.30, 0.55, 0.6];
/// Fore-and-aft force within the beat, share of thrust, and its lever in yaw, m: the wings of a
/// side sweep against each other, so little of it is left.
const SWEEP: [f64; 2] = [0.28, 0.12];
const SWEEP_LEVER_M: f64 = 0.02;
/// Feet: half distance (m), stiffness of each (N/m), damping (N·s/m), friction, speed at which
/// friction saturates (m/s).
const FOOT_M: f64 = 0.065;
const FOOT_N_PER_M: f64 = 300.0;
const FOOT_NS_PER_M: f64 = 4.0;
const FRICTION: f64 = 0.25;
const CREEP_MPS: f64 = 0.02;
/// Lowest open-circuit voltage under any load, V: keeps the current finite.
const LEAST_V: f64 = 3.0;

const P: usize = 0;
const V: usize = 3;
const Q: usize = 6;
const W: usize = 10;
const F: usize = 13;
const THETA: usize = 15;
const D: usize = 17;
const Y: usize = 19;
const USED: usize = 21;
const POLAR: usize = 22;
const LAG: usize = 23;
const N: usize = 25;

type X = SVector<f64, N>;

/// What the motors and servos are told.
#[derive(Debug, Clone, Copy, Default)]
pub struct Order {
    /// Throttle of left and right wing, 0 to 1.
    pub throttle: [f64; 2],
    /// Dihedral, rad.
    pub dihedral_rad: f64,
    /// Wing root, rad.
    pub yaw_rad: f64,
}

/// Held over one step.
#[derive(Debug, Clone, Copy, Default)]
pub struct Surroundings {
    /// Time, s.
    pub t_s: f64,
    /// Air, m/s.
    pub wind_E_mps: Vector3<f64>,
    /// Other forces: cable, slung mass; Earth frame, N.
    pub pull_E_n: Vector3<f64>,
    /// Others along the body, N, and moments about its axes, N·m.
    pub push_B_n: Vector3<f64>,
    /// See `push_B_n`.
    pub twist_B_nm: Vector3<f64>,
}

/// Forces at an instant.
#[derive(Debug, Clone, Copy, Default)]
pub struct Loads {
    /// Without gravity, body, N.
    pub force_B_n: Vector3<f64>,
    /// About the centre of mass, N·m.
    pub torque_B_nm: Vector3<f64>,
    /// Thrust of both wings over a beat, N.
    pub thrust_n: f64,
    /// Whether a foot is down.
    pub touches: bool,
}

/// The moving vehicle.
#[derive(Debug, Clone)]
pub struct Motion {
    x: X,
    /// Supply at the plug, V, and current, A, held over a step.
    pub supply_v: f64,
    /// See `supply_v`.
    pub current_a: f64,
    /// Loads at the beginning of the last step.
    pub loads: Loads,
}

fn three(x: &X, at: usize) -> Vector3<f64> {
    Vector3::new(x[at], x[at + 1], x[at + 2])
}

impl Motion {
    /// At rest on the floor.
    pub fn new(craft: &Craft, north_m: f64, east_m: f64, phase: [f64; 2]) -> Self {
        let mut x = X::zeros();
        x[P] = north_m;
        x[P + 1] = east_m;
        // Feet pressed in by the weight.
        x[P + 2] = -craft.gear_m + craft.weight_n() / (4.0 * FOOT_N_PER_M);
        x[Q] = 1.0;
        x[THETA] = phase[0];
        x[THETA + 1] = phase[1];
        let supply_v = 2.0 * cell_v(craft.charge_frac);
        Self { x, supply_v, current_a: 0.0, loads: Loads::default() }
    }

    /// Position of the centre of mass, Earth, m.
    pub fn pos(&self) -> Vector3<f64> {
        three(&self.x, P)
    }
    /// Velocity, Earth, m/s.
    pub fn vel(&self) -> Vector3<f64> {
        three(&self.x, V)
    }
    /// Rate, body, rad/s.
    pub fn rate(&self) -> Vector3<f64> {
        three(&self.x, W)
    }
    /// Attitude.
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        attitude(&self.x)
    }
    /// Flap rates, Hz.
    pub fn flap_hz(&self) -> [f64; 2] {
        [self.x[F], self.x[F + 1]]
    }
    /// Phase of the beat of each wing, rad.
    pub fn phase(&self) -> [f64; 2] {
        [self.x[THETA], self.x[THETA + 1]]
    }
    /// Dihedral and wing root, rad.
    pub fn servos(&self) -> [f64; 2] {
        [self.x[D], self.x[Y]]
    }
    /// Charge used, A·s.
    pub fn used_as(&self) -> f64 {
        self.x[USED]
    }

    /// One step.
    pub fn step(
        &mut self,
        dt_s: f64,
        craft: &Craft,
        order: &Order,
        around: &Surroundings,
        d: &Deviations,
    ) {
        self.feed(craft, d, around.t_s);
        let a = self.x;
        let (k1, loads) = slope(&a, craft, order, around, self.supply_v, self.current_a, d);
        self.loads = loads;
        let rates = |x: &X| slope(x, craft, order, around, self.supply_v, self.current_a, d).0;
        let k2 = rates(&(a + k1 * (0.5 * dt_s)));
        let k3 = rates(&(a + k2 * (0.5 * dt_s)));
        let k4 = rates(&(a + k3 * dt_s));
        self.x = a + (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (dt_s / 6.0);
        let q = Quaternion::new(self.x[Q], self.x[Q + 1], self.x[Q + 2], self.x[Q + 3]);
        let norm = q.norm();
        for i in Q..Q + 4 {
            self.x[i] /= norm;
        }
        for i in THETA..THETA + 2 {
            self.x[i] %= TAU;
        }
        for i in F..F + 2 {
            self.x[i] = self.x[i].max(0.0);
        }
    }

    /// Current and voltage from what the motors do now.
    fn feed(&mut self, craft: &Craft, d: &Deviations, t_s: f64) {
        let [motors_w, electronics_w] = craft.power_w;
        let load: f64 = self.flap_hz().iter().map(|f| (f / craft.hover_hz).powf(2.8)).sum();
        self.current_a = (0.5 * motors_w * load + electronics_w) / self.supply_v.max(LEAST_V);
        let charge = craft.charge_frac - self.x[USED] / d.propulsion.capacity(craft.capacity_as);
        let ohm = craft.resistance_ohm[0] + d.propulsion.ohmic + d.unknown.contact_ohm(t_s);
        self.supply_v = (2.0 * cell_v(charge) - self.x[POLAR] - ohm * self.current_a).max(LEAST_V);
    }
}

fn attitude(x: &X) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(x[Q], x[Q + 1], x[Q + 2], x[Q + 3]))
}

/// Open-circuit voltage of a cell against charge: steep at both ends, after usual LiPo curves.
pub fn cell_v(charge: f64) -> f64 {
    let q = charge.clamp(-0.1, 1.05);
    3.66 + 0.22 * q + 0.32 * q.powi(4) - 0.39 * (-16.0 * q).exp()
}

/// Flap rate per command and volt, so that hover is at its recorded place.
fn motor_gain(craft: &Craft) -> f64 {
    craft.hover_hz * (1.0 + craft.gear_drag) / craft.hover_command_v
}

fn slope(
    x: &X,
    craft: &Craft,
    order: &Order,
    around: &Surroundings,
    supply_v: f64,
    current_a: f64,
    d: &Deviations,
) -> (X, Loads) {
    let mut rate = X::zeros();
    let loads = loads(x, craft, around, d);
    let q_EB = attitude(x);
    let w = three(x, W);
    let mass = craft.mass_kg + d.inertia.extra_kg(around.t_s) + d.unknown.water_kg(around.t_s);
    let a_E = q_EB * loads.force_B_n / mass + Vector3::new(0.0, 0.0, G_MPS2);
    let J = d.inertia.of(craft.inertia_kgm2);
    let alpha = (loads.torque_B_nm - w.cross(&J.component_mul(&w))).component_div(&J);
    let q = q_EB.into_inner() * Quaternion::from_imag(w) * 0.5;
    for i in 0..3 {
        rate[P + i] = x[V + i];
        rate[V + i] = a_E[i];
        rate[W + i] = alpha[i];
    }
    (rate[Q], rate[Q + 1], rate[Q + 2], rate[Q + 3]) = (q.w, q.i, q.j, q.k);
    let (gain, drag) = (motor_gain(craft), craft.gear_drag / craft.hover_hz);
    for wing in 0..2 {
        let f = x[F + wing];
        let drive = d.propulsion.drive(
            gain * order.throttle[wing].clamp(0.0, 1.0) * supply_v,
            supply_v,
            craft,
        );
        let drive = if order.throttle[wing] <= 0.0 { 0.0 } else { drive };
        let pull = drive * d.propulsion.gear(wing) - f - drag * f * f;
        let tau = craft.motor_s[usize::from(pull < 0.0)] * (1.0 + craft.gear_drag);
        rate[F + wing] = pull / tau;
        rate[THETA + wing] = TAU * f;
        if d.propulsion.lag_s > 0.0 {
            rate[LAG + wing] = (f - x[LAG + wing]) / d.propulsion.lag_s;
        } else {
            // Ready to be switched on in flight.
            rate[LAG + wing] = (f - x[LAG + wing]) / 0.01;
        }
    }
    let targets = [order.dihedral_rad, order.yaw_rad];
    for (servo, at) in [D, Y].into_iter().enumerate() {
        let limit = SERVO_LIMIT_RAD[servo];
        let target = targets[servo].clamp(-limit, limit);
        let (omega, zeta) = (craft.servo_radps[servo], craft.servo_damping[servo]);
        rate[at] = x[at + 1];
        rate[at + 1] = omega * omega * (target - x[at]) - 2.0 * zeta * omega * x[at + 1];
    }
    rate[USED] = d.propulsion.drain(current_a);
    let (ohm, tau) = (craft.resistance_ohm[1] + d.propulsion.slow_ohm, craft.polarisation_s);
    rate[POLAR] = (ohm * current_a - x[POLAR]) / tau;
    (rate, loads)
}

fn loads(x: &X, craft: &Craft, around: &Surroundings, d: &Deviations) -> Loads {
    let q_EB = attitude(x);
    let (pos, vel, w) = (three(x, P), three(x, V), three(x, W));
    let height_m = -pos.z - craft.gear_m;
    let t_s = around.t_s;
    let density = d.unknown.density();

    let z = height_m.max(0.0) + craft.wing_height_m;
    let cushion = 1.0 / (1.0 - craft.cushion_m2 / (z * z));
    let place = cushion * d.aero.lift_factor(height_m) * density * craft.lift;
    let dihedral = d.inner_loop.wing_rad(x[D]) + craft.trim_rad[0];
    let yaw_root = x[Y] + d.inner_loop.trim_rad[1] + craft.trim_rad[1];
    let mut l = Loads::default();
    let mut thrust = [0.0; 2];
    for (wing, side) in [-1.0, 1.0].into_iter().enumerate() {
        let f = if d.propulsion.lag_s > 0.0 { x[LAG + wing] } else { x[F + wing] };
        let ratio = (f / craft.hover_hz).max(0.0);
        let mean = 0.5
            * craft.weight_n()
            * ratio.powf(craft.lift_exponent + d.aero.expo)
            * place
            * d.propulsion.lift(wing)
            * d.unknown.lift(t_s, wing, x[F + wing], x[LAG + wing]);
        let theta = x[THETA + wing];
        let now = mean * (1.0 + BEAT[0] * theta.cos() + BEAT[1] * (2.0 * theta + BEAT[2]).cos());
        let sweep = mean * (SWEEP[0] * theta.sin() + SWEEP[1] * (2.0 * theta).sin());
        thrust[wing] = mean;
        let lean = craft.pitch_push * dihedral.sin() - side * 0.36 * yaw_root.sin();
        l.force_B_n += Vector3::new(now * lean + sweep, 0.0, -now * (1.0 - 0.5 * lean * lean));
        l.torque_B_nm += Vector3::new(
            -side * craft.wing_m * now,
            craft.pitch_arm_m * now * dihedral.sin(),
            craft.yaw_arm_m * now * yaw_root.sin() - side * SWEEP_LEVER_M * sweep,
        );
        l.thrust_n += mean;
    }
    l.torque_B_nm.z += d.inner_loop.twist_nm(craft.wing_m * (thrust[0] - thrust[1]));

    let v = q_EB.inverse_transform_vector(&(vel - around.wind_E_mps));
    let beat = 0.5 * (x[F] + x[F + 1]) / craft.hover_hz;
    let speed = v.norm();
    let bend = d.aero.bend(speed, craft.drag_bend_mps);
    let mut drag = Vector3::zeros();
    for i in 0..3 {
        drag[i] = -craft.stated_kg
            * density
            * craft.drag_per_s[i]
            * d.aero.drag_scale[i]
            * v[i]
            * beat
            * bend;
    }
    drag += d.aero.plates(&v) * (craft.stated_kg * density);
    l.force_B_n += drag;
    l.torque_B_nm +=
        Vector3::new(craft.drag_lever_m[1] * drag.y, -craft.drag_lever_m[0] * drag.x, 0.0);
    for i in 0..3 {
        let spin = beat * craft.damping_per_s[i] * (1.0 + 0.05 * w[i].abs());
        l.torque_B_nm[i] -= craft.inertia_kgm2[i] * density * spin * w[i];
    }
    // The centre of mass sits elsewhere: everything so far acted about the drawn one.
    l.torque_B_nm -= d.inertia.offset_B_m(craft.stated_kg).cross(&l.force_B_n);
    l.force_B_n += q_EB.inverse_transform_vector(&(d.aero.wall_n(&pos) + around.pull_E_n));
    l.force_B_n += around.push_B_n;
    l.torque_B_nm += around.twist_B_nm;

    if height_m < 0.1 {
        let mut foot = |dx: f64, dy: f64| {
            let arm = Vector3::new(dx, dy, craft.gear_m);
            let at = q_EB * arm;
            let depth = pos.z + at.z;
            if depth > 0.0 {
                let v = vel + q_EB * w.cross(&arm);
                let push = (FOOT_N_PER_M * depth + FOOT_NS_PER_M * v.z).max(0.0);
                let slide = (v.x * v.x + v.y * v.y + CREEP_MPS * CREEP_MPS).sqrt();
                let grip = FRICTION * push / slide;
                let force_B =
                    q_EB.inverse_transform_vector(&Vector3::new(-grip * v.x, -grip * v.y, -push));
                l.force_B_n += force_B;
                l.torque_B_nm += arm.cross(&force_B);
                l.touches = true;
            }
        };
        for (dx, dy) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            foot(dx * FOOT_M, dy * FOOT_M);
        }
    }
    l
}
