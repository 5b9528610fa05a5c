//! Command line of the companion.
//!
//! Tables and reports go to standard output (with `--json` as JSON), progress and logs to standard
//! error. Exit codes: 0 success, 1 failure, 2 wrong usage; others per command.

mod check;
pub mod complete;
mod ctl;
mod fit;
mod fit_program;
mod fly;
pub mod gap;
mod gap_accept;
mod gap_advise;
mod gap_attribute;
mod gap_balance;
mod gap_bank;
mod gap_budget;
mod gap_commission;
mod gap_diagnose;
mod gap_missions;
mod gap_observe;
mod gap_references;
mod gap_report;
mod gap_session;
mod gap_shrink;
mod init;
mod key;
pub mod laboratory;
mod log;
mod log_export;
mod log_list;
mod programs;
mod replay;
mod report;
mod style;
pub mod vehicle;
mod which_flight;

use std::io::{self, Write as _};
use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};
use serde::Serialize;

use crate::live::console;

/// Something failed; the sentence is on standard error.
const FAILED: u8 = 1;
/// Its name.
const PROGRAM: &str = "haltere";

/// Companion autopilot for flapping-wing drones on ultra-wideband positioning.
#[derive(Debug, Parser)]
#[command(name = PROGRAM, version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Runs at a lower priority, 1 to 19.
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(i32).range(1..=19))]
    nice: Option<i32>,
}

// A command of another module is one variant here, one line in `main`, one file beside this one.
#[derive(Debug, Subcommand)]
enum Command {
    /// Flies: the companion, until it is stopped.
    #[command(
        after_help = "Examples:\n  haltere fly\n  haltere fly --config lab.toml --set control.version=raw"
    )]
    Fly(fly::Fly),
    /// Lives through recorded flights again and says whether the same bytes go out.
    #[command(after_help = "Examples:\n  haltere replay logs/*.mcap")]
    Replay(replay::Replay),
    /// Handles flight logs.
    #[command(subcommand)]
    Log(log::Log),
    /// Identifies the vehicle from flight logs.
    #[command(subcommand)]
    Fit(fit::Fit),
    /// Where flight and nominal model differ, which effect causes it, how far it shrinks.
    #[command(subcommand)]
    Gap(Box<gap::Gap>),
    /// Vehicle files: prints one with every key, examines one.
    #[command(subcommand)]
    Vehicle(vehicle::VehicleCommand),
    /// Arms, flies and lands a running companion: a small ground station for scripts.
    #[command(
        after_help = "Examples:\n  haltere ctl status\n  haltere ctl takeoff 1.2\n  haltere ctl mission square.toml\n  haltere ctl --to udpout:10.0.0.7:14551 land"
    )]
    Ctl(ctl::Ctl),
    /// Draws a flight log as one page.
    #[command(
        after_help = "Examples:\n  haltere report logs/flight.mcap\n  haltere report logs/flight.mcap --truth truth.csv -o flight.html"
    )]
    Report(report::Report),
    /// Examines configuration, survey, ports, system and disk, and says what to put right.
    #[command(
        after_help = "Examples:\n  haltere check\n  haltere check --live --config haltere.toml"
    )]
    Check(check::Check),
    /// Asks a few questions and writes a first configuration.
    #[command(
        after_help = "Examples:\n  haltere init\n  haltere init --yes --station mavsdk --station qgroundcontrol --anchors anchors.txt"
    )]
    Init(init::Init),
    /// Prints the completion script of a shell.
    Completions(complete::Completions),
    /// Writes the manual pages.
    Man(complete::Man),
    /// Makes a key for signed MAVLink.
    Key(key::Key),
}

/// Runs the command that the process was started with.
pub fn main() -> ExitCode {
    run(std::env::args_os())
}

