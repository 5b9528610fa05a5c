//! MAVLink FTP: the server.
//!
//! Source: the guide's "File Transfer Protocol (FTP)" page. Every request is answered with ACK or
//! NAK; a repeated one (same sequence number) with the same answer as before, without doing the
//! work twice. Sessions, remembered answers and blocks of files are bounded; a session that nobody
//! uses ends by itself. A file that is written lies in memory until its session is ended, and is
//! then on the disk whole or not at all.

use haltere_dialect::mav::haltere::{MavFtpErr, MavFtpOpcode, MavMessage};

use haltere_core::time::HostTime;

use super::Purpose;
use super::crc32::crc32;
use super::files::{FileFault, FileTask, Folder, MOST_MISSION_BYTES};
use super::ftp_path::{LOGS, MISSIONS, Made, Place, place};
use super::ftp_stream::{Content, Job, MOST_SESSIONS, Session};
use super::ftp_wire::{MOST_DATA, Packet};
use crate::input::LinkId;
use crate::out::Out;
use crate::stations::Stations;
use crate::stations::endpoint::Identity;
use crate::stations::mission_transfer::Client;

/// Clients whose last answer is remembered.
const MOST_CLIENTS: usize = 16;

/// The last request of a client, and its answer if there is one yet.
#[derive(Debug)]
struct Answered {
    client: Client,
    seq: u16,
    /// Of the whole request: another program of the same client may begin with the same numbers.
    crc: u32,
    answer: Option<Packet>,
}

/// State of the server.
#[derive(Debug, Default)]
pub(crate) struct Ftp {
    pub(crate) sessions: [Option<Session>; MOST_SESSIONS],
    next_serial: u32,
    answered: Vec<Answered>,
}

impl Ftp {
    /// Whether nobody has a file open.
    pub fn is_idle(&self) -> bool {
        self.sessions.iter().all(Option::is_none)
    }

    /// The place of a client's session.
    pub(crate) fn place_of(&self, id: u8, client: Client) -> Option<usize> {
        let is_it = |s: &Session| s.id == id && s.client == client;
        self.sessions.iter().position(|slot| slot.as_ref().is_some_and(is_it))
    }

    pub(crate) fn session(&mut self, id: u8, client: Client) -> Option<&mut Session> {
        let place = self.place_of(id, client)?;
        self.sessions.get_mut(place)?.as_mut()
    }

    /// Opens a session, under the id that the client wants if it has none of that id yet: MAVProxy
    /// chooses and listens to no other; the rest take what they are given.
    fn open(
        &mut self,
        client: Client,
        wanted: u8,
        size: u64,
        content: Content,
        at: HostTime,
    ) -> Option<u8> {
        let place = self.sessions.iter().position(Option::is_none)?;
        let id = std::iter::once(wanted)
            .chain(0..=u8::MAX)
            .find(|id| self.place_of(*id, client).is_none())?;
        self.next_serial = self.next_serial.wrapping_add(1);
        let session = Session {
            client,
            id,
            serial: self.next_serial,
            size,
            content,
            burst: None,
            waiting: Vec::new(),
            used_at: at,
        };
        *self.sessions.get_mut(place)? = Some(session);
        Some(id)
    }

    fn remember(&mut self, client: Client, seq: u16, crc: u32) {
        self.answered.retain(|known| known.client != client);
        if self.answered.len() == MOST_CLIENTS {
            self.answered.remove(0);
        }
        self.answered.push(Answered { client, seq, crc, answer: None });
    }
}

/// The error code for a client.
fn error_of(fault: FileFault) -> MavFtpErr {
    match fault {
        FileFault::NotFound | FileFault::Off => MavFtpErr::MAV_FTP_ERR_FILENOTFOUND,
        FileFault::Protected => MavFtpErr::MAV_FTP_ERR_FILEPROTECTED,
        _ => MavFtpErr::MAV_FTP_ERR_FAIL,
    }
}

/// One entry of a list on the wire.
fn entry(kind: char, name: &str, size: Option<u64>) -> Vec<u8> {
    let size = size.map_or(String::new(), |size| format!("\t{size}"));
    format!("{kind}{name}{size}\0").into_bytes()
}

