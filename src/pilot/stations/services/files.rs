//! Files, as the core sees them: it asks, glue answers, nobody waits.
//!
//! The core has no disk. It hands out a [`FileRequest`] with a ticket; glue works on it on a thread of
//! its own and hands the result back as [`crate::input::Input::File`] with the same ticket. Answers
//! are recorded like every other input, so that a replay needs no disk either.

use haltere_core::time::HostTime;

/// Requests that may be under way at once. Bounds memory; more are refused at once.
const MOST_PENDING: usize = 32;
/// A request without an answer for so long has failed, s: a disk that stalls longer is broken.
const PATIENCE_S: f64 = 5.0;

/// Ticket of what glue tells unasked, before anything else: whether the parameters that were kept, which are
/// part of the configuration the core was made with, could be read back; if not, the bytes say why.
pub const PARAMETERS_TICKET: u32 = 0;

/// Most bytes of one read.
pub const MOST_READ_BYTES: u32 = 16 * 1024;
/// Most bytes of a mission file.
pub const MOST_MISSION_BYTES: usize = 128 * 1024;

/// A folder that stations can see into.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Folder {
    /// Flight logs: read only.
    Logs,
    /// Mission files: read and written.
    Missions,
}

/// One of the lists that are kept over a restart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Plan {
    /// The mission.
    Mission,
    /// The fence.
    Fence,
    /// Rally points.
    Rally,
}

/// A file in a folder. The name has been checked: it cannot lead out of the folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileName {
    /// Where.
    pub folder: Folder,
    /// Letters, digits, dot, dash and underscore, not starting with a dot.
    name: String,
}

/// Longest name of a file.
const LONGEST_NAME: usize = 64;

impl FileName {
    /// `None`: not a name that we would ever give.
    pub fn new(folder: Folder, name: &str) -> Option<Self> {
        let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
        let sound = (1..=LONGEST_NAME).contains(&name.len())
            && name.chars().all(allowed)
            && !name.starts_with('.');
        sound.then(|| Self { folder, name: name.to_owned() })
    }

    /// The bare name.
    pub fn name(&self) -> &str {
        &self.name
    }
}

/// What glue shall do.
#[derive(Debug, Clone, PartialEq)]
pub enum FileTask {
    /// Keep a parameter's value over a restart.
    KeepParameter {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// Forget all parameters that were kept.
    ForgetParameters,
    /// Read a list that was kept; an answer without bytes means that there is none.
    LoadPlan(Plan),
    /// Keep a list; no bytes: keep none.
    SavePlan(Plan, Vec<u8>),
    /// List a folder: lines `NAME TAB SIZE TAB UNIX-SECONDS`, sorted by name.
    List(Folder),
    /// Size of a file: eight bytes, little-endian.
    Size(FileName),
    /// Bytes of a file, fewer at its end.
    Read {
        /// Which.
        file: FileName,
        /// From here.
        offset: u64,
        /// Most.
        count: u32,
    },
    /// CRC-32 of a whole file: four bytes, little-endian.
    Checksum(FileName),
    /// Write a whole file, at once or not at all.
    Write {
        /// Which.
        file: FileName,
        /// What.
        bytes: Vec<u8>,
    },
    /// Remove a file.
    Remove(FileName),
    /// Remove all logs but the one being written.
    EraseLogs,
    /// The mission that a file of the missions folder holds, as a plan; a name: built-in or file.
    LoadProgram(String),
}

/// A task with its ticket.
#[derive(Debug, Clone, PartialEq)]
pub struct FileRequest {
    /// Comes back with the answer.
    pub ticket: u32,
    /// What to do.
    pub task: FileTask,
}

/// Why a task was not done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum FileFault {
    /// There is no such file.
    NotFound = 1,
    /// It may not be changed.
    Protected = 2,
    /// The disk said no.
    Failed = 3,
    /// Too much is under way.
    Busy = 4,
    /// Nothing is kept: `store.directory` is empty.
    Off = 5,
    /// Too many files or bytes.
    Full = 6,
    /// No answer came.
    TimedOut = 7,
    /// The content makes no sense; the bytes say why.
    Nonsense = 8,
}

impl FileFault {
    /// All of them, in the order of their numbers.
    pub const ALL: [FileFault; 8] = [
        FileFault::NotFound,
        FileFault::Protected,
        FileFault::Failed,
        FileFault::Busy,
        FileFault::Off,
        FileFault::Full,
        FileFault::TimedOut,
        FileFault::Nonsense,
    ];

