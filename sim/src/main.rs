//! `haltere-sim`: the endpoint that stands in for tag and board, and the demo.
//!
//! Begin with `endpoint`, the plant in real time; what a simulated flight is says `haltere::simulated::scenario`.
//! `lockstep` and `fly` fly on simulated time, `demo` and `hide` are what a reader runs first, `firmware` puts a real
//! firmware in the place of the simulated board.

mod board_wire;
mod campaign;
mod demo;
mod endpoint;
mod firmware;
mod fly;
mod hide;
mod lateness;
mod leavings;
mod lockstep;
mod orders;
mod packet_wire;
mod print;
#[cfg(test)]
mod programs;
mod truth_file;

use std::ffi::OsString;
use std::io::IsTerminal as _;
use std::process::ExitCode;

use clap::{CommandFactory as _, Parser};
use haltere::cli::complete::{Completions, Man};
use haltere::cli::{is_unwritten, laboratory, print, tell};
use haltere::live::console::Console;
use haltere::rig::EXIT_NOT_JUDGED;

/// Its name.
const PROGRAM: &str = "haltere-sim";

/// Simulated tag, board and vehicle for the haltere companion.
#[derive(Debug, Parser)]
#[command(name = PROGRAM, version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// The endpoint alone; the first line on standard output is a JSON object that names the tag's
    /// device and the board's address as the companion has to be told; the last one says how late the simulator itself
    /// was. Exit code 75, with NOT JUDGED, when it was too late to stand in for anything.
    #[command(
        after_help = "Examples:\n  haltere-sim serve --tag-link tag --truth truth.csv\n  haltere-sim serve --scenario corridor --tag-protocol tdoa3\n  haltere-sim serve --board crazyflie"
    )]
    Serve(endpoint::Options),
    /// Simulator and companion in one program on simulated time, faster than real time; ground stations and
    /// clients connect as to any vehicle. The first line on standard output is a JSON object that says where.
    #[command(
        after_help = "Examples:\n  haltere-sim lockstep --speed 5\n  haltere-sim lockstep --scenario zurich"
    )]
    Lockstep(lockstep::Options),
    /// Endpoint, companion and mission together, in real time; leaves a log and a report. Exit code 1 when a bound is
    /// broken; 75, with NOT JUDGED, when one is broken and the simulator itself was not given the time.
    #[command(
        after_help = "Examples:\n  haltere-sim demo\n  haltere-sim demo --short --scenario draughty --json"
    )]
    Demo(demo::Options),
    /// Hide an effect in a simulated vehicle, diagnose its logs alone, then tell what was hidden, what
    /// was said, how far the gap shrank on flights not used, and the page.
    #[command(
        after_help = "Examples:\n  haltere-sim hide\n  haltere-sim hide --effect P1 --seed 7 --size full"
    )]
    Hide(hide::Options),
    /// Print a scenario, a campaign or a vehicle that comes with the program, to start a file of your own from; without
    /// a name, which there are.
    #[command(
        after_help = "Examples:\n  haltere-sim print scenario\n  haltere-sim print scenario corridor"
    )]
    Print(print::Print),
    /// Print the completion script of a shell.
    Completions(Completions),
    /// Write the manual pages.
    Man(Man),
    /// Print every physical effect with equation, source and parameters: docs/EFFECTS.md.
    Effects,
    /// Fly missions in lockstep, as fast as the computer is: one log each. Exit code 1 when one did not end on
    /// its feet, in the room.
    #[command(
        after_help = "Examples:\n  haltere-sim fly diagnostic --count 8 --out good\n  haltere-sim fly square.toml --effect P1.loss=0.12"
    )]
    Fly(fly::Options),
    /// Many flights over distributions of a scenario, on all cores, resumable
    /// (docs/CAMPAIGNS.md).
    #[command(
        after_help = "Examples:\n  haltere-sim campaign lab --out lab\n  haltere-sim campaign lab --fly 7 --log flight.mcap"
    )]
    Campaign(campaign::Options),
    /// The companion, as `haltere` would run it.
    #[command(hide = true, disable_help_flag = true)]
    Companion {
        /// Arguments of `haltere`.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        args: Vec<OsString>,
    },
}

