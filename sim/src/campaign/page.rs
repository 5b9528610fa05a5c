//! The summary of a campaign as one HTML file: how the flights ended, by what was drawn, how the measured
//! quantities are spread, and the worst flights with the command that flies each again. Needs no network.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use haltere::report::html;
use haltere::report::svg::{Mark, Plot, Series, Tone, escape};
use serde_json::Value;

use super::row::{Outcome, Row};
use super::store::Identity;
use super::table::plain;

/// Style of what only this page has.
const STYLE: &str = "h2{margin-top:40px;font-size:18px;border-top:2px solid var(--rule);padding-top:14px}\
h3{font-size:14px;margin:20px 0 2px}table{margin:8px 0}p{max-width:92ch}\
td.why{max-width:52ch;font-size:12.5px}code{font-size:12px;word-break:break-all}\
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(340px,1fr));gap:8px}";
/// Bins of a histogram, and of a drawn number.
const BINS: usize = 24;
const GROUPS: usize = 5;
/// Different values that a drawn key may have to be listed one by one; flights in the list of the worst.
const MOST_VALUES: usize = 120;
const WORST: usize = 40;
/// Size of a histogram, pixels.
const SIZE_PX: [f64; 2] = [360.0, 190.0];

type Measure = (&'static str, fn(&Row) -> Option<f64>);
/// What is shown as a histogram.
const MEASURES: [Measure; 8] = [
    ("mean error of the estimate, m", |r| r.estimate_mean_m),
    ("largest error of the estimate, m", |r| r.estimate_worst_m),
    ("mean distance from the setpoint, m", |r| r.tracking_mean_m),
    ("largest distance from the setpoint, m", |r| r.tracking_worst_m),
    ("largest tilt, degrees", |r| Some(r.tilt_worst_deg)),
    ("hardest contact, m/s", |r| (r.contacts > 0).then_some(r.contact_mps)),
    ("lowest supply, V", |r| Some(r.lowest_supply_v)),
    ("time in the air, s", |r| Some(r.airborne_s)),
];

/// The page. `again`: the words that fly a flight of this campaign, without its number.
pub fn render(identity: &Identity, rows: &[&Row], again: &str) -> String {
    let title = format!("Campaign {}", identity.name);
    let mut page = html::open(&title, STYLE);
    let good = rows.iter().filter(|r| matches!(r.outcome, Outcome::Landed | Outcome::NotTakenOff));
    let (good, all) = (good.count(), rows.len());
    let shard = match identity.shard {
        [_, 1] => String::new(),
        [i, n] => format!(", shard {i} of {n}"),
    };
    let _ = write!(
        page,
        "<header><span class=\"verdict {}\">{good} of {all} safe</span><div><h1>{}</h1><p>{all} of {} flights{shard}, \
         simulated in lockstep by haltere {} ({}), campaign {:.12}</p></div></header>",
        if good == all { "good" } else { "bad" },
        escape(&title),
        identity.flights,
        escape(&identity.program.version),
        escape(&identity.program.commit),
        escape(&identity.digest)
    );
    page.push_str(
        "<p>Judged by the truth of the simulator. Safe: landed whole inside the fence, or never off the floor. \
         Crashed: tumbled, or met the floor faster than 2 m/s, sliding faster than 1.5 m/s or leaning by more than \
         45°. Left: the centre of mass was outside the fence by any amount.</p>",
    );
    outcomes(&mut page, rows);
    page.push_str("<h2>How the flights are spread</h2><div class=\"plots\">");
    for (name, pick) in MEASURES {
        histogram(&mut page, name, rows.iter().filter_map(|r| pick(r)).collect());
    }
    page.push_str("</div><h2>By what was drawn</h2>");
    let keys: BTreeSet<&String> = rows.iter().flat_map(|r| r.drawn.keys()).collect();
    if keys.is_empty() {
        page.push_str("<p>Nothing was drawn but the seed.</p>");
    }
    for key in keys {
        by_value(&mut page, key, rows);
    }
    worst(&mut page, rows, again);
    page.push_str("<footer>Lengths in m, heights upward. The table of all flights is results.parquet.</footer>");
    html::close(page)
}

fn outcomes(page: &mut String, rows: &[&Row]) {
    page.push_str("<table><thead><tr><th>Outcome</th><th class=\"n\">Flights</th><th class=\"n\">Share</th></tr></thead><tbody>");
    for outcome in Outcome::ALL {
        let count = rows.iter().filter(|r| r.outcome == outcome).count();
        let share = 100.0 * count as f64 / rows.len().max(1) as f64;
        let _ = write!(
            page,
            "<tr><td>{}</td><td class=\"n\">{count}</td><td class=\"n\">{share:.1} %</td></tr>",
            outcome.name()
        );
    }
    page.push_str("</tbody></table>");
}

fn histogram(page: &mut String, name: &str, mut values: Vec<f64>) {
    values.retain(|v| v.is_finite());
    values.sort_by(f64::total_cmp);
    let (Some(first), Some(last)) = (values.first().copied(), values.last().copied()) else {
        let _ = write!(page, "<p>{}: no flight has it.</p>", escape(name));
        return;
    };
    let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    // A few far ones may share the last bin: they are told in words.
    let reach = (at(0.99) - first).max(1e-6) * 1.1;
    let width = reach / BINS as f64;
    let mut counts = [0u32; BINS];
    for value in &values {
        counts[(((value - first) / width) as usize).min(BINS - 1)] += 1;
    }
    let mut points = vec![[first, 0.0]];
    for (i, count) in counts.iter().enumerate() {
        let left = first + width * i as f64;
        points.extend([[left, f64::from(*count)], [left + width, f64::from(*count)]]);
    }
    points.push([first + reach, 0.0]);
    let plot = Plot {
        title: name.to_owned(),
        x_label: format!(
            "median {:.3}, 90 % below {:.3}, {first:.3} to {last:.3}",
            at(0.5),
            at(0.9)
        ),
        y_label: "flights".into(),
        series: vec![Series {
            name: String::new(),
            tone: Tone::Estimate,
            mark: Mark::Line,
            points,
        }],
        size_px: SIZE_PX,
        least_height: 1.0,
        ..Plot::default()
    };
    page.push_str(&plot.render());
}

/// Rows in groups of one value, or of a range of values.
fn groups<'a>(key: &str, rows: &[&'a Row]) -> Vec<(String, Vec<&'a Row>)> {
    let value = |r: &Row| r.drawn.get(key).cloned().unwrap_or(Value::Null);
    let mut by: BTreeMap<String, Vec<&Row>> = BTreeMap::new();
    for row in rows {
        by.entry(plain(&value(row))).or_default().push(row);
    }
    let numbers: Option<Vec<f64>> = rows.iter().map(|r| value(r).as_f64()).collect();
    match numbers {
        Some(mut numbers) if by.len() > 2 * GROUPS => {
            numbers.sort_by(f64::total_cmp);
            let edge = |k: usize| numbers[(k * numbers.len() / GROUPS).min(numbers.len() - 1)];
            (0..GROUPS)
                .map(|k| {
                    let (low, high) = (edge(k), edge(k + 1));
                    let last = k + 1 == GROUPS;
                    let inside = |r: &&&Row| {
                        value(r).as_f64().is_some_and(|v| v >= low && (v < high || last))
                    };
                    let group = rows.iter().filter(inside).copied().collect();
                    (format!("{low:.3} to {high:.3}"), group)
                })
                .collect()
        }
        _ => by.into_iter().collect(),
    }
}

