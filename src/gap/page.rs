//! The gap report as one HTML file: verdict, block chain, candidates, shrink, what this flight
//! cannot say, and everything behind it. Needs no network and no other file.

use std::fmt::Write as _;

use super::diagnosis::Diagnosis;
use crate::model::effects::Block;
use crate::report::html;
use crate::report::svg::{Limit, Mark, Plot, Series, Tone, escape};

/// The chain in the order in which one block feeds the next.
const CHAIN: [Block; 11] = [
    Block::Mission,
    Block::Controller,
    Block::Link,
    Block::InnerLoop,
    Block::Thrust,
    Block::Aerodynamics,
    Block::Battery,
    Block::Imu,
    Block::Uwb,
    Block::Estimator,
    Block::Timing,
];
/// Candidates that the table lists.
const LISTED: usize = 8;
/// Sigma from which a block counts as loud, and as very loud.
const LOUD: [f64; 2] = [3.0, 10.0];
/// Style of what only this page has.
const OWN_STYLE: &str = ".chain{display:flex;flex-wrap:wrap;gap:6px;margin:10px 0}\
.chain div{border:2px solid var(--rule);border-radius:6px;padding:6px 10px;min-width:84px}\
.chain .loud{border-color:var(--c)}.chain .most{border-color:var(--c);border-width:4px;font-weight:700}\
.chain small{display:block;color:var(--soft);font-weight:400}";

/// The whole page.
pub fn render(d: &Diagnosis) -> String {
    let mut html = html::open("Gap report", OWN_STYLE);
    let against = match d.references {
        0 => "the nominal simulator".to_owned(),
        n => format!("the nominal simulator and {n} reference flights"),
    };
    let tone = match d.outcome {
        "no_gap" => "good",
        "log_fault" | "not_testable" => "none",
        _ => "bad",
    };
    let _ = write!(
        html,
        "<header><span class=\"verdict {tone}\">{}</span><div><h1>Gap report</h1><p>{} against \
         {against}; replay: {}</p></div></header><p>{}</p>",
        escape(&d.outcome.replace('_', " ")),
        escape(&d.log),
        escape(&d.replay),
        escape(&d.verdict),
    );
    list(&mut html, "", d.faults.iter().chain(&d.remarks));
    if let Some(attribution) = &d.attribution {
        chain(&mut html, d);
        effects(&mut html, d);
        shrink(&mut html, d);
        candidates(&mut html, d);
        let _ = write!(
            html,
            "<h2>Behind the verdict</h2><table><tr><th>Test</th><th class=\"n\">Found</th>\
             <th class=\"n\">Limit</th></tr>"
        );
        let (gate, adequacy) = (&attribution.gate, &attribution.adequacy);
        for (name, found, limit) in [
            ("Gate: log evidence of the best effect over none", gate.gain, gate.gain_limit),
            ("Gate: normal score of the whole distance", gate.distance, gate.distance_limit),
            ("Gate: share of the forest that sees an effect", gate.seen, gate.seen_limit),
            (
                "Adequacy: log odds that the explanation is not the cause",
                adequacy.score,
                adequacy.limit,
            ),
            ("Second effect: evidence relative to the first", f64::NAN, attribution.pair_limit),
        ] {
            let found = if found.is_finite() { format!("{found:.2}") } else { "not tried".into() };
            let _ = write!(
                html,
                "<tr><td>{name}</td><td class=\"n\">{found}</td><td class=\"n\">{limit:.2}</td></tr>"
            );
        }
        let _ = write!(
            html,
            "</table><p class=\"note\">Gate: above any limit a gap is said to be there. Limits come from \
             held-out flights without a gap; {} statistics in use, {} unknown on this flight.</p>",
            attribution.used,
            attribution.unknown.len()
        );
    }
    if !d.not_testable.is_empty() {
        let _ = write!(
            html,
            "<h2>Not testable on this flight</h2><p>{}</p><p class=\"note\">Most flights with these \
             effects look like flights without, on what this flight visited. Missing data is no \
             pass.</p>",
            escape(&d.not_testable.join(" "))
        );
    }
    if !d.parameters_changed.is_empty() {
        html.push_str("<h2>Configuration away from its default</h2><table><tr><th>Key</th><th>Flown</th><th>Default</th></tr>");
        for p in &d.parameters_changed {
            let _ = write!(
                html,
                "<tr><td>{}</td><td>{}</td><td>{}</td></tr>",
                escape(&p.key),
                escape(&p.flown),
                escape(&p.default)
            );
        }
        html.push_str("</table>");
    }
    let _ = write!(html, "<p class=\"note\">Bank {}</p>", escape(&d.bank));
    html::close(html)
}

fn list<'a>(html: &mut String, title: &str, lines: impl Iterator<Item = &'a String>) {
    let lines: Vec<String> = lines.map(|line| format!("<li>{}</li>", escape(line))).collect();
    if !lines.is_empty() {
        let _ = write!(html, "<h2>{title}</h2><ul>{}</ul>", lines.concat());
    }
}

