//! The filter that flies, on recorded flights: the companion's configuration with the numbers of the recorded vehicle.

use std::fmt::{self, Write};

use super::{FlightReport, run_flight, run_told};
use crate::sources::{Origin, Recorded, Sources, VehicleKeys, load_with_origins};
use haltere_core::checks::Problems;
use haltere_core::estimator::EstimatorConfig;
use haltere_log::import::util::Flight;
use haltere_log::record::LogReader;
use haltere_pilot::settings::Config;
use haltere_pilot::{FlightConfig, PilotConfig};

/// Key of where the tag is on the vehicle.
const TAG: &str = "estimator.p_BT_B_m";

/// A configuration as it would fly the recorded vehicle.
#[derive(Debug, Clone)]
pub struct Flown {
    /// Its filter.
    pub estimator: EstimatorConfig,
    config: Config,
    origins: Vec<Origin>,
    /// What a place of the tag is that nobody told.
    untold_tag: &'static str,
}

/// The quadrotor of the recordings.
pub fn quadrotor() -> VehicleKeys {
    VehicleKeys {
        name: "the quadrotor of UTIL".into(),
        text: include_str!("quadrotor.toml").into(),
    }
}

impl Flown {
    /// What these sources would fly; refuses with all that is wrong.
    pub fn read(sources: Sources) -> Result<Self, Problems> {
        let (config, origins) = load_with_origins(&sources)?;
        let estimator = config.pilot().estimator_in_force();
        // Where the tag was is written beside the recordings, by vehicle.
        Ok(Self { estimator, config, origins, untold_tag: "as the recording says" })
    }

    /// The same for a log of one's own: what it was flown with where no file is named.
    pub fn read_for(log: &LogReader, sources: Sources) -> Result<Self, Problems> {
        let text = log.session().config_toml.clone();
        let recorded = Some(Recorded { name: "as flown".into(), text });
        Ok(Self { untold_tag: "default", ..Self::read(Sources { recorded, ..sources })? })
    }

    /// What lives through a log again: its links, board and room, and the filter of this configuration with what feeds it.
    pub fn pilot_on(&self, flown: PilotConfig) -> PilotConfig {
        let told = self.config.pilot();
        let gear_height_m = told.flight.gear_height_m;
        PilotConfig {
            flight: FlightConfig { gear_height_m, ..flown.flight },
            uwb: told.uwb,
            estimator: told.estimator,
            control: told.control,
            ..flown
        }
    }

    /// What flies when nobody configures anything, on the quadrotor of the recordings.
    pub fn by_default() -> Result<Self, Problems> {
        Self::read(Sources { vehicle: Some(quadrotor()), ..Sources::default() })
    }

    /// The same with nine states alone, which learn no errors of the UWB.
    pub fn nine_states() -> Result<Self, Problems> {
        let overrides = vec!["control.learned_uwb_errors=false".into()];
        Self::read(Sources { vehicle: Some(quadrotor()), overrides, ..Sources::default() })
    }

    /// Runs one flight, the tag where the recording says unless the sources say it.
    pub fn run(&self, flight: &Flight) -> FlightReport {
        let is_told = |origin: &Origin| origin.key == TAG && origin.from.is_some();
        if self.origins.iter().any(is_told) {
            run_told(flight, self.estimator.clone(), |_, _, _| {})
        } else {
            run_flight(flight, &self.estimator)
        }
    }

    /// Writes the numbers of the vehicle, each with its origin.
    pub fn print(&self, out: &mut impl Write) -> fmt::Result {
        writeln!(out, "the vehicle; all else is the configuration that flies")?;
        self.print_vehicle(out)
    }

    /// The numbers alone.
    pub fn print_vehicle(&self, out: &mut impl Write) -> fmt::Result {
        let filter = self.origins.iter().filter(|origin| origin.key.starts_with("estimator."));
        for Origin { key, value, from } in filter {
            let value = value.as_ref().map_or("none".into(), ToString::to_string);
            let from = match from {
                None if *key == TAG => self.untold_tag,
                None => "default",
                Some(from) => from,
            };
            writeln!(out, "  {key:<40} {value:<22} {from}")?;
        }
        Ok(())
    }
}
