//! Whether logs and settings can be written, and for how long.

use std::path::{Path, PathBuf};

use super::Finding;
use haltere_log::record::in_the_way;
use haltere_pilot::settings::Config;

/// What a flight writes, bytes/s: the demo's log, 27.3 MB in 81 s, with one station.
const LOG_BYTES_PER_S: f64 = 340_000.0;
/// Less than one battery of flight, s, and less than an afternoon of them.
const LEAST_S: f64 = 600.0;
const LITTLE_S: f64 = 7200.0;

/// Logs and settings.
pub fn examine(config: &Config) -> Vec<Finding> {
    let mut findings = Vec::new();
    if config.record.enabled {
        let directory = &config.record.directory;
        findings.push(writable("record.directory", directory));
        findings.extend(space("record.directory", directory));
    } else {
        findings.push(Finding::warning(
            "record.enabled",
            "false: this flight leaves no log",
            "set record.enabled = true: without a log nobody can say what happened",
        ));
    }
    if config.store.is_on() {
        findings.push(writable("store.directory", &config.store.directory));
    } else {
        findings.push(Finding::warning(
            "store.directory",
            "empty: parameters and missions are forgotten at a restart",
            "name a folder in store.directory",
        ));
    }
    findings
}

/// The folder itself, or the nearest above it that exists: it is made in flight.
fn existing(directory: &Path) -> PathBuf {
    let whole = std::path::absolute(directory).unwrap_or_else(|_| directory.to_owned());
    whole.ancestors().find(|p| p.exists()).map_or_else(|| PathBuf::from("/"), Path::to_owned)
}

fn writable(key: &str, directory: &Path) -> Finding {
    let place = existing(directory);
    let name = directory.display();
    if let Some(why) = in_the_way(directory) {
        let way_out = format!("name a folder in {key}, or bring back the disk that it lies on");
        return Finding::problem(key, format!("{name}: {why}"), way_out);
    }
    let trial = place.join(format!(".haltere-check-{}", std::process::id()));
    let written = std::fs::write(&trial, b"x").and_then(|()| std::fs::remove_file(&trial));
    match written {
        Ok(()) if directory.exists() => Finding::ok(key, format!("{name}: can be written")),
        Ok(()) => Finding::ok(key, format!("{name}: will be made in {}", place.display())),
        Err(error) => Finding::problem(
            key,
            format!("{name}: cannot be written: {error}"),
            format!(
                "name a folder that you may write in {key}, or `sudo chown $USER {}`",
                place.display()
            ),
        ),
    }
}

fn space(key: &str, directory: &Path) -> Option<Finding> {
    let found = rustix::fs::statvfs(existing(directory)).ok()?;
    let free_bytes = found.f_bavail as f64 * found.f_frsize as f64;
    let left_s = free_bytes / LOG_BYTES_PER_S;
    let text =
        format!("{:.1} GB free, room for {:.1} h of flight", free_bytes * 1e-9, left_s / 3600.0);
    let way_out = "remove old logs (`haltere log list` shows them), or name another disk";
    Some(if left_s < LEAST_S {
        Finding::problem(key, text, way_out)
    } else if left_s < LITTLE_S {
        Finding::warning(key, text, way_out)
    } else {
        Finding::ok(key, text)
    })
}
