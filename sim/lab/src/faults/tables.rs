//! What a fault campaign came to: the table by fault and part of the flight, docs/FAULTS.md, the same as JSON.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use haltere::simulated::campaign::entry::{Entry, Reaction};
use haltere::simulated::campaign::file::Campaign;
use haltere::simulated::campaign::plan::{FAULT, FAULT_AT, FROM_START, PHASE, VOLUME};
use haltere::simulated::campaign::row::{Outcome, Row};
use haltere::simulated::campaign::store::Identity;
use haltere::simulated::campaign::table::plain;
use serde_json::json;

/// Results of a fault campaign, and how they are told.
pub(super) struct Report<'a> {
    pub campaign: &'a Campaign,
    pub identity: &'a Identity,
    pub rows: &'a [&'a Row],
    /// The command, for one flight again.
    pub again: &'a str,
}

/// Flights of a fault in a part of the flight.
#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    flights: u64,
    left: u64,
    again: u64,
    crashed: u64,
    other: u64,
}

impl Cell {
    fn add(&mut self, row: &Row) {
        self.flights += 1;
        match row.outcome {
            Outcome::Landed | Outcome::NotTakenOff => {}
            Outcome::Left => self.left += 1,
            Outcome::Again => self.again += 1,
            Outcome::Crashed => self.crashed += 1,
            Outcome::Unfinished | Outcome::Panicked => self.other += 1,
        }
    }

    fn sum(&mut self, other: &Cell) {
        self.flights += other.flights;
        self.left += other.left;
        self.again += other.again;
        self.crashed += other.crashed;
        self.other += other.other;
    }

    fn safe(&self) -> u64 {
        self.flights - self.left - self.again - self.crashed - self.other
    }

    fn text(&self) -> String {
        if self.flights == 0 {
            return "–".to_owned();
        }
        let mut text = self.safe().to_string();
        for (count, letter) in
            [(self.left, 'L'), (self.again, 'A'), (self.crashed, 'C'), (self.other, 'U')]
        {
            if count > 0 {
                let _ = write!(text, " {count}{letter}");
            }
        }
        text
    }
}