/// Runs the command in `args`, program name first: for programs that act as the companion.
pub fn run(args: impl IntoIterator<Item = std::ffi::OsString>) -> ExitCode {
    let args: Vec<std::ffi::OsString> = args.into_iter().collect();
    if let Some(code) = laboratory::run(args.iter().cloned()) {
        return code;
    }
    let cli = match parsed::<Cli>(args, PROGRAM) {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    if !matches!(cli.command, Command::Fly(_)) {
        start_logging();
        be_nice(cli.nice);
    }
    let result = match cli.command {
        // Logs and ends in a way of its own: nothing that flies waits for who reads.
        Command::Fly(fly) => return fly.run(cli.nice),
        Command::Replay(replay) => replay.run(),
        Command::Log(log) => log.run(),
        Command::Fit(fit) => fit.run(),
        Command::Gap(gap) => gap.run(),
        Command::Vehicle(vehicle) => vehicle.run(),
        Command::Ctl(ctl) => ctl.run(),
        Command::Report(report) => report.run(),
        Command::Check(check) => check.run(),
        Command::Init(init) => init.run(),
        Command::Completions(completions) => {
            completions.print(&mut Cli::command(), PROGRAM).map(|()| ExitCode::SUCCESS)
        }
        Command::Man(man) => man.write(Cli::command(), PROGRAM).map(|()| ExitCode::SUCCESS),
        Command::Key(key) => key.run(),
    };
    match result {
        Ok(code) => code,
        Err(error) => {
            tell(PROGRAM, &error);
            ExitCode::from(FAILED)
        }
    }
}

fn be_nice(nice: Option<i32>) {
    if let Some(nice) = nice
        && let Err(error) = rustix::process::nice(nice)
    {
        tracing::warn!("--nice {nice}: {error}");
    }
}

/// Logs to standard error.
pub fn start_logging() {
    console::log_to(std::io::stderr);
}

/// A result that did not arrive.
#[derive(Debug, thiserror::Error)]
#[error("the result cannot be written to standard output")]
pub struct Unwritten(#[source] pub io::Error);

/// An error with its causes, each said once: many errors name their cause in their own words.
pub fn sentence(error: &anyhow::Error) -> String {
    error.chain().fold(String::new(), |said, cause| {
        let text = cause.to_string();
        match () {
            () if said.is_empty() || text.starts_with(&said) => text,
            () if said.contains(&text) => said,
            () => said + ": " + &text,
        }
    })
}

/// Says why a command failed: a sentence for people; each layer has named what it knows. Of a reader that went away, as
/// `head` does when it has enough, nothing is said: who reads knows, and a script has the exit code.
pub fn tell(program: &str, error: &anyhow::Error) {
    let kind_of =
        |cause: &(dyn std::error::Error + 'static)| Some(cause.downcast_ref::<io::Error>()?.kind());
    let reader_is_gone =
        error.chain().filter_map(kind_of).any(|kind| kind == io::ErrorKind::BrokenPipe);
    if !(reader_is_gone && is_unwritten(error)) {
        let _ = writeln!(std::io::stderr(), "{program}: {}", sentence(error));
    }
}

/// Whether an error is of this kind.
pub fn is_unwritten(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        let inside = cause.downcast_ref::<io::Error>().and_then(io::Error::get_ref);
        cause.is::<Unwritten>() || inside.is_some_and(|inside| inside.is::<Unwritten>())
    })
}

/// Standard output for what is written piece by piece; its errors are [`Unwritten`].
#[derive(Debug)]
pub struct Out(io::StdoutLock<'static>);

impl Out {
    /// Taken until it is dropped.
    pub fn lock() -> Self {
        Self(io::stdout().lock())
    }
}

impl io::Write for Out {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes).map_err(|e| io::Error::new(e.kind(), Unwritten(e)))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush().map_err(|e| io::Error::new(e.kind(), Unwritten(e)))
    }
}

/// Prints to standard output. Who reads a result has it whole, or the command fails: a disk that is full, and a reader
/// that went away, look alike to the script that goes on.
pub fn print(text: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    Ok(out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(Unwritten)?)
}

/// Arguments; else the exit code, with help, version or what is wrong with them printed.
pub fn parsed<C: Parser>(
    args: impl IntoIterator<Item = std::ffi::OsString>,
    program: &str,
) -> Result<C, ExitCode> {
    C::try_parse_from(args).map_err(|mut said| {
        suggest(&mut said, &C::command());
        let printed = said.print().and_then(|()| std::io::stdout().flush());
        let code = u8::try_from(said.exit_code()).unwrap_or(FAILED);
        match printed.map_err(Unwritten) {
            Err(error) if !said.use_stderr() => {
                tell(program, &anyhow::Error::new(error));
                ExitCode::from(FAILED)
            }
            _ => ExitCode::from(code),
        }
    })
}

