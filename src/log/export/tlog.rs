//! The frames of a link as a telemetry log, the form of QGroundControl and MAVProxy: before each
//! frame eight bytes, big-endian, microseconds since 1970 UTC.

use std::collections::BTreeMap;
use std::io::{self, Write};

use haltere_dialect::mav_stream::MavSplitter;

use crate::record::{Entry, LogReader, RawInput};
use haltere_pilot::LinkId;

/// What a link carried.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LinkTraffic {
    /// Bytes that came in.
    pub bytes_in: u64,
    /// Bytes that went out.
    pub bytes_out: u64,
}

/// What was written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TlogCount {
    /// Frames that came in.
    pub frames_in: u64,
    /// Frames that went out.
    pub frames_out: u64,
    /// Bytes that belong to no whole frame, and are left out.
    pub garbage_bytes: u64,
}

/// Every link of a log.
pub fn links(log: &LogReader) -> BTreeMap<LinkId, LinkTraffic> {
    let mut found: BTreeMap<LinkId, LinkTraffic> = BTreeMap::new();
    for entry in log.entries() {
        match entry {
            Entry::Input { input: RawInput::Bytes { link, bytes }, .. } => {
                found.entry(link).or_default().bytes_in += bytes.len() as u64;
            }
            Entry::Output { link, bytes, .. } => {
                found.entry(link).or_default().bytes_out += bytes.len() as u64;
            }
            _ => {}
        }
    }
    found
}

/// Writes the frames of `link`, both ways, in the order of the log.
///
/// Frames with ids of other dialects pass; what has a wrong checksum does not. A frame bears the time
/// at which its last byte was read or sent.
pub fn write_tlog(log: &LogReader, link: LinkId, mut out: impl Write) -> io::Result<TlogCount> {
    let session = log.session();
    let mut count = TlogCount::default();
    let mut splitters = [MavSplitter::new(), MavSplitter::new()];
    for entry in log.entries() {
        let (sent, at, bytes) = match entry {
            Entry::Input { at, input: RawInput::Bytes { link: from, bytes }, .. }
                if from == link =>
            {
                (false, at, bytes)
            }
            Entry::Output { at, link: to, bytes, .. } if to == link => (true, at, bytes),
            _ => continue,
        };
        let since_us = at.as_us().saturating_sub(session.pilot_started_at.as_us());
        let start_us = u64::try_from(session.started_unix_us).unwrap_or(0);
        let unix_us = start_us.saturating_add(since_us);
        let splitter = &mut splitters[usize::from(sent)];
        splitter.push(&bytes);
        while let Some(found) = splitter.next() {
            match found {
                Ok(frame) => {
                    out.write_all(&unix_us.to_be_bytes())?;
                    out.write_all(frame.raw)?;
                    if sent {
                        count.frames_out += 1;
                    } else {
                        count.frames_in += 1;
                    }
                }
                Err(haltere_dialect::mav_stream::MavLoss::GarbageBytes(n)) => {
                    count.garbage_bytes += n as u64;
                }
                // Its bytes are counted as garbage too.
                Err(_) => {}
            }
        }
    }
    count.garbage_bytes += splitters.iter().map(|s| s.pending() as u64).sum::<u64>();
    out.flush()?;
    Ok(count)
}
