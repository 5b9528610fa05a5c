//! How much room a disk must have for what is recorded: a reserve is kept for flights while nobody flies, and a flight
//! leaves what the system needs to live.

use std::path::Path;

use haltere_pilot::Recording;

/// A flight is recorded until no more is free than this …
const FLIGHT_LEAVES_B: u64 = 200_000_000;
/// … or than this part of the disk, if that is less.
const FLIGHT_LEAVES_PART: u64 = 20;
/// On the floor at most this part of a disk is kept for flights.
const RESERVE_PART: u64 = 10;
/// What has stopped goes on when so much more is free than what stopped it, in parts of that: otherwise each megabyte
/// that comes and goes would be told.
const AGAIN_PART: u64 = 4;

/// Of a disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Room {
    /// What we may still write, bytes.
    pub free_B: u64,
    /// All of it, bytes.
    pub size_B: u64,
}

impl Room {
    /// Of the disk that a folder lies on, or the nearest folder above that exists; `None`: the system does not say.
    pub fn of(folder: &Path) -> Option<Self> {
        let folder = std::path::absolute(folder).ok()?;
        let found = folder.ancestors().find_map(|place| rustix::fs::statvfs(place).ok())?;
        let bytes = |blocks: u64| blocks.saturating_mul(found.f_frsize);
        Some(Self { free_B: bytes(found.f_bavail), size_B: bytes(found.f_blocks) })
    }
}

/// What is kept free.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Limits {
    /// For flights, while nobody flies, bytes.
    pub reserve_B: u64,
    /// What logs may take together before those that hold nothing go, bytes; `None`: nothing is ever removed.
    pub budget_B: Option<u64>,
}

impl Limits {
    /// What room allows. `before` is how it stood. The text says why not.
    pub(super) fn judge(
        self,
        room: Option<Room>,
        armed: bool,
        before: Recording,
        folder: &Path,
    ) -> (Recording, String) {
        // A system that does not say is asked by writing.
        let Some(Room { free_B, size_B }) = room else { return (Recording::Runs, String::new()) };
        let flight_B = FLIGHT_LEAVES_B.min(size_B / FLIGHT_LEAVES_PART);
        let floor_B = self.reserve_B.min(size_B / RESERVE_PART).max(flight_B);
        let more = |least_B: u64, is_more: bool| {
            least_B.saturating_add(if is_more { least_B / AGAIN_PART } else { 0 })
        };
        let flight_B = more(flight_B, before == Recording::Stopped);
        let floor_B = more(floor_B, matches!(before, Recording::Stopped | Recording::Waits));
        let says = |kept_B: u64, what: &str| {
            let (free, kept) = (words(free_B), words(kept_B));
            format!("{free} free in {}, {kept} {what}", folder.display())
        };
        if free_B < flight_B {
            (Recording::Stopped, says(flight_B, "needed"))
        } else if !armed && free_B < floor_B {
            (Recording::Waits, says(floor_B, "kept for flights (record.reserve_gb)"))
        } else {
            (Recording::Runs, String::new())
        }
    }
}

/// Bytes for people.
fn words(bytes: u64) -> String {
    match bytes {
        0..1_000_000 => format!("{:.0} kB", bytes as f64 * 1e-3),
        1_000_000..1_000_000_000 => format!("{:.0} MB", bytes as f64 * 1e-6),
        _ => format!("{:.2} GB", bytes as f64 * 1e-9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GB: u64 = 1_000_000_000;

    fn judged(free_B: u64, size_B: u64, armed: bool, before: Recording) -> Recording {
        let limits = Limits { reserve_B: GB, budget_B: None };
        limits.judge(Some(Room { free_B, size_B }), armed, before, Path::new("logs")).0
    }

    #[test]
    fn prop_a_reserve_is_kept_on_the_floor_and_flown_into_down_to_200_mb() {
        use Recording::{Runs, Stopped, Waits};
        let disk = 100 * GB;
        assert_eq!(judged(GB, disk, false, Runs), Runs);
        assert_eq!(judged(GB - 1, disk, false, Runs), Waits);
        assert_eq!(judged(GB - 1, disk, true, Waits), Runs);
        assert_eq!(judged(GB / 5, disk, true, Runs), Runs);
        assert_eq!(judged(GB / 5 - 1, disk, true, Runs), Stopped);
        // It does not come and go with each megabyte.
        assert_eq!(judged(GB / 4 - 1, disk, true, Stopped), Stopped);
        assert_eq!(judged(GB / 4, disk, true, Stopped), Runs);
        assert_eq!(judged(GB * 5 / 4 - 1, disk, false, Waits), Waits);
        assert_eq!(judged(GB * 5 / 4, disk, false, Waits), Runs);
        // A small disk is not all reserve.
        assert_eq!(judged(GB / 2, GB, false, Runs), Runs);
        assert_eq!(judged(GB / 10 - 1, GB, false, Runs), Waits);
        assert_eq!(judged(GB / 20 - 1, GB, true, Runs), Stopped);
    }

    #[test]
    fn prop_the_reason_names_what_is_free_where_and_what_is_needed() {
        let limits = Limits { reserve_B: GB, budget_B: None };
        let room = Some(Room { free_B: 123_456_789, size_B: 32 * GB });
        let (_, why) = limits.judge(room, false, Recording::Runs, Path::new("/logs"));
        assert_eq!(why, "123 MB free in /logs, 200 MB needed");
        // Who does not say is asked by writing.
        assert_eq!(limits.judge(None, false, Recording::Stopped, Path::new("")).0, Recording::Runs);
    }
}