/// As many entries as fit, from one on; `None`: there is none any more.
fn page(entries: impl Iterator<Item = Vec<u8>>, from: u32) -> Option<Vec<u8>> {
    let mut data = Vec::new();
    for entry in entries.skip(from as usize) {
        if data.len() + entry.len() > MOST_DATA {
            break;
        }
        data.extend_from_slice(&entry);
    }
    (!data.is_empty()).then_some(data)
}

impl Out {
    pub(crate) fn send_ftp(&mut self, client: Client, packet: &Packet) {
        let message = MavMessage::FILE_TRANSFER_PROTOCOL(packet.encode(client.peer));
        self.message(client.link, &message);
    }
}

impl Stations {
    pub(crate) fn answer_ftp(&mut self, client: Client, seq: u16, answer: Packet, out: &mut Out) {
        out.send_ftp(client, &answer);
        let mut all = self.services.ftp.answered.iter_mut();
        if let Some(known) = all.find(|known| (known.client, known.seq) == (client, seq)) {
            known.answer = Some(answer);
        }
    }

    /// Hands a task out; the answer comes later, unless it is "no".
    fn ftp_ask(
        &mut self,
        at: HostTime,
        task: FileTask,
        job: Job,
        request: &Packet,
    ) -> Option<Packet> {
        match self.services.desk.ask(task, Purpose::Ftp(job), at) {
            Ok(()) => None,
            Err((fault, _)) => Some(request.nak(error_of(fault))),
        }
    }

    /// What an upload brings is kept in memory until its session ends.
    fn ftp_write(&mut self, at: HostTime, client: Client, request: &Packet) -> Packet {
        use MavFtpErr as E;
        let Some(session) = self.services.ftp.session(request.session, client) else {
            return request.nak(E::MAV_FTP_ERR_INVALIDSESSION);
        };
        session.used_at = at;
        let Content::Upload { bytes, .. } = &mut session.content else {
            return request.nak(E::MAV_FTP_ERR_FILEPROTECTED);
        };
        let start = request.offset as usize;
        let end = start.saturating_add(request.data.len());
        if end > MOST_MISSION_BYTES {
            return request.nak(E::MAV_FTP_ERR_FAIL);
        }
        if bytes.len() < end {
            bytes.resize(end, 0);
        }
        for (slot, byte) in bytes.iter_mut().skip(start).zip(&request.data) {
            *slot = *byte;
        }
        let written = (request.data.len() as u32).to_le_bytes().to_vec();
        request.ack(written)
    }

