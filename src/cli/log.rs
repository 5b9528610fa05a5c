//! `haltere log`: list, look into, mend, cut and convert flight logs.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Subcommand;
use serde::Serialize;

use super::log_export::{Export, Tlog};
use super::log_list::List;
use super::output::{print, print_json};
use haltere_core::time::HostTime;
use haltere_log::record::{
    Decoded, Entry, LogEnd, LogReader, RawInput, link_from_name, recover, recovered_name, trim,
    trimmed_name,
};

/// Handles flight logs.
#[derive(Debug, Subcommand)]
pub(super) enum Log {
    /// Lists the logs of a folder: when, how long, which modes, how they end.
    List(List),
    /// Says what a log holds and how it ends.
    Info {
        /// The log.
        log: PathBuf,
        /// Print as JSON.
        #[arg(long)]
        json: bool,
        /// Read the log whole, not its head and tail alone: counts bytes, and finds what is damaged in between.
        #[arg(long)]
        whole: bool,
    },
    /// Cuts a part out of a log. A part from the start replays as the whole does.
    Trim {
        /// The log. It is left as it is.
        log: PathBuf,
        /// Begin of the part, s since the companion started, as in reports.
        #[arg(long, value_name = "S", default_value_t = 0.0)]
        from: f64,
        /// End of the part, s since the companion started; else the end of the log.
        #[arg(long, value_name = "S")]
        to: Option<f64>,
        /// The new file, which must not exist. Default: NAME.trimmed.mcap beside the log.
        #[arg(long, short, value_name = "FILE")]
        output: Option<PathBuf>,
    },
    /// Writes the decoded topics as tables: CSV or Parquet, one file a topic.
    Export(Export),
    /// Writes the frames of a link as a telemetry log (.tlog) for QGroundControl and MAVProxy.
    Tlog(Tlog),
    /// Rewrites a log that was cut by a power loss, or is damaged, into a complete one, which every viewer opens.
    Recover {
        /// The log. It is left as it is.
        log: PathBuf,
        /// The new file, which must not exist. Default: NAME.recovered.mcap beside the log.
        #[arg(long, value_name = "FILE")]
        to: Option<PathBuf>,
    },
}

#[derive(Debug, Serialize)]
struct Info {
    log: PathBuf,
    end: String,
    complete: bool,
    started_unix_s: f64,
    duration_s: f64,
    program_version: String,
    git_commit: String,
    source_hash: String,
    target: String,
    anchors: usize,
    entries: BTreeMap<String, u64>,
    /// As the next, of a log that was read whole.
    input_bytes: Option<u64>,
    output_bytes: Option<u64>,
    lost_entries: u64,
}

