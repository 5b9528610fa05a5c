//! The classic log download: LOG_REQUEST_LIST, _DATA, _END and LOG_ERASE.
//!
//! Source: common.xml, and the guide's "Log transfer". Numbers of logs count from 1 in the order of
//! their names, which is that of time. The list is read anew with every request for it; data are
//! paced and read in blocks. Silence is a fault for clients: "no logs" is one LOG_ENTRY with
//! `num_logs` = 0.
//!
//! Requests for data wait for one another: all that a client asks for is sent, in the order in which it was asked for.
//! One that covers what is still to be sent of an earlier one takes its place: a client that began anew.

use haltere_dialect::mav::haltere::{
    LOG_DATA_DATA, LOG_ENTRY_DATA, LOG_REQUEST_DATA_DATA, LOG_REQUEST_LIST_DATA, MavMessage,
};

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use super::Purpose;
use super::budget::Budget;
use super::files::{FileFault, FileName, FileTask, Folder, MOST_READ_BYTES};
use crate::input::LinkId;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::stations::Stations;
use crate::stations::mission_transfer::Client;

/// Most logs that are listed: the newest.
const MOST_LOGS: usize = 1000;
/// Requests for data that wait on one link: MAVProxy asks for 20 holes at once, and again after 0.7 s.
const MOST_WAITING: usize = 40;
/// People are told again that more was asked for after this time, s.
const FULL_TELL_S: f64 = 5.0;
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

/// A request for data.
#[derive(Debug)]
struct Download {
    client: Client,
    serial: u32,
    id: u16,
    /// Which file that is, from its turn on.
    file: Option<FileName>,
    offset: u64,
    end: u64,
    block: Vec<u8>,
    block_at: u64,
    /// The disk was asked for the list or for a block.
    is_fetching: bool,
}

impl Download {
    /// The next piece, as far as it was read.
    fn piece(&self) -> Option<&[u8]> {
        let left = self.end.saturating_sub(self.offset);
        let start = usize::try_from(self.offset.checked_sub(self.block_at)?).ok()?;
        let rest = self.block.get(start..).filter(|rest| !rest.is_empty())?;
        Some(rest.get(..PIECE.min(usize::try_from(left).unwrap_or(PIECE))).unwrap_or(rest))
    }
}

/// What became of a download in a control step.
#[derive(Debug)]
enum Turn {
    /// All of it was sent.
    Over,
    /// For the disk, or for room on the link.
    Waits,
    /// The disk is to be asked.
    Asks(Job, FileTask),
}

/// What an answer of the disk is for.
#[derive(Debug)]
pub(crate) enum Job {
    List {
        client: Client,
        start: u16,
        end: u16,
    },
    /// The list was not there yet when data were to be sent.
    ListForData {
        serial: u32,
    },
    Block {
        serial: u32,
        offset: u64,
    },
    Erase,
}

/// State of the service.
#[derive(Debug, Default)]
pub(crate) struct Logs {
    logs: Vec<Log>,
    listings: Vec<Listing>,
    /// Those of one client in their order.
    downloads: Vec<Download>,
    next_serial: u32,
    full_told_at: Option<HostTime>,
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

impl Out {
    /// A piece from a byte on; one of nothing says that there is no more.
    fn send_log_data(&mut self, client: Client, id: u16, offset: u64, bytes: &[u8]) {
        let ofs = u32::try_from(offset).unwrap_or(u32::MAX);
        let mut data = [0; PIECE];
        for (slot, byte) in data.iter_mut().zip(bytes) {
            *slot = *byte;
        }
        let count = bytes.len().min(PIECE) as u8;
        let message = MavMessage::LOG_DATA(LOG_DATA_DATA { ofs, id, count, data });
        self.message(client.link, &message);
    }
}

impl Stations {
    fn log_ask(&mut self, at: HostTime, job: Job, task: FileTask, out: &mut Out) {
        if let Err((fault, Purpose::Logs(job))) =
            self.services.desk.ask(task, Purpose::Logs(job), at)
        {
            self.log_answer(at, job, Err(fault), &[], out);
        }
    }

