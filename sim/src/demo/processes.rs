//! The two processes of the demo, and the files between them.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::net::UdpSocket;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use haltere::model::Vehicle;
use rustix::process::{Pid, Signal, kill_process};

use super::Options;
use crate::scenario::Scenario;
use crate::stop::Stop;

/// Time to close a log after a signal.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(10);

/// Endpoint and companion, running.
#[derive(Debug)]
pub struct Processes {
    endpoint: Child,
    companion: Child,
    stop: Stop,
    /// Where the ground station listens.
    pub ground: String,
    /// Truth file of the endpoint.
    pub truth: PathBuf,
    /// Where the companion leaves its log.
    pub log_directory: PathBuf,
    companion_output: PathBuf,
}

impl Processes {
    /// Writes configuration and anchors, starts both.
    pub fn start(options: &Options) -> Result<Self> {
        Self::start_with(options, &[])
    }

    /// The same with more ground endpoints than the one for our own station.
    pub fn start_with(options: &Options, more_endpoints: &[String]) -> Result<Self> {
        let stop = Stop::on_signals()?;
        let folder = std::path::absolute(&options.output).context("--output")?;
        let program = std::env::current_exe().context("this program's own path")?;
        let scenario = Scenario::load(options.scenario.as_deref())?;
        let truth = folder.join("truth.csv");
        let log_directory = folder.join("log");
        // A log of an earlier demo must not be taken for ours.
        if log_directory.exists() {
            std::fs::remove_dir_all(&log_directory)
                .with_context(|| log_directory.display().to_string())?;
        }
        let mut command = Command::new(&program);
        command.arg("serve").arg("--truth").arg(&truth);
        command.args(["--seed", &options.seed.to_string()]);
        command.args(["--board", &format!("udpout:127.0.0.1:{}", free_port()?)]);
        if let Some(scenario) = &options.scenario {
            command.arg("--scenario").arg(scenario);
        }
        let mut endpoint = Guard(
            command
                .stdin(Stdio::null())
                .stdout(Stdio::piped())
                .spawn()
                .context("starting the endpoint")?,
        );
        let greeting = greeting(&mut endpoint.0)?;
        let told = |key: &str| {
            let value = greeting.get(key).and_then(|v| v.as_str());
            value.with_context(|| format!("the endpoint did not name its {key}"))
        };
        let ground_port = free_port()?;
        let gear_m = Vehicle::default().body.gear_m;
        let endpoints: Vec<String> = std::iter::once(format!("udpout:127.0.0.1:{ground_port}"))
            .chain(more_endpoints.iter().cloned())
            .collect();
        let mut config = String::new();
        let _ = write!(
            config,
            "# Written by `haltere-sim demo`.\n\
             [tag]\nport = \"{}\"\nprotocol = \"{}\"\n\n\
             [board]\naddress = \"{}\"\nnorth_offset_deg = {:?}\n\n\
             [ground]\nendpoints = {endpoints:?}\n\n\
             [anchors]\nfile = \"anchors.toml\"\n\n\
             # The vehicle stands on the floor at the height of its gear: near the floor ranging\n\
             # alone tells height badly.\n\
             [flight]\ngear_height_m = {gear_m:?}\n\n\
             [estimator]\nrest_height_m = {gear_m:?}\n\n\
             [record]\ndirectory = \"{}\"\n\n\
             # Nothing of a demo before this one.\n\
             [store]\ndirectory = \"\"\n",
            told("tag")?,
            told("tag_protocol")?,
            told("board")?,
            scenario.board.north_offset_deg.unwrap_or(0.0),
            log_directory.display(),
        );
        let config_file = folder.join("haltere.toml");
        write_file(&config_file, &config)?;
        write_file(&folder.join("anchors.toml"), &scenario.anchors_toml())?;
        let companion_output = folder.join("companion.txt");
        let output = File::create(&companion_output)
            .with_context(|| companion_output.display().to_string())?;
        let mut command = Command::new(&program);
        command.args(["companion", "fly", "--config"]).arg(&config_file);
        for setting in &options.overrides {
            command.args(["--set", setting]);
        }
        let companion = command
            .stdin(Stdio::null())
            .stdout(output.try_clone().context("companion.txt")?)
            .stderr(output)
            .spawn()
            .context("starting the companion")?;
        Ok(Self {
            endpoint: endpoint.release()?,
            companion,
            stop,
            ground: format!("udpin:127.0.0.1:{ground_port}"),
            truth,
            log_directory,
            companion_output,
        })
    }

