//! A disk that is full, and has room again.

use std::io::{self, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::room::Limits;
use super::scribe::Disk;
use super::tests::session;
use super::writer::LogWriter;
use super::*;
use haltere_core::time::HostTime;
use haltere_pilot::{Input, Recording};

const GB: u64 = 1_000_000_000;

/// A disk of 100 GB, of which so much is free; and a medium on it that takes so many bytes more.
#[derive(Clone, Default)]
struct Small {
    bytes: Arc<Mutex<io::Cursor<Vec<u8>>>>,
    free_B: Arc<AtomicU64>,
    room_B: Arc<AtomicU64>,
    /// It takes nothing now, and does not come back either.
    stalls: Arc<AtomicBool>,
}

impl Write for Small {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        while self.stalls.load(SeqCst) {
            std::thread::sleep(Duration::from_millis(1));
        }
        let n = (bytes.len() as u64).min(self.room_B.load(SeqCst));
        if n == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.room_B.fetch_sub(n, SeqCst);
        self.bytes.lock().unwrap().write(&bytes[..n as usize])
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Small {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        self.bytes.lock().unwrap().seek(to)
    }
}

impl Small {
    fn new(free_B: u64) -> Self {
        let small = Self::default();
        small.free_B.store(free_B, SeqCst);
        small.room_B.store(u64::MAX / 2, SeqCst);
        small
    }

    fn recorder(&self) -> Recorder {
        self.recorder_of(4096)
    }

    fn recorder_of(&self, depth: usize) -> Recorder {
        let (medium, free_B) = (self.clone(), self.free_B.clone());
        let begin = move || {
            let sync = Box::new(|| Ok(()));
            LogWriter::on(PathBuf::from("/logs/a.mcap"), medium.clone(), sync, &session())
        };
        let disk = Disk {
            log: None,
            begin: Box::new(begin),
            room: Box::new(move || Some(Room { free_B: free_B.load(SeqCst), size_B: 100 * GB })),
            folder: "/logs".into(),
            limits: Limits { reserve_B: GB, budget_B: None },
        };
        Recorder::spawn_on(disk, depth).unwrap()
    }

    fn read(&self) -> (Vec<Entry>, LogEnd) {
        let bytes = self.bytes.lock().unwrap().get_ref().clone();
        let log = LogReader::from_bytes("small.mcap".into(), bytes).unwrap();
        let mut entries = log.entries();
        let all = entries.by_ref().collect();
        (all, entries.end())
    }
}

/// Wakes until it is told that the recording stands so; the reason.
fn until(recorder: &mut Recorder, wakes: &mut u64, wanted: Recording) -> String {
    let began = Instant::now();
    loop {
        wake(recorder, wakes);
        match recorder.news() {
            Some((state, why)) if state == wanted => return why,
            Some((state, why)) => panic!("{state:?}: {why}"),
            None => {}
        }
        assert!(began.elapsed() < Duration::from_secs(30), "{wanted:?} is not told");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn wake(recorder: &mut Recorder, wakes: &mut u64) {
    *wakes += 1;
    let at = HostTime::from_us(5_000_000 + *wakes * 30_000);
    recorder.input(at, Input::Wake);
    recorder.commit(at);
}

/// Every wake-up is there or in a hole; the number of holes.
fn accounted(entries: &[Entry], wakes: u64) -> usize {
    let (mut next, mut holes) = (1, 0);
    for entry in entries {
        match entry {
            Entry::Input { sequence, .. } => {
                assert_eq!(*sequence, next);
                next += 1;
            }
            Entry::Hole(hole) => {
                assert_eq!(hole.first_sequence, next);
                assert_eq!(hole.lost_raw, hole.last_sequence - hole.first_sequence + 1);
                next = hole.last_sequence + 1;
                holes += 1;
            }
            Entry::Closing(closing) => assert_eq!(closing.last_sequence, wakes),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(next, wakes + 1);
    holes
}

#[test]
fn regress_a_full_disk_stops_the_log_which_goes_on_when_there_is_room() {
    let small = Small::new(50 * GB);
    let (mut recorder, mut n) = (small.recorder(), 0);
    until(&mut recorder, &mut n, Recording::Runs);
    small.room_B.store(100, SeqCst);
    let why = until(&mut recorder, &mut n, Recording::Stopped);
    assert_eq!(why, "/logs/a.mcap: no storage space");
    small.room_B.store(u64::MAX / 2, SeqCst);
    until(&mut recorder, &mut n, Recording::Runs);
    wake(&mut recorder, &mut n);
    assert!(recorder.unrecorded() > 0);
    let lost = recorder.unrecorded();
    let summary = recorder.finish();
    assert!(summary.error.is_none(), "{:?}", summary.error);
    assert_eq!(summary.lost_entries, lost);
    let (entries, end) = small.read();
    assert_eq!(end, LogEnd::Complete);
    assert_eq!(accounted(&entries, n), 1);
}

/// A write that took 20 s cost 4.8 s of the log, and nobody was told.
#[test]
fn regress_a_disk_that_stalls_is_told_and_what_it_cost_is_counted() {
    let small = Small::new(50 * GB);
    let (mut recorder, mut n) = (small.recorder_of(16), 0);
    until(&mut recorder, &mut n, Recording::Runs);
    small.stalls.store(true, SeqCst);
    // As much as may wait is not told: it is not lost.
    for _ in 0..15 {
        wake(&mut recorder, &mut n);
        assert_eq!(recorder.news(), None);
    }
    let why = until(&mut recorder, &mut n, Recording::Stopped);
    assert_eq!(why, "/logs/a.mcap: the disk does not keep up");
    for _ in 0..50 {
        wake(&mut recorder, &mut n);
        assert_eq!(recorder.news(), None, "said once");
    }
    small.stalls.store(false, SeqCst);
    let why = until(&mut recorder, &mut n, Recording::Runs);
    let lost = recorder.lost();
    assert!(lost >= 50, "{lost}");
    assert_eq!(why, format!("{lost} entries are missing"));
    wake(&mut recorder, &mut n);
    let summary = recorder.finish();
    assert!(summary.error.is_none() && summary.lost_entries == lost, "{summary:?}");
    let (entries, end) = small.read();
    assert_eq!(end, LogEnd::Complete);
    assert!(accounted(&entries, n) >= 1);
}

/// A disk that takes its time with the first bytes held up the companion.
#[test]
fn regress_what_comes_before_the_log_is_begun_is_in_it() {
    let small = Small::new(50 * GB);
    small.stalls.store(true, SeqCst);
    let (mut recorder, mut n) = (small.recorder(), 0);
    for _ in 0..100 {
        wake(&mut recorder, &mut n);
    }
    assert_eq!(recorder.path(), None);
    assert_eq!(recorder.news(), None);
    small.stalls.store(false, SeqCst);
    until(&mut recorder, &mut n, Recording::Runs);
    let summary = recorder.finish();
    assert!(summary.error.is_none() && summary.lost_entries == 0, "{summary:?}");
    assert_eq!(accounted(&small.read().0, n), 0);
}

/// Without its folder the companion did not start.
#[test]
fn regress_a_folder_that_is_not_there_is_told_and_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let disk = folder.path().join("disk");
    for (name, what) in [("link", "a link to "), ("file", "a file, no folder")] {
        let logs = folder.path().join(name);
        match name {
            "link" => std::os::unix::fs::symlink(&disk, &logs).unwrap(),
            _ => std::fs::write(&logs, "notes").unwrap(),
        }
        let (mut recorder, mut n) =
            (Recorder::within(Limits::default(), &logs, &session()).unwrap(), 0);
        let why = until(&mut recorder, &mut n, Recording::Stopped);
        assert!(why.starts_with(&format!("{}: {what}", logs.display())), "{why}");
        // The disk comes, or somebody puts the file away.
        match name {
            "link" => std::fs::create_dir(&disk).unwrap(),
            _ => std::fs::remove_file(&logs).unwrap(),
        }
        until(&mut recorder, &mut n, Recording::Runs);
        wake(&mut recorder, &mut n);
        assert!(LogReader::open(recorder.finish().path.unwrap()).is_ok());
    }
}

#[test]
fn regress_a_disk_that_is_full_at_the_start_is_waited_for() {
    let small = Small::new(GB / 10);
    let (mut recorder, mut n) = (small.recorder(), 0);
    let why = until(&mut recorder, &mut n, Recording::Stopped);
    assert_eq!(why, "100 MB free in /logs, 200 MB needed");
    assert_eq!(recorder.path(), None);
    small.free_B.store(2 * GB, SeqCst);
    until(&mut recorder, &mut n, Recording::Runs);
    assert_eq!(recorder.path(), Some(Path::new("/logs/a.mcap")));
    wake(&mut recorder, &mut n);
    assert!(recorder.finish().error.is_none());
    assert_eq!(accounted(&small.read().0, n), 1);

    // To the end without.
    let recorder = Small::new(GB / 10).recorder();
    let summary = recorder.finish();
    assert_eq!(summary.path, None);
    let error = summary.error.unwrap().to_string();
    assert!(
        error.starts_with("without log: 100 MB free in /logs, 200 MB needed; make room"),
        "{error}"
    );
}

#[test]
fn regress_a_vehicle_on_the_bench_leaves_room_for_flights() {
    let small = Small::new(2 * GB);
    let (mut recorder, mut n) = (small.recorder(), 0);
    until(&mut recorder, &mut n, Recording::Runs);
    small.free_B.store(GB - 1, SeqCst);
    let why = until(&mut recorder, &mut n, Recording::Waits);
    assert!(why.contains("1.00 GB kept for flights (record.reserve_gb)"), "{why}");
    for _ in 0..3 {
        wake(&mut recorder, &mut n);
    }
    std::thread::sleep(Duration::from_millis(100));
    // Whoever arms has it all.
    recorder.set_armed(true);
    until(&mut recorder, &mut n, Recording::Runs);
    small.free_B.store(GB / 5, SeqCst);
    for _ in 0..300 {
        wake(&mut recorder, &mut n);
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(recorder.news(), None);
    small.free_B.store(GB / 5 - 1, SeqCst);
    until(&mut recorder, &mut n, Recording::Stopped);
    wake(&mut recorder, &mut n);
    let summary = recorder.finish();
    let error = summary.error.unwrap().to_string();
    assert!(error.contains("recording stopped: 200 MB free in /logs, 200 MB needed"), "{error}");
    let (entries, end) = small.read();
    assert_eq!(end, LogEnd::Complete);
    assert_eq!(accounted(&entries, n), 2);
}

/// On a file system of 2 MB, where the one who tests may mount one.
#[test]
fn regress_a_real_disk_that_is_full_and_emptied() {
    let folder = tempfile::tempdir().unwrap();
    let mounted = std::process::Command::new("mount")
        .args(["-t", "tmpfs", "-o", "size=2m", "tmpfs"])
        .arg(folder.path())
        .output();
    if !mounted.is_ok_and(|mounted| mounted.status.success()) {
        eprintln!("not checked on a real file system: it takes root to mount one");
        return;
    }
    let filler = folder.path().join("filler");
    std::fs::write(&filler, vec![0; 2_080_000]).unwrap();
    let logs = folder.path().join("logs");
    let limits = Limits { reserve_B: GB, budget_B: None };
    let (mut recorder, mut n) = (Recorder::within(limits, &logs, &session()).unwrap(), 0);
    until(&mut recorder, &mut n, Recording::Stopped);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left lying about");
    std::fs::remove_file(&filler).unwrap();
    until(&mut recorder, &mut n, Recording::Runs);
    recorder.set_armed(true);
    // A flight fills it, down to a twentieth.
    let mut told = None;
    while told.is_none() && n < 100_000 {
        let at = HostTime::from_us(5_000_000 + n * 30_000);
        let link = haltere_pilot::LinkId::Tag;
        recorder.input(at, Input::Bytes { link, bytes: &[n as u8; 500] });
        n += 1;
        recorder.commit(at);
        std::thread::sleep(Duration::from_micros(500));
        told = recorder.news();
    }
    assert_eq!(told.map(|(state, _)| state), Some(Recording::Stopped));
    let path = recorder.finish().path.unwrap();
    let log = LogReader::open(path).unwrap();
    let mut entries = log.entries();
    let all: Vec<_> = entries.by_ref().collect();
    let end = entries.end();
    let _ = std::process::Command::new("umount").arg("-l").arg(folder.path()).status();
    assert!(matches!(end, LogEnd::Complete | LogEnd::Cut { .. }), "{end}");
    assert!(all.len() > 1000, "{}", all.len());
}
