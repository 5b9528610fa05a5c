//! Flies a mission in lockstep and keeps the trace of it.

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;

use crate::flight::trace::Trace;
use crate::scene::Scene;
use haltere_core::checks::Problems;
use haltere_core::frames::Vec3;
use haltere_model::lockstep::{FlightError, Lockstep, SAMPLE_US, World, fly_unsampled};
use haltere_model::{Plant, PlantConfig};
use haltere_pilot::{Mission, Mode, PilotConfig};

/// Any flight is waited for that long, s: the diagnostic flight lasts 100 s, with a missed waypoint
/// here and there somewhat longer.
const LEAST_LIMIT_S: f64 = 150.0;
/// A longer mission for this many times its length as planned (judgement; the standard flights last 0.92 to 0.99 of theirs, and
/// the diagnostic one stays at the limit above).
const PATIENCE: f64 = 1.2;
/// And none longer than that, s: a pack of 300 mAh lasts four to six minutes (GAP.md 3.0).
pub const MOST_LIMIT_S: f64 = 600.0;

/// From the start of a flight to the first item of its mission, s: spool-up and climb take 4 s.
const TO_THE_MISSION_S: f64 = 20.0;

/// Why there is no trace.
#[derive(Debug, thiserror::Error)]
pub enum NotFlown {
    /// The plant cannot be built.
    #[error("plant: {0}")]
    Plant(Problems),
    /// The flight did not begin.
    #[error(transparent)]
    Flight(#[from] FlightError),
}

/// Flies in the nominal plant, deviations included as configured. A flight that crashes or does not
/// land is still a trace.
pub fn fly_observed(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    plant: PlantConfig,
    pilot: PilotConfig,
) -> Result<Trace, NotFlown> {
    let mut trace = Trace::new(scene.survey.clone());
    fly_observed_into(&mut trace, scene, items, plant, pilot)?;
    Ok(trace)
}

/// The same into a trace that is there, for flights by the thousand; what it held is gone.
pub fn fly_observed_into(
    trace: &mut Trace,
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    plant: PlantConfig,
    pilot: PilotConfig,
) -> Result<(), NotFlown> {
    let plant = Plant::new(plant).map_err(NotFlown::Plant)?;
    Ok(fly_into(trace, scene, items, plant, pilot)?)
}

/// Flies in any world.
pub fn fly_in_world<W: World>(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    world: W,
    pilot: PilotConfig,
) -> Result<Trace, FlightError> {
    let mut trace = Trace::new(scene.survey.clone());
    fly_into(&mut trace, scene, items, world, pilot)?;
    Ok(trace)
}

/// How long a flight is waited for, s.
fn limit_s(scene: &Scene, mission: &Mission) -> f64 {
    let [north_m, east_m] = scene.start_NE_m;
    let length_s = mission.length_s(Vec3::new(north_m, east_m, 0.0), &scene.pilot.flight);
    let whole_s = (PATIENCE * length_s).clamp(LEAST_LIMIT_S, MOST_LIMIT_S);
    // What is not looked at need not be flown.
    scene.until_s.map_or(whole_s, |until_s| whole_s.min(until_s + TO_THE_MISSION_S))
}

fn fly_into<W: World>(
    trace: &mut Trace,
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    world: W,
    pilot: PilotConfig,
) -> Result<(), FlightError> {
    trace.clear();
    trace.survey.clone_from(&scene.survey);
    let mut lockstep = Lockstep::in_world(world, pilot, &scene.survey, None).without_streams();
    let (mut crashed, mut carried_s) = (false, 0.0);
    let limit_s = |mission: &Mission| limit_s(scene, mission);
    let landed = fly_unsampled(&mut lockstep, items, limit_s, |lockstep| {
        let truth = lockstep.truth();
        crashed |= truth.crashed;
        lockstep.pilot_mut().drain_topics(|topic| trace.take(topic));
        if truth.on_ground && trace.modes.last().is_some_and(|m| m.mode == Mode::Mission.name()) {
            carried_s += SAMPLE_US as f64 * 1e-6;
        }
    })?;
    trace.landed = Some(landed);
    trace.crashed = Some(crashed);
    trace.carried_s = Some(carried_s);
    Ok(())
}
