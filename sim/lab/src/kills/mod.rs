//! `haltere-lab kills`: something befalls the companion's process in flight.
//!
//! Endpoint and companion are processes over the real wires. Killed and started again at a random moment is the
//! kind that is flown where none is named: the board has to fly its own failsafe to the floor, and the companion
//! that comes back sends no setpoint into a flight that it did not begin, but arms again once the vehicle stands.
//! `--kind` flies others, each in every phase of a flight: pauses, signals, output that nobody reads. Truth tells
//! what became of the vehicle, the programs what they did.

mod flight;
mod judge;
mod kind;
mod table;

use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use anyhow::{Context, Result, bail};
use haltere::progress::Progress;
use haltere::rig::firmware::Which;
use haltere::rig::stop::Stop;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;

use self::flight::fly;
use self::judge::Outcome;
use self::kind::{Kind, Phase, Trial};

/// `haltere-lab kills`
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Folder for the flights; made if it is missing.
    #[arg(long, value_name = "DIR", default_value = "kills")]
    pub output: PathBuf,
    /// What befalls the companion, in every phase of a flight; may be given several times, `all` is every kind.
    /// Without it: killed and started again, at any moment.
    #[arg(long, value_name = "KIND", value_parser = kinds)]
    pub kind: Vec<Kinds>,
    /// Phases in which the kinds are flown; may be given several times. Without it: all four.
    #[arg(long, value_name = "PHASE")]
    pub phase: Vec<Phase>,
    /// Flights of each kind in each phase.
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub count: usize,
    /// Flights at a time; each is two processes in real time. With a real firmware always one.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub jobs: usize,
    /// Seed of the moments.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    #[command(flatten)]
    pub firmware: Which,
    /// Keep the logs of all flights, not only of those that went wrong.
    #[arg(long)]
    pub keep: bool,
    /// Print the result as JSON on standard output.
    #[arg(long)]
    pub json: bool,
}

/// One kind, or all of them.
#[derive(Debug, Clone)]
pub struct Kinds(Vec<Kind>);

fn kinds(text: &str) -> Result<Kinds, String> {
    if text == "all" {
        return Ok(Kinds(Kind::ALL.to_vec()));
    }
    let one = Kind::ALL.into_iter().find(|kind| kind.name() == text);
    one.map(|kind| Kinds(vec![kind])).ok_or_else(|| {
        let names: Vec<_> = Kind::ALL.into_iter().map(Kind::name).collect();
        format!("allowed all, {}", names.join(", "))
    })
}

impl Options {
    /// What is flown, and when in a flight it happens.
    fn trials(&self) -> Vec<Trial> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(self.seed);
        let mut kinds: Vec<Kind> = self.kind.iter().flat_map(|kinds| kinds.0.clone()).collect();
        kinds.sort();
        kinds.dedup();
        let any = kinds.is_empty() && self.phase.is_empty();
        if kinds.is_empty() {
            kinds.push(Kind::Killed);
        }
        let mut phases =
            if self.phase.is_empty() { Phase::ALL.to_vec() } else { self.phase.clone() };
        if any {
            phases = vec![Phase::Any];
        }
        let all = kinds.iter().flat_map(|kind| phases.iter().map(move |phase| (*kind, *phase)));
        let each = all.flat_map(|what| std::iter::repeat_n(what, self.count));
        (0..).zip(each).map(|(n, (kind, phase))| Trial::draw(n, kind, phase, &mut rng)).collect()
    }
}

/// Runs them. `false`: one went wrong.
pub fn run(options: &Options) -> Result<bool> {
    if options.count == 0 || options.jobs == 0 {
        bail!("--count and --jobs: at least 1");
    }
    // PX4 has fixed ports, and two firmwares want more than this computer's two cores.
    let jobs = if options.firmware.is_real() { 1 } else { options.jobs };
    let folder = std::path::absolute(&options.output).context("--output")?;
    std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let stop = Stop::on_signals()?;
    let trials = options.trials();
    let progress = Progress::counted("kills", 0, trials.len() as u64);
    let next = AtomicUsize::new(0);
    let outcomes = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                while let Some(trial) = trials.get(next.fetch_add(1, Relaxed)) {
                    if stop.asked() {
                        return;
                    }
                    let own = folder.join(format!("{:04}", trial.n));
                    let outcome = fly(trial, &own, &options.firmware);
                    let tidy = !options.keep && outcome.as_ref().is_ok_and(Outcome::ok);
                    if tidy {
                        let _ = std::fs::remove_dir_all(&own);
                    }
                    if let Ok(mut all) = outcomes.lock() {
                        all.push((*trial, outcome));
                    }
                    progress.advance(1);
                }
            });
        }
    });
    progress.end();
    if stop.asked() {
        bail!("stopped by a signal");
    }
    let mut outcomes = outcomes.into_inner().unwrap_or_default();
    outcomes.sort_by_key(|(trial, _)| trial.n);
    table::tell(options.json, &outcomes)
}
