//! Shrink over the suite: what was named, the true effect, and retuned constants, on held-out flights.
//! The model flies whole missions: a flight, diagnosed or held out, that ended early has no part in it.

use std::path::Path;

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;

use haltere_gap::bank::archive::Shelf;
use haltere_gap::bank::library;
use haltere_gap::diagnosis::observed;
use haltere_gap::flight::logs;
use haltere_gap::nominal::Nominal;
use haltere_gap::scene::{Scene, Told};
use haltere_gap::shrink::held_out::{HeldOut, SEARCH_FLIGHTS, SHRINK_FLIGHTS};
use haltere_gap::shrink::resize::resize;
use haltere_gap::shrink::{Paired, Shrink};
use haltere_model::effects::EffectSpec;

use super::{Answer, BlindError, Entry, Key, Public};
use crate::retune::{Retuning, borrowed};

/// Scene and mission of a log.
struct Stage {
    scene: Scene,
    items: Vec<MISSION_ITEM_INT_DATA>,
    references: Vec<Vec<f64>>,
}

impl Stage {
    fn new(
        dir: &Path,
        told: &Told,
        log: &str,
        healthy: impl Iterator<Item = String>,
    ) -> Result<Self, BlindError> {
        let flown = logs::read(&dir.join(log))?;
        let scene = flown.scene(told).on_grid();
        let nominal = Nominal::of_scene(&scene);
        let references = healthy
            .filter_map(|log| {
                let flown = logs::read(&dir.join(log)).ok()?;
                observed(flown, &nominal).observation.ok().map(|o| o.statistics)
            })
            .collect();
        Ok(Self { scene, items: flown.mission.clone(), references })
    }

    fn model(&self) -> HeldOut<'_> {
        HeldOut::new(&self.scene, &self.items, &self.references, &Shelf::none())
    }
}

/// What was measured on held-out flights.
pub(super) struct Shrunk {
    pub named: Shrink,
    pub right: Shrink,
    pub retuned: Shrink,
    pub unhelpful: usize,
    pub flights: Vec<(String, String, [f64; 4])>,
}

/// Shrink with what was named, with the true effect fitted, and with constants retuned: the size is searched on the diagnosed
/// flight, the shrink measured on the held-out one.
#[allow(clippy::too_many_arguments)] // one caller, and every part is another thing
pub(super) fn shrunk(
    dir: &Path,
    told: &Told,
    public: &[Public],
    chosen: &[Entry],
    keys: &[Key],
    answers: &[Answer],
    seen: &[Option<[Vec<f64>; 2]>],
    tell: &(impl Fn(String) + Sync),
) -> Result<Shrunk, BlindError> {
    let diagnostic = |c: &&Entry| c.mission == "diagnostic" && c.held_out_log.is_some();
    let Some(first) = chosen.iter().find(diagnostic) else {
        return Err(BlindError::Empty(dir.to_owned()));
    };
    let log = first.held_out_log.clone().unwrap_or_default();
    let held_out = Stage::new(dir, told, &log, public.iter().map(|c| c.held_out.clone()))?;
    let fitted_on = Stage::new(dir, told, &first.log, public.iter().map(|c| c.diagnostic.clone()))?;
    let (model, fit) = (held_out.model(), fitted_on.model());
    let spec = |id: &str| library::standard().into_iter().find(|s| s.id == id);
    tell("shrink: what the constants of the model do".to_owned());
    let retuning = Retuning::learn(&fit, |done, of| {
        if done.is_multiple_of(10) || done == of {
            tell(format!("shrink: {done} of {of} constants"));
        }
    });
    let (mut named, mut right, mut retuned) = (Vec::<Paired>::new(), Vec::new(), Vec::new());
    let (mut unhelpful, mut flights) = (0, Vec::new());
    let of = keys.iter().filter(|key| key.class == "single").count();
    let mut done = 0;
    for ((key, answer), seen) in keys.iter().zip(answers).zip(seen) {
        let (Some(attribution), Some([diagnosed, real])) = (&answer.attribution, seen) else {
            continue;
        };
        let [effect] = &key.effects[..] else { continue };
        if key.class != "single" {
            continue;
        }
        let flown = |spec: &EffectSpec, theta: &[f64]| -> (Paired, bool) {
            match resize(|e| fit.off(diagnosed, e, SEARCH_FLIGHTS), fit.vehicle(), spec, theta) {
                Some((_, theta)) => (model.paired(real, &[(spec, &theta)], SHRINK_FLIGHTS), true),
                None => (model.paired(real, &[], SHRINK_FLIGHTS), false),
            }
        };
        let mut of_named: Option<(String, Paired)> = None;
        let mut with_truth = f64::NAN;
        if let Some(first) = attribution.outcome.effects().first()
            && let Some(spec) = spec(&first.id)
        {
            let (paired, helps) = flown(spec, &first.theta);
            unhelpful += usize::from(!helps);
            named.push(paired.clone());
            of_named = Some((first.id.clone(), paired));
        }
        if let Some(fitted) = attribution.candidates.iter().find(|c| c.id == effect.id)
            && let Some(spec) = spec(&effect.id)
            && !fitted.theta.is_empty()
        {
            right.push(match &of_named {
                Some((id, paired)) if *id == effect.id => paired.clone(),
                _ => flown(spec, &fitted.theta).0,
            });
            with_truth = right.last().map_or(f64::NAN, |p| model.distances(p)[1]);
        }
        let constants = retuning.fit(&fit, diagnosed);
        let last = model.paired(real, &borrowed(&constants), SHRINK_FLIGHTS);
        let [before, with_constants] = model.distances(&last);
        let with_named = of_named.as_ref().map_or(f64::NAN, |(_, p)| model.distances(p)[1]);
        let said = of_named.map_or_else(|| "-".to_owned(), |(id, _)| id);
        let row = [before, with_named, with_truth, with_constants];
        flights.push((effect.id.clone(), said, row));
        retuned.push(last);
        done += 1;
        if done % 5 == 0 || done == of {
            tell(format!("shrink: {done} of {of} cases"));
        }
    }
    Ok(Shrunk {
        named: model.shrink(&named),
        right: model.shrink(&right),
        retuned: model.shrink(&retuned),
        unhelpful,
        flights,
    })
}
