//! `haltere gap`: one variant, one line in `run` and one file beside this one per subcommand.

mod accept;
mod advise;
mod attribute;
mod balance;
mod bank;
mod budget;
mod commission;
mod diagnose;
mod effects;
mod missions;
mod observe;
mod options;
mod own_simulator;
mod report;
mod shrink;
mod terminal;

use std::process::ExitCode;

use clap::Subcommand;

pub use attribute::read as observed_flights;
pub use diagnose::diagnose;
pub use options::{BankOptions, SceneOptions};

/// Diagnosis of the gap between flights and the nominal model.
#[derive(Debug, Subcommand)]
pub(super) enum Gap {
    /// Says where a flight differs from the simulator, which effect causes it, how far it shrinks.
    Diagnose(diagnose::Diagnose),
    /// Says what an effect is, what it shows as, and what to do about it.
    #[command(after_help = "Examples:\n  haltere gap effects\n  haltere gap effects P1 I2")]
    Effects(effects::Effects),
    /// Ranks experiments by how well they would tell apart what a diagnosis left open.
    Advise(advise::Advise),
    /// Adds one effect to the simulator and says how far the gap closes on other flights.
    Shrink(shrink::Shrink),
    /// Writes what was found into the files of simulator and vehicle.
    Accept(accept::Accept),
    /// Takes the newest change by `accept` to a file back.
    Undo(accept::Undo),
    /// Finds the constants of a vehicle file with which the simulator flies as accepted flights were flown.
    Commission(commission::Commission),
    /// Says which constants of the vehicle file differ and what share of the gap each closes, without accepted flights.
    Budget(budget::BudgetCommand),
    /// Flies the bank that flights of a mission are compared with, and keeps it.
    Bank(bank::BankCommand),
    /// Prints the statistics of flights, for other methods.
    Observe(observe::Observe),
    /// Attributes flights whose statistics were observed before.
    Attribute(attribute::Attribute),
    /// Writes a standard flight as a mission file.
    Mission(missions::MissionCommand),
}

impl Gap {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            Gap::Diagnose(diagnose) => diagnose.run(),
            Gap::Effects(effects) => effects.run(),
            Gap::Advise(advise) => advise.run(),
            Gap::Shrink(shrink) => shrink.run(),
            Gap::Accept(accept) => accept.run(),
            Gap::Undo(undo) => undo.run(),
            Gap::Commission(commission) => commission.run(),
            Gap::Budget(budget) => budget.run(),
            Gap::Bank(bank) => bank.run(),
            Gap::Observe(observe) => observe.run(),
            Gap::Attribute(attribute) => attribute.run(),
            Gap::Mission(mission) => mission.run(),
        }
    }
}