    /// LOG_REQUEST_DATA.
    pub(crate) fn log_data(
        &mut self,
        at: HostTime,
        client: Client,
        m: &LOG_REQUEST_DATA_DATA,
        out: &mut Out,
    ) {
        let logs = &mut self.services.logs;
        let offset = u64::from(m.ofs);
        let end = offset.saturating_add(u64::from(m.count));
        let covers =
            |d: &Download| d.client == client && d.id == m.id && offset <= d.offset && d.end <= end;
        logs.downloads.retain(|d| !covers(d));
        let waiting = logs.downloads.iter().filter(|d| d.client.link == client.link).count();
        if waiting >= MOST_WAITING {
            let told = logs.full_told_at.is_some_and(|t| at.seconds_since(t) < FULL_TELL_S);
            out.lose(client.link, DropReason::InputQueueFull, 1);
            if !told {
                self.services.logs.full_told_at = Some(at);
                let text = format!(
                    "log {} from byte {offset} is not sent: {waiting} requests wait on link {}, ask again",
                    m.id,
                    client.link.number()
                );
                out.say(at, Severity::Warning, text);
            }
            return;
        }
        logs.next_serial = logs.next_serial.wrapping_add(1);
        logs.downloads.push(Download {
            client,
            serial: logs.next_serial,
            id: m.id,
            file: None,
            offset,
            end,
            block: Vec::new(),
            block_at: 0,
            is_fetching: false,
        });
    }

    /// The disk has answered.
    pub(crate) fn log_answer(
        &mut self,
        at: HostTime,
        job: Job,
        result: Result<(), FileFault>,
        bytes: &[u8],
        out: &mut Out,
    ) {
        match job {
            Job::List { client, start, end } => {
                self.services.logs.logs = if result.is_ok() { parse(bytes) } else { Vec::new() };
                let count = self.services.logs.logs.len() as u16;
                self.services.logs.listings.retain(|l| l.client != client);
                let (first, last) = (start.max(1), end.min(count));
                if count == 0 || first > last {
                    self.send_log_entry(client, 0, out);
                } else {
                    self.services.logs.listings.push(Listing { client, next: first, last });
                }
            }
            Job::ListForData { serial } => {
                self.services.logs.logs = if result.is_ok() { parse(bytes) } else { Vec::new() };
                let is_empty = self.services.logs.logs.is_empty();
                let downloads = &mut self.services.logs.downloads;
                let Some(index) = downloads.iter().position(|d| d.serial == serial) else { return };
                downloads[index].is_fetching = false;
                if is_empty {
                    let Download { client, id, offset, .. } = downloads.remove(index);
                    out.send_log_data(client, id, offset, &[]);
                }
            }
            Job::Block { serial, offset } => {
                let downloads = &mut self.services.logs.downloads;
                let Some(index) = downloads.iter().position(|d| d.serial == serial) else { return };
                let Some(download) = downloads.get_mut(index) else { return };
                download.is_fetching = false;
                if result.is_err() || bytes.is_empty() {
                    let Download { client, id, offset, .. } = downloads.remove(index);
                    out.send_log_data(client, id, offset, &[]);
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
                out.say(at, Severity::Info, text);
            }
        }
    }

    /// Number 0: there is none.
    fn send_log_entry(&mut self, client: Client, id: u16, out: &mut Out) {
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
        out.message(client.link, &message);
    }

    /// Goes on with lists and downloads.
    pub(crate) fn log_tick(
        &mut self,
        at: HostTime,
        link: LinkId,
        budget: &mut Budget<'_>,
        out: &mut Out,
    ) {
        let listings = &mut self.services.logs.listings;
        if let Some(index) = listings.iter().position(|l| l.client.link == link) {
            let mut listing = listings.swap_remove(index);
            while listing.next <= listing.last && budget.take(ENTRY_BYTES) {
                self.send_log_entry(listing.client, listing.next, out);
                listing.next += 1;
            }
            if listing.next <= listing.last {
                self.services.logs.listings.push(listing);
            }
        }
        self.send_logs(at, link, budget, out);
    }

    /// Goes on with the downloads of a link: those of one client, one after another, and of the next one in the next step.
    fn send_logs(&mut self, at: HostTime, link: LinkId, budget: &mut Budget<'_>, out: &mut Out) {
        let logs = &self.services.logs;
        let Some(first) = logs.downloads.iter().find(|d| d.client.link == link) else { return };
        let client = first.client;
        loop {
            let downloads = &mut self.services.logs.downloads;
            let Some(index) = downloads.iter().position(|d| d.client == client) else { return };
            let mut download = downloads.remove(index);
            let turn = self.send_log(at, &mut download, budget, out);
            let downloads = &mut self.services.logs.downloads;
            match turn {
                Turn::Over => continue,
                Turn::Waits => downloads.insert(index, download),
                Turn::Asks(job, task) => {
                    download.is_fetching = true;
                    downloads.insert(index, download);
                    self.log_ask(at, job, task, out);
                }
            }
            break;
        }
        self.services.logs.downloads.sort_by_key(|d| d.client == client);
    }

    /// Goes on with a download.
    fn send_log(
        &mut self,
        at: HostTime,
        download: &mut Download,
        budget: &mut Budget<'_>,
        out: &mut Out,
    ) -> Turn {
        let Download { client, serial, id, .. } = *download;
        if download.file.is_none() && !download.is_fetching {
            if self.services.logs.logs.is_empty() {
                return Turn::Asks(Job::ListForData { serial }, FileTask::List(Folder::Logs));
            }
            let logs = &self.services.logs.logs;
            let log = id.checked_sub(1).and_then(|n| logs.get(usize::from(n)));
            let end = log.map_or(0, |log| download.end.min(log.size));
            let file = log.and_then(|log| FileName::new(Folder::Logs, &log.name));
            if file.is_none() || download.offset >= end {
                if !budget.take(DATA_BYTES) {
                    return Turn::Waits;
                }
                if file.is_none() && out.may_echo(at) {
                    let text = format!("no log {id}: {} are listed", self.services.logs.logs.len());
                    out.say(at, Severity::Warning, text);
                }
                // Beyond the end: a piece of nothing says so.
                out.send_log_data(client, id, download.offset, &[]);
                return Turn::Over;
            }
            (download.file, download.end) = (file, end);
        }
        while let Some(piece) = download.piece() {
            if !budget.take(DATA_BYTES) {
                return Turn::Waits;
            }
            out.send_log_data(client, id, download.offset, piece);
            download.offset += piece.len() as u64;
            if download.offset >= download.end {
                return Turn::Over;
            }
        }
        match &download.file {
            Some(file) if !download.is_fetching => {
                let (file, offset) = (file.clone(), download.offset);
                let left = u32::try_from(download.end - offset).unwrap_or(u32::MAX);
                let task = FileTask::Read { file, offset, count: left.min(BLOCK_BYTES) };
                Turn::Asks(Job::Block { serial, offset }, task)
            }
            _ => Turn::Waits,
        }
    }

    /// A link is gone, and whoever was on it.
    pub(crate) fn logs_forget(&mut self, link: LinkId) {
        self.services.logs.downloads.retain(|d| d.client.link != link);
        self.services.logs.listings.retain(|l| l.client.link != link);
    }
}

impl Stations {
    /// LOG_REQUEST_LIST.
    pub(crate) fn log_list(
        &mut self,
        at: HostTime,
        client: Client,
        m: &LOG_REQUEST_LIST_DATA,
        out: &mut Out,
    ) {
        let job = Job::List { client, start: m.start, end: m.end };
        self.log_ask(at, job, FileTask::List(Folder::Logs), out);
    }