/// Blocks as boxes; loud ones have a heavy border and their sigma.
fn chain(html: &mut String, d: &Diagnosis) {
    html.push_str("<h2>Where</h2><div class=\"chain\">");
    let scores = d.attribution.as_ref().map_or(&[][..], |a| &a.blocks[..]);
    let loudest = scores.iter().map(|b| b.sigma).fold(0.0, f64::max);
    for block in CHAIN {
        let name = block.name();
        let found = scores.iter().find(|b| b.block == name);
        let (class, text) = match found {
            None => ("", "no statistic".to_owned()),
            Some(b) if b.sigma >= LOUD[0] && b.sigma >= loudest => ("most", sigma(b.sigma)),
            Some(b) if b.sigma >= LOUD[0] => ("loud", sigma(b.sigma)),
            Some(b) => ("", sigma(b.sigma)),
        };
        let place = d.places.iter().find(|p| p.block == name);
        let anchor =
            place.and_then(|p| p.anchor).map_or(String::new(), |a| format!(", anchor {a}"));
        let _ = write!(html, "<div class=\"{class}\">{name}<small>{text}{anchor}</small></div>");
    }
    let _ = write!(
        html,
        "</div><p class=\"note\">Sigma above flights without a gap; heavy border from {} sigma, \
         heaviest the loudest.</p>",
        LOUD[0]
    );
}

fn sigma(value: f64) -> String {
    format!("{value:.1} sigma")
}

fn effects(html: &mut String, d: &Diagnosis) {
    if d.effects.is_empty() {
        return;
    }
    html.push_str("<h2>Which</h2><table><tr><th>Effect</th><th class=\"n\">Probability</th><th>Parameter</th><th class=\"n\">Value</th><th class=\"n\">90 %</th></tr>");
    for effect in &d.effects {
        for (k, p) in effect.parameters.iter().enumerate() {
            let head = if k == 0 {
                format!(
                    "<td>{} {}</td><td class=\"n\">{:.2}</td>",
                    escape(&effect.id),
                    escape(&effect.name),
                    effect.probability
                )
            } else {
                "<td></td><td></td>".to_owned()
            };
            let _ = write!(
                html,
                "<tr>{head}<td>{}, {}</td><td class=\"n\">{:.4}</td><td class=\"n\">{:.4} to {:.4}</td></tr>",
                escape(&p.name),
                escape(&p.unit),
                p.value,
                p.low,
                p.high
            );
        }
    }
    html.push_str("</table>");
}

fn shrink(html: &mut String, d: &Diagnosis) {
    html.push_str("<h2>How far</h2>");
    let Some(s) = &d.shrink else {
        html.push_str("<p>Not measured: needs a flight that the fit did not see.</p>");
        return;
    };
    let bars: Vec<(f64, &str, f64)> = vec![(0.0, "before", s.before), (1.0, "after", s.after)];
    let plot = Plot {
        title: "Distance to the held-out flight".into(),
        y_label: "mean squared sigma".into(),
        series: bars
            .iter()
            .map(|(x, name, value)| Series {
                name: (*name).to_owned(),
                tone: Tone::Family(*x as u8),
                mark: Mark::Line,
                points: vec![[*x, 0.0], [*x, *value]],
            })
            .collect(),
        limits: vec![Limit { name: "floor".into(), y: s.floor }],
        categories: bars.iter().map(|(x, n, _)| (*x, (*n).to_owned(), String::new())).collect(),
        x_range: Some([-0.7, 1.7]),
        size_px: [460.0, 220.0],
        ..Plot::default()
    };
    let value = s.value.map_or("nothing to shrink".to_owned(), |v| format!("{v:.2}"));
    let interval = match (s.low, s.high) {
        (Some(low), Some(high)) => format!("95 %: {low:.2} to {high:.2}"),
        _ => "no interval: fewer than three flights".to_owned(),
    };
    let more = |name: &str, v: Option<f64>| v.map_or(String::new(), |v| format!("; {name} {v:.2}"));
    let _ = write!(
        html,
        "<p>Share of the gap that is closed: {value} ({interval}){}{}</p><figure class=\"bars\" style=\"max-width:480px\">{}</figure>",
        more("best of all candidates", s.attainable),
        more("median of other effects", s.wrong),
        plot.render()
    );
}

fn candidates(html: &mut String, d: &Diagnosis) {
    let Some(attribution) = &d.attribution else { return };
    html.push_str("<h2>Candidates</h2><table><tr><th>Effect</th><th class=\"n\">Probability</th><th class=\"n\">Log evidence over none</th><th class=\"n\">Left unexplained</th><th class=\"n\">Apart from the first</th></tr>");
    for (k, c) in attribution.candidates.iter().take(LISTED).enumerate() {
        let apart = match c.distance {
            _ if k == 0 => "itself".to_owned(),
            Some(d) => format!("{d:.1} sigma"),
            None => "told apart".to_owned(),
        };
        let _ = write!(
            html,
            "<tr><td>{}</td><td class=\"n\">{:.2}</td><td class=\"n\">{:.1}</td><td class=\"n\">{:.1}</td><td class=\"n\">{apart}</td></tr>",
            escape(&c.id),
            c.posterior,
            c.log_evidence,
            c.residual_score
        );
    }
    html.push_str("</table><p class=\"note\">Left unexplained: normal score of the distance that remains, near 0 when nothing does.</p>");
}

#[cfg(test)]
mod tests {
    use crate::gap::diagnosis::unreadable;

    #[test]
    fn prop_a_fault_is_told_and_escaped() {
        let page = super::render(&unreadable("a<b>.mcap".into(), "byte 0: <not> a log".into()));
        assert!(page.contains("a&lt;b&gt;.mcap") && page.contains("&lt;not&gt;"), "{page}");
        assert!(page.contains("log fault") && page.ends_with("</html>"));
        assert!(!page.contains("http"), "the page must need no network");
    }
}
