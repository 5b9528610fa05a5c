//! `haltere gap shrink`: one effect added, the gap before and after on other flights.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use serde_json::json;

use super::options::{BankOptions, ReferenceOptions, SceneOptions, simulator};
use super::terminal::Terminal;
use crate::cli::output::{print, print_json};
use crate::cli::which_flight::{WhichFlight, tell};
use haltere_gap::bank::archive::Shelf;
use haltere_gap::bank::library::{self, whole};
use haltere_gap::diagnosis::observed;
use haltere_gap::door::{self, Audience as _, Flights, Opened, Session, each_once, open};
use haltere_gap::flight::logs::{self, Flown};
use haltere_gap::said::chosen;
use haltere_gap::scene::Told;
use haltere_gap::shrink::held_out::{Explanation, Measured, SHRINK_FLIGHTS, measure};
use haltere_model::effects::{EffectSpec, Kind};

/// Adds one effect to the simulator and says how far the gap closes on other flights, closed loop.
///
/// The effect is fitted on the first log, or has the values that are given; it is judged on the other logs,
/// which the fit does not see. Beside it stand the floor (two flights of the same model), the best that any
/// explanation reached, and effects that are not the cause as control.
#[derive(Debug, Args)]
pub struct Shrink {
    /// The effect, with values where it is not to be fitted: `P1`, `P1=0.08`, `U2=bias:0.2,anchor:3`.
    #[arg(long, value_name = "ID[=VALUE,…]")]
    effect: String,
    /// Log to fit on (only with an effect without values), then logs to judge on.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    #[command(flatten)]
    which: WhichFlight,
    #[command(flatten)]
    references: ReferenceOptions,
    #[command(flatten)]
    told: SceneOptions,
    #[command(flatten)]
    options: BankOptions,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

/// Other effects that are flown as control.
const WRONG: usize = 6;

impl Shrink {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let (spec, given) =
            library::asked(&self.effect).map_err(|why| anyhow::anyhow!("--effect {why}"))?;
        let explain =
            |theta| Explanation { name: spec.id.to_owned(), effects: vec![(spec, theta)] };
        let accepted;
        let mut told = self.told.told()?;
        let references = self.references.references();
        let audience = Terminal::default();
        let (asked, others, judged_on) = match given {
            Some(theta) => {
                let flown = self.judged(&self.logs)?;
                accepted = door::read(&references, None, &flown, &audience)?.held_out;
                (explain(theta), controls(spec), flown)
            }
            None => {
                let [first, rest @ ..] = &self.logs[..] else { anyhow::bail!("no log") };
                if rest.is_empty() {
                    anyhow::bail!(
                        "{}: is the flight to fit on; name at least one more to judge on, or give the effect \
                         values ({}=…)",
                        first.display(),
                        spec.id
                    );
                }
                let flights = Flights {
                    log: first.clone(),
                    flight: self.which.number(),
                    held_out: rest.to_vec(),
                };
                let simulator = simulator(&self.told, &self.options)?;
                let session = match open(&flights, &simulator, &references, &audience)? {
                    Opened::Ready(session) => session,
                    Opened::Fault(d) => anyhow::bail!("{}: {}", d.log, d.verdict),
                };
                let (theta, mut others) = fitted(&session, spec)?;
                let mut own = explain(theta);
                let all = std::iter::once(&mut own).chain(&mut others);
                session.resize(&mut all.collect::<Vec<_>>(), &audience);
                for flown in &session.others {
                    sound(flown, &session.told)?;
                }
                told = session.told;
                accepted = session.held_out_references;
                (own, others, session.others)
            }
        };
        // No parameters: the effect helps at no size.
        let theta = asked.effects.first().map_or(&[][..], |(_, theta)| theta);
        let shelf = Shelf::in_folder(&self.options.folder());
        let result = measure(&judged_on, &accepted, &told, &asked, &others, &shelf, |done, of| {
            audience.at("shrink", done, of);
        })?;
        if self.json {
            print_json(&json!({
                "effect": spec.id,
                "parameters": parameters(spec, theta),
                "fitted_on": self.logs.first().filter(|_| self.logs.len() > judged_on.len()),
                "judged_on": judged_on.iter().map(|f| &f.path).collect::<Vec<_>>(),
                "references": accepted.len(),
                "simulated_flights": SHRINK_FLIGHTS,
                "shrink": result,
            }))?;
        } else {
            print(&text(spec, theta, &result, &judged_on, accepted.len()))?;
        }
        Ok(ExitCode::SUCCESS)
    }

    fn judged(&self, paths: &[PathBuf]) -> anyhow::Result<Vec<Flown>> {
        let told = self.told.told()?;
        let mut flights = Vec::new();
        for (place, path) in paths.iter().enumerate() {
            let flown = logs::read_flight(path, self.which.of_log(place))?;
            tell(path, flown.flight);
            sound(&flown, &told)?;
            flights.push(flown);
        }
        each_once(&flights.iter().collect::<Vec<_>>())?;
        Ok(flights)
    }
}

/// Whether a flight can be judged on.
fn sound(flown: &Flown, told: &Told) -> anyhow::Result<()> {
    let path = &flown.path;
    if let Some(fault) = flown.faults.first() {
        anyhow::bail!("{}: {fault}", path.display());
    }
    if flown.mission.is_empty() {
        anyhow::bail!("{}: no mission in this log", path.display());
    }
    let nominal = haltere_gap::nominal::Nominal::of_scene(&flown.scene(told));
    if let Err(why) = observed(flown.clone(), &nominal).observation {
        anyhow::bail!("{}: {why}", path.display());
    }
    Ok(())
}

