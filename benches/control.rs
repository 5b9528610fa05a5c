//! Time of one control step: `cargo bench --bench control`. Best of several runs, since the machine
//! is shared and only the least disturbed run says something about the code.

use std::hint::black_box;
use std::time::Instant;

use haltere_core::control::{Command, ControlConfig, ControlInput, Controller, Version};
use haltere_core::estimate::{Estimate, Health};
use haltere_core::frames::{Rot, Vec3};
use haltere_core::time::HostTime;

const RUNS: usize = 20;
const STEPS: usize = 100_000;

fn main() {
    // Different estimates, so that no branch and no value can be foreseen.
    let estimates: Vec<Estimate> = (0..256)
        .map(|i| {
            let phase = f64::from(i) * 0.1;
            Estimate {
                at: HostTime::from_us(0),
                pos_E_m: Vec3::new(phase.sin(), phase.cos(), -1.2),
                vel_B_mps: Vec3::new(0.8 * phase.cos(), -0.6 * phase.sin(), 0.1 * phase.sin()),
                R_EB: Rot::from_euler_rad(0.1 * phase.sin(), -0.2 * phase.cos(), 0.3 * phase.sin()),
                rate_B_radps: Vec3::zero(),
                std_pos_E_m: Vec3::zero(),
                std_vel_B_mps: Vec3::zero(),
                std_att_B_rad: Vec3::zero(),
                uwb_noise_factor: 1.0,
                health: Health::Good,
            }
        })
        .collect();
    let command = Command::hold(Vec3::new(0.2, -0.1, -1.5), 0.1);
    for version in [Version::Raw, Version::Modified] {
        let config = ControlConfig { version, ..Default::default() };
        let mut best_ns = f64::INFINITY;
        for _ in 0..RUNS {
            let mut controller = Controller::new(config.clone());
            let begun = Instant::now();
            for step in 0..STEPS {
                let estimate = &estimates[step % estimates.len()];
                let out = controller.step(black_box(&ControlInput {
                    at: estimate.at,
                    estimate,
                    command: &command,
                    supply_v: Some(7.5),
                    height_above_ground_m: 1.0,
                    dt_s: 0.01,
                    integrators_frozen: false,
                    thrust_ceiling_frac: 1.0,
                    held: None,
                }));
                black_box(&out);
            }
            best_ns = best_ns.min(begun.elapsed().as_secs_f64() * 1e9 / STEPS as f64);
        }
        println!("control step, {version:?}: {best_ns:.0} ns (best of {RUNS} x {STEPS})");
    }
}
