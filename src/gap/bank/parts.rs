//! A bank in parts, flown anywhere, joined to what one machine makes byte for byte.
//!
//! Every part flies a share of the flights without effect, and a share of the effects once all those are there: draws of an
//! effect have them as twins, and their scatter tells what does nothing. So a part is flown twice by the same command. What
//! it comes to is a piece in the folder of the bank, whole or absent: a part that died is flown again, and nothing else is.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use haltere_model::effects::EffectSpec;

use crate::bank::bank_file::{
    self, BankFileError, DrawOnDisk, Row, draw_from_disk, draw_to_disk, from_disk, to_disk,
};
use crate::bank::kept_file::{self, Kind};
use crate::bank::make_bank::{
    Begun, EffectRows, Made, NullRow, Part, Recipe, begin, end, flights_with, flights_without,
    fly_effects, fly_nulls,
};
use crate::bank::one_flight::End;
use crate::bank::workshop::{WorkshopError, enough, key};

const PIECE: Kind = Kind { what: "piece of a bank", magic: b"HALTPIEC", version: 1 };

/// The two times that a part is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Flights without effect.
    Healthy,
    /// Flights with one.
    Effects,
}

impl Stage {
    const ALL: [Self; 2] = [Self::Healthy, Self::Effects];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Healthy => "flights without effect",
            Self::Effects => "effects",
        }
    }
}

/// How far the parts of a bank are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Standing {
    /// Of which flights.
    pub stage: Stage,
    /// Parts whose piece is there.
    pub there: usize,
    /// Of how many.
    pub of: usize,
}

/// The pieces of one bank.
struct Pieces<'a> {
    folder: &'a Path,
    key: String,
    of: usize,
}

impl Pieces<'_> {
    fn path(&self, stage: Stage, number: usize) -> PathBuf {
        let stage = match stage {
            Stage::Healthy => "healthy",
            Stage::Effects => "effects",
        };
        let Self { folder, key, of } = self;
        folder.join(format!("{key}.{stage}-{number}-of-{of}.piece"))
    }

    fn standing(&self, stage: Stage) -> Standing {
        let there = (1..=self.of).filter(|number| self.path(stage, *number).exists()).count();
        Standing { stage, there, of: self.of }
    }

    /// Flights without effect of a part; `None`: the piece is not there, or damaged, which is said.
    fn healthy(&self, number: usize) -> Option<Vec<NullRow>> {
        let rows: Vec<Result<Row, End>> =
            kept_file::recall(PIECE, &self.path(Stage::Healthy, number))?;
        Some(rows.into_iter().map(|row| row.map(from_disk)).collect())
    }

    /// Draws of the effects of a part, likewise.
    fn effects(&self, number: usize) -> Option<Vec<EffectRows>> {
        let effects: Vec<Vec<Option<DrawOnDisk>>> =
            kept_file::recall(PIECE, &self.path(Stage::Effects, number))?;
        let draws = |effect: Vec<Option<DrawOnDisk>>| {
            effect.into_iter().map(|draw| draw.map(draw_from_disk)).collect()
        };
        Some(effects.into_iter().map(draws).collect())
    }

    /// A stage of all parts in the order of its list; an error names the parts of which it is not there.
    fn all<T>(
        &self,
        stage: Stage,
        piece: impl Fn(usize) -> Option<Vec<T>>,
    ) -> Result<Vec<T>, WorkshopError> {
        let (mut parts, mut missing) = (Vec::new(), Vec::new());
        for number in 1..=self.of {
            match piece(number) {
                Some(part) => parts.push(part),
                None => missing.push(number.to_string()),
            }
        }
        if missing.is_empty() {
            return Ok(dealt_back(parts));
        }
        let (folder, missing) = (self.folder.to_owned(), missing.join(", "));
        Err(WorkshopError::Parts { folder, what: stage.words(), of: self.of, missing })
    }
}

/// The list of which the parts hold every n-th.
fn dealt_back<T>(parts: Vec<Vec<T>>) -> Vec<T> {
    let mut parts: Vec<_> = parts.into_iter().map(Vec::into_iter).collect();
    let mut all = Vec::new();
    for n in (0..parts.len()).cycle() {
        match parts[n].next() {
            Some(next) => all.push(next),
            None => return all,
        }
    }
    all
}

