//! `haltere fit program`: the flights that show what a fit needs.

use std::process::ExitCode;

use anyhow::anyhow;
use clap::{Args, ValueEnum};

use super::fly::Configuration;
use super::output::print;
use crate::fit::programs::{Options, Program, RUNG_S, plan};
use haltere_core::control::TiltAxis;
use haltere_model::PlantConfig;
use haltere_pilot::Envelope;

/// Prints a program as a mission file (TOML), placed in the volume of the configuration and checked
/// against its limits. Where there is neither a configuration nor a survey, that is the hall of `haltere-sim fly`.
///
/// Fly it with `haltere ctl mission`, or in the simulator with `haltere-sim fly`.
#[derive(Debug, Args)]
pub(super) struct ProgramCommand {
    /// What is to be fitted.
    #[arg(value_enum)]
    name: Name,
    #[command(flatten)]
    configuration: Configuration,
    /// Axis of the angle steps.
    #[arg(long, value_enum, default_value_t = Axes::Both)]
    axis: Axes,
    /// Angles of the steps, deg; by default those of the source, largest first.
    #[arg(long, value_name = "DEG,…", value_delimiter = ',')]
    angles: Vec<f64>,
    /// Lets the steps of this program exceed control.limits.tilt_deg, up to 52 deg.
    #[arg(long)]
    beyond_limit: bool,
    /// Heights of the ladder above the floor, m.
    #[arg(long, value_name = "M,…", value_delimiter = ',')]
    heights: Vec<f64>,
    /// Time on a rung, s.
    #[arg(long, default_value_t = RUNG_S)]
    rung: f64,
    /// Voltage that ends the hover, V; by default a little above limits.battery_low_v.
    #[arg(long, value_name = "V")]
    until: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Name {
    /// Angle steps to both sides.
    Drag,
    /// Hover until a voltage.
    Thrust,
    /// Hover at a ladder of heights.
    Ground,
    /// The trimming hover.
    Trim,
    /// Doublets in roll and pitch.
    Lag,
    /// Rest and hover.
    Imu,
    /// Through the whole volume.
    Anchors,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Axes {
    /// Forward and back.
    Pitch,
    /// To the sides.
    Roll,
    /// Both.
    Both,
}

impl ProgramCommand {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let hall = PlantConfig::hall(0).survey;
        let loaded = self.configuration.load_or_in(hall)?;
        if loaded.files.is_empty() {
            eprintln!(
                "no configuration and no survey here: placed in the hall of `haltere-sim fly`; for a room of your own name its \
                 survey (--set anchors.file=FILE), or begin with `haltere init`"
            );
        }
        let pilot = loaded.config.pilot();
        let envelope = Envelope::of(&pilot, &loaded.survey);
        let program = match self.name {
            Name::Drag => Program::Drag,
            Name::Thrust => Program::Thrust,
            Name::Ground => Program::Ground,
            Name::Trim => Program::Trim,
            Name::Lag => Program::Lag,
            Name::Imu => Program::Imu,
            Name::Anchors => Program::Anchors,
        };
        if !(1.0..=3600.0).contains(&self.rung) {
            anyhow::bail!("--rung {} s, allowed 1 to 3600", self.rung);
        }
        let usual = Options::of(&pilot);
        let options = Options {
            until_v: self.until.unwrap_or(usual.until_v),
            axes: match self.axis {
                Axes::Pitch => vec![TiltAxis::Pitch],
                Axes::Roll => vec![TiltAxis::Roll],
                Axes::Both => vec![TiltAxis::Pitch, TiltAxis::Roll],
            },
            angles_deg: self.angles,
            beyond_limit: self.beyond_limit,
            heights_m: self.heights,
            rung_s: self.rung,
            ..usual
        };
        let planned = plan(program, &envelope, &options)
            .map_err(|why| anyhow!("program {}: {why}", program.name()))?;
        print(&planned.toml(program)?)?;
        Ok(ExitCode::SUCCESS)
    }
}
