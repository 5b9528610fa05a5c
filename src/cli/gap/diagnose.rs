//! `haltere gap diagnose`: one flight against the nominal simulator.

use std::ffi::OsString;
use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::{Args, Parser};

use super::balance::{self, Import};
use super::budget;
use super::options::{BankOptions, ReferenceOptions, SceneOptions, simulator};
use super::terminal::Terminal;
use crate::cli::output::{print, print_json};
use crate::cli::which_flight::WhichFlight;
use crate::progress;
use crate::report::{gap as page, truth};
use haltere_gap::bank::workshop;
use haltere_gap::diagnosis::{Diagnosis, Part, ShrinkResult};
use haltere_gap::door::{self, Flights, Options, Truth};
use haltere_gap::flight::beside_truth::BesideTruth;
use haltere_log::written;

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
pub struct Diagnose {
    /// Flight logs of the companion.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// The flights are of another program: what they are. --vehicle is then the file of a quadrotor, or the name of one.
    #[arg(long, value_name = "KIND", requires_all = ["vehicle", "reference"])]
    #[arg(conflicts_with_all = ["truth", "held_out_reference", "room"])]
    import: Option<Import>,
    /// With `--import csv`: which column of the tables is what (docs/IMPORT.md).
    #[arg(long, value_name = "FILE.toml", requires = "import")]
    columns: Option<PathBuf>,
    /// With --import: a simulator of one's own flies what causes do, in place of a formula: a command that answers requests, a line of JSON
    /// each (docs/INTERFACES.md, section 6).
    #[arg(long, value_name = "COMMAND", requires = "import")]
    simulator: Option<String>,
    #[command(flatten)]
    which: WhichFlight,
    #[command(flatten)]
    references: ReferenceOptions,
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
    diagnose.write_all(&diagnosis)?;
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
            self.look(&references)?;
            let simulator = self.simulator.as_deref();
            let found = balance::judge(&source, &self.logs, &references, vehicle, simulator)?;
            let [text, json, page] = found.printed()?;
            self.write(page, json.clone(), &references)?;
            print(&if self.json { json + "\n" } else { text })?;
            return Ok(ExitCode::from(found.exit_code()));
        }
        let diagnosis = self.diagnosis()?;
        self.write_all(&diagnosis)?;
        if self.json {
            print_json(&diagnosis)?;
        } else {
            print(&text(&diagnosis))?;
        }
        Ok(ExitCode::from(diagnosis.exit_code()))
    }

    fn diagnosis(&self) -> anyhow::Result<Diagnosis> {
        self.look(&[])?;
        let references = self.references.references();
        let picture = self.report.is_some() || self.json;
        let advice = picture && !self.without_advice;
        let is_due = |stage: &str| match stage {
            "sizes" | "shrink" => self.logs.len() > 1,
            "cells" => picture,
            "advice" => advice,
            "reference flights" | "commissioning" => references.any(),
            "budget" => !references.any(),
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
        let truth = self.truth()?;
        let flights =
            Flights { log: first.clone(), flight: self.which.number(), held_out: others.to_vec() };
        let simulator = simulator(&self.told, &self.options)?;
        let audience = &Terminal::default();
        let options = Options { picture, advice, truth: truth.as_ref(), audience };
        let mut diagnosis = door::diagnose(&flights, &simulator, &references, &options)?;
        diagnosis.remarks.extend(self.remark.iter().cloned());
        Ok(diagnosis)
    }

    /// Where the truth stands, if it is asked for.
    fn truth(&self) -> anyhow::Result<Option<Truth>> {
        let Some(asked) = &self.truth else { return Ok(None) };
        let Some(path) = asked else { return Ok(Some(Truth::Captured)) };
        let name = || path.display().to_string();
        let file = File::open(path).with_context(name)?;
        let rows = truth::read(BufReader::new(file)).with_context(name)?;
        let points = rows.iter().map(|row| (row.at, row.pos_E_m)).collect();
        Ok(Some(Truth::File(points, name())))
    }

    /// What is read: nothing is written over it. References that are logs of ours are safe by themselves.
    fn inputs<'a>(&'a self, references: &'a [PathBuf]) -> Vec<&'a PathBuf> {
        let truth = self.truth.iter().flatten();
        let others = references.iter().chain(truth).chain(&self.columns);
        self.logs.iter().chain(others).chain(self.told.vehicle_file()).collect()
    }

    /// Minutes before it is due: a report that may not be written.
    fn look(&self, references: &[PathBuf]) -> anyhow::Result<()> {
        let Some(path) = &self.report else { return Ok(()) };
        let json = path.with_extension("json");
        if json == *path {
            anyhow::bail!(
                "--report {}: the page; the same as JSON is written beside it under this name: let it end in .html",
                path.display()
            );
        }
        let inputs = self.inputs(references);
        written::look(path, &inputs)?;
        written::look(&json, &inputs)?;
        Ok(())
    }

    fn write_all(&self, diagnosis: &Diagnosis) -> anyhow::Result<()> {
        if self.report.is_none() {
            return Ok(());
        }
        self.write(page::render(diagnosis), serde_json::to_string_pretty(diagnosis)?, &[])
    }

    fn write(&self, page: String, json: String, references: &[PathBuf]) -> anyhow::Result<()> {
        let Some(path) = &self.report else { return Ok(()) };
        let inputs = self.inputs(references);
        written::write(path, page, &inputs)?;
        written::write(&path.with_extension("json"), json, &inputs)?;
        Ok(())
    }
}

fn text(d: &Diagnosis) -> String {
    use std::fmt::Write;
    let mut out = String::new();
    let _ = writeln!(out, "{}\n\nHow it was found:", door::in_words(d));
    let _ = writeln!(out, "GAP REPORT  {}", d.compared());
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
    if let Some(balance) = &d.balance {
        let _ = writeln!(out, "BALANCE     {}", balance.words);
    }
    for line in d.truth.iter().flat_map(BesideTruth::words) {
        let _ = writeln!(out, "TRUTH       {line}");
    }
    out.push_str(&d.budget.as_ref().map_or(String::new(), budget::parts));
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
        let _ = writeln!(out, "NOT CAUSE   {}: replayed bit for bit", d.exonerated.join(", "));
    }
    for effect in &d.effects {
        let _ = writeln!(
            out,
            "EFFECT      {} {}, probability {:.2}",
            effect.id, effect.name, effect.probability
        );
        for p in &effect.parameters {
            let found = p.chosen.clone().unwrap_or_else(|| {
                let (value, unit) = (p.value, &p.unit);
                format!("{} = {value:.4} {unit} (90 %: {:.4} to {:.4})", p.name, p.low, p.high)
            });
            let _ = writeln!(out, "              {found}");
        }
    }
    let shrink = d.shrink.as_ref().map(ShrinkResult::words);
    let shrink = shrink.unwrap_or_else(|| "not measured: needs a held-out flight".to_owned());
    let _ = writeln!(out, "SHRINK      {shrink}");
    if let Some(p) = d.picture.as_ref().filter(|_| d.outcome.is_gap()) {
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
