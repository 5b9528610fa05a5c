//! One flight of a campaign: what it is flown with. Follows from the campaign's digest and its number
//! alone.

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail};
use haltere_core::checks::Problems;
use haltere_model::Vehicle;
use haltere_model::random::Stream;
use haltere_pilot::mission_file::MissionFile;
use haltere_pilot::settings::Config;
use sha2::{Digest, Sha256};
use toml::{Table, Value};

use super::draw::{grain, set};
use super::entry::Parts;
use super::file::{Base, Campaign};
use super::judge::Fence;
use super::takeoff::TakeOff;
use crate::simulated::faults::{FaultAt, Phase};
use crate::simulated::scenario::Scenario;

/// A flight before it is flown.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Its number.
    pub index: u64,
    /// Seed of all its random numbers.
    pub seed: u64,
    /// What was drawn, by key.
    pub drawn: BTreeMap<String, serde_json::Value>,
    /// Where it is flown.
    pub scenario: Scenario,
    /// With what.
    pub vehicle: Vehicle,
    /// By which companion.
    pub config: Config,
    /// What is flown.
    pub mission: MissionFile,
    /// How it takes off.
    pub take_off: TakeOff,
    /// Where it may be.
    pub fence: Fence,
    /// Longest, s.
    pub limit_s: f64,
}

/// Keys of the catalogue's grid in rows and tables.
pub const FAULT: &str = "fault";
/// Part of the flight.
pub const PHASE: &str = "phase";
const REPEAT: &str = "repeat";
/// When it comes in that part.
pub const FAULT_AT: &str = "fault_at_s";
/// Volume that the companion is told; `default`: none.
pub const VOLUME: &str = "volume";
/// How a flight with a fault from the floor on takes off.
pub const TAKE_OFF: &str = "take_off";
/// Such a flight may come so much higher than anybody asked for, m.
const OVER_ASKED_M: f64 = 0.8;
/// Phase of a fault that is there before the flight begins.
pub const FROM_START: &str = "start";

/// When in a phase a fault comes, s from its begin. The phases of the committed mission last longer.
fn span_s(phase: Phase) -> [f64; 2] {
    match phase {
        Phase::Spool => [0.0, 0.8],
        Phase::Climb => [0.2, 1.8],
        Phase::Hover => [0.5, 4.0],
        Phase::Waypoints => [0.5, 10.0],
        Phase::Return => [0.3, 3.0],
        Phase::Landing => [0.2, 2.5],
        // From 0.15 m at 0.25 m/s: before the floor, on it, and while the wings stop.
        Phase::Touchdown => [0.0, 1.4],
    }
}

/// Seed of a flight, small enough for every file format.
fn seed_of(digest: &str, index: u64) -> u64 {
    let mut hash = Sha256::new();
    hash.update(digest);
    hash.update(index.to_le_bytes());
    let bytes: [u8; 8] = std::array::from_fn({
        let all = hash.finalize();
        move |i| all[i]
    });
    u64::from_le_bytes(bytes) >> 11
}

impl Campaign {
    /// The flight of this number.
    pub fn plan(&self, index: u64) -> Result<Plan> {
        self.try_plan(index).with_context(|| format!("flight {index}"))
    }

    /// Numbers of fault, phase and repetition in the grid of the catalogue.
    pub fn fault_place(&self, index: u64) -> Option<(usize, usize, u64)> {
        let (faults, phases) = (self.faults.len() as u64, self.phases.len() as u64);
        if faults == 0 || phases == 0 {
            return None;
        }
        let (fault, rest) = (index % faults, index / faults);
        let (phase, repeat) = (rest % phases, rest / phases);
        Some((usize::try_from(fault).ok()?, usize::try_from(phase).ok()?, repeat))
    }

    /// Whether this flight has the companion's default volume.
    pub fn in_default_volume(&self, index: u64) -> bool {
        let every = self.file.faults.as_ref().map_or(0, |grid| grid.default_volume_every);
        // Diagonal, so that each fault and each phase has its share of both volumes.
        every > 0
            && self.fault_place(index).is_some_and(|(fault, phase, repeat)| {
                ((fault + phase) as u64 + repeat).is_multiple_of(every)
            })
    }

