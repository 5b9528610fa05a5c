//! The filter that flies, on recorded flights: the companion's configuration with the numbers of the recorded vehicle.

use std::fmt::{self, Write};

use super::file::Flight;
use super::{FlightReport, run_flight, run_told};
use haltere::sources::{Origin, Recorded, Sources, VehicleKeys, load_with_origins};
use haltere_core::checks::Problems;
use haltere_core::estimator::EstimatorConfig;
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
    /// Whether the tag is where the recording says: a number of its vehicle, which no configuration knows and which goes over its
    /// files, as the others do.
    tag_is_recorded: bool,
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
        let is_told = |origin: &Origin| origin.key == TAG && origin.over_files;
        let tag_is_recorded = !origins.iter().any(is_told);
        Ok(Self { estimator, config, origins, tag_is_recorded })
    }

    /// The same for a log of one's own: what it was flown with where no file is named.
    pub fn read_for(log: &LogReader, sources: Sources) -> Result<Self, Problems> {
        let text = log.session().config_toml.clone();
        let recorded = Some(Recorded { name: "as flown".into(), text });
        Ok(Self { tag_is_recorded: false, ..Self::read(Sources { recorded, ..sources })? })
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

    /// Runs one flight, the tag where the recording says unless a vehicle or the command line says it.
    pub fn run(&self, flight: &Flight) -> FlightReport {
        if self.tag_is_recorded {
            run_flight(flight, &self.estimator)
        } else {
            run_told(flight, self.estimator.clone(), |_, _, _| {})
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
        for Origin { key, value, from, .. } in filter {
            let recorded = *key == TAG && self.tag_is_recorded;
            let value = match value {
                _ if recorded => "by recording".into(),
                Some(value) => value.to_string(),
                None => "none".into(),
            };
            let from = match from {
                _ if recorded => "where its authors say, else at the centre",
                None => "default",
                Some(from) => from,
            };
            writeln!(out, "  {key:<40} {value:<22} {from}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sample configuration says where the tag is not, as every configuration does: 0.354 m in place of 0.444 on a recording of
    /// whose vehicle its authors wrote down where it was.
    #[test]
    fn regress_a_configuration_does_not_move_the_tag_of_a_recording() {
        let folder = tempfile::tempdir().unwrap();
        let sample = folder.path().join("sample.toml");
        std::fs::write(&sample, include_str!("../../../../config/haltere.toml")).unwrap();
        let read = |files: Vec<std::path::PathBuf>, text: &str, overrides: &[&str]| {
            let vehicle = VehicleKeys { name: "quad.toml".into(), text: text.into() };
            let overrides = overrides.iter().map(|set| (*set).to_owned()).collect();
            Flown::read(Sources { files, vehicle: Some(vehicle), overrides, ..Sources::default() })
        };
        let own = quadrotor().text;
        let [plain, told] =
            [vec![], vec![sample.clone()]].map(|files| read(files, &own, &[]).unwrap());
        assert_eq!(plain.estimator, told.estimator);
        assert!(plain.tag_is_recorded && told.tag_is_recorded);
        let mut page = String::new();
        told.print(&mut page).unwrap();
        assert!(page.contains("by recording"), "{page}");
        let moved = "estimator.p_BT_B_m=[0.0, 0.0, -0.05]";
        assert!(!read(vec![sample], &own, &[moved]).unwrap().tag_is_recorded);
        let vehicle = "[estimator]\np_BT_B_m = [0.0, 0.0, -0.05]\n";
        assert!(!read(vec![], vehicle, &[]).unwrap().tag_is_recorded);
    }
}
