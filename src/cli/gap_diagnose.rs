//! `haltere gap diagnose`: one flight against the nominal simulator.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;

use super::gap::{BankOptions, Progress, RoomOptions};
use super::{print, print_json};
use crate::gap::attribute::Settings;
use crate::gap::diagnosis::{Diagnosis, HeldOut, ShrinkResult, judge, observed, unreadable};
use crate::gap::logs::{self, Flown};
use crate::gap::page;
use crate::gap::scene::Scene;
use crate::gap::workshop::Workshop;

/// Says where a flight differs from the nominal simulator, which effect causes it, and how far the
/// gap shrinks once that effect is added.
///
/// The first log is diagnosed; the others, on the same or another mission, are flights that the fit
/// does not see and that the shrink is measured on.
///
/// Exit codes: 0 no gap, 10 named, 11 one of a set, 12 several, 13 not in the library, 14 named with
/// a remainder, 20 not testable, 30 log or replay fault.
#[derive(Debug, Args)]
pub(super) struct Diagnose {
    /// Flight logs of the companion.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Accepted flights of this airframe on the mission of the first log: they set the floor.
    #[arg(long, value_name = "LOG")]
    reference: Vec<PathBuf>,
    /// Accepted flights of this airframe on the missions of the other logs.
    #[arg(long, value_name = "LOG")]
    held_out_reference: Vec<PathBuf>,
    #[command(flatten)]
    room: RoomOptions,
    #[command(flatten)]
    options: BankOptions,
    /// Writes the report as one HTML page, and the same as JSON beside it.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

/// Fewest reference flights that say anything about a spread.
const LEAST_REFERENCES: usize = 8;

impl Diagnose {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let room = self.room.room()?;
        let [first, others @ ..] = &self.logs[..] else { anyhow::bail!("no log") };
        let flown = match logs::read(first) {
            Ok(flown) => flown,
            Err(error) => {
                return self.answer(&unreadable(first.display().to_string(), error.to_string()));
            }
        };
        // Gate 0 comes before any bank is flown.
        if let Some(fault) = flown.faults.first() {
            return self.answer(&unreadable(first.display().to_string(), fault.clone()));
        }
        let scene = flown.scene(room).on_grid();
        if flown.mission.is_empty() {
            anyhow::bail!(
                "{}: no mission in this log; only a flight that can be flown again can be compared",
                first.display()
            );
        }
        let progress = Progress::new("bank");
        let items = flown.mission.clone();
        let workshop = Workshop::open(
            &self.options.folder(),
            scene.clone(),
            items,
            self.options.library()?,
            self.options.size(),
            |done, of| progress.at(done, of),
        )?;
        let references = self.statistics(&self.reference, &workshop, &flown)?;
        if !references.is_empty() && references.len() < LEAST_REFERENCES {
            anyhow::bail!(
                "{} reference flights, at least {LEAST_REFERENCES} needed, 20 are better",
                references.len()
            );
        }
        eprintln!("learning the bank");
        let attributor = workshop.learn(
            &references,
            &[],
            &Settings { jittered: true, ..Settings::default() },
        )?;
        let seen = observed(flown, &workshop.nominal);
        let mut diagnosis = judge(&workshop, &attributor, references.len(), &seen);
        if !others.is_empty() && !diagnosis.effects.is_empty() {
            diagnosis.shrink = Some(self.shrink(&workshop, &scene, others, &diagnosis)?);
        }
        self.answer(&diagnosis)
    }

    fn answer(&self, diagnosis: &Diagnosis) -> anyhow::Result<ExitCode> {
        if let Some(path) = &self.report {
            let write = |path: &std::path::Path, text: String| {
                std::fs::write(path, text).with_context(|| format!("{}", path.display()))
            };
            write(path, page::render(diagnosis))?;
            write(&path.with_extension("json"), serde_json::to_string_pretty(diagnosis)?)?;
        }
        if self.json {
            print_json(diagnosis)?;
        } else {
            print(&text(diagnosis));
        }
        Ok(ExitCode::from(diagnosis.exit_code()))
    }

    fn statistics(
        &self,
        paths: &[PathBuf],
        workshop: &Workshop,
        flown: &Flown,
    ) -> anyhow::Result<Vec<Vec<f64>>> {
        let mut rows = Vec::new();
        for path in paths {
            let reference = logs::read(path)?;
            if let Some(fault) = reference.faults.first() {
                anyhow::bail!("{}: no reference: {fault}", path.display());
            }
            if reference.mission.len() != flown.mission.len() {
                anyhow::bail!("{}: another mission than {}", path.display(), flown.path.display());
            }
            match observed(reference, &workshop.nominal).observation {
                Ok(observation) => rows.push(observation.statistics),
                Err(why) => anyhow::bail!("{}: {why}", path.display()),
            }
        }
        Ok(rows)
    }

