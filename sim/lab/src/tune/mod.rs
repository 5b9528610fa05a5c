//! `haltere-lab tune`: the search that found the gains.

mod search;

use anyhow::Result;

use crate::compare::{fly, pilot_config};
use crate::variation::{VARIATIONS, Variation};
use haltere_core::control::{ControlConfig, ControlGains, Version};

use self::search::FAILED;

/// Seeds of the search; scores are never taken on them.
const SEARCH_SEEDS: std::ops::Range<u64> = 9_000..9_100;

/// `haltere-lab tune`
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Generations of the search.
    #[arg(long, default_value_t = 60)]
    pub generations: usize,
    /// Seeds that a vehicle is flown on.
    #[arg(long, default_value_t = 2)]
    pub seeds: usize,
    /// Search on the nominal vehicle alone, to see what margin costs; not how the gains were found.
    #[arg(long)]
    pub nominal: bool,
    /// Configuration whose gains to start from; else the design on a linear model.
    #[arg(long, value_name = "FILE")]
    pub config: Option<std::path::PathBuf>,
    /// Change one key, as for the companion.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

impl Options {
    fn start(&self, raw: &ControlConfig) -> ControlGains {
        if self.config.is_some() { raw.gains } else { ControlGains::designed() }
    }
}

/// Searches and prints the gains as a configuration snippet.
pub fn run(options: &Options) -> Result<bool> {
    let pilot = pilot_config(options.config.as_deref(), &options.set)?;
    let raw = ControlConfig { version: Version::Raw, ..pilot.control.clone() };
    let variations = if options.nominal { &VARIATIONS[..1] } else { &VARIATIONS[..] };
    let seeds: Vec<u64> = SEARCH_SEEDS.take(options.seeds).collect();
    let cost = |gains: &ControlGains, variation: &Variation, seed: u64| {
        let control = ControlConfig { gains: *gains, ..raw.clone() };
        match fly(&pilot, &control, variation, seed) {
            Ok(flown) => search::cost(&flown.scores),
            Err(_) => [FAILED; 3],
        }
    };
    let (gains, best) =
        search::search(&options.start(&raw), variations, &seeds, options.generations, cost, |p| {
            let costs = p.best.map(|w| format!("{:.4} ({})", w.cost, variations[w.variation].name));
            let steps = p.step.map(|s| format!("{s:.3}"));
            eprintln!(
                "generation {:3}  cost {}  step {}",
                p.generation,
                costs.join(", "),
                steps.join(" ")
            );
            eprintln!("{:.4?}", p.gains.as_vector());
        });
    println!(
        "# found for `raw` on seeds {seeds:?}, worst of {} vehicles: cost {:.4} {:.4} {:.4}",
        variations.len(),
        best[0].cost,
        best[1].cost,
        best[2].cost
    );
    println!("[control.gains]");
    print!("{}", toml::to_string(&gains)?);
    Ok(true)
}
