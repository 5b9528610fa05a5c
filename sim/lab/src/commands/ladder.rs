//! `haltere-lab ladder`: which step of the diagnosis loses the name of flights whose cause is known.
//!
//! From the top: the gate sees a gap; the cause ranks first; its probability stands out from its siblings; the limit of adequacy and
//! what it foretells let the verdict say so. Beside that what the library's law explains at its best size on the flight itself, with
//! the size of another flight of the same cause, the floor of healthy flights and of repeated ones, and what is left by block.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;
use rayon::prelude::*;
use serde_json::Value;

use haltere::cli::gap::observed_flights;
use haltere::cli::print;
use haltere_gap::attribute::{Attributor, Rungs, Settings};
use haltere_gap::bank::bank_file;
use haltere_gap::flight::statistics::specs;
use haltere_model::effects::Block;

/// Says for flights whose cause is known which step of the diagnosis loses the name.
///
/// Flights are lines as `haltere gap observe` and `haltere-lab detectable --labelled` write them; the latter know their
/// cause themselves.
#[derive(Debug, Args)]
pub struct Ladder {
    /// A bank of the same mission (`haltere gap bank`).
    bank: PathBuf,
    /// Flights.
    flights: PathBuf,
    /// Accepted flights of the vehicle.
    #[arg(long, value_name = "FILE")]
    references: Option<PathBuf>,
    /// JSON object: name of a flight (its log's, without `.mcap`) to the ids of effects that count as right; an empty list: none of
    /// the library; null: healthy.
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
    /// Choices of the attribution, key=value in TOML.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Ids that count as right, by flight; `None`: healthy.
type Key = BTreeMap<String, Option<Vec<String>>>;

struct Case {
    name: String,
    causes: Option<Vec<String>>,
    statistics: Vec<f64>,
}

impl Ladder {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let (bank, _) = bank_file::read(&self.bank)?;
        let settings = toml::from_str::<Settings>(&self.set.join("\n"))?.beside_flights();
        let key: Key = match &self.key {
            None => Key::new(),
            Some(path) => {
                let place = || path.display().to_string();
                let text = std::fs::read_to_string(path).with_context(place)?;
                serde_json::from_str(&text).with_context(place)?
            }
        };
        let references = match &self.references {
            None => Vec::new(),
            Some(path) => observed_flights(path)?.into_iter().map(|(_, row)| row).collect(),
        };
        let cases: Vec<Case> = observed_flights(&self.flights)?
            .into_iter()
            .filter_map(|(line, statistics)| {
                let (name, causes) = cause(&line, &key)?;
                Some(Case { name, causes, statistics })
            })
            .collect();
        let blocks: Vec<Block> = specs().iter().map(|s| s.block).collect();
        let attributor = Attributor::new(&bank, &references, &[], &blocks, &settings)?;
        print(&table(&attributor, &cases, &settings))?;
        Ok(ExitCode::SUCCESS)
    }
}

/// Name and cause of a flight; nothing where neither key nor line knows it.
fn cause(line: &Value, key: &Key) -> Option<(String, Option<Vec<String>>)> {
    let log = line.get("log").and_then(Value::as_str);
    let name = log
        .and_then(|log| Path::new(log).file_stem())
        .map(|stem| stem.to_string_lossy().into_owned());
    match name {
        Some(name) => key.get(&name).map(|causes| (name, causes.clone())),
        None => match line.get("id")? {
            Value::Null => Some(("healthy".to_owned(), None)),
            id => {
                let id = id.as_str()?.to_owned();
                let times = line.get("times").and_then(Value::as_u64).unwrap_or(0);
                Some((format!("{id} {times}x"), Some(vec![id])))
            }
        },
    }
}

/// Where a name is lost, in the order of the steps.
fn lost_at(rungs: &Rungs, causes: &[String], settings: &Settings) -> &'static str {
    let said = rungs.attribution.outcome.effects();
    if said.first().is_some_and(|first| causes.contains(&first.id)) {
        "named"
    } else if !rungs.attribution.gate.open() {
        "gate"
    } else if rungs.rank != Some(1) {
        "ranking"
    } else if rungs.posterior < settings.costs.alone() {
        "siblings"
    } else {
        "limits"
    }
}

