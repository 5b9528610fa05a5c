//! The summary of a campaign as one HTML file: how the flights ended, by what was drawn, how the measured
//! quantities are spread, and the worst flights with the command that flies each again. Needs no network.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use serde_json::Value;

use super::row::{Outcome, Row};
use super::store::Identity;
use super::table::plain;
use crate::report::html::{self, Cell, WRAPS};
use crate::report::svg::{Mark, Plot, Series, Tone, escape};

/// Style of what only this page has.
const STYLE: &str = "h2{margin-top:40px;font-size:18px;border-top:2px solid var(--rule);padding-top:14px}\
h3{font-size:14px;margin:20px 0 2px}table{margin:8px 0}p{max-width:92ch}\
code{font-size:12px;word-break:break-all}\
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
    let (all, safe) = (rows.len(), rows.iter().filter(|r| r.is_safe()).count());
    let flown = rows.iter().filter(|r| r.flew_mission()).count();
    let class = match (safe == all, flown == all) {
        (true, true) => "good",
        (true, false) => "none",
        (false, _) => "bad",
    };
    let words = format!("{safe} of {all} safe, {flown} of {all} missions flown");
    let shard = match identity.shard {
        [_, 1] => String::new(),
        [i, n] => format!(", shard {i} of {n}"),
    };
    let subtitle = format!(
        "{all} of {} flights{shard}, simulated in lockstep by haltere {} ({}), campaign {:.12}",
        identity.flights, identity.program.version, identity.program.commit, identity.digest
    );
    page += &html::header(Some((class, &words)), &title, &subtitle);
    page.push_str(
        "<p>Judged by the truth of the simulator. Safe: landed whole inside the fence, or never off the floor. \
         Crashed: tumbled, or met the floor faster than 2 m/s, sliding faster than 1.5 m/s or leaning by more than \
         45°. Left: the centre of mass was outside the fence by any amount. A mission is flown when each of its \
         items was.</p>",
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
    let told = |name: &str, count: usize| {
        let share = 100.0 * count as f64 / rows.len().max(1) as f64;
        vec![name.into(), count.to_string().into(), format!("{share:.1} %").into()]
    };
    let count = |outcome| rows.iter().filter(|r| r.outcome == outcome).count();
    let lines = Outcome::ALL.into_iter().map(|outcome| told(outcome.name(), count(outcome)));
    let missions = told("mission flown", rows.iter().filter(|r| r.flew_mission()).count());
    let lines: Vec<Vec<Cell>> = lines.chain([missions]).collect();
    *page += &html::table(["Outcome", "#Flights", "#Share"], &lines);
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
    let outcomes = Outcome::ALL.map(|outcome| format!("#{}", outcome.name()));
    let heads = ["Value", "#Flights"].into_iter().chain(outcomes.iter().map(String::as_str));
    let heads = heads.chain(["#mission flown", "#Estimate m", "#Setpoint m"]);
    let lines = groups.into_iter().map(|(value, group)| {
        let counted = |class: &'static str, count: usize| match count {
            0 => Cell::from(""),
            count => Cell::of(class, &count.to_string()),
        };
        let count = |outcome| {
            let class = if outcome >= Outcome::Left { "bad" } else { "" };
            counted(class, group.iter().filter(|r| r.outcome == outcome).count())
        };
        let flown = counted("", group.iter().filter(|r| r.flew_mission()).count());
        let picks = [|r: &Row| r.estimate_mean_m, |r: &Row| r.tracking_mean_m];
        let means = picks.map(|pick| mean(group.iter().filter_map(|r| pick(r))).into());
        let begin = [value, group.len().to_string()].map(Cell::from);
        begin.into_iter().chain(Outcome::ALL.map(count)).chain([flown]).chain(means).collect()
    });
    *page += &html::table(heads, &lines.collect::<Vec<_>>());
}

fn mean(values: impl Iterator<Item = f64>) -> String {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, count), v| (sum + v, count + 1));
    if count == 0 { "–".into() } else { format!("{:.3}", sum / f64::from(count)) }
}

fn worst(page: &mut String, rows: &[&Row], again: &str) {
    let mut sorted: Vec<(f64, String, &Row)> = rows
        .iter()
        .map(|row| {
            let (score, number) = row.badness();
            (score, number, *row)
        })
        .collect();
    sorted.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.2.index.cmp(&b.2.index)));
    page.push_str(
        "<h2>The worst flights</h2><p>By outcome, missions that were not flown before others, then by the number beside it. \
         Each is flown again, and its log and truth are kept, by the command at its end.</p>",
    );
    let lines = sorted.into_iter().take(WORST).map(|(_, number, row)| {
        let drawn: Vec<String> =
            row.drawn.iter().map(|(k, v)| format!("{k} = {}", plain(v))).collect();
        let i = row.index;
        let items = format!("{} of {}", row.items_flown, row.items);
        let why = [&row.why, &drawn.join(", "), &row.modes.replace('>', " › ")];
        let command = format!("<code>{} --fly {i} --log flight-{i}.mcap</code>", escape(again));
        [i.to_string(), row.outcome.name().to_owned(), number, items]
            .map(Cell::from)
            .into_iter()
            .chain(why.map(|words| Cell::of(WRAPS, words)))
            .chain([Cell::markup("", command)])
            .collect()
    });
    let heads =
        ["#Flight", "Outcome", "At worst", "#Items", "What happened", "Drawn", "Modes", "Again"];
    *page += &html::table(heads, &lines.collect::<Vec<_>>());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulated::campaign::store::Program;

    #[test]
    fn prop_the_page_names_every_outcome_and_flies_again() {
        let drawn = |v: f64| BTreeMap::from([("a<b".to_owned(), serde_json::json!(v))]);
        let mut rows: Vec<Row> = (0..40).map(|i| Row::blank(i, i, drawn(i as f64))).collect();
        rows[7].outcome = Outcome::Crashed;
        rows[7].why = "hit <the> floor".into();
        for row in &mut rows[..30] {
            (row.items, row.items_flown, row.estimate_worst_m) = (8, 8, Some(0.3));
        }
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
            "39 of 40 safe, 30 of 40 missions flown",
            "estimate off by 0.30 m",
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
        // No column in which nothing stands: nobody left the volume.
        assert!(
            !page.contains("<th class=\"n\">left the volume") && !page.contains("<th>Modes"),
            "{page}"
        );
        assert!(render(&identity, &[], "x").contains("0 of 0 safe"));
    }
}
