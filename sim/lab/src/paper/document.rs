//! The summary and every number as Markdown: docs/PAPER.md.

use std::fmt::Write as _;

use super::page::about_rows;
use super::print::{HEAD, OTHER, OTHER_AT, cells};
use super::{About, Outcome, summary};

/// What the page says before the numbers.
const HEAD_OF_PAGE: &str = "\
# The source's experiments

Written by `haltere-lab paper --beside FILE --doc docs/PAPER.md`, FILE by `haltere-lab beside FILE`; do not edit by hand.
The same with plots, tables in every window and what else was found: `paper/paper.html`. `--only steps` flies one
experiment, `--set KEY=VALUE` another configuration.
";

/// The whole page.
pub fn render(outcomes: &[Outcome], about: &About<'_>) -> String {
    let mut page = format!("{HEAD_OF_PAGE}\n{}\n", about_rows());
    let _ = write!(page, "\n{} repetitions, {} s of flight.", about.repetitions, about.flown_s);
    if !about.changed.is_empty() {
        let _ = write!(page, " Changed: {}.", about.changed.join(", "));
    }
    page.push_str(
        "\n\n## In twelve lines\n\n| stands | claim of the source, ours (source) |\n|---|---|\n",
    );
    for line in summary(outcomes) {
        let _ = writeln!(page, "| {} | {} |", line.claim.word(), cell(&line.text));
    }
    for Outcome { experiment, section } in outcomes {
        let section = match section {
            Ok(section) if section.rows.is_empty() => continue,
            Ok(section) => section,
            Err(error) => {
                let _ = writeln!(page, "\n## {}\n\nFailed: {error}", experiment.title);
                continue;
            }
        };
        let _ = writeln!(page, "\n## {}\n\n{}\n", experiment.title, section.method);
        let others = section.rows.iter().any(|r| r.other.is_some());
        let mut head = HEAD.to_vec();
        if others {
            head.insert(OTHER_AT, OTHER);
        }
        let _ = writeln!(page, "| {} |\n|{}", head.join(" | "), "---|".repeat(head.len()));
        for row in &section.rows {
            let cells: Vec<String> = cells(row, others).iter().map(|c| cell(c)).collect();
            let _ = writeln!(page, "| {} |", cells.join(" | "));
        }
        for finding in &section.findings {
            let _ = writeln!(page, "\n* {finding}");
        }
    }
    page
}

/// Text in a cell of a table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('*', "\\*")
}
