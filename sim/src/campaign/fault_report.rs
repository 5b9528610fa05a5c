//! `haltere-sim campaign faults`: every fault of the catalogue in every part of a flight, as a table.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde_json::json;

use super::catalogue::{self, Reaction};
use super::file::Campaign;
use super::row::{Outcome, Row};
use super::store::{Identity, write_whole};
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
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=6))]
    sample: Option<u64>,
    /// Exit code 1 only where a fault is not safe that was safe in all flights of this earlier result (the
    /// JSON beside docs/FAULTS.md), or a flight panics.
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
        print!("{}", list());
        return Ok(true);
    }
    let run = &options.run;
    let seed = run.seed.map_or(String::new(), |seed| format!(" --seed {seed}"));
    let again = format!("haltere-sim campaign faults{seed}");
    let campaign = Campaign::parse(CAMPAIGN, Path::new("."), run.seed, "faults")?;
    if again_alone(&campaign, run)? {
        return Ok(true);
    }
    let sample = options.sample.map(|n| sample(&campaign, n));
    if sample.is_some() && run.shard.0 != [1, 1] {
        bail!("--sample: it is small, and flown in one piece: leave --shard out");
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
        print!("{json}");
    } else {
        print_outcomes(&rows);
        print!("{}", report.table());
        print!("{}", report.failures());
    }
    let Some(earlier) = &options.against else { return Ok(report.target_is_met()) };
    let text = std::fs::read_to_string(earlier).with_context(|| earlier.display().to_string())?;
    let earlier = serde_json::from_str(&text).with_context(|| earlier.display().to_string())?;
    let worse = report.worse_than(&earlier);
    worse.iter().for_each(|line| eprintln!("{line}"));
    Ok(worse.is_empty())
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

struct Report<'a> {
    campaign: &'a Campaign,
    identity: &'a Identity,
    rows: &'a [&'a Row],
    again: &'a str,
}

/// Flights of a fault in a phase.
#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    flights: u64,
    left: u64,
    crashed: u64,
    other: u64,
}

impl Cell {
    fn add(&mut self, row: &Row) {
        self.flights += 1;
        match row.outcome {
            Outcome::Landed | Outcome::NotTakenOff => {}
            Outcome::Left => self.left += 1,
            Outcome::Crashed => self.crashed += 1,
            Outcome::Unfinished | Outcome::Panicked => self.other += 1,
        }
    }

    fn text(&self) -> String {
        if self.flights == 0 {
            return "–".to_owned();
        }
        let mut text = (self.flights - self.left - self.crashed - self.other).to_string();
        for (count, letter) in [(self.left, 'L'), (self.crashed, 'C'), (self.other, 'U')] {
            if count > 0 {
                let _ = write!(text, " {count}{letter}");
            }
        }
        text
    }
}