fn pieces<'a>(folder: &'a Path, recipe: &Recipe<'_>, of: usize) -> Pieces<'a> {
    let library: &[&'static EffectSpec] = recipe.library;
    let key = key(recipe.scene, recipe.items, library, recipe.size);
    Pieces { folder, key, of }
}

fn begun(recipe: &Recipe<'_>, healthy: Vec<NullRow>) -> Result<Begun, WorkshopError> {
    let begun = begin(recipe, healthy);
    enough(recipe, begun.bank.jitter.len(), || begun.ends())?;
    Ok(begun)
}

/// Flies what of a part can be flown and is not there: how far the parts then are.
pub fn fly(
    folder: &Path,
    recipe: &Recipe<'_>,
    part: Part,
    progress: impl Fn(usize, usize) + Sync,
) -> Result<Standing, WorkshopError> {
    std::fs::create_dir_all(folder)
        .map_err(|source| WorkshopError::Folder { path: folder.to_owned(), source })?;
    let pieces = pieces(folder, recipe, part.of);
    let done = AtomicUsize::new(0);
    let count = |of: usize| {
        let (done, progress) = (&done, &progress);
        move || progress(1 + done.fetch_add(1, Ordering::Relaxed), of)
    };
    if pieces.healthy(part.number).is_none() {
        let rows = fly_nulls(recipe, part, &count(flights_without(recipe, part)));
        let rows: Vec<Result<Row, End>> =
            rows.into_iter().map(|row| row.map(|row| to_disk(&row))).collect();
        kept_file::write(PIECE, &pieces.path(Stage::Healthy, part.number), &rows)
            .map_err(BankFileError::from)?;
    }
    let Ok(healthy) = pieces.all(Stage::Healthy, |number| pieces.healthy(number)) else {
        return Ok(pieces.standing(Stage::Healthy));
    };
    if pieces.effects(part.number).is_none() {
        done.store(0, Ordering::Relaxed);
        let begun = begun(recipe, healthy)?;
        let flown = fly_effects(recipe, &begun, part, &count(flights_with(recipe, part)));
        let draws = |effect: &EffectRows| -> Vec<Option<DrawOnDisk>> {
            effect.iter().map(|draw| draw.as_ref().map(draw_to_disk)).collect()
        };
        let flown: Vec<_> = flown.iter().map(draws).collect();
        kept_file::write(PIECE, &pieces.path(Stage::Effects, part.number), &flown)
            .map_err(BankFileError::from)?;
    }
    Ok(pieces.standing(Stage::Effects))
}

/// Joins the pieces of so many parts to the bank, which is kept where one that was flown at once is. The pieces are then
/// no longer needed, and gone.
pub fn join(folder: &Path, recipe: &Recipe<'_>, of: usize) -> Result<Made, WorkshopError> {
    let pieces = pieces(folder, recipe, of);
    let healthy = pieces.all(Stage::Healthy, |number| pieces.healthy(number))?;
    let effects = pieces.all(Stage::Effects, |number| pieces.effects(number))?;
    let made = end(begun(recipe, healthy)?, effects);
    bank_file::write(&folder.join(format!("{}.bank", pieces.key)), &made.bank)?;
    for stage in Stage::ALL {
        for number in 1..=of {
            // What cannot be taken away is in nobody's way.
            let _ = std::fs::remove_file(pieces.path(stage, number));
        }
    }
    Ok(made)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::make_bank::{BankSize, make};
    use crate::bank::{library, missions};
    use crate::scene::Scene;

    #[test]
    fn prop_parts_are_dealt_back_into_their_order() {
        for of in 1..6 {
            let dealt = |number| {
                let part = Part { number, of };
                (0..13).filter(|k| part.holds(*k)).collect()
            };
            assert!(dealt_back((1..=of).map(dealt).collect()).into_iter().eq(0..13), "{of}");
        }
        assert_eq!("2/8".parse(), Ok(Part { number: 2, of: 8 }));
        for wrong in ["0/8", "9/8", "1/0", "1", "x/2", "1/1001"] {
            assert!(wrong.parse::<Part>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn prop_parts_join_to_the_bytes_of_a_bank_flown_at_once_and_a_lost_piece_is_flown_again() {
        let scene = Scene::lab().unwrap();
        let items = missions::plain(&scene);
        let library: Vec<_> =
            library::standard().into_iter().filter(|s| ["P1", "U2"].contains(&s.id)).collect();
        let size = BankSize { seeds: 1, jitter: 12, draws: 6 };
        let recipe = Recipe { scene: &scene, items: &items, library: &library, size, seed: 1 };
        let at_once = tempfile::tempdir().unwrap();
        let whole = at_once.path().join("whole.bank");
        bank_file::write(&whole, &make(&recipe, |_, _| {}).bank).unwrap();

        let folder = tempfile::tempdir().unwrap();
        let fly = |number: usize| {
            let part = Part { number, of: 2 };
            super::fly(folder.path(), &recipe, part, |_, _| {}).unwrap()
        };
        let standing = |stage, there| Standing { stage, there, of: 2 };
        assert_eq!(fly(2), standing(Stage::Healthy, 1));
        let said = join(folder.path(), &recipe, 2).unwrap_err().to_string();
        assert!(said.contains("without effect of parts 1"), "{said}");
        // Here the first finds all that it waits for.
        assert_eq!(fly(1), standing(Stage::Effects, 1));
        assert_eq!(fly(2), standing(Stage::Effects, 2));
        let pieces = pieces(folder.path(), &recipe, 2);
        std::fs::write(pieces.path(Stage::Effects, 1), b"HALTPIEC and half of it").unwrap();
        assert!(join(folder.path(), &recipe, 2).is_err(), "half a piece is none");
        fly(1);
        join(folder.path(), &recipe, 2).unwrap();
        let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().flatten().collect();
        assert_eq!(left.len(), 1, "{left:?}");
        let joined = std::fs::read(left[0].path()).unwrap();
        assert!(joined == std::fs::read(whole).unwrap(), "another bank");
    }
}
