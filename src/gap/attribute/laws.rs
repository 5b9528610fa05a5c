//! What an effect does by other laws than the simulator's.
//!
//! A gust, a loss of thrust or a worn gear follows another law on every vehicle: its argument is the same, its shape is not. What
//! the effects of the library did to the statistics on drawn worlds, each beside the same flight without it, is taught by
//! `haltere-lab worlds --laws`; no world on which the diagnosis is judged is among them.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct Taught {
    /// Names of the statistics.
    statistics: Vec<String>,
    /// What each scatters by on the worlds within an hour, in its unit.
    sigma: Vec<f64>,
    /// By effect: principal directions of what it did on the worlds, each in thousandths of all that it did there.
    did: BTreeMap<String, Vec<Vec<f64>>>,
}

/// What the effect `id` does to the statistics `names` on other vehicles, by other laws, in their units: principal directions, whose
/// squares add up to those of all laws. Zero where that is not known.
pub(super) fn of(id: &str, names: &[String]) -> Vec<Vec<f64>> {
    static TAUGHT: LazyLock<Taught> =
        LazyLock::new(|| serde_json::from_str(include_str!("laws.json")).unwrap_or_default());
    let sigmas = TAUGHT.statistics.iter().zip(&TAUGHT.sigma).enumerate();
    let place: BTreeMap<&str, (usize, f64)> =
        sigmas.map(|(k, (name, sigma))| (name.as_str(), (k, *sigma))).collect();
    let at = |row: &[f64], name: &String| {
        let found = place.get(name.as_str());
        found.and_then(|(k, sigma)| Some(sigma * row.get(*k)?)).unwrap_or(0.0)
    };
    let rows = TAUGHT.did.get(id).map_or(&[][..], Vec::as_slice);
    rows.iter().map(|row| names.iter().map(|name| at(row, name)).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::library::standard;
    use crate::flight::statistics::specs;

    /// What is taught is known by its names: one that is renamed would be forgotten without a word.
    #[test]
    fn prop_what_was_taught_is_of_statistics_and_effects_that_there_are() {
        let names: Vec<String> = specs().iter().map(|spec| spec.name.clone()).collect();
        let taught: Vec<_> = standard().iter().map(|spec| (spec.id, of(spec.id, &names))).collect();
        let known = taught.iter().filter(|(_, rows)| !rows.is_empty()).count();
        assert!(known >= 40, "{known} of {}", taught.len());
        for (id, rows) in taught.iter().filter(|(_, rows)| !rows.is_empty()) {
            let moved = |j: usize| rows.iter().any(|row| row[j] != 0.0);
            let moved = (0..names.len()).filter(|j| moved(*j)).count();
            assert!(moved > 30, "{id} moves {moved} statistics");
        }
        assert!(of("A1", &["other".to_owned()]).iter().flatten().all(|v| *v == 0.0));
    }
}
