//! A world, flown: its owner's vehicle file and companion, accepted flights of a session, and flights to judge.

use std::ops::Range;

use anyhow::{Context, Result, anyhow, bail};
use haltere_core::survey::Survey;
use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use haltere_gap::bank::fly::fly_in_world;
use haltere_gap::bank::missions::{diagnostic_file, wire};
use haltere_gap::flight::trace::Trace;
use haltere_gap::scene::Scene;
use haltere_model::Vehicle;
use haltere_model::room::Room;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::cases::detectable::Detectable;
use crate::cases::list::mixed;
use crate::generator::effects::{Deviations, SEVERITIES, Spec, known};
use crate::generator::law::{Drawn, Stranger};
use crate::generator::noise::Noise;
use crate::generator::world::{Session, World};
use crate::generator::{Foreign, Setup, hall};
use crate::score::Truth;

/// Accepted flights, all of the first session: what a user has who flies for an hour.
pub const ACCEPTED: u64 = 10;
/// Other sessions, and healthy flights in each.
pub const SESSIONS: u64 = 3;
pub const HEALTHY: u64 = 3;
/// Effects that no library holds, and pairs.
const STRANGERS: u64 = 6;
const PAIRS: u64 = 4;
/// Draws of a world before it is given up.
const DRAWS: u64 = 12;
/// What the owner's numbers are off by, one sigma: scale, ruler, data sheet, and hover and drag by a fit of flights.
const OWNERS: [f64; 5] = [0.01, 0.02, 0.05, 0.01, 0.1];
/// Hover command times voltage that the companion's base thrust is for, V.
const USUAL_V: f64 = 4.73;
/// Of the diagnostic mission are left out: two of four turns, the third leg of each dash, the way along the walls, and of each two
/// doublets the small one. What is left takes half the time, and so does commissioning. Worlds that are reported fly all of it.
const LEFT_OUT: [Range<usize>; 7] = [8..12, 17..18, 22..23, 24..32, 34..36, 38..40, 42..44];

/// A flight to judge.
#[derive(Debug, Clone)]
pub struct Job {
    /// What is the matter.
    pub truth: Truth,
    /// Times the detectable strength; 0: no such thing.
    pub times: f64,
    /// Session.
    pub session: u64,
    seed: u64,
    drawn: Drawn,
}

/// A flight that was judged, or why not.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    /// What was the matter.
    pub truth: Truth,
    /// Times the detectable strength.
    pub times: f64,
    /// Session.
    pub session: u64,
    /// Statistics; `null`: unknown. Absent: the flight did not come to its end, or cannot be observed.
    pub statistics: Option<Vec<Option<f64>>>,
}

/// A world that flies.
pub struct Flyable {
    /// The world.
    pub world: World,
    /// Draws that did not fly healthy, before it.
    pub redrawn: u64,
    /// Room, companion and the owner's vehicle file.
    pub scene: Scene,
    /// The mission.
    pub items: Vec<MISSION_ITEM_INT_DATA>,
    /// Accepted flights.
    pub accepted: Vec<Trace>,
    /// Healthy flights of other sessions.
    pub healthy: Vec<(u64, Trace)>,
}

impl Flyable {
    /// The first draw after `seed` that lands all its healthy flights. `whole`: flies the whole mission, and not the half of it.
    pub fn found(seed: u64, whole: bool, tell: &dyn Fn(String)) -> Result<Self> {
        for redrawn in 0..DRAWS {
            let world = World::drawn(mixed(seed, redrawn));
            let (scene, items) = owned(&world, whole)?;
            let fly = |(session, number): (u64, u64)| {
                let at = world.session(session);
                let seed = mixed(world.seed ^ 0x0ea1, 100 * session + number);
                flown(&world, &scene, &items, &at, seed, Drawn::default())
            };
            // One by one until one fails: most draws that do not fly show it at once.
            if let Err(why) = fly((0, 0)) {
                tell(format!("draw {redrawn} does not fly: {why}"));
                continue;
            }
            let jobs: Vec<(u64, u64)> = (0..ACCEPTED)
                .map(|k| (0, k))
                .chain((1..=SESSIONS).flat_map(|s| (0..HEALTHY).map(move |k| (s, k))))
                .collect();
            let traces: Result<Vec<Trace>> = jobs.par_iter().map(|job| fly(*job)).collect();
            let traces = match traces {
                Ok(traces) => traces,
                Err(why) => {
                    tell(format!("draw {redrawn} does not fly every time: {why}"));
                    continue;
                }
            };
            let mut accepted = traces;
            let others = accepted.split_off(ACCEPTED as usize);
            let healthy = jobs[ACCEPTED as usize..].iter().map(|(s, _)| *s).zip(others).collect();
            return Ok(Self { world, redrawn, scene, items, accepted, healthy });
        }
        bail!("seed {seed}: none of {DRAWS} draws flies healthy")
    }

