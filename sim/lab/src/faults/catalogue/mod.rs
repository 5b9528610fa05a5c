//! The catalogue of faults that the fault campaign flies: one list.
//!
//! Each entry is one or more `[[fault]]` of a scenario without time; the campaign says in which part of
//! the flight it comes and when. Or it is a `[told]`: what the companion is told wrongly, from the start. Link
//! faults are made of a kind, a line and a share.

mod families;
mod floor;

use haltere::simulated::campaign::entry::Entry;
use haltere::simulated::campaign::entry::Reaction::{self, Exists, None as Nothing};

const GATES: Reaction = Exists("the filter's gates; blind descent if the estimate goes bad");
const IMU: Reaction = Exists("blind descent, landing when it is back");
const UWB: Reaction = Exists("dead reckoning, then landing");
const LINES: Reaction = Exists("checksums, sequence numbers, asking again, silence limits");
const LATE: Reaction = Exists("a descent by nothing that is faster than the link");
const BOARD: Reaction = Exists("the board's failsafe: level, sink, cut");
const ATTITUDE: Reaction = Exists("the controller");

/// Faults that are named one by one: name, group, fields of each `[[fault]]`, reaction.
const SINGLE: &[(&str, &str, &[&str], Reaction)] = &[
    ("accelerometer off", "IMU", &["part = 'accelerometer'"], IMU),
    ("accelerometer stuck", "IMU", &["part = 'accelerometer'\nstate = 'stuck'"], GATES),
    ("accelerometer spikes", "IMU", &["part = 'accelerometer'\nstate = 'spike'"], GATES),
    ("accelerometer drifts", "IMU", &["part = 'accelerometer'\nstate = 'drift'"], GATES),
    ("accelerometer garbage", "IMU", &["part = 'accelerometer'\nstate = 'garbage'"], GATES),
    ("gyroscope off", "IMU", &["part = 'gyroscope'"], IMU),
    ("gyroscope stuck", "IMU", &["part = 'gyroscope'\nstate = 'stuck'"], GATES),
    ("gyroscope spikes", "IMU", &["part = 'gyroscope'\nstate = 'spike'"], GATES),
    ("gyroscope drifts", "IMU", &["part = 'gyroscope'\nstate = 'drift'"], GATES),
    ("gyroscope garbage", "IMU", &["part = 'gyroscope'\nstate = 'garbage'"], GATES),
    ("IMU off", "IMU", &["part = 'accelerometer'", "part = 'gyroscope'"], IMU),
    (
        "IMU off for 1 s",
        "IMU",
        &["part = 'accelerometer'\nfor_s = 1.0", "part = 'gyroscope'\nfor_s = 1.0"],
        IMU,
    ),
    ("barometer off", "barometer", &["part = 'barometer'"], GATES),
    ("barometer stuck", "barometer", &["part = 'barometer'\nstate = 'stuck'"], GATES),
    ("barometer spikes", "barometer", &["part = 'barometer'\nstate = 'spike'"], GATES),
    ("barometer drifts", "barometer", &["part = 'barometer'\nstate = 'drift'"], GATES),
    ("UWB off", "UWB", &["part = 'tag'"], UWB),
    ("UWB off for 0.5 s", "UWB", &["part = 'tag'\nfor_s = 0.5"], UWB),
    ("UWB off for 3 s", "UWB", &["part = 'tag'\nfor_s = 3.0"], UWB),
    (
        "UWB outlier bursts",
        "UWB",
        &["part = 'effect'\neffect = 'U10'\nvalues = { rate = 60.0, size = 6.0 }"],
        UWB,
    ),
    (
        "UWB anchor drifts",
        "UWB",
        &["part = 'effect'\neffect = 'U8'\nvalues = { rate = 10.0, anchor = 3.0 }"],
        UWB,
    ),
    (
        "UWB among metal cabinets and a person who walks",
        "UWB",
        &[
            "part = 'effect'\neffect = 'N16'\nvalues = { std = 0.1, constant = 0.1 }",
            "part = 'effect'\neffect = 'N20'\nvalues = { cabinets = 2.0, least = 0.3, most = 2.0, people = 1.0 }",
        ],
        GATES,
    ),
    ("UWB frozen", "UWB", &["part = 'line'\nline = 'from-tag'\nfrozen = 1.0"], UWB),
    ("1 anchor of 8 off", "UWB", &["part = 'anchor'\nanchor = 2"], UWB),
    (
        "3 anchors of 8 off",
        "UWB",
        &[
            "part = 'anchor'\nanchor = 0",
            "part = 'anchor'\nanchor = 3",
            "part = 'anchor'\nanchor = 6",
        ],
        UWB,
    ),
    (
        "5 anchors of 8 off",
        "UWB",
        &[
            "part = 'anchor'\nanchor = 0",
            "part = 'anchor'\nanchor = 1",
            "part = 'anchor'\nanchor = 3",
            "part = 'anchor'\nanchor = 6",
            "part = 'anchor'\nanchor = 7",
        ],
        UWB,
    ),
    ("board link off", "board link", &["part = 'board-link'"], BOARD),
    ("board link off for 0.3 s", "board link", &["part = 'board-link'\nfor_s = 0.3"], BOARD),
    ("board link off for 2 s", "board link", &["part = 'board-link'\nfor_s = 2.0"], BOARD),
    (
        "board link comes and goes",
        "board link",
        &["part = 'board-link'\nstate = 'intermittent'"],
        BOARD,
    ),
    (
        "board's messages frozen",
        "board link",
        &["part = 'line'\nline = 'from-board'\nfrozen = 1.0"],
        BOARD,
    ),
    ("setpoints do not arrive", "board link", &["part = 'to-board'"], BOARD),
    (
        "board reboots",
        "board",
        &["part = 'board-reboot'"],
        Nothing("its motors stop; it comes back disarmed on the floor"),
    ),
    (
        "battery sags by 0.6 V",
        "battery",
        &["part = 'battery'\ndrop_v = 0.6"],
        Exists("thrust is corrected for voltage; warning"),
    ),
    ("battery sags by 1.9 V", "battery", &["part = 'battery'\ndrop_v = 1.9"], Exists("lands")),
    (
        "battery loses a cell",
        "battery",
        &["part = 'battery'\ndrop_v = 3.5"],
        Nothing("full throttle carries less than the weight"),
    ),
    ("both wings torn, 85 % left", "wing", &["part = 'wing'\ngain = 0.85"], ATTITUDE),
    ("a wing torn, 95 % left", "wing", &["part = 'wing'\nwing = 'left'\ngain = 0.95"], ATTITUDE),
    ("a wing torn, 85 % left", "wing", &["part = 'wing'\nwing = 'right'\ngain = 0.85"], ATTITUDE),
    (
        "a wing torn, 60 % left",
        "wing",
        &["part = 'wing'\nwing = 'left'\ngain = 0.6"],
        Nothing("the other wing cannot give up so much and still carry"),
    ),
    (
        "a wing lost",
        "wing",
        &["part = 'wing'\nwing = 'right'\ngain = 0.0"],
        Nothing("half of the thrust, all on one side"),
    ),
    (
        "servos stuck",
        "servo",
        &["part = 'servos'\nstate = 'stuck'"],
        Nothing("no moment about pitch and yaw but the one they were stuck with"),
    ),
    ("servos limp", "servo", &["part = 'servos'"], Nothing("no moment about pitch and yaw")),
    (
        "gust of 1 m/s",
        "wind",
        &["part = 'gust'\ngust_mps = [1.0, 0.0, 0.0]\nlength_s = 2.0"],
        ATTITUDE,
    ),
    (
        "gust of 2 m/s",
        "wind",
        &["part = 'gust'\ngust_mps = [0.0, 2.0, 0.0]\nlength_s = 2.0"],
        ATTITUDE,
    ),
    (
        "gust of 2 m/s downwards",
        "wind",
        &["part = 'gust'\ngust_mps = [0.0, 0.0, 2.0]\nlength_s = 1.0"],
        ATTITUDE,
    ),
    (
        "gust of 4 m/s",
        "wind",
        &["part = 'gust'\ngust_mps = [-2.83, 2.83, 0.0]\nlength_s = 2.0"],
        Nothing("as fast as the vehicle itself: it is carried away while it lasts"),
    ),
    (
        "turbulence of 0.6 m/s",
        "wind",
        &["part = 'effect'\neffect = 'A7'\nvalues = { std = 0.6 }"],
        ATTITUDE,
    ),
    (
        "wind of 1 m/s",
        "wind",
        &["part = 'effect'\neffect = 'A5'\nvalues = { north = 0.7, east = -0.7 }"],
        ATTITUDE,
    ),
];

