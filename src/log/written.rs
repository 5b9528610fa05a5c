//! Files that programs write for people: whole or not at all, never over a flight log, never over what was read.
//!
//! A flight cannot be flown again, and a shell turns `-o *.mcap` into two names without a question. So every
//! command writes through here: beside, synced, renamed, and the folder synced, so that a power cut at any moment
//! leaves the old or the new. What is named is looked at through links. Devices and pipes have no contents to lose and
//! are written as they are.

use std::fs::{File, Metadata, OpenOptions, Permissions};
use std::io::{self, Read as _, Write};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// First bytes of every flight log (MCAP's magic).
pub const LOG_MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
/// Name of what is in the making: nobody reads it.
const PREFIX: &str = ".written-";
const SUFFIX: &str = ".part";
/// Mode of a new file; the process's umask takes from it.
const MODE: u32 = 0o666;
/// Mode of what only its owner may read, new or not.
const PRIVATE: u32 = 0o600;

/// Why a file is not written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// A flight log has this name.
    #[error("{}: is a flight log, which nothing is written over; name another file to write", path.display())]
    OverLog {
        /// Which.
        path: PathBuf,
    },
    /// The command reads it.
    #[error("{}: is {}, which this command reads; name another file to write", path.display(), same(path, input))]
    OverInput {
        /// Which.
        path: PathBuf,
        /// As it was named for reading.
        input: PathBuf,
    },
    /// A file of that name is there, and nobody said that it may go.
    #[error("{}: exists already; name another folder, or say --overwrite", path.display())]
    Exists {
        /// Which.
        path: PathBuf,
    },
    /// The system.
    #[error("{}: cannot be written: {source}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// What it says.
        source: io::Error,
    },
}

fn same(path: &Path, input: &Path) -> String {
    if path == input {
        "a file".to_owned()
    } else {
        format!("the same file as {}", input.display())
    }
}

/// What becomes of a file that is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Old {
    /// It is replaced.
    Goes,
    /// It stays, and nothing is written.
    Stays,
}

/// A file in the making; without [`Output::finish`] there is none.
#[derive(Debug)]
pub struct Output {
    path: PathBuf,
    old: Old,
    to: To,
}

#[derive(Debug)]
enum To {
    /// Beside the place where it goes.
    Beside(NamedTempFile, PathBuf),
    /// Nothing can be lost there.
    Device(File),
}

/// Writes a file whole or not at all; `inputs` is what the command reads.
pub fn write<P: AsRef<Path>>(
    path: &Path,
    contents: impl AsRef<[u8]>,
    inputs: &[P],
) -> Result<(), OutputError> {
    let mut output = Output::begin(path, inputs, Old::Goes)?;
    output.put(contents.as_ref())?;
    output.finish()
}

/// The same for what only its owner may read, from the first byte on, whatever the old file allowed.
pub fn write_private(path: &Path, contents: impl AsRef<[u8]>) -> Result<(), OutputError> {
    let mut output = Output::begin(path, &[""; 0], Old::Goes)?;
    if let To::Beside(file, _) = &output.to {
        let private = file.as_file().set_permissions(Permissions::from_mode(PRIVATE));
        private.map_err(|source| OutputError::Io { path: path.into(), source })?;
    }
    output.put(contents.as_ref())?;
    output.finish()
}

/// A file that others read while it grows, such as the truth of a flight that lasts: looked at in the same way,
/// written in its place.
pub fn growing<P: AsRef<Path>>(path: &Path, inputs: &[P]) -> Result<File, OutputError> {
    look(path, inputs)?;
    File::create(path).map_err(|source| OutputError::Io { path: path.into(), source })
}

impl Output {
    /// Looks whether it may be written, and begins.
    pub fn begin<P: AsRef<Path>>(path: &Path, inputs: &[P], old: Old) -> Result<Self, OutputError> {
        let io = |source| OutputError::Io { path: path.into(), source };
        let there = look(path, inputs)?;
        if there.is_some() && old == Old::Stays {
            return Err(OutputError::Exists { path: path.into() });
        }
        if there.as_ref().is_some_and(|there| !there.is_file()) {
            let device = device(path).map_err(io)?;
            return Ok(Self { path: path.into(), old, to: To::Device(device) });
        }
        let mode = match &there {
            Some(there) => {
                // Who may not write a file may not replace it.
                OpenOptions::new().append(true).open(path).map_err(io)?;
                there.permissions()
            }
            None => Permissions::from_mode(MODE),
        };
        let place = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        // A name of its own: two programs may write the same file at the same time.
        let beside = tempfile::Builder::new()
            .prefix(PREFIX)
            .suffix(SUFFIX)
            .permissions(mode.clone())
            .tempfile_in(folder_of(&place))
            // Without its own words, which name the file beside.
            .map_err(|e| io(without_path(e)))?;
        if there.is_some() {
            beside.as_file().set_permissions(mode).map_err(io)?;
        }
        Ok(Self { path: path.into(), old, to: To::Beside(beside, place) })
    }