    /// Flights with an effect each, with a stranger, with two.
    pub fn jobs(&self) -> Vec<Job> {
        let world = &self.world;
        let sizes = Detectable::committed();
        let hall = hall(&self.scene);
        let mut rng = Noise::new(world.seed, "jobs");
        // The walls are not visited.
        let specs: Vec<&'static Spec> = known().filter(|spec| spec.id != "A10").collect();
        let mut cause = |spec: &'static Spec, number: u64| {
            let times = SEVERITIES[rng.below(3)].times();
            let seed = mixed(world.seed ^ 0xca5e, number);
            Some((world.cause(spec, sizes.size(spec, times), seed)?, times))
        };
        let mut jobs = Vec::new();
        for (k, spec) in specs.iter().enumerate() {
            let Some((one, times)) = cause(spec, k as u64) else { continue };
            let truth = Truth::Single {
                id: spec.id.to_owned(),
                block: spec.block.to_owned(),
                theta: Vec::new(),
            };
            jobs.push((truth, times, Drawn { causes: vec![one], ..Drawn::default() }));
        }
        for k in 0..PAIRS {
            let mut rng = Noise::new(world.seed, &format!("pair {k}"));
            let a = rng.below(specs.len());
            let b = (a + 1 + rng.below(specs.len() - 1)) % specs.len();
            let two = [a, b].map(|at| cause(specs[at], 1000 + 10 * k + at as u64));
            let causes: Vec<_> = two.into_iter().flatten().map(|(cause, _)| cause).collect();
            let truth = Truth::Pair { ids: [a, b].map(|at| specs[at].id.to_owned()) };
            jobs.push((truth, 0.0, Drawn { causes, ..Drawn::default() }));
        }
        for k in 0..STRANGERS {
            let stranger: Stranger = world.stranger(k);
            let name = format!("{}: {:?} {:?}", stranger.block(), stranger.at, stranger.law);
            let truth = Truth::Unknown { name };
            jobs.push((truth, 0.0, Drawn { strangers: vec![stranger], ..Drawn::default() }));
        }
        let jobs = jobs.into_iter().zip(0..).map(|((truth, times, drawn), k)| Job {
            truth,
            times,
            session: 1 + k % SESSIONS,
            seed: mixed(world.seed ^ 0x10b5, k),
            drawn: Drawn { hall: Some(hall), ..drawn },
        });
        jobs.collect()
    }

    /// Flies one; `Err`: why it cannot be judged.
    pub fn fly(&self, job: &Job) -> Result<Trace> {
        self.with(job, job.drawn.clone())
    }

    /// The same flight without what is the matter.
    pub fn fly_healthy(&self, job: &Job) -> Result<Trace> {
        self.with(job, Drawn { hall: job.drawn.hall, ..Drawn::default() })
    }

    fn with(&self, job: &Job, drawn: Drawn) -> Result<Trace> {
        let at = self.world.session(job.session);
        flown(&self.world, &self.scene, &self.items, &at, job.seed, drawn)
    }
}

