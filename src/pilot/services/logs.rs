//! The classic log download: LOG_REQUEST_LIST, _DATA, _END and LOG_ERASE.
//!
//! Source: common.xml, and the guide's "Log transfer". Numbers of logs count from 1 in the order of
//! their names, which is that of time. The list is read anew with every request for it; data are
//! paced and read in blocks. Silence is a fault for clients: "no logs" is one LOG_ENTRY with
//! `num_logs` = 0.

use haltere_dialect::mav::haltere::{
    LOG_DATA_DATA, LOG_ENTRY_DATA, LOG_REQUEST_DATA_DATA, LOG_REQUEST_LIST_DATA, MavMessage,
};

use haltere_core::time::HostTime;

use super::super::mission_transfer::Client;
use super::super::{LinkId, Pilot, Severity};
use super::Purpose;
use super::budget::Budget;
use super::files::{FileFault, FileName, FileTask, Folder, MOST_READ_BYTES};

/// Most logs that are listed: the newest.
const MOST_LOGS: usize = 1000;
/// Downloads at once.
const MOST_DOWNLOADS: usize = 4;
/// Data of one LOG_DATA.
const PIECE: usize = 90;
/// Bytes of one read: whole pieces, since clients take a shorter one for the end of the log.
const BLOCK_BYTES: u32 = MOST_READ_BYTES - MOST_READ_BYTES % PIECE as u32;
/// LOG_DATA and LOG_ENTRY on the wire, bytes.
const DATA_BYTES: usize = 109;
const ENTRY_BYTES: usize = 26;

#[derive(Debug, Clone, PartialEq)]
struct Log {
    name: String,
    size: u64,
    unix_s: u32,
}

#[derive(Debug)]
struct Listing {
    client: Client,
    next: u16,
    last: u16,
}

#[derive(Debug)]
struct Download {
    client: Client,
    serial: u32,
    id: u16,
    file: FileName,
    offset: u64,
    end: u64,
    block: Vec<u8>,
    block_at: u64,
    is_fetching: bool,
}

/// What an answer of the disk is for.
#[derive(Debug)]
pub(in super::super) enum Job {
    List {
        client: Client,
        start: u16,
        end: u16,
    },
    /// The list was not there yet when data were asked for.
    ListForData {
        client: Client,
        id: u16,
        offset: u32,
        count: u32,
    },
    Block {
        serial: u32,
        offset: u64,
    },
    Erase,
}

/// State of the service.
#[derive(Debug, Default)]
pub(in super::super) struct Logs {
    logs: Vec<Log>,
    listings: Vec<Listing>,
    downloads: Vec<Download>,
    next_serial: u32,
}

impl Logs {
    /// Whether nobody lists or downloads.
    pub fn is_idle(&self) -> bool {
        self.listings.is_empty() && self.downloads.is_empty()
    }
}

/// The lines of a listing, the newest [`MOST_LOGS`].
fn parse(bytes: &[u8]) -> Vec<Log> {
    let text = String::from_utf8_lossy(bytes);
    let mut logs: Vec<Log> = text
        .lines()
        .filter_map(|line| {
            let mut parts = line.split('\t');
            let name = parts.next()?.to_owned();
            let size = parts.next()?.parse().ok()?;
            let unix_s = parts.next()?.parse().unwrap_or(0);
            Some(Log { name, size, unix_s })
        })
        .collect();
    let surplus = logs.len().saturating_sub(MOST_LOGS);
    logs.drain(..surplus);
    logs
}

impl Pilot {
    pub(super) fn log_message(
        &mut self,
        at: HostTime,
        client: Client,
        message: &MavMessage,
    ) -> bool {
        match message {
            MavMessage::LOG_REQUEST_LIST(m) => {
                let LOG_REQUEST_LIST_DATA { start, end, .. } = *m;
                self.log_ask(at, Job::List { client, start, end }, FileTask::List(Folder::Logs));
            }
            MavMessage::LOG_REQUEST_DATA(m) => self.log_data(at, client, m),
            MavMessage::LOG_REQUEST_END(_) => {
                self.services.logs.downloads.retain(|d| d.client != client);
                self.services.logs.listings.retain(|l| l.client != client);
            }
            MavMessage::LOG_ERASE(_) => {
                if self.board.is_armed() {
                    let text = "logs not erased: disarm first".to_owned();
                    self.say(at, Severity::Warning, text);
                } else {
                    self.services.logs.downloads.clear();
                    self.log_ask(at, Job::Erase, FileTask::EraseLogs);
                }
            }
            _ => return false,
        }
        true
    }

