//! Scenario files: room, anchors, start, effects, faults of a simulated flight.
//!
//! `scenarios/sample.toml` documents every key. Unknown keys are refused.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use haltere_core::checks::Problems;
use haltere_core::frames::{E, U, Vec3, earth_from_survey, survey_from_earth};
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;
use haltere_model::board::crazyflie::CrazyflieSettings;
use haltere_model::board::{BoardSettings, Firmware, Manners, Overrides};
use haltere_model::effects::{EffectConfig, EffectSet};
use haltere_model::magnetometer::MagnetometerSettings;
use haltere_model::room::Room;
use haltere_model::tag::TagProtocol;
use haltere_model::{Fault, PlantConfig, Vehicle};
use haltere_pilot::OriginConfig;
use haltere_pilot::settings::parse_anchors;
use serde::{Deserialize, Serialize};

use crate::simulated::built_in::{self, Kind};
use crate::simulated::faults::{FaultAt, Told};
use crate::sources::read_anchors;

/// Effect that turns the board's north from room north.
const HEADING_EFFECT: &str = "N13";
/// Largest angle between the two that the effect list takes, degrees.
const NORTH_DEG: f64 = 100.0;

/// A scenario, as in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scenario {
    /// Random numbers; `--seed` wins.
    pub seed: u64,
    /// Walls and ceiling.
    pub room: Room,
    /// Anchor survey file, relative to the scenario; absent: the corners of the room.
    pub anchors_file: Option<PathBuf>,
    /// Where the room lies on Earth, for the companion of `lockstep`; absent: where its configuration has it.
    pub origin: Option<OriginConfig>,
    /// Where the vehicle stands.
    pub start: Start,
    /// The tag.
    pub tag: Tag,
    /// The board.
    pub board: Board,
    /// Physical effects.
    pub effects: EffectConfig,
    /// What the companion is told that is not so.
    pub told: Told,
    /// Failures while flying.
    #[serde(rename = "fault")]
    pub faults: Vec<FaultAt>,
    /// Anchors, once resolved.
    #[serde(skip)]
    survey: Option<Survey>,
    /// Anchors as the companion is told.
    #[serde(skip)]
    told_survey: Option<Survey>,
}

/// `[start]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Start {
    /// Room north and east, m; the vehicle stands on the floor.
    pub position_m: [f64; 2],
    /// From room north, clockwise seen from above, degrees.
    pub yaw_deg: f64,
}

impl Default for Start {
    fn default() -> Self {
        Self { position_m: [5.0, 5.0], yaw_deg: 0.0 }
    }
}

/// `[tag]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tag {
    /// What it speaks; `--tag-protocol` wins.
    pub protocol: TagProtocol,
}

/// `[board]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Board {
    /// Angle from room north to the board's north, degrees, clockwise seen from above. Absent:
    /// that of the nominal effect.
    pub north_offset_deg: Option<f64>,
    /// What it plays: generic, px4, ardupilot, crazyflie.
    pub firmware: Firmware,
    /// Time since its boot at the start, s. Absent: long enough to be ready.
    pub booted_s: Option<f64>,
    /// Its magnetometer and the room's field.
    pub magnetometer: MagnetometerSettings,
    /// A Crazyflie's own: build, radio, cable.
    pub crazyflie: CrazyflieSettings,
    /// Unkind manners.
    pub manners: Manners,
    /// Parameters that are not the firmware's, by name.
    pub parameters: Overrides,
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            seed: 1,
            room: Room::default(),
            anchors_file: None,
            origin: None,
            start: Start::default(),
            tag: Tag::default(),
            board: Board::default(),
            effects: EffectConfig::default(),
            told: Told::default(),
            faults: Vec::new(),
            survey: None,
            told_survey: None,
        }
    }
}

impl Scenario {
    /// Reads a file or what is built in by that name, or takes the defaults: the 10 × 10 × 7 m hall of the source.
    pub fn load(path: Option<&Path>) -> Result<Self> {
        let Some(path) = path else { return Self::default().resolved(Path::new(".")) };
        let file = Kind::Scenario.find(Path::new(""), path);
        let text = Kind::Scenario.read(&file)?;
        let folder = file.parent().unwrap_or(Path::new("."));
        Self::parse(&text, folder).with_context(|| path.display().to_string())
    }

