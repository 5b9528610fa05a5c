//! `haltere gap advise`: which experiment would separate what a diagnosis left open.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;
use serde_json::json;

use super::gap::{BankOptions, SceneOptions};
use super::gap_references::{References, each_once};
use super::gap_report::Report;
use super::gap_session::{Opened, open};
use super::which_flight::{WhichFlight, tell};
use super::{print, print_json};
use crate::progress::Progress;
use haltere_gap::advice::experiments::{EXPERIMENTS, Means, find};
use haltere_gap::advice::{Advice, Effort, Hypothesis, Remaining, advise, after_flight};
use haltere_gap::bank::archive::Shelf;
use haltere_gap::bank::library::whole;
use haltere_gap::diagnosis::{Diagnosis, observed};
use haltere_gap::flight::logs::{self, Flown};
use haltere_gap::nominal::Nominal;
use haltere_gap::scene::{Scene, Told};
use haltere_model::effects::EffectSpec;

/// Ranks manoeuvres and bench actions by how well they would tell apart what a diagnosis did not rule
/// out, and what they would make testable.
///
/// Every flight of the catalogue is flown in the nominal simulator with every candidate; of bench actions
/// the resolution is set against the intervals of the parameters. Takes the JSON of a report, or logs, of
/// which the first is then diagnosed.
#[derive(Debug, Args)]
pub(super) struct Advise {
    /// Report of `gap diagnose` as JSON, or flight logs.
    #[arg(required_unless_present = "list", value_name = "REPORT.json|LOG")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    which: WhichFlight,
    #[command(flatten)]
    references: References,
    /// The log behind the report, if it has moved.
    #[arg(long, value_name = "LOG")]
    log: Option<PathBuf>,
    /// Writes the mission of every flight that is worth it here, for `haltere ctl mission FILE`.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// The log of a recommended flight: says how probable each candidate is now.
    #[arg(long, value_name = "LOG")]
    flown: Option<PathBuf>,
    #[command(flatten)]
    told: SceneOptions,
    #[command(flatten)]
    options: BankOptions,
    /// Only lists the catalogue.
    #[arg(long)]
    list: bool,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

/// Experiments that are printed.
const PRINTED: usize = 8;
/// Least predicted worth of a flight whose mission is written.
const LEAST_WORTH: f64 = 0.01;

impl Advise {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        if self.list {
            print(&catalogue())?;
            return Ok(ExitCode::SUCCESS);
        }
        let mut told = self.told.told()?;
        let (flown, remaining) = match &self.inputs[..] {
            [report] if report.extension().is_some_and(|e| e == "json") => {
                self.report_of(report, &mut told)?
            }
            [first, ..] => {
                match open(first, self.which, &[], &self.references, &self.told, &self.options)? {
                    Opened::Fault(diagnosis) => {
                        anyhow::bail!("{}: {}", diagnosis.log, diagnosis.verdict)
                    }
                    Opened::Ready(session) => {
                        let diagnosis = session.judge();
                        tell(first, session.seen.flown.flight);
                        eprintln!("{}", diagnosis.verdict);
                        told = session.told;
                        (session.seen.flown.clone(), remaining(&diagnosis))
                    }
                }
            }
            [] => anyhow::bail!("no report and no log"),
        };
        let scene = flown.scene(&told).for_bank(&flown.mission);
        if let Some(path) = &self.flown {
            return self.judge_flown(path, &flown, &scene, &remaining);
        }
        if remaining.is_settled() {
            let text = "nothing is open: one explanation, and no effect of the library that this flight could not have shown";
            if self.json {
                print_json(&json!({ "open": [], "advice": [], "note": text }))?;
            } else {
                print(&format!("{text}\n"))?;
            }
            return Ok(ExitCode::SUCCESS);
        }
        let progress = Progress::new("trying the experiments");
        let shelf = Shelf::in_folder(&self.options.folder());
        let tell = |done, of| progress.at(done, of);
        let advice = advise(&scene, &remaining, Effort::All, &shelf, tell);
        let written = match &self.out {
            Some(folder) => write_missions(folder, &scene, &advice, &self.inputs)?,
            None => Vec::new(),
        };
        if self.json {
            let open: Vec<_> = remaining
                .candidates
                .iter()
                .map(|h| json!({ "id": h.spec.id, "name": h.spec.name, "probability": h.probability }))
                .collect();
            let untested: Vec<&str> = remaining.untested.iter().map(|s| s.id).collect();
            print_json(&json!({
                "open": open,
                "not_testable": untested,
                "not_looked_at": remaining.left_out,
                "correct_now": remaining.correct_now(),
                "advice": advice,
                "missions": written,
            }))?;
        } else {
            print(&text(&remaining, &advice, &written))?;
        }
        Ok(ExitCode::SUCCESS)
    }