    /// Resident memory of the companion, bytes.
    pub fn companion_memory_B(&self) -> Result<u64> {
        let name = format!("/proc/{}/status", self.companion.id());
        let text = std::fs::read_to_string(&name).with_context(|| name.clone())?;
        let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kb = line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok());
        kb.map(|kb| kb * 1024).with_context(|| format!("{name} does not tell VmRSS"))
    }

    /// Whether the user wants the demo to end.
    pub fn stop_asked(&self) -> bool {
        self.stop.asked()
    }

    /// Asks both to end and waits for it; the companion first, so that its log shows no lost links.
    pub fn stop(&mut self) -> Result<()> {
        let companion = end(&mut self.companion);
        let endpoint = end(&mut self.endpoint);
        let companion = companion?;
        if !companion.success() {
            let said = std::fs::read_to_string(&self.companion_output).unwrap_or_default();
            let tail: Vec<&str> = said.lines().rev().take(12).collect();
            let tail: Vec<&str> = tail.into_iter().rev().collect();
            bail!("the companion ended with {}:\n{}", told(companion), tail.join("\n"));
        }
        let endpoint = endpoint?;
        if !endpoint.success() {
            bail!("the endpoint ended with {}", told(endpoint));
        }
        Ok(())
    }
}

impl Drop for Processes {
    fn drop(&mut self) {
        for child in [&mut self.companion, &mut self.endpoint] {
            if matches!(child.try_wait(), Ok(None)) {
                let _ = child.kill();
                let _ = child.wait();
            }
        }
    }
}

/// Kills a child that nobody took over.
struct Guard(Child);

impl Guard {
    fn release(mut self) -> Result<Child> {
        // A child that is gone leaves a harmless stand-in behind.
        let stand_in = Command::new("true").spawn().context("starting `true`")?;
        Ok(std::mem::replace(&mut self.0, stand_in))
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn told(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit code {code}"),
        (None, Some(signal)) => format!("signal {signal}"),
        (None, None) => "no code".into(),
    }
}

/// SIGTERM, then patience.
fn end(child: &mut Child) -> Result<ExitStatus> {
    if let Some(status) = child.try_wait().context("waiting for a process")? {
        return Ok(status);
    }
    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    if let Some(pid) = pid {
        kill_process(pid, Signal::TERM).context("ending a process")?;
    }
    let deadline = Instant::now() + CLOSE_TIMEOUT;
    while Instant::now() < deadline {
        if let Some(status) = child.try_wait().context("waiting for a process")? {
            return Ok(status);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let _ = child.kill();
    child.wait().context("waiting for a process")
}

/// The endpoint's first line.
fn greeting(endpoint: &mut Child) -> Result<serde_json::Value> {
    let output = endpoint.stdout.take().context("the endpoint's output")?;
    let mut line = String::new();
    BufReader::new(output).read_line(&mut line).context("the endpoint's first line")?;
    serde_json::from_str(&line)
        .with_context(|| format!("the endpoint's first line is no JSON object: {line:?}"))
}

/// A port that was free a moment ago.
pub fn free_port() -> Result<u16> {
    let socket = UdpSocket::bind("127.0.0.1:0").context("no free UDP port")?;
    Ok(socket.local_addr().context("no free UDP port")?.port())
}

fn write_file(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).with_context(|| path.display().to_string())
}