    fn parse(text: &str, folder: &Path) -> Result<Self> {
        let scenario: Scenario = toml::from_str(text)?;
        if let (Ok(found), Ok(understood)) = (text.parse(), toml::Table::try_from(&scenario))
            && let Some(why) = haltere_pilot::settings::surplus(&found, &understood, "")
        {
            anyhow::bail!("{why}");
        }
        scenario.resolved(folder)
    }

    /// From a table, as a campaign edits it; `folder` is where its anchor file lies.
    pub fn from_table(table: toml::Table, folder: &Path) -> Result<Self> {
        let scenario: Scenario = table.try_into()?;
        scenario.resolved(folder)
    }

    /// What is to be simulated.
    pub fn plant(&self, vehicle: Vehicle) -> Result<PlantConfig> {
        let [north_m, east_m] = self.start.position_m;
        Ok(PlantConfig {
            vehicle,
            effects: self.effect_set()?,
            start_E_m: Vec3::new(north_m, east_m, 0.0),
            start_yaw_rad: self.start.yaw_deg.to_radians(),
            room: self.room.clone(),
            protocol: self.tag.protocol,
            board: self.board_settings(),
            ..PlantConfig::new(self.survey()?, self.seed)
        })
    }

    /// The same for who does not know what is flown: a fault that waits for a part of the flight is refused.
    pub fn fixed_faults(&self) -> Result<Vec<(f64, Fault)>> {
        if let Some(i) = self.faults.iter().position(|f| f.phase.is_some()) {
            bail!(
                "fault[{i}].phase: only a campaign knows what is being flown; leave phase out, or fly the scenario \
                 with `haltere-sim campaign`"
            );
        }
        Ok(self.timed_faults())
    }

    /// Faults at fixed times, mended ones with their end: time in s and fault, in order.
    pub fn timed_faults(&self) -> Vec<(f64, Fault)> {
        let mut list = Vec::new();
        for entry in self.faults.iter().filter(|f| f.phase.is_none()) {
            // Checked when the scenario was read.
            let Some(fault) = entry.to_fault("fault", &mut Problems::new()) else { continue };
            let end = entry.for_s.and_then(|for_s| Some((entry.at_s + for_s, fault.mended()?)));
            list.push((entry.at_s, fault));
            list.extend(end);
        }
        list.sort_by(|a, b| a.0.total_cmp(&b.0));
        list
    }

    fn resolved(mut self, folder: &Path) -> Result<Self> {
        let mut problems = Problems::new();
        self.room.check("room", &mut problems);
        let [north_m, east_m] = self.start.position_m;
        let (north, east) = (self.room.north_m, self.room.east_m);
        problems.range("start.position_m[0]", north_m, north[0]..=north[1], "m");
        problems.range("start.position_m[1]", east_m, east[0]..=east[1], "m");
        problems.range("start.yaw_deg", self.start.yaw_deg, -360.0..=360.0, "deg");
        if let Some(offset_deg) = self.board.north_offset_deg {
            problems.range("board.north_offset_deg", offset_deg, -NORTH_DEG..=NORTH_DEG, "deg");
            let heading = self.effects.on.entry(HEADING_EFFECT.into()).or_default();
            heading.insert("offset".into(), offset_deg);
        }
        if let Some(booted_s) = self.board.booted_s {
            problems.range("board.booted_s", booted_s, 0.0..=1e6, "s");
        }
        self.board_settings().check("board", &mut problems);
        for (i, fault) in self.faults.iter().enumerate() {
            fault.to_mishap(&format!("fault[{i}]"), &mut problems);
        }
        self.told.check("told", &mut problems);
        if let Some(origin) = &self.origin {
            origin.check("origin", &mut problems);
        }
        self.faults.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        if let Err(more) = EffectSet::from_config(&self.effects) {
            more.lines().iter().for_each(|line| problems.say(line.clone()));
        }
        if !problems.is_empty() {
            bail!(problems);
        }
        let survey = match &self.anchors_file {
            Some(file) => anchors(&built_in::survey(folder, file))?,
            None => Survey::new(&corners(&self.room))?,
        };
        self.told_survey = Some(self.told.survey(&survey)?);
        self.survey = Some(survey);
        Ok(self)
    }

    /// Anchors.
    pub fn survey(&self) -> Result<Survey> {
        self.survey.clone().context("scenario without anchors")
    }

    /// Anchors as the companion is told.
    pub fn told_survey(&self) -> Result<Survey> {
        self.told_survey.clone().context("scenario without anchors")
    }

