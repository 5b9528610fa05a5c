//! The survey check before take-off: how often an anchor that stands wrong is named, and how often a sound
//! one.

use std::fmt::Write as _;

use anyhow::{Result, anyhow};
use nalgebra::Vector3;
use rayon::prelude::*;

use haltere_core::frames::{E, Vec3};
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;
use haltere_model::PlantConfig;
use haltere_model::lockstep::{Ground, Lockstep};
use haltere_model::random::Stream;
use haltere_pilot::PilotConfig;

use super::SEED;

/// What is wrong with the survey.
#[derive(Clone, Copy)]
enum Wrong {
    Nothing,
    /// Along the line of sight, either way, m.
    Along(f64),
    /// In any direction, m.
    Anyhow(f64),
}

/// The anchor that was named, and whether it forbade arming; `None`: none.
fn named(seed: u64, id: u8, wrong: Wrong) -> Result<Option<(u8, bool)>> {
    let mut rng = Stream::new(seed, "survey");
    let mut plant = PlantConfig::hall(seed);
    plant.start_E_m = Vec3::new(rng.between(3.0, 7.0), rng.between(3.0, 7.0), 0.0);
    let site = |id: AnchorId| plant.survey.position_E_m(id).map(|p| p.raw());
    let way = if rng.uniform() < 0.5 { -1.0 } else { 1.0 };
    let any = Vector3::from_fn(|_, _| rng.normal()).normalize();
    let told: Vec<(AnchorId, Vec3<E>)> = plant
        .survey
        .ids()
        .iter()
        .filter_map(|at| {
            let p = site(*at)?;
            let along = (p - plant.start_E_m.raw()).normalize();
            let by = match wrong {
                Wrong::Along(m) if at.0 == id => along * (way * m),
                Wrong::Anyhow(m) if at.0 == id => any * m,
                _ => Vector3::zeros(),
            };
            Some((*at, Vec3::from_raw(p + by)))
        })
        .collect();
    let told = Survey::new(&told).map_err(|problems| anyhow!("{problems}"))?;
    let mut pilot = PilotConfig::default();
    pilot.flight.gear_height_m = plant.vehicle.body.gear_m;
    let mut world = Lockstep::new(plant, pilot, &told)?.without_topics();
    let mut ground = Ground::new();
    world.run_until(9_000_000);
    let arm = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let command = haltere_dialect::mav::haltere::MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
    ground.command(&mut world, command, arm);
    ground.listen(&mut world);
    let of = |text: &String| -> Option<u8> {
        let (_, rest) = text.split_once("anchor ")?;
        let (number, rest) = rest.split_once(' ')?;
        rest.starts_with("does not fit").then(|| number.parse().ok())?
    };
    let refused = !world.truth().armed && ground.texts.iter().any(|t| t.contains("refused"));
    let last = ground.texts.iter().rev().find_map(of);
    Ok(last.map(|id| (id, refused)))
}

/// Writes the part of the page.
pub fn write(page: &mut String, n: u64) -> Result<()> {
    writeln!(page, "\n## Survey check before take-off\n\n{ABOUT}\n")?;
    writeln!(page, "| survey | starts | named rightly | wrongly | by anchor, 0 to 7, rightly |")?;
    writeln!(page, "|---|---|---|---|---|")?;
    for (name, wrong) in [
        ("sound", Wrong::Nothing),
        ("an anchor 1 m off along its line of sight", Wrong::Along(1.0)),
        ("0.5 m off along it", Wrong::Along(0.5)),
        ("1 m off in any direction", Wrong::Anyhow(1.0)),
    ] {
        let each = n.div_ceil(2);
        let starts: Vec<(u8, Option<(u8, bool)>)> = (0..8 * each)
            .into_par_iter()
            .map(|i| {
                let id = (i % 8) as u8;
                Ok((id, named(SEED + 500 + i, id, wrong)?))
            })
            .collect::<Result<_>>()?;
        let none = matches!(wrong, Wrong::Nothing);
        let right =
            |(id, named): &&(u8, Option<(u8, bool)>)| !none && named.is_some_and(|(n, _)| n == *id);
        let rightly = starts.iter().filter(right).count();
        let wrongly = starts.iter().filter(|s| s.1.is_some()).count() - rightly;
        let by_anchor: Vec<String> = (0..8u8)
            .map(|id| starts.iter().filter(|s| s.0 == id).filter(right).count().to_string())
            .collect();
        writeln!(
            page,
            "| {name} | {} | {rightly} | {wrongly} | {} |",
            starts.len(),
            if none { "-".to_owned() } else { by_anchor.join(", ") }
        )?;
    }
    Ok(())
}

const ABOUT: &str = "\
A vehicle on the floor, 3 to 7 m north and east, asks to arm 9 s after it was switched on. Named: the
companion says that the anchor does not fit the others, from 0.3 m on; from `supervisor.anchor_misfit_m`
(0.6 m) on it refuses. Only what lies along the line of sight shows: an anchor that stands wrong across it
fits as well as before, and does less harm.";
