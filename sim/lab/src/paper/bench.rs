//! What every experiment works with: the configuration, seeds, worlds, missions and the progress bar.

use anyhow::{Result, bail};
use rayon::prelude::*;

use haltere::progress::Progress;
use haltere_core::control::{ControlConfig, Version};
use haltere_core::frames::Vec3;
use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd};
use haltere_model::PlantConfig;
use haltere_model::lockstep::{Flight, Lockstep, Sample, fly};
use haltere_pilot::{Action, CONDITIONS, Mode, PilotConfig};

use super::beside::Beside;
use super::ladder;
use crate::compare::{CENTRE_NE_M, in_plant};
use crate::steps::item;

/// First seed unless another is asked for; no search was made on it or on those that follow.
pub const SEED: u64 = 100;
/// Setpoints move at once from this speed on: above every velocity limit that is allowed, m/s.
const JUMP_MPS: f32 = 20.0;
/// Radius within which a stepped setpoint counts as reached, m: the largest there is, so that the
/// time at a point is counted from the jump.
const AT_ONCE_M: f32 = 5.0;

/// Everything that all experiments share.
pub struct Bench {
    /// Configuration of the companion.
    pub pilot: PilotConfig,
    /// Repetitions of each experiment, each with a seed of its own.
    pub repetitions: u64,
    /// Seed of the first.
    pub seed: u64,
    /// How far everything is, in simulated seconds.
    pub progress: Progress,
    /// The steps as another world flew them.
    pub beside: Option<Beside>,
}

impl Bench {
    /// Seeds of the repetitions.
    pub fn seeds(&self) -> impl Iterator<Item = u64> + Clone + use<> {
        self.seed..self.seed + self.repetitions
    }

    /// The configuration in one of the two versions.
    pub fn version(&self, version: Version) -> ControlConfig {
        ControlConfig { version, ..self.pilot.control.clone() }
    }

    /// As printed, and as shipped: `version` of the source, and which of ours stands for it.
    pub fn both(&self, version: Version) -> [ControlConfig; 2] {
        let ours = if version == Version::Paper { Version::Modified } else { version };
        [ladder::printed(&self.pilot.control, version), self.version(ours)]
    }

    /// Each case with each seed, on all cores; `seconds` is what one flight takes of simulated time.
    pub fn each<C: Sync, T: Send>(
        &self,
        cases: &[C],
        seconds: f64,
        run: impl Fn(&C, u64) -> Result<T> + Sync,
    ) -> Result<Vec<Vec<T>>> {
        let jobs: Vec<(usize, u64)> =
            (0..cases.len()).flat_map(|c| self.seeds().map(move |seed| (c, seed))).collect();
        let flown: Vec<T> = jobs
            .into_par_iter()
            .map(|(c, seed)| {
                let result = run(&cases[c], seed);
                self.progress.advance(seconds as u64);
                result
            })
            .collect::<Result<_>>()?;
        let mut flown = flown.into_iter();
        Ok(cases.iter().map(|_| flown.by_ref().take(self.repetitions as usize).collect()).collect())
    }

    /// Flies a plan in any plant.
    pub fn fly_in(
        &self,
        plant: PlantConfig,
        control: &ControlConfig,
        plan: &Plan,
    ) -> Result<Flight> {
        let mut world = self.world(plant, control)?;
        let flight = fly(&mut world, &plan.items, plan.limit_s)?;
        // Half an experiment is none: its figures would be those of the landing.
        if let Some(order) = flight.texts.iter().find(|text| is_order(text)) {
            bail!("the supervisor ended the flight: {order}");
        }
        Ok(flight)
    }

    /// A world ready for take-off.
    pub fn world(&self, plant: PlantConfig, control: &ControlConfig) -> Result<Lockstep> {
        let mut pilot = self.pilot.clone();
        // The source flew batteries down at one place; the way home is none.
        pilot.supervisor.battery_home = Action::Tell;
        in_plant(&pilot, control, plant)
    }
}

/// Whether a text tells of a mode that the supervisor ordered.
fn is_order(text: &str) -> bool {
    let ordered = |mode: &str| Mode::ALL.iter().any(|m| m.name() == mode);
    text.trim_end().split_once(": ").is_some_and(|(mode, because)| {
        ordered(mode) && CONDITIONS.iter().any(|row| row.because == because)
    })
}

/// A mission from the middle of the hall.
pub struct Plan {
    /// As uploaded.
    pub items: Vec<MISSION_ITEM_INT_DATA>,
    /// The flight is broken off after this time, s.
    pub limit_s: f64,
}

impl Plan {
    /// Take-off to a height, m, and rest there; setpoints jump from then on.
    pub fn from_height(height_m: f64, limit_s: f64) -> Self {
        let mut plan = Self { items: Vec::new(), limit_s };
        plan.items.push(item(MavCmd::MAV_CMD_NAV_TAKEOFF, at([0.0, 0.0, height_m])));
        let mut settle = item(MavCmd::MAV_CMD_NAV_WAYPOINT, at([0.0, 0.0, height_m]));
        settle.param1 = 4.0;
        plan.items.push(settle);
        let mut speed = item(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [0.0; 3]);
        speed.param2 = JUMP_MPS;
        plan.items.push(speed);
        plan
    }

    /// Setpoint to a place (north, east of the middle, height, m) at once, for a time, s. The number
    /// of the leg, for [`leg`].
    pub fn step(&mut self, place_m: [f64; 3], hold_s: f64) -> usize {
        let mut point = item(MavCmd::MAV_CMD_NAV_WAYPOINT, at(place_m));
        point.param1 = hold_s as f32;
        point.param2 = AT_ONCE_M;
        self.items.push(point);
        self.items.len() - 1
    }

    /// Lands.
    pub fn land(mut self) -> Self {
        self.items.push(item(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3]));
        self
    }
}

/// A place relative to the middle of the hall, height upward, in the Earth frame, m.
pub fn at([north, east, height]: [f64; 3]) -> [f64; 3] {
    Vec3::<haltere_core::frames::E>::new(CENTRE_NE_M[0] + north, CENTRE_NE_M[1] + east, -height)
        .to_array()
}

/// Samples from the moment a leg is reached until the next item is.
pub fn leg(flight: &Flight, number: usize) -> &[Sample] {
    let of = |s: &Sample| usize::from(s.reached);
    let start = flight.samples.partition_point(|s| of(s) < number + 1);
    let end = flight.samples.partition_point(|s| of(s) <= number + 1);
    &flight.samples[start..end]
}