/// A bound of the demo is broken.
const EXIT_BOUND: u8 = 1;
/// Something else went wrong.
const EXIT_ERROR: u8 = 2;
/// The result could not be written: as of every command of `haltere`.
const EXIT_UNWRITTEN: u8 = 1;

fn main() -> ExitCode {
    if let Some(code) = laboratory::run(std::env::args_os()) {
        return code;
    }
    let cli = match haltere::cli::parsed::<Cli>(std::env::args_os(), PROGRAM) {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    let result = match cli.command {
        Command::Companion { args } => {
            return haltere::cli::run(std::iter::once(OsString::from("haltere")).chain(args));
        }
        Command::Serve(options) => {
            // The board must not wait for who reads its log.
            let _console = Console::start();
            match endpoint::serve(&options) {
                Ok(false) => return ExitCode::from(EXIT_NOT_JUDGED),
                ended => ended,
            }
        }
        Command::Lockstep(options) => {
            log_to_stderr();
            lockstep::run(&options).map(|()| true)
        }
        Command::Demo(options) => {
            log_to_stderr();
            match demo::run(&options) {
                Ok(demo::Judged::Not) => return ExitCode::from(EXIT_NOT_JUDGED),
                judged => judged.map(|judged| judged == demo::Judged::Well),
            }
        }
        Command::Print(print) => print.run().map(|()| true),
        Command::Completions(completions) => {
            completions.print(&mut Cli::command(), PROGRAM).map(|()| true)
        }
        Command::Man(man) => man.write(Cli::command(), PROGRAM).map(|()| true),
        Command::Effects => print(&haltere_model::effects::document::markdown()).map(|()| true),
        Command::Hide(options) => hide::run(&options),
        Command::Fly(options) => fly::run(&options),
        Command::Campaign(options) => campaign::run(&options),
    };
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(EXIT_BOUND),
        Err(error) => {
            tell(PROGRAM, &error);
            ExitCode::from(if is_unwritten(&error) { EXIT_UNWRITTEN } else { EXIT_ERROR })
        }
    }
}

fn log_to_stderr() {
    let colours = std::io::stderr().is_terminal();
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(colours)
        .with_target(false)
        .init();
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere::reference::commands::{MANUALS, commands_of};

    #[test]
    fn prop_the_main_commands_show_examples_that_are_understood() {
        let mut shown = 0;
        for command in Cli::command().get_subcommands().filter(|c| !c.is_hide_set()) {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            for line in help.lines().filter(|line| line.starts_with("  ")) {
                assert!(line.contains(&format!("{PROGRAM} {}", command.get_name())), "{line}");
                if let Err(error) = Cli::try_parse_from(line.split_whitespace()) {
                    panic!("`{line}` is refused:\n{error}");
                }
                shown += 1;
            }
        }
        assert!(shown > 10, "{shown} examples");
    }

    #[test]
    fn prop_commands_of_the_manuals_are_understood() {
        let mut checked = 0;
        for name in MANUALS.iter().chain(&["docs/CAMPAIGNS.md"]) {
            let path = format!("{}/../{name}", env!("CARGO_MANIFEST_DIR"));
            let text = std::fs::read_to_string(&path).expect("a manual");
            // What a shell puts in is not known here.
            let plain = |command: &Vec<String>| !command.iter().any(|word| word.contains('$'));
            for command in commands_of(&text, PROGRAM).into_iter().filter(plain) {
                let line = command.join(" ");
                if let Err(error) = Cli::try_parse_from(command) {
                    panic!("{name}: `{line}` is refused:\n{error}");
                }
                checked += 1;
            }
        }
        assert!(checked > 10, "{checked} commands were found");
    }
}
