//! A whole flight in lockstep: align, arm, fly a mission, land, with a sample per control step.

use haltere_dialect::mav::LOCAL_PER_M;
use haltere_dialect::mav::haltere::{
    MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMessage, MavMissionResult, MavResult,
};

use crate::Truth;
use haltere_core::estimate::Estimate;
use haltere_core::topics::ControlRecord;
use haltere_pilot::{Mission, Mode};

use super::{Ground, Lockstep, World};

/// Time to find the start values, µs.
const ALIGN_US: u64 = 20_000_000;
/// Time for a board to arm, µs.
const ARM_US: u64 = 40_000_000;
/// Time between two samples, µs: the control period.
pub const SAMPLE_US: u64 = 10_000;

/// What was true, believed and wanted at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Simulated time, µs.
    pub t_us: u64,
    /// Mode in force.
    pub mode: Mode,
    /// Number of mission items reached so far.
    pub reached: u16,
    /// Truth.
    pub truth: Truth,
    /// Estimate.
    pub estimate: Estimate,
    /// Inside of the control step.
    pub control: ControlRecord,
}

/// A flight that was flown.
#[derive(Debug, Clone)]
pub struct Flight {
    /// One sample per control step, from arming to the end.
    pub samples: Vec<Sample>,
    /// Texts of the vehicle.
    pub texts: Vec<String>,
    /// Whether it ended disarmed on the floor.
    pub landed: bool,
}

impl Flight {
    /// What the vehicle said last, for who has to say why a flight is none.
    pub fn last_words(&self) -> &str {
        self.texts.last().map_or("the vehicle said nothing", String::as_str)
    }
}

/// A mission item at a place, Earth, m, with its first parameter; no heading is asked for.
pub fn local_item(command: MavCmd, point_E_m: [f64; 3], param1: f32) -> MISSION_ITEM_INT_DATA {
    MISSION_ITEM_INT_DATA {
        command: command as u16,
        frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        x: (point_E_m[0] * LOCAL_PER_M).round() as i32,
        y: (point_E_m[1] * LOCAL_PER_M).round() as i32,
        z: point_E_m[2] as f32,
        param1,
        param4: f32::NAN,
        ..Default::default()
    }
}

/// Why a flight did not take place.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FlightError {
    /// The estimator found no start values.
    #[error("not aligned after {seconds} s; the vehicle said: {}", texts.join("; "))]
    NotAligned {
        /// How long was waited.
        seconds: u64,
        /// What the vehicle said.
        texts: Vec<String>,
    },
    /// The vehicle refused.
    #[error("{what} refused with {result}; the vehicle said: {}", texts.join("; "))]
    Refused {
        /// What was asked.
        what: &'static str,
        /// The answer.
        result: String,
        /// What the vehicle said.
        texts: Vec<String>,
    },
}

/// Uploads a mission, arms as soon as the vehicle allows it, and starts the mission.
pub fn start<W: World>(
    world: &mut Lockstep<W>,
    ground: &mut Ground,
    items: &[MISSION_ITEM_INT_DATA],
) -> Result<(), FlightError> {
    make_ready(world, ground, items)?;
    match ground.command(world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]) {
        Some(MavResult::MAV_RESULT_ACCEPTED) => Ok(()),
        other => Err(FlightError::Refused {
            what: "mission start",
            result: answer(other),
            texts: ground.texts.clone(),
        }),
    }
}

/// Uploads a mission and arms as soon as the vehicle allows it.
pub fn make_ready<W: World>(
    world: &mut Lockstep<W>,
    ground: &mut Ground,
    items: &[MISSION_ITEM_INT_DATA],
) -> Result<(), FlightError> {
    let refused = |what, result: String, ground: &Ground| FlightError::Refused {
        what,
        result,
        texts: ground.texts.clone(),
    };
    match ground.upload(world, items) {
        Some(MavMissionResult::MAV_MISSION_ACCEPTED) => {}
        other => return Err(refused("mission", answer(other), ground)),
    }
    let arm = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let asked_us = world.t_us();
    loop {
        match ground.command(world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, arm) {
            Some(MavResult::MAV_RESULT_ACCEPTED) => return Ok(()),
            // Not ready yet: alignment takes its time.
            Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED)
                if world.t_us() < asked_us + ALIGN_US =>
            {
                world.run_until(world.t_us() + 500_000);
            }
            Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED) => {
                ground.listen(world);
                return Err(FlightError::NotAligned {
                    seconds: (world.t_us() - asked_us) / 1_000_000,
                    texts: ground.texts.clone(),
                });
            }
            // The board is asked and takes its time, as one that settles after its boot does.
            None | Some(MavResult::MAV_RESULT_FAILED) if world.t_us() < asked_us + ARM_US => {
                world.run_until(world.t_us() + 500_000);
            }
            other => return Err(refused("arming", answer(other), ground)),
        }
    }
}

