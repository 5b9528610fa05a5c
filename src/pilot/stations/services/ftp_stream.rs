//! MAVLink FTP: what goes through a session: single reads, bursts, and the blocks behind them.
//!
//! Files of the disk are read in blocks of 16 kB ahead of the packets, so that a packet of 239 bytes
//! does not wait for the disk each.

use haltere_dialect::mav::haltere::MavFtpErr;

use haltere_core::time::HostTime;

use super::Purpose;
use super::budget::Budget;
use super::files::{FileFault, FileName, FileTask, MOST_READ_BYTES};
use super::ftp_wire::{FRAME_BYTES, MOST_DATA, Packet};
use crate::input::LinkId;
use crate::out::Out;
use crate::stations::Stations;
use crate::stations::mission_transfer::Client;

/// Sessions at once.
pub(crate) const MOST_SESSIONS: usize = 6;
/// Reads of a session that wait for the disk: clients have a few in flight.
const MOST_WAITING: usize = 8;
/// A session that nobody uses for so long ends, s.
const IDLE_S: f64 = 60.0;
/// Packets of one burst; then the client asks again. QGroundControl and MAVSDK go on by themselves.
const BURST_PACKETS: u32 = 400;

/// What an answer of the disk is for.
#[derive(Debug)]
pub(crate) enum Job {
    List(Client, Packet),
    Open(Client, Packet, FileName),
    Checksum(Client, Packet),
    Remove(Client, Packet),
    Store(Client, Packet),
    Block { number: usize, serial: u32, offset: u64 },
}

/// What a session reads or writes.
#[derive(Debug)]
pub(crate) enum Content {
    /// Made in the core.
    Memory(Vec<u8>),
    /// On the disk: the block that is at hand, where it begins, and whether another one is fetched.
    Disk { file: FileName, block: Vec<u8>, block_at: u64, is_fetching: bool },
    /// To be written.
    Upload { file: FileName, bytes: Vec<u8> },
}

#[derive(Debug)]
pub(crate) struct Burst {
    request: Packet,
    seq: u16,
    offset: u32,
    chunk: usize,
    left: u32,
}

#[derive(Debug)]
pub(crate) struct Session {
    pub(crate) client: Client,
    /// By which the client names it.
    pub(crate) id: u8,
    /// Not used twice: answers for an older session of the same number do not fit.
    pub(crate) serial: u32,
    pub(crate) size: u64,
    pub(crate) content: Content,
    pub(crate) burst: Option<Burst>,
    /// Reads that wait for their block.
    pub(crate) waiting: Vec<Packet>,
    pub(crate) used_at: HostTime,
}

impl Stations {
    pub(crate) fn ftp_read(
        &mut self,
        at: HostTime,
        client: Client,
        request: Packet,
        out: &mut Out,
    ) -> Option<Packet> {
        let ftp = &mut self.services.ftp;
        let number = ftp.place_of(request.session, client);
        let (Some(number), Some(session)) = (number, ftp.session(request.session, client)) else {
            return Some(request.nak(MavFtpErr::MAV_FTP_ERR_INVALIDSESSION));
        };
        session.used_at = at;
        if u64::from(request.offset) >= session.size {
            return Some(request.nak(MavFtpErr::MAV_FTP_ERR_EOF));
        }
        let count = usize::from(request.size).min(MOST_DATA);
        match session.at_hand(request.offset, count) {
            Some(data) => Some(request.ack(data)),
            None => {
                let offset = u64::from(request.offset);
                if session.waiting.len() == MOST_WAITING {
                    // Its client asks again.
                    session.waiting.remove(0);
                }
                session.waiting.push(request);
                self.ftp_fetch(at, number, offset, out);
                None
            }
        }
    }

    pub(crate) fn ftp_burst(
        &mut self,
        at: HostTime,
        client: Client,
        request: Packet,
    ) -> Option<Packet> {
        let Some(session) = self.services.ftp.session(request.session, client) else {
            return Some(request.nak(MavFtpErr::MAV_FTP_ERR_INVALIDSESSION));
        };
        session.used_at = at;
        if u64::from(request.offset) >= session.size {
            return Some(request.nak(MavFtpErr::MAV_FTP_ERR_EOF));
        }
        let chunk = match usize::from(request.size) {
            0 => MOST_DATA,
            size => size.min(MOST_DATA),
        };
        session.burst = Some(Burst {
            seq: request.seq.wrapping_add(1),
            offset: request.offset,
            chunk,
            left: BURST_PACKETS,
            request,
        });
        None
    }

