//! Whole campaigns, small ones.

use super::*;

fn small(flights: u64) -> Campaign {
    let text = format!(
        "name = 'small'\nflights = {flights}\nlimit_s = 30.0\n\
         [[item]]\ncommand = 'takeoff'\nheight_m = 0.8\n[[item]]\ncommand = 'land'\n\
         [vary]\n'start.yaw_deg' = {{ uniform = [-90.0, 90.0] }}\n"
    );
    Campaign::parse(&text, Path::new("."), None, "small.toml", Vec::new()).unwrap()
}

fn options(out: &Path, shard: [u64; 2]) -> Run {
    Run { out: out.to_owned(), shard: Shard(shard), jobs: 2, seed: None, fly: None, log: None }
}

fn bytes(out: &Path) -> Vec<u8> {
    std::fs::read(out.join("rows.jsonl")).unwrap()
}

#[test]
fn prop_one_machine_shards_and_a_resumed_run_give_the_same_rows() {
    let dir = tempfile::tempdir().unwrap();
    let campaign = small(4);
    let at = |name: &str| dir.path().join(name);
    let (identity, rows) = fly_all(&campaign, &options(&at("whole"), [1, 1]), None).unwrap();
    assert!(rows.values().all(|r| r.outcome == Outcome::Landed), "{rows:#?}");
    let all: Vec<&Row> = rows.values().collect();
    write_results(&at("whole"), &identity, &all, "x").unwrap();

    for shard in [[1, 2], [2, 2]] {
        let out = at(&format!("shard-{}", shard[0]));
        fly_all(&campaign, &options(&out, shard), None).unwrap();
    }
    let merge = |shards: &[&str], out: &str| {
        let shards: Vec<PathBuf> = shards.iter().map(|s| at(s)).collect();
        merge::merge(&shards, &at(out))
    };
    merge(&["shard-2", "shard-1"], "merged").unwrap();
    assert_eq!(bytes(&at("merged")), bytes(&at("whole")));
    assert_eq!(
        std::fs::read(at("merged").join(RESULTS)).unwrap(),
        std::fs::read(at("whole").join(RESULTS)).unwrap()
    );
    assert!(merge(&["shard-1"], "other").is_err() && !at("other").exists());

    // Killed in the middle of a row: that flight is flown again, the others are not.
    let mut cut = bytes(&at("whole"));
    cut.truncate(cut.len() / 2);
    std::fs::write(at("whole").join("rows.jsonl"), &cut).unwrap();
    fly_all(&campaign, &options(&at("whole"), [1, 1]), None).unwrap();
    assert_eq!(bytes(&at("merged")), bytes(&at("whole")));
    // A changed campaign is refused.
    let error = fly_all(&small(5), &options(&at("whole"), [1, 1]), None).unwrap_err();
    assert!(format!("{error:#}").contains("another campaign"), "{error:#}");
}

#[test]
fn prop_a_panic_ends_its_flight_alone() {
    let plan = small(2).plan(1).unwrap();
    let row = caught(&plan, |_| panic!("on purpose {}", 7)).unwrap();
    assert_eq!((row.outcome, row.why.as_str(), row.index), (Outcome::Panicked, "on purpose 7", 1));
}

#[test]
fn prop_shards_are_read_and_refused() {
    assert_eq!(shard("2/3"), Ok(Shard([2, 3])));
    for wrong in ["0/3", "4/3", "1", "a/b", "1/0", "-1/2", "1/100001"] {
        assert!(shard(wrong).is_err(), "{wrong}");
    }
    let of = |i| selection(10, [i, 3], None).collect::<Vec<_>>();
    let mut all: Vec<u64> = (1..=3).flat_map(of).collect();
    all.sort_unstable();
    assert_eq!(all, (0..10).collect::<Vec<_>>());
}

#[test]
fn prop_a_kept_flight_is_the_same_flight_and_its_log_replays() {
    let dir = tempfile::tempdir().unwrap();
    let campaign = small(2);
    let log = dir.path().join("flight.mcap");
    let plan = campaign.plan(1).unwrap();
    let kept = flight::fly(&plan, Some(&flight::Keep { log: &log })).unwrap();
    assert_eq!(kept, flight::fly(&plan, None).unwrap());
    let log = haltere_log::record::LogReader::open(&log).unwrap();
    let replayed = haltere_log::replay::replay_log(&log).unwrap();
    assert_eq!(replayed.exit_code(), 0, "the log does not replay");
    let truth = std::fs::read_to_string(dir.path().join("flight.truth.csv")).unwrap();
    assert!(truth.lines().count() > 500);
}

/// Every scenario file of the repository, with the settings that a companion needs in it.
#[test]
fn val_every_scenario_file_is_flown_to_its_end() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("sim/scenarios");
    let mut names: Vec<String> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        // The unkind boards settle for longer than a lockstep start waits; the demo flies them.
        .filter(|name| !name.starts_with("anchors-") && !name.contains("unkind"))
        .collect();
    names.sort();
    assert!(names.len() >= 7, "{names:?}");
    let rows: Vec<(String, Row)> = names
        .into_par_iter()
        .map(|name| {
            let text = format!(
                "name = 'one'\nflights = 1\nlimit_s = 90.0\nscenario = '{name}'\n\
                 set = ['board.set_parameters=true']\n\
                 [[item]]\ncommand = 'takeoff'\nheight_m = 1.2\n\
                 [[item]]\ncommand = 'delay'\nduration_s = 14.0\n[[item]]\ncommand = 'return'\n"
            );
            let campaign = Campaign::parse(&text, &folder, None, "one", Vec::new()).unwrap();
            let row = flight::fly(&campaign.plan(0).unwrap(), None).unwrap();
            (name, row)
        })
        .collect();
    for (name, row) in rows {
        println!("{name}: {:?} {} {:?} {:?}", row.outcome, row.why, row.modes, row.said);
        assert_eq!(row.outcome, Outcome::Landed, "{name}: {row:#?}");
        assert!(row.airborne_s > 5.0, "{name}: {row:#?}");
        let faulty = ["draughty.toml", "mishaps.toml"].contains(&name.as_str());
        assert!(!faulty || row.fault_s.is_some(), "{name}: the fault came too late");
    }
}

#[test]
fn prop_the_committed_campaigns_can_be_planned() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("sim/campaigns");
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        let campaign = Campaign::load(&path, None).unwrap();
        (0..campaign.flights).for_each(|i| {
            campaign.plan(i).unwrap_or_else(|e| panic!("{}: {e:#}", path.display()));
        });
    }
}