fn answer(result: Option<impl std::fmt::Debug>) -> String {
    result.map_or_else(|| "no answer".to_owned(), |result| format!("{result:?}"))
}

/// Flies a mission to its end, or until `limit_s` of simulated time.
///
/// The mission should end with a landing; otherwise the flight is landed at the limit.
pub fn fly<W: World>(
    world: &mut Lockstep<W>,
    items: &[MISSION_ITEM_INT_DATA],
    limit_s: f64,
) -> Result<Flight, FlightError> {
    fly_watched(world, items, limit_s, |_| {})
}

/// The same; `watch` is called after every control step, to read the core's records as they come.
pub fn fly_watched<W: World>(
    world: &mut Lockstep<W>,
    items: &[MISSION_ITEM_INT_DATA],
    limit_s: f64,
    watch: impl FnMut(&mut Lockstep<W>),
) -> Result<Flight, FlightError> {
    let mut samples = Vec::with_capacity((limit_s * 100.0) as usize + 1000);
    let (landed, texts) = flown(
        world,
        items,
        |_| limit_s,
        watch,
        |world, reached| {
            samples.push(Sample {
                t_us: world.t_us(),
                mode: world.pilot().mode(),
                reached,
                truth: world.truth(),
                estimate: *world.pilot().estimate(),
                control: *world.pilot().control_record(),
            });
        },
    )?;
    Ok(Flight { samples, texts, landed })
}

/// The same without samples, for flights by the thousand; whether it ended disarmed on the floor. `limit_s`: how long
/// is waited for the mission, as the core understood it.
pub fn fly_unsampled<W: World>(
    world: &mut Lockstep<W>,
    items: &[MISSION_ITEM_INT_DATA],
    limit_s: impl FnOnce(&Mission) -> f64,
    watch: impl FnMut(&mut Lockstep<W>),
) -> Result<bool, FlightError> {
    flown(world, items, limit_s, watch, |_, _| {}).map(|(landed, _)| landed)
}

/// Whether it landed, and texts; `sample` hears of every control step when its messages have been read, with the
/// number of items reached.
fn flown<W: World>(
    world: &mut Lockstep<W>,
    items: &[MISSION_ITEM_INT_DATA],
    limit_s: impl FnOnce(&Mission) -> f64,
    mut watch: impl FnMut(&mut Lockstep<W>),
    mut sample: impl FnMut(&Lockstep<W>, u16),
) -> Result<(bool, Vec<String>), FlightError> {
    let mut ground = Ground::new();
    start(world, &mut ground, items)?;
    let mut reached = 0;
    let start_us = world.t_us();
    let end_us = start_us + (limit_s(world.pilot().mission()) * 1e6) as u64;
    let mut airborne = false;
    let mut next_us = start_us;
    let landed = loop {
        next_us += SAMPLE_US;
        world.run_until(next_us);
        watch(world);
        ground.listen(world);
        let count = |m: &MavMessage| match m {
            MavMessage::MISSION_ITEM_REACHED(r) => Some(r.seq + 1),
            _ => None,
        };
        while let Some(seq) = ground.take(count) {
            reached = seq;
        }
        sample(world, reached);
        let mode = world.pilot().mode();
        airborne |= mode.is_flying();
        if airborne && mode == Mode::Disarmed {
            break true;
        }
        if world.t_us() >= end_us {
            break false;
        }
    };
    Ok((landed, ground.texts))
}