    /// Flight and candidates of a report; the vehicle that it was judged by goes to what is told.
    fn report_of(&self, path: &Path, told: &mut Told) -> anyhow::Result<(Flown, Remaining)> {
        let report = Report::read(path)?;
        if let Some(vehicle) = report.vehicle() {
            told.vehicle = vehicle.clone();
        }
        let log = match &self.log {
            Some(log) => log.clone(),
            None => report.log_beside(path)?,
        };
        let flown = logs::read_flight(&log, self.which.number().or(report.flight()))?;
        if let Some(fault) = flown.faults.first() {
            anyhow::bail!("{}: {fault}", log.display());
        }
        Ok((flown, report.remaining()))
    }

    fn judge_flown(
        &self,
        path: &Path,
        first: &Flown,
        scene: &Scene,
        remaining: &Remaining,
    ) -> anyhow::Result<ExitCode> {
        if remaining.candidates.len() < 2 {
            anyhow::bail!("fewer than two candidates are left: there is nothing to tell apart");
        }
        let second = logs::read(path)?;
        tell(path, second.flight);
        if let Some(fault) = second.faults.first() {
            anyhow::bail!("{}: {fault}", path.display());
        }
        super::gap_session::same_survey(&second, first)?;
        each_once(&[first, &second])?;
        let items = second.mission.clone();
        if items.is_empty() {
            anyhow::bail!("{}: no mission in this log", path.display());
        }
        let nominal = Nominal::of_scene(scene);
        let seen = observed(second, &nominal).observation;
        let seen = seen.map_err(|why| anyhow::anyhow!("{}: {why}", path.display()))?;
        let progress = Progress::new("flying the candidates");
        let after = after_flight(scene, &items, remaining, &seen.statistics, |done, of| {
            progress.at(done, of);
        });
        let Some(mut after) = after else {
            anyhow::bail!("{}: no statistic that all candidates have", path.display())
        };
        after.sort_by(|a, b| b.1.total_cmp(&a.1));
        let before = |id: &str| {
            remaining.candidates.iter().find(|h| h.spec.id == id).map_or(0.0, |h| h.probability)
        };
        if self.json {
            let rows: Vec<_> = after
                .iter()
                .map(|(s, p)| json!({ "id": s.id, "name": s.name, "before": before(s.id), "after": p }))
                .collect();
            print_json(&json!({ "log": path, "candidates": rows }))?;
        } else {
            print("candidate                          before  after\n")?;
            for (spec, p) in &after {
                let name = format!("{} {}", spec.id, spec.name);
                print(&format!("{name:<34} {:>6.2} {p:>6.2}\n", before(spec.id)))?;
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// What a diagnosis left open.
pub(super) fn remaining(d: &Diagnosis) -> Remaining {
    let spec = |id: &str| whole().into_iter().find(|s| s.id == id);
    let candidates = d.attribution.as_ref().map_or(&[][..], |a| &a.candidates[..]);
    // What is not in the library is not told apart by effects of the library.
    let hypotheses = candidates
        .iter()
        .filter(|_| d.outcome.is_explained())
        .filter_map(|c| {
            Some(Hypothesis {
                spec: spec(&c.id)?,
                probability: c.posterior,
                theta: c.theta.clone(),
                theta_90: c.theta_90.clone(),
            })
        })
        .collect();
    let untested: Vec<&'static EffectSpec> =
        d.not_testable.iter().filter_map(|id| spec(id)).collect();
    Remaining::new(hypotheses, &d.set, untested)
}

fn write_missions(
    folder: &Path,
    scene: &Scene,
    advice: &[Advice],
    inputs: &[PathBuf],
) -> anyhow::Result<Vec<PathBuf>> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}", folder.display()))?;
    let mut written = Vec::new();
    for a in
        advice.iter().filter(|a| a.flight && a.not_possible.is_none() && a.value() >= LEAST_WORTH)
    {
        let Some(experiment) = find(&a.experiment) else { continue };
        let Means::Flight(mission) = experiment.means else { continue };
        let Ok(mission) = mission(scene) else { continue };
        let path = folder.join(format!("{}.toml", experiment.id));
        let head =
            format!("# {}\n# {}\n# haltere ctl mission {}.toml\n\n", a.title, a.how, a.experiment);
        haltere_log::written::write(&path, head + &toml::to_string(&mission)?, inputs)?;
        written.push(path);
    }
    Ok(written)
}

fn catalogue() -> String {
    use std::fmt::Write as _;
    let mut out = String::new();
    for e in EXPERIMENTS {
        let kind = if e.is_flight() { "flight" } else { "bench" };
        let sets: Vec<String> =
            e.separates.iter().map(|s| format!("{{{}}}", s.join(" "))).collect();
        let _ = writeln!(out, "{:<18} {kind:<6} {:>5.0} s  {}", e.id, e.cost_s, e.title);
        let _ = writeln!(out, "{:<34} {}", "", e.how);
        if !sets.is_empty() {
            let _ = writeln!(out, "{:<34} {}", "", sets.join(" "));
        }
    }
    out
}

fn text(remaining: &Remaining, advice: &[Advice], written: &[PathBuf]) -> String {
    use std::fmt::Write as _;
    let mut out = String::new();
    if !remaining.candidates.is_empty() {
        let open: Vec<String> = remaining
            .candidates
            .iter()
            .map(|h| format!("{} {} ({:.2})", h.spec.id, h.spec.name, h.probability))
            .collect();
        let _ = writeln!(out, "NOT RULED OUT  {}", open.join(", "));
    }
    if !remaining.untested.is_empty() {
        let ids: Vec<&str> = remaining.untested.iter().map(|s| s.id).collect();
        let _ = writeln!(out, "NOT TESTABLE   {}", ids.join(" "));
    }
    if !remaining.left_out.is_empty() {
        let _ = writeln!(out, "not looked at  {}", remaining.left_out.join(" "));
    }
    let _ = writeln!(
        out,
        "\nP: probability that the right one of these is named, now {:.2}\n",
        remaining.correct_now()
    );
    for a in advice.iter().filter(|a| a.not_possible.is_none()).take(PRINTED) {
        let kind = if a.flight { "fly" } else { "bench" };
        let after = match a.correct_after {
            Some(p) => format!("P {:.2} -> {p:.2}", remaining.correct_now()),
            None => String::new(),
        };
        let _ = writeln!(
            out,
            "{kind:<6} {:<18} {:>5.0} s  {after:<16} {}",
            a.experiment, a.cost_s, a.title
        );
        if let (Some((x, y, d)), Some(gain)) = (&a.hardest, a.gain)
            && gain >= LEAST_WORTH
        {
            let _ = writeln!(out, "{:<33} hardest pair {x} and {y}: {d:.1} sigma apart", "");
        }
        let shown: Vec<String> = a
            .would_show
            .iter()
            .filter(|(_, p)| *p >= 0.5)
            .map(|(id, p)| format!("{id} {p:.2}"))
            .collect();
        if !shown.is_empty() {
            let _ = writeln!(out, "{:<33} would show: {}", "", shown.join(", "));
        }
    }
    for a in advice.iter() {
        if let Some(why) = &a.not_possible {
            let _ = writeln!(out, "not here: {}: {why}", a.experiment);
        }
    }
    for path in written {
        let _ = writeln!(out, "mission: {}", path.display());
    }
    out
}
