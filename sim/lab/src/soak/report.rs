//! The result of a soak: figures, bounds, targets; as text or as JSON.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::Path;

use anyhow::Result;
use serde_json::json;

use super::asked::{ANSWER_MS, ANSWER_SHARE, PARAMETERS_PER_S};
use super::wire::{Sorted, Wire};
use super::{
    DISTURBED_MS, LATENCY_MS, LATENCY_SHARE, MIDDLE_GAP_MS, MIDDLE_LATENCY_MS, MOST_CPU,
    MOST_GROWTH_B, MOST_MEMORY_B, MOST_SLEEPS_PER_S, Options, Seen,
};
use crate::flood::measure::Phase;

/// Nothing seen is no time.
fn finite(ms: f64) -> f64 {
    if ms.is_finite() { ms } else { 0.0 }
}

/// Tells it; `false`: a bound is broken.
pub fn tell(options: &Options, seen: &Seen, steps: &Phase, log: &Path) -> Result<bool> {
    let Wire { gaps_ms, own_gaps_ms, latency_ms, own_latency_ms } = &seen.wire;
    let [answers_ms, own_answers_ms] = seen.asked.answers_ms(&seen.stalls);
    let parameters_per_s = seen.asked.parameters_per_s();
    let answered = answers_ms.share_within(ANSWER_MS);
    let below: Vec<&str> = [
        ("parameters a second", parameters_per_s.at(0.0) >= PARAMETERS_PER_S),
        ("commands answered", own_answers_ms.share_within(ANSWER_MS) >= ANSWER_SHARE),
    ]
    .into_iter()
    .filter_map(|(target, kept)| (!kept).then_some(target))
    .collect();
    let stalls_ms = Sorted::of(seen.stalls.durations_ms());
    let own_late_ms = Sorted::of(steps.lateness_without(|from, to| seen.stalls.stood_us(from, to)));
    let [first_B, last_B, most_B] = seen.memory_B;
    let growth_B = last_B.saturating_sub(first_B);
    let within = own_latency_ms.share_within(LATENCY_MS);
    let missed = own_gaps_ms.beyond(options.longest_gap_ms);
    let middle_gap_ms = gaps_ms.at(0.5);
    let mut bounds: BTreeMap<&str, bool> = [
        ("every flight flown", seen.trouble.len() == seen.disturbed),
        ("setpoints were seen", gaps_ms.count() > 100),
        (
            "middle between setpoints",
            (MIDDLE_GAP_MS[0]..=MIDDLE_GAP_MS[1]).contains(&middle_gap_ms),
        ),
        ("middle latency", latency_ms.at(0.5) <= MIDDLE_LATENCY_MS),
        ("no growth of memory", growth_B <= MOST_GROWTH_B),
        ("memory", most_B <= MOST_MEMORY_B),
        ("wake-ups a second", seen.sleeps_per_s <= MOST_SLEEPS_PER_S),
    ]
    .into();
    let of_computer: BTreeMap<&str, bool> = [
        ("no setpoint missed", missed == 0),
        ("latency", within >= LATENCY_SHARE),
        ("processor time", seen.cpu <= MOST_CPU),
    ]
    .into();
    let mut unjudged = BTreeMap::new();
    if options.shared { &mut unjudged } else { &mut bounds }.extend(of_computer);
    let ok = bounds.values().all(|kept| *kept);
    let mut out = haltere::cli::Out::lock();
    if options.json {
        let result = json!({
            "ok": ok, "bounds": bounds, "unjudged": unjudged, "flights": seen.flights, "trouble": seen.trouble,
            "disturbed": seen.disturbed, "load_threads": options.load,
            "setpoints": gaps_ms.count() + seen.flights, "missed": missed,
            "gap_ms": { "median": gaps_ms.at(0.5), "p999": gaps_ms.at(0.999), "longest": gaps_ms.at(1.0), "longest_own": own_gaps_ms.at(1.0) },
            "processors_stood_ms": { "times": stalls_ms.count(), "longest": finite(stalls_ms.at(1.0)) },
            "latency_ms": { "count": latency_ms.count(), "median": latency_ms.at(0.5),
                "p99": latency_ms.at(0.99), "p999": latency_ms.at(0.999), "longest": latency_ms.at(1.0), "longest_own": own_latency_ms.at(1.0),
                "share_within_12_ms": within },
            "answer_ms": { "count": answers_ms.count(), "median": answers_ms.at(0.5),
                "p99": answers_ms.at(0.99), "longest": answers_ms.at(1.0), "longest_own": own_answers_ms.at(1.0),
                "share_within_50_ms": answered },
            "parameters": { "count": seen.asked.parameters_count(), "lists": parameters_per_s.count(),
                "slowest_per_s": parameters_per_s.at(0.0), "median_per_s": parameters_per_s.at(0.5) },
            "below_target": below,
            "lateness_ms": { "steps": steps.steps, "median": steps.lateness_ms(0.5),
                "p99": steps.lateness_ms(0.99), "p999": steps.lateness_ms(0.999),
                "worst": steps.lateness_ms(1.0), "p999_own": own_late_ms.at(0.999) },
            "memory_kB": { "after_first_flight": first_B / 1024, "end": last_B / 1024,
                "most": most_B / 1024, "growth": growth_B / 1024 },
            "cpu_share": seen.cpu, "wake_ups_per_s": seen.sleeps_per_s, "drops": steps.drops, "log": log,
        });
        writeln!(out, "{}", serde_json::to_string_pretty(&result)?)?;
        return Ok(ok);
    }
    writeln!(out, "flights                    {}", seen.flights)?;
    writeln!(
        out,
        "between setpoints, ms      median {:.2}, 99.9 % {:.2}, longest {:.2} ({:.2} without the time that a \
         processor stood still); {} of {} beyond {} ms",
        gaps_ms.at(0.5),
        gaps_ms.at(0.999),
        gaps_ms.at(1.0),
        own_gaps_ms.at(1.0),
        missed,
        gaps_ms.count(),
        options.longest_gap_ms
    )?;
    writeln!(
        out,
        "processors stood still     {} times, longest {:.2} ms",
        stalls_ms.count(),
        finite(stalls_ms.at(1.0))
    )?;
    writeln!(
        out,
        "UWB to setpoint, ms        median {:.2}, 99 % {:.2}, longest {:.2} ({:.2}); {:.3} % within {LATENCY_MS} ms",
        latency_ms.at(0.5),
        latency_ms.at(0.99),
        latency_ms.at(1.0),
        own_latency_ms.at(1.0),
        100.0 * within
    )?;
    writeln!(
        out,
        "lateness of steps, ms      median {:.3}, 99 % {:.3}, 99.9 % {:.3} ({:.3}), worst {:.3}",
        steps.lateness_ms(0.5),
        steps.lateness_ms(0.99),
        steps.lateness_ms(0.999),
        own_late_ms.at(0.999),
        steps.lateness_ms(1.0)
    )?;
    writeln!(
        out,
        "commands answered, ms      median {:.2}, 99 % {:.2}, longest {:.2} ({:.2}); {:.2} % of {} within {ANSWER_MS} ms",
        answers_ms.at(0.5),
        answers_ms.at(0.99),
        answers_ms.at(1.0),
        own_answers_ms.at(1.0),
        100.0 * answered,
        answers_ms.count()
    )?;
    writeln!(
        out,
        "parameters a second        {} of them, {} times: median {:.0}, slowest {:.0}",
        seen.asked.parameters_count(),
        parameters_per_s.count(),
        parameters_per_s.at(0.5),
        parameters_per_s.at(0.0)
    )?;
    writeln!(
        out,
        "memory, kB                 {} after the first flight, {} at the end, {} at most",
        first_B / 1024,
        last_B / 1024,
        most_B / 1024
    )?;
    writeln!(
        out,
        "processor time             {:.2} % of a core, {:.0} wake-ups a second",
        100.0 * seen.cpu,
        seen.sleeps_per_s
    )?;
    for (reason, count) in &steps.drops {
        writeln!(out, "  {reason}: {count}")?;
    }
    for why in &seen.trouble {
        writeln!(out, "{why}")?;
    }
    if seen.disturbed > 0 {
        writeln!(
            out,
            "{} of these while processors stood still for over {DISTURBED_MS} ms: not held against it",
            seen.disturbed
        )?;
    }
    for target in below {
        writeln!(out, "BELOW TARGET: {target}")?;
    }
    for (bound, _) in bounds.iter().filter(|(_, kept)| !**kept) {
        writeln!(out, "BROKEN: {bound}")?;
    }
    for (bound, _) in unjudged.iter().filter(|(_, kept)| !**kept) {
        writeln!(out, "BROKEN, not judged on a shared computer: {bound}")?;
    }
    writeln!(
        out,
        "{}; log {}",
        if ok { "within bounds" } else { "A BOUND IS BROKEN" },
        log.display()
    )?;
    Ok(ok)
}
