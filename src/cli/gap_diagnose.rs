//! `haltere gap diagnose`: one flight against the nominal simulator.

use std::ffi::OsString;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::{Args, Parser};

use super::gap::{BankOptions, SceneOptions};
use super::gap_advise::remaining;
use super::gap_balance::{self, Import};
use super::gap_budget;
use super::gap_references::References;
use super::gap_session::{Opened, Session, open, same_flight};
use super::which_flight::WhichFlight;
use super::{print, print_json};
use crate::progress::{self, Progress};
use crate::report::{gap as page, truth};
use haltere_gap::advice::{Effort, advise};
use haltere_gap::bank::archive::Shelf;
use haltere_gap::bank::workshop;
use haltere_gap::commission::budget::budget;
use haltere_gap::diagnosis::{Advised, Diagnosis, Part, ShrinkResult};
use haltere_gap::flight::beside_truth::{BesideTruth, TruePoint, beside_truth};
use haltere_gap::flight::seal::digest_of;
use haltere_gap::outcome::Ending;
use haltere_gap::picture::details::details;
use haltere_gap::picture::picture;
use haltere_gap::scene::Scene;
use haltere_gap::shrink::held_out::{Explanation, measure};
use haltere_log::written;
use haltere_model::effects::EffectSpec;

/// Says where a flight differs from the nominal simulator, which effect causes it, and how far the
/// gap shrinks once that effect is added.
///
/// The first log is diagnosed; the others, on the same or another mission, are flights that the fit
/// does not see and that the shrink is measured on.
///
/// A log of another build is judged too: where this one would have sent the board other setpoints, those recorded
/// count, and the report says so with the largest difference.
///
/// Without accepted flights a gap that no effect explains is the vehicle file's to begin with: then the answer is a budget of its
/// constants, as of `haltere gap budget`.
///
/// Flights of other vehicles and programs are judged without a simulator (`--import`, docs/IMPORT.md): what the motors of a quadrotor
/// held in hover, against accepted flights of it.
///
/// Exit codes: 0 no gap, 10 named, 11 one of a set, 12 several, 13 not in the library, 14 named with
/// a remainder, 15 a budget, 20 not testable, 30 log or replay fault.
#[derive(Debug, Args)]
pub(super) struct Diagnose {
    /// Flight logs of the companion.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// The flights are of another program: what they are. --vehicle is then the file of a quadrotor, or the name of one.
    #[arg(long, value_name = "KIND", requires_all = ["vehicle", "reference"])]
    #[arg(conflicts_with_all = ["truth", "report", "held_out_reference", "room"])]
    import: Option<Import>,
    /// With `--import csv`: which column of the tables is what (docs/IMPORT.md).
    #[arg(long, value_name = "FILE.toml", requires = "import")]
    columns: Option<PathBuf>,
    #[command(flatten)]
    which: WhichFlight,
    #[command(flatten)]
    references: References,
    #[command(flatten)]
    told: SceneOptions,
    #[command(flatten)]
    options: BankOptions,
    /// Says how far the estimate lay from the truth: motion capture in the log, or a truth file of the flight
    /// (`haltere-sim serve --truth`). Nothing else needs it.
    #[arg(long, value_name = "FILE", num_args = 0..=1)]
    truth: Option<Option<PathBuf>>,
    /// Writes the report as one HTML page, and the same as JSON beside it.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Leaves the advice out of the report; it takes about as long as everything else.
    #[arg(long)]
    without_advice: bool,
    /// A remark that the report is to carry, for programs that call this one.
    #[arg(long, value_name = "TEXT", hide = true)]
    remark: Vec<String>,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

/// What this command finds for these arguments, its reports written and nothing printed: for programs that fly what they
/// have diagnosed.
pub fn diagnose<I, T>(args: I) -> anyhow::Result<Diagnosis>
where
    I: IntoIterator<Item = T>,
    T: Into<OsString> + Clone,
{
    #[derive(Parser)]
    #[command(no_binary_name = true)]
    struct Alone {
        #[command(flatten)]
        diagnose: Diagnose,
    }
    let Alone { diagnose } = Alone::try_parse_from(args)?;
    let diagnosis = diagnose.diagnosis()?;
    diagnose.write(&diagnosis)?;
    Ok(diagnosis)
}

/// What a diagnosis does, with its usual length on two cores, s.
const STAGES: [(&str, f64); 9] = [
    ("reference flights", 3.0),
    ("commissioning", 150.0),
    ("bank", 230.0),
    ("learning the bank", 20.0),
    ("budget", 120.0),
    ("sizes", 40.0),
    ("shrink", 30.0),
    ("cells", 5.0),
    ("advice", 60.0),
];

impl Diagnose {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        if let (Some(import), Some(vehicle)) = (self.import, self.told.vehicle_file()) {
            let source = import.source(self.columns.as_deref())?;
            let references = self.references.files()?;
            return gap_balance::run(&source, &self.logs, &references, vehicle, self.json);
        }
        let diagnosis = self.diagnosis()?;
        self.write(&diagnosis)?;
        if self.json {
            print_json(&diagnosis)?;
        } else {
            print(&text(&diagnosis))?;
        }
        Ok(ExitCode::from(diagnosis.exit_code()))
    }

