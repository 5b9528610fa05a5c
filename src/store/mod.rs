//! The disk behind the core: does what a [`FileTask`] says, in one folder and the folder of logs.
//!
//! ```text
//! store.directory/parameters.txt        parameters that stations set
//! store.directory/mission.plan …        mission, fence, rally points
//! store.directory/missions/NAME         mission files
//! record.directory/NAME                 flight logs, read only
//! ```
//!
//! Nothing here is fast enough for the control thread: glue runs it on a thread of its own. Whatever
//! is replaced is replaced whole: a power cut at any moment leaves the old or the new.

mod atomic;
pub mod cache;

use std::fs::{self, File};
use std::io::{ErrorKind, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::UNIX_EPOCH;

use crate::sources::stored;
use haltere_log::log_file::LogFile;
use haltere_log::written;
use haltere_pilot::services::{
    FileFault, FileName, FileTask, Folder, MOST_MISSION_BYTES, Plan, crc32,
};

pub use atomic::{replace, replace_private};

/// Most mission files.
const MOST_MISSIONS: usize = 200;
/// Largest list that is read back, bytes: a thousand items are 50 kB.
const MOST_PLAN_BYTES: u64 = 1 << 20;
/// Folder of mission files.
const MISSIONS: &str = "missions";

/// Missions that are not files, and the reader of mission files: known above this layer.
pub trait Programs: Send {
    /// Names of what is built in.
    fn names(&self) -> Vec<String>;
    /// The plan of a built-in program; the error is for people.
    fn built_in(&self, name: &str) -> Result<Vec<u8>, String>;
    /// The plan that the text of a mission file means; the error is for people.
    fn parse(&self, name: &str, text: &str) -> Result<Vec<u8>, String>;
}

/// No programs.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoPrograms;

impl Programs for NoPrograms {
    fn names(&self) -> Vec<String> {
        Vec::new()
    }
    fn built_in(&self, _name: &str) -> Result<Vec<u8>, String> {
        Err("there are none".to_owned())
    }
    fn parse(&self, _name: &str, _text: &str) -> Result<Vec<u8>, String> {
        Err("mission files are not read here".to_owned())
    }
}

/// Logs that are being written, which are never erased.
#[derive(Debug, Clone, Default)]
pub struct OwnLogs(Arc<Mutex<Vec<Arc<LogFile>>>>);

impl OwnLogs {
    /// Another one is begun.
    pub fn add(&self, log: Arc<LogFile>) {
        self.lock().push(log);
    }

    /// This one is written no more.
    pub fn remove(&self, log: &Arc<LogFile>) {
        self.lock().retain(|own| !Arc::ptr_eq(own, log));
    }

    fn holds(&self, name: &str) -> bool {
        let is_it = |log: &Path| log.file_name().is_some_and(|own| own == name);
        self.lock().iter().filter_map(|log| log.path()).any(is_it)
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Arc<LogFile>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The disk.
pub struct Store {
    directory: PathBuf,
    logs: PathBuf,
    own_logs: OwnLogs,
    programs: Box<dyn Programs>,
}

/// What came of a task: bytes, or the fault with its reason.
pub type Answer = Result<Vec<u8>, (FileFault, Vec<u8>)>;

fn io(error: &std::io::Error) -> (FileFault, Vec<u8>) {
    let fault = match error.kind() {
        ErrorKind::NotFound => FileFault::NotFound,
        ErrorKind::PermissionDenied => FileFault::Protected,
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => FileFault::Full,
        _ => FileFault::Failed,
    };
    (fault, error.to_string().into_bytes())
}

fn empty(path: &Path) -> (FileFault, Vec<u8>) {
    let name = path.file_name().unwrap_or_default().display();
    (FileFault::Nonsense, format!("{name} is empty").into_bytes())
}

fn fault(fault: FileFault) -> (FileFault, Vec<u8>) {
    (fault, Vec::new())
}

impl Store {
    /// On these folders. `own_log` is never erased.
    pub fn new(
        directory: &Path,
        logs: &Path,
        own_log: Option<&Path>,
        programs: Box<dyn Programs>,
    ) -> Self {
        let own_logs = OwnLogs::default();
        if let Some(log) = own_log {
            own_logs.add(Arc::new(LogFile::complete(log.to_owned())));
        }
        Self { directory: directory.to_owned(), logs: logs.to_owned(), own_logs, programs }
    }

    /// Removes what was in the making when the power went. For who alone writes here, before anything is written.
    pub fn sweep(&self) {
        for folder in [self.directory.clone(), self.folder(Folder::Missions)] {
            written::sweep(&folder);
        }
    }

    /// The same with logs that may be begun later.
    pub fn with_logs_to_come(self, own_logs: OwnLogs) -> Self {
        Self { own_logs, ..self }
    }

    /// Does one task.
    pub fn work(&self, task: &FileTask) -> Answer {
        match task {
            FileTask::KeepParameter { name, value } => self.keep_parameter(name, *value),
            FileTask::ForgetParameters => remove_if_there(&stored::path(&self.directory)),
            FileTask::LoadPlan(plan) => match fs::metadata(self.plan(*plan)) {
                Ok(meta) if meta.len() > MOST_PLAN_BYTES => Err(fault(FileFault::Full)),
                // What a power cut leaves on many cards. A list that is cleared has no file.
                Ok(meta) if meta.len() == 0 => Err(empty(&self.plan(*plan))),
                Ok(_) => fs::read(self.plan(*plan)).map_err(|e| io(&e)),
                Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
                Err(error) => Err(io(&error)),
            },
            FileTask::SavePlan(plan, bytes) if bytes.is_empty() => {
                remove_if_there(&self.plan(*plan))
            }
            FileTask::SavePlan(plan, bytes) => {
                replace(&self.plan(*plan), bytes).map(|()| Vec::new()).map_err(|e| io(&e))
            }
            FileTask::List(folder) => self.list(*folder),
            FileTask::Size(file) => {
                let size = self.metadata(file)?.len();
                Ok(size.to_le_bytes().to_vec())
            }
            FileTask::Read { file, offset, count } => self.read(file, *offset, *count),
            FileTask::Checksum(file) => self.checksum(file),
            FileTask::Write { file, bytes } => self.write(file, bytes),
            FileTask::Remove(file) if file.folder == Folder::Missions => {
                self.metadata(file)?;
                fs::remove_file(self.path(file)).map(|()| Vec::new()).map_err(|e| io(&e))
            }
            FileTask::Remove(_) => Err(fault(FileFault::Protected)),
            FileTask::EraseLogs => self.erase_logs(),
            FileTask::LoadProgram(name) if name.is_empty() => self.program_names(),
            FileTask::LoadProgram(name) => self.load_program(name),
        }
    }

    fn plan(&self, plan: Plan) -> PathBuf {
        self.directory.join(match plan {
            Plan::Mission => "mission.plan",
            Plan::Fence => "fence.plan",
            Plan::Rally => "rally.plan",
        })
    }

    fn folder(&self, folder: Folder) -> PathBuf {
        match folder {
            Folder::Logs => self.logs.clone(),
            Folder::Missions => self.directory.join(MISSIONS),
        }
    }

    fn path(&self, file: &FileName) -> PathBuf {
        self.folder(file.folder).join(file.name())
    }

    /// Of a plain file: a link would lead out of the folder.
    fn metadata(&self, file: &FileName) -> Result<fs::Metadata, (FileFault, Vec<u8>)> {
        let meta = fs::symlink_metadata(self.path(file)).map_err(|e| io(&e))?;
        if meta.is_file() { Ok(meta) } else { Err(fault(FileFault::NotFound)) }
    }

    fn keep_parameter(&self, name: &str, value: f64) -> Answer {
        let path = stored::path(&self.directory);
        let mut values = match fs::read_to_string(&path) {
            // A damaged file was not used at the start either: begun anew.
            Ok(text) => stored::from_text(&text).unwrap_or_default(),
            Err(error) if error.kind() == ErrorKind::NotFound => stored::Values::new(),
            Err(error) => return Err(io(&error)),
        };
        values.insert(name.to_owned(), value);
        let text = stored::to_text(&values);
        replace(&path, text.as_bytes()).map(|()| Vec::new()).map_err(|e| io(&e))
    }

    /// Plain files with names that stations may see, sorted.
    fn files(&self, folder: Folder) -> Result<Vec<(FileName, fs::Metadata)>, std::io::Error> {
        let entries = match fs::read_dir(self.folder(folder)) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(error),
        };
        let mut files: Vec<_> = entries
            .filter_map(|entry| {
                let entry = entry.ok()?;
                let name = FileName::new(folder, entry.file_name().to_str()?)?;
                let meta = self.metadata(&name).ok()?;
                (folder != Folder::Logs || name.name().ends_with(".mcap")).then_some((name, meta))
            })
            .collect();
        files.sort_by(|a, b| a.0.name().cmp(b.0.name()));
        Ok(files)
    }

    fn list(&self, folder: Folder) -> Answer {
        let mut text = String::new();
        for (file, meta) in self.files(folder).map_err(|e| io(&e))? {
            let modified = meta.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
            let unix_s = modified.map_or(0, |t| t.as_secs());
            text.push_str(&format!("{}\t{}\t{unix_s}\n", file.name(), meta.len()));
        }
        Ok(text.into_bytes())
    }

    fn read(&self, file: &FileName, offset: u64, count: u32) -> Answer {
        self.metadata(file)?;
        let mut open = File::open(self.path(file)).map_err(|e| io(&e))?;
        open.seek(SeekFrom::Start(offset)).map_err(|e| io(&e))?;
        let mut bytes = Vec::with_capacity(count as usize);
        open.take(u64::from(count)).read_to_end(&mut bytes).map_err(|e| io(&e))?;
        Ok(bytes)
    }

    fn checksum(&self, file: &FileName) -> Answer {
        self.metadata(file)?;
        let mut open = File::open(self.path(file)).map_err(|e| io(&e))?;
        let mut piece = vec![0; 1 << 16];
        let mut crc = 0_u32;
        loop {
            match open.read(&mut piece).map_err(|e| io(&e))? {
                0 => return Ok(crc.to_le_bytes().to_vec()),
                n => crc = crc32(piece.get(..n).unwrap_or_default(), crc),
            }
        }
    }

    fn write(&self, file: &FileName, bytes: &[u8]) -> Answer {
        if file.folder != Folder::Missions {
            return Err(fault(FileFault::Protected));
        }
        let known = self.metadata(file).is_ok();
        let full = !known && self.files(file.folder).map_err(|e| io(&e))?.len() >= MOST_MISSIONS;
        if full || bytes.len() > MOST_MISSION_BYTES {
            return Err(fault(FileFault::Full));
        }
        replace(&self.path(file), bytes).map(|()| Vec::new()).map_err(|e| io(&e))
    }

    fn erase_logs(&self) -> Answer {
        for (file, _) in self.files(Folder::Logs).map_err(|e| io(&e))? {
            if !self.own_logs.holds(file.name()) {
                fs::remove_file(self.path(&file)).map_err(|e| io(&e))?;
            }
        }
        Ok(Vec::new())
    }

    fn program_names(&self) -> Answer {
        let files = self.files(Folder::Missions).map_err(|e| io(&e))?;
        let files = files.iter().map(|(file, _)| file.name().to_owned());
        let names: Vec<String> = files.chain(self.programs.names()).collect();
        Ok(names.join("\n").into_bytes())
    }

    fn load_program(&self, name: &str) -> Answer {
        let nonsense = |why: String| (FileFault::Nonsense, why.into_bytes());
        if self.programs.names().iter().any(|built_in| built_in == name) {
            return self.programs.built_in(name).map_err(nonsense);
        }
        let Some(file) = FileName::new(Folder::Missions, name) else {
            return Err(fault(FileFault::NotFound));
        };
        if self.metadata(&file)?.len() > MOST_MISSION_BYTES as u64 {
            return Err(fault(FileFault::Full));
        }
        let text = fs::read_to_string(self.path(&file)).map_err(|e| io(&e))?;
        self.programs.parse(name, &text).map_err(nonsense)
    }
}

fn remove_if_there(path: &Path) -> Answer {
    match fs::remove_file(path) {
        Ok(()) => Ok(Vec::new()),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(io(&error)),
    }
}

#[cfg(test)]
mod tests;
