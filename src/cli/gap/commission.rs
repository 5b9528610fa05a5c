//! `haltere gap commission`: the vehicle file as accepted flights show the vehicle.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::Context as _;
use clap::Args;
use serde_json::json;

use super::balance::{Import, filled};
use super::options::SceneOptions;
use super::terminal::Terminal;
use crate::cli::output::{print, print_json};
use crate::report::gap::budget::number;
use crate::vehicles;
use haltere_gap::accept::accepted;
use haltere_gap::accept::rewrite_vehicle;
use haltere_gap::commission::{Commissioned, LEAST_FLIGHTS, commission};
use haltere_gap::door::{Audience as _, of_one_mission};
use haltere_log::written;

/// Where the new vehicle file goes unless the user says otherwise.
const OUT: &str = "commissioned.toml";
/// Exit code where the simulator is not this vehicle's yet: its flights cannot be judged by it, as in `gap diagnose`.
const NOT_YET: u8 = 20;

/// Finds the constants of a vehicle file with which the simulator flies as accepted flights were flown.
///
/// Each constant has a 90 % interval; what the flights do not show stays as the file says. The new file is written beside yours; it
/// says how near the simulator now comes to accepted flights that it was not fitted to. Exit code 20: it does not come near enough.
#[derive(Debug, Args)]
pub struct Commission {
    /// Accepted flights of one mission, eight or more: logs, or folders of logs.
    #[arg(required = true, value_name = "LOG|FOLDER")]
    references: Vec<PathBuf>,
    /// The flights are of another program: what they are. --vehicle is then the file of a quadrotor, whose thrust is filled in from what
    /// three flights or more held in hover (docs/IMPORT.md).
    #[arg(long, value_name = "KIND", requires = "vehicle")]
    import: Option<Import>,
    /// With `--import csv`: which column of the tables is what.
    #[arg(long, value_name = "FILE.toml", requires = "import")]
    columns: Option<PathBuf>,
    #[command(flatten)]
    told: SceneOptions,
    /// The new vehicle file; commissioned.toml by default, which must not be there yet.
    #[arg(long, value_name = "FILE", conflicts_with = "write")]
    out: Option<PathBuf>,
    /// Writes into the file of --vehicle instead; `haltere gap undo FILE` takes it back.
    #[arg(long, requires = "vehicle")]
    write: bool,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

impl Commission {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let of_user = self.told.vehicle_file();
        let inputs: Vec<&PathBuf> = of_user.into_iter().chain(&self.references).collect();
        let out = match (self.write, of_user) {
            (true, Some(file)) if !file.is_file() => anyhow::bail!(
                "--write: {} is no file; a built-in vehicle is not changed: leave --write out",
                file.display()
            ),
            (true, Some(file)) => file.clone(),
            _ => {
                let out = self.out.clone().unwrap_or_else(|| OUT.into());
                let there = written::look(&out, &inputs)?;
                if there.is_some() && self.out.is_none() {
                    anyhow::bail!("{OUT}: is there already; name another file with --out");
                }
                out
            }
        };
        if let (Some(import), Some(vehicle)) = (self.import, of_user) {
            let source = import.source(self.columns.as_deref())?;
            let (new, filled) = filled(&source, &self.references, vehicle)?;
            let said = self.written(
                &out,
                &vehicles::rotorcraft_text(vehicle).unwrap_or_default(),
                Some(new),
                filled.flights,
            )?;
            if self.json {
                print_json(&json!({ "filled": filled, "file": out }))?;
            } else {
                print(&format!("{}{said}\n", filled.text()))?;
            }
            return Ok(ExitCode::SUCCESS);
        }
        let text = of_user.map_or(Ok(String::new()), |file| vehicles::read(file))?;
        let told = self.told.told()?;
        let audience = Terminal::default();
        let flights = of_one_mission(&self.references, &audience)?;
        let Some(first) = flights.first().filter(|_| flights.len() >= LEAST_FLIGHTS) else {
            anyhow::bail!(
                "{} accepted flights, at least {LEAST_FLIGHTS} needed, 20 are better",
                flights.len()
            );
        };
        let scene = first.scene(&told).for_bank(&first.mission);
        let started = Instant::now();
        let found = commission(&scene, &first.mission, &flights, |done, of| {
            audience.at("commissioning", done, of)
        })?;
        let seconds = started.elapsed().as_secs_f64();
        let new =
            rewrite_vehicle(&text, &found.vehicle).with_context(|| out.display().to_string())?;
        let said = self.written(&out, &text, new, found.flights)?;
        if self.json {
            print_json(
                &json!({ "commissioned": found, "failed": found.why_not_yet(), "seconds": seconds, "file": out }),
            )?;
        } else {
            print(&report(&found, seconds))?;
            print(&format!("{said}\n"))?;
        }
        Ok(if found.why_not_yet().is_some() { ExitCode::from(NOT_YET) } else { ExitCode::SUCCESS })
    }

    /// Writes the new text where it is asked for, and says where.
    fn written(
        &self,
        out: &Path,
        text: &str,
        new: Option<String>,
        flights: usize,
    ) -> anyhow::Result<String> {
        let Some(new) = new else {
            return Ok("nothing written: flights show no constant to be another one".to_owned());
        };
        if self.write {
            accepted::write(
                out,
                Some(text),
                &new,
                &format!("commissioning from {flights} flights"),
            )?;
            return Ok(format!(
                "written into {}; `haltere gap undo {0}` takes it back",
                out.display()
            ));
        }
        let inputs: Vec<&PathBuf> =
            self.told.vehicle_file().into_iter().chain(&self.references).collect();
        written::write(out, new, &inputs)?;
        Ok(format!("written: {}", out.display()))
    }
}

fn report(found: &Commissioned, seconds: f64) -> String {
    let mut out = String::new();
    let _ = writeln!(
        out,
        "COMMISSIONED from {} accepted flights, {} simulated ones, {seconds:.0} s",
        found.flights, found.simulated
    );
    for f in found.constants.iter().filter(|f| f.shown) {
        let far = if f.moved_far() { ", more than its prior's sigma" } else { "" };
        let _ = writeln!(
            out,
            "CONSTANT    {} = {} (90 %: {} to {}), file {}, {:+.1} sigma{far}",
            f.key,
            number(f.value),
            number(f.low),
            number(f.high),
            number(f.file),
            f.sigmas
        );
    }
    let kept: Vec<&str> = found.constants.iter().filter(|f| !f.shown).map(|f| f.key).collect();
    let _ = writeln!(out, "AS THE FILE {}: these flights do not show them", kept.join(", "));
    let _ = writeln!(out, "HELD OUT    block          before   after   limit  healthy    own");
    for n in found.blocks.iter().chain(std::iter::once(&found.whole)) {
        // Of a file that is not flown there is no before.
        let before = if n.before.is_nan() { "-".to_owned() } else { format!("{:.2}", n.before) };
        let _ = writeln!(
            out,
            "            {:<14} {:>6}  {:>6.2}  {:>6.2}   {:>6.2} {:>6.2}",
            n.block, before, n.after, n.limit, n.healthy, n.own
        );
    }
    let _ = match found.why_not_yet() {
        Some(why) => writeln!(out, "NOT YET     {why}"),
        None => {
            writeln!(out, "VERDICT     the simulator can be judged by: every block keeps its limit")
        }
    };
    out
}
