//! `haltere key`: makes a key for signed MAVLink.

use std::fs::{File, OpenOptions};
use std::io::{Read as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, anyhow};
use clap::Args;
use haltere_dialect::signing::{KEY_BYTES, SigningKey};

/// Where the system keeps chance that is good enough for keys.
const CHANCE: &str = "/dev/urandom";

/// Makes a key that only you can read; it is not printed.
#[derive(Debug, Args)]
pub(super) struct Key {
    /// File to write: 64 hexadecimal digits, mode 600. It must not exist yet.
    file: PathBuf,
}

impl Key {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let name = self.file.display();
        let mut bytes = [0; KEY_BYTES];
        File::open(CHANCE).and_then(|mut file| file.read_exact(&mut bytes)).context(CHANCE)?;
        let key = SigningKey::new(bytes).ok_or_else(|| anyhow!("{CHANCE} gives zeros only"))?;
        let mut file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(&self.file)
            .with_context(|| format!("{name}: not written; a key that exists is not replaced"))?;
        file.write_all(key.to_file().as_bytes()).and_then(|()| file.sync_all())?;
        tracing::info!(
            "{name}: written. Name it in signing.key_file, set ground.signing, and give the stations the \
             same key"
        );
        Ok(ExitCode::SUCCESS)
    }
}