fn by_value(page: &mut String, key: &str, rows: &[&Row]) {
    let groups = groups(key, rows);
    let _ = write!(page, "<h3>{}</h3>", escape(key));
    if groups.len() > MOST_VALUES {
        let _ = write!(page, "<p>{} different values.</p>", groups.len());
        return;
    }
    page.push_str("<table><thead><tr><th>Value</th><th class=\"n\">Flights</th>");
    for outcome in Outcome::ALL {
        let _ = write!(page, "<th class=\"n\">{}</th>", outcome.name());
    }
    page.push_str(
        "<th class=\"n\">Estimate m</th><th class=\"n\">Setpoint m</th></tr></thead><tbody>",
    );
    for (value, group) in groups {
        let _ = write!(page, "<tr><td>{}</td><td class=\"n\">{}</td>", escape(&value), group.len());
        for outcome in Outcome::ALL {
            let count = group.iter().filter(|r| r.outcome == outcome).count();
            let class = if count > 0 && outcome >= Outcome::Left { "n bad" } else { "n" };
            let text = if count == 0 { String::new() } else { count.to_string() };
            let _ = write!(page, "<td class=\"{class}\">{text}</td>");
        }
        for pick in [|r: &Row| r.estimate_mean_m, |r: &Row| r.tracking_mean_m] {
            let _ =
                write!(page, "<td class=\"n\">{}</td>", mean(group.iter().filter_map(|r| pick(r))));
        }
        page.push_str("</tr>");
    }
    page.push_str("</tbody></table>");
}