/// The effect as fitted on the first log, and other candidates as fitted there.
fn fitted(
    session: &Session,
    spec: &'static EffectSpec,
) -> anyhow::Result<(Vec<f64>, Vec<Explanation>)> {
    let diagnosis = session.judge();
    eprintln!("{}", diagnosis.verdict);
    let Some(attribution) = &diagnosis.attribution else {
        anyhow::bail!("{}: {}", diagnosis.log, diagnosis.verdict)
    };
    let own = attribution.candidates.iter().find(|c| c.id == spec.id);
    let Some(own) = own.filter(|c| c.theta.len() == spec.parameters.len()) else {
        anyhow::bail!(
            "{}: not in the library of this bank; give it values ({}=…)",
            spec.id,
            spec.id
        )
    };
    let of = |id: &str| whole().into_iter().find(|s| s.id == id);
    let mut others: Vec<Explanation> = attribution
        .candidates
        .iter()
        .filter(|c| c.id != spec.id)
        .take(WRONG)
        .filter_map(|c| {
            Some(Explanation { name: c.id.clone(), effects: vec![(of(&c.id)?, c.theta.clone())] })
        })
        .collect();
    // The best pair stands for a model with more freedom.
    if let Some(pair) = attribution.pairs.first()
        && let (Some(a), Some(b)) = (of(&pair.ids[0]), of(&pair.ids[1]))
    {
        let effects = vec![(a, pair.theta[0].clone()), (b, pair.theta[1].clone())];
        others.push(Explanation { name: pair.ids.join(" + "), effects });
    }
    Ok((own.theta.clone(), others))
}

/// Effects of other blocks at their defaults, where nothing was fitted.
fn controls(spec: &EffectSpec) -> Vec<Explanation> {
    let mut blocks = vec![spec.block];
    haltere_gap::bank::library::standard()
        .into_iter()
        .filter(|s| {
            let new = !blocks.contains(&s.block);
            blocks.push(s.block);
            new
        })
        .take(WRONG)
        .map(|s| Explanation {
            name: s.id.to_owned(),
            effects: vec![(s, s.parameters.iter().map(|p| p.default).collect())],
        })
        .collect()
}

fn parameters(spec: &EffectSpec, theta: &[f64]) -> serde_json::Value {
    spec.parameters
        .iter()
        .zip(theta)
        .map(|(p, v)| json!({ "name": p.name, "value": v, "unit": p.unit }))
        .collect()
}

fn text(
    spec: &EffectSpec,
    theta: &[f64],
    r: &Measured,
    judged_on: &[Flown],
    references: usize,
) -> String {
    use std::fmt::Write as _;
    let mut out = String::new();
    let anchors = judged_on.first().map_or(&[][..], |flown| flown.trace.survey.ids());
    let values: Vec<String> = spec
        .parameters
        .iter()
        .zip(theta)
        .map(|(p, v)| match p.kind {
            Kind::Which(which) => chosen(which, *v, anchors),
            _ => format!("{} = {v:.4} {}", p.name, p.unit).trim_end().to_owned(),
        })
        .collect();
    let flights = judged_on.len();
    let _ = writeln!(out, "EFFECT      {} {}: {}", spec.id, spec.name, values.join(", "));
    let _ = writeln!(
        out,
        "JUDGED ON   {flights} flights, {SHRINK_FLIGHTS} simulated flights each before and after; {references} \
         accepted flights behind the floor"
    );
    let line = |s: &haltere_gap::shrink::Shrink| {
        let value = match (s.value, s.before.is_finite()) {
            (Some(v), _) => format!("{v:>6.2}"),
            (None, true) => "  none".to_owned(),
            (None, false) => "    --".to_owned(),
        };
        let interval = s
            .interval
            .map_or("              ".to_owned(), |[a, b]| format!("{a:>6.2} to {b:<5.2}"));
        format!(
            "{value} {interval} {:>8.2} {:>8.2} {:>8.2} {:>8.2}",
            s.before, s.after, s.floor, s.noise
        )
    };
    let _ = writeln!(out, "\n{:<16} shrink 95 %             before    after    floor    noise", "");
    let _ = writeln!(out, "{:<16} {}", "all channels", line(&r.whole));
    for (channel, s) in &r.channels {
        let _ = writeln!(out, "  {channel:<14} {}", line(s));
    }
    let number = |v: Option<f64>| v.map_or("none".to_owned(), |v| format!("{v:.2}"));
    let _ = writeln!(
        out,
        "\nattainable  {} by {} (best of everything tried); efficiency {}",
        number(r.attainable),
        r.attained_by,
        number(r.efficiency)
    );
    let wrong: Vec<String> = r.wrong.iter().map(|(id, v)| format!("{id} {}", number(*v))).collect();
    let _ = writeln!(out, "control     median {}: {}", number(r.wrong_median), wrong.join(", "));
    let _ = writeln!(
        out,
        "\nDistances are mean squared sigma of nominal flights. shrink: share of the distance above the floor that\n\
         is closed; `none`: before is above the floor by no more than the noise, nothing to shrink; `--`: the channel\n\
         was not visited."
    );
    if flights < 3 {
        let _ = writeln!(out, "No interval: it needs at least three flights.");
    }
    out
}