/// Names the command that was meant where one of another level is: `haltere diagnose` for `haltere gap diagnose`.
fn suggest(said: &mut clap::Error, command: &clap::Command) {
    use clap::error::{ContextKind, ContextValue};
    let Some(ContextValue::String(wrong)) = said.get(ContextKind::InvalidSubcommand) else {
        return;
    };
    let wrong = wrong.to_lowercase();
    let mut open: Vec<(String, &clap::Command)> = vec![(String::new(), command)];
    let mut found = Vec::new();
    while let Some((path, command)) = open.pop() {
        for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
            let name = below.get_name();
            let path = if path.is_empty() { name.to_owned() } else { format!("{path} {name}") };
            let begins = wrong.len() >= LEAST_BEGINNING && name.starts_with(&wrong);
            if path != name && (begins || wrong.starts_with(name)) {
                found.push(path.clone());
            }
            open.push((path, below));
        }
    }
    if !found.is_empty() {
        found.sort();
        said.insert(ContextKind::SuggestedSubcommand, ContextValue::Strings(found));
    }
}

/// A shorter beginning of a name means too many, letters.
const LEAST_BEGINNING: usize = 3;

/// Prints as JSON.
pub fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    print(&(serde_json::to_string_pretty(value)? + "\n"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::commands::{MANUALS, commands_of};

    #[test]
    fn regress_a_command_of_another_level_is_named() {
        let said = |words: &str| {
            let error = Cli::try_parse_from(words.split(' ')).map_err(|mut error| {
                suggest(&mut error, &<Cli as clap::CommandFactory>::command());
                error.to_string()
            });
            error.unwrap_err()
        };
        for (words, meant) in [
            ("haltere diagnose a.mcap", "'gap diagnose'"),
            ("haltere diagnoses", "'gap diagnose'"),
            ("haltere export a.mcap", "'log export'"),
            ("haltere Takeoff 1.2", "'ctl takeoff'"),
        ] {
            let text = said(words);
            assert!(text.contains("similar subcommand exists") && text.contains(meant), "{text}");
        }
        // One of this level that is close is named as before.
        assert!(said("haltere repot").contains("'report'"));
    }

    #[test]
    fn regress_path_and_cause_are_said_once() {
        let io = std::io::Error::other("a pipe");
        let inner = haltere_log::import::Error::Io { path: "a.csv".into(), source: io };
        let error = anyhow::Error::new(inner).context("a.csv");
        assert_eq!(sentence(&error), "a.csv: a pipe");
        let apart = anyhow::anyhow!("cause").context("what");
        assert_eq!(sentence(&apart), "what: cause");
    }

    #[test]
    fn prop_the_main_commands_show_examples_that_are_understood() {
        let mut shown = 0;
        for command in Cli::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            for line in help.lines().filter(|line| line.starts_with("  ")) {
                assert!(line.contains(&format!("{PROGRAM} {}", command.get_name())), "{line}");
                if let Err(error) = Cli::try_parse_from(line.split_whitespace()) {
                    panic!("`{line}` is refused:\n{error}");
                }
                shown += 1;
            }
        }
        assert!(shown > 8, "{shown} examples");
    }

    #[test]
    fn prop_commands_of_the_manuals_are_understood() {
        let mut checked = 0;
        for name in MANUALS {
            let path = format!("{}/{name}", env!("CARGO_MANIFEST_DIR"));
            let text = std::fs::read_to_string(&path).expect("a manual");
            for command in commands_of(&text, "haltere") {
                let line = command.join(" ");
                if let Err(error) = Cli::try_parse_from(command) {
                    panic!("{name}: `{line}` is refused:\n{error}");
                }
                checked += 1;
            }
        }
        assert!(checked > 20, "{checked} commands were found");
    }
}
