//! The report as one HTML file: what was compared, then each experiment with its tables and figures.
//! Needs no network and no other file.

use std::fmt::Write as _;

use haltere::report::html;
use haltere::report::svg::escape;
use haltere::report::verdict::all_passed;

use super::print::unit;
use super::results::{CREDIT, Cell, Section, Verdict};
use super::{About, Outcome};

/// Style of what only this page has.
const STYLE: &str = "h2{margin-top:44px;font-size:18px;border-top:2px solid var(--rule);padding-top:14px}\
h3{font-size:14px;margin:20px 0 2px}\
nav{columns:2;margin:10px 0 20px}nav a{color:var(--e);text-decoration:none;display:block}\
table{margin:8px 0}p{max-width:92ch}td.why{max-width:44ch;font-size:12.5px}\
figcaption{color:var(--soft);font-size:12.5px;margin:2px 0 6px}";

/// Prose with `names` in backticks.
fn prose(text: &str) -> String {
    let parts: Vec<String> = text
        .split('`')
        .enumerate()
        .map(|(k, part)| {
            let part = escape(part);
            if k % 2 == 1 { format!("<code>{part}</code>") } else { part }
        })
        .collect();
    parts.concat()
}

/// Words of a cell that are longer than this are set as words, not as a number.
const LONG: usize = 24;

/// The whole page.
pub fn render(outcomes: &[Outcome], about: &About<'_>) -> String {
    let targets =
        || outcomes.iter().filter_map(|o| o.section.as_ref().ok()).flat_map(|s| &s.targets);
    let failed = outcomes.iter().any(|o| o.section.is_err());
    let met = targets().filter(|c| all_passed(std::slice::from_ref(c))).count();
    let all = targets().count();
    let good = !failed && met == all;
    let mut page = html::open("The source's experiments", STYLE);
    let _ = write!(
        page,
        "<header><span class=\"verdict {}\">{}</span><div><h1>The source's experiments</h1><p>haltere {}, \
         simulated in lockstep: {} repetitions, {} s of flight in {:.0} s{}</p></div></header>",
        if good { "good" } else { "bad" },
        if failed { "FAILED".into() } else { format!("{met} of {all} targets") },
        env!("CARGO_PKG_VERSION"),
        about.repetitions,
        about.flown_s,
        about.took_s,
        if about.changed.is_empty() {
            String::new()
        } else {
            format!("; changed: {}", escape(&about.changed.join(", ")))
        }
    );
    let _ = write!(
        page,
        "<p>Source: González, de Croon, Olejnik, Karásek, <i>Position controller for a flapping-wing drone using \
         UWB</i>, IMAV 2021. Its full text is not available to us; numbers of it that we have are named with \
         their place, all others are said to be missing. Ours are means \u{b1} standard deviation over \
         repetitions. A difference counts as explained only by a run or a calculation in this very report that \
         closes {:.0} to {:.0} % of it with one thing changed; otherwise it says so.</p><nav>",
        100.0 * CREDIT[0],
        100.0 * CREDIT[1]
    );
    for Outcome { experiment, .. } in outcomes {
        let _ = write!(
            page,
            "<a href=\"#{}\">{} {}</a>",
            experiment.name,
            experiment.number,
            escape(experiment.title)
        );
    }
    page.push_str("</nav>");
    summary(&mut page, outcomes);
    for Outcome { experiment, section } in outcomes {
        let _ = write!(
            page,
            "<h2 id=\"{}\">{} {}</h2>",
            experiment.name,
            experiment.number,
            escape(experiment.title)
        );
        match section {
            Err(error) => {
                let _ = write!(page, "<p><b>Failed:</b> {}</p>", escape(error));
            }
            Ok(section) => draw(&mut page, section),
        }
    }
    page.push_str("<footer>Frame: local NED, heights upward. Truth is the simulator's.</footer>");
    html::close(page)
}

