//! Setpoints: what the newest one asks for, whether it may give thrust, and how its angles are meant.
//!
//! On the wire of the legacy packet roll right and pitch nose up are positive, a yaw rate clockwise, an absolute yaw
//! counter-clockwise from above (crazyflie-firmware 2a18fc29, `crtp_commander_rpyt.c`).

use haltere_dialect::crtp::value::Value;
use nalgebra::UnitQuaternion;

use super::readings::Sensed;
use super::table::PARAMETERS;
use crate::effects::{STEP_S, Setpoint};

/// Thrust below this is none, and none is above that, of 65535.
const LEAST: u16 = 1000;
const MOST: u16 = 60_000;
/// A desired yaw that is turned by a rate stays this near to the yaw, degrees (`YAW_MAX_DELTA`).
const LEASH_DEG: f64 = 30.0;

/// How yaw is told.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Yaw {
    /// Counter-clockwise, degrees a second.
    Rate(f64),
    /// As it stands in a legacy packet, which a parameter tells how to read.
    Legacy(f64),
}

#[derive(Debug, Clone, Copy)]
struct Asked {
    at_us: u64,
    roll_deg: f64,
    pitch_deg: f64,
    yaw: Yaw,
    thrust: u16,
}

/// The commander.
#[derive(Default)]
pub(super) struct Commander {
    asked: Option<Asked>,
    /// A packet without thrust has come.
    unlocked: bool,
    /// In force: roll right, pitch nose up, degrees, and yaw rate counter-clockwise, degrees a second.
    pub target_deg: [f64; 3],
    /// Desired yaw, counter-clockwise, degrees.
    pub yaw_deg: f64,
    /// Thrust that the mixer is told, of 65535.
    pub thrust: u16,
}

fn parameter(values: &[Value], group: &str, name: &str) -> f64 {
    let place = PARAMETERS.iter().position(|p| p.group == group && p.name == name);
    place.and_then(|n| values.get(n)).map_or(0.0, |value| value.f64())
}

impl Commander {
    /// A legacy packet: roll, pitch and yaw as on the wire.
    pub fn attitude(&mut self, now_us: u64, [roll, pitch, yaw]: [f32; 3], thrust: u16) {
        self.unlocked |= thrust == 0;
        let thrust = if self.unlocked && thrust >= LEAST { thrust.min(MOST) } else { 0 };
        self.ask(now_us, [roll, pitch], Yaw::Legacy(yaw.into()), thrust);
    }

    /// A manual one: its yaw rate is counter-clockwise, nothing is locked or limited.
    pub fn manual(&mut self, now_us: u64, [roll, pitch, rate]: [f32; 3], thrust: u16) {
        self.ask(now_us, [roll, pitch], Yaw::Rate(rate.into()), thrust);
    }

    /// Cuts until the next one.
    pub fn stop(&mut self, now_us: u64) {
        self.ask(now_us, [0.0; 2], Yaw::Rate(0.0), 0);
    }

    fn ask(&mut self, at_us: u64, [roll, pitch]: [f32; 2], yaw: Yaw, thrust: u16) {
        let (roll_deg, pitch_deg) = (roll.into(), pitch.into());
        self.asked = Some(Asked { at_us, roll_deg, pitch_deg, yaw, thrust });
    }

    /// Age of the newest one, µs.
    pub fn age_us(&self, now_us: u64) -> u64 {
        self.asked.map_or(u64::MAX, |asked| now_us.saturating_sub(asked.at_us))
    }

    pub fn gives_thrust(&self) -> bool {
        self.thrust > 0
    }

    /// What is to be flown in this step; `None`: motors off.
    pub fn target(
        &mut self,
        can_fly: bool,
        level: bool,
        sensed: &Sensed,
        parameters: &[Value],
    ) -> Option<Setpoint> {
        let asked = self.asked.filter(|_| can_fly);
        self.thrust = asked.map_or(0, |asked| asked.thrust);
        let Some(asked) = asked.filter(|asked| asked.thrust > 0) else {
            // Without thrust the controllers are cleared, and the yaw is the present one.
            (self.target_deg, self.yaw_deg) = ([0.0; 3], sensed.yaw_deg);
            return None;
        };
        let absolute = parameter(parameters, "flightmode", "stabModeYaw") == 1.0;
        let rate_dps = match asked.yaw {
            _ if level => 0.0,
            Yaw::Legacy(yaw_deg) if absolute => {
                self.yaw_deg = wrapped(yaw_deg);
                0.0
            }
            Yaw::Legacy(clockwise) => -clockwise,
            Yaw::Rate(rate) => rate,
        };
        if rate_dps != 0.0 {
            let off = wrapped(self.yaw_deg + rate_dps * STEP_S - sensed.yaw_deg);
            self.yaw_deg = wrapped(sensed.yaw_deg + off.clamp(-LEASH_DEG, LEASH_DEG));
        }
        let tilt = if level { [0.0; 2] } else { [asked.roll_deg, asked.pitch_deg] };
        self.target_deg = [tilt[0], tilt[1], rate_dps];
        // Down and clockwise from north in the plant's world, where pitch is nose up as well; its own counts from east.
        let q = UnitQuaternion::from_euler_angles(
            tilt[0].to_radians(),
            tilt[1].to_radians(),
            (90.0 - self.yaw_deg).to_radians(),
        );
        Some(Setpoint { q, thrust_frac: f64::from(asked.thrust) / f64::from(u16::MAX) })
    }
}

/// To ±180°.
fn wrapped(deg: f64) -> f64 {
    (deg + 180.0).rem_euclid(360.0) - 180.0
}
