//! The catalogue in campaigns: every fault in every phase, from the start, and in both volumes.

use haltere::simulated::campaign::flight::fly;
use haltere::simulated::campaign::plan::{FAULT, FAULT_AT, FROM_START, PHASE, TAKE_OFF, VOLUME};
use haltere::simulated::campaign::row::Outcome;
use haltere::simulated::campaign::store::Identity;
use haltere::simulated::faults::Phase;

use super::*;

fn campaign(text: &str) -> Result<Campaign> {
    Campaign::parse(text, Path::new("."), None, "test", catalogue::all())
}

#[test]
fn prop_refusals_name_what_is_wrong() {
    let says = |text: &str, needed: &str| {
        let text = format!("name = 'x'\n[[item]]\ncommand = 'land'\n[faults]\n{text}");
        let error = format!("{:#}", campaign(&text).unwrap_err());
        assert!(error.contains(needed), "{error}");
    };
    says("names = ['gremlins']", "`gremlins` is not in the catalogue");
    says("repeats = 0", "faults.repeats = 0");
}

#[test]
fn prop_the_committed_campaign_can_be_planned() {
    let campaign = committed();
    (0..campaign.flights).for_each(|i| {
        campaign.plan(i).unwrap_or_else(|e| panic!("{e:#}"));
    });
}

#[test]
fn prop_the_fault_grid_has_every_fault_in_every_phase() {
    let text = "name = 'x'\n[[item]]\ncommand = 'land'\n[faults]\nrepeats = 2\n";
    let c = campaign(text).unwrap();
    assert_eq!(c.flights, 2 * 7 * c.faults.len() as u64);
    let mut seen: Vec<_> = (0..c.flights).filter_map(|i| c.fault_place(i)).collect();
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(seen.len() as u64, c.flights);
    let plan = c.plan(5).unwrap();
    assert_eq!(plan.drawn[FAULT], c.faults[5].name.as_str());
    assert!(plan.scenario.faults.iter().all(|f| f.phase == Some(Phase::Spool)));
}

#[test]
fn prop_what_is_told_wrongly_is_there_from_the_start() {
    let text = "name = 'x'\n[[item]]\ncommand = 'land'\n\
         [faults]\nnames = ['survey: x and y exchanged', 'heading told -90° off']\n";
    let c = campaign(text).unwrap();
    let [survey, heading] = [0, 1].map(|i| c.plan(i).unwrap());
    assert_eq!(survey.drawn[PHASE], FROM_START);
    assert!(survey.scenario.faults.is_empty() && !survey.drawn.contains_key(FAULT_AT));
    let (truth, told) = (survey.scenario.survey().unwrap(), survey.scenario.told_survey().unwrap());
    assert_ne!(truth, told);
    assert_eq!(heading.scenario.survey().unwrap(), heading.scenario.told_survey().unwrap());
    assert_eq!(heading.config.board.north_offset_deg, -90.0);
}

#[test]
fn prop_a_share_of_each_fault_is_flown_in_the_default_volume() {
    let text = "name = 'x'\nset = ['limits.height_m=4.0']\n[[item]]\ncommand = 'land'\n\
         [fence]\nnorth_m = [1.0, 9.0]\neast_m = [1.0, 9.0]\nheight_m = 4.0\n\
         [faults]\nrepeats = 4\ndefault_volume_every = 4\n";
    let c = campaign(text).unwrap();
    let mut shares = vec![0; c.faults.len()];
    for i in 0..c.flights {
        let plan = c.plan(i).unwrap();
        let default = plan.drawn.contains_key(VOLUME);
        assert_eq!(plan.config.limits.height_m, if default { None } else { Some(4.0) });
        let height_m = plan.fence.height_m;
        if plan.drawn.contains_key(TAKE_OFF) {
            assert!(height_m <= 2.3, "no higher than was asked for: {height_m}");
        } else {
            assert_eq!(height_m, if default { 7.0 } else { 4.0 });
        }
        shares[c.fault_place(i).unwrap().0] += u32::from(default);
    }
    assert!(shares.iter().all(|n| *n == 7), "of 28 each: {shares:?}");
}