    fn log_ask(&mut self, at: HostTime, job: Job, task: FileTask) {
        if let Err((fault, Purpose::Logs(job))) =
            self.services.desk.ask(task, Purpose::Logs(job), at)
        {
            self.log_answer(at, job, Err(fault), &[]);
        }
    }

    fn log_data(&mut self, at: HostTime, client: Client, m: &LOG_REQUEST_DATA_DATA) {
        let (id, offset, count) = (m.id, m.ofs, m.count);
        if self.services.logs.logs.is_empty() {
            let job = Job::ListForData { client, id, offset, count };
            self.log_ask(at, job, FileTask::List(Folder::Logs));
            return;
        }
        let logs = &mut self.services.logs;
        let log = id.checked_sub(1).and_then(|n| logs.logs.get(usize::from(n)));
        let file = log.and_then(|log| FileName::new(Folder::Logs, &log.name));
        logs.downloads.retain(|d| d.client != client);
        let (Some(log), Some(file)) = (log, file) else {
            self.send_log_data(client, id, offset, &[]);
            let text = format!("no log {id}: {} are listed", self.services.logs.logs.len());
            self.say(at, Severity::Warning, text);
            return;
        };
        let start = u64::from(offset);
        let end = start.saturating_add(u64::from(count)).min(log.size);
        if start >= end {
            // Beyond the end: a piece of nothing says so.
            self.send_log_data(client, id, offset, &[]);
            return;
        }
        if logs.downloads.len() == MOST_DOWNLOADS {
            logs.downloads.remove(0);
        }
        logs.next_serial = logs.next_serial.wrapping_add(1);
        logs.downloads.push(Download {
            client,
            serial: logs.next_serial,
            id,
            file,
            offset: start,
            end,
            block: Vec::new(),
            block_at: 0,
            is_fetching: false,
        });
    }

    fn send_log_data(&mut self, client: Client, id: u16, ofs: u32, bytes: &[u8]) {
        let mut data = [0; PIECE];
        for (slot, byte) in data.iter_mut().zip(bytes) {
            *slot = *byte;
        }
        let count = bytes.len().min(PIECE) as u8;
        let message = MavMessage::LOG_DATA(LOG_DATA_DATA { ofs, id, count, data });
        self.out.message(client.link, self.own, &message);
    }

    /// The disk has answered.
    pub(super) fn log_answer(
        &mut self,
        at: HostTime,
        job: Job,
        result: Result<(), FileFault>,
        bytes: &[u8],
    ) {
        match job {
            Job::List { client, start, end } => {
                self.services.logs.logs = if result.is_ok() { parse(bytes) } else { Vec::new() };
                let count = self.services.logs.logs.len() as u16;
                self.services.logs.listings.retain(|l| l.client != client);
                let (first, last) = (start.max(1), end.min(count));
                if count == 0 || first > last {
                    self.send_log_entry(client, 0);
                } else {
                    self.services.logs.listings.push(Listing { client, next: first, last });
                }
            }
            Job::ListForData { client, id, offset, count } => {
                self.services.logs.logs = if result.is_ok() { parse(bytes) } else { Vec::new() };
                if self.services.logs.logs.is_empty() {
                    self.send_log_data(client, id, offset, &[]);
                } else {
                    let ask =
                        LOG_REQUEST_DATA_DATA { ofs: offset, count, id, ..Default::default() };
                    self.log_data(at, client, &ask);
                }
            }
            Job::Block { serial, offset } => {
                let downloads = &mut self.services.logs.downloads;
                let Some(index) = downloads.iter().position(|d| d.serial == serial) else { return };
                let Some(download) = downloads.get_mut(index) else { return };
                download.is_fetching = false;
                if result.is_err() || bytes.is_empty() {
                    let (client, id, ofs) = (download.client, download.id, download.offset as u32);
                    downloads.remove(index);
                    self.send_log_data(client, id, ofs, &[]);
                    return;
                }
                download.block = bytes.to_vec();
                download.block_at = offset;
            }
            Job::Erase => {
                self.services.logs.logs.clear();
                let text = match result {
                    Ok(()) => "logs erased, but for the one being written".to_owned(),
                    Err(fault) => format!("logs not erased: {}", fault.words()),
                };
                self.say(at, Severity::Info, text);
            }
        }
    }

    /// Number 0: there is none.
    fn send_log_entry(&mut self, client: Client, id: u16) {
        let logs = &self.services.logs.logs;
        let count = logs.len() as u16;
        let log = id.checked_sub(1).and_then(|n| logs.get(usize::from(n)));
        let message = MavMessage::LOG_ENTRY(LOG_ENTRY_DATA {
            time_utc: log.map_or(0, |log| log.unix_s),
            size: log.map_or(0, |log| u32::try_from(log.size).unwrap_or(u32::MAX)),
            id,
            num_logs: count,
            last_log_num: count,
        });
        self.out.message(client.link, self.own, &message);
    }

