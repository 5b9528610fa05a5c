//! Trace: everything that the diagnosis may see of a flight, from the pilot's own records.
//!
//! A trace from lockstep, from a flight log and from an import look alike; truth is not in it.

use haltere_core::estimate::Estimate;
use haltere_core::measure::{
    BaroSample, BatterySample, BoardAttitude, ImuSample, ReferencePose, ServoOutput,
};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_core::topics::{ControlRecord, HealthRecord, ModeRecord, TextRecord, Topic, UwbRecord};
use haltere_pilot::{MISSION_LANDS, Mode};

/// Samples expected of a flight of 100 s, so that filling does not reallocate: IMU at 250 Hz.
const IMU_EXPECTED: usize = 30_000;
/// TDOA at 1 kHz.
const UWB_EXPECTED: usize = 110_000;
/// Control steps at 100 Hz.
const STEPS_EXPECTED: usize = 12_000;

/// Longest landing that is looked at, s: from the diagnostic flight's 1 m it takes 4 s. A vehicle that does
/// not notice the floor sits on it with spinning wings, and no model of flight says anything about that.
const LANDING_S: f64 = 12.0;

/// How much of its mission a flight holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissionPart {
    /// When the mission took over.
    pub from: HostTime,
    /// How long it was flown, s.
    pub flown_s: f64,
    /// Whether it came to its own landing; one that somebody ordered, or the supervisor, is none.
    pub whole: bool,
}

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
    /// What the board told motors and servos.
    pub servos: Vec<ServoOutput>,
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
    /// How long the floor carried it during the mission, s, where somebody knows.
    pub carried_s: Option<f64>,
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
            servos: Vec::new(),
            modes: Vec::new(),
            references: Vec::new(),
            health: Vec::new(),
            texts: Vec::new(),
            landed: None,
            crashed: None,
            carried_s: None,
        }
    }

    /// Empties it for the next flight. The memory stays: to have it, and what the smoother kept, from the system anew
    /// for each flight of a bank took 7 % of the processor time (1.2 of 11.5 s went to the kernel, now 0.4).
    pub fn clear(&mut self) {
        self.imu.clear();
        self.uwb.clear();
        self.estimates.clear();
        self.controls.clear();
        self.batteries.clear();
        self.attitudes.clear();
        self.baros.clear();
        self.servos.clear();
        self.modes.clear();
        self.references.clear();
        self.health.clear();
        self.texts.clear();
        (self.landed, self.crashed, self.carried_s) = (None, None, None);
    }

    /// How much of the mission was flown; `None`: there was none.
    pub fn mission_part(&self) -> Option<MissionPart> {
        let begun = self.modes.iter().position(|m| m.mode == Mode::Mission.name())?;
        let from = self.modes[begun].at;
        let next = self.modes.get(begun + 1);
        let end = next.map(|m| m.at).or(self.controls.last().map(|c| c.at))?;
        let whole = next.is_some_and(|m| m.mode == Mode::Land.name() && m.cause == MISSION_LANDS);
        Some(MissionPart { from, flown_s: end.seconds_since(from), whole })
    }

    /// Whether the mission was flown to its landing, or at least `until_s` of it: what flights that stand beside
    /// one another must have.
    pub fn came_as_far_as(&self, until_s: Option<f64>) -> bool {
        self.mission_part().is_some_and(|part| {
            part.whole || until_s.is_some_and(|until_s| part.flown_s >= until_s)
        })
    }

    /// Last instant that is looked at: the end of the landing, or `until_s` into the mission.
    pub fn looked_at_until(&self, until_s: Option<f64>) -> Option<HostTime> {
        let last = self.controls.last()?.at;
        let Some(part) = self.mission_part() else { return Some(last) };
        let span_s = match until_s {
            Some(until_s) => until_s.min(part.flown_s),
            None if part.whole => part.flown_s + LANDING_S,
            None => return Some(last),
        };
        Some(last.min(part.from.offset_us((span_s * 1e6) as i64)))
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
            Topic::Servos(r) => self.servos.push(r),
            // The diagnosis has no use for these.
            Topic::Mag(_) | Topic::OtherBattery(_) | Topic::Shadow(_) => {}
            Topic::Reference(r) => self.references.push(r),
            Topic::Mode(r) => self.modes.push(r),
            Topic::Text(r) => self.texts.push(r),
            Topic::Health(r) => self.health.push(r),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::topics::ControlRecord;

    fn trace(modes: &[(&'static str, u64)], end_s: u64) -> Trace {
        let mut trace = Trace::new(crate::scene::Scene::lab().unwrap().survey);
        for (mode, at_s) in modes {
            trace.modes.push(ModeRecord {
                at: HostTime::from_us(at_s * 1_000_000),
                mode,
                armed: true,
                cause: MISSION_LANDS.into(),
            });
        }
        trace.controls.push(ControlRecord {
            at: HostTime::from_us(end_s * 1_000_000),
            ..ControlRecord::default()
        });
        trace
    }

    #[test]
    fn prop_a_flight_is_looked_at_to_its_landing_and_not_beyond() {
        let whole = trace(&[("takeoff", 5), ("mission", 8), ("land", 100)], 300);
        let part = whole.mission_part().unwrap();
        assert!(part.whole && part.flown_s == 92.0, "{part:?}");
        let end = whole.looked_at_until(None).unwrap();
        assert_eq!(end.as_us(), 112_000_000, "twelve seconds of landing");
        let felled = trace(&[("takeoff", 5), ("mission", 8), ("disarmed", 48)], 150);
        let part = felled.mission_part().unwrap();
        assert!(!part.whole && part.flown_s == 40.0, "{part:?}");
        assert_eq!(felled.looked_at_until(Some(30.0)).unwrap().as_us(), 38_000_000);
        assert!(felled.came_as_far_as(Some(40.0)) && whole.came_as_far_as(None));
        assert!(!felled.came_as_far_as(Some(41.0)) && !felled.came_as_far_as(None));
        assert!(trace(&[("takeoff", 5)], 20).mission_part().is_none());
        let mut ordered = whole;
        ordered.modes[2].cause = "off course".into();
        assert!(!ordered.came_as_far_as(None), "the supervisor's landing is not the mission's");
        assert!(ordered.came_as_far_as(Some(92.0)));
    }
}
