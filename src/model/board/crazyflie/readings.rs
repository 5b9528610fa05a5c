//! What its log variables read: sensors, attitude, setpoint and outputs in its own axes and units.
//!
//! Body x forward, y left, z up; the world is that of the anchors, which its filter flies in: x east of its north, y
//! north, z up; g, degrees, hPa.

use std::f64::consts::FRAC_PI_2;

use haltere_core::frames::G_MPS2;
use haltere_dialect::crtp::quaternion;
use haltere_dialect::crtp::value::{Kind, Value};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::Crazyflie;
use super::table::VARIABLES;
use crate::board::outside::PITCH_STROKE_FRAC;
use crate::effects::ImuReading;
use crate::wings::ActuatorCommand;

/// Low-pass of what is logged of the accelerometer, Hz: two of first order, with the delay of its own of second order.
const ACC_HZ: f64 = 30.0;

/// What it senses in a step.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::board) struct Sensed {
    /// Specific force, g, and rates, degrees a second.
    pub acc_g: [f64; 3],
    pub rate_dps: [f64; 3],
    pub pressure_hpa: f64,
    /// x, y, z, w.
    pub q: [f64; 4],
    /// Right down, nose up, counter-clockwise.
    pub roll_deg: f64,
    pub pitch_deg: f64,
    pub yaw_deg: f64,
    pub volt: f64,
    /// m1 to m4.
    pub outputs: [u16; 4],
}

/// Forward, right, down as forward, left, up.
fn flu(v: Vector3<f64>) -> [f64; 3] {
    [v.x, -v.y, -v.z]
}

impl Sensed {
    /// Of an IMU, an attitude in axes forward, right, down, the supply and what the actuators are told; `travel` as
    /// shares of the servos', `before` what was sensed one step ago.
    pub fn new(
        imu: &ImuReading,
        q_NB: &UnitQuaternion<f64>,
        volt: f64,
        output: &ActuatorCommand,
        travel: [f64; 2],
        before: &Self,
    ) -> Self {
        let (roll, pitch, yaw) = q_NB.euler_angles();
        let share = 1.0 - (-std::f64::consts::TAU * ACC_HZ * crate::effects::STEP_S).exp();
        let raw_g = flu(imu.acc_B_mps2 / G_MPS2);
        let acc_g = std::array::from_fn(|i| before.acc_g[i] + share * (raw_g[i] - before.acc_g[i]));
        let share_of = |frac: f64| (frac.clamp(0.0, 1.0) * f64::from(u16::MAX)) as u16;
        let [dihedral, servo] = travel;
        let [left, right] = output.flap_frac;
        // To east, north, up of north, east, down: a quarter turn about up, the rest is in the axes of the body.
        let level =
            UnitQuaternion::from_quaternion(Quaternion::new(q_NB.w, q_NB.i, -q_NB.j, -q_NB.k));
        let q = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2) * level;
        Self {
            acc_g,
            rate_dps: flu(imu.rate_B_radps).map(f64::to_degrees),
            pressure_hpa: imu.pressure_pa / 100.0,
            q: [q.i, q.j, q.k, q.w],
            roll_deg: roll.to_degrees(),
            pitch_deg: pitch.to_degrees(),
            yaw_deg: 90.0 - yaw.to_degrees(),
            volt,
            // Pitch servo, left motor, yaw servo, right motor: the Flapper of revision D. More is nose up, and of the yaw
            // servo nose left.
            outputs: [
                share_of(0.5 + 0.5 * PITCH_STROKE_FRAC * dihedral),
                share_of(left),
                share_of(0.5 - 0.5 * servo),
                share_of(right),
            ],
        }
    }
}

impl Crazyflie {
    /// Value of a log variable; `None`: there is none of this id.
    pub(super) fn value(&self, id: u16) -> Option<Value> {
        if self.other_table && id == 0 {
            return Some(Value::Int(1));
        }
        let variable = VARIABLES.get(usize::from(id) - usize::from(self.other_table))?;
        let s = &self.sensed;
        let bits = self.supervisor.bits();
        let axis = |name: &str, of: [f64; 3]| match name {
            "x" | "roll" => of[0],
            "y" | "pitch" => of[1],
            _ => of[2],
        };
        let value = match (variable.group, variable.name) {
            ("motor", name) => f64::from(s.outputs[usize::from(name.as_bytes()[1] - b'1')]),
            ("loco", _) => self.loco.mode() as f64,
            ("deckStatus", _) => f64::from(u8::from(self.has_deck_fault())),
            ("tdoa2", name) => self.loco.tdoa_m[usize::from(name.as_bytes()[3] - b'0')],
            ("pm", "vbat") => s.volt,
            ("pm", "vbatMV") => (s.volt * 1000.0).round(),
            ("controller", name) => {
                let [roll, pitch, _] = self.commander.target_deg;
                axis(name, [roll, pitch, self.commander.yaw_deg])
            }
            ("stateEstimateZ", _) => f64::from(quaternion::pack(s.q)),
            ("stateEstimate", "qx") => s.q[0],
            ("stateEstimate", "qy") => s.q[1],
            ("stateEstimate", "qz") => s.q[2],
            ("stateEstimate", "qw") => s.q[3],
            ("stateEstimate" | "stabilizer", "roll") => s.roll_deg,
            ("stateEstimate" | "stabilizer", "pitch") => s.pitch_deg,
            ("stateEstimate" | "stabilizer", "yaw") => s.yaw_deg,
            ("gyro", name) => axis(name, s.rate_dps),
            ("acc", name) => axis(name, s.acc_g),
            ("baro", "pressure") => s.pressure_hpa,
            ("stabilizer" | "ctrltarget", "thrust") => f64::from(self.commander.thrust),
            ("ctrltarget", name) => axis(name, self.commander.target_deg),
            ("supervisor", _) => f64::from(bits.bits()),
            ("sys", "canfly") => f64::from(u8::from(self.supervisor.can_fly())),
            ("sys", "isFlying") => f64::from(u8::from(bits.bits() & 0x10 != 0)),
            ("sys", "isTumbled") => f64::from(u8::from(self.supervisor.is_tumbled())),
            // What nobody here asks for: rates, and its own position.
            _ => 0.0,
        };
        let whole = variable.kind != Kind::F32;
        Some(if whole { Value::Int(value as i64) } else { Value::Float(value) })
    }
}
