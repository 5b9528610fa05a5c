//! `haltere gap accept` and `haltere gap undo`: what was found goes into files, and out again.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;
use serde_json::json;

use super::gap::RoomOptions;
use super::gap_report::Report;
use super::which_flight::WhichFlight;
use super::{print, print_json};
use crate::progress::Progress;
use haltere_core::frames::Vec3;
use haltere_core::measure::AnchorId;
use haltere_gap::accept::accepted::{self, LineChange, lines_changed};
use haltere_gap::accept::trim::{Trim, trim};
use haltere_gap::accept::{edit_anchor, edit_scenario, edit_vehicle, number, set_key};
use haltere_gap::flight::logs::{self, Flown};
use haltere_gap::scene::Told;
use haltere_model::effects::EffectSpec;

/// Writes an effect that was found into the files of the simulator, and, where there is one, the fix into
/// those of the vehicle.
///
/// Without a file it prints what would be set. Every line that changes is printed before it is written, and
/// `haltere gap undo FILE` takes it back. One run accepts one report; run it with the file of each kind that
/// you want changed.
#[derive(Debug, Args)]
pub(super) struct Accept {
    /// Report of `gap diagnose` as JSON.
    report: PathBuf,
    /// Which effect, where the report could not tell some apart, or another of its candidates.
    #[arg(long, value_name = "ID")]
    effect: Option<String>,
    /// Scenario of the simulator: the effect is switched on there.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Vehicle file: the numbers that the effect changes. Use this or --scenario, not both: the simulator
    /// would have the effect twice.
    #[arg(long, value_name = "FILE", conflicts_with = "scenario")]
    vehicle: Option<PathBuf>,
    /// Configuration of the companion: trims.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Anchor survey: the corrected position.
    #[arg(long, value_name = "FILE")]
    anchors: Option<PathBuf>,
    /// The log behind the report, if it has moved.
    #[arg(long, value_name = "LOG")]
    log: Option<PathBuf>,
    #[command(flatten)]
    which: WhichFlight,
    #[command(flatten)]
    room: RoomOptions,
    /// Says what would change, and changes nothing.
    #[arg(long)]
    dry_run: bool,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

/// Takes the newest change by `gap accept` to a file back. Refuses when the file was edited since.
#[derive(Debug, Args)]
pub(super) struct Undo {
    /// The file.
    file: PathBuf,
    /// Says what would change, and changes nothing.
    #[arg(long)]
    dry_run: bool,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

/// A file with its new text.
struct Edit {
    path: PathBuf,
    before: Option<String>,
    after: String,
    lines: Vec<LineChange>,
}

impl Accept {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let report = Report::read(&self.report)?;
        let effects = report.accepted(self.effect.as_deref())?;
        let what = effects
            .iter()
            .map(|(spec, _)| format!("{} {}", spec.id, spec.name))
            .collect::<Vec<_>>()
            .join(" and ");
        let mut edits = Vec::new();
        if let Some(path) = &self.scenario {
            edits.push(edit(path, |text| {
                effects.iter().try_fold(text.to_owned(), |text, (spec, theta)| {
                    edit_scenario(&text, spec, theta)
                })
            })?);
        }
        if let Some(path) = &self.vehicle {
            edits.push(edit(path, |text| {
                effects.iter().try_fold(text.to_owned(), |text, (spec, theta)| {
                    edit_vehicle(&text, spec, theta)
                })
            })?);
        }
        if let Some(path) = &self.anchors {
            edits.push(self.survey(path, &report, &effects)?);
        }
        let mut trims = None;
        if effects.iter().any(|(spec, _)| Trim::MAY_HELP.contains(&spec.id)) {
            // Only from the log is it known where and how it was flown.
            let found = self.trims(&report, &effects);
            match (found, &self.config) {
                (Ok(found), Some(path)) => {
                    edits.push(trimmed(path, &found)?);
                    trims = Some(found);
                }
                (Ok(found), None) => trims = Some(found),
                (Err(why), Some(_)) => return Err(why),
                (Err(why), None) => eprintln!("no trim: {why:#}"),
            }
        } else if let Some(path) = &self.config {
            anyhow::bail!(
                "{}: nothing in the companion's configuration helps against {what}; {}",
                path.display(),
                effects.first().map_or("", |(spec, _)| spec.remedy())
            );
        }
        let hands: Vec<(&str, &str)> =
            effects.iter().map(|(spec, _)| (spec.id, spec.remedy())).collect();
        let patch = edit_patch(&effects)?;
        if self.json {
            let files: Vec<_> =
                edits.iter().map(|e| json!({ "file": e.path, "lines": e.lines })).collect();
            print_json(&json!({
                "accepted": effects.iter().map(|(s, _)| s.id).collect::<Vec<_>>(),
                "patch": patch,
                "files": files,
                "written": !self.dry_run,
                "trims": trims,
                "by_hand": hands.iter().map(|(id, text)| json!({ "id": id, "do": text })).collect::<Vec<_>>(),
            }))?;
        } else {
            print(&format!("accepting {what} ({}: {})\n", self.report.display(), report.verdict))?;
            if edits.is_empty() {
                print(&format!(
                    "for a scenario of haltere-sim (--scenario FILE writes it):\n\n{patch}\n"
                ))?;
            }
            for (id, text) in &hands {
                print(&format!("{id}: {text}\n"))?;
            }
            if let Some(t) = trims.as_ref().filter(|_| self.config.is_none()) {
                print(&format!("{}\n", t.words()))?;
            }
            for e in &edits {
                print(&format!("{}:\n{}", e.path.display(), shown(&e.lines)))?;
            }
        }
        if self.dry_run {
            if !self.json && !edits.is_empty() {
                print("nothing written (--dry-run)\n")?;
            }
            return Ok(ExitCode::SUCCESS);
        }
        for e in edits.iter().filter(|e| !e.lines.is_empty()) {
            let what = format!("{what}, from {}", self.report.display());
            let undo = accepted::write(&e.path, e.before.as_deref(), &e.after, &what)?;
            if !self.json {
                print(&format!(
                    "written; `haltere gap undo {}` takes it back ({})\n",
                    e.path.display(),
                    undo.display()
                ))?;
            }
        }
        Ok(ExitCode::SUCCESS)
    }