    fn shrink(
        &self,
        workshop: &Workshop,
        scene: &Scene,
        others: &[PathBuf],
        diagnosis: &Diagnosis,
    ) -> anyhow::Result<ShrinkResult> {
        let mut pairs = Vec::new();
        let mut rivals: Vec<Vec<_>> = Vec::new();
        let mut references = Vec::new();
        for path in &self.held_out_reference {
            let reference = logs::read(path)?;
            if let Ok(seen) = observed(reference, &workshop.nominal).observation {
                references.push(seen.statistics);
            }
        }
        let candidates = diagnosis.attribution.as_ref().map_or(&[][..], |a| &a.candidates[..]);
        let progress = Progress::new("shrink");
        let mut model = None;
        let flights: Vec<Flown> =
            others.iter().map(|path| logs::read(path)).collect::<Result<_, _>>()?;
        for flown in &flights {
            let Ok(seen) = observed(flown.clone(), &workshop.nominal).observation else { continue };
            let held_out = HeldOut::new(scene, &flown.mission, &references);
            // Set members are alternatives: the first stands for them. Several act together.
            let together = if diagnosis.outcome == "several" { diagnosis.effects.len() } else { 1 };
            let fitted: Vec<(_, Vec<f64>)> = diagnosis
                .effects
                .iter()
                .take(together)
                .filter_map(|e| {
                    Some((workshop.spec(&e.id)?, e.parameters.iter().map(|p| p.value).collect()))
                })
                .collect();
            let named: Vec<_> = fitted.iter().map(|(spec, theta)| (*spec, &theta[..])).collect();
            pairs.push(held_out.paired(&seen.statistics, &named));
            let others: Vec<_> = candidates
                .iter()
                .filter(|c| !diagnosis.set.contains(&c.id) && !c.theta.is_empty())
                .take(RIVALS)
                .filter_map(|c| Some((workshop.spec(&c.id)?, &c.theta[..])))
                .collect();
            rivals.resize(others.len(), Vec::new());
            for (k, rival) in others.iter().enumerate() {
                progress.at(k + 1, others.len());
                rivals[k].push(held_out.paired(&seen.statistics, &[*rival]));
            }
            model = Some(held_out);
        }
        let Some(model) = model else { anyhow::bail!("no held-out flight could be observed") };
        let result = model.shrink(&pairs);
        let mut values: Vec<f64> =
            rivals.iter().filter_map(|pairs| model.shrink(pairs).value).collect();
        values.sort_by(f64::total_cmp);
        let best = values.last().copied();
        Ok(ShrinkResult {
            value: result.value,
            low: result.interval.map(|i| i[0]),
            high: result.interval.map(|i| i[1]),
            floor: result.floor,
            before: result.before,
            after: result.after,
            attainable: result.value.into_iter().chain(best).reduce(f64::max),
            wrong: values.get(values.len() / 2).copied(),
            references: references.len(),
        })
    }
}

/// Effects that are not named and flown as control.
const RIVALS: usize = 5;

fn text(d: &Diagnosis) -> String {
    use std::fmt::Write;
    let mut out = String::new();
    let against = match d.references {
        0 => "the nominal simulator".to_owned(),
        n => format!("the nominal simulator and {n} reference flights"),
    };
    let _ = writeln!(out, "GAP REPORT  {} against {against}, replay {}", d.log, d.replay);
    let _ = writeln!(out, "VERDICT     {}", d.verdict);
    for fault in d.faults.iter().chain(&d.remarks) {
        let _ = writeln!(out, "            {fault}");
    }
    for place in &d.places {
        let anchor = place.anchor.map_or(String::new(), |a| format!(", anchor {a}"));
        let _ = writeln!(
            out,
            "WHERE       {} ({:.0} sigma{anchor}), loudest {}",
            place.block, place.score, place.regime
        );
    }
    for effect in &d.effects {
        let _ = writeln!(
            out,
            "EFFECT      {} {}, probability {:.2}",
            effect.id, effect.name, effect.probability
        );
        for p in &effect.parameters {
            let _ = writeln!(
                out,
                "              {} = {:.4} {} (90 %: {:.4} to {:.4})",
                p.name, p.value, p.unit, p.low, p.high
            );
        }
    }
    match &d.shrink {
        None => {
            let _ = writeln!(out, "SHRINK      not measured: needs a held-out flight");
        }
        Some(s) => {
            let interval = match (s.low, s.high) {
                (Some(low), Some(high)) => format!(" (95 %: {low:.2} to {high:.2})"),
                _ => " (no interval: fewer than three held-out flights)".to_owned(),
            };
            let value = s.value.map_or("nothing to shrink".to_owned(), |v| format!("{v:.2}"));
            let more = |name: &str, v: Option<f64>| {
                v.map_or(String::new(), |v| format!(", {name} {v:.2}"))
            };
            let _ = writeln!(
                out,
                "SHRINK      {value}{interval}: distance {:.2} to {:.2}, floor {:.2}{}{}",
                s.before,
                s.after,
                s.floor,
                more("attainable", s.attainable),
                more("other effects", s.wrong)
            );
        }
    }
    if d.references > 0 && d.shrink.as_ref().is_some_and(|s| s.references == 0) {
        let _ = writeln!(
            out,
            "            without --held-out-reference this holds all that the airframe differs by"
        );
    }
    if !d.not_testable.is_empty() {
        let _ = writeln!(out, "NOT TESTABLE  {}", d.not_testable.join(" "));
    }
    for p in &d.parameters_changed {
        let _ = writeln!(out, "PARAMETER   {} = {} (default {})", p.key, p.flown, p.default);
    }
    let _ = writeln!(out, "BANK        {}", d.bank);
    out
}
