//! Closed-loop tests against a small vehicle of their own.
//!
//! A point mass in the room, with an attitude that follows its setpoint; not the simulator's
//! model, on purpose. x, v in E; u in B:
//!
//! * attitude: each angle second order, 10 rad/s, damping 0.7, after 30 ms (0.17 s to half);
//! * thrust: first order, 0.08 s; acceleration `g·frac·V/4.730 / floor(h)` (the recorded law);
//! * drag: `−k·u` along the body axes, k = 4.2, 1.9, 0.65 1/s;
//! * floor: `1 − 0.16·e^(−2h/m)`, without a pole and not the controller's law;
//! * battery: 8.2 to 6.8 V in a minute, an exaggeration;
//! * attitude bias: the board's level is off, as a servo out of trim would make it;
//! * estimate: truth plus position and velocity noise, first order, from a fixed sequence.

use std::collections::VecDeque;

use super::tests::{estimate, input};
use super::*;
use crate::frames::G_MPS2;

const CONTROL_S: f64 = 0.01;
const SUBSTEPS: usize = 5;

/// Fixed sequence of numbers with mean 0 and variance 1 (twelve uniform numbers summed).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            // Knuth's 64-bit linear congruential generator.
            self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            sum += (self.0 >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum
    }
}

#[derive(Clone, Copy)]
struct World {
    std_pos_m: f64,
    std_vel_mps: f64,
    bias_rad: [f64; 2],
    floor: bool,
    supply_v: [f64; 2],
    drag_per_s: [f64; 3],
}

/// No noise, no bias, constant nominal voltage, no floor.
const CLEAN: World = World {
    std_pos_m: 0.0,
    std_vel_mps: 0.0,
    bias_rad: [0.0; 2],
    floor: false,
    supply_v: [7.4, 7.4],
    drag_per_s: [4.2, 1.9, 0.65],
};

/// All that the real vehicle brings.
const REAL: World = World {
    std_pos_m: 0.05,
    std_vel_mps: 0.08,
    bias_rad: [0.03, -0.04],
    floor: true,
    supply_v: [8.2, 6.8],
    ..CLEAN
};

struct Vehicle {
    world: World,
    noise: Noise,
    t_s: f64,
    pos_E_m: [f64; 3],
    vel_E_mps: [f64; 3],
    euler_rad: [f64; 3],
    rate_radps: [f64; 3],
    thrust_frac: f64,
    pending: VecDeque<[f64; 3]>,
    pos_noise_m: [f64; 3],
    vel_noise_mps: [f64; 3],
}

impl Vehicle {
    fn new(world: World, pos_E_m: [f64; 3], seed: u64) -> Self {
        Self {
            world,
            noise: Noise(seed),
            t_s: 0.0,
            pos_E_m,
            vel_E_mps: [0.0; 3],
            euler_rad: [0.0; 3],
            rate_radps: [0.0; 3],
            thrust_frac: 0.639,
            pending: VecDeque::from([[0.0; 3]; 3]),
            pos_noise_m: [0.0; 3],
            vel_noise_mps: [0.0; 3],
        }
    }

    fn supply_v(&self) -> f64 {
        let [full, empty] = self.world.supply_v;
        full + (empty - full) * (self.t_s / 60.0).min(1.0)
    }

    fn estimate(&mut self) -> Estimate {
        // First-order noise, 0.3 s, of the stated size.
        let (keep, new) = (0.967, (1.0f64 - 0.967 * 0.967).sqrt());
        for i in 0..3 {
            self.pos_noise_m[i] =
                keep * self.pos_noise_m[i] + new * self.world.std_pos_m * self.noise.next();
            self.vel_noise_mps[i] =
                keep * self.vel_noise_mps[i] + new * self.world.std_vel_mps * self.noise.next();
        }
        let sum = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] + b[i]);
        estimate(
            sum(self.pos_E_m, self.pos_noise_m),
            sum(self.vel_E_mps, self.vel_noise_mps),
            self.euler_rad,
        )
    }

    fn advance(&mut self, out: &ControlOutput) {
        self.pending.push_back([out.roll_rad, out.pitch_rad, out.yaw_rad]);
        let target = self.pending.pop_front().expect("never empty");
        let dt_s = CONTROL_S / SUBSTEPS as f64;
        for _ in 0..SUBSTEPS {
            for (i, target) in target.into_iter().enumerate() {
                let gap = target - self.euler_rad[i];
                self.rate_radps[i] += dt_s * (100.0 * gap - 14.0 * self.rate_radps[i]);
                self.euler_rad[i] += dt_s * self.rate_radps[i];
            }
            self.thrust_frac += dt_s / 0.08 * (out.thrust_frac - self.thrust_frac);
            let height_m = -self.pos_E_m[2];
            let floor = if self.world.floor { 1.0 - 0.16 * (-2.0 * height_m).exp() } else { 1.0 };
            let thrust_mps2 = G_MPS2 * self.thrust_frac * self.supply_v() / 4.7303 / floor;
            let [roll, pitch, yaw] = self.euler_rad;
            let R_EB = Rot::<E, B>::from_euler_rad(
                roll + self.world.bias_rad[0],
                pitch + self.world.bias_rad[1],
                yaw,
            );
            let u = R_EB.inverse() * Vec3::from_array(self.vel_E_mps);
            let k = self.world.drag_per_s;
            let force =
                R_EB * Vec3::<B>::new(-k[0] * u.x(), -k[1] * u.y(), -thrust_mps2 - k[2] * u.z());
            let acc = [force.x(), force.y(), force.z() + G_MPS2];
            for (i, acc) in acc.into_iter().enumerate() {
                self.vel_E_mps[i] += dt_s * acc;
                self.pos_E_m[i] += dt_s * self.vel_E_mps[i];
            }
            self.t_s += dt_s;
        }
    }
}

