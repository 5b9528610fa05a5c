//! `haltere-lab paper`: every experiment of the source in lockstep, ours beside its numbers.
//!
//! One list, [`EXPERIMENTS`], drives what is run, printed, drawn and accepted by `--only`. Each
//! experiment is a file of its own; `results` says what they give, `source` holds the source's numbers. `identify` reads
//! the source's gains and window from its table, `ladder` leads from the source's system as printed to ours as shipped.

mod angle_steps;
mod bench;
pub mod beside;
mod document;
mod drift;
mod extrapolation;
mod ground;
mod height;
mod identify;
mod ladder;
mod noise;
mod page;
mod print;
mod results;
mod shapes;
pub mod source;
mod standing;
mod step_tests;
pub mod table_3;
#[cfg(test)]
mod tests;
mod thrust;
mod two_vehicles;

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use haltere::cli::print as say;
use haltere::progress::Progress;
use haltere::report::verdict::all_passed;
use rayon::prelude::*;

use crate::compare::pilot_config;
use bench::Bench;
use beside::Beside;
use results::{Line, Section};

/// `haltere-lab paper`
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Where the report goes: paper.html and paper.json.
    #[arg(default_value = "paper")]
    directory: PathBuf,
    /// Only this experiment, by name or number; may be given more than once.
    #[arg(long, value_name = "EXPERIMENT", value_parser = find)]
    only: Vec<&'static Experiment>,
    /// Repetitions of each, each with a seed of its own; five as in the source.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=1000))]
    repetitions: u64,
    /// Seed of the first repetition: the others follow it.
    #[arg(long, default_value_t = bench::SEED)]
    seed: u64,
    /// Threads; all cores when not given.
    #[arg(long)]
    threads: Option<usize>,
    /// Configuration whose `[control]` and `[estimator]` sections are flown; without it the defaults.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Change one key, as for the companion.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Table 3 in another world, as `haltere-lab beside FILE` writes it, in a column of its own.
    #[arg(long, value_name = "FILE")]
    beside: Option<PathBuf>,
    /// Also write the summary and every number as a document.
    #[arg(long, value_name = "FILE")]
    doc: Option<PathBuf>,
    /// Print JSON instead of tables.
    #[arg(long)]
    json: bool,
    /// Instead of flying experiments find the source's gains from its cells of `raw` (table 3), and print them.
    #[arg(long)]
    identify: bool,
}

/// One experiment.
#[derive(Debug)]
pub struct Experiment {
    /// Name for `--only` and for links.
    name: &'static str,
    /// Number in the list of what is to be reproduced.
    number: &'static str,
    /// Heading.
    title: &'static str,
    /// Simulated seconds that a repetition takes, for the progress bar.
    seconds: fn() -> u64,
    run: fn(&Bench) -> Result<Section>,
}

/// All of them, in the order of the report.
static EXPERIMENTS: &[Experiment] = &[
    Experiment {
        name: "noise",
        number: "1",
        title: "Standing at the origin, constant and variable UWB noise (figure 3)",
        seconds: noise::seconds,
        run: noise::run,
    },
    Experiment {
        name: "drift",
        number: "1b",
        title: "Standing still: attitude with UWB and on the IMU alone",
        seconds: drift::seconds,
        run: drift::run,
    },
    Experiment {
        name: "shapes",
        number: "2",
        title: "Path shapes (section 4)",
        seconds: shapes::seconds,
        run: shapes::run,
    },
    Experiment {
        name: "extrapolation",
        number: "3",
        title: "Final speed extrapolated from a part of the data (table 1, figures 4 and 5)",
        seconds: extrapolation::seconds,
        run: extrapolation::run,
    },
    Experiment {
        name: "laws",
        number: "4",
        title: "The exponential law for two vehicles (figure 6)",
        seconds: two_vehicles::seconds,
        run: two_vehicles::run,
    },
    Experiment {
        name: "thrust",
        number: "5",
        title: "Throttle against battery voltage (figure 7)",
        seconds: thrust::seconds,
        run: thrust::run,
    },
    Experiment {
        name: "height",
        number: "6",
        title: "P and PI height control, constant and variable base thrust (table 2, figure 8)",
        seconds: height::seconds,
        run: height::run,
    },
    Experiment {
        name: "ground",
        number: "7",
        title: "Ground effect (figure 9, equation 7)",
        seconds: ground::seconds,
        run: ground::run,
    },
    Experiment {
        name: "steps",
        number: "8",
        title: "Steps, raw against modified (table 3, figure 10)",
        seconds: step_tests::seconds,
        run: step_tests::run,
    },
];

