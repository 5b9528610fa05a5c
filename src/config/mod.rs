//! Configuration of the companion: what may be written, where it comes from, what is wrong with it.
//!
//! Layers, later ones win: defaults, `--config` files in their order, environment variables
//! `HALTERE_SECTION__KEY`, `--set section.key=value`. `config/haltere.toml` documents every key.

mod address;
mod anchors;
mod differences;
mod document;
mod ground;
mod key_file;
mod layers;
mod note;
mod retired;
mod sections;
mod signing;
pub mod stored;
#[cfg(test)]
mod tests;
mod watch;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

pub use address::{Address, AddressError, HostPort};
pub use differences::Difference;
pub use document::{DocumentedKey, configuration_page, reference};
pub use ground::{EndpointConfig, GroundConfig};
pub use key_file::{KeyFileError, read_key, read_time, time_file};
pub use note::Note;
pub use sections::{
    AnchorsConfig, BankSizeName, BoardConfig, DiagnosisConfig, RecordConfig, StoreConfig,
    TagConfig, TagPort, TimingConfig,
};
pub use signing::{Doors, SigningConfig};
pub use watch::{Token, TokenError, WatchAddress, WatchConfig};

use self::retired::{Author, RETIRED, Retired};
use crate::checks::Problems;
use crate::control::ControlConfig;
use crate::estimator::EstimatorConfig;
use crate::pilot::{FlightConfig, LimitsConfig, PilotConfig, SupervisorConfig};
use crate::survey::Survey;
use crate::uwb::UwbConfig;

/// File that is read from the working directory when none is named.
pub const DEFAULT_FILE: &str = "haltere.toml";

/// Everything that can be configured, one field per section.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// `[tag]`
    pub tag: TagConfig,
    /// `[board]`
    pub board: BoardConfig,
    /// `[ground]`
    pub ground: GroundConfig,
    /// `[signing]`
    pub signing: SigningConfig,
    /// `[anchors]`
    pub anchors: AnchorsConfig,
    /// `[record]`
    pub record: RecordConfig,
    /// `[store]`
    pub store: StoreConfig,
    /// `[diagnosis]`
    pub diagnosis: DiagnosisConfig,
    /// `[watch]`
    pub watch: WatchConfig,
    /// `[timing]`
    pub timing: TimingConfig,
    /// `[flight]`
    pub flight: FlightConfig,
    /// `[limits]`
    pub limits: LimitsConfig,
    /// `[supervisor]`
    pub supervisor: SupervisorConfig,
    /// `[uwb]`
    pub uwb: UwbConfig,
    /// `[estimator]`
    pub estimator: EstimatorConfig,
    /// `[control]`
    pub control: ControlConfig,
}

/// A configuration that was checked, and its survey.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// Every key resolved.
    pub config: Config,
    /// The anchors.
    pub survey: Survey,
    /// Files that were read, for the user to see.
    pub files: Vec<PathBuf>,
    /// What people should know: retired keys, parameters that a station had set.
    pub notes: Vec<Note>,
    /// Why what a station has set is not in force, the first reason.
    pub lost: Option<String>,
}

/// Where a configuration comes from.
#[derive(Debug, Clone, Default)]
pub struct Sources {
    /// TOML files, later ones win. None: [`DEFAULT_FILE`], if it exists.
    pub files: Vec<PathBuf>,
    /// Environment, as `std::env::vars`.
    pub environment: Vec<(String, String)>,
    /// `section.key=value`, later ones win.
    pub overrides: Vec<String>,
}

impl Sources {
    /// With the environment of this process.
    pub fn new(files: Vec<PathBuf>, overrides: Vec<String>) -> Self {
        // Names or values that are no text cannot be ours.
        let environment = std::env::vars_os()
            .filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)))
            .collect();
        Self { files, environment, overrides }
    }
}

impl Loaded {
    /// Reads and checks everything; refuses with all that is wrong.
    pub fn load(sources: &Sources) -> Result<Self, Problems> {
        Self::load_by(sources, RETIRED)
    }

    fn load_by(sources: &Sources, gone: &[Retired]) -> Result<Self, Problems> {
        let (mut config, mut layers) = Config::load_layers(sources, gone)?;
        let notes = std::mem::take(&mut layers.notes);
        if !config.watch.token_file.as_os_str().is_empty() {
            config.watch.token_file = layers.beside("watch.token_file", &config.watch.token_file);
        }
        if !config.signing.key_file.as_os_str().is_empty() {
            config.signing.key_file = layers.beside("signing.key_file", &config.signing.key_file);
        }
        let anchor_file = layers.beside("anchors.file", &config.anchors.file);
        let survey = anchors::read(&anchor_file)?;
        let mut files = layers.files();
        files.push(anchor_file);
        let mut loaded = Self { config, survey, files, notes, lost: None };
        stored::apply(&mut loaded, &layers);
        Ok(loaded)
    }
}

