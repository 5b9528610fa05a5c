//! `haltere-sim campaign faults`: every fault of the catalogue in every part of a flight, as a table.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use haltere::cli::print;
use haltere_log::written;

use super::catalogue::{self, Reaction};
use super::fault_tables::Report;
use super::file::Campaign;
use super::row::Row;
use super::store::write_whole;
use super::{Run, again_alone, fly_all, print_outcomes, write_results};

/// `haltere-sim campaign faults`
#[derive(Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    run: Run,
    /// Write the table there, as docs/FAULTS.md, and the same as JSON beside it.
    #[arg(long, value_name = "FILE")]
    doc: Option<PathBuf>,
    /// Only a fixed share: every fault in this many of the parts of a flight, every part equally often.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=7))]
    sample: Option<u64>,
    /// Only faults of these names or groups, or whose name holds this: `replayed_ranging`, `"servos limp"`. Every
    /// part of the flight and every repetition, or the share that --sample leaves.
    #[arg(long, value_name = "NAME", num_args = 1..)]
    only: Vec<String>,
    /// Exit code 1 only where a fault is not safe that was safe in all flights of this earlier result (the
    /// JSON beside docs/FAULTS.md), or a flight panics. A fault that it does not know is new, and judged by the
    /// bounds alone.
    #[arg(long, value_name = "FILE")]
    against: Option<PathBuf>,
    /// Print the catalogue; nothing is flown.
    #[arg(long)]
    list: bool,
    /// Print the table as JSON.
    #[arg(long)]
    json: bool,
}

/// The committed campaign: hall, mission, fence, repetitions.
const CAMPAIGN: &str = include_str!("../../campaigns/faults.toml");

/// Flies and reports. `false`: the target is missed.
pub fn run(options: &Options) -> Result<bool> {
    if options.list {
        print(&list())?;
        return Ok(true);
    }
    let run = &options.run;
    let seed = run.seed.map_or(String::new(), |seed| format!(" --seed {seed}"));
    let again = format!("haltere-sim campaign faults{seed}");
    let campaign = Campaign::parse(CAMPAIGN, Path::new("."), run.seed, "faults")?;
    if let Some(doc) = &options.doc {
        let inputs: Vec<&PathBuf> = options.against.iter().collect();
        written::look(doc, &inputs).context("--doc")?;
        written::look(&doc.with_extension("json"), &inputs).context("--doc")?;
    }
    if again_alone(&campaign, run, &[])? {
        return Ok(true);
    }
    let sample = selected(&campaign, options)?;
    if sample.is_some() && run.shard.0 != [1, 1] {
        bail!("--sample, --only: it is small, and flown in one piece: leave --shard out");
    }
    let (identity, rows) = fly_all(&campaign, run, sample.as_deref())?;
    let rows: Vec<&Row> = rows.values().collect();
    write_results(&run.out, &identity, &rows, &again)?;
    let report = Report { campaign: &campaign, identity: &identity, rows: &rows, again: &again };
    let json = serde_json::to_string_pretty(&report.json())? + "\n";
    if let Some(doc) = &options.doc {
        write_whole(doc, report.markdown().as_bytes())?;
        write_whole(&doc.with_extension("json"), json.as_bytes())?;
    }
    if options.json {
        print(&json)?;
    } else {
        print_outcomes(&rows)?;
        print(&report.table().to_string())?;
        print(&report.failures().to_string())?;
    }
    let Some(earlier) = &options.against else { return Ok(report.target_is_met()) };
    let text = std::fs::read_to_string(earlier).with_context(|| earlier.display().to_string())?;
    let earlier = serde_json::from_str(&text).with_context(|| earlier.display().to_string())?;
    let new = report.new_since(&earlier);
    if !new.is_empty() {
        eprintln!("new, judged by the bounds: {}", new.join("; "));
    }
    let worse = report.worse_than(&earlier);
    worse.iter().for_each(|line| eprintln!("{line}"));
    Ok(worse.is_empty())
}

