//! Names of log files: `YYYYMMDD-HHMMSS-NN.mcap`, UTC, never one that exists.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

/// Logs that may begin in the same second.
const MOST_PER_SECOND: u32 = 100;

const SECONDS_PER_DAY: i64 = 86_400;

/// Creates the next log file in `directory`, and the directory if need be.
pub(super) fn create_log(directory: &Path, unix_us: i64) -> io::Result<(PathBuf, File)> {
    if let Some(why) = in_the_way(directory) {
        return Err(io::Error::new(io::ErrorKind::NotADirectory, why));
    }
    std::fs::create_dir_all(directory)?;
    let stamp = stamp(unix_us.div_euclid(1_000_000));
    for number in 0..MOST_PER_SECOND {
        let path = directory.join(format!("{stamp}-{number:02}.mcap"));
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(file) => {
                // The entry of the directory must survive a power cut like the data.
                File::open(directory)?.sync_all()?;
                return Ok((path, file));
            }
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
    Err(io::Error::new(
        io::ErrorKind::AlreadyExists,
        format!("{MOST_PER_SECOND} logs of {stamp} exist"),
    ))
}

/// What stands where a folder is, or would be made, and is none: the system says "File exists" of a link to a disk that
/// is not there. `None`: nothing.
pub fn in_the_way(folder: &Path) -> Option<String> {
    let whole = std::path::absolute(folder).ok()?;
    let place = whole.ancestors().find(|place| place.symlink_metadata().is_ok())?;
    if place.is_dir() {
        return None;
    }
    let what = match std::fs::read_link(place) {
        Ok(to) if !place.exists() => format!("a link to {}, which is not there", to.display()),
        _ => "a file, no folder".to_owned(),
    };
    Some(if place == whole { what } else { format!("{} is {what}", place.display()) })
}

/// Whether a file's name is one that is made here.
pub(super) fn is_log_name(name: &str) -> bool {
    let Some(name) = name.strip_suffix(".mcap") else { return false };
    let parts: Vec<&str> = name.split('-').collect();
    parts.iter().map(|part| part.len()).eq([8, 6, 2])
        && parts.iter().all(|part| part.bytes().all(|byte| byte.is_ascii_digit()))
}

fn stamp(unix_s: i64) -> String {
    let [year, month, day, hour, minute, second] = calendar(unix_s);
    format!("{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}")
}

/// A time of the wall clock, microseconds since 1970 UTC, as people write it.
pub fn utc_text(unix_us: i64) -> String {
    let [year, month, day, hour, minute, second] = calendar(unix_us.div_euclid(1_000_000));
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

/// Year, month, day, hour, minute, second.
fn calendar(unix_s: i64) -> [i64; 6] {
    let (year, month, day) = civil_from_days(unix_s.div_euclid(SECONDS_PER_DAY));
    let s = unix_s.rem_euclid(SECONDS_PER_DAY);
    [year, month, day, s / 3600, s / 60 % 60, s % 60]
}

/// Proleptic Gregorian date of a day counted from 1970-01-01. The year is taken to begin in March,
/// so that the leap day is its last; 719468 days lie between 0000-03-01 and 1970-01-01, and 146097
/// days make 400 years.
fn civil_from_days(days: i64) -> (i64, i64, i64) {
    let days = days + 719_468;
    let era = days.div_euclid(146_097);
    let day_of_era = days.rem_euclid(146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    (era * 400 + year_of_era + i64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_stamps_agree_with_the_calendar() {
        // `date -u -d @SECONDS +%Y%m%d-%H%M%S`
        assert_eq!(stamp(0), "19700101-000000");
        assert_eq!(stamp(951_782_399), "20000228-235959");
        assert_eq!(stamp(951_782_400), "20000229-000000");
        assert_eq!(stamp(1_795_269_763), "20261121-140243");
        assert_eq!(stamp(-1), "19691231-235959");
    }

    #[test]
    fn prop_a_name_is_ours_or_not() {
        assert!(is_log_name("20261121-140243-00.mcap"));
        for other in ["bench.mcap", "20261121-140243-00-trimmed.mcap", "20261121-140243.mcap", "a"]
        {
            assert!(!is_log_name(other), "{other}");
        }
    }

    #[test]
    fn regress_a_folder_that_cannot_be_is_named_with_what_is_there_instead() {
        let directory = tempfile::tempdir().unwrap();
        let here = |name: &str| directory.path().join(name);
        std::fs::write(here("notes"), "text").unwrap();
        std::os::unix::fs::symlink("/mnt/not-there/logs", here("gone")).unwrap();
        std::os::unix::fs::symlink(here("notes"), here("note-link")).unwrap();
        let said = |name: &str| create_log(&here(name), 0).unwrap_err().to_string();
        let gone = "a link to /mnt/not-there/logs, which is not there";
        assert_eq!(said("gone"), gone);
        assert_eq!(said("gone/deeper"), format!("{} is {gone}", here("gone").display()));
        for file in ["notes", "note-link"] {
            assert_eq!(said(file), "a file, no folder");
        }
        std::os::unix::fs::symlink(directory.path(), here("good")).unwrap();
        create_log(&here("good/new"), 0).unwrap();
    }

    #[test]
    fn prop_no_log_is_overwritten() {
        let directory = tempfile::tempdir().unwrap();
        let nested = directory.path().join("flights");
        let (first, _) = create_log(&nested, 0).unwrap();
        let (second, _) = create_log(&nested, 0).unwrap();
        assert_eq!(first.file_name().unwrap(), "19700101-000000-00.mcap");
        assert_eq!(second.file_name().unwrap(), "19700101-000000-01.mcap");
    }
}
