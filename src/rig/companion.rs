//! `haltere fly` as a process.

use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use haltere_log::log_file::has_log_ending;
use rustix::process::Signal;

use super::process::{Process, companion, told};

/// The companion, running.
#[derive(Debug)]
pub struct Companion {
    process: Process,
    output: PathBuf,
}

impl Companion {
    /// Starts it; what it says goes to the file `output`.
    pub fn start(config: &Path, overrides: &[String], output: PathBuf) -> Result<Self> {
        let file = haltere_log::written::growing::<&Path>(&output, &[])?;
        let second = file.try_clone().with_context(|| output.display().to_string())?;
        Self::start_into(config, overrides, output, [file.into(), second.into()])
    }

    /// The same with standard output and standard error of somebody else, who keeps them in the file `output`.
    pub fn start_into(
        config: &Path,
        overrides: &[String],
        output: PathBuf,
        [out, err]: [Stdio; 2],
    ) -> Result<Self> {
        let mut command = companion()?;
        command.args(["fly", "--config"]).arg(config);
        for setting in overrides {
            command.args(["--set", setting]);
        }
        let child = command
            .stdin(Stdio::null())
            .stdout(out)
            .stderr(err)
            .spawn()
            .context("starting the companion")?;
        Ok(Self { process: Process(child), output })
    }

    /// Ends it as a crash would: at once, without a chance to say anything.
    pub fn kill(&mut self) -> Result<()> {
        self.process.0.kill().context("killing the companion")?;
        self.process.0.wait().context("waiting for the companion")?;
        Ok(())
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: Signal) -> Result<()> {
        self.process.signal(signal)
    }

    /// How it ended, if it has within this time.
    pub fn ends_within(&mut self, limit: Duration) -> Result<Option<ExitStatus>> {
        self.process.ends_within(limit)
    }

    /// Asks it to end and waits; its log is closed then.
    pub fn stop(&mut self) -> Result<()> {
        let status = self.process.end()?;
        if !status.success() {
            bail!("the companion ended with {}:\n{}", told(status), self.last_words());
        }
        Ok(())
    }

    /// Whether it still runs.
    pub fn runs(&mut self) -> bool {
        matches!(self.process.0.try_wait(), Ok(None))
    }

    /// The end of what it said.
    pub fn last_words(&self) -> String {
        let said = std::fs::read_to_string(&self.output).unwrap_or_default();
        let lines: Vec<&str> = said.lines().collect();
        lines.get(lines.len().saturating_sub(12)..).unwrap_or_default().join("\n")
    }

    /// Resident memory, bytes.
    pub fn memory_B(&self) -> Result<u64> {
        let (name, text) = self.proc("status")?;
        let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kb = line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok());
        kb.map(|kb| kb * 1024).with_context(|| format!("{name} does not tell VmRSS"))
    }

    /// Processor time used so far, s.
    pub fn cpu_s(&self) -> Result<f64> {
        let (name, text) = self.proc("stat")?;
        // After the name, which may hold anything, in parentheses: user and system time are the
        // 12th and 13th field, in hundredths of a second.
        let fields = text.rsplit_once(')').map_or("", |(_, rest)| rest);
        let ticks: Vec<f64> =
            fields.split_whitespace().skip(11).take(2).filter_map(|f| f.parse().ok()).collect();
        match ticks[..] {
            [user, system] => Ok((user + system) / 100.0),
            _ => bail!("{name} does not tell processor time"),
        }
    }

    /// How often its threads went to sleep so far, all together: unlike seconds a number that does not depend
    /// on what else this computer or its host does.
    pub fn sleeps(&self) -> Result<u64> {
        let folder = format!("/proc/{}/task", self.process.0.id());
        let threads = std::fs::read_dir(&folder).with_context(|| folder.clone())?;
        let of_thread = |status: String| -> Option<u64> {
            let field = status.lines().find_map(|l| l.strip_prefix("voluntary_ctxt_switches:"));
            field?.trim().parse().ok()
        };
        // A thread that ends meanwhile takes its count along.
        let status =
            threads.filter_map(|t| std::fs::read_to_string(t.ok()?.path().join("status")).ok());
        Ok(status.filter_map(of_thread).sum())
    }

    fn proc(&self, file: &str) -> Result<(String, String)> {
        let name = format!("/proc/{}/{file}", self.process.0.id());
        let text = std::fs::read_to_string(&name).with_context(|| name.clone())?;
        Ok((name, text))
    }
}

/// The log of this flight: names are times, so the greatest is the newest.
pub fn newest_log(directory: &Path) -> Result<PathBuf> {
    let entries = std::fs::read_dir(directory)
        .with_context(|| format!("the companion left no log in {}", directory.display()))?;
    entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| has_log_ending(path))
        .max()
        .with_context(|| format!("the companion left no log in {}", directory.display()))
}
