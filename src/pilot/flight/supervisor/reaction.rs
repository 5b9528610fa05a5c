//! What the supervisor can do, from the mildest to the hardest, and what of it a mode still needs.

use serde::{Deserialize, Serialize};

use crate::flight::modes::Mode;

/// A reaction. The order is the order of hardness: of several the hardest wins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Reaction {
    /// Nothing: the condition does not exist in this mode.
    Nothing,
    /// People are told; the flight goes on.
    Tell,
    /// The joystick flies.
    TakeOver,
    /// The vehicle stays where it is.
    Hold,
    /// It flies home and lands.
    Return,
    /// It lands here under position control.
    Land,
    /// It comes down level, on barometer and thrust model, without the estimate.
    Descend,
    /// The board flies by itself and is not fought.
    Yield,
    /// On the floor: motors off.
    Disarm,
}

impl Reaction {
    /// All of them, the mildest first.
    pub const ALL: [Reaction; 9] = [
        Reaction::Nothing,
        Reaction::Tell,
        Reaction::TakeOver,
        Reaction::Hold,
        Reaction::Return,
        Reaction::Land,
        Reaction::Descend,
        Reaction::Yield,
        Reaction::Disarm,
    ];

    /// Name on pages.
    pub fn name(self) -> &'static str {
        match self {
            Reaction::Nothing => "",
            Reaction::Tell => "tell",
            Reaction::TakeOver => "manual",
            Reaction::Hold => "hold",
            Reaction::Return => "return",
            Reaction::Land => "land",
            Reaction::Descend => "descend",
            Reaction::Yield => "yield",
            Reaction::Disarm => "disarm",
        }
    }

    /// What a mode already does, as a reaction: what is milder need not be ordered any more.
    pub fn of_mode(mode: Mode) -> Reaction {
        match mode {
            Mode::Disarmed | Mode::Arming | Mode::Idle | Mode::Spool => Reaction::Nothing,
            Mode::Takeoff | Mode::Goto | Mode::Mission | Mode::Offboard => Reaction::Tell,
            Mode::Manual => Reaction::TakeOver,
            Mode::Hold => Reaction::Hold,
            Mode::Return => Reaction::Return,
            Mode::Land => Reaction::Land,
            Mode::Descend => Reaction::Descend,
            Mode::Yielded => Reaction::Yield,
            Mode::Disarming => Reaction::Disarm,
        }
    }

    /// What a condition that wants this comes to in a mode: on the floor nothing has to be landed, and
    /// whatever already does more goes on.
    pub fn in_mode(self, mode: Mode) -> Reaction {
        match mode {
            _ if self <= Reaction::Tell => self,
            Mode::Disarmed | Mode::Arming | Mode::Disarming => Reaction::Tell,
            Mode::Idle if self >= Reaction::Yield => Reaction::Disarm,
            Mode::Idle => Reaction::Tell,
            Mode::Spool if self >= Reaction::Hold => Reaction::Disarm,
            Mode::Spool => Reaction::Tell,
            // Sticks are an order, not a danger: they also end what is calmer than they are.
            Mode::Hold | Mode::Return if self == Reaction::TakeOver => Reaction::TakeOver,
            Mode::Takeoff if self == Reaction::TakeOver => Reaction::Tell,
            _ if self <= Reaction::of_mode(mode) => Reaction::Tell,
            // What the board flies by itself is not cut by us.
            Mode::Yielded => Reaction::Tell,
            _ => self,
        }
    }
}

/// A reaction that the configuration can choose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Action {
    /// People are told.
    Tell,
    /// Stay.
    Hold,
    /// Fly home and land.
    Return,
    /// Land here.
    Land,
}

impl Action {
    /// As a reaction.
    pub fn reaction(self) -> Reaction {
        match self {
            Action::Tell => Reaction::Tell,
            Action::Hold => Reaction::Hold,
            Action::Return => Reaction::Return,
            Action::Land => Reaction::Land,
        }
    }
}

haltere_core::choices!(Action: Tell "tell", Hold "hold", Return "return", Land "land");
