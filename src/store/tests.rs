//! The store on a real folder.

use super::*;
use haltere_pilot::services::{FileName, Folder};

fn store(folder: &Path) -> Store {
    let own = folder.join("logs/b.mcap");
    Store::new(&folder.join("state"), &folder.join("logs"), Some(&own), Box::new(NoPrograms))
}

fn mission(name: &str) -> FileName {
    FileName::new(Folder::Missions, name).unwrap()
}

/// Each kept file as a power cut or a bad disk may leave it: cut behind any byte, any bit turned over, any
/// leftover beside it. What is read is the old, the new, or nothing that is used and people are told.
#[test]
fn prop_no_cut_and_no_flipped_bit_is_taken_for_content() {
    use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
    use haltere_pilot::services::{decode_plan, encode_plan};
    let folder = tempfile::tempdir().unwrap();
    let store = store(folder.path());
    let item = |seq| MISSION_ITEM_INT_DATA { seq, x: 10_000, z: -1.0, ..Default::default() };
    let plans = [vec![item(0)], vec![item(0), item(1), item(2)]].map(|p| encode_plan(&p));
    let state = folder.path().join("state");
    fs::create_dir_all(&state).unwrap();
    let path = state.join("mission.plan");
    let load = || decode_plan(&store.work(&FileTask::LoadPlan(Plan::Mission)).unwrap());
    let [old, new] = plans.clone().map(|bytes| decode_plan(&bytes).unwrap());
    // A cut while the new one is written: it lies beside, in any length.
    fs::write(&path, &plans[0]).unwrap();
    for end in 0..=plans[1].len() {
        fs::write(state.join(".written-x.part"), &plans[1][..end]).unwrap();
        assert_eq!(load().as_ref(), Ok(&old), "{end} bytes of the new one");
    }
    assert!(store.work(&FileTask::SavePlan(Plan::Mission, plans[1].clone())).is_ok());
    assert_eq!(load().as_ref(), Ok(&new), "beside the leftover");
    store.sweep();
    assert_eq!(fs::read_dir(&state).unwrap().count(), 1, "the leftover is gone");
    // A disk that broke its word: nothing that is not whole is taken.
    for end in 1..plans[1].len() {
        fs::write(&path, &plans[1][..end]).unwrap();
        assert!(load().is_err(), "cut behind byte {end}");
    }
    // Empty is what many cards leave after a power cut; no file is what clearing leaves.
    fs::write(&path, b"").unwrap();
    let answer = store.work(&FileTask::LoadPlan(Plan::Mission));
    assert_eq!(answer, Err((FileFault::Nonsense, b"mission.plan is empty".to_vec())));
    assert_eq!(store.work(&FileTask::LoadPlan(Plan::Fence)), Ok(Vec::new()));
    for bit in 0..8 * plans[1].len() {
        let mut bytes = plans[1].clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        fs::write(&path, &bytes).unwrap();
        assert!(load().is_err(), "bit {bit}");
    }
    // Parameters: the same, and the next value that is set begins them anew.
    let keep = |value| store.work(&FileTask::KeepParameter { name: "FLT_TKO_HGT", value });
    let path = stored::path(&state);
    assert!(keep(1.25).is_ok());
    let whole = fs::read(&path).unwrap();
    let values =
        |bytes: &[u8]| std::str::from_utf8(bytes).ok().and_then(|t| stored::from_text(t).ok());
    let wanted = values(&whole).unwrap();
    for end in 0..whole.len() {
        assert_eq!(values(&whole[..end]), None, "cut behind byte {end}");
    }
    for bit in 0..8 * whole.len() {
        let mut bytes = whole.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        // The letters of a checksum mean the same in either case.
        assert!(values(&bytes).is_none_or(|found| found == wanted), "bit {bit}");
    }
    fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    assert!(keep(1.5).is_ok());
    assert_eq!(values(&fs::read(&path).unwrap()).unwrap()["FLT_TKO_HGT"], 1.5);
}

#[test]
fn prop_parameters_are_kept_one_by_one_and_forgotten_together() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(folder.path());
    let keep = |name, value| store.work(&FileTask::KeepParameter { name, value });
    assert!(keep("FLT_TKO_HGT", 1.2).is_ok() && keep("FLT_ACC_RAD", 0.4).is_ok());
    assert!(keep("FLT_TKO_HGT", 1.5).is_ok());
    let path = stored::path(&folder.path().join("state"));
    let values = stored::from_text(&fs::read_to_string(&path).unwrap()).unwrap();
    assert_eq!(values.len(), 2);
    assert_eq!(values["FLT_TKO_HGT"], 1.5);
    assert!(store.work(&FileTask::ForgetParameters).is_ok());
    assert!(!path.exists());
    assert!(store.work(&FileTask::ForgetParameters).is_ok());
}

#[test]
fn prop_plans_come_back_and_go() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(folder.path());
    let load = || store.work(&FileTask::LoadPlan(Plan::Fence));
    assert_eq!(load(), Ok(vec![]));
    assert!(store.work(&FileTask::SavePlan(Plan::Fence, vec![1, 2, 3])).is_ok());
    assert_eq!(load(), Ok(vec![1, 2, 3]));
    assert_eq!(store.work(&FileTask::LoadPlan(Plan::Mission)), Ok(vec![]));
    assert!(store.work(&FileTask::SavePlan(Plan::Fence, vec![])).is_ok());
    assert_eq!(load(), Ok(vec![]));
}

