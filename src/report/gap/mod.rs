//! The gap report as one HTML file: verdict, block chain, candidates, shrink, what this flight
//! cannot say, and everything behind it. Needs no network and no other file.

pub mod balance;
pub mod budget;
mod matrix;
mod next;
mod plan;

use std::fmt::Write as _;

use crate::report::html::{self, Cell};
use crate::report::svg::{Limit, Mark, Plot, Series, Tone, escape};
use haltere_gap::attribute::{Attribution, Candidate, Settings};
use haltere_gap::diagnosis::{Diagnosis, Part, ShrinkResult};
use haltere_gap::door;
use haltere_gap::outcome::Ending;
use haltere_model::effects::Block;

/// Flights per effect from which a bank is not called small: half the default.
const FULL_DRAWS: usize = 20;
/// Candidates that the table lists.
const LISTED: usize = 8;
/// Width of a drawing that is moved sideways where the screen is narrow, pixels.
const WIDE_PX: f64 = 700.0;
/// Sigma from which a block counts as loud, and as very loud.
const LOUD: [f64; 2] = [3.0, 10.0];
/// Style of what only this page has.
const OWN_STYLE: &str = ".chain{display:flex;flex-wrap:wrap;gap:6px;margin:10px 0}\
.chain div{border:2px solid var(--rule);border-radius:6px;padding:6px 10px;min-width:84px}\
.chain .loud{border-color:var(--c)}.chain .most{border-color:var(--c);border-width:4px;font-weight:700}\
.words{font-size:17px;line-height:1.5;margin:10px 0;max-width:none}\
.card{margin:4px 0 10px;border:1px solid var(--rule);background:var(--card)}.card th{width:118px;vertical-align:top;border-bottom:1px solid var(--rule)}\
.card td{font-size:14.5px}.chain small{display:block;color:var(--soft);font-weight:400}";

/// The whole page.
pub fn render(d: &Diagnosis) -> String {
    let mut html = html::open("Gap report", &format!("{OWN_STYLE}{}", matrix::STYLE));
    let tone = match d.outcome {
        Ending::NoGap => "good",
        Ending::Fault | Ending::NotTestable => "none",
        _ => "bad",
    };
    let badge = d.outcome.key().replace('_', " ");
    let subtitle = d.compared();
    html += matrix::HATCH;
    html += &html::header(Some((tone, &badge)), "Gap report", &subtitle);
    in_words(&mut html, d);
    summary(&mut html, d);
    list(&mut html, d.faults.iter().chain(&d.remarks));
    found(&mut html, d);
    if d.attribution.is_some() {
        html.push_str("<h2>Where</h2>");
        chain(&mut html, d);
    }
    if let Some(balance) = &d.balance {
        html += &html::heading("Beside the bank: the balance");
        html += &html::note(&balance.words);
    }
    if let Some(p) = &d.picture {
        html.push_str(&matrix::draw(&p.matrix));
        let _ = write!(
            html,
            "<div class=\"two\"><div><h2>In the room</h2>{}</div><div>",
            plan::plan(&p.plan)
        );
        if let Some(s) = &p.signature {
            let _ = write!(html, "<h2>Signature</h2>{}", plan::signature(s));
        }
        html.push_str("</div></div><h2>Since when</h2>");
        html.push_str(&plan::strip(p));
    }
    if let Some(found) = d.budget.as_ref().filter(|found| !found.parts.is_empty()) {
        html.push_str("<h2>Budget</h2>");
        budget::section(&mut html, found);
    }
    if let Some(attribution) = &d.attribution {
        effects(&mut html, d);
        candidates(&mut html, d);
        ladder(&mut html, d);
        shrink(&mut html, d);
        next::section(&mut html, d);
        behind(&mut html, attribution);
    }
    let rows = d.parameters_changed.iter();
    let rows = rows.map(|p| [&p.key, &p.flown, &p.default].map(Cell::from).into());
    let heads = ["Key", "Flown", "Default"];
    html += &html::titled("Configuration away from its default", heads, &rows.collect::<Vec<_>>());
    let made = &d.made_with;
    let [seeds, jitter, draws] = made.bank_flights;
    let _ = write!(
        html,
        "<footer>Bank {}: {seeds} nominal flights, {jitter} with jitter, {draws} or more of each of {} effects. Program {}, \
         source {}. SHA-256 of the log: {}</footer>",
        escape(&d.bank),
        made.library.len(),
        escape(&made.program),
        escape(&made.source_hash),
        escape(&made.log_sha256)
    );
    html::close(html)
}

