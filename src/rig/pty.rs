//! The tag's serial line: a pseudo-terminal that behaves like the USB device it stands for.
//!
//! Nobody has the device open: DTR is not asserted, the tag is silent. The host opens it: a rising
//! edge of DTR. The host stalls: bytes that find no room are dropped, in mid-frame, and counted;
//! we never wait.

use std::fs::OpenOptions;
use std::os::fd::OwnedFd;
use std::os::unix::fs::{OpenOptionsExt, symlink};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// Whether the host has the device open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dtr {
    /// Nobody has it open.
    Low,
    /// Somebody has just opened it.
    Rising,
    /// Somebody has it open.
    High,
}

/// The device's end of the line.
#[derive(Debug)]
pub struct TagPty {
    master: OwnedFd,
    device: PathBuf,
    link: Option<PathBuf>,
    open: bool,
    dropped: u64,
}

impl TagPty {
    /// Makes the line, in raw mode, with a symbolic link to it if wanted.
    pub fn new(link: Option<&Path>) -> Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)
            .context("no pseudo-terminal can be opened; is /dev/pts mounted?")?;
        grantpt(&master).context("pseudo-terminal: grantpt")?;
        unlockpt(&master).context("pseudo-terminal: unlockpt")?;
        let name = ptsname(&master, Vec::new()).context("pseudo-terminal: ptsname")?;
        let device = PathBuf::from(name.into_string().context("pseudo-terminal: its name")?);
        {
            // Opened and closed once: from now on a read tells us whether anybody has it open.
            let slave = OpenOptions::new()
                .read(true)
                .write(true)
                .custom_flags(OFlags::NOCTTY.bits().cast_signed())
                .open(&device)
                .with_context(|| device.display().to_string())?;
            let mut settings = tcgetattr(&slave).context("pseudo-terminal: its settings")?;
            settings.make_raw();
            tcsetattr(&slave, OptionalActions::Now, &settings)
                .context("pseudo-terminal: raw mode")?;
        }
        let flags = fcntl_getfl(&master).context("pseudo-terminal: its flags")?;
        fcntl_setfl(&master, flags | OFlags::NONBLOCK).context("pseudo-terminal: its flags")?;
        if let Some(link) = link {
            // Replaces a link that an earlier run left behind, but never a file.
            match std::fs::symlink_metadata(link) {
                Ok(meta) if meta.file_type().is_symlink() => {
                    std::fs::remove_file(link).with_context(|| link.display().to_string())?;
                }
                Ok(_) => bail!("--tag-link {}: exists and is no link", link.display()),
                Err(_) => {}
            }
            symlink(&device, link).with_context(|| format!("--tag-link {}", link.display()))?;
        }
        Ok(Self { master, device, link: link.map(Path::to_owned), open: false, dropped: 0 })
    }

    /// Path that the host opens.
    pub fn device(&self) -> &Path {
        self.link.as_deref().unwrap_or(&self.device)
    }

    /// Bytes that found no room.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Reads what the host sent, and tells whether it is there.
    pub fn read(&mut self, into: &mut Vec<u8>) -> Dtr {
        let before = self.open;
        let mut buffer = [0; 256];
        loop {
            match rustix::io::read(&self.master, &mut buffer) {
                Ok(n) if n > 0 => {
                    self.open = true;
                    into.extend_from_slice(buffer.get(..n).unwrap_or_default());
                }
                Err(Errno::AGAIN) => {
                    self.open = true;
                    break;
                }
                Err(Errno::INTR) => {}
                // EIO: no one has the other end open.
                Ok(_) | Err(_) => {
                    self.open = false;
                    break;
                }
            }
        }
        match (before, self.open) {
            (_, false) => Dtr::Low,
            (false, true) => Dtr::Rising,
            (true, true) => Dtr::High,
        }
    }

    /// Writes what there is room for, and drops the rest.
    pub fn write(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while self.open && !rest.is_empty() {
            match rustix::io::write(&self.master, rest) {
                Ok(n) => rest = rest.get(n..).unwrap_or_default(),
                Err(Errno::INTR) => {}
                Err(_) => {
                    self.dropped += rest.len() as u64;
                    break;
                }
            }
        }
    }
}

impl Drop for TagPty {
    fn drop(&mut self) {
        if let Some(link) = &self.link
            && std::fs::read_link(link).is_ok_and(|to| to == self.device)
        {
            let _ = std::fs::remove_file(link);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};

    fn open(pty: &TagPty) -> std::fs::File {
        let flags = (OFlags::NOCTTY | OFlags::NONBLOCK).bits().cast_signed();
        OpenOptions::new().read(true).write(true).custom_flags(flags).open(pty.device()).unwrap()
    }

    #[test]
    fn prop_presence_follows_the_host() {
        let mut pty = TagPty::new(None).unwrap();
        let mut got = Vec::new();
        assert_eq!(pty.read(&mut got), Dtr::Low);
        pty.write(b"lost");
        for _ in 0..2 {
            let mut host = open(&pty);
            assert_eq!(pty.read(&mut got), Dtr::Rising);
            assert_eq!(pty.read(&mut got), Dtr::High);
            // No echo, no translation of line ends.
            pty.write(b"\xBC\n\r\x03");
            let mut back = [0; 16];
            assert_eq!(host.read(&mut back).unwrap(), 4);
            assert_eq!(&back[..4], b"\xBC\n\r\x03");
            host.write_all(b"b").unwrap();
            pty.read(&mut got);
            assert_eq!(got, b"b");
            got.clear();
            drop(host);
            assert_eq!(pty.read(&mut got), Dtr::Low);
        }
        assert_eq!(pty.dropped(), 0);
    }

    #[test]
    fn prop_a_host_that_does_not_read_costs_bytes_not_time() {
        let mut pty = TagPty::new(None).unwrap();
        let _host = open(&pty);
        pty.read(&mut Vec::new());
        // Nobody ever reads: a write that waits would not come back.
        for _ in 0..1000 {
            pty.write(&[0x55; 400]);
        }
        assert!(pty.dropped() > 100_000, "{}", pty.dropped());
    }

    #[test]
    fn prop_link_is_made_replaced_and_removed() {
        let dir = tempfile::tempdir().unwrap();
        let link = dir.path().join("tag");
        let first = TagPty::new(Some(&link)).unwrap();
        let second = TagPty::new(Some(&link)).unwrap();
        drop(first);
        assert!(link.exists());
        drop(second);
        assert!(std::fs::symlink_metadata(&link).is_err());
        std::fs::write(&link, "mine").unwrap();
        assert!(TagPty::new(Some(&link)).is_err());
        assert_eq!(std::fs::read(&link).unwrap(), b"mine");
    }
}
