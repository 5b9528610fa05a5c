//! The scorer: keys are what was committed, opened last, and turned into truths.

use super::*;

fn key(json: &str) -> Key {
    serde_json::from_str(json).unwrap()
}

const ANCHOR: &str = "{\"class\": \"single\", \"effects\": [{\"id\": \"U2\", \"block\": \"uwb\", \
                      \"parameters\": {\"bias\": 0.2}, \"anchor\": 3}]}";
const PAIR: &str = "{\"class\": \"pair\", \"effects\": [\
    {\"id\": \"P1\", \"block\": \"thrust\", \"parameters\": {}, \"anchor\": null},\
    {\"id\": \"I1\", \"block\": \"thrust\", \"parameters\": {}, \"anchor\": null}]}";

#[test]
fn prop_truths_follow_the_library_that_was_judged_with() {
    let library = library::standard();
    let Truth::Single { id, block, theta } = truth(&key(ANCHOR), &library) else { panic!() };
    assert_eq!((id.as_str(), block.as_str()), ("U2", "uwb"));
    assert!(theta[0] == 0.2 && theta[1].is_nan(), "a parameter that is not in the key: {theta:?}");
    let without: Vec<_> = library.iter().copied().filter(|s| s.id != "U2").collect();
    assert_eq!(truth(&key(ANCHOR), &without), Truth::Unknown { name: "U2".into() });
    assert_eq!(
        truth(&key(PAIR), &library),
        Truth::Pair { ids: ["P1".to_owned(), "I1".to_owned()] }
    );
    assert_eq!(truth(&key("{\"class\": \"no-gap\", \"effects\": []}"), &library), Truth::NoGap);
}

#[test]
fn prop_anchors_count_only_where_the_key_has_one() {
    let answer = |anchor: u8| Answer {
        anchors: BTreeMap::from([("bias".to_owned(), anchor)]),
        ..Answer::fault("x", String::new())
    };
    let keys = [key(ANCHOR), key(ANCHOR), key(PAIR)];
    assert_eq!(anchors(&keys, &[answer(3), answer(5), answer(3)]), (1, 2));
}

fn entry(key_sha256: &str) -> Entry {
    Entry {
        id: "case-001".into(),
        mission: "diagnostic".into(),
        log: "logs/case-001-diagnostic.mcap".into(),
        held_out_log: None,
        tenth: true,
        lockbox: false,
        key_sha256: key_sha256.to_owned(),
    }
}

#[test]
fn prop_a_key_other_than_the_committed_one_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("key")).unwrap();
    std::fs::write(folder.path().join("key/case-001.json"), ANCHOR).unwrap();
    let committed = seal::digest(ANCHOR.as_bytes());
    assert_eq!(open(folder.path(), &entry(&committed)).unwrap().class, "single");
    let changed = ANCHOR.replace("0.2", "0.3");
    std::fs::write(folder.path().join("key/case-001.json"), changed).unwrap();
    let said = open(folder.path(), &entry(&committed)).unwrap_err();
    assert!(matches!(said, BlindError::Seal { .. }), "{said}");
    assert!(said.to_string().contains(&committed));
}

fn choice(lockbox: bool) -> Choice {
    Choice {
        tenth: true,
        lockbox,
        references: Some(0),
        shrink: false,
        withheld: Vec::new(),
        size: BankSize { seeds: 4, jitter: 12, draws: 6 },
        settings: Settings::default(),
        outside: None,
    }
}

#[test]
fn prop_a_suite_without_flights_is_told_and_no_key_is_opened_before_an_answer() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let banks = dir.join("banks");
    let told = Told::default();
    let go = |lockbox: bool| run(dir, &banks, &told, &choice(lockbox), &|_| {}).unwrap_err();
    assert!(go(false).to_string().contains("cases.json"));
    let suite = |lockbox: bool| {
        format!(
            "{{\"generator\": \"g\", \"all_keys_sha256\": \"x\", \"commissioning\": [], \"calibration\": [], \
             \"cases\": [{{\"id\": \"case-001\", \"mission\": \"diagnostic\", \"log\": \"c.mcap\", \
             \"held_out_log\": null, \"tenth\": true, \"lockbox\": {lockbox}, \"key_sha256\": \"x\"}}]}}"
        )
    };
    std::fs::write(dir.join("cases.json"), suite(false)).unwrap();
    assert!(matches!(go(false), BlindError::Empty(_)), "its log is not there");
    // No key folder: whoever opened a key first would fail on that.
    std::fs::write(dir.join("c.mcap"), b"no log").unwrap();
    assert!(matches!(go(false), BlindError::Log(_)), "{}", go(false));
    std::fs::write(dir.join("cases.json"), suite(true)).unwrap();
    assert!(matches!(go(false), BlindError::Empty(_)), "the lockbox stays shut");
    assert!(matches!(go(true), BlindError::Log(_)));
}