impl Report<'_> {
    fn entry(&self, row: &Row) -> Option<&Entry> {
        let (fault, _, _) = self.campaign.fault_place(row.index)?;
        self.campaign.faults.get(fault)
    }

    /// Where something on board can help: not against what is met while the companion stands still, when the board flies
    /// alone.
    fn has_reaction(&self, row: &Row) -> bool {
        let Some(entry) = self.entry(row) else { return true };
        let stood_still = entry.stands_still_s().zip(row.fault_s).zip(row.crashed_s);
        let too_early = stood_still.is_some_and(|((s, from_s), at_s)| at_s <= from_s + s);
        !matches!(entry.reaction, Reaction::None(_)) && !too_early
    }

    /// What the target forbids.
    fn is_failure(&self, row: &Row) -> bool {
        match row.outcome {
            Outcome::Landed | Outcome::NotTakenOff => false,
            Outcome::Left => true,
            Outcome::Crashed | Outcome::Again => self.has_reaction(row) || row.left(),
            Outcome::Unfinished | Outcome::Panicked => true,
        }
    }

    pub fn target_is_met(&self) -> bool {
        !self.rows.iter().any(|r| self.is_failure(r))
    }

    /// Flights that are not safe under a fault that was safe in every flight of an earlier result. A fault that
    /// it does not know is judged by the bounds alone.
    pub fn worse_than(&self, earlier: &serde_json::Value) -> Vec<String> {
        let of_name = |name: &str| {
            earlier["faults"].as_array().into_iter().flatten().find(|f| f["fault"] == name)
        };
        let unsafe_before = |fault: &serde_json::Value| {
            let phases = fault["phases"].as_object();
            phases.is_some_and(|phases| phases.values().any(|c| c["flights"] != c["safe"]))
        };
        let worse = |row: &&Row| {
            let entry = self.entry(row)?;
            let before = of_name(&entry.name);
            let excused = before.is_some_and(unsafe_before);
            let is_worse = row.outcome == Outcome::Panicked || (self.is_failure(row) && !excused);
            is_worse.then(|| {
                format!(
                    "{}: flight {}, {}: {}, {}",
                    if before.is_some() { "worse than before" } else { "new, and not safe" },
                    row.index,
                    entry.name,
                    row.outcome.name(),
                    detail(row)
                )
            })
        };
        self.rows.iter().filter_map(worse).collect()
    }

    /// Names of the faults that were flown and that an earlier result does not know.
    pub fn new_since(&self, earlier: &serde_json::Value) -> Vec<&str> {
        let known = |name: &str| {
            earlier["faults"].as_array().into_iter().flatten().any(|f| f["fault"] == name)
        };
        let mut names: Vec<&str> =
            self.rows.iter().filter_map(|row| Some(self.entry(row)?.name.as_str())).collect();
        names.sort_unstable();
        names.dedup();
        names.retain(|name| !known(name));
        names
    }

    /// Columns of the table: what is there from the start has no part of the flight.
    fn columns(&self) -> Vec<&'static str> {
        let phases = self.campaign.phases.iter().map(|phase| phase.name());
        let from_start = self.campaign.faults.iter().any(Entry::is_from_start);
        from_start.then_some(FROM_START).into_iter().chain(phases).collect()
    }

    fn cells(&self) -> Vec<Vec<Cell>> {
        let columns = self.columns();
        let mut cells = vec![vec![Cell::default(); columns.len()]; self.campaign.faults.len()];
        for row in self.rows {
            let phase = row.drawn.get(PHASE).and_then(serde_json::Value::as_str);
            let column = columns.iter().position(|name| Some(*name) == phase);
            if let (Some((fault, _, _)), Some(column)) =
                (self.campaign.fault_place(row.index), column)
                && let Some(cell) = cells.get_mut(fault).and_then(|line| line.get_mut(column))
            {
                cell.add(row);
            }
        }
        cells
    }

    /// Faults that were flown, or their groups, by part of the flight.
    pub fn table(&self, name: impl Fn(&Entry) -> &str) -> String {
        let columns = self.columns();
        let mut lines: Vec<(&str, Vec<Cell>)> = Vec::new();
        let mut sums = vec![Cell::default(); columns.len()];
        for (entry, line) in self.campaign.faults.iter().zip(&self.cells()) {
            if line.iter().all(|cell| cell.flights == 0) {
                continue;
            }
            let name = name(entry);
            if lines.last().is_none_or(|(last, _)| *last != name) {
                lines.push((name, vec![Cell::default(); columns.len()]));
            }
            let cells = lines.last_mut().into_iter().flat_map(|(_, cells)| cells);
            for ((cell, own), sum) in line.iter().zip(cells).zip(&mut sums) {
                own.sum(cell);
                sum.sum(cell);
            }
        }
        lines.push(("**all**", sums));
        let mut text = format!("| fault | {} |\n|---|", columns.join(" | "));
        text.push_str(&"---|".repeat(columns.len()));
        for (name, cells) in &lines {
            let cells: Vec<String> = cells.iter().map(Cell::text).collect();
            let _ = write!(text, "\n| {name} | {} |", cells.join(" | "));
        }
        text.push('\n');
        text
    }

    /// Every crash, every leaving, every flight that did not end, where a reaction exists or where none does.
    pub fn failures(&self, with_reaction: bool) -> String {
        let bad = |r: &&&Row| !matches!(r.outcome, Outcome::Landed | Outcome::NotTakenOff);
        let rows = self.rows.iter().filter(bad);
        let rows: Vec<_> = rows.filter(|r| self.has_reaction(r) == with_reaction).collect();
        let title =
            if with_reaction { "Where a reaction exists" } else { "Where no reaction exists" };
        let mut text = format!("\n### {title}: {} flights\n\n", rows.len());
        if rows.is_empty() {
            text.push_str("None.\n");
            return text;
        }
        text.push_str(
            "| flight | fault | phase | outcome | what happened |\n|---|---|---|---|---|\n",
        );
        for row in rows {
            let drawn = |key: &str| row.drawn.get(key).map(plain).unwrap_or_default();
            let when = match row.drawn.get(FAULT_AT) {
                Some(at_s) => format!("{} + {at_s} s", drawn(PHASE)),
                None => drawn(PHASE),
            };
            let _ = writeln!(
                text,
                "| {} | {} | {when} | {} | {} |",
                row.index,
                drawn(FAULT),
                row.outcome.name(),
                detail(row)
            );
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

    pub fn markdown(&self) -> String {
        let (date, counts) = (today(), self.counts());
        let bad = |o: Outcome, with: bool| {
            self.rows.iter().filter(|r| r.outcome == o && self.has_reaction(r) == with).count()
        };
        let mut text = format!(
            "# The fault campaign\n\nWritten by `{}`{}. Do not edit.\n\n\
             {} flights, {date}, commit {}, campaign {:.12}; {} of them in the companion's default volume, where \
             walls and ceiling are the fence. Every fault of the catalogue (`haltere-lab faults --list`) comes in every part of a \
             flight: spool (thrust rises on the floor), climb, hover, waypoints, return, landing, touchdown (below 0.15 m in a \
             landing); what the companion is told wrongly is there from the start. CAMPAIGNS.md says how flights are \
             judged, by the truth of the simulator: **L** left the volume, **A** left the floor again, **C** crashed, **U** \
             unfinished or panicked; all others are safe. A fault has no reaction where nothing on board could help; the list of \
             the catalogue says why. Nor has what the vehicle meets while the companion stands still: the board flies it \
             alone.\n\n",
            "haltere-lab faults --doc docs/FAULTS.md",
            if self.identity.sample { " (a sample)" } else { "" },
            self.rows.len(),
            self.identity.program.commit,
            self.identity.digest,
            self.rows.iter().filter(|r| r.drawn.contains_key(VOLUME)).count(),
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
            "\nTarget: no flight leaves the fence; where a reaction exists none leaves the floor again and none crashes: **{}**. In {} flights the fault \
             did not come, because the flight was over before.\n\n## By group of faults and part of the flight\n\nFlights \
             that were safe, and those that were not; by fault in sim/lab/FAULTS.json.\n\n{}",
            if self.target_is_met() { "met" } else { "missed" },
            self.missed(),
            self.table(|entry| entry.group)
        );
        let _ = write!(
            text,
            "\n## Flights that were not safe\n\n`{} --fly FLIGHT --log flight.mcap` flies one again and keeps its log \
             and its truth.\n{}",
            self.again,
            self.failures(true)
        );
        text
    }

    pub fn json(&self) -> serde_json::Value {
        let cells = self.cells();
        let faults = self.campaign.faults.iter().zip(&cells).filter_map(|(entry, line)| {
            let phases: BTreeMap<_, _> = self
                .columns()
                .into_iter()
                .zip(line)
                .filter(|(_, c)| c.flights > 0)
                .map(|(column, c)| {
                    let cell = json!({ "flights": c.flights, "safe": c.safe(), "left": c.left,
                        "again": c.again, "crashed": c.crashed, "unfinished": c.other });
                    (column, cell)
                })
                .collect();
            (!phases.is_empty()).then(|| {
                json!({
                    "fault": entry.name,
                    "group": entry.group,
                    "reaction": matches!(entry.reaction, Reaction::Exists(_)),
                    "phases": phases,
                })
            })
        });
        let faults: Vec<_> = faults.collect();
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
    if matches!(row.outcome, Outcome::Left | Outcome::Again) && row.crashed() {
        text.push_str(", then crashed");
    } else if matches!(row.outcome, Outcome::Crashed | Outcome::Again) && row.left() {
        let _ = write!(text, ", then {:.2} m outside", row.outside_m);
    }
    text
}

/// Date of today, UTC.
fn today() -> String {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let us = now.map_or(0, |d| i64::try_from(d.as_micros()).unwrap_or(0));
    let text = haltere_log::record::utc_text(us);
    text.chars().take(10).collect()
}
