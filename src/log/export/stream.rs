//! The tables of a log, written while it is read: what is in memory of each is some thousand rows.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::tables::{Row, Table, rows};
use super::{ExportError, Form, about, create, csv, parquet};
use crate::record::{LogEnd, LogReader};

/// Rows that are written at once: of the widest table 4 MB, and a Parquet file has them as one row group.
const BATCH_ROWS: usize = 8192;

/// A table that was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported<W> {
    /// Name of the topic.
    pub topic: String,
    /// Rows of it.
    pub rows: usize,
    /// Columns of it.
    pub columns: usize,
    /// Where it was written.
    pub to: W,
}

/// Writes the topics of a log into `directory`, each as TOPIC.csv or TOPIC.parquet: those of `only`, or all where
/// that is empty. Every file is written, or none. Says how the log ends.
pub fn write_tables(
    log: &LogReader,
    form: Form,
    directory: &Path,
    only: &[String],
    overwrite: bool,
) -> Result<(Vec<Exported<PathBuf>>, LogEnd), ExportError> {
    let path_of = |topic: &str| directory.join(format!("{topic}.{}", form.ending()));
    let begin = |topic: &str| Ok(BufWriter::new(create(log, &path_of(topic), overwrite)?));
    let (tables, end) = stream_tables(log, form, only, begin).map_err(|error| match error {
        // There the place has the name of the topic.
        ExportError::Write { path, source } => {
            ExportError::Write { path: path_of(&path.display().to_string()), source }
        }
        other => other,
    })?;
    let mut written = Vec::new();
    for Exported { topic, rows, columns, to } in tables {
        let path = path_of(&topic);
        let failed = |source| ExportError::Write { path: path.clone(), source };
        to.into_inner().map_err(|e| failed(e.into_error()))?.finish()?;
        written.push(Exported { topic, rows, columns, to: path });
    }
    Ok((written, end))
}

/// The same to anywhere: `begin` gives the place of each table when its first row comes.
pub fn stream_tables<W: Write + Send>(
    log: &LogReader,
    form: Form,
    only: &[String],
    mut begin: impl FnMut(&str) -> Result<W, ExportError>,
) -> Result<(Vec<Exported<W>>, LogEnd), ExportError> {
    let mut open: BTreeMap<&'static str, Open<W>> = BTreeMap::new();
    let mut there: BTreeSet<&'static str> = BTreeSet::new();
    let end = rows(log, |topic, row| {
        there.insert(topic);
        if !only.is_empty() && !only.iter().any(|name| name == topic) {
            return Ok(());
        }
        if let Some(table) = open.get_mut(topic) {
            return table.push(row);
        }
        let table = Open::begin(log, topic, row, form, begin(topic)?)?;
        open.insert(topic, table);
        Ok(())
    })?;
    if there.is_empty() {
        return Err(ExportError::NoTopics { path: log.path().to_owned() });
    }
    if let Some(topic) = only.iter().find(|topic| !there.contains(topic.as_str())) {
        let there = there.into_iter().map(str::to_owned).collect();
        return Err(ExportError::NoTopic { topic: topic.clone(), there });
    }
    let written = open.into_values().map(Open::finish).collect::<Result<_, _>>()?;
    Ok((written, end))
}

/// A table in the making.
struct Open<W: Write + Send> {
    /// Rows that wait.
    table: Table,
    /// Rows that were written.
    written: usize,
    to: To<W>,
}

enum To<W: Write + Send> {
    Csv(W),
    Parquet(parquet::Writer<W>),
}

impl<W: Write + Send> Open<W> {
    /// The columns are those of its first row.
    fn begin(
        log: &LogReader,
        topic: &str,
        first: Row,
        form: Form,
        mut out: W,
    ) -> Result<Self, ExportError> {
        let mut table = Table { name: topic.to_owned(), columns: Vec::new() };
        table.push(first);
        let begun = match form {
            Form::Csv => csv::head(&table, &mut out).map(|()| To::Csv(out)),
            Form::Parquet => parquet::Writer::begin(&table, &about(log), out).map(To::Parquet),
        };
        let to = begun.map_err(|source| failed(&table, source))?;
        Ok(Self { table, written: 0, to })
    }

    fn push(&mut self, row: Row) -> Result<(), ExportError> {
        self.table.push(row);
        if self.table.rows() >= BATCH_ROWS { self.write() } else { Ok(()) }
    }

    fn write(&mut self) -> Result<(), ExportError> {
        let done = match &mut self.to {
            To::Csv(out) => csv::rows(&self.table, out),
            To::Parquet(out) => out.rows(&self.table),
        };
        done.map_err(|source| failed(&self.table, source))?;
        self.written += self.table.rows();
        self.table.clear();
        Ok(())
    }

    fn finish(mut self) -> Result<Exported<W>, ExportError> {
        if self.table.rows() > 0 {
            self.write()?;
        }
        let done = match self.to {
            To::Csv(mut out) => out.flush().map(|()| out),
            To::Parquet(out) => out.finish(),
        };
        let to = done.map_err(|source| failed(&self.table, source))?;
        let (rows, columns) = (self.written, self.table.columns.len());
        Ok(Exported { topic: self.table.name, rows, columns, to })
    }
}

fn failed(table: &Table, source: io::Error) -> ExportError {
    ExportError::Write { path: PathBuf::from(&table.name), source }
}