impl Report<'_> {
    fn reaction(&self, row: &Row) -> Option<Reaction> {
        let (fault, _, _) = self.campaign.fault_place(row.index)?;
        Some(self.campaign.faults.get(fault)?.reaction)
    }

    fn has_reaction(&self, row: &Row) -> bool {
        !matches!(self.reaction(row), Some(Reaction::None(_)))
    }

    /// What the target forbids.
    fn is_failure(&self, row: &Row) -> bool {
        match row.outcome {
            Outcome::Landed | Outcome::NotTakenOff => false,
            Outcome::Left => true,
            Outcome::Crashed => self.has_reaction(row) || row.left(),
            Outcome::Unfinished | Outcome::Panicked => true,
        }
    }

    fn target_is_met(&self) -> bool {
        !self.rows.iter().any(|r| self.is_failure(r))
    }

    /// Flights that are not safe under a fault that was safe in every flight of an earlier result.
    fn worse_than(&self, earlier: &serde_json::Value) -> Vec<String> {
        let unsafe_before = |name: &str| {
            let faults = earlier["faults"].as_array().into_iter().flatten();
            let cells = faults.filter(|f| f["fault"] == name).flat_map(|f| {
                f["phases"].as_object().into_iter().flat_map(|phases| phases.values())
            });
            cells.filter(|c| c["flights"] != c["safe"]).count() > 0
        };
        let worse = |row: &&&Row| {
            let known = self
                .campaign
                .fault_place(row.index)
                .and_then(|(fault, _, _)| self.campaign.faults.get(fault))
                .is_some_and(|entry| unsafe_before(&entry.name));
            row.outcome == Outcome::Panicked || (self.is_failure(row) && !known)
        };
        self.rows
            .iter()
            .filter(worse)
            .map(|row| {
                let fault = row.drawn.get(super::plan::FAULT).map(super::table::plain);
                format!(
                    "worse than before: flight {}, {}: {}, {}",
                    row.index,
                    fault.unwrap_or_default(),
                    row.outcome.name(),
                    detail(row)
                )
            })
            .collect()
    }

    fn cells(&self) -> Vec<Vec<Cell>> {
        let mut cells =
            vec![vec![Cell::default(); self.campaign.phases.len()]; self.campaign.faults.len()];
        for row in self.rows {
            if let Some((fault, phase, _)) = self.campaign.fault_place(row.index)
                && let Some(cell) = cells.get_mut(fault).and_then(|line| line.get_mut(phase))
            {
                cell.add(row);
            }
        }
        cells
    }

    fn table(&self) -> String {
        let mut text = String::from("| fault |");
        for phase in &self.campaign.phases {
            let _ = write!(text, " {} |", phase.name());
        }
        text.push_str(" reaction |\n|---|");
        text.push_str(&"---|".repeat(self.campaign.phases.len() + 1));
        text.push('\n');
        let cells = self.cells();
        for (entry, line) in self.campaign.faults.iter().zip(&cells) {
            let _ = write!(text, "| {} |", entry.name);
            for cell in line {
                let _ = write!(text, " {} |", cell.text());
            }
            let known = if matches!(entry.reaction, Reaction::Exists(_)) { "yes" } else { "no" };
            let _ = writeln!(text, " {known} |");
        }
        let mut sums = vec![Cell::default(); self.campaign.phases.len()];
        for (phase, cell) in cells.iter().flat_map(|line| line.iter().enumerate()) {
            let Some(all) = sums.get_mut(phase) else { continue };
            all.flights += cell.flights;
            all.left += cell.left;
            all.crashed += cell.crashed;
            all.other += cell.other;
        }
        text.push_str("| **all** |");
        sums.iter().for_each(|cell| {
            let _ = write!(text, " {} |", cell.text());
        });
        text.push_str("  |\n");
        text
    }

    /// Every crash, every leaving, every flight that did not end.
    fn failures(&self) -> String {
        let bad = |r: &&&Row| !matches!(r.outcome, Outcome::Landed | Outcome::NotTakenOff);
        let mut text = String::new();
        for (with, title) in
            [(true, "Where a reaction exists"), (false, "Where no reaction exists")]
        {
            let rows: Vec<_> =
                self.rows.iter().filter(bad).filter(|r| self.has_reaction(r) == with).collect();
            let _ = writeln!(text, "\n### {title}: {} flights\n", rows.len());
            if rows.is_empty() {
                text.push_str("None.\n");
                continue;
            }
            text.push_str("| flight | fault | phase | outcome | what happened | modes |\n|---|---|---|---|---|---|\n");
            for row in rows {
                let drawn =
                    |key: &str| row.drawn.get(key).map(super::table::plain).unwrap_or_default();
                let _ = writeln!(
                    text,
                    "| {} | {} | {} + {} s | {} | {} | {} |",
                    row.index,
                    drawn(super::plan::FAULT),
                    drawn(super::plan::PHASE),
                    drawn("fault_at_s"),
                    row.outcome.name(),
                    detail(row),
                    row.modes.replace('>', " › ")
                );
            }
        }
        text
    }

    fn counts(&self) -> BTreeMap<&'static str, usize> {
        let of = |o: Outcome| self.rows.iter().filter(|r| r.outcome == o).count();
        Outcome::ALL.into_iter().map(|o| (o.name(), of(o))).collect()
    }

    /// Flights whose fault never came: the flight ended before.
    fn missed(&self) -> usize {
        self.rows.iter().filter(|r| r.fault_s.is_none()).count()
    }

    fn markdown(&self) -> String {
        let (date, counts) = (today(), self.counts());
        let bad = |o: Outcome, with: bool| {
            self.rows.iter().filter(|r| r.outcome == o && self.has_reaction(r) == with).count()
        };
        let mut text = format!(
            "# The fault campaign\n\nWritten by `{}`{}. Do not edit.\n\n\
             {} flights, {date}, commit {}, campaign {:.12}. Every fault of the catalogue \
             (`haltere-sim campaign faults --list`) comes in every part of a flight: spool (thrust rises on the \
             floor), climb, hover, waypoints, return, landing. Flight, fault and judge: `sim/campaigns/faults.toml`, \
             `sim/src/campaign/catalogue.rs`, `sim/src/campaign/judge.rs`; how campaigns work: CAMPAIGNS.md.\n\n\
             Judged by the truth of the simulator. **Left** (L): the centre of mass was outside the fence by any \
             amount. **Crashed** (C): tumbled, or met the floor sinking faster than 2 m/s, sliding faster than \
             1.5 m/s or leaning by more than 45°. **U**: still armed or in the air at the limit, or the program \
             panicked. The first of these counts. All others are safe: landed whole and inside, or never off the \
             floor. A fault has no reaction where nothing on board could help; the list of the catalogue says why.\n\n",
            "haltere-sim campaign faults --doc docs/FAULTS.md",
            if self.identity.sample { " (a sample)" } else { "" },
            self.rows.len(),
            self.identity.program.commit,
            self.identity.digest,
        );
        text.push_str("| outcome | flights | of these no reaction exists |\n|---|---|---|\n");
        for outcome in Outcome::ALL {
            let _ = writeln!(
                text,
                "| {} | {} | {} |",
                outcome.name(),
                counts.get(outcome.name()).copied().unwrap_or_default(),
                bad(outcome, false)
            );
        }
        let _ = writeln!(
            text,
            "\nTarget: no flight leaves the fence, no crash where a reaction exists: **{}**. In {} flights the fault \
             did not come, because the flight was over before.\n\n## By fault and part of the flight\n\nFlights \
             that were safe, and those that were not.\n\n{}",
            if self.target_is_met() { "met" } else { "missed" },
            self.missed(),
            self.table()
        );
        let _ = write!(
            text,
            "\n## Flights that were not safe\n\n`{} --fly FLIGHT --log flight.mcap` flies one again and keeps its log \
             and its truth.\n{}",
            self.again,
            self.failures()
        );
        text
    }

    fn json(&self) -> serde_json::Value {
        let cells = self.cells();
        let faults: Vec<_> = self
            .campaign
            .faults
            .iter()
            .zip(&cells)
            .map(|(entry, line)| {
                let phases: BTreeMap<_, _> = self
                    .campaign
                    .phases
                    .iter()
                    .zip(line)
                    .map(|(phase, c)| {
                        let safe = c.flights - c.left - c.crashed - c.other;
                        let cell = json!({ "flights": c.flights, "safe": safe, "left": c.left,
                            "crashed": c.crashed, "unfinished": c.other });
                        (phase.name(), cell)
                    })
                    .collect();
                json!({
                    "fault": entry.name,
                    "group": entry.group,
                    "reaction": matches!(entry.reaction, Reaction::Exists(_)),
                    "phases": phases,
                })
            })
            .collect();
        let bad: Vec<_> = self
            .rows
            .iter()
            .filter(|r| !matches!(r.outcome, Outcome::Landed | Outcome::NotTakenOff))
            .map(|r| {
                json!({
                    "flight": r.index, "seed": r.seed, "drawn": r.drawn, "outcome": r.outcome.name(),
                    "what": detail(r), "modes": r.modes, "said": r.said,
                    "reaction": self.has_reaction(r),
                    "command": format!("{} --fly {i} --log flight-{i}.mcap", self.again, i = r.index),
                })
            })
            .collect();
        json!({
            "date": today(),
            "commit": self.identity.program.commit,
            "digest": self.identity.digest,
            "flights": self.rows.len(),
            "sample": self.identity.sample,
            "target_met": self.target_is_met(),
            "outcomes": self.counts(),
            "fault_did_not_come": self.missed(),
            "faults": faults,
            "not_safe": bad,
        })
    }
}

fn detail(row: &Row) -> String {
    let mut text = row.why.clone();
    if row.outcome == Outcome::Left && row.crashed() {
        text.push_str(", then crashed");
    } else if row.outcome == Outcome::Crashed && row.left() {
        let _ = write!(text, ", then {:.2} m outside", row.outside_m);
    }
    text
}

/// Date of today, UTC.
fn today() -> String {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let us = now.map_or(0, |d| i64::try_from(d.as_micros()).unwrap_or(0));
    let text = haltere::record::utc_text(us);
    text.chars().take(10).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn campaign() -> Campaign {
        Campaign::parse(CAMPAIGN, Path::new("."), None, "faults").unwrap()
    }

    #[test]
    fn prop_the_committed_campaign_is_large_enough() {
        let c = campaign();
        assert!(c.flights >= 2000, "{}", c.flights);
        assert_eq!(c.faults.len(), catalogue::all().len());
        assert_eq!(c.phases.len(), 6);
    }

    #[test]
    fn prop_a_sample_has_every_fault_and_every_phase() {
        let c = campaign();
        for n in 1..=6 {
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
        assert_eq!(worse(&crashed, &serde_json::json!({})), 1, "an empty result excuses nothing");
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
