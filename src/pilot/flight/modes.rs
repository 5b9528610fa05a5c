//! Modes and the table of their transitions.
//!
//! Every change of mode is a row of [`TABLE`]. An event that has no row for the mode in force
//! changes nothing. What the supervisor orders comes in as one event for each reaction; which condition of
//! its list orders it is told as the reason.

use super::ending::ENDS;
use super::supervisor::Reaction;

/// What the vehicle is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Motors off, board disarmed.
    Disarmed,
    /// Arming was asked of the board.
    Arming,
    /// Armed on the floor, no thrust.
    Idle,
    /// Thrust rises to just below hover.
    Spool,
    /// Climbs over its place.
    Takeoff,
    /// Stays where it is.
    Hold,
    /// Flies to a point that was asked for.
    Goto,
    /// Flies the uploaded mission.
    Mission,
    /// Follows setpoints of a client.
    Offboard,
    /// Follows a joystick, and stays where it is let go.
    Manual,
    /// Flies back over the place of take-off, then lands.
    Return,
    /// Sinks under position control until the floor.
    Land,
    /// Sinks level with reduced thrust because there is no usable estimate.
    Descend,
    /// The board flies in a mode of its own: a remote control or a failsafe of its has taken over.
    /// Nothing is sent that it could take for our will.
    Yielded,
    /// On the floor, disarming was asked of the board.
    Disarming,
}

impl Mode {
    /// Every mode, in the order in which a flight passes through them.
    pub const ALL: [Mode; 15] = [
        Mode::Disarmed,
        Mode::Arming,
        Mode::Idle,
        Mode::Spool,
        Mode::Takeoff,
        Mode::Hold,
        Mode::Goto,
        Mode::Mission,
        Mode::Offboard,
        Mode::Manual,
        Mode::Return,
        Mode::Land,
        Mode::Descend,
        Mode::Yielded,
        Mode::Disarming,
    ];

    /// Name in logs and texts.
    pub fn name(self) -> &'static str {
        match self {
            Mode::Disarmed => "disarmed",
            Mode::Arming => "arming",
            Mode::Idle => "idle",
            Mode::Spool => "spool",
            Mode::Takeoff => "takeoff",
            Mode::Hold => "hold",
            Mode::Goto => "goto",
            Mode::Mission => "mission",
            Mode::Offboard => "offboard",
            Mode::Manual => "manual",
            Mode::Return => "return",
            Mode::Land => "land",
            Mode::Descend => "descend",
            Mode::Yielded => "yielded",
            Mode::Disarming => "disarming",
        }
    }

    /// The mode of a name, as in logs. `None`: no mode of this build.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.name() == name)
    }

    /// PX4's numbers, which most clients decode (STATIONS.md): main mode << 16 | sub mode << 24.
    pub fn custom_mode(self) -> u32 {
        let auto = |sub: u32| 4 << 16 | sub << 24;
        match self {
            Mode::Offboard => 6 << 16,
            Mode::Manual => 3 << 16,
            Mode::Spool | Mode::Takeoff => auto(2),
            Mode::Mission => auto(4),
            Mode::Return => auto(5),
            Mode::Land | Mode::Descend => auto(6),
            Mode::Disarmed
            | Mode::Arming
            | Mode::Idle
            | Mode::Hold
            | Mode::Goto
            | Mode::Yielded
            | Mode::Disarming => auto(3),
        }
    }

    /// Whether the position loop is closed in this mode.
    pub fn is_flying(self) -> bool {
        matches!(
            self,
            Mode::Takeoff
                | Mode::Hold
                | Mode::Goto
                | Mode::Mission
                | Mode::Offboard
                | Mode::Manual
                | Mode::Return
                | Mode::Land
        )
    }

    /// Whether motors may turn.
    pub fn has_thrust(self) -> bool {
        self.is_flying() || matches!(self, Mode::Spool | Mode::Descend)
    }
}

/// What can change the mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A client asked to arm and the checks passed.
    ArmAsked,
    /// The board says that it is armed.
    BoardArmed,
    /// The board says that it is not armed.
    BoardDisarmed,
    /// The board refused or did not answer.
    ArmFailed,
    /// A client asked to disarm on the floor, or forces it.
    DisarmAsked,
    /// A take-off or a mission is wanted.
    LiftOffAsked,
    /// Thrust has risen.
    SpoolDone,
    /// The height of the take-off is reached and nothing else was asked.
    HeightReached,
    /// The take-off's time is over and the vehicle is not half as high as it should be.
    NotLifted,
    /// The height is reached and a mission waits.
    HeightReachedWithMission,
    /// A client asks to stay.
    HoldAsked,
    /// A client asks for a point.
    GotoAsked,
    /// A client asks for the mission.
    MissionAsked,
    /// The mission's last item is done, in the air.
    MissionDone,
    /// A client asks for its setpoints to be followed and they arrive.
    OffboardAsked,
    /// A client asks to fly by its joystick, which speaks.
    ManualAsked,
    /// A client or the mission asks to come back.
    ReturnAsked,
    /// Over the place of take-off.
    HomeReached,
    /// The fence bars every straight way to a place to return to, or the one that is flown.
    NoWayHome,
    /// A client asks to land.
    LandAsked,
    /// The mission has come to its landing.
    MissionLands,
    /// The floor carries a vehicle that is not asked to land.
    FloorCarries,
    /// The floor carries the vehicle.
    TouchDown,
    /// Armed on the floor for too long.
    IdleTooLong,
    /// The estimate has been good again for a while.
    EstimateBack,
    /// Conditions of the supervisor's list hold, and this is the hardest reaction to them.
    Ordered(Reaction),
    /// The board is in the mode again in which it obeys.
    ControlBack,
    /// The board does not fly what it is sent.
    SetpointsIgnored,
    /// Whoever runs the program wants it to end.
    EndAsked,
    /// The landing before the end takes far too long.
    LandingOverdue,
}

