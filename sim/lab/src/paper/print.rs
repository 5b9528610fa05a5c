//! The results as text for the terminal and as JSON.

use std::fmt::Write as _;

use haltere::report::verdict::Verdict as CheckVerdict;
use serde_json::{Value, json};

use super::results::{Cell, Row, Section, Table};
use super::{About, Outcome, summary};

/// Columns that hold words, set to the left.
pub const WORDS: [&str; 3] = [HEAD[4], HEAD[5], HEAD[6]];
/// Points that a drawn series keeps in JSON.
const POINTS: usize = 200;

/// Everything as text, the summary first.
pub fn text(outcomes: &[Outcome]) -> String {
    let mut out = String::new();
    for line in summary(outcomes) {
        let _ = writeln!(out, "{:<15} {}", line.claim.word(), line.text);
    }
    for Outcome { experiment, section } in outcomes {
        let _ = writeln!(out, "\n{} {}", experiment.number, experiment.title);
        match section {
            Err(error) => {
                let _ = writeln!(out, "  failed: {error}");
            }
            Ok(section) => section_text(&mut out, section),
        }
    }
    out
}

fn section_text(out: &mut String, section: &Section) {
    if !section.rows.is_empty() {
        let head = HEAD.map(String::from).to_vec();
        let rows = section.rows.iter().map(|row| cells(row).to_vec());
        columns(out, std::iter::once(head).chain(rows).collect());
    }
    for Table { title, columns: names, rows, .. } in &section.tables {
        let _ = writeln!(out, "  {title}");
        let cells = rows.iter().map(|row| row.iter().map(Cell::text).collect());
        columns(out, std::iter::once(names.clone()).chain(cells).collect());
    }
    for finding in &section.findings {
        let _ = writeln!(out, "  {finding}");
    }
    for check in &section.targets {
        if check.verdict == CheckVerdict::Fail {
            let _ = writeln!(
                out,
                "  target missed: {}: {}, {}",
                check.name, check.found, check.allowed
            );
        }
    }
}

/// Heads of the columns of rows.
pub const HEAD: [&str; 7] =
    ["", "source", "as printed", "as shipped", "printed", "shipped", "why, as far as checked"];

/// A row under these heads. What was flown once for both columns stands in the second.
pub fn cells(row: &Row) -> [String; 7] {
    let printed = row.printed.as_ref();
    [
        format!("{}{}", row.what, unit(row.unit)),
        row.source_text(),
        printed.map_or_else(|| "\u{2192}".into(), |p| p.text(row.decimals)),
        row.ours.text(row.decimals),
        printed.map_or_else(String::new, |p| row.verdict_of(p).word().into()),
        row.verdict_of(&row.ours).word().into(),
        row.why_text(),
    ]
}

/// A unit behind a name.
pub fn unit(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(", {unit}") }
}

/// Columns as wide as their widest cell; the first is set to the left.
fn columns(out: &mut String, rows: Vec<Vec<String>>) {
    let count = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |k: usize| rows.iter().filter_map(|r| r.get(k)).map(|c| c.chars().count()).max();
    let widths: Vec<usize> = (0..count).map(|k| width(k).unwrap_or(0)).collect();
    for row in &rows {
        let mut line = String::from("   ");
        for (k, (cell, width)) in row.iter().zip(&widths).enumerate() {
            let pad = " ".repeat(width - cell.chars().count());
            let words = rows.first().is_some_and(|head| WORDS.contains(&head[k].as_str()));
            let _ = if k == 0 || words {
                write!(line, " {cell}{pad} ")
            } else {
                write!(line, " {pad}{cell} ")
            };
        }
        let _ = writeln!(out, "{}", line.trim_end());
    }
}

/// Everything as JSON.
pub fn json(outcomes: &[Outcome], about: &About<'_>) -> Value {
    json!({
        "repetitions": about.repetitions,
        "flown_s": about.flown_s,
        "took_s": about.took_s,
        "changed": about.changed,
        "summary": summary(outcomes).iter().map(|l| json!({
            "claim": l.claim.word(),
            "text": l.text,
        })).collect::<Vec<_>>(),
        "experiments": outcomes.iter().map(outcome_json).collect::<Vec<_>>(),
    })
}

fn outcome_json(outcome: &Outcome) -> Value {
    let experiment = outcome.experiment;
    let head = json!({
        "name": experiment.name,
        "number": experiment.number,
        "title": experiment.title,
    });
    let body = match &outcome.section {
        Err(error) => json!({ "failed": error }),
        Ok(section) => section_json(section),
    };
    match (head, body) {
        (Value::Object(mut head), Value::Object(body)) => {
            head.extend(body);
            Value::Object(head)
        }
        (head, _) => head,
    }
}

fn section_json(section: &Section) -> Value {
    let rows = section.rows.iter().map(|row| {
        json!({
            "what": row.what,
            "unit": row.unit,
            "ours": row.ours,
            "source": row.source,
            "printed": row.printed,
            "verdict": row.verdict().word(),
            "verdict_shipped": row.verdict_of(&row.ours).word(),
            "trials": row.trials.iter().map(|t| json!({
                "change": t.change,
                "value": t.value,
                "closes": row.closes(t),
            })).collect::<Vec<_>>(),
        })
    });
    let figures = section.figures.iter().map(|figure| {
        json!({
            "name": figure.name,
            "caption": figure.caption,
            "plots": figure.plots.iter().map(|plot| json!({
                "title": plot.title,
                "x": plot.x_label,
                "y": plot.y_label,
                "series": plot.series.iter().map(|s| json!({
                    "name": s.name,
                    "points": thinned(&s.points),
                })).collect::<Vec<_>>(),
            })).collect::<Vec<_>>(),
        })
    });
    json!({
        "method": section.method,
        "rows": rows.collect::<Vec<_>>(),
        "tables": section.tables.iter().map(|table| json!({
            "title": table.title,
            "columns": table.columns,
            "rows": table.rows.iter().map(|row| row.iter().map(|cell| match cell {
                Cell::Text(text) => json!(text),
                Cell::Spread(spread, _) => json!(spread),
            }).collect::<Vec<_>>()).collect::<Vec<_>>(),
            "note": table.note,
        })).collect::<Vec<_>>(),
        "figures": figures.collect::<Vec<_>>(),
        "findings": section.findings,
        "targets": section.targets.iter().map(|c| json!({
            "name": c.name,
            "found": c.found,
            "allowed": c.allowed,
            "met": c.verdict == CheckVerdict::Pass,
        })).collect::<Vec<_>>(),
    })
}

fn thinned(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let step = points.len().div_ceil(POINTS).max(1);
    let round = |v: f64| (v * 1e4).round() / 1e4;
    points.iter().step_by(step).map(|p| p.map(round)).collect()
}
