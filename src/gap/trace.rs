//! Trace: everything that the diagnosis may see of a flight, from the pilot's own records.
//!
//! A trace from lockstep, from a flight log and from an import look alike; truth is not in it.

use crate::estimate::Estimate;
use crate::measure::{BaroSample, BatterySample, BoardAttitude, ImuSample, ReferencePose};
use crate::survey::Survey;
use crate::topics::{ControlRecord, HealthRecord, ModeRecord, TextRecord, Topic, UwbRecord};

/// Samples expected of a flight of 100 s, so that filling does not reallocate: IMU at 250 Hz.
const IMU_EXPECTED: usize = 30_000;
/// TDOA at 1 kHz.
const UWB_EXPECTED: usize = 110_000;
/// Control steps at 100 Hz.
const STEPS_EXPECTED: usize = 12_000;

/// The records of one flight, each kind in the order in which it came.
#[derive(Debug, Clone)]
pub struct Trace {
    /// The anchors as the companion was told.
    pub survey: Survey,
    /// IMU samples.
    pub imu: Vec<ImuSample>,
    /// TDOA and their fate.
    pub uwb: Vec<UwbRecord>,
    /// States of the pilot's filter.
    pub estimates: Vec<Estimate>,
    /// Control steps with thrust.
    pub controls: Vec<ControlRecord>,
    /// Battery.
    pub batteries: Vec<BatterySample>,
    /// The board's own attitude.
    pub attitudes: Vec<BoardAttitude>,
    /// Air pressure.
    pub baros: Vec<BaroSample>,
    /// Changes of mode.
    pub modes: Vec<ModeRecord>,
    /// Motion capture.
    pub references: Vec<ReferencePose>,
    /// Losses and timing.
    pub health: Vec<HealthRecord>,
    /// Texts for people.
    pub texts: Vec<TextRecord>,
    /// Whether the flight ended disarmed on the floor, where somebody knows.
    pub landed: Option<bool>,
    /// Whether the vehicle broke, where somebody knows.
    pub crashed: Option<bool>,
}

impl Trace {
    /// Nothing yet.
    pub fn new(survey: Survey) -> Self {
        Self {
            survey,
            imu: Vec::with_capacity(IMU_EXPECTED),
            uwb: Vec::with_capacity(UWB_EXPECTED),
            estimates: Vec::with_capacity(STEPS_EXPECTED),
            controls: Vec::with_capacity(STEPS_EXPECTED),
            batteries: Vec::new(),
            attitudes: Vec::with_capacity(STEPS_EXPECTED),
            baros: Vec::new(),
            modes: Vec::new(),
            references: Vec::new(),
            health: Vec::new(),
            texts: Vec::new(),
            landed: None,
            crashed: None,
        }
    }

    /// One record more.
    pub fn take(&mut self, topic: Topic) {
        match topic {
            Topic::Imu(r) => self.imu.push(r),
            Topic::Uwb(r) => self.uwb.push(r),
            Topic::Estimate(r) => self.estimates.push(r),
            Topic::Control(r) => self.controls.push(r),
            Topic::Battery(r) => self.batteries.push(r),
            Topic::BoardAttitude(r) => self.attitudes.push(r),
            Topic::Baro(r) => self.baros.push(r),
            Topic::Reference(r) => self.references.push(r),
            Topic::Mode(r) => self.modes.push(r),
            Topic::Text(r) => self.texts.push(r),
            Topic::Health(r) => self.health.push(r),
        }
    }
}
