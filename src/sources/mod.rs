//! Where a configuration comes from: files, the environment, the command line, and what a station has set.
//!
//! Layers, later ones win: defaults, `--config` files in their order, numbers of a vehicle where a command takes them,
//! environment variables `HALTERE_SECTION__KEY`, `--set section.key=value`. What may stand in them is told by `config`.

mod anchors;
mod key_file;
mod layers;
pub mod stored;
#[cfg(test)]
mod tests;
mod vehicle;

use std::path::PathBuf;

pub use anchors::read_anchors;
pub use key_file::{KeyFileError, read_key, read_time, time_file};

use self::layers::Layers;
use haltere_core::checks::Problems;
use haltere_core::survey::Survey;
use haltere_pilot::settings::{Config, Note};
pub use vehicle::{Origin, VehicleKeys};

/// File that is read from the working directory when none is named.
pub const DEFAULT_FILE: &str = "haltere.toml";

/// A configuration that was checked, and its survey.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// Every key resolved.
    pub config: Config,
    /// The anchors.
    pub survey: Survey,
    /// Files that were read, for the user to see.
    pub files: Vec<PathBuf>,
    /// What people should know: misspelt variables, parameters that a station had set.
    pub notes: Vec<Note>,
    /// Why what a station has set is not in force, the first reason.
    pub lost: Option<String>,
}

/// The configuration that a log holds.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// Which log, for people.
    pub name: String,
    /// Its text.
    pub text: String,
}

/// Where a configuration comes from.
#[derive(Debug, Clone, Default)]
pub struct Sources {
    /// TOML files, later ones win. None: what a log holds, or else [`DEFAULT_FILE`], if it exists.
    pub files: Vec<PathBuf>,
    /// Configuration in a log, in place of files that nobody names.
    pub recorded: Option<Recorded>,
    /// Environment, as `std::env::vars`.
    pub environment: Vec<(String, String)>,
    /// Numbers of a vehicle. They win over files.
    pub vehicle: Option<VehicleKeys>,
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
        Self { files, environment, overrides, ..Self::default() }
    }
}

impl Loaded {
    /// Reads and checks everything; refuses with all that is wrong.
    pub fn load(sources: &Sources) -> Result<Self, Problems> {
        Self::load_by(sources, None)
    }

    /// The same for what can be said of a room that is not told: where no file and no key tells anything and no survey lies there, this
    /// one is taken, and no file is named for it.
    pub fn load_or_in(sources: &Sources, room: Survey) -> Result<Self, Problems> {
        Self::load_by(sources, Some(room))
    }

    fn load_by(sources: &Sources, untold: Option<Survey>) -> Result<Self, Problems> {
        let (mut config, mut layers) = load_layers(sources)?;
        let notes = std::mem::take(&mut layers.notes);
        if !config.watch.token_file.as_os_str().is_empty() {
            config.watch.token_file = layers.beside("watch.token_file", &config.watch.token_file);
        }
        if !config.signing.key_file.as_os_str().is_empty() {
            config.signing.key_file = layers.beside("signing.key_file", &config.signing.key_file);
        }
        let anchor_file = layers.beside("anchors.file", &config.anchors.file);
        let mut files = layers.files();
        let is_told = !files.is_empty() || layers.is_set("anchors.file") || anchor_file.exists();
        let survey = match untold.filter(|_| !is_told) {
            Some(survey) => survey,
            None => {
                let survey = read_anchors(&anchor_file)?;
                files.push(anchor_file);
                survey
            }
        };
        let mut loaded = Self { config, survey, files, notes, lost: None };
        stored::apply(&mut loaded, &layers);
        Ok(loaded)
    }
}

/// Reads and checks all keys, without the anchor file: for tools that bring a survey of
/// their own.
pub fn load(sources: &Sources) -> Result<Config, Problems> {
    load_layers(sources).map(|(config, _)| config)
}

/// The same, and where each number of the vehicle comes from.
pub fn load_with_origins(sources: &Sources) -> Result<(Config, Vec<Origin>), Problems> {
    let (config, layers) = load_layers(sources)?;
    let origins = vehicle::origins(&config, &layers);
    Ok((config, origins))
}

fn load_layers(sources: &Sources) -> Result<(Config, Layers), Problems> {
    let layers = Layers::read(sources)?;
    let config = layers.merged()?;
    let mut problems = Problems::new();
    config.check_to_fly(&mut problems);
    let mut traced = Problems::new();
    for line in problems.lines() {
        traced.say(layers.with_origin(line));
    }
    traced.into_result()?;
    Ok((config, layers))
}