    fn diagnosis(&self) -> anyhow::Result<Diagnosis> {
        self.look()?;
        let is_due = |stage: &str| match stage {
            "sizes" | "shrink" => self.logs.len() > 1,
            "cells" => self.report.is_some() || self.json,
            "advice" => (self.report.is_some() || self.json) && !self.without_advice,
            "reference flights" | "commissioning" => self.references.any(),
            "budget" => !self.references.any(),
            _ => true,
        };
        let usual = |(name, usual_s): (&'static str, f64)| match name {
            "bank" | "learning the bank" => (name, usual_s * self.options.share()),
            _ => (name, usual_s),
        };
        let due: Vec<_> = STAGES.into_iter().filter(|(name, _)| is_due(name)).map(usual).collect();
        progress::stages(&due, workshop::costs_file());
        let [first, others @ ..] = &self.logs[..] else { anyhow::bail!("no log") };
        // Before anything long: files that do not hold what they should.
        let truth = self.truth_file()?;
        let session =
            match open(first, self.which, others, &self.references, &self.told, &self.options)? {
                Opened::Ready(session) => session,
                Opened::Fault(mut diagnosis) => {
                    diagnosis.made_with.log_sha256 = hash_of(first);
                    return Ok(*diagnosis);
                }
            };
        let truth = self.beside_truth(&session, truth)?;
        let mut diagnosis = session.judge();
        diagnosis.made_with.log_sha256 = hash_of(first);
        diagnosis.truth = truth;
        if diagnosis.wants_budget {
            budgeted(&session, &mut diagnosis);
        }
        if !others.is_empty() {
            self.shrink(&session, &mut diagnosis)?;
        }
        if self.report.is_some() || self.json {
            self.draw(&session, &mut diagnosis);
        }
        diagnosis.remarks.extend(self.remark.iter().cloned());
        Ok(diagnosis)
    }

    /// Truth of a file, and its name.
    fn truth_file(&self) -> anyhow::Result<Option<(Vec<TruePoint>, String)>> {
        let Some(Some(path)) = &self.truth else { return Ok(None) };
        let name = || path.display().to_string();
        let file = File::open(path).with_context(name)?;
        let rows = truth::read(BufReader::new(file)).with_context(name)?;
        Ok(Some((rows.iter().map(|row| (row.at, row.pos_E_m)).collect(), name())))
    }

    /// The estimate beside the truth, where that is asked for.
    fn beside_truth(
        &self,
        session: &Session,
        file: Option<(Vec<TruePoint>, String)>,
    ) -> anyhow::Result<Option<BesideTruth>> {
        let flown = &session.seen.flown;
        let (points, source) = match (&self.truth, file) {
            (None, _) => return Ok(None),
            (Some(_), Some(file)) => file,
            (Some(_), None) => {
                let captured = flown.trace.references.iter();
                let points = captured.map(|r| (r.valid_at, r.pos_E_m)).collect();
                (points, format!("motion capture in {}", flown.path.display()))
            }
        };
        Ok(Some(beside_truth(&flown.trace, &points, &source)?))
    }

