//! `haltere log export` and `haltere log tlog`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::{Args, ValueEnum};
use serde::Serialize;

use super::output::{print, print_json};
use haltere_log::export::{Form, create, links, write_tables, write_tlog, write_tum};
use haltere_log::record::{LogEnd, LogReader, link_from_name, link_name};
use haltere_pilot::LinkId;

/// Form of the tables.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Format {
    /// Text with commas; an empty cell where there is no value.
    Csv,
    /// Apache Parquet, typed, with nulls where there is no value.
    Parquet,
    /// Tracks for `evo`: estimate, reference and truth as `time x y z qx qy qz qw`, z up.
    Tum,
}

/// Writes the decoded topics as tables.
#[derive(Debug, Args)]
pub(super) struct Export {
    /// The log.
    log: PathBuf,
    /// Form of the tables.
    #[arg(long, value_enum, default_value = "csv")]
    format: Format,
    /// Folder for the tables, made if it is missing. Default: beside the log, with its name.
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
    /// Only these topics, such as estimate or uwb; may be given several times.
    #[arg(long, value_name = "NAME")]
    topic: Vec<String>,
    /// Truth file for --format tum, from `haltere-sim serve --truth`. Default: NAME.truth.csv beside the log, if there is one.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Replace tables that are there already.
    #[arg(long)]
    overwrite: bool,
    /// Print what was written as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct Written {
    topic: String,
    rows: usize,
    columns: usize,
    file: PathBuf,
}

impl Export {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let log = LogReader::open(&self.log)?;
        let form = match self.format {
            Format::Csv => Some(Form::Csv),
            Format::Parquet => Some(Form::Parquet),
            Format::Tum => None,
        };
        match form {
            None if !self.topic.is_empty() => {
                bail!("--topic: --format tum writes poses alone; name topics with csv or parquet")
            }
            Some(_) if self.truth.is_some() => bail!("--truth: goes with --format tum alone"),
            _ => {}
        }
        let ending = form.map_or("tum", Form::ending);
        let dir = self.dir.unwrap_or_else(|| self.log.with_extension(ending));
        std::fs::create_dir_all(&dir)
            .with_context(|| format!("{}: the folder cannot be made", dir.display()))?;
        let beside = Some(self.log.with_extension("truth.csv")).filter(|path| path.exists());
        let (tables, end) = match form {
            Some(form) => write_tables(&log, form, &dir, &self.topic, self.overwrite)?,
            None => write_tum(&log, &dir, self.truth.or(beside).as_deref(), self.overwrite)?,
        };
        say_end(&log, &end);
        let written: Vec<_> = tables
            .into_iter()
            .map(|t| Written { topic: t.topic, rows: t.rows, columns: t.columns, file: t.to })
            .collect();
        if self.json {
            print_json(&written)?;
        } else {
            for Written { rows, columns, file, .. } in &written {
                print(&format!("{}: {rows} rows of {columns} columns\n", file.display()))?;
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Writes a telemetry log.
#[derive(Debug, Args)]
pub(super) struct Tlog {
    /// The log.
    log: PathBuf,
    /// The telemetry log. Default: beside the log, ending in .tlog.
    file: Option<PathBuf>,
    /// Whose frames: board, tag, or a ground link such as ground/0. Default: the ground link that
    /// carried most.
    #[arg(long, value_name = "LINK", value_parser = parse_link)]
    link: Option<LinkId>,
    /// Replace the file if it is there already.
    #[arg(long)]
    overwrite: bool,
    /// Print what was written as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct TlogWritten {
    file: PathBuf,
    link: String,
    frames_in: u64,
    frames_out: u64,
    garbage_bytes: u64,
}

impl Tlog {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let log = LogReader::open(&self.log)?;
        let found = links(&log);
        let listed = || {
            let names = found.iter().map(|(link, t)| {
                format!("{} ({} bytes in, {} out)", link_name(*link), t.bytes_in, t.bytes_out)
            });
            names.collect::<Vec<_>>().join(", ")
        };
        let link = match self.link {
            Some(link) if found.contains_key(&link) => link,
            Some(link) => bail!(
                "--link {}: carried nothing in this log; what did: {}",
                link_name(link),
                listed()
            ),
            None => found
                .iter()
                .filter(|(link, _)| matches!(link, LinkId::Ground(_)))
                .max_by_key(|(_, t)| t.bytes_in + t.bytes_out)
                .map(|(link, _)| *link)
                .with_context(|| {
                    format!("no ground link carried anything; name one with --link: {}", listed())
                })?,
        };
        let path = self.file.unwrap_or_else(|| self.log.with_extension("tlog"));
        let mut file = create(&log, &path, self.overwrite)?;
        let count = write_tlog(&log, link, std::io::BufWriter::new(&mut file))
            .with_context(|| format!("{}: cannot be written", path.display()))?;
        file.finish()?;
        if count.frames_in + count.frames_out == 0 {
            tracing::warn!("{} carried no MAVLink frame: the file is empty", link_name(link));
        }
        let written = TlogWritten {
            file: path,
            link: link_name(link),
            frames_in: count.frames_in,
            frames_out: count.frames_out,
            garbage_bytes: count.garbage_bytes,
        };
        if self.json {
            print_json(&written)?;
        } else {
            print(&format!(
                "{}: {}, {} frames in, {} out; {} bytes that belong to no frame left out\n",
                written.file.display(),
                written.link,
                written.frames_in,
                written.frames_out,
                written.garbage_bytes
            ))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

fn parse_link(text: &str) -> Result<LinkId, String> {
    link_from_name(text).ok_or_else(|| "write tag, board, or ground/N".to_owned())
}

/// A log that does not end well is read as far as it goes, and people are told.
pub(super) fn say_end(log: &LogReader, end: &LogEnd) {
    if *end != LogEnd::Complete {
        tracing::warn!("{}: {end}; taken is what is whole", log.path().display());
    }
}