/// The tests that a verdict went through, with their limits.
fn behind(html: &mut String, attribution: &Attribution) {
    let (gate, adequacy) = (&attribution.gate, &attribution.adequacy);
    let tests = [
        (
            "Is there a gap: how far all numbers together lie from healthy flights, more than",
            gate.distance,
            gate.distance_limit,
        ),
        (
            "Or: log evidence that one of the effects is there over that none is, more than",
            gate.effect,
            gate.effect_limit,
        ),
        (
            "Is it the cause: log odds that the explanation is not, less than",
            adequacy.score,
            adequacy.limit,
        ),
        (
            "Or: share of the gap that the first effect foretells in numbers that its size was not fitted to, at least",
            adequacy.foretold,
            adequacy.foretold_limit,
        ),
        (
            "Is there a second effect: its evidence relative to that of the first, more than",
            attribution.second_effect().unwrap_or(f64::NAN),
            attribution.pair_limit,
        ),
    ];
    let rows = tests.map(|(name, found, limit)| {
        let found = if found.is_finite() { format!("{found:.2}") } else { "not tried".into() };
        vec![name.into(), found.into(), format!("{limit:.2}").into()]
    });
    *html += &html::titled("Behind the verdict", ["Test", "#Found", "#Limit"], &rows);
    *html += &html::note(&format!(
        "Limits are learned from simulated flights so that of 100 flights without a gap {:.0} are given a name, though \
         {} effects are asked about. {} numbers of this flight are looked at; {} more it does not say.",
        100.0 * Settings::for_flights().false_alarm,
        attribution.candidates.len(),
        attribution.used,
        attribution.unknown.len()
    ));
}

/// What is read first, its first sentence in bold; what stands between backticks is typed.
fn in_words(html: &mut String, d: &Diagnosis) {
    let words = escape(&door::in_words(d));
    let pieces = words.split('`').enumerate();
    let typed = |(k, piece): (usize, &str)| match k % 2 {
        0 => piece.to_owned(),
        _ => format!("<code>{piece}</code>"),
    };
    let words: String = pieces.map(typed).collect();
    let (first, rest) = words.split_once(". ").unwrap_or((&words, ""));
    let stop = if rest.is_empty() { "" } else { "." };
    let _ = write!(html, "<p class=\"words\"><b>{first}{stop}</b> {rest}</p>");
}

/// What is read in twenty seconds, after the words.
fn summary(html: &mut String, d: &Diagnosis) {
    let draws = d.made_with.bank_flights[2];
    let mind = if draws > 0 && draws < FULL_DRAWS {
        format!(
            "a bank of {draws} flights an effect is for trying the program; a verdict needs --size full"
        )
    } else {
        String::new()
    };
    let truth: Vec<String> = d.truth.iter().flat_map(|truth| truth.words()).collect();
    let truth = truth.iter().map(|line| escape(line)).collect::<Vec<_>>().join("<br>");
    card(
        html,
        [
            ("What to do", next::remedy(d)),
            ("Mind", mind),
            ("Not ruled out", next::open(d)),
            ("Truth", truth),
            ("Do next", next::first(d)),
        ],
    );
}

/// The terms behind it.
fn found(html: &mut String, d: &Diagnosis) {
    let since = d.picture.as_ref().filter(|_| d.outcome.is_gap());
    let not_testable = if d.not_testable.is_empty() {
        String::new()
    } else {
        format!(
            "{}: most flights with these look like flights without, on what this flight visited, or none comes to its end",
            escape(&d.not_testable.join(" "))
        )
    };
    let named = !d.effects.is_empty();
    let shrink = if named { shrink_words(d.shrink.as_ref()) } else { String::new() };
    html.push_str("<h2>How it was found</h2>");
    card(
        html,
        [
            ("Verdict", escape(&d.verdict)),
            ("Explained", d.explained.as_ref().map_or(String::new(), |e| escape(&e.words()))),
            ("Where", escape(&whereabouts(d))),
            ("Since", since.map_or(String::new(), |p| escape(&p.onset.words()))),
            ("Shrink", shrink),
            ("Not testable", not_testable),
        ],
    );
}

/// Rows of a name and a text; those without text are left out.
fn card<const N: usize>(html: &mut String, rows: [(&str, String); N]) {
    html.push_str("<table class=\"card\">");
    for (name, text) in rows.iter().filter(|(_, text)| !text.is_empty()) {
        let _ = write!(html, "<tr><th>{name}</th><td>{text}</td></tr>");
    }
    html.push_str("</table>");
}