/// An experiment by name or number.
fn find(text: &str) -> Result<&'static Experiment, String> {
    EXPERIMENTS.iter().find(|e| e.name == text || e.number == text).ok_or_else(|| {
        let known: Vec<String> =
            EXPERIMENTS.iter().map(|e| format!("{} ({})", e.name, e.number)).collect();
        format!("no experiment {text:?}; there are {}", known.join(", "))
    })
}

/// Experiments that the source's conclusions rest on.
const CONCLUSIONS: [&str; 2] = ["height", "steps"];

/// What came of an experiment; one that failed does not take the others with it.
pub struct Outcome {
    experiment: &'static Experiment,
    section: Result<Section, String>,
}

/// The lines of the summary: what the source concludes first, then in the order of the experiments.
fn summary(outcomes: &[Outcome]) -> Vec<&Line> {
    let mut order: Vec<&Outcome> = outcomes.iter().collect();
    order.sort_by_key(|o| !CONCLUSIONS.contains(&o.experiment.name));
    order.iter().filter_map(|o| o.section.as_ref().ok()).flat_map(|s| &s.lines).collect()
}

/// Runs experiments side by side.
fn run_all(experiments: &[&'static Experiment], bench: &Bench) -> Vec<Outcome> {
    experiments
        .par_iter()
        .map(|experiment| Outcome {
            experiment,
            section: (experiment.run)(bench).map_err(|error| once(&format!("{error:#}"))),
        })
        .collect()
}

/// What a vehicle said again and again until it was given up, once.
fn once(text: &str) -> String {
    let mut said: Vec<&str> = Vec::new();
    text.split("; ").for_each(|part| {
        if !said.contains(&part) {
            said.push(part);
        }
    });
    said.join("; ")
}

/// What is written.
const PAGE: &str = "paper.html";
const JSON: &str = "paper.json";

/// Runs, prints, writes the report. `false`: a target is missed or an experiment failed.
pub fn run(options: &Options) -> Result<bool> {
    let inputs: Vec<&PathBuf> = options.config.iter().chain(&options.beside).collect();
    haltere_log::written::look_all(&options.directory, &[PAGE, JSON], &inputs)?;
    if let Some(path) = &options.doc {
        haltere_log::written::look(path, &inputs)?;
    }
    let pilot = pilot_config(options.config.as_deref(), &options.set)?;
    let mut pool = rayon::ThreadPoolBuilder::new();
    if let Some(threads) = options.threads {
        if threads == 0 {
            bail!("--threads 0: at least one is needed; leave it out for all cores");
        }
        pool = pool.num_threads(threads);
    }
    let pool = pool.build()?;
    if options.identify {
        return pool.install(|| identify::run(&pilot));
    }
    let beside = options.beside.as_deref().map(Beside::read).transpose()?;
    let chosen: Vec<&'static Experiment> = EXPERIMENTS
        .iter()
        .filter(|e| options.only.is_empty() || options.only.iter().any(|o| o.name == e.name))
        .collect();
    let directory = &options.directory;
    std::fs::create_dir_all(directory).with_context(|| {
        format!("{}: cannot be made a folder for the report", directory.display())
    })?;
    let repetitions = options.repetitions;
    let flown_s = due(&chosen, repetitions);
    let progress = Progress::counted("s of flight", 0, flown_s);
    let (outcomes, progress) = pool.install(|| {
        let bench = Bench { pilot, repetitions, seed: options.seed, progress, beside };
        (run_all(&chosen, &bench), bench.progress)
    });
    progress.end();
    let took_s = progress.seconds();
    let about = About { repetitions, flown_s, took_s, changed: &options.set };
    let json = print::json(&outcomes, &about);
    let page = directory.join(PAGE);
    write(&page, &page::render(&outcomes, &about))?;
    write(&directory.join(JSON), &serde_json::to_string_pretty(&json)?)?;
    if let Some(path) = &options.doc {
        write(path, &document::render(&outcomes, &about))?;
    }
    if options.json {
        say(&format!("{json}\n"))?;
    } else {
        say(&print::text(&outcomes))?;
        let flown_s = about.flown_s;
        say(&format!("\n{flown_s} s of flight in {took_s:.0} s; report: {}\n", page.display()))?;
    }
    Ok(outcomes.iter().all(|o| o.section.as_ref().is_ok_and(|s| all_passed(&s.targets))))
}

/// Simulated seconds of experiments.
fn due(experiments: &[&'static Experiment], repetitions: u64) -> u64 {
    experiments.iter().map(|e| repetitions * (e.seconds)()).sum()
}

/// How the whole run was made.
pub struct About<'a> {
    repetitions: u64,
    flown_s: u64,
    took_s: f64,
    changed: &'a [String],
}

fn write(path: &std::path::Path, text: &str) -> Result<()> {
    Ok(haltere_log::written::write::<&std::path::Path>(path, text, &[])?)
}