    fn trims(
        &self,
        report: &Report,
        effects: &[(&'static EffectSpec, Vec<f64>)],
    ) -> anyhow::Result<Trim> {
        let flown = self.flown(report)?;
        let told = Told { room: self.room.room()?, ..Told::default() };
        let scene = flown.scene(&told).on_grid();
        let named: Vec<_> = effects.iter().map(|(spec, theta)| (*spec, &theta[..])).collect();
        let progress = Progress::new("flying for the trim");
        let found = trim(&scene, &flown.mission, &named, |done, of| progress.at(done, of));
        let mut found = found.context("no flight of the simulator could be observed")?;
        let own = &flown.config.control.trims;
        found.add([own.roll_deg, own.pitch_deg, own.yaw_deg]);
        Ok(found)
    }

    /// The flight behind the report.
    fn flown(&self, report: &Report) -> anyhow::Result<Flown> {
        let log = match &self.log {
            Some(log) => log.clone(),
            None => report.log_beside(&self.report)?,
        };
        Ok(logs::read_flight(&log, self.which.number().or(report.flight()))?)
    }

    /// Anchor survey with the anchor where the flight says it is.
    fn survey(
        &self,
        path: &Path,
        report: &Report,
        effects: &[(&'static EffectSpec, Vec<f64>)],
    ) -> anyhow::Result<Edit> {
        let moved = effects.iter().find(|(spec, _)| spec.id == "U7");
        let Some((_, theta)) = moved else {
            anyhow::bail!(
                "{}: only an anchor survey error (U7) is mended in the survey; {}",
                path.display(),
                effects.first().map_or("", |(spec, _)| spec.remedy())
            );
        };
        let [north, east, down, anchor] = theta[..] else {
            anyhow::bail!("U7: {} parameters in the report, 4 expected", theta.len());
        };
        // The effect counts anchors in the survey that was flown.
        let flown = self.flown(report)?;
        let place = anchor.round().max(0.0) as usize;
        let ids = flown.trace.survey.ids();
        let Some(AnchorId(id)) = ids.get(place).copied() else {
            anyhow::bail!("U7.anchor = {place}, the survey of the log has {} anchors", ids.len());
        };
        let by = Vec3::new(north, east, down);
        let result = edit(path, |text| edit_anchor(text, AnchorId(id), by))?;
        crate::sources::read_anchors(path).map_err(|p| anyhow::anyhow!("{p}"))?;
        Ok(result)
    }
}

/// The effects as a scenario of their own.
fn edit_patch(effects: &[(&'static EffectSpec, Vec<f64>)]) -> anyhow::Result<String> {
    let mut text = String::new();
    for (spec, theta) in effects {
        text = edit_scenario(&text, spec, theta)?;
    }
    Ok(text.trim_start().to_owned())
}

fn edit<E: std::error::Error + Send + Sync + 'static>(
    path: &Path,
    change: impl Fn(&str) -> Result<String, E>,
) -> anyhow::Result<Edit> {
    let before = accepted::read(path)?;
    let text = before.clone().unwrap_or_default();
    let after = change(&text).with_context(|| format!("{}", path.display()))?;
    let after = if before.is_none() { after.trim_start().to_owned() } else { after };
    let lines = lines_changed(&text, &after);
    Ok(Edit { path: path.to_owned(), before, after, lines })
}

fn trimmed(path: &Path, found: &Trim) -> anyhow::Result<Edit> {
    edit(path, |text| {
        let mut text = text.to_owned();
        for (key, value) in found.keys() {
            text = set_key(&text, "control.trims", key, &number(value))?;
        }
        // Read as the companion reads it.
        haltere_pilot::settings::Config::from_toml(&path.display().to_string(), &text)
            .map_err(|p| haltere_gap::accept::EditError::Value(p.to_string()))?;
        Ok::<_, haltere_gap::accept::EditError>(text)
    })
}

fn shown(lines: &[LineChange]) -> String {
    if lines.is_empty() {
        return "  already so, nothing changes\n".to_owned();
    }
    lines.iter().map(|l| format!("  {:>4} {} {}\n", l.number, l.sign, l.text)).collect()
}

impl Undo {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let (what, lines) = accepted::undo(&self.file, self.dry_run)?;
        if self.json {
            print_json(
                &json!({ "undone": what, "file": self.file, "lines": lines, "written": !self.dry_run }),
            )?;
        } else {
            let done = if self.dry_run { "would take back" } else { "took back" };
            print(&format!("{}: {done} {what}\n{}", self.file.display(), shown(&lines)))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