/// An effect by its id, with its name.
fn named(id: &str) -> String {
    let spec = haltere_gap::bank::library::find(id);
    spec.map_or_else(|| id.to_owned(), |spec| format!("{id} {}", spec.name))
}

fn whereabouts(d: &Diagnosis) -> String {
    let Some(first) = d.places.first().filter(|_| d.outcome.is_gap()) else { return String::new() };
    let mut text = format!("{}, {:.0} sigma", first.block, first.score);
    if let Some(anchor) = first.anchor {
        let _ = write!(text, ", anchor {anchor}");
    }
    for (word, part) in
        [("also", Part::Cause), ("what follows from it shows in", Part::Consequence)]
    {
        let others = d.places.iter().skip(1).filter(|p| p.part == part).take(3);
        let others: Vec<String> = others.map(|p| format!("{} {:.0}", p.block, p.score)).collect();
        if !others.is_empty() {
            let _ = write!(text, "; {word} {}", others.join(", "));
        }
    }
    if !d.exonerated.is_empty() {
        let own = d.exonerated.join(", ");
        let _ =
            write!(text, "; our own {own} did as they were told, bit for bit, and are no cause");
    }
    if let Some(p) = &d.picture {
        let dots = p.matrix.squares.iter().filter(|s| s.significant).count();
        let _ = write!(text, "; {dots} of {} cells stand out", p.matrix.tested);
    }
    text
}

fn shrink_words(s: Option<&ShrinkResult>) -> String {
    let not_measured = || "not measured: needs a flight that the fit did not see".to_owned();
    s.map_or_else(not_measured, ShrinkResult::words)
}

fn list<'a>(html: &mut String, lines: impl Iterator<Item = &'a String>) {
    let lines: Vec<String> = lines.map(|line| format!("<li>{}</li>", escape(line))).collect();
    if !lines.is_empty() {
        let _ = write!(html, "<ul>{}</ul>", lines.concat());
    }
}

/// Blocks as boxes; loud ones have a heavy border and their sigma.
fn chain(html: &mut String, d: &Diagnosis) {
    html.push_str("<div class=\"chain\">");
    let scores = d.attribution.as_ref().map_or(&[][..], |a| &a.blocks[..]);
    let first = d.places.first().map_or("", |p| p.block.as_str());
    for block in Block::CHAIN {
        let name = block.name();
        let found = scores.iter().find(|b| b.block == name);
        let (class, text) = match found {
            None => ("", "no statistic".to_owned()),
            Some(b) if name == first => ("most", sigma(b.sigma)),
            Some(b) if b.sigma >= LOUD[0] => ("loud", sigma(b.sigma)),
            Some(b) => ("", sigma(b.sigma)),
        };
        let follows = if block.is_consequence() { ", no cause" } else { "" };
        let place = d.places.iter().find(|p| p.block == name);
        let anchor =
            place.and_then(|p| p.anchor).map_or(String::new(), |a| format!(", anchor {a}"));
        let _ = write!(
            html,
            "<div class=\"{class}\">{name}<small>{text}{anchor}{follows}</small></div>"
        );
    }
    let _ = write!(
        html,
        "</div><p class=\"note\">By how many sigma each part of the vehicle, from command to sensors, lies above flights \
         without a gap; orange border from {} sigma, heaviest where the cause most likely is. Our own software shows \
         what follows from a cause and is none.</p>",
        LOUD[0]
    );
}

fn sigma(value: f64) -> String {
    format!("{value:.1} sigma")
}

fn effects(html: &mut String, d: &Diagnosis) {
    let rows = d.effects.iter().flat_map(|effect| {
        effect.parameters.iter().enumerate().map(move |(k, p)| {
            let named = format!("{} {}", effect.id, effect.name);
            let head = [named, format!("{:.2}", effect.probability)];
            let head = if k == 0 { head } else { [String::new(), String::new()] };
            let unit = if p.unit.is_empty() { "" } else { ", " };
            // Nothing lies between two choices.
            let [value, interval] = match &p.chosen {
                Some(chosen) => [chosen.clone(), String::new()],
                None => [format!("{:.4}", p.value), format!("{:.4} to {:.4}", p.low, p.high)],
            };
            let rest = [format!("{}{unit}{}", p.name, p.unit), value, interval];
            head.into_iter().chain(rest).map(Cell::from).collect()
        })
    });
    let heads = ["Effect", "#Probability", "Parameter", "#Value", "#90 %"];
    *html += &html::titled("Which", heads, &rows.collect::<Vec<_>>());
}