#[test]
fn prop_files_are_listed_read_written_and_removed() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(folder.path());
    assert_eq!(store.work(&FileTask::List(Folder::Missions)), Ok(vec![]));
    let bytes: Vec<u8> = (0..=255).cycle().take(1000).collect();
    let file = mission("square.toml");
    assert!(store.work(&FileTask::Write { file: file.clone(), bytes: bytes.clone() }).is_ok());
    let list = store.work(&FileTask::List(Folder::Missions)).unwrap();
    assert!(list.starts_with(b"square.toml\t1000\t"));
    assert_eq!(store.work(&FileTask::Size(file.clone())), Ok(1000_u64.to_le_bytes().to_vec()));
    let read = |offset, count| store.work(&FileTask::Read { file: file.clone(), offset, count });
    assert_eq!(read(990, 100).unwrap(), bytes[990..]);
    assert_eq!(read(2000, 100), Ok(vec![]));
    let crc = crc32(&bytes, 0).to_le_bytes().to_vec();
    assert_eq!(store.work(&FileTask::Checksum(file.clone())), Ok(crc));
    assert!(store.work(&FileTask::Remove(file.clone())).is_ok());
    assert_eq!(store.work(&FileTask::Size(file)).unwrap_err().0, FileFault::NotFound);
}

#[test]
fn prop_logs_are_read_only_and_the_own_one_is_never_erased() {
    let folder = tempfile::tempdir().unwrap();
    let logs = folder.path().join("logs");
    fs::create_dir_all(&logs).unwrap();
    for name in ["a.mcap", "b.mcap", "c.mcap", "notes.txt"] {
        fs::write(logs.join(name), name).unwrap();
    }
    let store = store(folder.path());
    let log = FileName::new(Folder::Logs, "a.mcap").unwrap();
    let refused = |task| store.work(&task).unwrap_err().0;
    assert_eq!(refused(FileTask::Remove(log.clone())), FileFault::Protected);
    assert_eq!(refused(FileTask::Write { file: log, bytes: vec![] }), FileFault::Protected);
    assert!(store.work(&FileTask::EraseLogs).is_ok());
    let list = String::from_utf8(store.work(&FileTask::List(Folder::Logs)).unwrap()).unwrap();
    assert_eq!(list.lines().count(), 1);
    assert!(list.starts_with("b.mcap\t6\t"));
    assert!(logs.join("notes.txt").exists());
}

/// A link in the folder leads nowhere.
#[test]
fn prop_links_are_not_followed() {
    let folder = tempfile::tempdir().unwrap();
    let missions = folder.path().join("state/missions");
    fs::create_dir_all(&missions).unwrap();
    std::os::unix::fs::symlink("/etc/passwd", missions.join("passwd")).unwrap();
    let store = store(folder.path());
    assert_eq!(store.work(&FileTask::List(Folder::Missions)), Ok(vec![]));
    let file = mission("passwd");
    for task in [
        FileTask::Size(file.clone()),
        FileTask::Read { file: file.clone(), offset: 0, count: 10 },
        FileTask::Checksum(file.clone()),
        FileTask::Remove(file),
        FileTask::LoadProgram("passwd".to_owned()),
    ] {
        assert_eq!(store.work(&task).unwrap_err().0, FileFault::NotFound, "{task:?}");
    }
}

const FILE: &str = "HALTERE_KILLED_STORE";

/// What the next test kills: this program again.
#[test]
fn replaces_until_it_is_killed() {
    let Some(file) = std::env::var_os(FILE) else { return };
    for n in 0..u64::MAX {
        let text = format!("{n}\n").repeat(1 + n as usize % 5000);
        replace(Path::new(&file), text.as_bytes()).unwrap();
    }
}

/// `HALTERE_KILLS` says how often (`.ci/nightly`: 200).
#[test]
fn prop_a_store_that_is_killed_leaves_the_old_or_the_new() {
    let kills = std::env::var("HALTERE_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(5);
    let (mut none, mut whole) = (0_u64, 0_u64);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("parameters.txt");
    for kill in 0..kills {
        let mut writer = std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "store::tests::replaces_until_it_is_killed"])
            .env(FILE, &file)
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(std::time::Duration::from_micros(kill * 7919 % 100_000));
        writer.kill().unwrap();
        writer.wait().unwrap();
        let Ok(text) = fs::read_to_string(&file) else {
            none += 1;
            continue;
        };
        let n: usize = text.lines().next().unwrap().parse().unwrap();
        assert_eq!(text.lines().count(), 1 + n % 5000, "kill {kill}");
        assert!(text.lines().all(|line| line == n.to_string()), "kill {kill}");
        whole += 1;
    }
    println!(
        "store: killed {kills} times: {whole} times whole, {none} times before there was one, 0 torn"
    );
    assert_eq!(none + whole, kills);
}