    /// LOG_REQUEST_END.
    pub(crate) fn log_end(&mut self, client: Client) {
        self.services.logs.downloads.retain(|d| d.client != client);
        self.services.logs.listings.retain(|l| l.client != client);
    }

    /// LOG_ERASE.
    pub(crate) fn log_erase(&mut self, at: HostTime, is_armed: bool, out: &mut Out) {
        if is_armed {
            let text = "logs not erased: disarm first".to_owned();
            out.say(at, Severity::Warning, text);
        } else {
            self.services.logs.downloads.clear();
            self.log_ask(at, Job::Erase, FileTask::EraseLogs, out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Bench;
    use crate::config::PilotConfig;
    use crate::input::Input;

    const SIZE: usize = 40_000;

    fn bench() -> Bench {
        Bench::new(PilotConfig { store: true, ..PilotConfig::default() })
    }

    fn ask(bench: &mut Bench, id: u16, ofs: u32, count: u32) -> Vec<MavMessage> {
        let request = LOG_REQUEST_DATA_DATA { id, ofs, count, ..Default::default() };
        bench.says(&MavMessage::LOG_REQUEST_DATA(request))
    }

    /// What comes of two logs on a disk: log, offset and bytes of each piece.
    fn sent(bench: &mut Bench) -> Vec<(u16, usize, usize)> {
        let mut sent = Vec::new();
        for _ in 0..100 {
            let mut requests = Vec::new();
            bench.pilot.drain_file_requests(|request| requests.push(request));
            for request in requests {
                let bytes = match request.task {
                    FileTask::List(Folder::Logs) => {
                        format!("a.mcap\t{SIZE}\t1\nb.mcap\t{SIZE}\t2\n").into_bytes()
                    }
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
                MavMessage::LOG_DATA(m) => Some((m.id, m.ofs as usize, usize::from(m.count))),
                _ => None,
            }));
        }
        sent
    }

    /// The pieces of a log from a byte to another.
    fn pieces(id: u16, bytes: std::ops::Range<usize>) -> impl Iterator<Item = (u16, usize, usize)> {
        let end = bytes.end;
        bytes.step_by(PIECE).map(move |offset| (id, offset, PIECE.min(end - offset)))
    }

    /// MAVProxy ends a download at the first piece that is not full, QGroundControl counts pieces of 90 bytes.
    #[test]
    fn regress_every_piece_of_a_download_but_the_last_is_full() {
        let mut bench = bench();
        ask(&mut bench, 1, 0, u32::MAX);
        assert_eq!(sent(&mut bench), pieces(1, 0..SIZE).collect::<Vec<_>>());
    }

    /// MAVProxy fetches the holes of a log by 20 requests at once, of which the last alone was served.
    #[test]
    fn regress_requests_that_come_at_once_are_all_served_in_their_order() {
        let mut bench = bench();
        let holes: Vec<usize> = (0..20).map(|n| 36_000 - 1800 * n).collect();
        for (n, hole) in holes.iter().enumerate() {
            ask(&mut bench, 1 + n as u16 % 2, *hole as u32, 450);
        }
        let wanted = holes.iter().enumerate();
        let wanted: Vec<_> =
            wanted.flat_map(|(n, from)| pieces(1 + n as u16 % 2, *from..from + 450)).collect();
        assert_eq!(sent(&mut bench), wanted);
        // Who begins anew does not wait for what it asked for before.
        ask(&mut bench, 1, 0, u32::MAX);
        bench.run(0.02);
        ask(&mut bench, 1, 0, u32::MAX);
        assert_eq!(sent(&mut bench), pieces(1, 0..SIZE).collect::<Vec<_>>());
    }

    #[test]
    fn prop_what_does_not_fit_is_counted_and_said() {
        let mut bench = bench();
        let told: Vec<_> = (0..MOST_WAITING as u32 + 3)
            .flat_map(|n| ask(&mut bench, 1, 900 * n, 90))
            .filter_map(|m| match m {
                MavMessage::STATUSTEXT(m) => {
                    Some(String::from_utf8_lossy(&m.text[..]).into_owned())
                }
                _ => None,
            })
            .collect();
        let wanted: Vec<_> = (0..MOST_WAITING).map(|n| (1, 900 * n, PIECE)).collect();
        assert_eq!(sent(&mut bench), wanted);
        let link = usize::from(LinkId::Ground(0).number());
        assert_eq!(bench.pilot.drops()[link].count(DropReason::InputQueueFull), 3);

        assert_eq!(told.iter().filter(|t| t.contains("is not sent")).count(), 1, "{told:?}");
    }

    #[test]
    fn prop_what_waits_ends_with_its_client_its_logs_or_its_link() {
        use haltere_dialect::mav::haltere::{LOG_ERASE_DATA, LOG_REQUEST_END_DATA};
        for ends in ["end", "erase", "link"] {
            let mut bench = bench();
            for n in 0..20 {
                ask(&mut bench, 1, 900 * n, 90);
            }
            match ends {
                "end" => {
                    let end = LOG_REQUEST_END_DATA::default();
                    bench.says(&MavMessage::LOG_REQUEST_END(end));
                }
                "erase" => {
                    bench.says(&MavMessage::LOG_ERASE(LOG_ERASE_DATA::default()));
                }
                _ => {
                    let link = LinkId::Ground(0);
                    bench.pilot.handle(bench.now, Input::LinkDown { link });
                    bench.pilot.handle(bench.now, Input::LinkUp { link });
                }
            }
            assert_eq!(sent(&mut bench), [], "{ends}");
        }
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