    /// Effects that are on.
    pub fn effect_set(&self) -> Result<EffectSet> {
        Ok(EffectSet::from_config(&self.effects)?)
    }

    /// What the companion has to write into `tag.protocol`.
    pub fn companion_protocol(&self) -> &'static str {
        match (self.board.firmware, self.tag.protocol) {
            (Firmware::Crazyflie, _) => "crazyflie",
            (_, TagProtocol::Tdoa2 | TagProtocol::Tdoa3) => "lps-sniffer",
            (_, TagProtocol::Mavlink) => "mavlink",
        }
    }

    /// What it has to write into `board.profile` where it cannot find out, with an address where such a board may be.
    pub fn companion_board(&self) -> Option<[&'static str; 2]> {
        let is_one = self.board.firmware == Firmware::Crazyflie;
        is_one.then_some(["crazyflie", "crtpudp:127.0.0.1:19850"])
    }

    /// The board.
    pub fn board_settings(&self) -> BoardSettings {
        let mut settings = BoardSettings {
            firmware: self.board.firmware,
            crazyflie: self.board.crazyflie.clone(),
            magnetometer: self.board.magnetometer.clone(),
            manners: self.board.manners.clone(),
            parameters: self.board.parameters.clone(),
            ..BoardSettings::default()
        };
        if let Some(booted_s) = self.board.booted_s {
            settings.boot_us = (booted_s.max(0.0) * 1e6) as u64;
        }
        settings
    }

    /// The anchors as a survey file for the companion.
    pub fn anchors_toml(&self) -> String {
        let mut text = String::from("frame = \"enu\"\n");
        let survey = self.told_survey.iter();
        for (id, pos) in
            survey.flat_map(|s| s.ids().iter().filter_map(|id| Some((id, s.position_E_m(*id)?))))
        {
            let [x, y, z] = survey_from_earth(pos).to_array();
            let _ = write!(text, "\n[[anchor]]\nid = {id}\nposition_m = [{x:?}, {y:?}, {z:?}]\n");
        }
        text
    }
}

/// The survey of a file on the disk or in the program.
fn anchors(file: &Path) -> Result<Survey> {
    match built_in::read(file) {
        Ok(text) => Ok(parse_anchors(&file.display().to_string(), &text)?),
        // Its words say how to write one.
        Err(_) => Ok(read_anchors(file)?),
    }
}

