//! The page `docs/MODES.md`, from the table of transitions. What a mode or an event is stands here; a new
//! one does not compile before it has words.

use std::fmt::Write as _;

use haltere_pilot::{Event, Mode, Reaction, TABLE};

fn mode_words(mode: Mode) -> &'static str {
    match mode {
        Mode::Disarmed => "Motors off, board disarmed.",
        Mode::Arming => "Arming was asked of the board; waits for its heartbeat to say so.",
        Mode::Idle => "Armed on the floor, no thrust.",
        Mode::Spool => "Thrust rises to just below hover (`flight.spool_s`).",
        Mode::Takeoff => "Climbs over its place (`flight.takeoff_speed_mps`).",
        Mode::Hold => "Stays where it is.",
        Mode::Goto => "Flies to a point that was asked for.",
        Mode::Mission => "Flies the uploaded mission.",
        Mode::Offboard => "Follows setpoints of a client.",
        Mode::Manual => "Follows a joystick, and stays where it is let go.",
        Mode::Return => "Flies back over the place of take-off, then lands.",
        Mode::Land => "Sinks under position control until the floor.",
        Mode::Descend => {
            "Sinks level, on thrust model and barometer, because there is no usable estimate."
        }
        Mode::Yielded => {
            "The board flies in a mode of its own; nothing is sent that it could take for our will."
        }
        Mode::Disarming => "On the floor, disarming was asked of the board.",
    }
}

fn event_words(event: Event) -> &'static str {
    match event {
        Event::ArmAsked => "a client asks to arm, and the checks pass",
        Event::BoardArmed => "the board says that it is armed",
        Event::BoardDisarmed => "the board says that it is not armed",
        Event::ArmFailed => "the board refuses or does not answer",
        Event::DisarmAsked => "a client asks to disarm on the floor, or forces it",
        Event::LiftOffAsked => "a take-off or a mission is wanted",
        Event::SpoolDone => "thrust has risen",
        Event::HeightReached => "the height is reached, nothing else was asked",
        Event::NotLifted => "the time is over and it is not half as high as it should be",
        Event::HeightReachedWithMission => "the height is reached and a mission waits",
        Event::HoldAsked => "a client asks to stay",
        Event::GotoAsked => "a client asks for a point",
        Event::MissionAsked => "a client asks for the mission",
        Event::MissionDone => "the mission's last item is done, in the air",
        Event::OffboardAsked => "a client asks for its setpoints to be followed, and they arrive",
        Event::ManualAsked => "a client asks to fly by its joystick, which speaks",
        Event::ReturnAsked => "a client or the mission asks to come back",
        Event::HomeReached => "over the place of take-off",
        Event::NoWayHome => {
            "the fence bars every straight way to home and rally points, or has held the return back for 3 s"
        }
        Event::LandAsked => "a client asks to land",
        Event::MissionLands => "the mission has come to its landing",
        Event::FloorCarries => "the floor carries the vehicle, which nobody has asked to land",
        Event::TouchDown => "the floor carries the vehicle",
        Event::IdleTooLong => "armed on the floor for too long (`flight.idle_disarm_s`)",
        Event::EstimateBack => "the estimate has been good again for a while",
        Event::ControlBack => "the board is in that mode again",
        Event::SetpointsIgnored => "the board does not fly what it is sent",
        Event::EndAsked => "the program is asked to end (SIGINT, SIGTERM, the system goes down)",
        Event::LandingOverdue => "the landing before that end takes far too long",
        Event::Ordered(Reaction::TakeOver) => "the supervisor orders: manual",
        Event::Ordered(Reaction::Hold) => "the supervisor orders: hold",
        Event::Ordered(Reaction::Return) => "the supervisor orders: return",
        Event::Ordered(Reaction::Land) => "the supervisor orders: land",
        Event::Ordered(Reaction::Descend) => "the supervisor orders: descend",
        Event::Ordered(Reaction::Yield) => "the supervisor finds that the board flies by itself",
        Event::Ordered(Reaction::Disarm) => "the supervisor orders: motors off",
        Event::Ordered(Reaction::Nothing | Reaction::Tell) => "nothing",
    }
}

/// The page.
pub fn page() -> String {
    let mut page = String::from(
        "# Modes\n\n\
         Generated from `pilot::TABLE`; do not edit. Every change of mode is a row of the last table; an \
         event without a row for the mode in force changes nothing. A change is told as STATUSTEXT with \
         its reason, and stands in the log under `/mode`. Why the supervisor orders something is in \
         [SAFETY.md](SAFETY.md); it is told with the condition's own reason.\n\n\
         ## Modes\n\n\
         `custom_mode` is PX4's, main mode << 16 with sub mode << 24, which most clients decode.\n\n\
         | mode | | thrust | position loop | custom_mode |\n|---|---|---|---|---|\n",
    );
    let yes = |b: bool| if b { "yes" } else { "" };
    for mode in Mode::ALL {
        let _ = writeln!(
            page,
            "| {} | {} | {} | {} | {} |",
            mode.name(),
            mode_words(mode),
            yes(mode.has_thrust()),
            yes(mode.is_flying()),
            mode.custom_mode()
        );
    }
    page += "\n## What changes the mode\n\n\
             | when | from | to | told as |\n|---|---|---|---|\n";
    for row in TABLE {
        let from: Vec<_> = row.from.iter().map(|mode| mode.name()).collect();
        let _ = writeln!(
            page,
            "| {} | {} | {} | {} |",
            event_words(row.on),
            from.join(", "),
            row.to.name(),
            row.because
        );
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_modes_page_is_the_table() {
        super::super::check_page("MODES.md", &page());
    }

    #[test]
    fn prop_no_mode_is_forgotten() {
        for row in TABLE {
            for mode in row.from.iter().chain([&row.to]) {
                assert!(Mode::ALL.contains(mode), "{mode:?}");
            }
        }
    }
}
