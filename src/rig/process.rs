//! Children that are waited for, and never left behind.

use std::net::UdpSocket;
use std::os::unix::process::ExitStatusExt as _;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use rustix::process::{Pid, Signal, kill_process};

/// Time to land and to close a log after a signal.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(40);

/// Name of the program that is the endpoint; it holds a companion as well.
const SIMULATOR: &str = "haltere-sim";
/// Name of the program that vehicles fly.
const COMPANION: &str = "haltere";

/// The endpoint: this program, or the one that stands beside it.
pub fn simulator() -> Result<Command> {
    Ok(Command::new(own_simulator()?.map_or_else(|| beside(SIMULATOR), Ok)?))
}

/// The companion: what vehicles fly, which stands beside this program. A simulator, which is often built alone, takes
/// the one that it holds.
pub fn companion() -> Result<Command> {
    let Some(own) = own_simulator()? else { return Ok(Command::new(beside(COMPANION)?)) };
    let mut command = Command::new(own);
    command.arg("companion");
    Ok(command)
}

/// This program, if it is the simulator.
fn own_simulator() -> Result<Option<PathBuf>> {
    let own = std::env::current_exe().context("this program's own path")?;
    Ok(own.file_stem().is_some_and(|stem| stem == SIMULATOR).then_some(own))
}

/// A program that stands beside this one.
fn beside(name: &str) -> Result<PathBuf> {
    let beside = std::env::current_exe().context("this program's own path")?.with_file_name(name);
    if !beside.is_file() {
        bail!(
            "{}: is not there, and it is what flies; `cargo build --release --workspace` makes it",
            beside.display()
        );
    }
    Ok(beside)
}

/// A child that dies with us.
#[derive(Debug)]
pub struct Process(pub Child);

impl Process {
    /// SIGTERM, then patience.
    pub fn end(&mut self) -> Result<ExitStatus> {
        if let Some(status) = self.ends_within(Duration::ZERO)? {
            return Ok(status);
        }
        self.signal(Signal::TERM)?;
        if let Some(status) = self.ends_within(CLOSE_TIMEOUT)? {
            return Ok(status);
        }
        let _ = self.0.kill();
        self.0.wait().context("waiting for a process")
    }

    /// Sends a signal.
    pub fn signal(&self, signal: Signal) -> Result<()> {
        let pid = i32::try_from(self.0.id()).ok().and_then(Pid::from_raw);
        let pid = pid.context("the number of a process")?;
        kill_process(pid, signal).with_context(|| format!("sending {signal:?}"))
    }

    /// How it ended, if it has within this time.
    pub fn ends_within(&mut self, limit: Duration) -> Result<Option<ExitStatus>> {
        let deadline = Instant::now() + limit;
        loop {
            let status = self.0.try_wait().context("waiting for a process")?;
            if status.is_some() || Instant::now() >= deadline {
                return Ok(status);
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if matches!(self.0.try_wait(), Ok(None)) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }
}

/// How a process ended, in words.
pub fn told(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit code {code}"),
        (None, Some(signal)) => format!("signal {signal}"),
        (None, None) => "no code".into(),
    }
}

/// A port that was free a moment ago.
pub fn free_port() -> Result<u16> {
    let socket = UdpSocket::bind("127.0.0.1:0").context("no free UDP port")?;
    Ok(socket.local_addr().context("no free UDP port")?.port())
}

/// The monotonic clock, which the companion's times are of, µs.
pub fn now_us() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000
        + u64::try_from(now.tv_nsec).unwrap_or(0) / 1000
}