/// Every number that the source has, at one glance.
fn summary(page: &mut String, outcomes: &[Outcome]) {
    let rows: Vec<_> = outcomes
        .iter()
        .filter_map(|o| Some((o.experiment, o.section.as_ref().ok()?)))
        .flat_map(|(e, s)| s.rows.iter().map(move |r| (e, r)))
        .filter(|(_, r)| r.source.is_some())
        .collect();
    if rows.is_empty() {
        return;
    }
    page.push_str(
        "<h3>Where the source has a number</h3><table><thead><tr><th></th><th>Quantity</th>\
         <th class=\"n\">Ours</th><th class=\"n\">Source</th><th class=\"n\">Difference</th><th></th></tr>\
         </thead><tbody>",
    );
    for (experiment, row) in rows {
        let (class, word) = match row.verdict() {
            Verdict::Agrees => ("good", "agrees"),
            Verdict::Explained(_) => ("none", "differs, explained"),
            Verdict::NotExplained => ("bad", "differs, not explained"),
            Verdict::NotAvailable => ("none", ""),
        };
        let _ = write!(
            page,
            "<tr><td><a href=\"#{}\">{}</a></td><td>{}{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
             <td class=\"n\">{}</td><td class=\"{class}\">{word}</td></tr>",
            experiment.name,
            experiment.number,
            escape(&row.what),
            unit(row.unit),
            row.ours.text(row.decimals),
            row.source_text(),
            row.difference_text(),
        );
    }
    page.push_str("</tbody></table>");
}

/// Ours beside the source's, or alone where it has no number that we know.
fn rows(page: &mut String, section: &Section) {
    if section.rows.is_empty() {
        return;
    }
    let compared = section.rows.iter().any(|r| r.source.is_some());
    page.push_str("<table><thead><tr><th>Quantity</th><th class=\"n\">Ours</th>");
    page.push_str(if compared {
        "<th class=\"n\">Source</th><th>Place</th><th class=\"n\">Difference</th>\
         <th>Why, as far as checked</th>"
    } else {
        "<th class=\"n\">Source</th>"
    });
    page.push_str("</tr></thead><tbody>");
    for row in &section.rows {
        let _ = write!(
            page,
            "<tr><td>{}{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>",
            escape(&row.what),
            unit(row.unit),
            row.ours.text(row.decimals),
            row.source_text(),
        );
        if compared {
            let _ = write!(
                page,
                "<td>{}</td><td class=\"n\">{}</td><td class=\"why\">{}</td>",
                row.source.map_or("", |s| s.origin),
                row.difference_text(),
                prose(&row.why_text())
            );
        }
        page.push_str("</tr>");
    }
    page.push_str("</tbody></table>");
}

fn draw(page: &mut String, section: &Section) {
    let _ = write!(page, "<p class=\"note\">{}</p>", prose(&section.method));
    rows(page, section);
    for table in &section.tables {
        let _ = write!(page, "<h3>{}</h3><table><thead><tr>", escape(&table.title));
        for (k, name) in table.columns.iter().enumerate() {
            let class = if k == 0 { "" } else { " class=\"n\"" };
            let _ = write!(page, "<th{class}>{}</th>", escape(name));
        }
        page.push_str("</tr></thead><tbody>");
        for row in &table.rows {
            page.push_str("<tr>");
            for (k, cell) in row.iter().enumerate() {
                let text = cell.text();
                let class = match cell {
                    _ if k == 0 => "",
                    Cell::Text(text) if text.len() > LONG => " class=\"why\"",
                    _ => " class=\"n\"",
                };
                let _ = write!(page, "<td{class}>{}</td>", escape(&text));
            }
            page.push_str("</tr>");
        }
        page.push_str("</tbody></table>");
        if !table.note.is_empty() {
            let _ = write!(page, "<p class=\"note\">{}</p>", prose(&table.note));
        }
    }
    for figure in &section.figures {
        let class = if figure.plots.iter().all(|p| p.equal) { "maps" } else { "two" };
        let _ = write!(
            page,
            "<h3>{}</h3><p class=\"note\">{}</p><div class=\"{class}\">",
            figure.name,
            prose(&figure.caption)
        );
        for plot in &figure.plots {
            page.push_str(&plot.render());
        }
        page.push_str("</div>");
    }
    if !section.findings.is_empty() {
        page.push_str("<ul>");
        for finding in &section.findings {
            let _ = write!(page, "<li>{}</li>", prose(finding));
        }
        page.push_str("</ul>");
    }
    page.push_str(&html::checks(&section.targets));
}
