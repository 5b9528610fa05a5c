//! Statistics: from a flight to its vector of numbers, each tagged with block and channel.

use std::sync::OnceLock;

use crate::flight::cells::{Cell, cells, channels};
use crate::flight::residuals::{
    Flight, Sheet, attitude, battery, bias, force, loops, servos, timing, uwb,
};
use crate::flight::timeline::STEP_S;
use crate::flight::trace::Trace;
use crate::nominal::Nominal;
use haltere_core::measure::AnchorId;

pub use crate::flight::residuals::{Channel, StatSpec};
pub use crate::flight::timeline::NotObservable;

/// Kinds of anchor error whose worst anchor [`Observation::anchors`] names, in order.
pub const ANCHOR_SLOTS: [&str; 5] = ["bias", "place", "drift", "low", "zone"];

/// What was observed of a flight.
#[derive(Debug, Clone)]
pub struct Observation {
    /// In the order of [`specs`]; NaN: not visited on this flight.
    pub statistics: Vec<f64>,
    /// The worst anchor by each kind of [`ANCHOR_SLOTS`].
    pub anchors: Vec<AnchorId>,
    /// Means by channel, regime, time, place and anchor.
    pub cells: Vec<Cell>,
    /// Time in the air that was looked at, s.
    pub span_s: f64,
}

/// The fixed list.
pub fn specs() -> &'static [StatSpec] {
    static LIST: OnceLock<Vec<StatSpec>> = OnceLock::new();
    LIST.get_or_init(|| {
        let mut sheet = Sheet::default();
        fill(None, &mut sheet);
        sheet.specs
    })
}

/// The statistics of a flight alone, which is all that a bank keeps of it.
pub fn statistics_of(trace: &Trace, nominal: &Nominal) -> Result<Vec<f64>, NotObservable> {
    let flight = Flight::new(trace, nominal)?;
    Ok(statistics_by(&flight, &uwb::residuals(&flight)))
}

/// The same from its residuals.
pub fn statistics_by(flight: &Flight<'_>, rows: &uwb::Rows) -> Vec<f64> {
    filled(flight, rows).0
}

/// Observes a flight.
pub fn observe(trace: &Trace, nominal: &Nominal) -> Result<Observation, NotObservable> {
    let flight = Flight::new(trace, nominal)?;
    let rows = uwb::residuals(&flight);
    let (statistics, anchors) = filled(&flight, &rows);
    let span_s = flight.clear_points().count() as f64 * STEP_S;
    let cells = cells(&flight, &rows, &channels(&flight, &rows));
    Ok(Observation { statistics, anchors, cells, span_s })
}

fn filled(flight: &Flight<'_>, rows: &uwb::Rows) -> (Vec<f64>, Vec<AnchorId>) {
    let mut sheet = Sheet::default();
    let anchors = fill(Some((flight, rows)), &mut sheet);
    (sheet.values, anchors)
}

fn fill(f: Option<(&Flight<'_>, &uwb::Rows)>, sheet: &mut Sheet) -> Vec<AnchorId> {
    let flight = f.map(|(flight, _)| flight);
    force::put(flight, sheet);
    attitude::put(flight, sheet);
    servos::put(flight, sheet);
    battery::put(flight, sheet);
    bias::put(flight, sheet);
    let anchors = uwb::put(f, sheet);
    timing::put(flight, sheet);
    loops::put(flight, sheet);
    anchors
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_names_are_unique_and_the_list_is_of_a_sensible_length() {
        let specs = specs();
        let mut names: Vec<_> = specs.iter().map(|s| s.name.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), specs.len());
        assert!((150..=270).contains(&specs.len()), "{}", specs.len());
    }
}
