//! Worlds in which the steps of table 3 are flown: the nominal one, and each with one thing changed in both versions.

use anyhow::Result;
use haltere_model::PlantConfig;
use haltere_pilot::PilotConfig;

use super::bench::Bench;

/// What is changed in a trial: one thing, in both versions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum World {
    /// Nothing.
    Nominal,
    /// The vehicle has the forward drag sideways too, and both versions know.
    EqualDrag,
    /// UWB without its position-dependent bias.
    NoPathBias,
    /// UWB without noise of its receptions.
    NoNoise,
    /// The battery begins half empty.
    HalfEmpty,
    /// `modified` has no drag in its filter, as the source's has not.
    SourceSet,
    /// Horizontal gains of the public firmware.
    PublicGains,
    /// The limit of climb and sink of the public firmware.
    SlowClimb,
    /// The feed-forward of `modified` without its low-pass.
    QuickFeedForward,
}

/// All of them, the nominal one first.
pub const WORLDS: [World; 9] = [
    World::Nominal,
    World::EqualDrag,
    World::NoPathBias,
    World::NoNoise,
    World::HalfEmpty,
    World::SourceSet,
    World::PublicGains,
    World::SlowClimb,
    World::QuickFeedForward,
];

impl World {
    /// What is changed, for people.
    pub fn name(self) -> &'static str {
        match self {
            World::Nominal => "nominal",
            World::EqualDrag => "sideways drag as large as the forward one",
            World::NoPathBias => "no UWB path bias",
            World::NoNoise => "no UWB noise",
            World::HalfEmpty => "battery half empty at the start",
            World::SourceSet => "no drag in the filter of modified, as in the source",
            World::PublicGains => "gains of the vehicle's public firmware in both",
            World::SlowClimb => {
                "climb and sink limited to 1 m/s, as in the public firmware, in both"
            }
            World::QuickFeedForward => "feed-forward without its low-pass",
        }
    }

    /// Plant and pilot of this world.
    pub fn build(self, bench: &Bench, seed: u64) -> Result<(PlantConfig, PilotConfig)> {
        let mut plant = PlantConfig::hall(seed);
        let mut pilot = bench.pilot.clone();
        let gains = &mut pilot.control.gains;
        match self {
            World::Nominal => {}
            World::EqualDrag => {
                let k = &mut plant.vehicle.drag.k_ns_per_m_hz;
                k[1] = k[0];
                pilot.control.drag.roll = pilot.control.drag.pitch;
                pilot.control.drag.roll_inverse = pilot.control.drag.pitch_inverse;
                pilot.estimator.drag_per_s[1] = pilot.estimator.drag_per_s[0];
            }
            World::NoPathBias => plant.effects = plant.effects.without("N16")?,
            World::NoNoise => plant.effects = plant.effects.without("N15")?,
            World::HalfEmpty => plant.vehicle.battery.charge_frac = HALF_EMPTY,
            World::SourceSet => pilot.control.filter_drag = Some(false),
            World::SlowClimb => pilot.control.limits.vertical_mps = PUBLIC_CLIMB_MPS,
            World::QuickFeedForward => pilot.control.drag.filter_s = 0.0,
            World::PublicGains => {
                [gains.vel_x_p_rad_per_mps, gains.vel_y_p_rad_per_mps] =
                    PUBLIC_P_DEG.map(f64::to_radians);
                for i in [&mut gains.vel_x_i_rad_per_m, &mut gains.vel_y_i_rad_per_m] {
                    *i = PUBLIC_I_DEG.to_radians();
                }
                (gains.vel_x_d_rad_per_mps2, gains.vel_y_d_rad_per_mps2) = (0.0, 0.0);
                (gains.pos_x_p_per_s, gains.pos_y_p_per_s) = (PUBLIC_POS_PER_S, PUBLIC_POS_PER_S);
            }
        }
        Ok((plant, pilot))
    }
}

/// Charge that is left of a battery which is half empty and still lasts for the programme.
const HALF_EMPTY: f64 = 0.55;
/// Horizontal gains of the public firmware of this vehicle: degrees forward and sideways per m/s, degrees per m, 1/s
/// (crazyflie-firmware of 2022, platform_defaults_flapper.h: PID_VEL_X_KP 15, PID_VEL_Y_KP 10, KI 1, PID_POS_KP 1.5).
const PUBLIC_P_DEG: [f64; 2] = [15.0, 10.0];
const PUBLIC_I_DEG: f64 = 1.0;
const PUBLIC_POS_PER_S: f64 = 1.5;
/// Its limit of climb and sink, m/s (the same file, PID_POS_VEL_Z_MAX).
const PUBLIC_CLIMB_MPS: f64 = 1.0;