/// The flights that --sample and --only leave; `None`: all.
fn selected(campaign: &Campaign, options: &Options) -> Result<Option<Vec<u64>>> {
    if options.only.is_empty() {
        return Ok(options.sample.map(|n| sample(campaign, n)));
    }
    for word in &options.only {
        if !campaign.faults.iter().any(|entry| entry.is_named(word)) {
            bail!("--only {word}: no fault and no group of that name; --list prints them");
        }
    }
    let wanted = |i: &u64| {
        let place = campaign.fault_place(*i);
        let entry = place.and_then(|(fault, _, _)| campaign.faults.get(fault));
        entry.is_some_and(|entry| options.only.iter().any(|word| entry.is_named(word)))
    };
    let all: Vec<u64> = match options.sample {
        Some(n) => sample(campaign, n),
        None => (0..campaign.flights).collect(),
    };
    Ok(Some(all.into_iter().filter(wanted).collect()))
}

/// Every fault in `n` phases; over the faults each phase comes equally often. Of the first repetition.
fn sample(campaign: &Campaign, n: u64) -> Vec<u64> {
    let (faults, phases) = (campaign.faults.len() as u64, campaign.phases.len() as u64);
    let mut list: Vec<u64> = (0..faults)
        .flat_map(|fault| {
            let step = (phases / n.min(phases)).max(1);
            (0..n.min(phases)).map(move |k| fault + faults * ((fault + k * step) % phases))
        })
        .collect();
    list.sort_unstable();
    list.dedup();
    list
}

