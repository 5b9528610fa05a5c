//! The report as one HTML file: what was compared, then each experiment with its tables and figures.
//! Needs no network and no other file.

use std::fmt::Write as _;

use haltere::report::html::{self, Cell, WRAPS};
use haltere::report::svg::escape;
use haltere::report::verdict::all_passed;

use super::print::{HEAD, WORDS, cells};
use super::results::{CREDIT, Cell as PaperCell, Claim, Section, Spread, Verdict};
use super::{About, Outcome, summary};

/// Style of what only this page has.
const STYLE: &str = "h2{margin-top:44px;font-size:18px;border-top:2px solid var(--rule);padding-top:14px}\
h3{font-size:14px;margin:20px 0 2px}\
nav{columns:2;margin:10px 0 20px}nav a{color:var(--e);text-decoration:none;display:block}\
table{margin:8px 0}p{max-width:92ch}td.why{max-width:44ch}\
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
    let class = if good { "good" } else { "bad" };
    let words = if failed { "FAILED".into() } else { format!("{met} of {all} targets") };
    let subtitle = format!(
        "haltere {}, simulated in lockstep: {} repetitions, {} s of flight in {:.0} s{}",
        env!("CARGO_PKG_VERSION"),
        about.repetitions,
        about.flown_s,
        about.took_s,
        if about.changed.is_empty() {
            String::new()
        } else {
            format!("; changed: {}", about.changed.join(", "))
        }
    );
    page += &html::header(Some((class, &words)), "The source's experiments", &subtitle);
    let _ = write!(page, "<p>{}</p><table><tbody>", escape(&about_rows()));
    for line in summary(outcomes) {
        let class = match line.claim {
            Claim::Reproduced | Claim::Better => "good",
            Claim::Partly | Claim::NotFlown => "none",
            Claim::NotReproduced => "bad",
        };
        let _ = write!(
            page,
            "<tr><td class=\"{class}\">{}</td><td>{}</td></tr>",
            line.claim.word(),
            prose(&line.text)
        );
    }
    page.push_str("</tbody></table><nav>");
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

/// What the rows are.
pub fn about_rows() -> String {
    format!(
        "Source: Gonz\u{e1}lez, de Croon, Olejnik, Kar\u{e1}sek, Position controller for a flapping-wing drone using UWB, IMAV 2021. \
         **As printed** is its system alone, flown here: `control.version = \"raw\"` and `\"paper\"`, gains guessed near what its table gives. **As shipped** is `raw` and `modified` with our gains. Means \u{b1} standard deviation over repetitions. *Agrees*: \
         the mean lies within 10 % of the source's for sure (two standard errors). *Scatters*: nobody can tell. *Kinder world*: \
         better, where the simulator is kinder than reality. *Explained*: a run or calculation of this report closes {:.0} to \
         {:.0} % of the difference.",
        100.0 * CREDIT[0],
        100.0 * CREDIT[1]
    )
}

/// Ours beside the source's.
fn rows(page: &mut String, section: &Section) {
    if section.rows.is_empty() {
        return;
    }
    let lines = section.rows.iter().map(|row| {
        let cell = |(name, text): (&&str, String)| {
            let of = |found: Option<&Spread>| match found.map(|f| row.verdict_of(f)) {
                Some(Verdict::Agrees | Verdict::Better) => "good",
                Some(Verdict::NotExplained) => "bad",
                _ => "none",
            };
            let class = match *name {
                "printed" => of(row.printed.as_ref()),
                "shipped" => of(Some(&row.ours)),
                name if WORDS.contains(&name) => WRAPS,
                _ => "",
            };
            Cell::markup(class, prose(&text))
        };
        let cells = HEAD.iter().zip(cells(row)).map(cell);
        cells.chain([Cell::from(&row.source.origin)]).collect()
    });
    let heads = HEAD.iter().map(|name| match name.is_empty() || WORDS.contains(name) {
        true => (*name).to_owned(),
        false => format!("#{name}"),
    });
    let heads: Vec<String> = heads.chain(["place".to_owned()]).collect();
    *page += &html::table(heads.iter().map(String::as_str), &lines.collect::<Vec<_>>());
}

fn draw(page: &mut String, section: &Section) {
    let _ = write!(page, "<p class=\"note\">{}</p>", prose(&section.method));
    rows(page, section);
    for table in &section.tables {
        let _ = write!(page, "<h3>{}</h3>", escape(&table.title));
        let heads = table.columns.iter().enumerate();
        let heads = heads.map(|(k, name)| if k == 0 { name.clone() } else { format!("#{name}") });
        let heads: Vec<String> = heads.collect();
        let cell = |cell: &PaperCell| match cell {
            PaperCell::Text(text) if text.len() > LONG => Cell::of(WRAPS, text),
            cell => cell.text().into(),
        };
        let rows = table.rows.iter().map(|row| row.iter().map(cell).collect());
        *page += &html::table(heads.iter().map(String::as_str), &rows.collect::<Vec<_>>());
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
