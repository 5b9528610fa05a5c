//! `haltere-lab worlds DIR`: many worlds in place of two, so that limits hold on a vehicle that nobody has seen.
//!
//! Worlds are drawn (`generator::world`) and lie in three parts that never meet: on the first the diagnosis may learn, on the second
//! choices are made, the third is reported. A world is flown by its owner's companion: accepted flights of a session, healthy ones of
//! others, an effect each by a law of that world, effects of a grammar that no library holds, pairs. The program
//! commissions the owner's file to the accepted flights, flies its bank and judges.
//!
//! ```text
//! DIR/learn-00.page   the world in words and numbers
//! DIR/learn-00.bank   the bank of the commissioned vehicle
//! DIR/learn-00.json   statistics of its flights, with what was the matter
//! ```
//! What is there is not flown again, so that another build's verdicts are a matter of seconds. Whoever changes what is flown begins in
//! another folder.

mod bench;
mod flown;
mod learn;
mod table;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use haltere::cli::{print, print_json};
use haltere_gap::attribute::{Attributor, Settings};
use haltere_gap::bank::bank_file::{self, from_disk};
use haltere_gap::bank::make_bank::BankSize;
use haltere_gap::flight::seal;
use haltere_gap::flight::statistics::specs;
use haltere_log::written;
use serde::Serialize;

use crate::cases::list::mixed;
use crate::generator::world::World;
use crate::score::Truth;
use bench::{processor_s, recall, remember, seen};
use flown::Flyable;
use table::Tally;

/// Parts, how many worlds each has, and where its seeds begin.
const PARTS: [(&str, u64, u64); 3] =
    [("learn", 24, 5_601_000), ("choose", 8, 5_602_000), ("report", 16, 5_603_000)];

/// What to do.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Where worlds are kept.
    directory: PathBuf,
    /// Worlds to learn on, `A..B` of 24.
    #[arg(long, value_name = "A..B", value_parser = range)]
    learn: Option<(u64, u64)>,
    /// Worlds to choose on, of 8.
    #[arg(long, value_name = "A..B", value_parser = range)]
    choose: Option<(u64, u64)>,
    /// Worlds to report on, of 16: once a release.
    #[arg(long, value_name = "A..B", value_parser = range)]
    report: Option<(u64, u64)>,
    /// Writes pages only; nothing is flown. Prints the hash over all of them.
    #[arg(long)]
    pages: bool,
    /// Flies the healthy sessions only, without commissioning or a bank, and writes what statistics vary by between sessions.
    #[arg(long, value_name = "FILE", conflicts_with = "pages")]
    sessions: Option<PathBuf>,
    /// Flies effects beside the same flights without them, likewise, and writes what they did.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["pages", "sessions"])]
    laws: Option<PathBuf>,
    /// Says every verdict.
    #[arg(long)]
    verdicts: bool,
    /// Choices of the attribution, key=value in TOML, for experiments.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

fn range(text: &str) -> Result<(u64, u64), String> {
    let (from, to) = text.split_once("..").ok_or("expected A..B")?;
    let number = |text: &str| text.parse::<u64>().map_err(|e| format!("{text:?}: {e}"));
    let (from, to) = (number(from)?, number(to)?);
    if from < to { Ok((from, to)) } else { Err(format!("{text}: no world")) }
}

/// A world of a part.
#[derive(Debug, Clone)]
struct Place {
    name: String,
    seed: u64,
    /// By what a user has: the whole mission, and a bank of full size. Others fly half of it beside a small bank, for their number's sake.
    whole: bool,
}

impl Options {
    fn chosen(&self) -> Result<Vec<Place>> {
        let asked = [self.learn, self.choose, self.report];
        let mut places = Vec::new();
        for ((part, count, first), asked) in PARTS.into_iter().zip(asked) {
            let Some((from, to)) = asked else { continue };
            if to > count {
                bail!("--{part} {from}..{to}: there are {count}");
            }
            places.extend((from..to).map(|k| place(part, first, k)));
        }
        Ok(places)
    }
}

fn place(part: &str, first: u64, k: u64) -> Place {
    Place { name: format!("{part}-{k:02}"), seed: first + k, whole: part == "report" }
}

/// SHA-256 over the pages of all worlds as they are drawn first.
fn digest() -> String {
    let pages = PARTS.into_iter().flat_map(|(part, count, first)| {
        (0..count).map(move |k| {
            let place = place(part, first, k);
            format!("{}\n{}", place.name, World::drawn(mixed(place.seed, 0)).page())
        })
    });
    seal::digest(pages.collect::<String>().as_bytes())
}

/// A world, judged.
#[derive(Debug, Serialize)]
struct Judged {
    world: String,
    mass_kg: f64,
    redrawn: u64,
    beyond: Vec<(String, f64)>,
    not_flown: usize,
    tally: Tally,
    processor_s: [f64; 4],
    verdicts: Vec<String>,
}

