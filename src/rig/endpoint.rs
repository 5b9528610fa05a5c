//! `haltere-sim serve` as a process.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::process::{ChildStdout, Stdio};

use anyhow::{Context, Result, bail};

use super::process::{Process, simulator, told};

/// Exit code: nothing is known, try again (EX_TEMPFAIL of sysexits.h).
pub const EXIT_NOT_JUDGED: u8 = 75;

/// The endpoint, running.
#[derive(Debug)]
pub struct Endpoint {
    process: Process,
    output: BufReader<ChildStdout>,
    greeting: serde_json::Value,
}

impl Endpoint {
    /// Starts it with these arguments and reads its first line.
    pub fn start<A: AsRef<OsStr>>(args: impl IntoIterator<Item = A>) -> Result<Self> {
        let child = simulator()?
            .arg("serve")
            .args(args)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .context("starting the endpoint")?;
        let mut process = Process(child);
        let output = process.0.stdout.take().context("the endpoint's output")?;
        let mut output = BufReader::new(output);
        let greeting = line(&mut output, "first")?;
        Ok(Self { process, output, greeting })
    }

    /// What it says of itself.
    pub fn told(&self, key: &str) -> Result<&str> {
        let value = self.greeting.get(key).and_then(|v| v.as_str());
        value.with_context(|| format!("the endpoint did not name its {key}"))
    }

    /// Asks it to end and waits. Why nothing that was flown with it says something of the vehicle; `None`: it kept its time.
    pub fn stop(&mut self) -> Result<Option<String>> {
        let status = self.process.end()?;
        if !status.success() && status.code() != Some(i32::from(EXIT_NOT_JUDGED)) {
            bail!("the endpoint ended with {}", told(status));
        }
        let last = line(&mut self.output, "last")?;
        Ok(last["not_judged"].as_str().map(str::to_owned))
    }
}

fn line(output: &mut impl BufRead, which: &str) -> Result<serde_json::Value> {
    let mut line = String::new();
    output.read_line(&mut line).with_context(|| format!("the endpoint's {which} line"))?;
    serde_json::from_str(&line)
        .with_context(|| format!("the endpoint's {which} line is no JSON object: {line:?}"))
}