/// Bars as thick lines from zero, named on the axis.
fn bars(
    title: &str,
    y_label: &str,
    bars: &[(String, Vec<(Tone, f64)>)],
    limits: Vec<Limit>,
    width_px: f64,
) -> String {
    let mut series = Vec::new();
    for (k, (_, values)) in bars.iter().enumerate() {
        for (i, (tone, value)) in values.iter().enumerate() {
            let x = k as f64 + 0.16 * (i as f64 - 0.5 * (values.len() as f64 - 1.0));
            series.push(Series {
                name: String::new(),
                tone: *tone,
                mark: Mark::Line,
                points: vec![[x, 0.0], [x, *value]],
            });
        }
    }
    let plot = Plot {
        title: title.into(),
        y_label: y_label.into(),
        series,
        limits,
        categories: bars
            .iter()
            .enumerate()
            .map(|(k, (n, _))| (k as f64, n.clone(), String::new()))
            .collect(),
        x_range: Some([-0.6, bars.len() as f64 - 0.4]),
        size_px: [width_px, 230.0],
        ..Plot::default()
    };
    let wide = if width_px > WIDE_PX { " wide" } else { "" };
    format!("<div class=\"bars{wide}\" style=\"max-width:{width_px:.0}px\">{}</div>", plot.render())
}

/// What each further explanation leaves.
fn ladder(html: &mut String, d: &Diagnosis) {
    if d.ladder.len() < 2 {
        return;
    }
    html.push_str("<h2>What each effect leaves</h2><div class=\"two\">");
    let limit = d.attribution.as_ref().map_or(f64::NAN, |a| a.gate.distance_limit);
    let here: Vec<(String, Vec<(Tone, f64)>)> =
        d.ladder.iter().map(|r| (r.name.clone(), vec![(Tone::Estimate, r.left)])).collect();
    html.push_str(&bars(
        "On this flight, fitted to it",
        "left of the gap, sigma",
        &here,
        vec![Limit { name: format!("limit of flights without a gap {limit:.1}"), y: limit }],
        500.0,
    ));
    let held: Vec<(String, Vec<(Tone, f64)>)> = d
        .ladder
        .iter()
        .filter_map(|r| Some((r.name.clone(), vec![(Tone::Estimate, r.held_out?)])))
        .collect();
    match (&d.shrink, held.len() > 1) {
        (Some(s), true) => html.push_str(&bars(
            "On held-out flights",
            "mean squared sigma",
            &held,
            vec![
                Limit { name: format!("of healthy flights {:.2}", s.floor), y: s.floor },
                Limit {
                    name: format!("no gap below {:.2}", s.floor + s.noise),
                    y: s.floor + s.noise,
                },
            ],
            500.0,
        )),
        _ => html.push_str("<p>On held-out flights: not measured.</p>"),
    }
    html.push_str("</div><p class=\"note\">What is left as effects are added to the simulator, first one, then another. \
        The left side falls with every effect that is fitted, 0 is nothing left; whether one pays only the right side \
        says, on flights that it was not fitted to.</p>");
}

fn shrink(html: &mut String, d: &Diagnosis) {
    html.push_str("<h2>How far</h2>");
    let Some(s) = &d.shrink else {
        let _ = write!(html, "<p>{}.</p>", shrink_words(None));
        return;
    };
    let _ = write!(html, "<p>{}</p>", shrink_words(Some(s)));
    if s.references == 0 && d.references > 0 {
        html.push_str("<p class=\"note\">Without accepted flights on the held-out mission this distance holds all \
            that the airframe differs from the nominal simulator by.</p>");
    }
    let of = |s: &haltere_gap::shrink::Shrink| {
        vec![(Tone::Command, s.before), (Tone::Estimate, s.after), (Tone::Family(5), s.floor)]
    };
    let known: Vec<_> = s.channels.iter().filter(|(_, s)| s.before.is_finite()).collect();
    let groups: Vec<(String, Vec<(Tone, f64)>)> =
        known.iter().map(|(name, s)| (name.clone(), of(s))).collect();
    html.push_str(&bars(
        "Distance to the held-out flights by channel: before, after, floor (left to right)",
        "mean squared sigma",
        &groups,
        Vec::new(),
        1080.0,
    ));
    let rows = known.into_iter().map(|(name, c)| {
        let value = c.value.map_or("nothing to shrink".to_owned(), |v| format!("{v:.2}"));
        let numbers = [c.before, c.after, c.floor, c.noise].map(|v| format!("{v:.2}"));
        [name, &value].into_iter().chain(&numbers).map(Cell::from).collect()
    });
    let heads = ["Channel", "#Shrink", "#Before", "#After", "#Floor", "#Noise"];
    let table = html::table(heads, &rows.collect::<Vec<_>>());
    let others: Vec<String> = s
        .others
        .iter()
        .map(|(id, v)| {
            let ids: Vec<String> = id.split(" + ").map(named).collect();
            format!("{} {}", ids.join(" + "), v.map_or("none".to_owned(), |v| format!("{v:.2}")))
        })
        .collect();
    let _ = write!(
        html,
        "<details><summary>Numbers by channel, and other effects</summary>{table}<p class=\"note\">Control, shrink of \
         other effects: {}. Best of everything tried: {}.</p></details>",
        escape(&others.join(", ")),
        escape(&s.attained_by)
    );
}

