//! Timing: regularity of the control step, age of the data, losses.

use std::collections::BTreeMap;

use super::{Clock, PLOT_PX, series};
use crate::report::flight::Flight;
use crate::report::svg::{Mark, Plot, Tone};
use crate::report::timing::{self, Histogram};
use haltere_core::time::HostTime;

/// All of them.
pub(super) fn plots(flight: &Flight, clock: &Clock) -> Vec<String> {
    vec![
        histogram("Time between control steps", period(flight).as_ref()),
        histogram("Lateness of the wake-ups for them", late(flight).as_ref()),
        ages(flight, clock),
        losses(flight, clock),
    ]
}

/// The histograms in words.
pub(super) fn note(flight: &Flight) -> String {
    let told = |what: &str, found: Option<Histogram>| {
        found.map_or_else(String::new, |h| {
            let [half, most, all] = h.percentiles_ms;
            format!(
                "{what}: half within {half:.2} ms, 99 % within {most:.2} ms, worst {all:.2} ms. "
            )
        })
    };
    told("Time between control steps", period(flight)) + &told("Lateness", late(flight))
}

fn period(flight: &Flight) -> Option<Histogram> {
    let steps: Vec<HostTime> = flight.estimates.iter().map(|e| e.at).collect();
    timing::periods(&steps)
}

fn late(flight: &Flight) -> Option<Histogram> {
    timing::lateness(flight.started?, &flight.wakes)
}

fn histogram(title: &str, found: Option<&Histogram>) -> String {
    let points = found.map_or_else(Vec::new, Histogram::outline);
    Plot {
        title: title.to_owned(),
        x_label: "ms; the last bin holds what is beyond".into(),
        y_label: "steps".into(),
        series: vec![series("", Tone::Estimate, Mark::Line, points)],
        size_px: PLOT_PX,
        decades: true,
        least_height: 2.0,
        ..Plot::default()
    }
    .render()
}

fn ages(flight: &Flight, clock: &Clock) -> String {
    let column = |f: fn(&haltere_core::topics::HealthRecord) -> Option<f64>| {
        let rows = flight.health.iter();
        rows.map(|h| [clock.s(h.at), f(h).map_or(f64::NAN, |s| s * 1e3)]).collect::<Vec<_>>()
    };
    let misses = flight.health.windows(2).map(|w| {
        [clock.s(w[1].at), w[1].deadline_misses.saturating_sub(w[0].deadline_misses) as f64]
    });
    let mut plot = clock.plot(
        "Data age, missed deadlines",
        "ms or count",
        vec![
            series("UWB, ms", Tone::Estimate, Mark::Line, column(|h| h.uwb_age_s)),
            series("IMU, ms", Tone::Family(2), Mark::Line, column(|h| h.imu_age_s)),
            series("missed per s", Tone::Command, Mark::Dots, misses.collect()),
        ],
    );
    plot.least_height = 10.0;
    plot.render()
}

/// Losses over time, the most frequent reasons first.
fn losses(flight: &Flight, clock: &Clock) -> String {
    let mut lines: BTreeMap<&'static str, Vec<[f64; 2]>> = BTreeMap::new();
    for health in &flight.health {
        let mut sums: BTreeMap<&'static str, u64> = BTreeMap::new();
        for (reason, n) in health.drops.iter().flat_map(|(_, drops)| drops.iter()) {
            // Of several links; a damaged log may claim any number.
            let sum = sums.entry(reason.name()).or_default();
            *sum = sum.saturating_add(n);
        }
        for (reason, n) in sums {
            lines.entry(reason).or_default().push([clock.s(health.at), n as f64]);
        }
    }
    let last = |points: &[[f64; 2]]| points.last().map_or(0.0, |p| p[1]);
    let mut lines: Vec<_> = lines.into_iter().collect();
    lines.sort_by(|a, b| last(&b.1).total_cmp(&last(&a.1)));
    lines.truncate(3);
    let lines = lines.into_iter().enumerate();
    let lines = lines
        .map(|(i, (name, points))| {
            series(&name.replace('_', " "), Tone::Family(i as u8), Mark::Line, points)
        })
        .collect();
    let mut plot = clock.plot("Losses", "count since start", lines);
    plot.least_height = 10.0;
    plot.render()
}