    /// Writes, with the file's name in the error.
    pub fn put(&mut self, bytes: &[u8]) -> Result<(), OutputError> {
        self.write_all(bytes).map_err(|source| OutputError::Io { path: self.path.clone(), source })
    }

    /// Puts it in its place.
    pub fn finish(self) -> Result<(), OutputError> {
        let path = self.path;
        let io = |source| OutputError::Io { path: path.clone(), source };
        let (beside, place) = match self.to {
            To::Device(mut device) => return device.flush().map_err(io),
            To::Beside(beside, place) => (beside, place),
        };
        beside.as_file().sync_all().map_err(io)?;
        match self.old {
            Old::Goes => beside.persist(&place).map_err(|e| io(e.error))?,
            Old::Stays => beside.persist_noclobber(&place).map_err(|e| match e.error.kind() {
                io::ErrorKind::AlreadyExists => OutputError::Exists { path: path.clone() },
                _ => io(e.error),
            })?,
        };
        sync_folder(&place).map_err(io)
    }
}

/// Makes the name permanent; the contents are.
fn sync_folder(place: &Path) -> io::Result<()> {
    match File::open(folder_of(place)).and_then(|folder| folder.sync_all()) {
        // Where files may be made and not listed, or where folders are not synced, as on some network drives.
        Err(error)
            if matches!(
                error.kind(),
                io::ErrorKind::PermissionDenied | io::ErrorKind::InvalidInput
            ) =>
        {
            Ok(())
        }
        ended => ended,
    }
}