fn table(attributor: &Attributor, cases: &[Case], settings: &Settings) -> String {
    let mut out = String::from(
        "| flight | cause | rank | probability | law, best size | foretold | best wrong foretells | said | lost at | most left |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    let (healthy, deviant): (Vec<&Case>, Vec<&Case>) =
        cases.iter().partition(|c| c.causes.is_none());
    let known: Vec<(&Case, &[String], Rungs)> = deviant
        .par_iter()
        .filter_map(|case| {
            let causes = case.causes.as_deref()?;
            Some((*case, causes, attributor.rungs(&case.statistics, causes)))
        })
        .collect();
    let mut lost: BTreeMap<&str, usize> = BTreeMap::new();
    let mut refused = 0;
    let mut left: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (case, causes, rungs) in &known {
        let outcome = &rungs.attribution.outcome;
        let at = if causes.is_empty() { "-" } else { lost_at(rungs, causes, settings) };
        if causes.is_empty() {
            refused += usize::from(outcome.effects().is_empty());
        } else {
            *lost.entry(at).or_default() += 1;
            for (block, square) in &rungs.left {
                left.entry(block).or_default().push(*square);
            }
        }
        let most = rungs.left.iter().max_by(|a, b| a.1.total_cmp(b.1));
        let said: Vec<&str> = outcome.effects().iter().map(|e| e.id.as_str()).collect();
        let _ = writeln!(
            out,
            "| {} | {} | {} | {:.2} | {:.2} | {:.2} | {:.2} | {} {} | {at} | {} |",
            case.name,
            causes.join(" "),
            rungs.rank.map_or("-".to_owned(), |rank| rank.to_string()),
            rungs.posterior,
            rungs.law,
            rungs.foretold,
            rungs.foretold_wrong,
            outcome.key(),
            said.join(" "),
            most.map_or(String::new(), |(block, square)| format!("{block} {square:.1}"))
        );
    }
    let singles = known.iter().filter(|(_, causes, _)| !causes.is_empty()).count();
    let strange = known.len() - singles;
    let _ = writeln!(
        out,
        "\n{singles} flights with a cause of the library: {lost:?}; {refused} of {strange} others refused"
    );
    let alarms = healthy.iter().filter(|c| attributor.attribute(&c.statistics).gate.open()).count();
    let _ = writeln!(out, "{alarms} of {} healthy flights a gap", healthy.len());
    let mut floor: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for case in &healthy {
        for (block, square) in attributor.by_block_of(&case.statistics) {
            floor.entry(block).or_default().push(square);
        }
    }
    let _ = writeln!(
        out,
        "\n| block | what the cause leaves, median | healthy flights, median |\n|---|---|---|"
    );
    for (block, squares) in &mut left {
        let healthy = floor.get_mut(block).map_or(f64::NAN, |squares| median(squares));
        let _ = writeln!(out, "| {block} | {:.2} | {healthy:.2} |", median(squares));
    }
    out.push_str(&repeated(attributor, &known));
    out
}

/// Flights of one cause beside one another: size of the one on the other, and how far they are apart.
fn repeated(attributor: &Attributor, known: &[(&Case, &[String], Rungs)]) -> String {
    let mut out = String::new();
    for (one, causes, rungs) in known {
        let Some(id) =
            rungs.rank.and_then(|rank| rungs.attribution.candidates.get(rank - 1)).map(|c| &c.id)
        else {
            continue;
        };
        for (other, others, beside) in known {
            // Names of repeated flights differ after a tilde.
            let kind = |name: &str| name.rsplit_once('~').map(|(kind, _)| kind.to_owned());
            if one.name == other.name
                || causes != others
                || kind(&one.name).is_none()
                || kind(&one.name) != kind(&other.name)
            {
                continue;
            }
            let closed =
                attributor.closed_by(&other.statistics, id, &rungs.unit).unwrap_or(f64::NAN);
            let _ = writeln!(
                out,
                "{} by {id} with the size of {}: {closed:.2} (own {:.2}); apart {:.2} a statistic",
                other.name,
                one.name,
                beside.law,
                attributor.apart(&one.statistics, &other.statistics)
            );
        }
    }
    out
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn prop_the_key_or_the_line_knows_the_cause() {
        let key: Key = serde_json::from_str(r#"{"a": ["P1", "P7"], "b": [], "c": null}"#).unwrap();
        let of = |line: Value| cause(&line, &key);
        assert_eq!(of(json!({"log": "x/a.mcap"})).unwrap().1.unwrap(), ["P1", "P7"]);
        assert_eq!(of(json!({"log": "b.mcap"})).unwrap().1.unwrap().len(), 0);
        assert_eq!(of(json!({"log": "c.mcap"})).unwrap().1, None);
        assert_eq!(of(json!({"log": "d.mcap"})), None, "not in the key");
        assert_eq!(
            of(json!({"id": "A1", "times": 2})).unwrap(),
            ("A1 2x".to_owned(), Some(vec!["A1".to_owned()]))
        );
        assert_eq!(of(json!({"id": null})).unwrap().1, None);
    }
}
