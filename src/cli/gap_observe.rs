//! `haltere gap observe`: the statistics of flights, for other people's methods.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use rayon::prelude::*;
use serde_json::json;

use super::gap::SceneOptions;
use super::print;
use super::which_flight::WhichFlight;
use haltere_gap::diagnosis::observed;
use haltere_gap::flight::logs;
use haltere_gap::flight::statistics::specs;
use haltere_gap::nominal::Nominal;

/// Prints the statistics that the diagnosis sees of each flight, one JSON object a line.
///
/// The same numbers are in a bank (`haltere gap bank --export`), so that other methods can be set
/// beside this one on equal terms.
#[derive(Debug, Args)]
pub(super) struct Observe {
    /// Flight logs of the companion.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    #[command(flatten)]
    which: WhichFlight,
    #[command(flatten)]
    told: SceneOptions,
}

impl Observe {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let told = self.told.told()?;
        let names: Vec<&str> = specs().iter().map(|s| s.name.as_str()).collect();
        let blocks: Vec<&str> = specs().iter().map(|s| s.block.name()).collect();
        print(&(json!({ "names": names, "blocks": blocks }).to_string() + "\n"))?;
        let lines: Vec<String> = self
            .logs
            .par_iter()
            .enumerate()
            .map(|(place, path)| {
                let line = match logs::read_flight(path, self.which.of_log(place)) {
                    Err(error) => json!({ "log": path, "fault": error.to_string() }),
                    Ok(flown) => {
                        let nominal = Nominal::of_scene(&flown.scene(&told).on_grid());
                        let seen = observed(flown, &nominal);
                        match &seen.observation {
                            Err(why) => json!({ "log": path, "fault": why }),
                            Ok(o) => json!({
                                "log": path,
                                "flight": seen.flown.flight,
                                "faults": seen.flown.faults,
                                "survey": seen.flown.trace.survey.ids().iter().map(|id| id.0).collect::<Vec<_>>(),
                                "anchors": o.anchors.iter().map(|a| a.0).collect::<Vec<_>>(),
                                // JSON has no NaN: unknown is null.
                                "statistics": o.statistics,
                            }),
                        }
                    }
                };
                line.to_string() + "\n"
            })
            .collect();
        print(&lines.concat())?;
        Ok(ExitCode::SUCCESS)
    }
}
