//! Measurements, decoded: what the pilot core passes to estimator and control.
//!
//! Every measurement says when it was true (`valid_at`) and when its bytes came (`received_at`).

use crate::frames::{B, E, Rot, Vec3};
use crate::time::HostTime;

/// Number of a UWB anchor, as on the air.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AnchorId(pub u8);

impl std::fmt::Display for AnchorId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

/// One reading of accelerometer and gyroscope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// When it was true.
    pub valid_at: HostTime,
    /// When its bytes came.
    pub received_at: HostTime,
    /// Specific force, body frame, m/s²: at rest (0, 0, -g).
    pub acc_B_mps2: Vec3<B>,
    /// Angular rate, body frame, rad/s.
    pub rate_B_radps: Vec3<B>,
}

/// One time difference of arrival, as a difference of distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tdoa {
    /// When it was true.
    pub valid_at: HostTime,
    /// When its bytes came.
    pub received_at: HostTime,
    /// Anchor that is subtracted.
    pub anchor_a: AnchorId,
    /// Anchor that is added.
    pub anchor_b: AnchorId,
    /// `|p - p_b| - |p - p_a|`, m.
    pub distance_diff_m: f64,
    /// One sigma as the tag states it, m.
    pub std_m: Option<f64>,
}

/// Attitude as the board believes it, from the board's own north.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardAttitude {
    /// When it was true.
    pub valid_at: HostTime,
    /// When its bytes came.
    pub received_at: HostTime,
    /// Takes body vectors to the board's own NED frame, whose north need not be room north.
    pub attitude: Rot<E, B>,
}

/// Battery as the board measures it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BatterySample {
    /// When its bytes came.
    pub received_at: HostTime,
    /// Pack voltage, V.
    pub supply_v: f64,
    /// Current drawn, A.
    pub current_a: Option<f64>,
    /// State of charge, 0 to 1.
    pub remaining_frac: Option<f64>,
}

/// A battery of the board that is not flown on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OtherBattery {
    /// Its instance id.
    pub id: u8,
    /// What it is for, MAV_BATTERY_FUNCTION.
    pub function: u8,
    /// What it reads.
    pub sample: BatterySample,
}

/// What the board told motors and servos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServoOutput {
    /// When its bytes came.
    pub received_at: HostTime,
    /// Set of outputs, from 0.
    pub port: u8,
    /// As the board tells them: pulse widths, µs, or what its driver takes. NaN: an output that is not in use.
    outputs: [f32; Self::MOST],
    count: u8,
}

impl ServoOutput {
    /// Most outputs of a set: those of ACTUATOR_OUTPUT_STATUS.
    pub const MOST: usize = 32;

    /// What was told of each output, in order. Those at the end that are not in use (NaN) are left out, and what is
    /// beyond [`ServoOutput::MOST`].
    pub fn new(received_at: HostTime, port: u8, told: impl IntoIterator<Item = f32>) -> Self {
        let mut all = Self { received_at, port, outputs: [f32::NAN; Self::MOST], count: 0 };
        for (n, (slot, value)) in (1..).zip(all.outputs.iter_mut().zip(told)) {
            *slot = value;
            if value.is_finite() {
                all.count = n;
            }
        }
        all
    }

    /// From the first output on.
    pub fn outputs(&self) -> &[f32] {
        self.outputs.get(..usize::from(self.count)).unwrap_or(&[])
    }
}

/// Height from air pressure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaroSample {
    /// When it was true.
    pub valid_at: HostTime,
    /// When its bytes came.
    pub received_at: HostTime,
    /// Absolute pressure, Pa.
    pub pressure_pa: f64,
}

/// Magnetic field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MagSample {
    /// When it was true.
    pub valid_at: HostTime,
    /// When its bytes came.
    pub received_at: HostTime,
    /// Field, body frame, as calibrated by the board, T.
    pub field_B_tesla: Vec3<B>,
}

/// Pose from motion capture: truth for the log, fused only if configured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferencePose {
    /// When it was true.
    pub valid_at: HostTime,
    /// When its bytes came.
    pub received_at: HostTime,
    /// Position, Earth frame, m.
    pub pos_E_m: Vec3<E>,
    /// Attitude, when given.
    pub attitude: Option<Rot<E, B>>,
}