impl Log {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            Log::Recover { log, to } => {
                let to = to.unwrap_or_else(|| recovered_name(&log));
                let (saved, end) = recover(&log, &to)?;
                print(&format!(
                    "{}: {end}; {saved} messages in {}\n",
                    log.display(),
                    to.display()
                ))?;
            }
            Log::List(list) => return list.run(),
            Log::Export(export) => return export.run(),
            Log::Tlog(tlog) => return tlog.run(),
            Log::Trim { log, from, to, output } => {
                let to = to.unwrap_or(f64::INFINITY);
                if from.is_nan() || to.is_nan() || from >= to {
                    anyhow::bail!("--from {from} --to {to}: the begin must lie before the end");
                }
                let output = output.unwrap_or_else(|| trimmed_name(&log));
                let reader = LogReader::open(log)?;
                let part = trim(&reader, &output, from, to)?;
                let [first, last] = part.span_s;
                print(&format!(
                    "{}: {} messages, {first:.3} to {last:.3} s\n",
                    output.display(),
                    part.messages
                ))?;
            }
            Log::Info { log, json, whole } => {
                let log = LogReader::open(log)?;
                let glance = (!whole).then(|| at_a_glance(&log)).flatten();
                let info = glance.unwrap_or_else(|| info(&log));
                if json {
                    print_json(&info)?;
                } else {
                    print(&table(&info))?;
                }
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Read whole.
fn info(log: &LogReader) -> Info {
    let mut entries = log.entries();
    let mut counts = BTreeMap::new();
    let (mut input_bytes, mut output_bytes, mut lost_entries) = (0, 0, 0);
    let mut last = log.session().pilot_started_at;
    for entry in entries.by_ref() {
        match &entry {
            Entry::Input { at, input, .. } => {
                last = last.max(*at);
                if let RawInput::Bytes { bytes, .. } = input {
                    input_bytes += bytes.len() as u64;
                }
            }
            Entry::Output { bytes, .. } => output_bytes += bytes.len() as u64,
            _ => {}
        }
        lost_entries = lost(&entry).saturating_add(lost_entries);
        if let Some(name) = name(&entry) {
            *counts.entry(name).or_default() += 1;
        }
    }
    Info {
        entries: counts,
        input_bytes: Some(input_bytes),
        output_bytes: Some(output_bytes),
        lost_entries,
        ..about(log, &entries.end(), last)
    }
}

/// By head and tail. `None`: they do not tell it.
fn at_a_glance(log: &LogReader) -> Option<Info> {
    let outline = log.outline()?;
    let (mut counts, mut lost_entries) = (BTreeMap::new(), 0_u64);
    for (channel, count) in outline.counts() {
        if let Some(name) = name_of(channel) {
            let sum: &mut u64 = counts.entry(name).or_default();
            *sum = sum.saturating_add(count);
            continue;
        }
        // Few, and each has words of its own.
        for entry in outline.entries(channel)? {
            lost_entries = lost(&entry).saturating_add(lost_entries);
            if let Some(name) = name(&entry) {
                *counts.entry(name).or_default() += 1;
            }
        }
    }
    counts.retain(|_, count| *count > 0);
    let last = outline.span.map_or(log.session().pilot_started_at, |[_, last]| last);
    Some(Info { entries: counts, lost_entries, ..about(log, &LogEnd::Complete, last) })
}

fn about(log: &LogReader, end: &LogEnd, last: HostTime) -> Info {
    let session = log.session();
    Info {
        log: log.path().to_owned(),
        complete: *end == LogEnd::Complete,
        end: end.to_string(),
        started_unix_s: session.started_unix_us as f64 * 1e-6,
        duration_s: last.seconds_since(session.pilot_started_at),
        program_version: session.build.program_version.clone(),
        git_commit: session.build.git_commit.clone(),
        source_hash: session.build.source_hash.clone(),
        target: session.build.target.clone(),
        anchors: session.survey.ids().len(),
        entries: BTreeMap::new(),
        input_bytes: None,
        output_bytes: None,
        lost_entries: 0,
    }
}

/// A damaged log may claim any number.
fn lost(entry: &Entry) -> u64 {
    match entry {
        Entry::Hole(hole) => hole.lost_raw.saturating_add(hole.lost_topics),
        _ => 0,
    }
}

/// What an entry is counted as.
fn name(entry: &Entry) -> Option<String> {
    Some(match entry {
        Entry::Input { input, .. } => match input {
            RawInput::Bytes { link, .. } => format!("input on link {}", link.number()),
            RawInput::File { ticket, fault: None, bytes } => {
                format!("file request {ticket} answered, {} bytes", bytes.len())
            }
            RawInput::File { ticket, fault: Some(fault), .. } => {
                format!("file request {ticket} failed: {}", fault.words())
            }
            RawInput::Calendar { .. } => "calendar".to_owned(),
            RawInput::Recording { state, why } => format!("recording {state:?} {why}"),
            RawInput::EndAsked => "asked to end".to_owned(),
            RawInput::Wake => "wake-up".to_owned(),
            _ => "link event".to_owned(),
        },
        Entry::Output { link, .. } => format!("output on link {}", link.number()),
        Entry::Decoded(decoded) => decoded.channel().to_owned(),
        Entry::Hole(_) => "hole".to_owned(),
        Entry::Closing(_) => return None,
    })
}

/// The same by channel, where all of a channel are counted as one.
fn name_of(channel: &str) -> Option<String> {
    let fixed = match channel {
        "/wake" => Some("wake-up"),
        "/in/calendar" => Some("calendar"),
        "/in/end" => Some("asked to end"),
        "/in/event" | "/in/peer" | "/in/lost" => Some("link event"),
        _ => Decoded::CHANNELS.iter().map(|(name, _)| *name).find(|name| *name == channel),
    };
    let link = |way: &str| channel.strip_prefix(way).and_then(link_from_name);
    fixed.map(str::to_owned).or_else(|| {
        let put_in = link("/in/").map(|link| format!("input on link {}", link.number()));
        put_in.or_else(|| Some(format!("output on link {}", link("/out/")?.number())))
    })
}

fn table(info: &Info) -> String {
    // A log that was not closed has no tail, and is read whole.
    let (read, bytes) = match (info.input_bytes, info.output_bytes) {
        (Some(put_in), Some(out)) if info.complete => {
            ("", format!("{put_in} bytes in, {out} bytes out, "))
        }
        (Some(put_in), Some(out)) => {
            ("; read whole", format!("{put_in} bytes in, {out} bytes out, "))
        }
        _ => (", by its head and tail (--whole reads every byte)", String::new()),
    };
    let mut text = format!(
        "{}: {}{}\n{:.1} s, {} anchors, {}{} entries lost\n\
         written by haltere {} ({}, source {}, {})\n",
        info.log.display(),
        info.end,
        read,
        info.duration_s,
        info.anchors,
        bytes,
        info.lost_entries,
        info.program_version,
        info.git_commit,
        info.source_hash,
        info.target
    );
    for (name, count) in &info.entries {
        text += &format!("{count:>10}  {name}\n");
    }
    if !info.complete {
        text += "`haltere log recover` makes it complete, so that every viewer opens it\n";
    }
    text
}
