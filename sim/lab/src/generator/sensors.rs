//! IMU and barometer of the generator's board, and what it believes about its attitude.
//!
//! At 2 kHz: true specific force (beat of the wings included), shaking of the mount by the beat and by
//! the gear mesh, squared term, one-pole filter; read at 250 Hz, so that the mesh aliases. Noise is
//! Student-t, turn-on biases are Laplace.

use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::TAU;

use super::craft::Craft;
use super::effects::Deviations;
use super::noise::Noise;

/// Time constant of the filter in the sensor, s (90 Hz).
const FILTER_S: f64 = 0.00177;
/// Teeth that mesh per beat, and their shaking in hover, m/s².
const MESH: f64 = 18.7;
const MESH_MPS2: f64 = 0.6;
/// Noise per sample: m/s², rad/s, Pa.
const STD: [f64; 3] = [0.05, 0.004, 2.5];
/// Turn-on biases: m/s², rad/s.
const TURN_ON: [f64; 2] = [0.045, 0.0028];
/// Shares of the variance of the shaking: first and second harmonic, rest is broad.
const SHARES: [f64; 3] = [0.55, 0.33, 0.12];
/// Pressure on the floor (Pa) and its fall with height (Pa/m); slow weather, Pa per √s.
const FLOOR_PA: f64 = 100_870.0;
const FALL_PA_PER_M: f64 = 11.9;
const WEATHER_PA: f64 = 0.25;
/// Share of tilt wander of north with heading, rad.
const IRON_RAD: f64 = 0.008;

/// What the wings do.
#[derive(Debug, Clone, Copy)]
pub struct Beat {
    /// Flap rates, Hz.
    pub flap_hz: [f64; 2],
    /// Phases, rad.
    pub phase: [f64; 2],
}

/// The sensors.
#[derive(Debug, Clone)]
pub struct Sensors {
    rng: Noise,
    odd: Noise,
    phases: [[f64; 4]; 6],
    bias: [Vector3<f64>; 2],
    acc: Vector3<f64>,
    rate: Vector3<f64>,
    mesh: f64,
    weather_pa: f64,
    lean: [f64; 2],
    knock: Vector3<f64>,
}

impl Sensors {
    /// Just switched on.
    pub fn new(seed: u64) -> Self {
        let mut rng = Noise::new(seed, "sensors");
        let phases = std::array::from_fn(|_| std::array::from_fn(|_| rng.between(0.0, TAU)));
        let bias = TURN_ON
            .map(|std| Vector3::from_fn(|_, _| (std * rng.laplace()).clamp(-4.0 * std, 4.0 * std)));
        let lean = [rng.normal(), rng.normal()];
        Self {
            rng,
            odd: Noise::new(seed, "knocks"),
            phases,
            bias,
            acc: Vector3::new(0.0, 0.0, -9.81),
            rate: Vector3::zeros(),
            mesh: 0.0,
            weather_pa: 0.0,
            lean,
            knock: Vector3::zeros(),
        }
    }

    /// One step of 2 kHz: true specific force and rate at the board.
    pub fn shake(
        &mut self,
        dt_s: f64,
        acc: Vector3<f64>,
        rate: Vector3<f64>,
        wings: &Beat,
        craft: &Craft,
        d: &Deviations,
    ) {
        let Beat { flap_hz, phase: beat } = wings;
        let mean = 0.5 * (flap_hz[0] + flap_hz[1]);
        let strength = (mean / craft.hover_hz).powi(2);
        self.mesh = (self.mesh + TAU * MESH * mean * dt_s) % TAU;
        let (mut a, mut w) = (acc, rate);
        if strength > 0.0 {
            let channel = |i: usize, std: f64| {
                let [first, second, _] = SHARES;
                let p = &self.phases[i];
                let beats = first.sqrt() * ((beat[0] + p[0]).sin() + (beat[1] + p[1]).sin())
                    + second.sqrt() * ((2.0 * beat[0] + p[2]).sin() + (2.0 * beat[1] + p[3]).sin());
                strength * std * beats
            };
            for i in 0..3 {
                a[i] += channel(i, craft.shake_mps2[i]);
                w[i] += channel(i + 3, craft.shake_radps);
            }
            a.z += strength * MESH_MPS2 * self.mesh.sin();
            a.x += strength * 0.5 * MESH_MPS2 * self.mesh.cos();
        }
        if d.unknown.rattle_mps2 > 0.0 && mean > 1.0 {
            if self.odd.uniform() < dt_s * 9.0 {
                let hit = Vector3::from_fn(|_, _| self.odd.laplace());
                self.knock = hit * d.unknown.rattle_mps2;
            }
            self.knock *= 1.0 - dt_s / 0.012;
            a += self.knock;
            w += self.knock * 0.02;
        }
        a.z += d.imu.square * (a.z + 9.81).powi(2);
        w += a * d.unknown.g_sensitivity;
        let share = dt_s / (FILTER_S + dt_s);
        self.acc += (a - self.acc) * share;
        self.rate += (w - self.rate) * share;
    }

    /// A reading: accelerometer and gyroscope. `t_s` since power-on.
    pub fn read(
        &mut self,
        t_s: f64,
        flap_hz: [f64; 2],
        craft: &Craft,
        d: &Deviations,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let strength = (0.5 * (flap_hz[0] + flap_hz[1]) / craft.hover_hz).powi(2);
        let broad = SHARES[2].sqrt() * strength;
        let turn = d.imu.crooked.inverse();
        let (mut a, mut w) = (turn * self.acc, turn * self.rate);
        for i in 0..3 {
            a[i] += STD[0] * self.rng.student() + broad * craft.shake_mps2[i] * self.rng.laplace();
            w[i] += STD[1] * self.rng.student() + broad * craft.shake_radps * self.rng.laplace();
        }
        a += self.bias[0];
        w += self.bias[1];
        let a = d.imu.acc(a, t_s);
        let w = d.imu.rate(w, &a);
        (a, w)
    }

    /// A pressure, Pa; called 50 times a second.
    pub fn pressure_pa(&mut self, height_m: f64) -> f64 {
        self.weather_pa += WEATHER_PA * 0.02f64.sqrt() * self.rng.normal();
        FLOOR_PA - FALL_PA_PER_M * height_m + self.weather_pa + STD[2] * self.rng.student()
    }

    /// What the board believes: its level wanders, its north is not the room's. 500 times a second.
    pub fn believed(
        &mut self,
        dt_s: f64,
        t_s: f64,
        q: &UnitQuaternion<f64>,
        craft: &Craft,
        d: &Deviations,
    ) -> (UnitQuaternion<f64>, f64) {
        for lean in &mut self.lean {
            let rate = dt_s / craft.lean_s;
            *lean += -rate * *lean + (2.0 * rate).sqrt() * self.rng.student();
        }
        let yaw = q.euler_angles().2;
        let north = craft.north_rad
            + IRON_RAD * (2.0 * yaw).sin()
            + d.timing.north_rad(yaw)
            + d.unknown.north_rad(t_s);
        let [roll, pitch] = self.lean.map(|lean| lean * craft.lean_rad);
        let lean = UnitQuaternion::from_scaled_axis(Vector3::new(roll, pitch, 0.0));
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -north);
        (turn * q * lean * d.imu.crooked, north)
    }
}
