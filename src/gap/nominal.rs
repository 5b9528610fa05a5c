//! Nominal: what the nominal chain predicts from logged inputs, block by block. Closed forms of the
//! vehicle file, and a small linear model of each attitude loop; the plant is not called.

use haltere_core::frames::G_MPS2;
use haltere_model::Vehicle;
use haltere_model::board::BoardSettings;
use haltere_model::room::Room;

use crate::scene::Scene;

/// Period of the attitude model, s: the control period.
pub const RESPONSE_STEP_S: f64 = 0.01;
/// Turns of the attitude model in a period.
const TURNS: usize = 4;
/// Lag that the loops' explained error decays with, s: `model::board::Loops`.
const EXPECTED_S: f64 = 0.17;
/// Error that the yaw loop acts on, rad.
const YAW_ERROR_LIMIT_RAD: f64 = 0.4;

/// The nominal chain.
#[derive(Debug, Clone)]
pub struct Nominal {
    /// The vehicle file.
    pub vehicle: Vehicle,
    /// The board's settings.
    pub board: BoardSettings,
    /// Floor, walls and ceiling.
    pub room: Room,
    /// As in the scene: how far into the mission flights are looked at.
    pub until_s: Option<f64>,
}

impl Nominal {
    /// The vehicle of this scene with the default board.
    pub fn of_scene(scene: &Scene) -> Self {
        Self {
            vehicle: scene.vehicle.clone(),
            board: BoardSettings::default(),
            room: scene.room.clone(),
            until_s: scene.until_s,
        }
    }

    /// Flap rate of each wing over that of hover, for a throttle and a voltage, settled.
    pub fn flap_target_hz(&self, thrust_frac: f64, supply_v: f64) -> f64 {
        let w = &self.vehicle.wings;
        if thrust_frac <= 0.0 {
            return 0.0;
        }
        // Bounded as in effect N24: no power of a voltage that is none.
        let share = (supply_v / self.vehicle.rated_v()).max(0.1);
        let turned_hz =
            w.flap_hz_per_v * thrust_frac * supply_v * share.powf(w.voltage_exponent - 1.0);
        (turned_hz + w.flap_offset_hz).max(0.0)
    }

    /// Thrust of both wings, N.
    pub fn thrust_n(&self, flap_hz: f64) -> f64 {
        let w = &self.vehicle.wings;
        let line_n = (2.0 * w.thrust_n_per_hz * flap_hz + w.thrust_offset_n).max(0.0);
        if flap_hz <= 0.0 {
            return line_n;
        }
        let weight_n = self.vehicle.body.mass_kg * G_MPS2;
        let bend = flap_hz / self.vehicle.hover_hz() - 1.0;
        (line_n + weight_n * w.thrust_curve * bend * bend).max(0.0)
    }

    /// Drag rate along a body axis at a flap rate, 1/s.
    pub fn drag_per_s(&self, axis: usize, flap_hz: f64) -> f64 {
        self.vehicle.drag.k_ns_per_m_hz[axis] * 2.0 * flap_hz / self.vehicle.body.mass_kg
    }

    /// Factor of thrust near the floor; `height_m` of the feet.
    pub fn ground_factor(&self, height_m: f64) -> f64 {
        let g = &self.vehicle.ground;
        1.0 + g.gain * (-height_m.max(0.0) / g.length_m).exp()
    }

    /// Current at a flap rate and voltage, A.
    pub fn current_a(&self, flap_hz: f64, supply_v: f64) -> f64 {
        let b = &self.vehicle.battery;
        let ratio = flap_hz / self.vehicle.hover_hz();
        (b.electronics_w + b.hover_w * ratio.powi(3)) / supply_v.max(1.0)
    }

    /// Voltage at a charge and current, V.
    pub fn supply_v(&self, charge_frac: f64, current_a: f64) -> f64 {
        let b = &self.vehicle.battery;
        let at = charge_frac.clamp(0.0, 1.0) * 10.0;
        let low = (at as usize).min(9);
        let cell_v = b.cell_v[low] + (b.cell_v[low + 1] - b.cell_v[low]) * (at - low as f64);
        b.cells * cell_v - b.resistance_ohm * current_a
    }

    /// Response of the roll (0), pitch (1) or yaw (2) loop to its setpoint, both at the control
    /// period, rad. Linear about hover:
    ///
    /// `q' = a - D q`, `a` the loop's wanted acceleration through its actuator (roll: what the lead
    /// leaves of the flap lag; pitch and yaw: the servo), `D` damping of airframe and lever.
    pub fn response_rad(&self, axis: usize, setpoint_rad: &[f64], start_rad: f64) -> Vec<f64> {
        let (v, s) = (&self.vehicle, &self.board);
        let l = &v.inner_loop;
        let (w, z) = (l.frequency_radps[axis], l.damping[axis]);
        let beats = 2.0 * v.hover_hz();
        let k = v.drag.k_ns_per_m_hz;
        let (arm, lever) = (v.wings.centre_m.powi(2), v.wings.cop_m.powi(2));
        let inertia = v.body.inertia_kgm2[axis];
        let own = v.drag.damping_factor * k[0] * arm * beats / v.body.inertia_kgm2[2];
        let (damping, rate_gain) = match axis {
            0 => ((k[2] * arm + k[1] * lever) * beats / inertia, 2.0 * w * z),
            1 => (k[0] * lever * beats / inertia, 2.0 * w * z),
            _ => (own, (2.0 * w * z - own).max(0.0)),
        };
        let servo = match axis {
            0 => None,
            1 => Some((v.pitch_servo.frequency_radps, v.pitch_servo.damping)),
            _ => Some((v.yaw_servo.frequency_radps, v.yaw_servo.damping)),
        };
        let dt = RESPONSE_STEP_S / TURNS as f64;
        let keep = (-dt / EXPECTED_S).exp();
        let (mut angle, mut rate, mut acc, mut jerk) = (start_rad, 0.0, 0.0, 0.0);
        let most_boost = if axis == 2 { l.boost_yaw } else { l.boost };
        let (mut boost, mut expected) = (0.0, 0.0);
        let mut last = setpoint_rad.first().copied().unwrap_or(0.0);
        let mut out = Vec::with_capacity(setpoint_rad.len());
        let late = (l.delay_ms * 1e-3 / dt).round() as usize;
        for k in 0..setpoint_rad.len() {
            for turn in 0..TURNS {
                let target = setpoint_rad[(k * TURNS + turn).saturating_sub(late) / TURNS];
                expected = (expected + target - last) * keep;
                last = target;
                let mut e = target - angle;
                if axis == 2 {
                    e = e.clamp(-YAW_ERROR_LIMIT_RAD, YAW_ERROR_LIMIT_RAD);
                }
                boost += ((e - expected) * most_boost - boost) * dt / l.boost_s;
                e += boost;
                let wanted = w * w * e - rate_gain * rate;
                match servo {
                    None => acc += (wanted - acc) * dt / s.lead_s[1],
                    Some((f, d)) => {
                        jerk += dt * (f * f * (wanted - acc) - 2.0 * d * f * jerk);
                        acc += dt * jerk;
                    }
                }
                rate += dt * (acc - damping * rate);
                angle += dt * rate;
            }
            out.push(angle);
        }
        out
    }
}
