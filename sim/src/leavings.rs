//! What a command leaves on the disk: said before, and offered to be removed after.

use std::io::{BufRead as _, IsTerminal as _};
use std::path::{Path, PathBuf};

/// A log of a diagnostic flight in lockstep, bytes: 44 of them left 0.58 GB …
pub const LOG_B: f64 = 13.2e6;
/// … and with its decoded records: 16 left 0.62 GB.
pub const DECODED_LOG_B: f64 = 39e6;

/// Says how much so many flights will leave in a folder.
pub fn say_before(flights: usize, log_bytes: f64, folder: &Path) {
    let leave = if flights == 1 { "flight leaves" } else { "flights leave" };
    eprintln!(
        "{flights} {leave} about {} in {}, by two minutes each",
        size(flights as f64 * log_bytes),
        folder.display()
    );
}

/// Says what was left; on a terminal it is removed for who wants that.
pub fn offer(logs: &[PathBuf], folder: &Path, keeps: &str) {
    let (count, size, shown) = (logs.len(), size_of(logs), folder.display());
    if std::io::stdin().is_terminal() && std::io::stderr().is_terminal() {
        eprint!("remove the {count} logs in {shown}, {size}? {keeps} [no]: ");
        let mut told = String::new();
        let _ = std::io::stdin().lock().read_line(&mut told);
        if matches!(told.trim(), "y" | "yes") {
            let gone = logs.iter().filter(|log| std::fs::remove_file(log).is_ok()).count();
            eprintln!("{gone} of {count} logs removed");
            return;
        }
    }
    tell(logs, folder);
}

/// Says what was left, and how it goes.
pub fn tell(logs: &[PathBuf], folder: &Path) {
    let (count, size, shown) = (logs.len(), size_of(logs), folder.display());
    eprintln!("left: {size} in {count} logs; when you need them no more: rm {shown}/*.mcap");
}

fn size_of(logs: &[PathBuf]) -> String {
    let bytes: u64 = logs.iter().filter_map(|log| Some(log.metadata().ok()?.len())).sum();
    size(bytes as f64)
}

fn size(bytes: f64) -> String {
    if bytes < 1e8 { format!("{:.0} MB", bytes * 1e-6) } else { format!("{:.2} GB", bytes * 1e-9) }
}

#[cfg(test)]
mod tests {
    #[test]
    fn prop_sizes_are_told_as_people_count_them() {
        assert_eq!(super::size(44.0 * super::LOG_B), "0.58 GB");
        assert_eq!(super::size(13.2e6), "13 MB");
    }
}
