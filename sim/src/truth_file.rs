//! Writes truth to its own file, on its own thread: a slow disk must not slow the simulated world.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;

use anyhow::{Context, Result};
use haltere::report::truth::{HEADER, TruthRow};
use haltere_log::written;

/// Rows that may wait: 20 s at 100 Hz.
const WAITING_ROWS: usize = 2000;

/// A file in the making.
#[derive(Debug)]
pub struct TruthFile {
    path: PathBuf,
    rows: SyncSender<TruthRow>,
    writer: JoinHandle<std::io::Result<()>>,
    lost: u64,
}

impl TruthFile {
    /// Makes the file, over none of what is read, and writes its header.
    pub fn create(path: &Path, inputs: &[&Path]) -> Result<Self> {
        let file = written::growing(path, inputs).context("--truth")?;
        let mut out = BufWriter::new(file);
        let (rows, from) = sync_channel::<TruthRow>(WAITING_ROWS);
        let writer = std::thread::Builder::new()
            .name("truth".into())
            .spawn(move || {
                writeln!(out, "{HEADER}")?;
                for row in from {
                    row.write(&mut out)?;
                }
                out.flush()
            })
            .context("no thread for the truth file")?;
        Ok(Self { path: path.to_owned(), rows, writer, lost: 0 })
    }

    /// Takes a row, or drops it when the disk is far behind.
    pub fn push(&mut self, row: TruthRow) {
        if self.rows.try_send(row).is_err() {
            self.lost += 1;
        }
    }

    /// Writes what waits; gives the number of rows that were dropped.
    pub fn finish(self) -> Result<u64> {
        drop(self.rows);
        let written = self.writer.join().map_err(|_| anyhow::anyhow!("the writer died"))?;
        written.with_context(|| format!("--truth {}", self.path.display()))?;
        Ok(self.lost)
    }
}
