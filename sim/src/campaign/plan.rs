//! One flight of a campaign: what it is flown with. Follows from the campaign's digest and its number
//! alone.

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail};
use haltere::checks::Problems;
use haltere::config::Config;
use haltere::ctl::MissionFile;
use haltere::model::Vehicle;
use haltere::model::random::Stream;
use haltere::model::tag::TagProtocol;
use haltere::pilot::TagProtocol as CompanionProtocol;
use sha2::{Digest, Sha256};
use toml::Value;

use super::draw::{grain, set};
use super::file::Campaign;
use super::judge::Fence;
use crate::faults::Phase;
use crate::scenario::Scenario;

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
    /// Where it may be.
    pub fence: Fence,
    /// Longest, s.
    pub limit_s: f64,
}

/// Keys of the catalogue's grid in rows and tables.
pub const FAULT: &str = "fault";
pub const PHASE: &str = "phase";
const REPEAT: &str = "repeat";
const FAULT_AT: &str = "fault_at_s";

/// When in a phase a fault comes, s from its begin. The phases of the committed mission last longer.
fn span_s(phase: Phase) -> [f64; 2] {
    match phase {
        Phase::Spool => [0.0, 0.8],
        Phase::Climb => [0.2, 1.8],
        Phase::Hover => [0.5, 4.0],
        Phase::Waypoints => [0.5, 10.0],
        Phase::Return => [0.3, 3.0],
        Phase::Landing => [0.2, 2.5],
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

    fn try_plan(&self, index: u64) -> Result<Plan> {
        let seed = seed_of(&self.digest, index);
        let mut drawn = BTreeMap::new();
        let mut scenario = self.base.scenario.clone();
        let mut mission = self.base.mission.clone();
        let mut config = self.base.config.clone();
        let mut place = index;
        if let Some((fault, phase, repeat)) = self.fault_place(index) {
            let repeats = self.file.faults.as_ref().map_or(1, |grid| grid.repeats);
            place = repeat / repeats;
            let (entry, phase) = (&self.faults[fault], self.phases[phase]);
            let [low_s, high_s] = span_s(phase);
            let at_s = grain(Stream::new(seed, FAULT_AT).between(low_s, high_s));
            let mut list = scenario.get("fault").cloned().unwrap_or(Value::Array(Vec::new()));
            for mut one in entry.faults()? {
                one.at_s = at_s;
                one.phase = Some(phase);
                let many = list.as_array_mut().context("fault: not a list")?;
                many.push(Value::try_from(&one)?);
            }
            set(&mut scenario, "fault", list)?;
            drawn.insert(FAULT.to_owned(), entry.name.clone().into());
            drawn.insert(PHASE.to_owned(), phase.name().into());
            drawn.insert(REPEAT.to_owned(), (repeat % repeats).into());
            drawn.insert(FAULT_AT.to_owned(), at_s.into());
        }
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
        let mut scenario = Scenario::from_table(scenario, &self.base.scenario_folder)
            .context("scenario")
            .with_context(told)?;
        scenario.seed = seed;
        let vehicle = Vehicle::from_toml(&self.base.vehicle).context("vehicle")?;
        let config = companion(&config, &scenario, &vehicle).with_context(told)?;
        let mission = MissionFile::parse(&toml::to_string(&mission)?)
            .map_err(|why| anyhow::anyhow!("mission: {why}"))
            .with_context(told)?;
        let fence = self.file.fence.unwrap_or(Fence::of_room(&scenario.room));
        let limit_s = self.file.limit_s;
        Ok(Plan { index, seed, drawn, scenario, vehicle, config, mission, fence, limit_s })
    }
}

/// The companion's configuration, fitted to tag and vehicle as a user would have to.
fn companion(table: &toml::Table, scenario: &Scenario, vehicle: &Vehicle) -> Result<Config> {
    let mut config = Config::from_toml("config", &toml::to_string(table)?)?;
    config.flight.gear_height_m = vehicle.body.gear_m;
    config.tag.protocol = match scenario.tag.protocol {
        TagProtocol::Tdoa2 | TagProtocol::Tdoa3 => CompanionProtocol::LpsSniffer,
        TagProtocol::Mavlink => CompanionProtocol::Mavlink,
    };
    // Nobody answers for a disk in lockstep.
    config.store.directory = std::path::PathBuf::new();
    let mut problems = Problems::new();
    config.check(&mut problems);
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
        Campaign::parse(text, Path::new("."), seed, "test")
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
        let faults = |v: &str| format!("name = 'x'\n{item}[faults]\n{v}");
        says(&faults("names = ['gremlins']"), "`gremlins` is not in the catalogue");
        says(&faults("repeats = 0"), "faults.repeats = 0");
        says(&format!("name = 'x'\nset = ['flight']\n{item}"), "write section.key=value");
    }

    #[test]
    fn prop_the_fault_grid_has_every_fault_in_every_phase() {
        let text = "name = 'x'\n[[item]]\ncommand = 'land'\n[faults]\nrepeats = 2\n";
        let c = campaign(text, None).unwrap();
        assert_eq!(c.flights, 2 * 6 * c.faults.len() as u64);
        let mut seen: Vec<_> = (0..c.flights).filter_map(|i| c.fault_place(i)).collect();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len() as u64, c.flights);
        let plan = c.plan(5).unwrap();
        assert_eq!(plan.drawn[FAULT], c.faults[5].name.as_str());
        assert!(plan.scenario.faults.iter().all(|f| f.phase == Some(Phase::Spool)));
    }
}
