//! The diagnosis without a simulator as one HTML page: the sentence, the balance against that of healthy flights, the causes, and what was
//! not looked at.

use crate::report::html::{self, Cell};
use crate::report::svg::{Limit, Mark, Plot, Series, Tone};
use haltere_gap::balance::Report;
use haltere_gap::balance::report::AxisChange;
use haltere_gap::outcome::{Ending, Outcome};

/// Size of the picture, pixels.
const PICTURE_PX: [f64; 2] = [720.0, 300.0];

/// The page of a flight that has no balance.
pub fn without(flight: &str, outcome: &Outcome) -> String {
    let badge = outcome.kind().key().replace('_', " ");
    let page = html::open("Balance", "") + &html::header(Some(("none", &badge)), flight, "");
    html::close(page + &html::said("none", &outcome.sentence(str::to_owned)))
}

/// The whole page.
pub fn render(report: &Report) -> String {
    let mut page = html::open("Balance", "");
    let ending = report.outcome.kind();
    let tone = if ending == Ending::NoGap { "good" } else { "bad" };
    let subtitle = format!(
        "{:.1} s of hover against {} accepted flights, vehicle {}; nothing was simulated",
        report.hover_s,
        report.references.len(),
        report.vehicle
    );
    let badge = ending.key().replace('_', " ");
    page += &html::header(Some((tone, &badge)), &report.flight, &subtitle);
    page += &html::said(tone, &report.verdict);
    page += &html::note(&format!("These references can show {}.", report.can_show_words()));
    page += &html::heading("Force and moments in hover");
    page += &picture(report);
    page += &html::note(
        "A sigma is what the next healthy flight differs by, from the scatter of the references and what is usual between sessions. \
         Moments are shares of the weight at the mean lever.",
    );
    page += &changes(report);
    let rows = report.candidates.iter().map(|named| {
        let probability = format!("{:.2}", named.probability);
        vec![Cell::of(html::WRAPS, &report.cause_words(named)), probability.into()]
    });
    let others =
        [("nothing has changed", report.nothing), ("another vehicle", report.another_vehicle)];
    let others = others.map(|(what, p)| vec![Cell::from(what), format!("{p:.2}").into()]);
    let rows: Vec<_> = others.into_iter().chain(rows).collect();
    page += &html::titled("Causes", ["Cause", "#Probability"], &rows);
    if let Some(held_out) = &report.held_out {
        page += &html::heading("On flights that were not used");
        page += &html::note(&format!(
            "The explanation closes {:.2} of vertical force and moments on {}.",
            held_out.shrink,
            held_out.flights.join(", ")
        ));
    }
    if let Some(told) = report.simulator_words() {
        page += &html::heading("Your simulator");
        page += &html::note(&format!("It {told}."));
    }
    let rows: Vec<Vec<Cell>> =
        report.not_checked.iter().map(|what| vec![Cell::of(html::WRAPS, what)]).collect();
    page += &html::titled("Not checked", ["What"], &rows);
    let references = report.references.iter().map(|name| vec![Cell::from(name)]);
    page += &html::titled("References", ["Flight"], &references.collect::<Vec<_>>());
    html::close(page)
}

/// Every axis in its sigma: the references, the flight, and what the explanation leaves of it.
fn picture(report: &Report) -> String {
    let dots = |name: &str, tone: Tone, of: &dyn Fn(&AxisChange) -> Vec<f64>| {
        let points = report.balance.iter().enumerate().flat_map(|(k, axis)| {
            of(axis).into_iter().map(move |share| [k as f64, share / axis.sigma])
        });
        Series { name: name.into(), tone, mark: Mark::Dots, points: points.collect() }
    };
    let all = [
        dots("references", Tone::Truth, &|axis| axis.references.clone()),
        dots("this flight", Tone::Estimate, &|axis| vec![axis.share]),
        dots("less the most probable cause", Tone::Command, &|axis| {
            axis.left.into_iter().collect()
        }),
    ];
    let limit = |y: f64| Limit { name: format!("{y:+.0} sigma"), y };
    let plot = Plot {
        title: "Change against healthy flights".into(),
        y_label: "sigma".into(),
        series: all.into_iter().filter(|series| !series.points.is_empty()).collect(),
        limits: vec![limit(-2.0), limit(2.0)],
        least_height: 8.0,
        categories: report
            .balance
            .iter()
            .enumerate()
            .map(|(k, axis)| (k as f64, axis.axis.to_owned(), String::new()))
            .collect(),
        x_range: Some([-0.6, report.balance.len() as f64 - 0.4]),
        size_px: PICTURE_PX,
        ..Plot::default()
    };
    plot.render()
}

fn changes(report: &Report) -> String {
    let share = |share: f64| format!("{:+.1} %", 100.0 * share);
    let rows = report.balance.iter().map(|axis| {
        let left = axis.left.map_or(String::new(), share);
        let healthy = format!("\u{b1}{:.1} %", 100.0 * axis.sigma);
        vec![Cell::from(axis.axis), share(axis.share).into(), healthy.into(), left.into()]
    });
    let shaking =
        report.shaking.map(|times| vec![Cell::from("shaking"), format!("{times:.1} times").into()]);
    let rows: Vec<_> = rows.chain(shaking).collect();
    html::table(["Axis", "#This flight", "#Healthy", "#Left by the most probable cause"], &rows)
}

#[cfg(test)]
mod tests {
    use haltere_gap::balance::{Hover, diagnose};
    use haltere_model::rotorcraft::Rotorcraft;

    use super::*;

    #[test]
    fn prop_the_page_says_the_verdict_and_what_was_not_checked() {
        let file = include_str!("../../../sim/rotorcraft/crazyflie-2.1.toml");
        let vehicle = Rotorcraft::from_toml(file).unwrap();
        let hover = |name: &str, balance: [f64; 4]| Hover {
            name: name.into(),
            balance,
            shake: -3.0,
            rate_hz: 100.0,
            hover_s: 10.0,
            by_height: true,
            by_speed: false,
            offset_g: [None; 3],
        };
        let references = [0.0, 0.002, -0.002].map(|share| hover("healthy & sound", [share; 4]));
        // Motor 3 is told a third more.
        let weak = hover("bad<1>", [0.08, 0.08, -0.08, 0.08]);
        let report = diagnose(&weak, &[], &references, &vehicle, None).unwrap();
        let page = render(&report);
        for part in [
            "bad&lt;1&gt;",
            "healthy &amp; sound",
            "<svg",
            "less the most probable cause",
            "speed: none was logged",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(page.contains(&crate::report::svg::escape(&report.verdict)), "{}", report.verdict);
        assert!(!page.contains("On flights that were not used"));
        let none = without("short", &Outcome::NotTestable { why: "it hovers 2 s".into() });
        assert!(none.contains("not testable") && none.contains("it hovers 2 s"));
    }
}
