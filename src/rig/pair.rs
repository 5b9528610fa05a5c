//! Endpoint and companion side by side, and the files between them.

use std::fs::{File, TryLockError};
use std::net::TcpListener;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};

use super::firmware::{Firmware, Which};
use super::stop::Stop;
use super::{Companion, Endpoint, Wiring, free_port};
use crate::simulated::scenario::Scenario;

/// Port that docs/WATCH.md names.
const PAGE_PORT: u16 = 8480;

/// What is flown, and where its files go.
#[derive(Debug, Clone)]
pub struct Setup {
    /// Folder for configuration, log and truth.
    pub output: PathBuf,
    /// Scenario file of the endpoint, or the name of a built-in one.
    pub scenario: Option<PathBuf>,
    /// Seed of the endpoint's random numbers.
    pub seed: u64,
    /// Configuration values of the companion, `KEY=VALUE`.
    pub overrides: Vec<String>,
    /// What flies instead of the simulated board.
    pub firmware: Which,
    /// The command that starts it, for the configuration's first line.
    pub by: &'static str,
}

/// Endpoint and companion, running.
#[derive(Debug)]
pub struct Pair {
    endpoint: Endpoint,
    firmware: Option<Firmware>,
    companion: Companion,
    stop: Stop,
    /// Where the ground station listens.
    pub ground: String,
    /// Where the flight can be watched live; empty: nowhere.
    pub page: String,
    /// Truth file of the endpoint.
    pub truth: PathBuf,
    /// Where the companion leaves its log.
    pub log_directory: PathBuf,
    /// Locked, so that nobody else clears it meanwhile.
    _folder: File,
}

impl Pair {
    /// Writes configuration and anchors, starts both.
    pub fn start(setup: &Setup) -> Result<Self> {
        let port = free_page_port()?;
        let mut setup = setup.clone();
        // What the user sets comes later and wins.
        setup.overrides.insert(0, format!("watch.address=tcpin:127.0.0.1:{port}"));
        let mut processes = Self::start_with(&setup, &[])?;
        processes.page = format!("http://127.0.0.1:{port}/");
        Ok(processes)
    }

    /// The same without a page, and with more ground endpoints than the one for our own station.
    pub fn start_with(setup: &Setup, more_endpoints: &[String]) -> Result<Self> {
        let stop = Stop::on_signals()?;
        let folder = std::path::absolute(&setup.output).context("--output")?;
        let own = File::open(&folder).with_context(|| folder.display().to_string())?;
        if matches!(own.try_lock(), Err(TryLockError::WouldBlock)) {
            let folder = folder.display();
            bail!("--output {folder}: another demo works in this folder; name another one");
        }
        let scenario = Scenario::load(setup.scenario.as_deref())?;
        let truth = folder.join("truth.csv");
        let log_directory = folder.join("log");
        // A log of an earlier flight must not be taken for ours.
        if log_directory.exists() {
            std::fs::remove_dir_all(&log_directory)
                .with_context(|| log_directory.display().to_string())?;
        }
        let mut args: Vec<std::ffi::OsString> = vec!["--truth".into(), truth.clone().into()];
        args.extend(["--seed".into(), setup.seed.to_string().into()]);
        let between = setup.firmware.between()?;
        args.extend(between.arguments());
        if let Some(scenario) = &setup.scenario {
            args.extend(["--scenario".into(), scenario.into()]);
        }
        let endpoint = Endpoint::start(args)?;
        let ground_port = free_port()?;
        let endpoints: Vec<String> = std::iter::once(format!("udpout:127.0.0.1:{ground_port}"))
            .chain(more_endpoints.iter().cloned())
            .collect();
        let board = between.address(&endpoint)?;
        let wiring = Wiring {
            tag: endpoint.told("tag")?,
            tag_protocol: endpoint.told("tag_protocol")?,
            board: &board,
            endpoints: &endpoints,
            logs: &log_directory,
        };
        let config = wiring.write(&folder, &scenario, setup.by)?;
        let output = folder.join("companion.txt");
        let companion = Companion::start(&config, &setup.overrides, output)?;
        let firmware = between.start(&folder.join("firmware"))?;
        Ok(Self {
            endpoint,
            firmware,
            companion,
            stop,
            ground: format!("udpin:127.0.0.1:{ground_port}"),
            page: String::new(),
            truth,
            log_directory,
            _folder: own,
        })
    }

    /// Resident memory of the companion, bytes.
    pub fn companion_memory_B(&self) -> Result<u64> {
        self.companion.memory_B()
    }

    /// Whether the user wants it to end.
    pub fn stop_asked(&self) -> bool {
        self.stop.asked()
    }

    /// Asks both to end and waits for it; the companion first, so that its log shows no lost links. Why nothing can be said
    /// of the flight; `None`: the endpoint kept its time.
    pub fn stop(&mut self) -> Result<Option<String>> {
        let companion = self.companion.stop();
        let firmware = self.firmware.as_mut().map_or(Ok(()), Firmware::stop);
        let endpoint = self.endpoint.stop();
        companion.and(firmware).and(endpoint)
    }
}

/// Port of the watch page: the usual one, or any that is free.
fn free_page_port() -> Result<u16> {
    let bound = TcpListener::bind(("127.0.0.1", PAGE_PORT));
    let bound = bound.or_else(|_| TcpListener::bind("127.0.0.1:0")).context("no free TCP port")?;
    Ok(bound.local_addr().context("no free TCP port")?.port())
}
