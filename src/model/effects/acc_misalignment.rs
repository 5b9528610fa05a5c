//! The board sits crooked on the airframe.
//!
//! `y_sensor = R(φ, θ)ᵀ y_body` for accelerometer and gyroscope, and the board's attitude leans by the
//! same angles: `R_believed = R_true R(φ, θ)`. `φ`, `θ` roll and pitch of the board against the
//! thrust axis (deg). Size by judgement: 1 to 4°.

use nalgebra::{UnitQuaternion, Vector3};

use crate::effects::{
    AttitudeError, Block, Deviation, Effect, EffectSpec, Hidden, ImuReading, Kind, ParameterSpec,
    Role, Stage, State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "M4",
    name: "IMU misalignment",
    block: Block::Imu,
    parameters: &[
        ParameterSpec::new(
            "roll",
            "deg",
            Kind::Component,
            0.0,
            0.0,
            [-4.0, 4.0],
            "board rolled against the airframe",
        )
        .ways("left side down", "right side down"),
        ParameterSpec::new(
            "pitch",
            "deg",
            Kind::Component,
            0.0,
            2.0,
            [-4.0, 4.0],
            "board pitched against it",
        )
        .ways("nose down", "nose up"),
    ],
    off: "board square to the thrust axis",
    source: "plausible sizes by judgement",
    equation: "y_sensor = Rᵀ y_body, R_believed = R_true R",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.354, 0.707, 1.0]),
        verdict: "The board sits crooked on the airframe: {}.",
        causes: "a soft or bent mounting, a level calibration on a table that is not level",
        remedy: "level-calibrate the board, or shim it: its IMU is not level",
        shows: "a horizontal error in proportion to thrust",
        looks_like: &["M1"],
        apart: "Fly throttle doublets: this follows thrust, a bias (M1) does not.",
    }),
    build: |b| {
        let lean = Vector3::new(b.value[0].to_radians(), b.value[1].to_radians(), 0.0);
        Box::new(Misalignment { lean, turn: UnitQuaternion::from_scaled_axis(lean).inverse() })
    },
};

struct Misalignment {
    lean: Vector3<f64>,
    turn: UnitQuaternion<f64>,
}

impl Effect for Misalignment {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Imu, Stage::Attitude]
    }
    fn imu(&mut self, _s: &State, reading: &mut ImuReading) {
        reading.acc_B_mps2 = self.turn * reading.acc_B_mps2;
        reading.rate_B_radps = self.turn * reading.rate_B_radps;
    }
    fn attitude(&mut self, _s: &State, error: &mut AttitudeError) {
        error.tilt_B_rad += self.lean;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_nose_up_board_feels_thrust_forward() {
        let mut r = probe::reading();
        probe::build(&SPEC, &[]).imu(&probe::hover(), &mut r);
        // A board pitched up by θ sees the upward specific force lean to its front: g sin θ.
        let want = 9.80665 * 2f64.to_radians().sin();
        assert!((r.acc_B_mps2.x - want).abs() < 1e-9, "{}", r.acc_B_mps2.x);
        assert!((r.acc_B_mps2.norm() - 9.80665).abs() < 1e-9);
        let mut e = AttitudeError::default();
        probe::build(&SPEC, &[]).attitude(&probe::hover(), &mut e);
        assert!((e.tilt_B_rad.y.to_degrees() - 2.0).abs() < 1e-12);
    }
}