/// Eight anchors in the corners of the room: bit 0 of the id north, bit 1 east, bit 2 up.
fn corners(room: &Room) -> Vec<(AnchorId, Vec3<E>)> {
    let pick = |id: u8, bit: u8, [low, high]: [f64; 2]| if id & bit != 0 { high } else { low };
    (0..8)
        .map(|id| {
            let north_m = pick(id, 1, room.north_m);
            let east_m = pick(id, 2, room.east_m);
            let up_m = pick(id, 4, [0.0, room.ceiling_m]);
            let level = earth_from_survey(Vec3::<U>::new(0.0, 0.0, up_m));
            (AnchorId(id), Vec3::new(north_m, east_m, level.z()))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_sample_holds_the_defaults() {
        let sample = include_str!("../../sim/scenarios/sample.toml");
        assert_eq!(Scenario::parse(sample, Path::new(".")).unwrap(), Scenario::load(None).unwrap());
    }

    #[test]
    fn prop_the_unkind_boards_can_be_flown() {
        let ardupilot = include_str!("../../sim/scenarios/ardupilot-unkind.toml");
        let px4 = include_str!("../../sim/scenarios/px4-unkind.toml");
        for (text, firmware) in [(ardupilot, Firmware::Ardupilot), (px4, Firmware::Px4)] {
            let scenario = Scenario::parse(text, Path::new(".")).unwrap();
            let settings = scenario.board_settings();
            assert_eq!((settings.firmware, settings.boot_us), (firmware, 0));
            assert!(settings.manners.settling_s > 0.0 && !settings.parameters.is_empty());
        }
    }

    #[test]
    fn prop_refusals_name_the_key() {
        let says = |text: &str, needed: &str| {
            let error = format!("{:#}", Scenario::parse(text, Path::new(".")).unwrap_err());
            assert!(error.contains(needed), "{error}");
        };
        says("sead = 3", "unknown field `sead`");
        says("[start]\nposition_m = [50.0, 5.0]", "start.position_m[0] = 50, allowed 0 to 10 m");
        says("[board]\nnorth_offset_deg = 400.0", "board.north_offset_deg = 400");
        says("[board]\nfirmware = \"betaflight\"", "unknown variant `betaflight`");
        says("[board.manners]\nbaud = 99999999", "board.manners.baud = 99999999");
        says("[board.magnetometer]\nwave_m = 0.0", "board.magnetometer.wave_m = 0");
        says("[board.manners]\nrude = true", "unknown field `rude`");
        says("[board.parameters]\nA_NAME_OF_TOO_MANY = 1.0", "names have 1 to 16");
        says("[[fault]]\nat_s = 1.0\npart = \"board-mode\"", "fault[0].mode is missing");
        says("[effects]\noff = [\"Z9\"]", "effects.Z9: no such effect");
        says("[[fault]]\nat_s = -1.0\npart = \"tag\"", "fault[0].at_s = -1");
        says("[[fault]]\nat_s = 1.0\npart = \"wing\"", "fault[0].gain is missing");
        says("[[fault]]\nat_s = 1.0\npart = \"tag\"\nstate = \"stuck\"", "fault[0].state");
    }

    #[test]
    fn prop_anchors_come_back_from_the_file_for_the_companion() {
        let scenario = Scenario::load(None).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("anchors.toml");
        std::fs::write(&file, scenario.anchors_toml()).unwrap();
        let back = read_anchors(&file).unwrap();
        for id in scenario.survey().unwrap().ids() {
            assert_eq!(back.position_E_m(*id), scenario.survey().unwrap().position_E_m(*id));
        }
    }

    /// Mean flap rate of both wings in the middle of a short hover, Hz.
    fn hover_hz(scenario: &Scenario) -> f64 {
        use haltere_model::lockstep::{Lockstep, fly};
        use haltere_model::{Plant, PlantConfig};
        use haltere_pilot::PilotConfig;
        use haltere_pilot::mission_file::{Command as ItemCommand, Item};
        let survey = scenario.survey().unwrap();
        let [north_m, east_m] = scenario.start.position_m;
        let plant = PlantConfig {
            effects: scenario.effect_set().unwrap(),
            start_E_m: Vec3::new(north_m, east_m, 0.0),
            room: scenario.room.clone(),
            ..PlantConfig::new(survey.clone(), scenario.seed)
        };
        let takeoff = Item { height_m: Some(1.5), ..Item::new(ItemCommand::Takeoff) };
        let wait = Item { duration_s: Some(8.0), ..Item::new(ItemCommand::Delay) };
        let items: Vec<_> = [takeoff, wait, Item::new(ItemCommand::Land)]
            .iter()
            .zip(0..)
            .map(|(item, seq)| item.to_wire(seq, 0, 0))
            .collect();
        let world = Plant::new(plant).unwrap();
        let mut lockstep = Lockstep::in_world(world, PilotConfig::default(), &survey, None);
        let flight = fly(&mut lockstep, &items, 60.0).unwrap();
        assert!(flight.landed, "{:?}", flight.texts);
        let high: Vec<f64> = flight
            .samples
            .iter()
            .filter(|s| -s.truth.pos_E_m.z() > 1.3)
            .map(|s| 0.5 * (s.truth.flap_hz[0] + s.truth.flap_hz[1]))
            .collect();
        assert!(high.len() > 300, "{} samples in hover", high.len());
        high.iter().sum::<f64>() / high.len() as f64
    }

    #[test]
    fn val_an_accepted_effect_is_read_and_flown_with() {
        use haltere_gap::accept::edit_scenario;
        let sample = include_str!("../../sim/scenarios/sample.toml");
        let spec =
            haltere_gap::bank::library::standard().into_iter().find(|s| s.id == "P1").unwrap();
        let patched = edit_scenario(sample, spec, &[0.15]).unwrap();
        let kept = sample.lines().all(|line| patched.contains(line));
        assert!(kept, "a line of the sample is gone:\n{patched}");
        let scenario = Scenario::parse(&patched, Path::new(".")).unwrap();
        assert!(scenario.effect_set().unwrap().is_on("P1"));
        let plain = hover_hz(&Scenario::parse(sample, Path::new(".")).unwrap());
        let ratio = hover_hz(&scenario) / plain;
        // Thrust (1 - 0.15)(c f - t0) must carry the same weight: f grows by little less than 1/0.85.
        assert!((1.12..1.20).contains(&ratio), "flap rate in hover grew by {ratio}");
    }
}
