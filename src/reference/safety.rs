//! The page `docs/SAFETY.md`, from the supervisor's list of conditions and the arming checks.

use std::fmt::Write as _;

use haltere_pilot::{AT_REST, CONDITIONS, Condition, Mode, Number, PilotConfig, Reaction};

/// Columns of the table of reactions, each for modes that mostly react alike; arming and disarming are said in words.
const COLUMNS: [(&str, &[Mode]); 4] = [
    ("disarmed, idle", &[Mode::Disarmed, Mode::Idle]),
    ("spool", &[Mode::Spool]),
    (
        "in flight",
        &[
            Mode::Takeoff,
            Mode::Hold,
            Mode::Goto,
            Mode::Mission,
            Mode::Offboard,
            Mode::Manual,
            Mode::Return,
            Mode::Land,
        ],
    ),
    ("descend, yielded", &[Mode::Descend, Mode::Yielded]),
];

const HEAD: &str = "\
# Safety

A program writes this page from its own list of conditions. In every control step (100 Hz) the supervisor walks the list of conditions \
below. What it finds is told, and the hardest of all reactions is flown. Nothing else ends a flight but the orders of clients, \
the mission itself ([MODES.md](MODES.md)) and the end of the program (below). A station may change most numbers \
([CONFIGURATION.md](CONFIGURATION.md), parameters `SUP_` and `LIM_`).

## The ways down

```text
              in flight: takeoff, hold, goto, mission, offboard, manual
       │                    │                     │                      │
       │ return             │ land                │ descend              │ yield
       ▼                    ▼                     ▼                      ▼
    return ──over home──► land ──no estimate──► descend               yielded
    flies home            under position        level, by thrust      the board
                          control               and barometer         flies by itself
                            │  ◄─estimate good──  │
                            │      for 0.3 s      │
                            ▼                     ▼
                          the floor carries the vehicle
                                       │
                                       ▼
                          disarming ──► disarmed

    milder   tell < manual < hold < return < land < descend < yield   harder
```

