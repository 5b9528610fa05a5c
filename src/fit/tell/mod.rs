//! From files to answers: one file per `haltere fit …`, which takes what it needs from the sources,
//! hands it to a pure core, and says what came of it in words, tables, plots and configuration.

pub mod anchors;
pub mod carry_over;
pub mod drag;
pub mod ground;
pub mod imu;
pub mod lag;
#[cfg(test)]
mod tests_recorded;
pub mod thrust;

use crate::fit::outcome::Refusal;
use crate::fit::programs::Program;
use crate::fit::source::Source;
use crate::report::flight::Flight;
use haltere_pilot::settings::Config;

/// Time between two flights that are fitted together, s: nothing lasts so long.
const APART_S: f64 = 1e4;
/// Sizes of a plot, pixels.
const PLOT_PX: [f64; 2] = [560.0, 320.0];

/// Our own logs among the sources; anything else cannot hold what is asked.
fn logs(sources: &[Source], program: Program) -> Result<Vec<(&Flight, &Config)>, Refusal> {
    sources
        .iter()
        .map(|source| match source {
            Source::Log { flight, config, .. } => Ok((flight.as_ref(), config.as_ref())),
            other => Err(Refusal::WrongKind {
                why: format!(
                    "{} is {}, which does not hold what `fit {}` needs: give our own log",
                    other.name(),
                    other.kind(),
                    program.name()
                ),
            }),
        })
        .collect()
}
