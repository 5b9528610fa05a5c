//! `haltere fly` and `haltere check`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::anyhow;
use clap::Args;

use super::programs::BuiltIn;
use super::{print, print_json};
use crate::config::{Loaded, Sources};
use crate::frames::Vec3;
use crate::live;

/// Where the configuration comes from.
#[derive(Debug, Args)]
pub(super) struct Configuration {
    /// Configuration file; several may be given, later ones win. Default: haltere.toml in the
    /// working directory, if there is one.
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// One value, for example control.version=raw. Wins over files and environment.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl Configuration {
    pub(super) fn load(self) -> anyhow::Result<Loaded> {
        Loaded::load(&Sources::new(self.config, self.set))
            .map_err(|problems| anyhow!("the configuration is refused:\n{problems}"))
    }
}

/// Flies.
#[derive(Debug, Args)]
pub(super) struct Fly {
    #[command(flatten)]
    configuration: Configuration,
    /// Print the summary at the end as JSON.
    #[arg(long)]
    json: bool,
}

impl Fly {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let loaded = self.configuration.load()?;
        for file in &loaded.files {
            tracing::info!("read {}", file.display());
        }
        for note in &loaded.notes {
            tracing::warn!("{note}");
        }
        let programs = Box::new(BuiltIn::new(&loaded)?);
        let summary = live::run_with(&loaded, &live::Stop::default(), programs)?;
        if self.json {
            print_json(&summary)?;
        } else {
            let log = summary.log.as_ref().map(|path| path.display().to_string());
            print(&format!("log: {}\n", log.as_deref().unwrap_or("none")));
            print(&format!(
                "wake-ups: {}, late by more than 5 ms: {}, worst {:.1} ms\n",
                summary.wake_ups,
                summary.late_wake_ups,
                summary.worst_lateness_s * 1e3
            ));
            for (link, reason, count) in &summary.drops {
                print(&format!("lost on link {link}: {reason} {count}\n"));
            }
        }
        match summary.recording_error {
            Some(error) => Err(anyhow!(error)),
            None => Ok(ExitCode::SUCCESS),
        }
    }
}

/// Examines a configuration.
#[derive(Debug, Args)]
pub(super) struct Check {
    #[command(flatten)]
    configuration: Configuration,
    /// Print the resolved configuration as JSON instead of TOML.
    #[arg(long)]
    json: bool,
}

impl Check {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let loaded = self.configuration.load()?;
        for file in &loaded.files {
            tracing::info!("read {}", file.display());
        }
        examine_survey(&loaded);
        tracing::info!("{} anchors; everything is in order", loaded.survey.ids().len());
        if self.json {
            print_json(&loaded.config)?;
        } else {
            print(&loaded.config.to_toml());
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Dilution in height or plane beyond which it is warned of: 0.1 m of wandering range error then is
/// half a metre of position.
const POOR_DILUTION: f64 = 5.0;

/// Says how well the anchors fix positions where it is to fly: the limits, or the anchors' extent
/// from 0.3 m above the floor.
fn examine_survey(loaded: &Loaded) {
    let survey = &loaded.survey;
    let anchors = || survey.ids().iter().filter_map(|id| survey.position_E_m(*id));
    let extent = |axis: usize| {
        anchors().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| {
            [low.min(p[axis]), high.max(p[axis])]
        })
    };
    let limits = &loaded.config.limits;
    let north = limits.north_m.unwrap_or(extent(0));
    let east = limits.east_m.unwrap_or(extent(1));
    let top_m = limits.height_m.unwrap_or(-extent(2)[0]);
    let low = Vec3::new(north[0], east[0], -top_m);
    let high = Vec3::new(north[1], east[1], -LOWEST_M.min(top_m));
    let found = survey.examine(low, high);
    let shown =
        |[plane, height]: [f64; 2]| format!("{plane:.1} in the plane, {height:.1} in height");
    let [n, e, d] = found.worst_at_E_m.to_array();
    tracing::info!(
        "position error for each metre of range error: {} in the middle of the volume; worst {} at \
         north {n:.1}, east {e:.1}, height {:.1} m",
        shown(found.middle),
        shown(found.worst),
        -d
    );
    let poor = |[plane, height]: [f64; 2]| plane.max(height) > POOR_DILUTION;
    if poor(found.worst) {
        tracing::warn!(
            "dilution of precision {} at north {n:.1}, east {e:.1}, height {:.1} m, at most \
             {POOR_DILUTION} advised; hang anchors at both ends of every axis, or narrow limits.north_m, \
             limits.east_m, limits.height_m",
            shown(found.worst),
            -d
        );
    } else if let Some((id, without)) = found.needed
        && poor(without)
    {
        tracing::warn!(
            "without anchor {id}, if something hides it, {} at the worst place, at most {POOR_DILUTION} \
             advised; another anchor near it would help most",
            shown(without)
        );
    }
}

/// Nothing flies lower than this, m.
const LOWEST_M: f64 = 0.3;
