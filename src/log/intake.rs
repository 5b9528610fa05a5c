//! Files that people name, opened: what is no file is refused, and what has no end is not read until memory ends.
//!
//! A pipe whose other end nobody opens holds a program for ever, a device such as `/dev/zero` fills it: neither is what
//! somebody means by a configuration, a survey or a log. Where a text may come through a pipe, the command says so
//! (`haltere init --anchors -`).

use std::fs::File;
use std::io::{self, Read as _};
use std::os::unix::fs::FileTypeExt as _;
use std::path::Path;

/// What some programs write before the first letter of a text.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// Opens a file. The error does not name it: who has asked does.
pub fn open(path: &Path) -> io::Result<File> {
    // Before it is opened: opening a pipe waits for its other end.
    let kind = std::fs::metadata(path)?.file_type();
    let what = match () {
        () if kind.is_file() => return File::open(path),
        () if kind.is_dir() => "a folder",
        () if kind.is_fifo() => "a pipe",
        () if kind.is_socket() => "a socket",
        () => "a device",
    };
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{what}, a file is due")))
}

/// All of a file, of `most` bytes at most.
pub fn bytes(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let file = open(path)?;
    let length = file.metadata()?.len();
    let mut bytes = Vec::new();
    // A file of the kernel may have no length, and one that grows has another.
    file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        let what = format!("{} bytes, at most {most} are read", length.max(most.saturating_add(1)));
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, what));
    }
    Ok(bytes)
}

/// The text of a file, of `most` bytes at most, without a byte order mark.
pub fn text(path: &Path, most: u64) -> io::Result<String> {
    let text = String::from_utf8(bytes(path, most)?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        io::Error::new(io::ErrorKind::InvalidData, format!("no text: byte {at} is no UTF-8"))
    })?;
    match text.strip_prefix(BYTE_ORDER_MARK) {
        Some(rest) => Ok(rest.to_owned()),
        None => Ok(text),
    }
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    #[test]
    fn regress_what_is_no_file_is_refused_and_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = Command::new("mkfifo").arg(&pipe).status();
        for (path, says) in [
            (Path::new("/dev/zero"), "a device, a file is due"),
            (folder.path(), "a folder, a file is due"),
            (pipe.as_path(), "a pipe, a file is due"),
        ] {
            if path == pipe && !made.as_ref().is_ok_and(|status| status.success()) {
                continue;
            }
            assert_eq!(text(path, 100).unwrap_err().to_string(), says);
            std::os::unix::fs::symlink(path, folder.path().join("link")).unwrap();
            assert_eq!(bytes(&folder.path().join("link"), 100).unwrap_err().to_string(), says);
            std::fs::remove_file(folder.path().join("link")).unwrap();
        }
    }

    #[test]
    fn prop_texts_are_read_whole_or_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("text");
        std::fs::write(&path, "\u{feff}a = 1\n").unwrap();
        assert_eq!(text(&path, 9).unwrap(), "a = 1\n");
        assert!(text(&path, 8).unwrap_err().to_string().contains("at most 8 are read"));
        std::fs::write(&path, b"ab\xff").unwrap();
        assert!(text(&path, 9).unwrap_err().to_string().contains("byte 2 is no UTF-8"));
    }
}