    /// The one with this number.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|fault| *fault as u8 == number)
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            FileFault::NotFound => "no such file",
            FileFault::Protected => "it may not be changed",
            FileFault::Failed => "the disk refuses",
            FileFault::Busy => "too much at once, try again",
            FileFault::Off => "nothing is kept: store.directory is empty",
            FileFault::Full => "too large, or too many",
            FileFault::TimedOut => "the disk does not answer",
            FileFault::Nonsense => "its content makes no sense",
        }
    }
}

/// Tasks under way, each with what it is for.
#[derive(Debug)]
pub(crate) struct FileDesk<P> {
    /// Whether anybody works on requests.
    is_open: bool,
    next_ticket: u32,
    requests: Vec<FileRequest>,
    pending: Vec<(u32, HostTime, P)>,
}

impl<P> FileDesk<P> {
    pub fn new(is_open: bool) -> Self {
        Self { is_open, next_ticket: 1, requests: Vec::new(), pending: Vec::new() }
    }

    /// Hands a task out. The error gives the purpose back.
    pub fn ask(&mut self, task: FileTask, purpose: P, at: HostTime) -> Result<(), (FileFault, P)> {
        if !self.is_open {
            return Err((FileFault::Off, purpose));
        }
        if self.pending.len() >= MOST_PENDING {
            return Err((FileFault::Busy, purpose));
        }
        let ticket = self.next_ticket;
        self.next_ticket = self.next_ticket.wrapping_add(1).max(1);
        self.requests.push(FileRequest { ticket, task });
        self.pending.push((ticket, at, purpose));
        Ok(())
    }

    /// What an answer is for. `None`: nobody waits for it, or not any more.
    pub fn take(&mut self, ticket: u32) -> Option<P> {
        let index = self.pending.iter().position(|(t, ..)| *t == ticket)?;
        Some(self.pending.remove(index).2)
    }

    /// Whether an answer for such a purpose is still to come.
    pub fn waits_for(&self, is_it: impl Fn(&P) -> bool) -> bool {
        self.pending.iter().any(|(.., purpose)| is_it(purpose))
    }

    /// Whether nothing is asked for, and no answer is to come.
    pub fn is_idle(&self) -> bool {
        self.requests.is_empty() && self.pending.is_empty()
    }

    /// One whose answer is overdue.
    pub fn overdue(&mut self, at: HostTime) -> Option<P> {
        let late = |(_, asked, _): &(u32, HostTime, P)| at.seconds_since(*asked) > PATIENCE_S;
        let index = self.pending.iter().position(late)?;
        Some(self.pending.remove(index).2)
    }

    /// Tasks that were not handed out yet.
    pub fn drain(&mut self) -> std::vec::Drain<'_, FileRequest> {
        self.requests.drain(..)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_no_name_leads_out_of_its_folder() {
        for bad in ["", ".", "..", ".hidden", "a/b", "/etc/passwd", "..\\x", "a\0b", "a b", "ü"] {
            assert_eq!(FileName::new(Folder::Missions, bad), None, "{bad:?}");
        }
        assert_eq!(FileName::new(Folder::Logs, &"x".repeat(65)), None);
        let good = FileName::new(Folder::Logs, "20261121-140243-00.mcap");
        assert_eq!(good.map(|f| f.name().to_owned()).as_deref(), Some("20261121-140243-00.mcap"));
    }

    #[test]
    fn prop_tickets_are_bounded_matched_and_expire() {
        let at = |s: u64| HostTime::from_us(s * 1_000_000);
        let mut desk = FileDesk::new(true);
        for n in 0..MOST_PENDING {
            assert!(desk.ask(FileTask::EraseLogs, n, at(0)).is_ok());
        }
        assert_eq!(desk.ask(FileTask::EraseLogs, 99, at(0)), Err((FileFault::Busy, 99)));
        assert_eq!(desk.drain().count(), MOST_PENDING);
        assert_eq!(desk.take(3), Some(2));
        assert_eq!(desk.take(3), None);
        assert_eq!(desk.overdue(at(4)), None);
        assert_eq!(desk.overdue(at(6)), Some(0));
        let mut shut = FileDesk::new(false);
        assert_eq!(shut.ask(FileTask::EraseLogs, 1, at(0)), Err((FileFault::Off, 1)));
    }
}
