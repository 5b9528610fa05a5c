//! `haltere-lab`: the laboratory, which measures the companion and its diagnosis: scores on sealed flights, what each
//! part is worth, the search for gains, recorded flights of others. It is no part of the product: nothing that flies,
//! diagnoses or is packaged ever needs it, and neither `haltere` nor `haltere-sim` depends on it.

mod aids;
mod cases;
mod generator;
mod tune;

use std::process::ExitCode;

use clap::Parser;

/// Scores, ablations, tuning and studies of haltere, for those who work on it.
///
/// Exit codes: 0 success, 1 a bound or a demand is missed, 2 something went wrong; others per command.
#[derive(Debug, Parser)]
#[command(name = "haltere-lab", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// The sealed suite for the diagnosis of the sim-to-real gap: flights of another world, with
    /// the key to them in a folder of its own (docs/GAP_PROTOCOL.md).
    Cases(cases::Options),
    /// From which size on each effect of the other world shows in the diagnostic flight: what the sealed
    /// suite is made with (docs/GAP_PROTOCOL.md).
    Detectable(cases::detectable::Options),
    /// What magnetometer, barometer and survey check are worth, with and without, in lockstep:
    /// docs/ESTIMATOR_SIM.md.
    Aids(aids::Options),
    /// Search PID gains for version `raw`, as the committed ones were found.
    Tune(tune::Options),
}

/// A bound or a demand is missed.
const EXIT_BOUND: u8 = 1;
/// Something else went wrong.
const EXIT_ERROR: u8 = 2;

fn main() -> ExitCode {
    let cli = Cli::parse();
    haltere::cli::start_logging();
    let result = match cli.command {
        Command::Cases(options) => cases::run(&options),
        Command::Detectable(options) => cases::detectable::run(&options),
        Command::Aids(options) => aids::run(&options),
        Command::Tune(options) => tune::run(&options),
    };
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(EXIT_BOUND),
        Err(error) => {
            eprintln!("haltere-lab: {error:#}");
            ExitCode::from(EXIT_ERROR)
        }
    }
}
