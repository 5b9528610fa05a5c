//! `haltere gap attribute`: verdicts on flights whose statistics were observed before.

use std::io::BufRead as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::{Value, json};

use super::print;
use haltere_core::measure::AnchorId;
use haltere_gap::attribute::{Attributor, Settings};
use haltere_gap::bank::bank_file;
use haltere_gap::flight::statistics::specs;
use haltere_gap::places::{Heard, places};
use haltere_model::effects::Block;

/// Attributes flights by their statistics, one JSON object a line, without reading a log again.
///
/// Flights are lines as `haltere gap observe` and `haltere-lab detectable --labelled` write them. Each comes back
/// with its own fields, the statistics left out, and with what the diagnosis says of it and where.
#[derive(Debug, Args)]
pub(super) struct Attribute {
    /// A bank of the same mission (`haltere gap bank`).
    bank: PathBuf,
    /// Flights to judge.
    flights: PathBuf,
    /// Accepted flights of the airframe.
    #[arg(long, value_name = "FILE")]
    references: Option<PathBuf>,
    /// More of them, for the limits of the gate alone.
    #[arg(long, value_name = "FILE", requires = "references")]
    calibration: Option<PathBuf>,
    /// Choices of the attribution, key=value in TOML, for experiments.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl Attribute {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let (bank, _) = bank_file::read(&self.bank)?;
        let settings = toml::from_str::<Settings>(&self.set.join("\n"))?.beside_flights();
        let known = |path: &Option<PathBuf>| -> anyhow::Result<Vec<Vec<f64>>> {
            let Some(path) = path else { return Ok(Vec::new()) };
            Ok(read(path)?.into_iter().map(|(_, statistics)| statistics).collect())
        };
        let blocks: Vec<Block> = specs().iter().map(|s| s.block).collect();
        let (references, calibration) = (known(&self.references)?, known(&self.calibration)?);
        let attributor = Attributor::new(&bank, &references, &calibration, &blocks, &settings)?;
        let (rest, flights): (Vec<Value>, Vec<Vec<f64>>) = read(&self.flights)?.into_iter().unzip();
        let judged = attributor.attribute_all(&flights);
        for ((mut line, statistics), attribution) in rest.into_iter().zip(&flights).zip(judged) {
            let (worst, surveyed) = (ids(&line["anchors"]), ids(&line["survey"]));
            let heard = Heard { statistics, worst: &worst, surveyed: &surveyed };
            line["where"] = json!(places(&attribution, heard, &bank));
            line["attribution"] = json!(attribution);
            print(&(line.to_string() + "\n"))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Anchors of a line.
fn ids(list: &Value) -> Vec<AnchorId> {
    let numbers = list.as_array().into_iter().flatten();
    numbers.filter_map(|id| Some(AnchorId(u8::try_from(id.as_u64()?).ok()?))).collect()
}

/// Flights with statistics: the other fields, and the statistics. Lines without any are passed over: the names,
/// flights that could not be observed.
pub fn read(path: &Path) -> anyhow::Result<Vec<(Value, Vec<f64>)>> {
    let place = || path.display().to_string();
    let file = std::fs::File::open(path).with_context(place)?;
    let mut flights = Vec::new();
    for (number, line) in std::io::BufReader::new(file).lines().enumerate() {
        let mut value: Value = serde_json::from_str(&line.with_context(place)?)
            .with_context(|| format!("{}: line {}", path.display(), number + 1))?;
        let Some(Value::Array(statistics)) = value.get_mut("statistics").map(Value::take) else {
            continue;
        };
        let expected = specs().len();
        if statistics.len() != expected {
            bail!(
                "{}: line {}: {} statistics, this build has {expected}: observe the flights again",
                path.display(),
                number + 1,
                statistics.len()
            );
        }
        // JSON has no NaN: unknown is null.
        let statistics = statistics.iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect();
        if let Value::Object(fields) = &mut value {
            fields.remove("statistics");
        }
        flights.push((value, statistics));
    }
    Ok(flights)
}