    /// What the page shows beyond the verdict.
    fn draw(&self, session: &Session, diagnosis: &mut Diagnosis) {
        let flown = &session.seen.flown;
        if let Ok(own) = details(&flown.trace, &session.workshop.nominal) {
            let named = explanation(diagnosis);
            let effects: Vec<_> = named
                .iter()
                .flat_map(|n| &n.effects)
                .map(|(spec, theta)| (*spec, &theta[..]))
                .collect();
            let progress = Progress::new("cells");
            diagnosis.picture = Some(picture(
                &session.scene,
                &flown.mission,
                &own,
                &session.reference_details,
                &effects,
                |done, of| progress.at(done, of),
            ));
        }
        if self.without_advice || diagnosis.attribution.is_none() {
            return;
        }
        let open = remaining(diagnosis);
        let experiments = if open.is_settled() {
            Vec::new()
        } else {
            let progress = Progress::new("advice");
            let shelf = Shelf::in_folder(&self.options.folder());
            let tell = |done, of| progress.at(done, of);
            advise(&session.scene, &open, Effort::Listed, &shelf, tell)
        };
        diagnosis.advice = Some(Advised {
            open: open.candidates.iter().map(|h| (h.spec.id.to_owned(), h.probability)).collect(),
            correct_now: open.correct_now(),
            left_out: open.left_out.clone(),
            experiments,
        });
    }

    /// What is read: nothing is written over it. References are logs, which are safe by themselves.
    fn inputs(&self) -> Vec<&PathBuf> {
        let truth = self.truth.iter().flatten();
        self.logs.iter().chain(truth).chain(self.told.vehicle_file()).collect()
    }

    /// Minutes before it is due: a report that may not be written.
    fn look(&self) -> anyhow::Result<()> {
        let Some(path) = &self.report else { return Ok(()) };
        let json = path.with_extension("json");
        if json == *path {
            anyhow::bail!(
                "--report {}: the page; the same as JSON is written beside it under this name: let it end in .html",
                path.display()
            );
        }
        let inputs = self.inputs();
        written::look(path, &inputs)?;
        written::look(&json, &inputs)?;
        Ok(())
    }

    fn write(&self, diagnosis: &Diagnosis) -> anyhow::Result<()> {
        if let Some(path) = &self.report {
            let inputs = self.inputs();
            written::write(path, page::render(diagnosis), &inputs)?;
            let json = serde_json::to_string_pretty(diagnosis)?;
            written::write(&path.with_extension("json"), json, &inputs)?;
        }
        Ok(())
    }

    fn shrink(&self, session: &Session, diagnosis: &mut Diagnosis) -> anyhow::Result<()> {
        let (flights, accepted) = (&session.others, &session.held_out_references);
        for flown in flights {
            if let Some(fault) = flown.faults.first() {
                anyhow::bail!("{}: no held-out flight: {fault}", flown.path.display());
            }
        }
        let spec = |id: &str| session.workshop.spec(id);
        let suspect = || {
            let first = diagnosis.suspect()?;
            let effects = vec![(spec(&first.id)?, first.theta.clone())];
            Some(Explanation { name: first.id.clone(), effects })
        };
        let Some(mut named) = explanation(diagnosis).or_else(suspect) else { return Ok(()) };
        let mut rivals: Vec<Explanation> = Vec::new();
        if let Some(attribution) = &diagnosis.attribution {
            rivals.extend(
                attribution
                    .candidates
                    .iter()
                    .filter(|c| {
                        !diagnosis.set.contains(&c.id) && c.id != named.name && !c.theta.is_empty()
                    })
                    .take(RIVALS)
                    .filter_map(|c| {
                        let effects = vec![(spec(&c.id)?, c.theta.clone())];
                        Some(Explanation { name: c.id.clone(), effects })
                    }),
            );
            // More freedom than the named one has: what could be reached.
            rivals.extend(attribution.pairs.first().filter(|_| named.effects.len() == 1).and_then(
                |pair| {
                    let [a, b] = [spec(&pair.ids[0])?, spec(&pair.ids[1])?];
                    let effects = vec![(a, pair.theta[0].clone()), (b, pair.theta[1].clone())];
                    Some(Explanation { name: pair.ids.join(" + "), effects })
                },
            ));
        }
        let all = std::iter::once(&mut named).chain(&mut rivals);
        session.resize(&mut all.collect::<Vec<_>>());
        let progress = Progress::new("shrink");
        let r = measure(flights, accepted, &session.told, &named, &rivals, |done, of| {
            progress.at(done, of);
        })?;
        for (k, rung) in diagnosis.ladder.iter_mut().enumerate() {
            rung.held_out = match k {
                0 => Some(r.whole.before),
                1 if diagnosis.set.first().is_some_and(|id| rung.name == format!("+ {id}")) => {
                    Some(r.whole.after)
                }
                _ => None,
            };
        }
        diagnosis.shrink = Some(ShrinkResult {
            value: r.whole.value,
            low: r.whole.interval.map(|i| i[0]),
            high: r.whole.interval.map(|i| i[1]),
            floor: r.whole.floor,
            before: r.whole.before,
            after: r.whole.after,
            noise: r.whole.noise,
            attainable: r.attainable,
            attained_by: r.attained_by,
            efficiency: r.efficiency,
            channels: r.channels,
            others: r.wrong,
            wrong: r.wrong_median,
            references: accepted.len(),
        });
        diagnosis.weigh_held_out(&session.workshop);
        Ok(())
    }
}

