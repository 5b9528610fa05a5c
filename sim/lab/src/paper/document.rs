//! The summary and every number as Markdown: docs/PAPER.md. Short: what has no place here is on the page.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::page::about_rows;
use super::print::{HEAD, cells, unit};
use super::results::{Row, Section};
use super::{About, Outcome, summary};

/// What the page says before the numbers.
const HEAD_OF_PAGE: &str = "\
# The source's experiments

Written by `haltere-lab paper --beside FILE --doc docs/PAPER.md`, FILE by `haltere-lab beside FILE`; do not edit by hand.
Plots, every window and measure, and why numbers differ: `paper/paper.html`. `--only steps` flies one experiment, `--set
KEY=VALUE` another configuration, `--identify` finds the source's gains.
";
/// Experiments whose findings are told here; those of the others stand on the page.
const TOLD: [&str; 4] = ["laws", "height", "ground", "steps"];
/// Tables of the source with more numbers than this are set as it sets them.
const FEW: usize = 20;

/// The whole page.
pub fn render(outcomes: &[Outcome], about: &About<'_>) -> String {
    let mut page = format!("{HEAD_OF_PAGE}\n## In short\n\n|stands|claim (source)|\n|---|---|\n");
    for line in summary(outcomes) {
        let _ = writeln!(page, "|{}|{}|", line.claim.word(), cell(&line.text));
    }
    let _ = write!(page, "\n{}\n\n{} repetitions.", about_rows(), about.repetitions);
    if !about.changed.is_empty() {
        let _ = write!(page, " Changed: {}.", about.changed.join(", "));
    }
    page.push('\n');
    for Outcome { experiment, section } in outcomes {
        let section = match section {
            Ok(section) => section,
            Err(error) => {
                let _ = writeln!(page, "\n## {}\n\nFailed: {error}", experiment.title);
                continue;
            }
        };
        let _ = writeln!(page, "\n## {}\n\n{}\n", experiment.title, section.method);
        tables(&mut page, section);
        for finding in section.findings.iter().filter(|_| TOLD.contains(&experiment.name)) {
            let _ = writeln!(page, "\n* {finding}");
        }
    }
    page
}

/// Every number: few row by row, those of a long table as the source sets them.
fn tables(page: &mut String, section: &Section) {
    let mut by_table: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
    for row in &section.rows {
        by_table.entry(row.source.origin).or_default().push(row);
    }
    let long: Vec<&str> =
        by_table.iter().filter(|(_, rows)| rows.len() > FEW).map(|(name, _)| *name).collect();
    for name in &long {
        matrix(page, name, &by_table[name]);
    }
    let rest: Vec<&Row> = section
        .rows
        .iter()
        .filter(|r| !long.contains(&r.source.origin) || !r.what.contains(", "))
        .collect();
    if !rest.is_empty() {
        let head = &HEAD[..6];
        let _ = writeln!(page, "|{}|\n|{}", head.join("|"), "---|".repeat(head.len()));
    }
    for row in rest {
        let cells: Vec<String> = cells(row)[..6].iter().map(|c| cell(c)).collect();
        let _ = writeln!(page, "|{}|", cells.join("|"));
    }
    for table in section.tables.iter().filter(|t| t.in_document) {
        let _ = writeln!(
            page,
            "\n{}\n\n|{}|\n|{}",
            table.note,
            table.columns.join("|"),
            "---|".repeat(table.columns.len())
        );
        for row in &table.rows {
            let cells: Vec<String> = row.iter().map(|c| cell(&c.text())).collect();
            let _ = writeln!(page, "|{}|", cells.join("|"));
        }
    }
}

/// Cells named "column, row": source/as printed/as shipped.
fn matrix(page: &mut String, name: &str, rows: &[&Row]) {
    let split: Vec<(&str, &str, &Row)> =
        rows.iter().filter_map(|r| r.what.split_once(", ").map(|(c, at)| (c, at, *r))).collect();
    let distinct = |pick: &dyn Fn(&(&str, &str, &Row)) -> String| {
        let mut found: Vec<String> = Vec::new();
        for one in split.iter().map(pick) {
            if !found.contains(&one) {
                found.push(one);
            }
        }
        found
    };
    let columns = distinct(&|s| s.0.to_owned());
    let _ = writeln!(
        page,
        "|{name}|{}|\n|{}",
        columns.join("|").replace('*', "\\*"),
        "---|".repeat(columns.len() + 1)
    );
    for at in distinct(&|s| s.1.to_owned()) {
        let of = |column: &String| {
            let row = split.iter().find(|s| s.0 == column && s.1 == at)?.2;
            let number = |v: f64| format!("{v:.*}", row.decimals);
            let printed = row.printed.as_ref().map_or_else(String::new, |p| number(p.mean) + "/");
            Some(format!("{}/{printed}{}", row.source_text(), number(row.ours.mean)))
        };
        let cells = columns.iter().map(|c| of(c).unwrap_or_default());
        let measure = split.iter().find(|s| s.1 == at).map_or(String::new(), |s| unit(s.2.unit));
        let _ = writeln!(page, "|{at}{measure}|{}|", cells.collect::<Vec<_>>().join("|"));
    }
    page.push('\n');
}

/// Text in a cell of a table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('*', "\\*")
}