/// Room, companion and vehicle file of the owner, and the mission.
fn owned(world: &World, whole: bool) -> Result<(Scene, Vec<MISSION_ITEM_INT_DATA>)> {
    let craft = &world.craft;
    let mut rng = Noise::new(world.seed, "owner");
    let mut off = |k: usize| 1.0 + OWNERS[k] * rng.normal().clamp(-2.0, 2.0);
    let text = format!(
        "[body]\nmass_kg = {}\ngear_m = {}\ntag_B_m = {:?}\n[wings]\ncentre_m = {}\n[battery]\ncells = 2\ncapacity_mah = {}\n",
        craft.stated_kg * off(0),
        craft.gear_m,
        craft.antenna_B_m,
        craft.wing_m * off(1),
        craft.capacity_as / 3.6 * off(2),
    );
    let vehicle = Vehicle::from_toml(&text).map_err(|problems| anyhow!("{problems}"))?;
    let lab = Scene::lab().map_err(|problems| anyhow!("{problems}"))?;
    let [north_m, east_m, ceiling_m] = world.room_m;
    let room = Room { north_m: [0.0, north_m], east_m: [0.0, east_m], ceiling_m };
    let survey = Survey::new(&room.corner_anchors()).map_err(|problems| anyhow!("{problems}"))?;
    let mut pilot = lab.pilot;
    pilot.flight.gear_height_m = craft.gear_m;
    pilot.estimator.p_BT_B_m = craft.antenna_B_m;
    let hover = craft.hover_command_v / USUAL_V * off(3);
    for c in &mut pilot.control.voltage.base_coefficients_frac {
        *c *= hover;
    }
    for (told, own) in pilot.estimator.drag_per_s.iter_mut().zip(craft.drag_per_s) {
        *told = own * off(4);
    }
    let start_NE_m = [0.5 * north_m, 0.5 * east_m];
    let scene = Scene { room, survey, start_NE_m, vehicle, pilot, until_s: None };
    let mut plan = diagnostic_file(&scene);
    let mut place = 0..;
    plan.items.retain(|_| {
        let k = place.next().unwrap_or(0);
        whole || !LEFT_OUT.iter().any(|range| range.contains(&k))
    });
    let items = wire(&plan);
    Ok((scene, items))
}

fn flown(
    world: &World,
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    at: &Session,
    seed: u64,
    drawn: Drawn,
) -> Result<Trace> {
    let start_NE_m = [0, 1].map(|k| scene.start_NE_m[k] + at.beside_NE_m[k]);
    let scene = Scene { start_NE_m, ..scene.clone() };
    let setup = Setup {
        craft: at.craft.clone(),
        deviations: Deviations::default(),
        drawn,
        computer: at.computer,
        room_seed: world.seed,
        ..Setup::healthy(&scene, seed)
    };
    let trace = fly_in_world(&scene, items, Foreign::new(setup), scene.pilot.clone())
        .map_err(anyhow::Error::new)
        .context("not begun")?;
    match (trace.landed, trace.crashed) {
        (Some(true), Some(false)) if trace.came_as_far_as(None) => Ok(trace),
        (Some(true), Some(false)) => bail!("the mission ended early"),
        (_, Some(true)) => bail!("crashed"),
        _ => bail!("not landed"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A world flies healthy, and an effect by its law flies otherwise.
    #[test]
    fn prop_an_effect_by_a_law_of_the_world_is_flown() {
        let world = World::drawn(mixed(5_601_000, 0));
        let (scene, items) = owned(&world, false).unwrap();
        let at = world.session(1);
        let fly = |drawn| flown(&world, &scene, &items, &at, 7, drawn).unwrap();
        let spec = known().find(|spec| spec.id == "A8").unwrap();
        let cause = world.cause(spec, spec.range[1], 3).unwrap();
        let hall = Some(hall(&scene));
        let seen = [Vec::new(), vec![cause]]
            .map(|causes| fly(Drawn { causes, hall, ..Drawn::default() }))
            .map(|trace| {
                let nominal = haltere_gap::nominal::Nominal::of_scene(&scene);
                haltere_gap::flight::statistics::statistics_of(&trace, &nominal).unwrap()
            });
        let same = seen[0].iter().zip(&seen[1]).filter(|(a, b)| a == b).count();
        assert!(same * 2 < seen[0].len(), "{same} statistics are the same");
    }
}
