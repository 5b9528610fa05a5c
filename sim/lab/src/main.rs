//! `haltere-lab`: the laboratory, which measures the companion and its diagnosis: scores on sealed flights, what each
//! part is worth, the search for gains, recorded flights of others. It is no part of the product: nothing that flies,
//! diagnoses or is packaged ever needs it, and neither `haltere` nor `haltere-sim` depends on it.
//!
//! Begin with `sim/lab/PROTOCOL.md`. `generator` is another world without shared physics, `cases` the sealed suite that is
//! flown in it, `blind` its scorer (`hall.rs` answers before any key is opened), `withheld`, `retune` and `outside` what the
//! diagnosis is compared with; `worlds` draws many vehicles, rooms, computers and laws; `util_flights` runs the filter on recorded flights, `recorded` and
//! `lines_of_sight` study them, `balance` weighs their forces, `crazypad` scores the diagnosis on real flights with known causes, `inject` effects at
//! sensors that are applied to recordings, `aids` and `tune` the estimator and
//! the gains; `paper` flies the experiments of the source, `beside` its steps in that other world. `faults` breaks
//! what can break, `soak`, `flood` and `kills` measure the companion as a process, `speed` what flights cost.

mod aids;
mod balance;
mod beside;
mod blind;
mod cases;
mod commands;
mod compare;
mod crazypad;
mod faults;
mod flood;
mod generator;
mod inject;
mod kills;
mod lines_of_sight;
mod outside;
mod paper;
mod paths;
mod recorded;
#[cfg(test)]
mod recordings;
mod retune;
mod score;
mod soak;
mod speed;
mod steps;
mod trial;
mod tune;
mod util_flights;
mod variation;
mod withheld;
mod worlds;

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
    /// the key to them in a folder of its own (sim/lab/PROTOCOL.md).
    Cases(cases::Options),
    /// From which size on each effect of the other world shows in the diagnostic flight: what the sealed
    /// suite is made with (sim/lab/PROTOCOL.md).
    Detectable(cases::detectable::Options),
    /// Scores a sealed suite of flights.
    Blind(commands::blind::Blind),
    /// Scores the diagnosis on many drawn worlds: other vehicles, rooms, computers, and laws (sim/lab/PROTOCOL.md).
    Worlds(worlds::Options),
    /// Which step of the diagnosis loses the name of flights whose cause is known.
    Ladder(commands::ladder::Ladder),
    /// Studies of the estimator on recorded UWB flights with motion capture: docs/ESTIMATOR.md.
    Recorded(commands::recorded::Recorded),
    /// The filter that flies on recorded flights with motion capture, in the UTIL layout.
    Util(commands::flights::Util),
    /// The same on logs of one's own, against any truth (docs/IMPORT.md).
    Flights(commands::flights::Flights),
    /// Blocked lines of sight in recorded UWB flights with motion capture.
    Sight(commands::sight::Sight),
    /// Force balance of recorded flights with motion capture.
    Balance(commands::balance::Balance),
    /// The diagnosis without a simulator on real flights with known causes, those of CrazyPAD.
    Crazypad(crazypad::Options),
    /// Effects at sensors, applied to the recorded flights of UTIL and the Flapper, and whether they are named.
    Inject(inject::Options),
    /// What the advice of `haltere gap advise` is worth.
    Advise(commands::advise::Advise),
    /// What magnetometer, barometer and survey check are worth, with and without, in lockstep.
    Aids(aids::Options),
    /// Every fault of the catalogue in every part of a flight; writes docs/FAULTS.md's table. Exit code 1
    /// when a flight leaves the fence, or leaves the floor again or crashes where a reaction exists.
    Faults(faults::Options),
    /// The companion hovers while others shout at its ground endpoints: how late its control steps are
    /// then, what it throws away, its memory. Exit code 1 when a bound is broken.
    Flood(flood::Options),
    /// One companion flies for as long as wanted: gaps between setpoints and the way from UWB to setpoint
    /// on the wire, memory, processor time. Exit code 1 when a bound is broken.
    Soak(soak::Options),
    /// The companion is killed in flight at random moments and started again: the board has to come down
    /// by itself, and nobody may take it over. Exit code 1 when one went wrong.
    Kills(kills::Options),
    /// Every experiment of the source, ours beside its numbers: one HTML report with all figures, and
    /// JSON beside it. Exit code 1 when a target is missed.
    Paper(paper::Options),
    /// The steps of the source in the world of the sealed suite, for `haltere-lab paper --beside`.
    Beside(beside::Options),
    /// What a flight costs in processor time, and what follows of it for a bank and for many machines.
    Speed(speed::Options),
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
        Command::Cases(options) => cases::run(&options).map(code),
        Command::Detectable(options) => cases::detectable::run(&options).map(code),
        Command::Blind(blind) => blind.run(),
        Command::Worlds(options) => worlds::run(&options).map(code),
        Command::Ladder(ladder) => ladder.run(),
        Command::Recorded(recorded) => recorded.run(),
        Command::Util(util) => util.run(),
        Command::Flights(flights) => flights.run(),
        Command::Sight(sight) => sight.run(),
        Command::Balance(balance) => balance.run(),
        Command::Crazypad(options) => crazypad::run(&options),
        Command::Inject(options) => inject::run(&options),
        Command::Advise(advise) => advise.run(),
        Command::Aids(options) => aids::run(&options).map(code),
        Command::Faults(options) => faults::run(&options).map(code),
        Command::Flood(options) => flood::run(&options).map(code),
        Command::Soak(options) => soak::run(&options).map(code),
        Command::Kills(options) => kills::run(&options).map(code),
        Command::Paper(options) => paper::run(&options).map(code),
        Command::Beside(options) => beside::run(&options).map(code),
        Command::Speed(options) => speed::run(&options).map(|()| ExitCode::SUCCESS),
        Command::Tune(options) => tune::run(&options).map(code),
    };
    match result {
        Ok(code) => code,
        Err(error) => {
            eprintln!("haltere-lab: {error:#}");
            ExitCode::from(EXIT_ERROR)
        }
    }
}

/// Exit code of what says whether its bounds were kept.
fn code(kept: bool) -> ExitCode {
    if kept { ExitCode::SUCCESS } else { ExitCode::from(EXIT_BOUND) }
}

#[cfg(test)]
mod tests {
    use haltere::reference::commands::{MANUALS, commands_of};

    use super::*;

    #[test]
    fn prop_commands_of_the_manuals_are_understood() {
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
        let mut checked = 0;
        for name in MANUALS.iter().chain(&["docs/CAMPAIGNS.md", "sim/lab/PROTOCOL.md"]) {
            let text = std::fs::read_to_string(format!("{root}/{name}")).expect("a manual");
            for command in commands_of(&text, "haltere-lab") {
                let line = command.join(" ");
                if let Err(error) = Cli::try_parse_from(command) {
                    panic!("{name}: `{line}` is refused:\n{error}");
                }
                checked += 1;
            }
        }
        assert!(checked > 5, "{checked} commands were found");
    }
}