/// Flies what is not there, judges, prints.
pub fn run(options: &Options) -> Result<bool> {
    let folder = &options.directory;
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let places = options.chosen()?;
    if options.pages {
        for Place { name, seed, .. } in &places {
            let page = World::drawn(mixed(*seed, 0)).page();
            written::write(&folder.join(format!("{name}.page")), page, &[""; 0])?;
        }
        print(&format!("{}\n", digest()))?;
        return Ok(true);
    }
    let seeds: Vec<u64> = places.iter().map(|place| place.seed).collect();
    if let Some(file) = &options.sessions {
        learn::sessions(&seeds, file)?;
        return Ok(true);
    }
    if let Some(file) = &options.laws {
        learn::laws(&seeds, file)?;
        return Ok(true);
    }
    if places.is_empty() {
        bail!("no worlds were asked for: --learn A..B, --choose A..B, --report A..B");
    }
    let settings = match &options.set[..] {
        [] => Settings::for_flights(),
        set => toml::from_str::<Settings>(&set.join("\n"))?.beside_flights(),
    };
    let mut all = Vec::new();
    for place in &places {
        all.push(judged(folder, place, &settings)?);
    }
    if options.json {
        print_json(&all)?;
        return Ok(true);
    }
    let mut out = Tally::head();
    let mut whole = Tally::default();
    for one in &all {
        out += &one.tally.line(&format!("{}, {:.0} g", one.world, 1e3 * one.mass_kg));
        whole.join(&one.tally);
    }
    out += &whole.line("all");
    out += &format!("\n{}\n", whole.limits());
    for one in &all {
        let beyond: Vec<String> =
            one.beyond.iter().map(|(block, times)| format!("{block} {times:.1}")).collect();
        let [flown, commissioned, bank, judging] = one.processor_s;
        out += &format!(
            "{}: {} drawn before it, {} flights not to their end, beyond {}; processor s: flights {flown:.0}, commissioning \
             {commissioned:.0}, bank {bank:.0}, verdicts {judging:.0}\n",
            one.world,
            one.redrawn,
            one.not_flown,
            if beyond.is_empty() { "nothing".to_owned() } else { beyond.join(", ") },
        );
        if options.verdicts {
            for line in &one.verdicts {
                out += &format!("  {line}\n");
            }
        }
    }
    print(&out)?;
    Ok(true)
}

fn judged(folder: &Path, place: &Place, settings: &Settings) -> Result<Judged> {
    let at = |end: &str| folder.join(format!("{}.{end}", place.name));
    let tell = |line: String| eprintln!("{}: {line}", place.name);
    if !at("json").exists() {
        let begun_s = processor_s();
        let flyable = Flyable::found(place.seed, place.whole, &tell)?;
        written::write(&at("page"), flyable.world.page(), &[""; 0])?;
        tell(format!("{:.0} g flies", 1e3 * flyable.world.craft.stated_kg));
        let size = if place.whole { BankSize::default() } else { BankSize::SMALL };
        let seen = seen(&flyable, size, begun_s, &at("bank"), &tell)?;
        remember(&at("json"), &seen)?;
    }
    let seen = recall(&at("json"))?;
    let (bank, _) = bank_file::read(&at("bank")).map_err(|error| anyhow!("{error}"))?;
    let begun_s = processor_s();
    let accepted: Vec<Vec<f64>> = seen.accepted.iter().cloned().map(from_disk).collect();
    let blocks: Vec<_> = specs().iter().map(|spec| spec.block).collect();
    let attributor = Attributor::new(&bank, &accepted, &[], &blocks, settings)?;
    let known: Vec<_> = seen
        .rows
        .iter()
        .filter_map(|one| Some((one, from_disk(one.statistics.clone()?))))
        .collect();
    let flights: Vec<Vec<f64>> = known.iter().map(|(_, flight)| flight.clone()).collect();
    let verdicts = attributor.attribute_all(&flights);
    let mut tally = Tally::default();
    let mut lines = Vec::new();
    for ((one, _), verdict) in known.iter().zip(&verdicts) {
        tally.add(&one.truth, verdict);
        let truth = match &one.truth {
            Truth::NoGap => "healthy".to_owned(),
            Truth::Single { id, .. } => format!("{id} {:.0}", one.times),
            Truth::Pair { ids } => ids.join(" + "),
            Truth::Unknown { name } => name.clone(),
        };
        let said: Vec<&str> = verdict.outcome.effects().iter().map(|e| e.id.as_str()).collect();
        let first = verdict.candidates.first();
        lines.push(format!(
            "{truth}, session {}: {} {}; first {} {:.2}, gate {:.1} of {:.1}, {:.1} of {:.1}, adequacy {:.1} of {:.1}, foretold {:.2}",
            one.session,
            verdict.outcome.key(),
            said.join(" "),
            first.map_or("-", |c| c.id.as_str()),
            first.map_or(0.0, |c| c.posterior),
            verdict.gate.distance,
            verdict.gate.distance_limit,
            verdict.gate.effect,
            verdict.gate.effect_limit,
            verdict.adequacy.score,
            verdict.adequacy.limit,
            verdict.adequacy.foretold,
        ));
    }
    let [flown, commissioned, bank_s] = seen.processor_s;
    Ok(Judged {
        world: place.name.clone(),
        mass_kg: seen.mass_kg,
        redrawn: seen.redrawn,
        beyond: seen.beyond.clone(),
        not_flown: seen.rows.len() - known.len(),
        tally,
        processor_s: [flown, commissioned, bank_s, processor_s() - begun_s],
        verdicts: lines,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As committed before any of them was flown; whoever changes what is drawn begins another list.
    const PAGES_SHA256: &str = "79f5e93bf1be6cfd2b4ccde671b908743ce8e8b43ccf4ccddc91e8ce53904078";

    #[test]
    fn prop_worlds_are_those_that_were_committed() {
        assert_eq!(digest(), PAGES_SHA256);
    }

    #[test]
    fn prop_parts_never_meet() {
        let mut seeds: Vec<u64> = PARTS
            .into_iter()
            .flat_map(|(_, count, first)| (0..count).map(move |k| first + k))
            .collect();
        let all = seeds.len();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), all);
        assert!(range("3..2").is_err() && range("7").is_err() && range("0..4") == Ok((0, 4)));
    }
}
