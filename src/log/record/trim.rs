//! Cuts a part out of a log.
//!
//! The part begins and ends between two inputs of the core, with everything that an input caused. A
//! part from the very start replays bit for bit as the whole does; of a later part the core's state is
//! not known, and the replay says that it cannot check it.

use std::path::{Path, PathBuf};

use super::channels;
use super::errors::LogError;
use super::reader::{LogReader, fault};
use super::recover::Copy;

/// What was cut out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trimmed {
    /// Messages in the new log.
    pub messages: u64,
    /// First and last input in it, s since the companion started.
    pub span_s: [f64; 2],
}

/// Writes what happened from `from_s` to `to_s`, seconds since the companion started, into the new
/// log `to`, which must not exist.
pub fn trim(log: &LogReader, to: &Path, from_s: f64, to_s: f64) -> Result<Trimmed, LogError> {
    let start_ns = log.session().pilot_started_at.as_us().saturating_mul(1000);
    let since_s = |ns: u64| (ns as f64 - start_ns as f64) / 1e9;
    let inside = |s: f64| s >= from_s && s <= to_s;
    let mut messages = log.messages();
    let (mut any, mut end_s) = (false, 0.0_f64);
    while let Some(message) = messages.next() {
        if is_input(&message.channel) {
            let at_s = since_s(message.log_time);
            any |= inside(at_s);
            end_s = end_s.max(at_s);
        }
    }
    if !any {
        return Err(LogError::NothingThere { path: log.path().to_owned(), from_s, to_s, end_s });
    }
    let failed = |source| LogError::Copy { path: to.to_owned(), source };
    let mut out = Copy::create(to)?;
    out.head(log).map_err(failed)?;
    let mut span_s: Option<[f64; 2]> = None;
    // The mode in force where the part begins.
    let mut mode: Option<(u64, Vec<u8>)> = None;
    let mut messages = log.messages();
    while let Some(message) = messages.next() {
        if *message.channel == *channels::CONFIG.0 {
            continue;
        }
        if let Some(why) = fault(&message) {
            let offset = message.offset;
            messages.note(offset, why);
            continue;
        }
        let at_s = since_s(message.log_time);
        if is_input(&message.channel) {
            if at_s > to_s {
                break;
            }
            if at_s >= from_s {
                span_s = Some(span_s.map_or([at_s; 2], |[a, b]| [a, b.max(at_s)]));
            }
        }
        // What was closed is the whole, not this part.
        let kept = *message.channel != *channels::CLOSING.0;
        if span_s.is_some() || from_s <= 0.0 {
            if kept {
                out.put(&message).map_err(failed)?;
            }
            if let Some((at, data)) = mode.take() {
                out.again(MODE, at, &data).map_err(failed)?;
            }
        } else if *message.channel == *MODE {
            mode = Some((message.log_time, message.data.to_vec()));
        }
    }
    let messages = out.finish(to)?;
    Ok(Trimmed { messages, span_s: span_s.unwrap_or([from_s, to_s]) })
}

/// Name beside `path` for a part of it.
pub fn trimmed_name(path: &Path) -> PathBuf {
    path.with_extension("trimmed.mcap")
}

/// Channel of the changes of mode.
const MODE: &str = "/mode";

fn is_input(channel: &str) -> bool {
    channel == channels::WAKE.0 || channel.starts_with("/in/")
}
