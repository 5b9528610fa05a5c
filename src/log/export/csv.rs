//! Tables as CSV, RFC 4180 with line feeds.

use std::io::{self, Write};

use super::tables::{Table, Values};

/// The line of the names.
pub(super) fn head(table: &Table, mut out: impl Write) -> io::Result<()> {
    let names: Vec<_> = table.columns.iter().map(|column| column.name.as_ref()).collect();
    writeln!(out, "{}", names.join(","))
}

/// The rows of a table, without its head.
pub(super) fn rows(table: &Table, mut out: impl Write) -> io::Result<()> {
    for row in 0..table.rows() {
        for (i, column) in table.columns.iter().enumerate() {
            if i > 0 {
                out.write_all(b",")?;
            }
            match &column.values {
                // The shortest decimal that reads back as the same number.
                Values::Real(v) => {
                    if let Some(Some(value)) = v.get(row) {
                        write!(out, "{value}")?;
                    }
                }
                Values::Whole(v) => write!(out, "{}", v.get(row).copied().unwrap_or_default())?,
                Values::Flag(v) => write!(out, "{}", v.get(row).copied().unwrap_or_default())?,
                Values::Text(v) => out.write_all(quoted(v.get(row)).as_bytes())?,
            }
        }
        out.write_all(b"\n")?;
    }
    Ok(())
}

/// A text that holds what has a meaning in CSV stands in quotes.
fn quoted(text: Option<&String>) -> String {
    let text = text.map_or("", String::as_str);
    if text.contains(['"', ',', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}
