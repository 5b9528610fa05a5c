//! `haltere-sim serve` as a process.

use std::ffi::OsStr;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result, bail};

use super::process::{Process, told};

/// The endpoint, running.
#[derive(Debug)]
pub struct Endpoint {
    process: Process,
    greeting: serde_json::Value,
}

impl Endpoint {
    /// Starts it with these arguments and reads its first line.
    pub fn start<A: AsRef<OsStr>>(args: impl IntoIterator<Item = A>) -> Result<Self> {
        let program = std::env::current_exe().context("this program's own path")?;
        let child = Command::new(&program)
            .arg("serve")
            .args(args)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .context("starting the endpoint")?;
        let mut process = Process(child);
        let greeting = greeting(&mut process.0)?;
        Ok(Self { process, greeting })
    }

    /// What it says of itself.
    pub fn told(&self, key: &str) -> Result<&str> {
        let value = self.greeting.get(key).and_then(|v| v.as_str());
        value.with_context(|| format!("the endpoint did not name its {key}"))
    }

    /// Asks it to end and waits.
    pub fn stop(&mut self) -> Result<()> {
        let status = self.process.end()?;
        if !status.success() {
            bail!("the endpoint ended with {}", told(status));
        }
        Ok(())
    }
}

fn greeting(endpoint: &mut Child) -> Result<serde_json::Value> {
    let output = endpoint.stdout.take().context("the endpoint's output")?;
    let mut line = String::new();
    BufReader::new(output).read_line(&mut line).context("the endpoint's first line")?;
    serde_json::from_str(&line)
        .with_context(|| format!("the endpoint's first line is no JSON object: {line:?}"))
}
