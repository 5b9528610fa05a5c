//! One flight of the suite: flown in lockstep, written as the companion's own flight log.

use std::path::Path;

use anyhow::Result;
use haltere::taped::{self, Outcome};
use haltere_gap::bank::missions;
use haltere_gap::scene::Scene;

use super::list::Mission;
use crate::generator::{Foreign, Setup};

/// Flies and writes `path`; nothing stands there unless the log is whole.
pub fn record(scene: &Scene, setup: Setup, mission: Mission, path: &Path) -> Result<Outcome> {
    let items = match mission {
        Mission::Diagnostic => missions::diagnostic(scene),
        Mission::HeldOut => missions::held_out(scene),
        Mission::Plain => missions::plain(scene),
    };
    taped::record(scene, Foreign::new(setup), &items, path)
}
