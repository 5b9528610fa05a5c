//! `haltere gap mission`: the standard flights as mission files.

use std::process::ExitCode;

use clap::{Args, ValueEnum};

use super::gap::RoomOptions;
use super::print;
use haltere_gap::bank::missions;
use haltere_gap::scene::Scene;

/// Prints a standard flight as a mission file (TOML), placed in the middle of the room.
///
/// Fly it with `haltere ctl mission`, or in the simulator with `haltere-sim fly`.
#[derive(Debug, Args)]
pub(super) struct MissionCommand {
    /// Which.
    #[arg(value_enum)]
    which: Which,
    #[command(flatten)]
    room: RoomOptions,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Which {
    /// The diagnostic flight.
    Diagnostic,
    /// Another flight, to measure shrinkage on.
    HeldOut,
    /// A hover and a box.
    Plain,
}

impl MissionCommand {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let mut scene = Scene::lab().map_err(anyhow::Error::new)?;
        if let Some(room) = self.room.room()? {
            let middle = |[low, high]: [f64; 2]| 0.5 * (low + high);
            scene.start_NE_m = [middle(room.north_m), middle(room.east_m)];
            scene.room = room;
        }
        let mission = match self.which {
            Which::Diagnostic => missions::diagnostic_file(&scene),
            Which::HeldOut => missions::held_out_file(&scene),
            Which::Plain => missions::plain_file(&scene),
        };
        print(&toml::to_string(&mission)?)?;
        Ok(ExitCode::SUCCESS)
    }
}
