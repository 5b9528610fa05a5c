//! What is said of blocked lines of sight, as text.

use std::fmt::Write as _;

use super::{Blocked, Outcome, Watched};

/// Intervals of time that are printed per anchor.
const MOST_TIMES: usize = 4;

/// One paragraph per flight.
pub fn text(flights: &[Watched]) -> String {
    let mut out = String::new();
    for flight in flights {
        // Writing to a string cannot fail.
        let _ = write(&mut out, flight);
    }
    out
}

fn write(out: &mut String, flight: &Watched) -> std::fmt::Result {
    let verdict = match flight.outcome {
        Outcome::NoGap => "clear",
        Outcome::Named => "one line of sight blocked (U5)",
        Outcome::Several => "several lines of sight blocked (U5)",
        Outcome::NotTestable => "not testable: too few windows with anchors that hang together",
    };
    writeln!(out, "{:<28} {verdict}", flight.flight)?;
    for b in &flight.blocked {
        let Blocked { anchor, greatest_m, median_m, blocked_s, share, .. } = b;
        writeln!(
            out,
            "    anchor {anchor}: {median_m:+.2} m in the middle, {greatest_m:+.2} m at most, for \
             {blocked_s:.0} s ({:.0} % of the flight)",
            100.0 * share
        )?;
        let times: Vec<String> = b
            .times_s
            .iter()
            .take(MOST_TIMES)
            .map(|[from, to]| format!("{from:.1}..{to:.1}"))
            .collect();
        let more = if b.times_s.len() > MOST_TIMES {
            format!(" and {} more", b.times_s.len() - MOST_TIMES)
        } else {
            String::new()
        };
        let [x, y, z] = b.place_U_m;
        let [ax, ay, az] = b.anchor_U_m;
        writeln!(
            out,
            "              at {} s{more}; seen from about ({x:.1}, {y:.1}, {z:.1}) towards \
             ({ax:.1}, {ay:.1}, {az:.1}); in most passes at {} of {} places",
            times.join(", "),
            b.places_blocked,
            b.places_visited
        )?;
    }
    let parts: Vec<String> = flight
        .greatest_m
        .iter()
        .map(|(id, part)| part.map_or(format!("{id}: -"), |p| format!("{id}: {p:.2}")))
        .collect();
    writeln!(
        out,
        "    greatest part per anchor, m: {}; pair alone {:.2}; limit {:.2} ({}); {} windows",
        parts.join("  "),
        flight.pair_m,
        flight.limit.limit_m,
        flight.limit.from,
        flight.windows
    )
}
