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
