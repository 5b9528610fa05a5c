//! Dilution of precision over two cuts through the room: how well the anchors that are heard fix a place.

use serde::Serialize;

use haltere_core::frames::{E, Vec3};
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;

/// Places along each axis of a cut.
const PLACES: usize = 24;
/// Worse than this all looks the same.
const WORST: f64 = 99.0;

/// Limits of what is shown: north, east and height, m.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Box3 {
    /// South and north end.
    pub north_m: [f64; 2],
    /// West and east end.
    pub east_m: [f64; 2],
    /// Lower and upper end.
    pub height_m: [f64; 2],
}

/// Both cuts, each as rows of [`PLACES`] values: position error in all axes for each m of white error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Cuts {
    /// Seen from above at `height_m`: a row for each place north, from the south; in it from west to east.
    pub plan: Vec<f64>,
    /// Seen from the south at `north_m`: a row for each height, from the floor; in it from west to east.
    pub side: Vec<f64>,
    /// Where the first one cuts, m.
    pub height_m: f64,
    /// Where the second one cuts, m.
    pub north_m: f64,
    /// Places along each axis.
    pub places: usize,
}

/// Position error in all axes at a place, for each m of white error of the ranges.
pub(super) fn at(
    survey: &Survey,
    place_E_m: Vec3<E>,
    heard: impl Fn(AnchorId) -> bool,
) -> Option<f64> {
    survey.dilution_of(place_E_m, heard).map(|[plane, height]| plane.hypot(height))
}

/// Cuts through a height and a north coordinate.
pub(super) fn cuts(
    survey: &Survey,
    room: &Box3,
    height_m: f64,
    north_m: f64,
    heard: impl Fn(AnchorId) -> bool,
) -> Cuts {
    let along =
        |[low, high]: [f64; 2], n: usize| low + (high - low) * n as f64 / (PLACES - 1) as f64;
    let value = |north_m, east_m, height_m: f64| {
        let found = at(survey, Vec3::new(north_m, east_m, -height_m), &heard).unwrap_or(WORST);
        (found.min(WORST) * 100.0).round() / 100.0
    };
    let grid = |value: &dyn Fn(usize, usize) -> f64| {
        (0..PLACES * PLACES).map(|n| value(n / PLACES, n % PLACES)).collect()
    };
    Cuts {
        plan: grid(&|i, j| value(along(room.north_m, i), along(room.east_m, j), height_m)),
        side: grid(&|i, j| value(north_m, along(room.east_m, j), along(room.height_m, i))),
        height_m,
        north_m,
        places: PLACES,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_the_middle_is_good_and_fewer_anchors_are_worse() {
        let corners: Vec<_> = (0..8_u8)
            .map(|id| {
                let pick = |bit: u8, far: f64| if id & bit != 0 { far } else { 0.0 };
                (AnchorId(id), Vec3::new(pick(1, 10.0), pick(2, 10.0), pick(4, -7.0)))
            })
            .collect();
        let survey = Survey::new(&corners).unwrap();
        let room = Box3 { north_m: [0.0, 10.0], east_m: [0.0, 10.0], height_m: [0.0, 7.0] };
        let all = cuts(&survey, &room, 3.5, 5.0, |_| true);
        let middle = all.plan[12 * PLACES + 12];
        assert!(middle < 2.0 && all.plan[0] > middle, "{middle} {}", all.plan[0]);
        // A symmetric room: the same from west and east.
        assert!((all.side[5] - all.side[PLACES - 1 - 5]).abs() < 0.02);
        let few = cuts(&survey, &room, 3.5, 5.0, |id| id.0 != 3 && id.0 != 4);
        assert!(few.plan[12 * PLACES + 12] > middle);
        // Three anchors fix nothing.
        let none = cuts(&survey, &room, 3.5, 5.0, |id| id.0 < 3);
        assert!(none.plan.iter().all(|v| (*v - WORST).abs() < 1e-9));
    }
}