    /// `None`: the answer comes later.
    fn ftp_request(
        &mut self,
        at: HostTime,
        client: Client,
        request: Packet,
        out: &mut Out,
    ) -> Option<Packet> {
        use MavFtpErr as E;
        use MavFtpOpcode as O;
        const NONE: u8 = O::MAV_FTP_OPCODE_NONE as u8;
        const TERMINATE: u8 = O::MAV_FTP_OPCODE_TERMINATESESSION as u8;
        const RESET: u8 = O::MAV_FTP_OPCODE_RESETSESSION as u8;
        const LIST: u8 = O::MAV_FTP_OPCODE_LISTDIRECTORY as u8;
        const OPEN_RO: u8 = O::MAV_FTP_OPCODE_OPENFILERO as u8;
        const READ: u8 = O::MAV_FTP_OPCODE_READFILE as u8;
        const CREATE: u8 = O::MAV_FTP_OPCODE_CREATEFILE as u8;
        const WRITE: u8 = O::MAV_FTP_OPCODE_WRITEFILE as u8;
        const REMOVE: u8 = O::MAV_FTP_OPCODE_REMOVEFILE as u8;
        const OPEN_WO: u8 = O::MAV_FTP_OPCODE_OPENFILEWO as u8;
        const CRC: u8 = O::MAV_FTP_OPCODE_CALCFILECRC as u8;
        const BURST: u8 = O::MAV_FTP_OPCODE_BURSTREADFILE as u8;
        const MAKE_FOLDER: u8 = O::MAV_FTP_OPCODE_CREATEDIRECTORY as u8;
        const REMOVE_FOLDER: u8 = O::MAV_FTP_OPCODE_REMOVEDIRECTORY as u8;
        const TRUNCATE: u8 = O::MAV_FTP_OPCODE_TRUNCATEFILE as u8;
        const RENAME: u8 = O::MAV_FTP_OPCODE_RENAME as u8;

        let not_found = || Some(request.nak(E::MAV_FTP_ERR_FILENOTFOUND));
        match request.opcode {
            NONE => Some(request.ack(Vec::new())),
            TERMINATE => self.ftp_end(at, client, request),
            RESET => {
                for slot in &mut self.services.ftp.sessions {
                    slot.take_if(|session| session.client == client);
                }
                Some(request.ack(Vec::new()))
            }
            LIST => match request.path().and_then(place) {
                Some(Place::Root) => {
                    let files = self.services.metadata.files();
                    let files =
                        files.map(|(name, bytes)| entry('F', name, Some(bytes.len() as u64)));
                    let folders = [LOGS, MISSIONS].map(|name| entry('D', name, None));
                    Some(match page(folders.into_iter().chain(files), request.offset) {
                        Some(data) => request.ack(data),
                        None => request.nak(E::MAV_FTP_ERR_EOF),
                    })
                }
                Some(Place::Folder(folder)) => {
                    let job = Job::List(client, request.clone());
                    self.ftp_ask(at, FileTask::List(folder), job, &request)
                }
                _ => not_found(),
            },
            OPEN_RO => {
                let bytes = match request.path().and_then(place) {
                    Some(Place::Made(made)) => self.made_file(client, made),
                    Some(Place::File(file)) => {
                        let job = Job::Open(client, request.clone(), file.clone());
                        return self.ftp_ask(at, FileTask::Size(file), job, &request);
                    }
                    _ => return not_found(),
                };
                let size = bytes.len() as u64;
                Some(self.ftp_open(at, client, &request, size, Content::Memory(bytes)))
            }
            CREATE | OPEN_WO => match request.path().and_then(place) {
                Some(Place::File(file)) if file.folder == Folder::Missions => {
                    let content = Content::Upload { file, bytes: Vec::new() };
                    Some(self.ftp_open(at, client, &request, 0, content))
                }
                _ => Some(request.nak(E::MAV_FTP_ERR_FILEPROTECTED)),
            },
            READ => self.ftp_read(at, client, request, out),
            BURST => self.ftp_burst(at, client, request),
            WRITE => Some(self.ftp_write(at, client, &request)),
            REMOVE => match request.path().and_then(place) {
                Some(Place::File(file)) if file.folder == Folder::Missions => {
                    let job = Job::Remove(client, request.clone());
                    self.ftp_ask(at, FileTask::Remove(file), job, &request)
                }
                Some(_) => Some(request.nak(E::MAV_FTP_ERR_FILEPROTECTED)),
                None => not_found(),
            },
            CRC => {
                let crc = match request.path().and_then(place) {
                    Some(Place::Made(made)) => crc32(&self.made_file(client, made), 0),
                    Some(Place::File(file)) => {
                        let job = Job::Checksum(client, request.clone());
                        return self.ftp_ask(at, FileTask::Checksum(file), job, &request);
                    }
                    _ => return not_found(),
                };
                Some(request.ack(crc.to_le_bytes().to_vec()))
            }
            MAKE_FOLDER | REMOVE_FOLDER | TRUNCATE | RENAME => {
                Some(request.nak(E::MAV_FTP_ERR_FILEPROTECTED))
            }
            _ => Some(request.nak(E::MAV_FTP_ERR_UNKNOWNCOMMAND)),
        }
    }

    /// A file that lies on no disk, as this client sees it.
    fn made_file(&self, client: Client, made: Made) -> Vec<u8> {
        let metadata = &self.services.metadata;
        match made {
            Made::General => metadata.general.clone(),
            Made::Parameters => metadata.parameters.clone(),
            Made::Events => metadata.events.clone(),
            Made::Packed(query) => {
                let px4 = self.endpoint_on(client.link).identity == Identity::Px4;
                self.services.parameters.packed(px4, query)
            }
        }
    }