/// What one flight showed.
#[derive(Debug, Clone, Copy, Default)]
struct Flight {
    /// Mean absolute position error per axis over the flight, m.
    mae_m: [f64; 3],
    /// Mean position error per axis over the last 2 s, m.
    rest_m: [f64; 3],
    /// Root mean square of the velocity over the last 2 s, m/s.
    rest_mps: f64,
    /// Farthest beyond the goal, along the step, per axis, m.
    overshoot_m: [f64; 3],
    /// Largest distance from the height of the goal, m.
    sink_m: f64,
}

fn fly(
    config: &ControlConfig,
    world: World,
    from: [f64; 3],
    to: [f64; 3],
    yaw_rad: f64,
    seconds: f64,
    seed: u64,
) -> Flight {
    let mut vehicle = Vehicle::new(world, from, seed);
    vehicle.euler_rad[2] = yaw_rad;
    vehicle.pending = VecDeque::from([[0.0, 0.0, yaw_rad]; 3]);
    let mut controller = Controller::new(config.clone());
    let mut flight = Flight::default();
    // Five seconds to settle where it is, then the step.
    let hover = Command::hold(Vec3::from_array(from), yaw_rad);
    let goal = Command::hold(Vec3::from_array(to), yaw_rad);
    let settle = 500;
    let steps = (seconds / CONTROL_S) as usize;
    for step in 0..settle + steps {
        let seen = vehicle.estimate();
        let case = ControlInput {
            supply_v: Some(vehicle.supply_v()),
            height_above_ground_m: -seen.pos_E_m.z(),
            ..input(&seen, if step < settle { &hover } else { &goal })
        };
        let out = controller.step(&case);
        vehicle.advance(&out);
        if step < settle {
            continue;
        }
        let last = step + 200 >= settle + steps;
        for i in 0..3 {
            let error = vehicle.pos_E_m[i] - to[i];
            flight.mae_m[i] += error.abs() / steps as f64;
            let beyond = error * (to[i] - from[i]).signum();
            flight.overshoot_m[i] = flight.overshoot_m[i].max(beyond);
            if last {
                flight.rest_m[i] += error / 200.0;
                flight.rest_mps += vehicle.vel_E_mps[i].powi(2) / 200.0;
            }
        }
        flight.sink_m = flight.sink_m.max((vehicle.pos_E_m[2] - to[2]).abs());
    }
    flight.rest_mps = flight.rest_mps.sqrt();
    flight
}

fn config(version: Version) -> ControlConfig {
    // The gains of the linear design: it is the laws that are tested here, on a vehicle of the test's
    // own, not what a search found for another one.
    ControlConfig { version, gains: ControlGains::designed(), ..Default::default() }
}

const START: [f64; 3] = [0.0, 0.0, -1.2];

/// Mean over seeds of the mean absolute error along the stepped axis, m.
fn step_error_m(config: &ControlConfig, world: World, axis: usize, size_m: f64) -> f64 {
    let seeds = [3, 1_009, 20_021, 300_007];
    let mut to = START;
    to[axis] += if axis == 2 { -size_m } else { size_m };
    let one = |seed| fly(config, world, START, to, 0.0, 8.0, seed).mae_m[axis];
    seeds.map(one).iter().sum::<f64>() / seeds.len() as f64
}