impl Config {
    /// Reads and checks all keys, without the anchor file: for tools that bring a survey of
    /// their own.
    pub fn load(sources: &Sources) -> Result<Self, Problems> {
        Self::load_layers(sources, RETIRED).map(|(config, _)| config)
    }

    fn load_layers(
        sources: &Sources,
        gone: &[Retired],
    ) -> Result<(Self, layers::Layers), Problems> {
        let layers = layers::Layers::read(sources, gone)?;
        let config = layers.merged()?;
        let mut problems = Problems::new();
        config.check(&mut problems);
        let mut traced = Problems::new();
        for line in problems.lines() {
            traced.say(layers.with_origin(line));
        }
        traced.into_result()?;
        Ok((config, layers))
    }

    /// Adds all values that are out of range to `problems`.
    pub fn check(&self, problems: &mut Problems) {
        self.tag.check("tag", problems);
        self.board.check("board", problems);
        self.ground.check("ground", problems);
        self.watch.check("watch", problems);
        self.timing.check("timing", problems);
        self.flight.check("flight", problems);
        self.limits.check("limits", problems);
        self.supervisor.check("supervisor", problems);
        self.uwb.check("uwb", problems);
        self.estimator.check("estimator", problems);
        self.control.check("control", problems);
        self.check_addresses(problems);
        self.check_signing(problems);
    }

    /// Two links cannot share a port or a device.
    fn check_addresses(&self, problems: &mut Problems) {
        let mut taken = vec![("board.address".to_owned(), self.board.address.resource())];
        if let TagPort::Device(path) = &self.tag.port {
            taken.push(("tag.port".to_owned(), path.display().to_string()));
        }
        for (i, endpoint) in self.ground.endpoints.iter().enumerate() {
            taken.push((format!("ground.endpoints[{i}]"), endpoint.address.resource()));
        }
        if let Some(address) = self.watch.address.get() {
            taken.push(("watch.address".to_owned(), address.resource()));
        }
        for (i, (key, resource)) in taken.iter().enumerate() {
            if let Some((other, _)) = taken[..i].iter().find(|(_, r)| r == resource) {
                problems.say(format!(
                    "{key}: {resource} is taken by {other}; give each link a port or device of \
                     its own"
                ));
            }
        }
    }

    /// The part that the pilot core is told.
    pub fn pilot(&self) -> PilotConfig {
        PilotConfig {
            tag_protocol: self.tag.protocol,
            board_profile: self.board.profile,
            board_set_parameters: self.board.set_parameters,
            board_north_offset_rad: self.board.north_offset_deg.to_radians(),
            endpoints: self.ground.for_pilot(),
            routing: self.ground.routing,
            origin: self.ground.origin,
            store: self.store.is_on(),
            judge_programs: self.diagnosis.after_programs,
            flight: self.flight.clone(),
            limits: self.limits.clone(),
            supervisor: self.supervisor.clone(),
            uwb: self.uwb.clone(),
            estimator: self.estimator.clone(),
            control: self.control.clone(),
        }
    }

    /// Takes over what a station may have changed in the core's part.
    fn take_over(&mut self, pilot: PilotConfig) {
        self.flight = pilot.flight;
        self.limits = pilot.limits;
        self.supervisor = pilot.supervisor;
        self.uwb = pilot.uwb;
        self.estimator = pilot.estimator;
        self.control = pilot.control;
    }

    /// The whole configuration as a TOML file.
    pub fn to_toml(&self) -> String {
        // Plain tables of plain values: there is nothing that TOML cannot hold.
        toml::to_string(self).unwrap_or_default()
    }

    /// The same for the log of a flight, with the volume that was flown in: what a build makes of the anchors
    /// may change.
    pub fn to_log(&self, survey: &Survey) -> String {
        let mut flown = self.clone();
        flown.limits.resolve(survey);
        flown.to_toml()
    }

    /// From a TOML file of a user in memory. `name` stands in messages.
    pub fn from_toml(name: &str, text: &str) -> Result<Self, Problems> {
        layers::read_config(name, text, RETIRED, Author::User).map(|read| read.config)
    }

    /// As it stands in the head of a log, which may be of an older build: keys that are no more are read
    /// without a word. `name` stands in messages.
    pub fn as_recorded(name: &str, text: &str) -> Result<Self, Problems> {
        layers::read_config(name, text, RETIRED, Author::Recorder).map(|read| read.config)
    }
}

/// An anchor file in memory. `name` stands in messages.
pub fn parse_anchors(name: &str, text: &str) -> Result<Survey, Problems> {
    anchors::parse(name, text)
}

/// Reads an anchor file alone, for tools that need no more.
pub fn read_anchors(path: &Path) -> Result<Survey, Problems> {
    anchors::read(path)
}