/// Truth of a flight decides: a wing that is lost crashes it, whatever the companion says.
#[test]
fn val_a_lost_wing_crashes_and_a_lost_tag_does_not() {
    let flown = |fault: &str| {
        let text = format!(
            "name = 'one'\nlimit_s = 40.0\n[[item]]\ncommand = 'takeoff'\nheight_m = 1.2\n\
             [[item]]\ncommand = 'delay'\nduration_s = 5.0\n[[item]]\ncommand = 'land'\n\
             [faults]\nnames = ['{fault}']\nphases = ['hover', 'climb']\n"
        );
        let campaign = campaign(&text).unwrap();
        fly(&campaign.plan(0).unwrap(), None).unwrap()
    };
    let wing = flown("a wing lost");
    assert_eq!(
        (wing.outcome, wing.fault_mode.as_str()),
        (Outcome::Crashed, "mission"),
        "{wing:#?}"
    );
    assert!(wing.fault_s.is_some() && wing.crashed_s > wing.fault_s);
    let tag = flown("UWB off");
    assert_eq!(tag.outcome, Outcome::Landed, "{tag:#?}");
    assert!(tag.modes.contains("land") && tag.reacted_after_s.is_some_and(|s| s < 2.0), "{tag:#?}");
}

fn committed() -> Campaign {
    campaign(CAMPAIGN).unwrap()
}

#[test]
fn prop_the_committed_campaign_is_large_enough() {
    let c = committed();
    assert!(c.flights >= 3000, "{}", c.flights);
    let default = (0..c.flights).filter(|i| c.in_default_volume(*i));
    assert!(default.count() >= 300);
    assert_eq!(c.faults.len(), catalogue::all().len());
    assert_eq!(c.phases.len(), 7);
}

#[test]
fn prop_a_sample_has_every_fault_and_every_phase() {
    let c = committed();
    for n in 1..=7 {
        let sample = sample(&c, n);
        assert_eq!(sample.len() as u64, n * c.faults.len() as u64);
        let places: Vec<_> = sample.iter().filter_map(|i| c.fault_place(*i)).collect();
        for fault in 0..c.faults.len() {
            assert_eq!(places.iter().filter(|p| p.0 == fault).count() as u64, n);
        }
        let per_phase = sample.len() / c.phases.len();
        for phase in 0..c.phases.len() {
            let count = places.iter().filter(|p| p.1 == phase).count();
            assert!(count.abs_diff(per_phase) <= 6, "phase {phase}: {count} of {per_phase}");
        }
    }
}