fn candidates(html: &mut String, d: &Diagnosis) {
    let Some(attribution) = &d.attribution else { return };
    let Some(first) = attribution.candidates.first() else { return };
    let rows = attribution.candidates.iter().take(LISTED).enumerate().map(|(k, c)| {
        let shrunk = match &d.shrink {
            Some(s) if k == 0 && d.set.first() == Some(&c.id) => s.value,
            Some(s) => s.others.iter().find(|(id, _)| *id == c.id).and_then(|(_, v)| *v),
            None => None,
        };
        vec![
            named(&c.id).into(),
            format!("{:.2}", c.posterior).into(),
            format!("{:.1}", c.log_evidence).into(),
            format!("{:.2}", c.explained).into(),
            format!("{:.1}", c.residual_score).into(),
            shrunk.map_or("not flown".to_owned(), |v| format!("{v:.2}")).into(),
            Cell::of(html::WRAPS, &why_not(k, c, first)),
        ]
    });
    let heads = [
        "Effect",
        "#Probability",
        "#Log evidence",
        "#Explained",
        "#Left, sigma",
        "#Closes elsewhere",
        "Why not",
    ];
    *html += &html::titled("Candidates", heads, &rows.collect::<Vec<_>>());
    *html += &html::note(
        "Probability: by how like what it does the flight is. Log evidence: of its fit, over no effect. Explained: share of the gap here. \
         Left: near 0 when nothing is. Closes elsewhere: share of the gap that it closes on flights that it was not fitted to.",
    );
}

/// What speaks against a candidate, in words.
fn why_not(k: usize, c: &Candidate, first: &Candidate) -> String {
    if k == 0 {
        return "best explanation".to_owned();
    }
    let mut why = Vec::new();
    if c.log_evidence < first.log_evidence - 3.0 {
        why.push(format!(
            "explains less: log evidence {:.0} below the first",
            first.log_evidence - c.log_evidence
        ));
    } else if c.posterior < first.posterior {
        why.push("the flight is less like what it does".to_owned());
    }
    if c.residual_score > first.residual_score + 3.0 {
        why.push(format!("leaves {:.0} sigma more", c.residual_score - first.residual_score));
    }
    let spec = haltere_gap::bank::library::find(&c.id);
    for (p, v) in spec.iter().flat_map(|s| s.parameters).zip(&c.theta) {
        let width = p.high - p.low;
        let choice =
            matches!(p.name, "anchor" | "wall" | "north" | "east" | "size" | "towards" | "phase");
        if !choice && width > 0.0 && (v - p.low < 0.02 * width || p.high - v < 0.02 * width) {
            why.push(format!("needs the end of its range: {} {v:.3} {}", p.name, p.unit));
        }
    }
    why.join("; ")
}

#[cfg(test)]
mod tests {
    use haltere_gap::diagnosis::unreadable;

    #[test]
    fn prop_a_fault_is_told_and_escaped() {
        let page = super::render(&unreadable("a<b>.mcap".into(), "byte 0: <not> a log".into()));
        assert!(page.contains("a&lt;b&gt;.mcap") && page.contains("&lt;not&gt;"), "{page}");
        assert!(page.contains("log fault") && page.ends_with("</html>"));
        assert!(!page.contains("http"), "the page must need no network");
    }

    #[test]
    fn prop_what_another_build_would_have_sent_stands_on_the_page() {
        let mut d = unreadable("x.mcap".into(), "byte 3: not a log".into());
        d.faults.clear();
        d.remarks.push("another build flew this: 3 of 9000, by up to 2.00 deg".into());
        let page = super::render(&d);
        assert!(page.contains("another build flew this: 3 of 9000, by up to 2.00 deg"));
    }
}