fn mean(values: impl Iterator<Item = f64>) -> String {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, count), v| (sum + v, count + 1));
    if count == 0 { "–".into() } else { format!("{:.3}", sum / f64::from(count)) }
}

fn worst(page: &mut String, rows: &[&Row], again: &str) {
    let mut sorted: Vec<&Row> = rows.to_vec();
    sorted.sort_by(|a, b| b.badness().total_cmp(&a.badness()).then(a.index.cmp(&b.index)));
    let _ = write!(
        page,
        "<h2>The worst flights</h2><p>Each is flown again, and its log and truth are kept, by the command beside \
         it.</p><table><thead><tr><th class=\"n\">Flight</th><th>Outcome</th><th>What happened</th><th>Drawn</th>\
         <th>Modes</th><th>Again</th></tr></thead><tbody>"
    );
    for row in sorted.iter().take(WORST) {
        let drawn: Vec<String> =
            row.drawn.iter().map(|(k, v)| format!("{k} = {}", plain(v))).collect();
        let _ = write!(
            page,
            "<tr><td class=\"n\">{i}</td><td>{}</td><td class=\"why\">{}</td><td class=\"why\">{}</td>\
             <td class=\"why\">{}</td><td><code>{} --fly {i} --log flight-{i}.mcap</code></td></tr>",
            row.outcome.name(),
            escape(&row.why),
            escape(&drawn.join(", ")),
            escape(&row.modes.replace('>', " › ")),
            escape(again),
            i = row.index
        );
    }
    page.push_str("</tbody></table>");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::store::Program;

    #[test]
    fn prop_the_page_names_every_outcome_and_flies_again() {
        let drawn = |v: f64| BTreeMap::from([("a<b".to_owned(), serde_json::json!(v))]);
        let mut rows: Vec<Row> = (0..40).map(|i| Row::blank(i, i, drawn(i as f64))).collect();
        rows[7].outcome = Outcome::Crashed;
        rows[7].why = "hit <the> floor".into();
        let identity = Identity {
            name: "x & y".into(),
            digest: "d".into(),
            flights: 40,
            shard: [2, 3],
            sample: false,
            program: Program::current(),
        };
        let all: Vec<&Row> = rows.iter().collect();
        let page = render(&identity, &all, "haltere-sim campaign x.toml");
        for needed in [
            "39 of 40 safe",
            "x &amp; y",
            "a&lt;b",
            "hit &lt;the&gt; floor",
            "haltere-sim campaign x.toml --fly 7 --log flight-7.mcap",
            "shard 2 of 3",
            "did not take off",
        ] {
            assert!(page.contains(needed), "{needed} is missing");
        }
        assert_eq!(groups("a<b", &all).iter().map(|(_, g)| g.len()).sum::<usize>(), 40);
        assert!(render(&identity, &[], "x").contains("0 of 0 safe"));
    }
}
