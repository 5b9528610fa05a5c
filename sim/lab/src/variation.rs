//! The nominal vehicle and what every vehicle of its kind may bring: a slow board, a late link, drag of other wings, a
//! spent battery, a heading that is not north, and loops whose gain is off.

use haltere_core::checks::Problems;
use haltere_core::control::{ControlConfig, ControlGains, Tunable};
use haltere_model::PlantConfig;

/// A vehicle that differs from the nominal one.
#[derive(Debug, Clone, Copy)]
pub struct Variation {
    /// For messages.
    pub name: &'static str,
    /// Effects switched on, with a parameter each.
    effects: &'static [(&'static str, &'static [(&'static str, f64)])],
    /// Heading at the start, degrees.
    heading_deg: f64,
    /// Factor on the position gains and on the velocity gains: how much the loop gain may be off.
    loop_gain: [f64; 2],
    /// The filter knows drag, whatever the version.
    right_estimate: bool,
}

const NOMINAL: Variation = Variation {
    name: "nominal",
    effects: &[],
    heading_deg: 0.0,
    loop_gain: [1.0, 1.0],
    right_estimate: false,
};

/// Margin of each loop, 6 dB: the usual least.
const GAIN_MARGIN: f64 = 2.0;

/// What a vehicle of this kind may bring. Severities are those that are typical of the effect list.
pub const VARIATIONS: [Variation; 8] = [
    NOMINAL,
    Variation {
        name: "attitude loop 40 % slower",
        effects: &[("L1", &[("factor", 0.6)])],
        right_estimate: true,
        ..NOMINAL
    },
    Variation {
        name: "setpoints 40 ms late",
        effects: &[("T2", &[("delay", 40.0)])],
        right_estimate: true,
        ..NOMINAL
    },
    Variation {
        name: "position loop gain x 2",
        loop_gain: [GAIN_MARGIN, 1.0],
        right_estimate: true,
        ..NOMINAL
    },
    Variation {
        name: "velocity loop gain x 2",
        loop_gain: [1.0, GAIN_MARGIN],
        right_estimate: true,
        ..NOMINAL
    },
    Variation {
        name: "battery half empty, heading 30 deg",
        effects: &[("N7", &[("charge", 0.55)])],
        heading_deg: 30.0,
        ..NOMINAL
    },
    Variation {
        name: "drag -30 %",
        effects: &[("A1", &[("kappa_x", 0.7), ("kappa_y", 0.7), ("kappa_z", 0.7)])],
        ..NOMINAL
    },
    Variation {
        name: "drag +30 %",
        effects: &[("A1", &[("kappa_x", 1.3), ("kappa_y", 1.3), ("kappa_z", 1.3)])],
        ..NOMINAL
    },
];

impl Variation {
    /// This variation of a plant.
    pub fn plant(&self, mut plant: PlantConfig) -> Result<PlantConfig, Problems> {
        for (id, values) in self.effects {
            plant.effects = plant.effects.with(id, values)?;
        }
        plant.start_yaw_rad = self.heading_deg.to_radians();
        Ok(plant)
    }

    /// The controller as flown on this variation.
    pub fn control(&self, control: &ControlConfig) -> ControlConfig {
        ControlConfig {
            gains: self.gains(&control.gains),
            filter_drag: if self.right_estimate { Some(true) } else { control.filter_drag },
            ..control.clone()
        }
    }

    /// Gains that act as `gains` would on a vehicle with this loop gain.
    fn gains(&self, gains: &ControlGains) -> ControlGains {
        let [position, velocity] = self.loop_gain;
        let mut vector = gains.as_vector();
        for (value, Tunable { name, .. }) in vector.iter_mut().zip(ControlGains::TUNABLES) {
            if name.starts_with("pos_") && !name.ends_with("_d_frac") {
                *value *= position;
            } else if name.starts_with("vel_") && name != "vel_d_filter_s" {
                *value *= velocity;
            }
        }
        ControlGains::from_vector(vector)
    }
}