    /// Brings the fault of this flight in, if the campaign has a catalogue. What is left of the number counts the
    /// other grids.
    fn place_fault(
        &self,
        index: u64,
        seed: u64,
        scenario: &mut Table,
        config: &mut Table,
        drawn: &mut BTreeMap<String, serde_json::Value>,
    ) -> Result<u64> {
        let (Some((fault, phase, repeat)), Some(grid)) =
            (self.fault_place(index), self.file.faults.as_ref())
        else {
            return Ok(index);
        };
        if self.in_default_volume(index) {
            forget_volume(config);
            drawn.insert(VOLUME.to_owned(), "default".into());
        }
        let entry = &self.faults[fault];
        let Parts { fault: faults, told, floor } = entry.parts()?;
        if floor {
            let way = TakeOff::ALL[phase % TakeOff::ALL.len()];
            drawn.insert(TAKE_OFF.to_owned(), way.name().into());
            drawn.insert(PHASE.to_owned(), FROM_START.into());
            add_faults(scenario, faults, None, 0.0)?;
        } else if let Some(told) = told {
            set(scenario, "told", Value::Table(told))?;
            drawn.insert(PHASE.to_owned(), FROM_START.into());
        } else {
            let phase = self.phases[phase];
            let [low_s, high_s] = span_s(phase);
            let at_s = grain(Stream::new(seed, FAULT_AT).between(low_s, high_s));
            add_faults(scenario, faults, Some(phase), at_s)?;
            drawn.insert(PHASE.to_owned(), phase.name().into());
            drawn.insert(FAULT_AT.to_owned(), at_s.into());
        }
        drawn.insert(FAULT.to_owned(), entry.name.clone().into());
        drawn.insert(REPEAT.to_owned(), (repeat % grid.repeats).into());
        Ok(repeat / grid.repeats)
    }

    fn try_plan(&self, index: u64) -> Result<Plan> {
        let seed = seed_of(&self.digest, index);
        let mut drawn = BTreeMap::new();
        let mut scenario = self.base.scenario.clone();
        let mut mission = self.base.mission.clone();
        let mut config = self.base.config.clone();
        let mut place = self.place_fault(index, seed, &mut scenario, &mut config, &mut drawn)?;
        for (key, draw) in &self.file.vary {
            let size = draw.grid_size();
            let mut rng = Stream::new(seed, key);
            let value = draw.value(&mut rng, place % size).context("nothing to draw")?;
            place /= size;
            drawn.insert(key.clone(), serde_json::to_value(&value)?);
            let (tree, rest) = match key.split_once('.') {
                Some(("mission", rest)) => (&mut mission, rest),
                Some(("config", rest)) => (&mut config, rest),
                _ => (&mut scenario, key.as_str()),
            };
            set(tree, rest, value).with_context(|| format!("vary.{key}"))?;
        }
        let told = || format!("with {}", serde_json::to_string(&drawn).unwrap_or_default());
        let base = Base { scenario, config, ..self.base.clone() };
        let mission = MissionFile::parse(&toml::to_string(&mission)?)
            .map_err(|why| anyhow::anyhow!("mission: {why}"))
            .with_context(told)?;
        let mut plan = Plan::of(&base, seed, self.file.limit_s).with_context(told)?;
        if let Some(fence) = self.file.fence
            && !drawn.contains_key(VOLUME)
        {
            plan.fence = fence;
        }
        let named = drawn.get(TAKE_OFF).and_then(serde_json::Value::as_str);
        if let Some(way) = TakeOff::ALL.into_iter().find(|way| named == Some(way.name())) {
            plan.take_off = way;
            plan.fence.height_m = plan.fence.height_m.min(way.highest_m(&mission) + OVER_ASKED_M);
        }
        Ok(Plan { index, drawn, mission, ..plan })
    }
}

impl Plan {
    /// A flight as these files say, without a mission yet: nothing is drawn, and it may be anywhere in the room.
    pub fn of(base: &Base, seed: u64, limit_s: f64) -> Result<Self> {
        let mut scenario = Scenario::from_table(base.scenario.clone(), &base.scenario_folder)
            .context("scenario")?;
        scenario.seed = seed;
        let vehicle = Vehicle::from_toml(&base.vehicle).context("vehicle")?;
        let config = companion(&base.config, &scenario, &vehicle)?;
        let (index, drawn, mission) = (0, BTreeMap::new(), MissionFile::default());
        let take_off = TakeOff::Mission;
        let fence = Fence::of_room(&scenario.room);
        Ok(Self {
            index,
            seed,
            drawn,
            scenario,
            vehicle,
            config,
            mission,
            take_off,
            fence,
            limit_s,
        })
    }
}

/// Adds the faults of an entry: in this phase, so long after its begin, s; without a phase at that time.
fn add_faults(
    scenario: &mut Table,
    faults: Vec<FaultAt>,
    phase: Option<Phase>,
    at_s: f64,
) -> Result<()> {
    let mut list = scenario.get("fault").cloned().unwrap_or(Value::Array(Vec::new()));
    let many = list.as_array_mut().context("fault: not a list")?;
    for one in faults {
        many.push(Value::try_from(FaultAt { at_s, phase, ..one })?);
    }
    set(scenario, "fault", list)
}

/// The companion is told no volume: it takes its own.
fn forget_volume(config: &mut Table) {
    if let Some(Value::Table(limits)) = config.get_mut("limits") {
        ["north_m", "east_m", "height_m"].iter().for_each(|key| {
            limits.remove(*key);
        });
    }
}

