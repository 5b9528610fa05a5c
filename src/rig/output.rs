//! A pipe that a program prints into, and what becomes of it: read, read no more, or closed.

use std::fs::{File, OpenOptions};
use std::io::{Read as _, Write as _};
use std::os::fd::{AsRawFd as _, OwnedFd};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::process::Stdio;

use anyhow::{Context, Result};
use rustix::fs::OFlags;
use rustix::pipe::{PipeFlags, fcntl_setpipe_size, pipe_with};

/// Bytes that fit into the pipe: the least that Linux grants.
const PIPE_BYTES: usize = 4096;

/// The end where a program's output is read.
#[derive(Debug)]
pub struct Output {
    /// `None`: closed.
    read: Option<OwnedFd>,
    /// Our own copy of the end that the program has.
    write: Option<OwnedFd>,
    file: File,
}

impl Output {
    /// A pipe; what is read from it goes to this file.
    pub fn new(path: &Path) -> Result<Self> {
        let file = haltere_log::written::growing::<&Path>(path, &[])?;
        // Programs that others start meanwhile must not hold its ends.
        let (read, write) = pipe_with(PipeFlags::CLOEXEC).context("no pipe")?;
        fcntl_setpipe_size(&write, PIPE_BYTES).context("the size of a pipe")?;
        rustix::io::ioctl_fionbio(&read, true).context("a pipe that does not wait")?;
        Ok(Self { read: Some(read), write: Some(write), file })
    }

    /// For a program's streams.
    pub fn stream(&self) -> Result<Stdio> {
        let write = self.write.as_ref().context("the program has its streams already")?;
        Ok(write.try_clone().context("a pipe's second handle")?.into())
    }

    /// The program has its streams: the pipe is to end with it.
    pub fn handed_over(&mut self) {
        self.write = None;
    }

    /// Reads what there is.
    pub fn drain(&mut self) -> Result<()> {
        let Some(read) = &self.read else { return Ok(()) };
        let mut buffer = [0; PIPE_BYTES];
        let mut pipe = File::from(read.try_clone().context("a pipe's second handle")?);
        while let Ok(length @ 1..) = pipe.read(&mut buffer) {
            self.file.write_all(buffer.get(..length).unwrap_or_default()).context("output")?;
        }
        Ok(())
    }

    /// Nobody reads any more, and nothing fits in: whoever writes now waits for ever.
    pub fn block(&mut self) -> Result<()> {
        let read = self.read.as_ref().context("a closed pipe cannot be full")?;
        // A description of its own, or the program's end would not wait either.
        let name = format!("/proc/self/fd/{}", read.as_raw_fd());
        let flags = i32::try_from(OFlags::NONBLOCK.bits()).context("flags of a file")?;
        let mut end = OpenOptions::new()
            .write(true)
            .custom_flags(flags)
            .open(&name)
            .with_context(|| name.clone())?;
        while end.write(b"\n").is_ok() {}
        Ok(())
    }

    /// The reader is gone: whoever writes now gets an error.
    pub fn close(&mut self) {
        self.read = None;
    }
}