/// Asks which constants of the vehicle file differ, by all flights of the mission.
fn budgeted(session: &Session, diagnosis: &mut Diagnosis) {
    let own = &session.seen.flown;
    let fellows = session.others.iter().filter(|flown| same_flight(own, flown).is_ok());
    let flights: Vec<_> = std::iter::once(own).chain(fellows).collect();
    let progress = Progress::new("budget");
    // What differs is told beside the file, also where that is not what flies.
    let scene = Scene { vehicle: session.file.clone(), ..session.scene.clone() };
    let found = budget(&scene, &session.workshop.items, &flights, |done, of| {
        progress.at(done, of);
    });
    match found {
        Ok(found) => diagnosis.budgeted(found),
        Err(why) => diagnosis.remarks.push(format!("no budget: {why}")),
    }
}

/// SHA-256 of a file; empty where it cannot be read, which was said before.
fn hash_of(path: &Path) -> String {
    haltere_log::intake::open(path).and_then(digest_of).unwrap_or_default()
}

/// What is named as one explanation: set members are alternatives, and the first stands for them;
/// several act together.
fn explanation(diagnosis: &Diagnosis) -> Option<Explanation> {
    let together = if diagnosis.outcome == Ending::Several { diagnosis.effects.len() } else { 1 };
    let whole = haltere_gap::bank::library::whole();
    let spec =
        |id: &str| -> Option<&'static EffectSpec> { whole.iter().copied().find(|s| s.id == id) };
    let effects: Vec<(&'static EffectSpec, Vec<f64>)> = diagnosis
        .effects
        .iter()
        .take(together)
        .filter_map(|e| Some((spec(&e.id)?, e.parameters.iter().map(|p| p.value).collect())))
        .collect();
    let name = effects.iter().map(|(s, _)| s.id).collect::<Vec<_>>().join(" + ");
    (!effects.is_empty()).then_some(Explanation { name, effects })
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
    let flight = d.flight.filter(|flight| flight.of > 1);
    let flight = flight.map_or(String::new(), |flight| format!(", {flight},"));
    let _ = writeln!(out, "GAP REPORT  {}{flight} against {against}, replay {}", d.log, d.replay);
    let _ = writeln!(out, "VERDICT     {}", d.verdict);
    if d.references == 0 {
        let _ = writeln!(
            out,
            "            no accepted flights: what is usual for this vehicle is not known (--reference)"
        );
    }
    for fault in d.faults.iter().chain(&d.remarks) {
        let _ = writeln!(out, "            {fault}");
    }
    if let Some(explained) = &d.explained {
        let _ = writeln!(out, "EXPLAINED   {}", explained.words());
    }
    for line in d.truth.iter().flat_map(BesideTruth::words) {
        let _ = writeln!(out, "TRUTH       {line}");
    }
    out.push_str(&d.budget.as_ref().map_or(String::new(), gap_budget::parts));
    for place in &d.places {
        let anchor = place.anchor.map_or(String::new(), |a| format!(", anchor {a}"));
        let (word, likely) = match place.part {
            Part::Cause => ("WHERE  ", format!(", probability {:.2}", place.probability)),
            Part::Consequence => ("FOLLOWS", String::new()),
        };
        let _ = writeln!(
            out,
            "{word}     {} ({:.0} sigma{likely}{anchor}), loudest {}",
            place.block, place.score, place.regime
        );
    }
    if !d.exonerated.is_empty() {
        let _ = writeln!(out, "NOT THERE   {}: replayed bit for bit", d.exonerated.join(", "));
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
    if let Some(p) = &d.picture {
        let _ = writeln!(out, "SINCE       {}", p.onset.words());
    }
    if let Some(best) = d.advice.as_ref().and_then(|a| a.experiments.first()) {
        let after = best.correct_after.map_or(String::new(), |p| {
            format!(": P {:.2} -> {p:.2}", d.advice.as_ref().map_or(0.0, |a| a.correct_now))
        });
        let _ = writeln!(
            out,
            "NEXT        {} ({:.0} s){after}; `haltere gap advise` has more",
            best.title, best.cost_s
        );
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