/// The companion's configuration, fitted to tag and vehicle as a user would have to.
fn companion(table: &Table, scenario: &Scenario, vehicle: &Vehicle) -> Result<Config> {
    let mut config = Config::from_toml("config", &toml::to_string(table)?)?;
    config.flight.gear_height_m = vehicle.body.gear_m;
    let north_deg = config.board.north_offset_deg;
    config.board.north_offset_deg = scenario.told.north_offset_deg(north_deg);
    config.tag.protocol = Value::from(scenario.companion_protocol()).try_into()?;
    if let Some([profile, address]) = scenario.companion_board() {
        config.board.profile = Value::from(profile).try_into()?;
        config.board.address = address.parse()?;
    }
    // Nobody answers for a disk in lockstep.
    config.store.directory = std::path::PathBuf::new();
    let mut problems = Problems::new();
    config.check("", &mut problems);
    if !problems.is_empty() {
        bail!("config: {problems}");
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const SMALL: &str = "name = 'small'\n[[item]]\ncommand = 'takeoff'\nheight_m = 1.0\n\
         [[item]]\ncommand = 'land'\n[vary]\n'start.yaw_deg' = { uniform = [-90.0, 90.0] }\n\
         'effects.on.A5.north' = { grid = [0.0, 0.5] }\n'config.control.version' = { grid = ['raw', 'modified'] }\n\
         'mission.item[0].height_m' = { choice = [0.8, 1.2] }\n";

    fn campaign(text: &str, seed: Option<u64>) -> Result<Campaign> {
        Campaign::parse(text, Path::new("."), seed, "test", Vec::new())
    }

    #[test]
    fn prop_a_flight_follows_from_digest_and_number() {
        let c = campaign(SMALL, None).unwrap();
        assert_eq!(c.flights, 4);
        let (a, b) = (c.plan(3).unwrap(), c.plan(3).unwrap());
        assert_eq!((a.seed, &a.drawn, &a.scenario), (b.seed, &b.drawn, &b.scenario));
        assert_ne!(c.plan(2).unwrap().seed, a.seed);
        let other = campaign(SMALL, Some(9)).unwrap();
        assert_ne!((&other.digest, other.plan(3).unwrap().seed), (&c.digest, a.seed));
        let mut pairs: Vec<String> = (0..4)
            .map(|i| {
                let d = c.plan(i).unwrap().drawn;
                format!("{} {}", d["effects.on.A5.north"], d["config.control.version"])
            })
            .collect();
        pairs.sort();
        pairs.dedup();
        assert_eq!(pairs.len(), 4, "not every combination: {pairs:?}");
    }

    #[test]
    fn prop_drawn_values_arrive() {
        let c = campaign(SMALL, None).unwrap();
        for i in 0..4 {
            let plan = c.plan(i).unwrap();
            assert_eq!(serde_json::json!(plan.scenario.start.yaw_deg), plan.drawn["start.yaw_deg"]);
            let height = plan.mission.items[0].height_m.unwrap();
            assert_eq!(serde_json::json!(height), plan.drawn["mission.item[0].height_m"]);
            let version = serde_json::to_value(plan.config.control.version).unwrap();
            assert_eq!(version, plan.drawn["config.control.version"]);
            assert!(plan.scenario.effect_set().unwrap().is_on("A5"));
        }
    }

    #[test]
    fn prop_refusals_name_what_is_wrong() {
        let says = |text: &str, needed: &str| {
            let error = campaign(text, None).and_then(|c| c.plan(0).map(|_| ())).unwrap_err();
            let error = format!("{error:#}");
            assert!(error.contains(needed), "{error}");
        };
        let item = "[[item]]\ncommand = 'land'\n";
        says(&format!("flights = 1\n{item}"), "missing field `name`");
        says(&format!("name = 'x'\n{item}"), "flights is missing");
        says("name = 'x'\nflights = 1", "either mission = FILE or [[item]]");
        says(&format!("name = 'x'\nflights = 0\n{item}"), "flights = 0, allowed 1");
        says(&format!("name = 'x'\nflights = 1\nsead = 1\n{item}"), "unknown field `sead`");
        let vary = |v: &str| format!("name = 'x'\nflights = 1\n{item}[vary]\n{v}");
        says(&vary("'start.yaw' = { uniform = [0.0, 1.0] }"), "unknown field `yaw`");
        says(&vary("'room.ceiling_m' = { choice = [500.0] }"), "room.ceiling_m = 500");
        says(&vary("'config.limits.battery_low_v' = { choice = [99.0] }"), "limits.battery_low_v");
        says(&vary("'mission.item[7].hold_s' = { choice = [1.0] }"), "the list has 1 elements");
        let c = campaign(&vary("'room.north_m[1]' = { choice = [12.5] }"), None).unwrap();
        assert_eq!(c.plan(0).unwrap().scenario.room.north_m, [0.0, 12.5]);
        says(&format!("name = 'x'\n{item}[faults]\n"), "`haltere-lab faults` flies it");
        says(&format!("name = 'x'\nset = ['flight']\n{item}"), "write section.key=value");
    }
}
