//! What a part wants changed in another one. `Pilot` grants it in order, as soon as the call returns (`schedule/grant`).

use crate::flight::modes::Mode;

/// A change of another part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Wish {
    /// Board: disarm, now or after the order that is under way.
    Disarm { force: bool, later: bool },
    /// Navigation: the vehicle is in the air, or on the floor.
    Airborne(bool),
    /// Navigation: the mode has changed, and what was felt of the floor counts for the one before.
    FeelAnew { from: Mode, to: Mode },
    /// Navigation: what was felt of a fall is from before a pause.
    ForgetFall,
    /// Navigation: the vehicle follows so late on its way down, s.
    DownLate { lag_s: f64 },
    /// Navigation: near the floor thrust stays where it is.
    HoldThrustNearFloor,
    /// Navigation: near the floor no more thrust than one has that stands.
    StayDownNearFloor,
}
