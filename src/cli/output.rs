//! What a command writes: its result, whole or not at all, and why it failed.

use std::io::{self, Write as _};

use serde::Serialize;

/// Something failed; the sentence is on standard error.
pub const FAILED: u8 = 1;

/// A result that did not arrive.
#[derive(Debug, thiserror::Error)]
#[error("the result cannot be written to standard output")]
pub struct Unwritten(#[source] pub io::Error);

/// An error with its causes, each said once: many errors name their cause in their own words.
pub fn sentence(error: &anyhow::Error) -> String {
    error.chain().fold(String::new(), |said, cause| {
        let text = cause.to_string();
        match () {
            () if said.is_empty() || text.starts_with(&said) => text,
            () if said.contains(&text) => said,
            () => said + ": " + &text,
        }
    })
}

/// Says why a command failed: a sentence for people; each layer has named what it knows. Of a reader that went away, as
/// `head` does when it has enough, nothing is said: who reads knows, and a script has the exit code.
pub fn tell(program: &str, error: &anyhow::Error) {
    let kind_of =
        |cause: &(dyn std::error::Error + 'static)| Some(cause.downcast_ref::<io::Error>()?.kind());
    let reader_is_gone =
        error.chain().filter_map(kind_of).any(|kind| kind == io::ErrorKind::BrokenPipe);
    if !(reader_is_gone && is_unwritten(error)) {
        let _ = writeln!(std::io::stderr(), "{program}: {}", sentence(error));
    }
}

/// Whether an error is of this kind.
pub fn is_unwritten(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        let inside = cause.downcast_ref::<io::Error>().and_then(io::Error::get_ref);
        cause.is::<Unwritten>() || inside.is_some_and(|inside| inside.is::<Unwritten>())
    })
}

/// Standard output for what is written piece by piece; its errors are [`Unwritten`].
#[derive(Debug)]
pub struct Out(io::StdoutLock<'static>);

impl Out {
    /// Taken until it is dropped.
    pub fn lock() -> Self {
        Self(io::stdout().lock())
    }
}

impl io::Write for Out {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes).map_err(|e| io::Error::new(e.kind(), Unwritten(e)))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush().map_err(|e| io::Error::new(e.kind(), Unwritten(e)))
    }
}

/// Prints to standard output. Who reads a result has it whole, or the command fails: a disk that is full, and a reader
/// that went away, look alike to the script that goes on.
pub fn print(text: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    Ok(out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(Unwritten)?)
}

/// Prints as JSON.
pub fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    print(&(serde_json::to_string_pretty(value)? + "\n"))
}

/// Lowers the priority of this process.
pub fn be_nice(nice: Option<i32>) {
    if let Some(nice) = nice
        && let Err(error) = rustix::process::nice(nice)
    {
        tracing::warn!("--nice {nice}: {error}");
    }
}