    fn ftp_open(
        &mut self,
        at: HostTime,
        client: Client,
        request: &Packet,
        size: u64,
        content: Content,
    ) -> Packet {
        // Offsets on the wire have 32 bits.
        let Ok(wire_size) = u32::try_from(size) else {
            return request.nak(MavFtpErr::MAV_FTP_ERR_FAIL);
        };
        match self.services.ftp.open(client, request.session, size, content, at) {
            Some(id) => {
                let mut answer = request.ack(wire_size.to_le_bytes().to_vec());
                answer.session = id;
                answer
            }
            None => request.nak(MavFtpErr::MAV_FTP_ERR_NOSESSIONSAVAILABLE),
        }
    }

    /// Ends a session; a file that was written goes to the disk.
    fn ftp_end(&mut self, at: HostTime, client: Client, request: Packet) -> Option<Packet> {
        let Some(place) = self.services.ftp.place_of(request.session, client) else {
            return Some(request.nak(MavFtpErr::MAV_FTP_ERR_INVALIDSESSION));
        };
        let slot = self.services.ftp.sessions.get_mut(place);
        match slot.and_then(Option::take).map(|session| session.content) {
            Some(Content::Upload { file, bytes }) => {
                let job = Job::Store(client, request.clone());
                self.ftp_ask(at, FileTask::Write { file, bytes }, job, &request)
            }
            _ => Some(request.ack(Vec::new())),
        }
    }

    /// The disk has answered.
    pub(crate) fn ftp_answer(
        &mut self,
        at: HostTime,
        job: Job,
        result: Result<(), FileFault>,
        bytes: &[u8],
        out: &mut Out,
    ) {
        let (client, request, answer) = match (job, result) {
            (Job::Block { number, serial, offset }, result) => {
                self.ftp_block(at, (number, serial, offset), result, bytes, out);
                return;
            }
            (Job::List(client, r), Ok(())) => {
                let text = String::from_utf8_lossy(bytes);
                let entries = text.lines().filter_map(|line| {
                    let mut parts = line.split('\t');
                    let (name, size) = (parts.next()?, parts.next()?.parse().ok()?);
                    Some(entry('F', name, Some(size)))
                });
                let answer = match page(entries, r.offset) {
                    Some(data) => r.ack(data),
                    None => r.nak(MavFtpErr::MAV_FTP_ERR_EOF),
                };
                (client, r, answer)
            }
            (Job::Open(client, r, file), Ok(())) => {
                let size = bytes.first_chunk::<8>().map_or(0, |b| u64::from_le_bytes(*b));
                let content =
                    Content::Disk { file, block: Vec::new(), block_at: 0, is_fetching: false };
                let answer = self.ftp_open(at, client, &r, size, content);
                (client, r, answer)
            }
            (Job::Checksum(client, r), Ok(())) => {
                let answer = r.ack(bytes.iter().copied().take(4).collect());
                (client, r, answer)
            }
            (Job::Remove(client, r) | Job::Store(client, r), Ok(())) => {
                let answer = r.ack(Vec::new());
                (client, r, answer)
            }
            (
                Job::List(client, r)
                | Job::Open(client, r, _)
                | Job::Checksum(client, r)
                | Job::Remove(client, r)
                | Job::Store(client, r),
                Err(fault),
            ) => {
                let answer = r.nak(error_of(fault));
                (client, r, answer)
            }
        };
        self.answer_ftp(client, request.seq, answer, out);
    }

    /// A link is gone, and whoever was on it.
    pub(crate) fn ftp_forget(&mut self, link: LinkId) {
        for slot in &mut self.services.ftp.sessions {
            slot.take_if(|session| session.client.link == link);
        }
        self.services.ftp.answered.retain(|known| known.client.link != link);
    }
}

impl Stations {
    pub(crate) fn ftp_message(
        &mut self,
        at: HostTime,
        client: Client,
        payload: &[u8; 251],
        out: &mut Out,
    ) {
        let request = Packet::decode(payload);
        let (seq, crc) = (request.seq, crc32(payload, 0));
        let known = self
            .services
            .ftp
            .answered
            .iter()
            .find(|known| (known.client, known.seq, known.crc) == (client, seq, crc));
        if let Some(known) = known {
            // Repeated: the answer was lost, or is still being worked on.
            if let Some(answer) = known.answer.clone() {
                out.send_ftp(client, &answer);
            }
            return;
        }
        self.services.ftp.remember(client, seq, crc);
        if let Some(answer) = self.ftp_request(at, client, request, out) {
            self.answer_ftp(client, seq, answer, out);
        }
    }
}