    /// Goes on with lists and downloads.
    pub(super) fn log_tick(&mut self, at: HostTime, link: LinkId, budget: &mut Budget<'_>) {
        let listings = &mut self.services.logs.listings;
        if let Some(index) = listings.iter().position(|l| l.client.link == link) {
            let mut listing = listings.swap_remove(index);
            while listing.next <= listing.last && budget.take(ENTRY_BYTES) {
                self.send_log_entry(listing.client, listing.next);
                listing.next += 1;
            }
            if listing.next <= listing.last {
                self.services.logs.listings.push(listing);
            }
        }
        let downloads = &mut self.services.logs.downloads;
        let Some(index) = downloads.iter().position(|d| d.client.link == link) else { return };
        let mut download = downloads.swap_remove(index);
        let mut is_over = false;
        while !is_over {
            let left = download.end.saturating_sub(download.offset);
            let start = download.offset.checked_sub(download.block_at);
            let piece = start
                .and_then(|start| download.block.get(usize::try_from(start).ok()?..))
                .map(|rest| rest.get(..PIECE.min(left as usize)).unwrap_or(rest))
                .filter(|piece| !piece.is_empty());
            let Some(piece) = piece.map(<[u8]>::to_vec) else {
                if !download.is_fetching {
                    download.is_fetching = true;
                    let (offset, serial) = (download.offset, download.serial);
                    let file = download.file.clone();
                    self.services.logs.downloads.push(download);
                    let task = FileTask::Read { file, offset, count: BLOCK_BYTES };
                    self.log_ask(at, Job::Block { serial, offset }, task);
                    return;
                }
                break;
            };
            if !budget.take(DATA_BYTES) {
                break;
            }
            self.send_log_data(download.client, download.id, download.offset as u32, &piece);
            download.offset += piece.len() as u64;
            is_over = download.offset >= download.end;
        }
        if !is_over {
            self.services.logs.downloads.push(download);
        }
    }

    /// A link is gone, and whoever was on it.
    pub(super) fn logs_forget(&mut self, link: LinkId) {
        self.services.logs.downloads.retain(|d| d.client.link != link);
        self.services.logs.listings.retain(|l| l.client.link != link);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Bench;
    use crate::{Input, PilotConfig};

    /// MAVProxy ends a download at the first piece that is not full, QGroundControl counts pieces of 90 bytes.
    #[test]
    fn regress_every_piece_of_a_download_but_the_last_is_full() {
        const SIZE: usize = 40_000;
        let mut bench = Bench::new(PilotConfig { store: true, ..PilotConfig::default() });
        bench.says(&MavMessage::LOG_REQUEST_DATA(LOG_REQUEST_DATA_DATA {
            id: 1,
            count: u32::MAX,
            ..Default::default()
        }));
        let mut sent = Vec::new();
        for _ in 0..100 {
            let mut requests = Vec::new();
            bench.pilot.drain_file_requests(|request| requests.push(request));
            for request in requests {
                let bytes = match request.task {
                    FileTask::List(Folder::Logs) => format!("a.mcap\t{SIZE}\t1\n").into_bytes(),
                    FileTask::Read { offset, count, .. } => {
                        let left = SIZE.saturating_sub(offset as usize);
                        vec![7; left.min(count as usize)]
                    }
                    _ => Vec::new(),
                };
                let ticket = request.ticket;
                let input = Input::File { ticket, result: Ok(()), bytes: &bytes };
                bench.pilot.handle(bench.now, input);
            }
            sent.extend(bench.run(0.01).into_iter().filter_map(|m| match m {
                MavMessage::LOG_DATA(m) => Some((m.ofs as usize, usize::from(m.count))),
                _ => None,
            }));
        }
        let wanted: Vec<_> =
            (0..SIZE).step_by(PIECE).map(|ofs| (ofs, PIECE.min(SIZE - ofs))).collect();
        assert_eq!(sent, wanted);
    }

    #[test]
    fn prop_the_newest_logs_are_kept_and_broken_lines_left_out() {
        let logs = parse(b"a.mcap\t10\t100\nbroken\nb.mcap\t20\t200\nc.mcap\tx\t1\n");
        assert_eq!(logs.len(), 2);
        assert_eq!(logs[1], Log { name: "b.mcap".into(), size: 20, unix_s: 200 });
        let many: String = (0..1200).map(|n| format!("{n:05}.mcap\t1\t1\n")).collect();
        let logs = parse(many.as_bytes());
        assert_eq!((logs.len(), logs[0].name.as_str()), (MOST_LOGS, "00200.mcap"));
    }
}