    /// Asks for the block of a session that begins at an offset.
    fn ftp_fetch(&mut self, at: HostTime, number: usize, offset: u64, out: &mut Out) {
        let Some(Some(session)) = self.services.ftp.sessions.get_mut(number) else {
            return;
        };
        let Content::Disk { file, is_fetching, .. } = &mut session.content else { return };
        if *is_fetching {
            return;
        }
        *is_fetching = true;
        let task = FileTask::Read { file: file.clone(), offset, count: MOST_READ_BYTES };
        let job = Job::Block { number, serial: session.serial, offset };
        if let Err((fault, Purpose::Ftp(job))) = self.services.desk.ask(task, Purpose::Ftp(job), at)
        {
            self.ftp_answer(at, job, Err(fault), &[], out);
        }
    }

    pub(crate) fn ftp_block(
        &mut self,
        at: HostTime,
        (number, serial, offset): (usize, u32, u64),
        result: Result<(), FileFault>,
        bytes: &[u8],
        out: &mut Out,
    ) {
        let Some(Some(session)) = self.services.ftp.sessions.get_mut(number) else {
            return;
        };
        if session.serial != serial {
            return;
        }
        let client = session.client;
        let Content::Disk { block, block_at, is_fetching, .. } = &mut session.content else {
            return;
        };
        *is_fetching = false;
        // A file that has become shorter would be asked for for ever.
        let due = session.size.saturating_sub(offset).min(u64::from(MOST_READ_BYTES));
        let failed = result.is_err() || bytes.is_empty() || (bytes.len() as u64) < due;
        if !failed {
            *block = bytes.to_vec();
            *block_at = offset;
        }
        let waiting = std::mem::take(&mut session.waiting);
        let burst = if failed { session.burst.take() } else { None };
        if let Some(burst) = burst {
            let mut answer = burst.request.nak(MavFtpErr::MAV_FTP_ERR_FAIL);
            answer.seq = burst.seq;
            out.send_ftp(client, &answer);
        }
        for request in waiting {
            let seq = request.seq;
            let answer = if failed {
                Some(request.nak(MavFtpErr::MAV_FTP_ERR_FAIL))
            } else {
                self.ftp_read(at, client, request, out)
            };
            if let Some(answer) = answer {
                self.answer_ftp(client, seq, answer, out);
            }
        }
    }

    /// Goes on with bursts, and ends what nobody uses.
    pub(crate) fn ftp_tick(
        &mut self,
        at: HostTime,
        link: LinkId,
        budget: &mut Budget<'_>,
        out: &mut Out,
    ) {
        for number in 0..MOST_SESSIONS {
            let Some(slot) = self.services.ftp.sessions.get_mut(number) else { return };
            if slot.take_if(|s| at.seconds_since(s.used_at) > IDLE_S).is_some() {
                continue;
            }
            let Some(session) = slot.as_mut().filter(|s| s.client.link == link) else {
                continue;
            };
            let client = session.client;
            let mut packets = Vec::new();
            let mut missing = None;
            while let Some(burst) = &mut session.burst {
                let left = session.size.saturating_sub(u64::from(burst.offset));
                let count = burst.chunk.min(left as usize);
                let offset = burst.offset;
                if !session.content.has(offset, count) {
                    missing = Some(u64::from(offset));
                    break;
                }
                if !budget.take(FRAME_BYTES) {
                    break;
                }
                session.used_at = at;
                let data = session.content.slice(offset, count);
                let mut packet = burst.request.ack(data);
                packet.seq = burst.seq;
                packet.offset = offset;
                burst.seq = burst.seq.wrapping_add(1);
                burst.offset = offset.saturating_add(count as u32);
                burst.left -= 1;
                packet.burst_complete = burst.left == 0 || left <= count as u64;
                if packet.burst_complete {
                    session.burst = None;
                }
                packets.push(packet);
            }
            for packet in &packets {
                out.send_ftp(client, packet);
            }
            if let Some(offset) = missing {
                self.ftp_fetch(at, number, offset, out);
            }
        }
    }
}

impl Session {
    /// Data of a read that can be answered at once: to the end of the file or of the block.
    fn at_hand(&self, offset: u32, count: usize) -> Option<Vec<u8>> {
        let left = self.size.saturating_sub(u64::from(offset));
        let count = count.min(left as usize);
        self.content.has(offset, count).then(|| self.content.slice(offset, count))
    }
}

impl Content {
    fn part(&self, offset: u32, count: usize) -> Option<&[u8]> {
        let (bytes, start) = match self {
            Content::Memory(bytes) | Content::Upload { bytes, .. } => (bytes, u64::from(offset)),
            Content::Disk { block, block_at, .. } => {
                (block, u64::from(offset).checked_sub(*block_at)?)
            }
        };
        let start = usize::try_from(start).ok()?;
        bytes.get(start..start.checked_add(count)?)
    }

    fn has(&self, offset: u32, count: usize) -> bool {
        self.part(offset, count).is_some()
    }

    fn slice(&self, offset: u32, count: usize) -> Vec<u8> {
        self.part(offset, count).unwrap_or_default().to_vec()
    }
}