A reaction leads from any box to a harder one at once, and never to a milder one. A client may order the vehicle out of a return or a \
landing, but not out of a descent. Motors are cut by **disarm** alone: in the spool-up, and later only of a vehicle that lies on the floor \
([tipped_over](#tipped_over)). A forced order to disarm cuts them anywhere.

| reaction | what the vehicle does |
|---|---|
| tell | the flight goes on; STATUSTEXT, event and health bit say what is wrong |
| manual | the joystick flies: a person wishes it, so what a fault asks for is harder |
| hold | the vehicle stays where it is, inside the walls |
| return | flies home (or to a rally point that is nearer) and lands |
| land | lands here under position control, by dead reckoning if need be; from outside the walls back inside |
| descend | sinks level by the board's attitude, on thrust model and barometer, at 0.8 m/s and below 1.2 m at 0.45 m/s; without a \
barometer at 92 % of the hover thrust |
| yield | the board flies by itself; nothing is sent that it could fly by |
| disarm | motors off |

### What beats what

* Exactly one reaction is flown, the hardest that is wanted. The first condition in the list that wants it gives the reason.
* What the vehicle already does goes on if it is harder: a landing is not turned into a return.
* While a condition holds, a milder order is refused with the reason. Harder orders and forced disarming are always taken.
* When a condition ends, its mode stays in force until a client orders another. Only a **descend** becomes a landing by itself, when \
nothing asks for it any more and the estimate has been good for 0.3 s. An estimate that was contradicted is not taken back before \
the vehicle is disarmed.
* In the spool-up the floor still carries the vehicle: every reaction from **hold** on is **disarm** there.
* A pause of the companion is no silence of others. When two control steps were more than 0.05 s apart, the pause does not count in the \
silence of IMU, board and client for the next 0.05 s, because what came meanwhile may wait to be read. Only the newest pause is taken \
off, so a loop that pauses again and again hides no silence.

### Near the floor

What a landing or a descent has found of the floor holds for the other too, and only an accelerometer that shows a fall takes it back. \
Base thrust is what hovers at the present voltage; \"near the floor\" is so by the estimate or by the barometer.

| what is seen | what follows |
|---|---|
| a descent comes near the floor, or something holds it up for 1 s | the floor is felt for with the accelerometer. Without one thrust \
goes down slowly where something holds the vehicle up near the floor, and fades out when the floor must have come |
| thrust below 62 % of the base near the floor, and the specific force is gravity's all the same | the floor carries: thrust is lowered to \
none, whatever the estimate says |
| the accelerometer shows that something stopped a descent near the floor | thrust stays at or below 80 % of the base, which does not lift \
the vehicle off |
| an estimate comes back below 0.8 m | it is not flown on any more |
| the floor is felt for, or a landing has come to 0.3 m by the estimate | no order to fly is taken |
| a landing near the floor becomes a descent, or its estimate is not measured any more | no more thrust than it had; without an accelerometer \
thrust is lowered from there, and the motors are off after 2.5 s |
| in any mode, thrust averaged over 1 s is below 70 % of what hovers near the floor, and the specific force is gravity's | the vehicle \
stands: it lands (\"it stands on the floor\") within 4 s in lockstep, within 12 s where the height that was asked for is the one \
that is estimated there. A climb that is asked for until then lifts it off, later it takes off anew |

The last row is needed because the estimate is up to half a metre too high near the floor, where a low height that somebody asks for may press \
the vehicle onto it.
";

/// Between conditions and arming checks.
const BOARD: &str = "
## What is believed of the board

* **Disarmed** is believed when two heartbeats say so that are at least 0.5 s apart, or one after the board has \
acknowledged a disarm command of ours. Until then setpoints go on: a single heartbeat may be damaged, or a \
stranger's with the board's number. When the board then says that it is armed after all, it is flown on only in the \
air (more than 0.1 m by our height), in the mode in which it obeys, after a single denial, and if nobody asked it to \
disarm; on the floor it is disarmed. Two denials end the flight for good: a person's kill switch wins, and only arming \
through us begins another one.
* **One board** is heard and spoken to: [second_board](#second_board).
* **The flight pack** is chosen among several batteries, on the floor: one whose `battery_function` is all or \
propulsion before one that does not say, that before one for something else, then the lowest id. The choice is told and \
stays in flight; the others are recorded (`/other_battery`) and shown, not flown on. Of inertial sensors, barometers and \
magnetometers with an instance id the first healthy one is used; another one takes its place on the floor only, when \
that is silent for 2 s.
* **MAV_CMD_INJECT_FAILURE** is passed on to a board that stands disarmed only, and answered with its answer. Give a \
simulator that flies its faults at an endpoint of its own (`haltere-sim serve --orders`).
* **Frames that are routed to the board** (`ground.routing = \"board\"`) while we are in control: of commands those that \
ask for messages, and for streams that we do not fly by. Every other command is kept back, known or not.
";

/// Before the rows of what is known at rest.
const AT_REST_HEAD: &str = "
## What is known at rest

These rows are asked in this order when a client asks to arm. The first that lets nothing fly is the answer; all are reported as \
health. Forced arming skips none. What can be flown with is told to whoever arms, with what was measured (`at rest: …`). All rows but \
the board's are asked again when the motors are to turn. `haltere check --live` looks at the rows marked *live* too.

| quantity | must be, and how well | looked at | said, and the way out | follows |
|---|---|---|---|---|
";

const TAIL: &str = "
## When the program is to end

Neither a signal nor a closed terminal nor a reader of the output that is gone ends a flight:

| what | while the vehicle is armed | disarmed |
|---|---|---|
| SIGINT (Ctrl-C), SIGTERM (`systemctl stop`, the system goes down), SIGQUIT | it lands here, disarms, closes its log and \
ends; stations hear \"haltere is asked to end: it lands first\" | ends |
| two of these 0.5 to 2 s apart, whenever they come | ends at once; the board's own failsafe is in charge (exit code 130) | ends \
at once |
| SIGXCPU (a limit on processor time) | as SIGTERM, once | ends |
| SIGHUP (the terminal or ssh is gone), SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGIO, SIGPWR, SIGSTKFLT | \
nothing | ends |
| SIGTSTP (Ctrl-Z) | nothing | the program stands still until SIGCONT |
| SIGXFSZ (a limit on the size of files) | the write fails as on a full disk: the flight goes on without a log (`log_stopped`) | the same |
| SIGTTOU, SIGTTIN, SIGPIPE | nothing | nothing |
| output that nobody reads (a stopped terminal, a full pipe), or whose reader is gone | lines are lost, counted as \
`output_line_lost`, told to stations once and in the output where the gap is | the same |

* On the way to its end the program takes no order that is milder than a landing, and does not arm. Landing, disarming and termination \
are taken, and what the supervisor orders. Who wants the vehicle elsewhere flies it there first.
* A landing that takes longer than twice its time and 10 s becomes a descent. A board that does not disarm within \
6 s, or that flies by itself for longer than 30 s, is left to its own failsafe.
* The service is given 150 s to stop, and asks for more while it lands. The package is neither updated nor removed while \
the vehicle is armed.
* SIGKILL and a program that was paused for longer than the board waits leave the vehicle to the board's failsafe.

## What is deliberately not covered

* A board that flies itself into a wall: inner loops, their sensors and the motors' failsafe are the board's, and so is what it does \
when the companion falls silent (docs/BOARDS.md).
* An accelerometer that errs along x and y alone: in flight the filter takes these forces from drag.
* Wing damage, a stuck servo, a lost propeller are not recognised as such. What they do shows as \
`off_course`, `tilt_high` or `speed_high`, or ends on the floor.
* People and obstacles in the room: nothing looks for them. Walls are those of `[limits]` and the fence.
* UWB of which nearly every reception errs by metres, each by its own: what still fits now and then is flown by, and \
the vehicle may leave the walls in the landing that follows.
* A position that is wrong and fits its measurements and every lean (a survey in the wrong place, of another size, or \
turned by less than some 65 degrees).
* While the board's link is silent nothing we send may arrive; the board's own failsafe is all there is.
* The charge that a pack reports is not used; the time left is a straight line through the voltage, and \
unknown in the first 35 s of a flight.
* A joystick that falls silent ends in **hold**, and stays there until somebody orders otherwise or the \
battery does.
* `ground_lost` only tells by default: scripts that end (`haltere ctl`) are stations too. Choose a reaction \
where people fly by a station.
* A second fault in a descent has no further reaction: there is nothing harder that is not a fall.
";

fn number(config: &PilotConfig, n: &Number) -> String {
    let value = (n.value)(config);
    let shown = format!("{value} {}", n.unit);
    if n.key.is_empty() {
        format!("{}: {}", shown.trim(), n.origin)
    } else {
        format!("`{}` = {}: {}", n.key, shown.trim(), n.origin)
    }
}

/// What follows in the modes of a column: one reaction, or each with the modes that have it.
fn reactions(row: &Condition, modes: &[Mode], config: &PilotConfig) -> String {
    let mut found: Vec<(&str, Vec<&str>)> = Vec::new();
    for mode in modes {
        let name = match row.reaction(*mode, config) {
            Reaction::Nothing => "nothing",
            reaction => reaction.name(),
        };
        match found.iter_mut().find(|(of, _)| *of == name) {
            Some((_, modes)) => modes.push(mode.name()),
            None => found.push((name, vec![mode.name()])),
        }
    }
    if let [("nothing", _)] = found[..] {
        return String::new();
    }
    let bold = |name: &str| {
        if matches!(name, "tell" | "nothing") { name.to_owned() } else { format!("**{name}**") }
    };
    // What most of them have stands first, and alone.
    found.sort_by_key(|(_, modes)| std::cmp::Reverse(modes.len()));
    let most = bold(found[0].0);
    let others =
        found[1..].iter().map(|(name, modes)| format!("; in {}: {}", modes.join(", "), bold(name)));
    most + &others.collect::<String>()
}

fn severity(row: &Condition) -> &'static str {
    match row.severity() {
        0 => "emergency",
        2 => "critical",
        3 => "error",
        4 => "warning",
        _ => "info",
    }
}

fn end(row: &Condition) -> String {
    if row.latched {
        return " It stays until the vehicle is disarmed.".to_owned();
    }
    let after = match row.gone_s {
        s if s == GONE_S => String::new(),
        0.0 => " at once".to_owned(),
        s => format!(" after {s} s"),
    };
    match row.over {
        "" if after.is_empty() => after,
        "" => format!(" Over{after}."),
        told => format!(" Over{after}: \"{told}\"."),
    }
}

/// How long most conditions must be gone to be over, s.
const GONE_S: f64 = 0.3;

/// Name of a bit of SYS_STATUS without what all of them begin with.
fn short(name: &str) -> String {
    format!("`{}`", name.trim_start_matches("MAV_SYS_STATUS_"))
}

/// The page.
pub fn page() -> String {
    let config = PilotConfig::default();
    let mut page = HEAD.to_owned();
    page += "\n## Conditions and reactions\n\nBy default, in the order of the list. Empty, or nothing: not looked at in \
             that mode. In arming and disarming people are told where it is looked at.\n\n| condition |";
    for (name, _) in COLUMNS {
        let _ = write!(page, " {name} |");
    }
    let _ = writeln!(page, "\n|---|{}", "---|".repeat(COLUMNS.len()));
    for row in &CONDITIONS {
        let _ = write!(page, "| [{0}](#{0}) |", row.name);
        for (_, modes) in COLUMNS {
            let _ = write!(page, " {} |", reactions(row, modes, &config));
        }
        page.push('\n');
    }
    let _ = writeln!(
        page,
        "\n## Each condition\n\nBelow what is seen stand the reaction, for how long it must be seen before, how urgent the text is that \
         people are told, and that text. A condition is over when it has been gone for {GONE_S} s, where no other time is given, and \
         may be told then too. Health: bits of SYS_STATUS (`MAV_SYS_STATUS_…`) that show it. Numbers follow, each with its reason."
    );
    for row in &CONDITIONS {
        let wanted = (row.wanted)(&config).max(Reaction::Tell);
        let lasts_s = (row.lasts_s)(&config);
        let lasts = if lasts_s > 0.0 { format!(" after {lasts_s} s") } else { String::new() };
        let _ = write!(
            page,
            "\n### {}\n\n{}\n\n* **{}**{lasts}, {}: \"{}\".{}",
            row.name,
            row.seen_by,
            wanted.name(),
            severity(row),
            row.because,
            end(row)
        );
        let bits: Vec<_> = row.health.iter_names().map(|(name, _)| short(name)).collect();
        if !bits.is_empty() {
            let _ = write!(page, " Health: {}.", bits.join(", "));
        }
        page.push('\n');
        for n in row.numbers {
            let _ = writeln!(page, "* {}", number(&config, n));
        }
    }
    page += "\nEvery beginning and end is also an event (`condition_begins`, `condition_ends` in \
             `events.json`), and stands in the log with its text.\n";
    page += BOARD;
    page += AT_REST_HEAD;
    for row in &AT_REST {
        let numbers: String =
            row.numbers.iter().map(|n| format!("; {}", number(&config, n))).collect();
        let looked_at = match row.looked_at_s {
            0.0 => "newest".to_owned(),
            s => format!("{s} s"),
        };
        let live = if row.is_measured { ", live" } else { "" };
        let way_out = if row.way_out.is_empty() { "" } else { ": " };
        let _ = writeln!(
            page,
            "| {} | {}{numbers} | {looked_at}{live} | {}{way_out}{} | {} |",
            row.name, row.must_be, row.said, row.way_out, row.follows
        );
    }
    page += TAIL;
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_safety_page_is_the_list() {
        super::super::check_page("SAFETY.md", &page());
    }

    #[test]
    fn prop_every_row_is_told_in_full() {
        for row in &CONDITIONS {
            assert!(!row.name.is_empty() && !row.seen_by.is_empty(), "{row:?}");
            assert!(!row.because.is_empty(), "{row:?}");
            for n in row.numbers {
                assert!(!n.origin.is_empty(), "{row:?} {}", n.key);
            }
        }
        for mode in Mode::ALL {
            let shown = COLUMNS.iter().any(|(_, modes)| modes.contains(&mode));
            assert!(shown || matches!(mode, Mode::Arming | Mode::Disarming), "{mode:?}");
        }
    }
}
