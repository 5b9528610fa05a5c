//! `haltere log list`: the logs of a folder, one line each.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;
use serde::Serialize;

use super::output::{print, print_json};
use crate::progress::Progress;
use haltere_core::time::HostTime;
use haltere_log::log_file::{has_log_ending, shown_name};
use haltere_log::record::{Decoded, Entry, LogEnd, LogReader, is_on_floor, utc_text};
use haltere_pilot::settings::RecordConfig;

/// Lists logs.
#[derive(Debug, Args)]
pub(super) struct List {
    /// The folder. Default: the folder logs go to by default.
    #[arg(value_name = "DIR", default_value_os_t = RecordConfig::default().directory)]
    directory: PathBuf,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
    /// Read every log whole, not its head and tail alone: finds what is damaged in between.
    #[arg(long)]
    whole: bool,
}

/// One log.
#[derive(Debug, Serialize)]
struct Row {
    log: PathBuf,
    size_bytes: u64,
    started_unix_s: Option<f64>,
    started: Option<String>,
    duration_s: Option<f64>,
    /// Time in the air or on the way there: motors may turn.
    airborne_s: Option<f64>,
    /// Modes in which something was flown, in the order in which they first came.
    modes: Vec<String>,
    complete: bool,
    end: String,
    /// Not by head and tail alone: damage in between would be seen.
    read_whole: bool,
}

impl List {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let name = self.directory.display();
        let mut logs: Vec<PathBuf> = std::fs::read_dir(&self.directory)
            .with_context(|| format!("{name}: cannot be listed; name the folder of the logs"))?
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| has_log_ending(path))
            .collect();
        logs.sort();
        let progress = Progress::new("logs");
        let mut rows = Vec::new();
        for (i, path) in logs.iter().enumerate() {
            progress.doing(i, logs.len(), &shown_name(path));
            rows.push(look(path, self.whole));
        }
        progress.end();
        if self.json {
            print_json(&rows)?;
        } else if rows.is_empty() {
            print(&format!("{name}: no log (*.mcap)\n"))?;
        } else {
            print(&table(&rows))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// A file that is no log has a row too: it lies among them.
fn look(path: &Path, whole: bool) -> Row {
    let mut row = Row {
        log: path.to_owned(),
        size_bytes: std::fs::metadata(path).map_or(0, |m| m.len()),
        started_unix_s: None,
        started: None,
        duration_s: None,
        airborne_s: None,
        modes: Vec::new(),
        complete: false,
        end: String::new(),
        read_whole: false,
    };
    let log = match LogReader::open(path) {
        Ok(log) => log,
        Err(error) => {
            let text = error.to_string();
            let own = format!("{}: ", path.display());
            row.end = text.strip_prefix(&own).unwrap_or(&text).to_owned();
            return row;
        }
    };
    let session = log.session();
    row.started_unix_s = Some(session.started_unix_us as f64 * 1e-6);
    row.started = Some(utc_text(session.started_unix_us));
    let start = session.pilot_started_at;
    let glance = (!whole).then(|| at_a_glance(&log)).flatten();
    row.read_whole = glance.is_none();
    let (seen, end) = glance.unwrap_or_else(|| read_whole(&log));
    let [first, last] = seen.ends.unwrap_or([start; 2]);
    let open_s = seen.since.map_or(0.0, |since| last.seconds_since(since).max(0.0));
    row.modes = seen.modes;
    row.duration_s = Some(last.seconds_since(first));
    row.airborne_s = Some(seen.airborne_s + open_s);
    row.complete = end == LogEnd::Complete;
    row.end = end.to_string();
    if !row.complete && !whole {
        row.end += "; read whole";
    }
    row
}

/// What a log shows of its flights.
#[derive(Default)]
struct Seen {
    /// First and last input or output: a part of a log begins where it was cut.
    ends: Option<[HostTime; 2]>,
    airborne_s: f64,
    since: Option<HostTime>,
    modes: Vec<String>,
}

/// By head and tail. `None`: they do not tell it.
fn at_a_glance(log: &LogReader) -> Option<(Seen, LogEnd)> {
    let outline = log.outline()?;
    let mut seen = Seen { ends: outline.span, ..Seen::default() };
    for entry in outline.entries("/mode")? {
        seen.take(log, entry);
    }
    Some((seen, LogEnd::Complete))
}

fn read_whole(log: &LogReader) -> (Seen, LogEnd) {
    let mut seen = Seen::default();
    let mut entries = log.entries();
    for entry in entries.by_ref() {
        seen.take(log, entry);
    }
    (seen, entries.end())
}

impl Seen {
    fn take(&mut self, log: &LogReader, entry: Entry) {
        match entry {
            Entry::Input { at, .. } | Entry::Output { at, .. } => {
                self.ends = Some(self.ends.map_or([at; 2], |[first, last]| [first, last.max(at)]));
            }
            Entry::Decoded(Decoded::Mode(m)) => {
                let first = self.ends.map_or(log.session().pilot_started_at, |e| e[0]);
                let at = HostTime::from_us(m.at_us).max(first);
                if let Some(since) = self.since.take() {
                    self.airborne_s += at.seconds_since(since);
                }
                if !is_on_floor(&m.mode) {
                    self.since = Some(at);
                    if !self.modes.contains(&m.mode) {
                        self.modes.push(m.mode);
                    }
                }
            }
            _ => {}
        }
    }
}

fn table(rows: &[Row]) -> String {
    let width = rows.iter().map(|row| shown_name(&row.log).chars().count()).max().unwrap_or(0);
    let mut text = format!(
        "{:width$}  {:23}  {:>8}  {:>8}  {:>9}  modes\n",
        "log", "started", "length", "flown", "size"
    );
    for row in rows {
        let seconds = |s: Option<f64>| s.map_or("-".to_owned(), |s| format!("{s:.1} s"));
        let modes = if row.modes.is_empty() { "-".to_owned() } else { row.modes.join(" ") };
        text += &format!(
            "{:width$}  {:23}  {:>8}  {:>8}  {:>9}  {modes}",
            shown_name(&row.log),
            row.started.as_deref().unwrap_or("-"),
            seconds(row.duration_s),
            seconds(row.airborne_s),
            size(row.size_bytes),
        );
        if !row.complete {
            text += &format!("  [{}]", row.end);
        }
        text += "\n";
    }
    if rows.iter().any(|row| row.complete && !row.read_whole) {
        text += "by head and tail of each log; damage in between is not seen: --whole reads every byte\n";
    }
    text
}

fn size(bytes: u64) -> String {
    match bytes as f64 {
        b if b >= 1e9 => format!("{:.1} GB", b * 1e-9),
        b if b >= 1e6 => format!("{:.1} MB", b * 1e-6),
        b => format!("{:.1} kB", b * 1e-3),
    }
}
