//! Ranging: innovations by pair and over time, consistency of the filter, anchors heard.

use std::collections::{BTreeMap, BTreeSet};

use super::{Clock, WIDE_PX, series};
use crate::report::flight::Flight;
use crate::report::lanes::{self, Kind, Lane, Stretch};
use crate::report::svg::{Limit, Mark, Plot, Tone};
use haltere_core::measure::AnchorId;

/// Innovations are averaged over this span, s.
const CONSISTENCY_BIN_S: f64 = 1.0;
/// Samples below which an average says nothing.
const LEAST_SAMPLES: u32 = 10;
/// Least width of a cell of the anchors' rows, s, and most cells in a row.
const CELL_S: f64 = 1.0;
const MOST_CELLS: f64 = 240.0;
/// Height of such a row, pixels.
const ROW_PX: f64 = 15.0;
/// A share of rejected measurements that is worth a look, and one that is wrong.
const WARN_REJECTED: f64 = 0.2;
const BAD_REJECTED: f64 = 0.5;

/// All of them.
pub(super) fn plots(flight: &Flight, clock: &Clock) -> Vec<String> {
    vec![
        pairs(flight),
        innovations(flight, clock),
        consistency(flight, clock),
        anchors(flight, clock),
    ]
}

/// How many measurements with each anchor came in, and what became of them.
fn anchors(flight: &Flight, clock: &Clock) -> String {
    let [low, high] = clock.span_s;
    let cell_s = ((high - low) / MOST_CELLS).max(CELL_S);
    let mut cells: BTreeMap<(AnchorId, i64), [u32; 2]> = BTreeMap::new();
    let waiting = flight.uwb.len() - flight.judged().count();
    for (i, record) in flight.uwb.iter().enumerate() {
        let cell = ((clock.s(record.tdoa.valid_at) - low) / cell_s).floor() as i64;
        for anchor in [record.tdoa.anchor_a, record.tdoa.anchor_b] {
            let [all, rejected] = cells.entry((anchor, cell)).or_default();
            *all += 1;
            *rejected += u32::from(!record.fused && i >= waiting);
        }
    }
    let surveyed = flight.survey.iter().flat_map(|survey| survey.ids().iter().copied());
    let ids: BTreeSet<AnchorId> = cells.keys().map(|(id, _)| *id).chain(surveyed).collect();
    let usual = {
        let mut counts: Vec<u32> = cells.values().map(|c| c[0]).collect();
        counts.sort_unstable();
        f64::from(counts.get(counts.len() / 2).copied().unwrap_or(1).max(1))
    };
    let lane = |id: AnchorId| Lane {
        name: format!("anchor {id}"),
        stretches: cells
            .range((id, i64::MIN)..=(id, i64::MAX))
            .map(|((_, cell), [all, rejected])| {
                let from_s = low + *cell as f64 * cell_s;
                let share = f64::from(*rejected) / f64::from(*all);
                Stretch {
                    x: [from_s, from_s + cell_s],
                    kind: match share {
                        s if s >= BAD_REJECTED => Kind::Bad,
                        s if s >= WARN_REJECTED => Kind::Warn,
                        _ => Kind::Family(0),
                    },
                    strength: 0.15 + 0.85 * f64::from(*all) / usual,
                    name: String::new(),
                    hint: format!(
                        "anchor {id}, {from_s:.0} s: {:.0} measurements/s, {:.0} % rejected",
                        f64::from(*all) / cell_s,
                        100.0 * share
                    ),
                }
            })
            .collect(),
        marks: Vec::new(),
    };
    let lanes: Vec<Lane> = ids.into_iter().map(lane).collect();
    let title =
        "Anchors: measurements with each; pale is few, blank is none, yellow and red are rejected";
    lanes::render(title, &lanes, clock.span_s, ROW_PX)
}

/// Mean and spread of the innovation of every anchor pair, with the share that was rejected.
fn pairs(flight: &Flight) -> String {
    let pairs = flight.pairs();
    let mut plot = Plot {
        title: "Innovation by anchor pair: mean, \u{b1} one sigma; below, the share rejected"
            .into(),
        y_label: "m".into(),
        size_px: WIDE_PX,
        least_height: 0.2,
        x_range: Some([-0.7, pairs.len() as f64 - 0.3]),
        ..Plot::default()
    };
    let mut bars = Vec::new();
    let mut means = Vec::new();
    let mut labels = Vec::new();
    for (i, ((a, b), stats)) in pairs.iter().enumerate() {
        let (x, total) = (i as f64, stats.fused + stats.rejected);
        let rejected = f64::from(stats.rejected) / f64::from(total.max(1));
        labels.push((x, format!("{a}\u{2013}{b}"), format!("{:.0}%", 100.0 * rejected)));
        if let (Some(mean), Some(std)) = (stats.mean_m(), stats.std_m()) {
            bars.extend([[x, mean - std], [x, mean + std], [f64::NAN; 2]]);
            means.push([x, mean]);
        }
    }
    plot.series = vec![
        series("\u{b1} one sigma", Tone::Family(0), Mark::Line, bars),
        series("mean", Tone::Command, Mark::Dots, means),
    ];
    plot.limits = vec![Limit { name: String::new(), y: 0.0 }];
    plot.categories = labels;
    format!("<div class=\"wide bars\">{}</div>", plot.render())
}

fn innovations(flight: &Flight, clock: &Clock) -> String {
    let points = |fused: bool| {
        let records = flight.judged().filter(move |r| r.fused == fused);
        records.map(|r| [clock.s(r.tdoa.valid_at), r.innovation_m]).collect::<Vec<_>>()
    };
    let (fused, rejected) = (points(true), points(false));
    let share = 100.0 * rejected.len() as f64 / (fused.len() + rejected.len()).max(1) as f64;
    let mut plot = clock.plot(
        "Innovations",
        "m",
        vec![
            series("fused", Tone::Family(0), Mark::Dots, fused),
            series(&format!("rejected {share:.1} %"), Tone::Command, Mark::Dots, rejected),
        ],
    );
    plot.least_height = 0.4;
    plot.render()
}

fn consistency(flight: &Flight, clock: &Clock) -> String {
    let mut bins: BTreeMap<i64, (u32, f64)> = BTreeMap::new();
    for record in flight.uwb.iter().filter(|r| r.fused && r.var_innovation_m2 > 0.0) {
        let bin = (clock.s(record.tdoa.valid_at) / CONSISTENCY_BIN_S).floor() as i64;
        let (n, sum) = bins.entry(bin).or_default();
        *n += 1;
        *sum += record.innovation_m * record.innovation_m / record.var_innovation_m2;
    }
    let points = bins.into_iter().filter(|(_, (n, _))| *n >= LEAST_SAMPLES);
    let points = points
        .map(|(bin, (n, sum))| [(bin as f64 + 0.5) * CONSISTENCY_BIN_S, sum / f64::from(n)])
        .collect();
    let mut plot = clock.plot(
        "Consistency of the filter, mean over 1 s",
        "innovation\u{b2} / variance",
        vec![series("", Tone::Estimate, Mark::Line, points)],
    );
    plot.limits = vec![Limit { name: "consistent".into(), y: 1.0 }];
    plot.least_height = 2.0;
    plot.render()
}