#[test]
fn prop_steps_converge_without_steady_error_at_any_heading() {
    // A board out of level, a battery that sags and a floor, but a perfect estimate.
    let world = World { std_pos_m: 0.0, std_vel_mps: 0.0, ..REAL };
    for version in [Version::Raw, Version::Modified] {
        for yaw_rad in [0.0, 1.2, -2.5] {
            for to in [[1.0, 0.0, -1.2], [0.0, -2.0, -1.2], [0.0, 0.0, -2.2], [1.0, 1.0, -0.6]] {
                let f = fly(&config(version), world, START, to, yaw_rad, 20.0, 1);
                let said = format!("{version:?} yaw {yaw_rad} to {to:?}: {f:?}");
                // 2 cm: the battery falls by 23 mV/s, which raw follows by its integrator alone.
                assert!(f.rest_m.iter().all(|e| e.abs() < 0.02), "{said}");
                assert!(f.rest_mps < 0.02, "{said}");
                assert!(f.overshoot_m.iter().all(|o| *o < 0.25), "{said}");
            }
        }
    }
}

#[test]
fn prop_modified_tracks_better_than_raw() {
    let sum = |version| -> f64 {
        let one = |size| [0, 1, 2].map(|axis| step_error_m(&config(version), REAL, axis, size));
        [one(1.0), one(2.0)].concat().iter().sum()
    };
    let (raw, modified) = (sum(Version::Raw), sum(Version::Modified));
    assert!(modified < 0.95 * raw, "modified {modified} m, raw {raw} m");
}

#[test]
fn prop_feed_forward_takes_the_overshoot_of_a_forward_step() {
    let overshoot =
        |version| fly(&config(version), CLEAN, START, [1.0, 0.0, -1.2], 0.0, 8.0, 1).overshoot_m[0];
    let (raw, modified) = (overshoot(Version::Raw), overshoot(Version::Modified));
    assert!(modified < 0.5 * raw && modified < 0.05, "modified {modified} m, raw {raw} m");
}

#[test]
fn prop_feed_forward_does_no_harm_to_integrators_that_were_tuned_without_it() {
    // Found for raw in this world by a random walk over the tunables (500 steps): the integrators
    // carry the drag. Without `integral_reference_s` feed-forward makes these a tenth worse.
    let gains = ControlGains {
        pos_x_p_per_s: 1.93,
        pos_y_p_per_s: 1.75,
        vel_x_p_rad_per_mps: 0.303,
        vel_x_i_rad_per_m: 1.39,
        vel_y_p_rad_per_mps: 0.289,
        vel_y_i_rad_per_m: 0.534,
        ..ControlGains::designed()
    };
    let sum = |version, integral_reference_s| -> f64 {
        let mut c = ControlConfig { gains, ..config(version) };
        // As in the walk that found them: at 45 deg the limit cuts less and the harm is smaller.
        c.limits.tilt_deg = 30.0;
        c.drag.integral_reference_s = integral_reference_s;
        let cases = [(0, 1.0), (0, 2.0), (1, 1.0), (1, 2.0)];
        cases.map(|(axis, size)| step_error_m(&c, REAL, axis, size)).iter().sum()
    };
    let raw = sum(Version::Raw, 0.0);
    let modified =
        sum(Version::Modified, crate::control::drag::DragConfig::default().integral_reference_s);
    let naive = sum(Version::Modified, 0.0);
    assert!(modified < 1.03 * raw && naive > 1.08 * raw, "{modified} {naive} {raw}");
}

#[test]
fn prop_voltage_law_holds_height_while_the_battery_sags() {
    let sink = |voltage| {
        let c = ControlConfig { voltage_base_thrust: Some(voltage), ..config(Version::Raw) };
        fly(&c, World { supply_v: [8.2, 6.8], ..CLEAN }, START, START, 0.0, 50.0, 1).mae_m[2]
    };
    let (without, with) = (sink(false), sink(true));
    assert!(with < 0.4 * without && with < 0.01, "with {with} m, without {without} m");
}

#[test]
fn prop_drag_aware_compensation_holds_height_in_forward_flight() {
    let sink = |kind| {
        let c = ControlConfig { tilt_compensation: Some(kind), ..Default::default() };
        fly(&c, CLEAN, START, [2.0, 0.0, -1.2], 0.0, 8.0, 1).sink_m
    };
    let [off, geometric, aware] =
        [TiltCompensation::Off, TiltCompensation::Geometric, TiltCompensation::DragAware].map(sink);
    // Why raw, which knows no drag, has none: the geometric factor more than doubles the error.
    assert!(geometric > 2.0 * off && aware < 0.7 * off, "{off} {geometric} {aware} m");
}

#[test]
fn prop_low_hover_is_stable_where_the_ground_law_is_steep() {
    // The floor of this world is not the controller's law: what it corrects wrongly must not run
    // away, although at 0.34 m it pushes off by 1.1 of the weight per metre.
    for height_m in [0.25, 0.34, 0.4, 0.6] {
        let low = [0.0, 0.0, -height_m];
        for world in [REAL, World { floor: false, ..REAL }] {
            let f = fly(&config(Version::Modified), world, low, low, 0.0, 20.0, 5);
            assert!(f.sink_m < 0.2 && f.mae_m[2] < 0.06, "{height_m} m: {f:?}");
        }
    }
}