fn list() -> String {
    let mut text = String::new();
    for entry in catalogue::all() {
        let reaction = match entry.reaction {
            Reaction::Exists(what) => format!("reaction: {what}"),
            Reaction::None(why) => format!("no reaction: {why}"),
        };
        let _ = writeln!(text, "{:12} {:44} {reaction}", entry.group, entry.name);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::row::Outcome;
    use crate::campaign::store::Identity;

    fn campaign() -> Campaign {
        Campaign::parse(CAMPAIGN, Path::new("."), None, "faults").unwrap()
    }

    #[test]
    fn prop_the_committed_campaign_is_large_enough() {
        let c = campaign();
        assert!(c.flights >= 3000, "{}", c.flights);
        let default = (0..c.flights).filter(|i| c.in_default_volume(*i));
        assert!(default.count() >= 300);
        assert_eq!(c.faults.len(), catalogue::all().len());
        assert_eq!(c.phases.len(), 7);
    }

    #[test]
    fn prop_a_sample_has_every_fault_and_every_phase() {
        let c = campaign();
        for n in 1..=7 {
            let sample = sample(&c, n);
            assert_eq!(sample.len() as u64, n * c.faults.len() as u64);
            let places: Vec<_> = sample.iter().filter_map(|i| c.fault_place(*i)).collect();
            for fault in 0..c.faults.len() {
                assert_eq!(places.iter().filter(|p| p.0 == fault).count() as u64, n);
            }
            let per_phase = sample.len() / c.phases.len();
            for phase in 0..c.phases.len() {
                let count = places.iter().filter(|p| p.1 == phase).count();
                assert!(count.abs_diff(per_phase) <= 6, "phase {phase}: {count} of {per_phase}");
            }
        }
    }

    #[test]
    fn prop_only_what_was_safe_before_can_be_worse() {
        let c = campaign();
        let identity = Identity::new(&c, [1, 1], false);
        let plan = c.plan(0).unwrap();
        let row = |outcome| Row { outcome, ..Row::blank(0, plan.seed, plan.drawn.clone()) };
        let (landed, crashed) = (row(Outcome::Landed), row(Outcome::Crashed));
        let panicked = row(Outcome::Panicked);
        fn report<'a>(c: &'a Campaign, identity: &'a Identity, rows: &'a [&'a Row]) -> Report<'a> {
            Report { campaign: c, identity, rows, again: "x" }
        }
        let good = report(&c, &identity, &[&landed]).json();
        let bad = report(&c, &identity, &[&landed, &crashed]).json();
        let worse = |row: &Row, earlier: &serde_json::Value| {
            report(&c, &identity, &[row]).worse_than(earlier).len()
        };
        assert_eq!(
            (worse(&landed, &good), worse(&crashed, &good), worse(&crashed, &bad)),
            (0, 1, 0)
        );
        assert_eq!(worse(&panicked, &bad), 1);
        let nothing = serde_json::json!({});
        assert_eq!(worse(&crashed, &nothing), 1, "an empty result excuses nothing");
        let (of_bad, of_good) = ([&crashed], [&landed]);
        let (new, old) = (report(&c, &identity, &of_bad), report(&c, &identity, &of_good));
        assert!(new.worse_than(&nothing)[0].starts_with("new, and not safe"));
        assert_eq!(new.new_since(&nothing), [c.faults[0].name.as_str()]);
        assert!(old.worse_than(&nothing).is_empty() && old.new_since(&good).is_empty());
    }

    #[test]
    fn prop_only_flies_what_is_named() {
        let c = campaign();
        let options = |arguments: &[&str]| {
            #[derive(clap::Parser)]
            struct Parsed {
                #[command(flatten)]
                options: Options,
            }
            let arguments = ["faults"].iter().chain(arguments);
            <Parsed as clap::Parser>::try_parse_from(arguments).unwrap().options
        };
        let count = |arguments: &[&str]| {
            selected(&c, &options(arguments)).map(|s| s.map_or(0, |s| s.len()))
        };
        assert_eq!(count(&[]).unwrap(), 0, "all, not a selection");
        assert_eq!(count(&["--only", "replayed_ranging"]).unwrap(), 8 * 28);
        assert_eq!(count(&["--only", "servos limp", "servos stuck", "--sample", "7"]).unwrap(), 14);
        let refused = format!("{:#}", count(&["--only", "gremlins"]).unwrap_err());
        assert!(refused.contains("no fault and no group"), "{refused}");
    }

    #[test]
    fn prop_what_is_there_from_the_start_has_a_column_of_its_own() {
        let c = campaign();
        let identity = Identity::new(&c, [1, 1], true);
        let place = c.faults.iter().position(|e| e.is_from_start()).unwrap() as u64;
        let plan = c.plan(place).unwrap();
        let row = Row { outcome: Outcome::Again, ..Row::blank(place, plan.seed, plan.drawn) };
        let rows = [&row];
        let report = Report { campaign: &c, identity: &identity, rows: &rows, again: "x" };
        let json = report.json();
        assert_eq!(json["faults"].as_array().unwrap().len(), 1);
        assert_eq!(json["faults"][0]["phases"]["start"]["again"], 1);
        assert!(report.table().contains("| 0 1A | – | – |"), "{}", report.table());
        assert!(!report.target_is_met());
    }

    #[test]
    fn prop_the_target_is_missed_by_what_it_forbids() {
        let c = campaign();
        let place = |name: &str| c.faults.iter().position(|e| e.name == name).unwrap() as u64;
        let identity = Identity::new(&c, [1, 1], false);
        let met = |name: &str, outcome: Outcome| {
            let row = Row {
                outcome,
                ..c.plan(place(name)).map(|p| Row::blank(p.index, p.seed, p.drawn)).unwrap()
            };
            let rows = [&row];
            let report = Report { campaign: &c, identity: &identity, rows: &rows, again: "x" };
            assert!(report.markdown().contains(name) && report.json()["faults"].is_array());
            report.target_is_met()
        };
        assert!(met("UWB off", Outcome::Landed) && met("UWB off", Outcome::NotTakenOff));
        assert!(!met("UWB off", Outcome::Crashed) && !met("UWB off", Outcome::Left));
        assert!(!met("UWB off", Outcome::Panicked) && !met("UWB off", Outcome::Unfinished));
        assert!(met("a wing lost", Outcome::Crashed) && !met("a wing lost", Outcome::Left));
    }
}