#[test]
fn prop_only_what_was_safe_before_can_be_worse() {
    let c = committed();
    let identity = Identity::new(&c, [1, 1], false);
    let plan = c.plan(0).unwrap();
    let row = |outcome| Row { outcome, ..Row::blank(0, plan.seed, plan.drawn.clone()) };
    let (landed, crashed) = (row(Outcome::Landed), row(Outcome::Crashed));
    let panicked = row(Outcome::Panicked);
    fn report<'a>(c: &'a Campaign, identity: &'a Identity, rows: &'a [&'a Row]) -> Report<'a> {
        Report { campaign: c, identity, rows, again: "x" }
    }
    let good = report(&c, &identity, &[&landed]).json();
    let bad = report(&c, &identity, &[&landed, &crashed]).json();
    let worse = |row: &Row, earlier: &serde_json::Value| {
        report(&c, &identity, &[row]).worse_than(earlier).len()
    };
    assert_eq!((worse(&landed, &good), worse(&crashed, &good), worse(&crashed, &bad)), (0, 1, 0));
    assert_eq!(worse(&panicked, &bad), 1);
    let nothing = serde_json::json!({});
    assert_eq!(worse(&crashed, &nothing), 1, "an empty result excuses nothing");
    let (of_bad, of_good) = ([&crashed], [&landed]);
    let (new, old) = (report(&c, &identity, &of_bad), report(&c, &identity, &of_good));
    assert!(new.worse_than(&nothing)[0].starts_with("new, and not safe"));
    assert_eq!(new.new_since(&nothing), [c.faults[0].name.as_str()]);
    assert!(old.worse_than(&nothing).is_empty() && old.new_since(&good).is_empty());
}

#[test]
fn prop_only_flies_what_is_named() {
    let c = committed();
    let options = |arguments: &[&str]| {
        #[derive(clap::Parser)]
        struct Parsed {
            #[command(flatten)]
            options: Options,
        }
        let arguments = ["faults"].iter().chain(arguments);
        <Parsed as clap::Parser>::try_parse_from(arguments).unwrap().options
    };
    let count =
        |arguments: &[&str]| selected(&c, &options(arguments)).map(|s| s.map_or(0, |s| s.len()));
    assert_eq!(count(&[]).unwrap(), 0, "all, not a selection");
    assert_eq!(count(&["--only", "replayed_ranging"]).unwrap(), 8 * 28);
    assert_eq!(count(&["--only", "servos limp", "servos stuck", "--sample", "7"]).unwrap(), 14);
    let refused = format!("{:#}", count(&["--only", "gremlins"]).unwrap_err());
    assert!(refused.contains("no fault and no group"), "{refused}");
}

#[test]
fn prop_what_is_there_from_the_start_has_a_column_of_its_own() {
    let c = committed();
    let identity = Identity::new(&c, [1, 1], true);
    let place = c.faults.iter().position(|e| e.is_from_start()).unwrap() as u64;
    let plan = c.plan(place).unwrap();
    let row = Row { outcome: Outcome::Again, ..Row::blank(place, plan.seed, plan.drawn) };
    let rows = [&row];
    let report = Report { campaign: &c, identity: &identity, rows: &rows, again: "x" };
    let json = report.json();
    assert_eq!(json["faults"].as_array().unwrap().len(), 1);
    assert_eq!(json["faults"][0]["phases"]["start"]["again"], 1);
    let table = report.table(|entry| &entry.name);
    assert!(table.contains("| 0 1A | – | – |"), "{table}");
    assert!(!report.target_is_met());
}

#[test]
fn prop_the_target_is_missed_by_what_it_forbids() {
    let c = committed();
    let place = |name: &str| c.faults.iter().position(|e| e.name == name).unwrap() as u64;
    let identity = Identity::new(&c, [1, 1], false);
    let met_at = |name: &str, outcome: Outcome, crashed_s: Option<f64>| {
        let row = c.plan(place(name)).map(|p| Row::blank(p.index, p.seed, p.drawn)).unwrap();
        let row = Row { outcome, fault_s: Some(10.0), crashed_s, ..row };
        let rows = [&row];
        let report = Report { campaign: &c, identity: &identity, rows: &rows, again: "x" };
        let json = report.json();
        assert!(report.markdown().contains("| **all** |") && json["faults"][0]["fault"] == name);
        report.target_is_met()
    };
    let met = |name: &str, outcome: Outcome| met_at(name, outcome, None);
    assert!(met("UWB off", Outcome::Landed) && met("UWB off", Outcome::NotTakenOff));
    assert!(!met("UWB off", Outcome::Crashed) && !met("UWB off", Outcome::Left));
    assert!(!met("UWB off", Outcome::Panicked) && !met("UWB off", Outcome::Unfinished));
    assert!(met("a wing lost", Outcome::Crashed) && !met("a wing lost", Outcome::Left));
    // Who stands still does nothing about what the board does alone.
    let pause = "companion stands still for 5 s";
    assert!(met_at(pause, Outcome::Crashed, Some(14.0)));
    assert!(!met_at(pause, Outcome::Crashed, Some(16.0)));
}
