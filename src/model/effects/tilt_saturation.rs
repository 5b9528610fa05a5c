//! The board does not lean further than some angle.
//!
//! Tilt of the setpoint is cut at `limit` (deg), heading kept: the turn from level to the setpoint is shortened
//! about its axis. Size by judgement: 8 to 15°.

use nalgebra::Vector3;

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Setpoint, Stage, State,
};
use nalgebra::UnitQuaternion;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "L5",
    name: "tilt saturation",
    block: Block::InnerLoop,
    parameters: &[ParameterSpec::new(
        "limit",
        "deg",
        Kind::Inverse,
        180.0,
        11.0,
        [8.0, 15.0],
        "largest tilt",
    )],
    off: "every tilt obeyed",
    source: "plausible sizes by judgement",
    equation: "tilt <= limit",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.533, 1.0, 1.0]),
        verdict: "The board leans the vehicle no farther than {limit}.",
        causes: "a limit of tilt that is set on the board, servos at the end of their travel",
        remedy: "check the travel of the servos and the limits on the board",
        shows: "attitude that is cut off at one value",
        looks_like: &["L1"],
        apart: "A slow loop (L1) comes to the lean late, a limit never: hold a large lean for a \
            second.",
    }),
    build: |b| Box::new(TiltSaturation(b.value[0].to_radians())),
};

struct TiltSaturation(f64);

impl Effect for TiltSaturation {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Setpoint]
    }
    fn setpoint(&mut self, _s: &State, setpoint: &mut Setpoint) {
        let up = setpoint.q * Vector3::z();
        let tilt = up.z.clamp(-1.0, 1.0).acos();
        if tilt > self.0 && tilt > 0.0 {
            // q = tilt about a horizontal axis, after the heading.
            let full = UnitQuaternion::rotation_between(&Vector3::z(), &up);
            if let Some(full) = full {
                let heading = full.inverse() * setpoint.q;
                setpoint.q = full.powf(self.0 / tilt) * heading;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_cuts_tilt_and_keeps_heading() {
        let tilt_of = |roll: f64, pitch: f64, yaw: f64| {
            let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let mut s = Setpoint { q, thrust_frac: 0.6 };
            probe::build(&SPEC, &[]).setpoint(&probe::hover(), &mut s);
            let up = s.q * Vector3::z();
            (up.z.acos().to_degrees(), s.q.angle_to(&q).to_degrees(), s.q.euler_angles().2)
        };
        let (tilt, _, yaw) = tilt_of(0.0, 0.4, 1.0);
        assert!((tilt - 11.0).abs() < 1e-6 && (yaw - 1.0).abs() < 1e-9);
        let (_, change, _) = tilt_of(0.1, 0.1, -2.0);
        assert!(change < 1e-6);
    }
}