use Event as Ev;
use Mode as M;

/// Modes in which the vehicle is in the air under position control.
const AIR: &[Mode] = &[M::Takeoff, M::Hold, M::Goto, M::Mission, M::Offboard, M::Manual, M::Return];
const CALM: &[Mode] = &[M::Hold, M::Goto, M::Mission, M::Offboard, M::Manual, M::Return, M::Land];
const LANDABLE: &[Mode] = AIR;
const FLYING: &[Mode] =
    &[M::Takeoff, M::Hold, M::Goto, M::Mission, M::Offboard, M::Manual, M::Return, M::Land];
const FLYING_OR_DESCENDING: &[Mode] = &[
    M::Takeoff,
    M::Hold,
    M::Goto,
    M::Mission,
    M::Offboard,
    M::Manual,
    M::Return,
    M::Land,
    M::Descend,
];
const ANY_ARMED: &[Mode] = &[
    M::Arming,
    M::Idle,
    M::Spool,
    M::Takeoff,
    M::Hold,
    M::Goto,
    M::Mission,
    M::Offboard,
    M::Manual,
    M::Return,
    M::Land,
    M::Descend,
    M::Yielded,
    M::Disarming,
];

/// Stands for the reason of the condition, which is told instead.
/// Cause of the landing that a mission ends with, apart from every other landing: whether a mission was
/// flown to its end is read from it, in logs of other builds too.
pub const MISSION_LANDS: &str = "the mission lands";
const SUPERVISOR: &str = "by the supervisor";

/// One row: from any of these modes, on this event, to this mode, for this reason.
pub struct Transition {
    /// Modes in which the row holds.
    pub from: &'static [Mode],
    /// What happens.
    pub on: Event,
    /// Mode that follows.
    pub to: Mode,
    /// Told to people and logged.
    pub because: &'static str,
}

const fn row(from: &'static [Mode], on: Event, to: Mode, because: &'static str) -> Transition {
    Transition { from, on, to, because }
}