/// Lines: key, in words.
const LINES_OF: [(&str, &str); 3] = [
    ("from-tag", "tag to companion"),
    ("from-board", "board to companion"),
    ("to-board", "companion to board"),
];
/// Kinds of noise: key, in words, further fields.
const KINDS: [(&str, &str, &str); 5] = [
    ("lost", "lost", ""),
    ("late", "0.1 s late", "\nlate_s = 0.1"),
    ("twice", "twice", ""),
    ("swapped", "swapped", ""),
    ("damaged", "damaged", ""),
];
/// Shares.
const SHARES: [(f64, &str); 3] = [(0.001, "0.1 %"), (0.01, "1 %"), (0.1, "10 %")];
/// Delays of everything on a line, s.
const DELAYS_S: [(f64, &str); 5] =
    [(0.05, "50 ms"), (0.1, "100 ms"), (0.2, "200 ms"), (0.3, "300 ms"), (0.4, "400 ms")];
/// From this delay on a board link is late, s: the loop that flies through it has no phase left at 0.2 s.
const LATE_S: f64 = 0.1;

/// Every fault.
pub fn all() -> Vec<Entry> {
    let mut list: Vec<Entry> = SINGLE
        .iter()
        .map(|(name, group, faults, reaction)| Entry {
            name: (*name).to_owned(),
            group,
            text: faults.iter().map(|f| format!("[[fault]]\n{f}\n")).collect(),
            reaction: *reaction,
        })
        .collect();
    for (line, from_to) in LINES_OF {
        for (kind, word, more) in KINDS {
            for (share, percent) in SHARES {
                list.push(Entry {
                    name: format!("{from_to}: {percent} {word}"),
                    group: "lines",
                    text: format!(
                        "[[fault]]\npart = 'line'\nline = '{line}'\n{kind} = {share}{more}\n"
                    ),
                    reaction: LINES,
                });
            }
        }
        for (delay_s, words) in DELAYS_S {
            let reaction = if line != "from-tag" && delay_s >= LATE_S { LATE } else { LINES };
            list.push(Entry {
                name: format!("{from_to}: all {words} late"),
                group: "lines",
                text: format!(
                    "[[fault]]\npart = 'line'\nline = '{line}'\nlate = 1.0\nlate_s = {delay_s}\n"
                ),
                reaction,
            });
        }
    }
    list.extend(families::all());
    list.extend(floor::all());
    list
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere::simulated::campaign::entry::Parts;
    use haltere::simulated::faults::Phase;
    use haltere_core::checks::Problems;

    #[test]
    fn prop_every_entry_is_a_fault_of_its_own() {
        let all = all();
        assert!(all.len() > 90, "{}", all.len());
        let mut names: Vec<_> = all.iter().map(|e| &e.name).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), all.len(), "two entries of one name");
        for entry in &all {
            let Parts { fault, told, floor } = entry.parts().unwrap_or_else(|e| panic!("{e:#}"));
            assert_eq!(fault.is_empty(), told.is_some(), "{}", entry.name);
            assert_eq!(entry.is_from_start(), told.is_some() || floor, "{}", entry.name);
            assert_eq!(entry.is_from_floor(), floor, "{}", entry.name);
            for mut fault in fault {
                assert!(fault.phase.is_none() && fault.at_s == 0.0, "{}", entry.name);
                fault.phase = Some(Phase::Hover);
                let mut problems = Problems::new();
                assert!(fault.to_mishap("x", &mut problems).is_some(), "{}", entry.name);
                assert!(problems.is_empty(), "{}: {problems}", entry.name);
            }
        }
    }

    #[test]
    fn prop_entries_are_found_by_their_names_and_groups() {
        let found = |word: &str| all().iter().filter(|e| e.is_named(word)).count();
        assert_eq!((found("replayed_ranging"), found("Replayed ranging")), (8, 8));
        assert_eq!((found("servos limp"), found("servos_limp"), found("gremlins")), (1, 1, 0));
        assert_eq!(found(""), 0, "nothing names nothing");
    }
}