fn folder_of(place: &Path) -> &Path {
    place.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Opens what has no contents to lose. A pipe that nobody reads would hold the program for ever.
fn device(path: &Path) -> io::Result<File> {
    let mut open = OpenOptions::new();
    open.write(true);
    let flags = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
    let first = open.clone().custom_flags(flags).open(path).map_err(|error| {
        let nobody = error.raw_os_error() == Some(rustix::io::Errno::NXIO.raw_os_error());
        if nobody { io::Error::new(error.kind(), "a pipe that nobody reads") } else { error }
    })?;
    // While the first is open its reader stays.
    let device = open.open(path);
    drop(first);
    device
}

/// The words of the system, without those of the package, which name the file beside.
fn without_path(error: io::Error) -> io::Error {
    let text = error.to_string();
    let own = text.split(" at path ").next().unwrap_or(&text);
    io::Error::new(error.kind(), own.to_owned())
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.to {
            To::Beside(file, _) => file.write(bytes),
            To::Device(file) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.to {
            To::Beside(file, _) => file.flush(),
            To::Device(file) => file.flush(),
        }
    }
}

/// Removes what was in the making when its writer died; for who alone writes in a folder.
pub fn sweep(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let is_one = |name: &str| name.starts_with(PREFIX) && name.ends_with(SUFFIX);
        if name.to_str().is_some_and(is_one) {
            // One that stays does no harm.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Looks at all files of these names in a folder.
pub fn look_all<P: AsRef<Path>>(
    folder: &Path,
    names: &[&str],
    inputs: &[P],
) -> Result<(), OutputError> {
    names.iter().try_for_each(|name| look(&folder.join(name), inputs).map(|_| ()))
}

/// Looks for who writes a log: an older one may go.
pub fn look_for_log<P: AsRef<Path>>(path: &Path, inputs: &[P]) -> Result<(), OutputError> {
    match look(path, inputs) {
        Ok(_) | Err(OutputError::OverLog { .. }) => Ok(()),
        Err(error) => Err(error),
    }
}

/// What is there, if it may be written over.
pub fn look<P: AsRef<Path>>(path: &Path, inputs: &[P]) -> Result<Option<Metadata>, OutputError> {
    let io = |source| OutputError::Io { path: path.into(), source };
    let there = match std::fs::metadata(path) {
        Ok(there) => there,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(io(error)),
    };
    if there.is_dir() {
        return Err(io(io::Error::from(io::ErrorKind::IsADirectory)));
    }
    if !there.is_file() {
        return Ok(Some(there));
    }
    for input in inputs.iter().map(AsRef::as_ref) {
        let read = std::fs::metadata(input);
        if read.is_ok_and(|read| (read.dev(), read.ino()) == (there.dev(), there.ino())) {
            return Err(OutputError::OverInput { path: path.into(), input: input.into() });
        }
    }
    let mut first = [0; LOG_MAGIC.len()];
    match File::open(path).and_then(|mut file| file.read_exact(&mut first)) {
        Ok(()) if first == LOG_MAGIC => Err(OutputError::OverLog { path: path.into() }),
        // Shorter than any log, or not ours to read: writing tells whether it is ours to write.
        _ => Ok(Some(there)),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::symlink;

    use super::*;

    const NONE: [&str; 0] = [];

    /// `haltere report a.mcap -o PIPE` waited for ever.
    #[test]
    fn regress_a_pipe_that_nobody_reads_is_refused_and_one_that_is_read_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if !made.is_ok_and(|status| status.success()) {
            return;
        }
        let refused = write(&pipe, "page", &NONE).unwrap_err().to_string();
        assert!(
            refused.ends_with("pipe: cannot be written: a pipe that nobody reads"),
            "{refused}"
        );
        // Opened for both: a reader that is there.
        let mut reader = OpenOptions::new().read(true).write(true).open(&pipe).unwrap();
        write(&pipe, "page", &NONE).unwrap();
        let mut page = [0; 4];
        reader.read_exact(&mut page).unwrap();
        assert_eq!(&page, b"page");
    }

    #[test]
    fn regress_a_flight_log_is_never_written_over_through_no_kind_of_link() {
        let folder = tempfile::tempdir().unwrap();
        let here = |name: &str| folder.path().join(name);
        let log = [&LOG_MAGIC[..], b"a flight"].concat();
        fs::write(here("a.mcap"), &log).unwrap();
        fs::hard_link(here("a.mcap"), here("hard.html")).unwrap();
        symlink("a.mcap", here("soft.html")).unwrap();
        symlink("soft.html", here("soft2.html")).unwrap();
        for name in ["a.mcap", "hard.html", "soft.html", "soft2.html"] {
            let refused = write(&here(name), "page", &NONE).unwrap_err().to_string();
            assert!(refused.contains(name) && refused.contains("is a flight log"), "{refused}");
            assert!(matches!(growing(&here(name), &NONE), Err(OutputError::OverLog { .. })));
            assert_eq!(fs::read(here(name)).unwrap(), log);
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 4, "nothing is left behind");
    }

    #[test]
    fn regress_what_is_read_is_never_written_over_through_no_kind_of_link() {
        let folder = tempfile::tempdir().unwrap();
        let here = |name: &str| folder.path().join(name);
        fs::write(here("a.csv"), "data").unwrap();
        fs::hard_link(here("a.csv"), here("hard.html")).unwrap();
        symlink("a.csv", here("soft.html")).unwrap();
        let inputs = [here("missing"), here("a.csv")];
        for name in ["a.csv", "hard.html", "soft.html", "./a.csv"] {
            let refused = write(&here(name), "page", &inputs).unwrap_err().to_string();
            assert!(refused.contains("which this command reads"), "{refused}");
            assert_eq!(fs::read(here(name)).unwrap(), b"data");
        }
        // Through a link to something else the link stays one.
        fs::write(here("old.html"), "old").unwrap();
        symlink("old.html", here("link.html")).unwrap();
        fs::set_permissions(here("old.html"), Permissions::from_mode(0o640)).unwrap();
        write(&here("link.html"), "new", &inputs).unwrap();
        assert_eq!(fs::read(here("old.html")).unwrap(), b"new");
        assert!(here("link.html").is_symlink());
        assert_eq!(fs::metadata(here("old.html")).unwrap().permissions().mode() & 0o777, 0o640);
    }

    #[test]
    fn prop_what_is_not_finished_leaves_the_old_file_and_nothing_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("page.html");
        fs::write(&path, "old").unwrap();
        let mut cut = Output::begin(&path, &NONE, Old::Goes).unwrap();
        cut.put(b"new, but").unwrap();
        drop(cut);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert!(matches!(Output::begin(&path, &NONE, Old::Stays), Err(OutputError::Exists { .. })));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        write(&path, "new", &NONE).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn prop_what_is_private_is_private_whatever_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        let mode = || fs::metadata(&path).unwrap().permissions().mode() & 0o777;
        write_private(&path, "secret").unwrap();
        assert_eq!(mode(), 0o600);
        fs::set_permissions(&path, Permissions::from_mode(0o644)).unwrap();
        write_private(&path, "another").unwrap();
        assert_eq!((mode(), fs::read(&path).unwrap()), (0o600, b"another".to_vec()));
    }

    #[test]
    fn prop_devices_are_written_as_they_are_and_their_refusal_is_told() {
        write(Path::new("/dev/null"), "page", &["/dev/null"]).unwrap();
        if Path::new("/dev/full").exists() {
            let full = write(Path::new("/dev/full"), "page", &NONE).unwrap_err().to_string();
            assert!(full.starts_with("/dev/full: cannot be written: "), "{full}");
        }
        let nowhere = write(Path::new("/no/such/folder/x"), "page", &NONE).unwrap_err().to_string();
        assert_eq!(nowhere.matches("/no/such").count(), 1, "{nowhere}");
    }
}