/// All transitions.
pub static TABLE: &[Transition] = &[
    row(&[M::Disarmed], Ev::ArmAsked, M::Arming, "arming asked"),
    row(&[M::Arming], Ev::BoardArmed, M::Idle, "board armed"),
    row(&[M::Arming], Ev::ArmFailed, M::Disarmed, "board did not arm"),
    row(ANY_ARMED, Ev::BoardDisarmed, M::Disarmed, "board disarmed"),
    row(ANY_ARMED, Ev::DisarmAsked, M::Disarming, "disarming asked"),
    row(&[M::Idle], Ev::IdleTooLong, M::Disarming, "no take-off asked"),
    row(&[M::Idle], Ev::LiftOffAsked, M::Spool, "take-off"),
    row(&[M::Spool], Ev::SpoolDone, M::Takeoff, "thrust is up"),
    row(&[M::Spool], Ev::LandAsked, M::Disarming, "landing asked on the floor"),
    row(&[M::Spool], Ev::HoldAsked, M::Disarming, "hold asked on the floor"),
    // The floor still carries the vehicle: nothing has to be landed.
    row(&[M::Idle, M::Spool], Ev::Ordered(Reaction::Disarm), M::Disarming, SUPERVISOR),
    row(&[M::Takeoff], Ev::HeightReached, M::Hold, "take-off height reached"),
    row(&[M::Takeoff], Ev::HeightReachedWithMission, M::Mission, "take-off height reached"),
    row(&[M::Takeoff], Ev::NotLifted, M::Land, "take-off failed: not enough thrust"),
    row(AIR, Ev::HoldAsked, M::Hold, "hold asked"),
    row(&[M::Land], Ev::HoldAsked, M::Hold, "landing aborted"),
    row(FLYING, Ev::GotoAsked, M::Goto, "point asked"),
    row(CALM, Ev::MissionAsked, M::Mission, "mission asked"),
    row(&[M::Mission], Ev::MissionDone, M::Hold, "mission done"),
    row(FLYING, Ev::OffboardAsked, M::Offboard, "offboard asked"),
    row(FLYING, Ev::ManualAsked, M::Manual, "joystick asked"),
    row(AIR, Ev::ReturnAsked, M::Return, "return asked"),
    row(&[M::Return], Ev::HomeReached, M::Land, "over home"),
    row(&[M::Return], Ev::NoWayHome, M::Land, "the fence bars the way home"),
    row(LANDABLE, Ev::LandAsked, M::Land, "landing asked"),
    row(&[M::Mission], Ev::MissionLands, M::Land, MISSION_LANDS),
    // A take-off that does not come off the floor ends by itself.
    row(
        &[M::Hold, M::Goto, M::Mission, M::Offboard, M::Manual, M::Return],
        Ev::FloorCarries,
        M::Land,
        "it stands on the floor",
    ),
    row(
        &[M::Hold, M::Goto, M::Mission, M::Offboard, M::Return],
        Ev::Ordered(Reaction::TakeOver),
        M::Manual,
        SUPERVISOR,
    ),
    row(
        &[M::Takeoff, M::Goto, M::Mission, M::Offboard, M::Manual],
        Ev::Ordered(Reaction::Hold),
        M::Hold,
        SUPERVISOR,
    ),
    row(
        &[M::Takeoff, M::Hold, M::Goto, M::Mission, M::Offboard, M::Manual],
        Ev::Ordered(Reaction::Return),
        M::Return,
        SUPERVISOR,
    ),
    row(LANDABLE, Ev::Ordered(Reaction::Land), M::Land, SUPERVISOR),
    row(FLYING, Ev::Ordered(Reaction::Descend), M::Descend, SUPERVISOR),
    row(
        &[M::Spool],
        Ev::SetpointsIgnored,
        M::Disarming,
        "board does not give the thrust it is sent",
    ),
    row(FLYING_OR_DESCENDING, Ev::Ordered(Reaction::Yield), M::Yielded, SUPERVISOR),
    // It lies there already.
    row(FLYING_OR_DESCENDING, Ev::Ordered(Reaction::Disarm), M::Disarming, SUPERVISOR),
    row(&[M::Yielded], Ev::ControlBack, M::Hold, "board obeys again"),
    row(&[M::Descend], Ev::EstimateBack, M::Land, "estimate is back"),
    row(&[M::Land, M::Descend], Ev::TouchDown, M::Disarming, "on the floor"),
    row(&[M::Arming, M::Idle, M::Spool], Ev::EndAsked, M::Disarming, ENDS),
    row(AIR, Ev::EndAsked, M::Land, ENDS),
    row(&[M::Land], Ev::LandingOverdue, M::Descend, "the landing takes too long"),
];

/// The row that holds, if any.
pub fn transition(mode: Mode, event: Event) -> Option<&'static Transition> {
    TABLE.iter().find(|row| row.on == event && row.from.contains(&mode))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Mode; 15] = Mode::ALL;

    #[test]
    fn prop_rows_do_not_contradict_each_other() {
        for mode in ALL {
            for row in TABLE.iter().filter(|r| r.from.contains(&mode)) {
                let same =
                    TABLE.iter().filter(|r| r.on == row.on && r.from.contains(&mode)).count();
                assert_eq!(same, 1, "{mode:?} on {:?}", row.on);
            }
        }
    }

    #[test]
    fn prop_every_order_of_the_supervisor_is_followed() {
        for mode in ALL {
            for reaction in Reaction::ALL.into_iter().map(|r| r.in_mode(mode)) {
                let to = transition(mode, Ev::Ordered(reaction)).map(|r| r.to);
                if reaction <= Reaction::Tell {
                    assert_eq!(to, None, "{mode:?}");
                } else {
                    let to = to.unwrap_or_else(|| panic!("{mode:?} on {reaction:?}"));
                    assert_eq!(Reaction::of_mode(to), reaction, "{mode:?}");
                }
            }
        }
        assert!(!M::Yielded.has_thrust() && !M::Yielded.is_flying());
    }

    #[test]
    fn prop_nothing_lifts_off_without_being_armed() {
        assert!(transition(M::Disarmed, Ev::LiftOffAsked).is_none());
        assert!(transition(M::Disarmed, Ev::OffboardAsked).is_none());
        assert!(transition(M::Idle, Ev::OffboardAsked).is_none());
    }

    #[test]
    fn val_custom_modes_are_those_of_px4() {
        // px4_custom_mode.h: main AUTO 4, OFFBOARD 6; AUTO sub TAKEOFF 2, LOITER 3, MISSION 4,
        // RTL 5, LAND 6. The sums are those of STATIONS.md's custom_mode_map.json.
        assert_eq!(M::Hold.custom_mode(), 50_593_792);
        assert_eq!(M::Offboard.custom_mode(), 393_216);
        // POSCTL 3.
        assert_eq!(M::Manual.custom_mode(), 196_608);
        assert_eq!(M::Mission.custom_mode(), 67_371_008);
        assert_eq!(M::Return.custom_mode(), 84_148_224);
        assert_eq!(M::Land.custom_mode(), 100_925_440);
        assert_eq!(M::Takeoff.custom_mode(), 33_816_576);
    }
}
