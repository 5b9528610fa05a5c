//! `haltere-sim hide`: hides an effect in a simulated vehicle, gives the logs alone to the diagnosis, and then tells what was
//! hidden.

mod story;

use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result, anyhow, bail};
use haltere::cli::{gap, print, print_json};
use haltere::ending::Ending;
use haltere::progress::{self, Progress};
use haltere::taped::record;
use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use haltere_gap::bank::{missions, workshop};
use haltere_gap::flight::seal;
use haltere_gap::scene::Scene;
use haltere_model::Plant;
use haltere_sim::hidden::{Candidate, Hidden, candidates};
use rayon::prelude::*;
use serde_json::json;

use crate::leavings;
use story::{Mark, REMARK};

/// Good flights of each of the two missions: fewer than twenty are taken for those of one hour (docs/GAP.md, 2.5).
const GOOD: u64 = 20;
/// Bad flights that the fit does not see: three make an interval.
const HELD_OUT: u64 = 3;
/// How often what is hidden is halved for a vehicle that does not come to the end of its missions: an eighth even
/// of a strong one is half of what can just be detected.
const HALVINGS: usize = 3;
/// What is done before the diagnosis, and what that does, with its usual length on two cores by the small bank, s.
const STAGES: [(&str, f64); 8] = [
    ("flights", 14.0),
    ("reference flights", 3.0),
    ("commissioning", 10.0),
    ("bank", 80.0),
    ("learning the bank", 10.0),
    ("sizes", 30.0),
    ("shrink", 20.0),
    ("cells", 5.0),
];

/// `haltere-sim hide`
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Hides this effect, or `none`; without it one of those that the flight shows, and more than just detectable.
    #[arg(long, value_name = "ID")]
    effect: Option<String>,
    /// Seed of effect, strength, place and flights; without it another one each time.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Folder for flights, envelope and page.
    #[arg(long, value_name = "DIR", default_value = "hidden")]
    out: PathBuf,
    /// Size of the bank, as for `haltere gap diagnose`: `small` for a first look, `full` for verdicts.
    #[arg(long, value_name = "SIZE", default_value = "small")]
    size: String,
    /// Folder of the banks; the user's cache by default.
    #[arg(long, value_name = "DIR")]
    banks: Option<PathBuf>,
    /// Prints the effects and how strong they are hidden, and hides none.
    #[arg(long)]
    list: bool,
    /// Hides every effect of the library in turn and judges one bad flight of each: the verdicts that the same seed gives
    /// with `--effect ID`, before other flights are held against them.
    #[arg(long, conflicts_with = "effect")]
    all: bool,
    /// Prints the result as JSON.
    #[arg(long)]
    json: bool,
}

/// What is flown.
struct Flight {
    path: PathBuf,
    seed: u64,
    bad: bool,
    held_out: bool,
}

/// Hides, flies, asks, and tells; right or wrong, that is the answer.
pub fn run(options: &Options) -> Result<bool> {
    if options.list {
        print(&list())?;
        return Ok(true);
    }
    let began = Instant::now();
    let scene = Scene::lab().map_err(|problems| anyhow!("{problems}"))?;
    let seed = options.seed.unwrap_or_else(any_seed);
    if options.all {
        return run_all(options, &scene, seed);
    }
    let hidden = match options.effect.as_deref() {
        Some("none") => Hidden::none(),
        id => Hidden::draw(id, seed, &scene).with_context(|| {
            let known: Vec<_> = candidates().map(|one| one.spec.id).collect();
            format!(
                "--effect {}: no such effect; none, or one of {}",
                id.unwrap_or_default(),
                known.join(" ")
            )
        })?,
    };
    progress::stages(&STAGES, workshop::costs_file());
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let (bad, good) = plan(options, seed, "bad");
    leavings::say_before(bad.len() + good.len(), leavings::LOG_B, &options.out);
    fly_all(&scene, &Hidden::none(), &good)?;
    let flown = fly_hidden(&scene, hidden, &bad)?;
    let hidden = &flown.hidden;
    let envelope = options.out.join("envelope.json");
    let key = json!({ "id": hidden.id(), "parameters": hidden.values(), "seed": seed });
    let text = serde_json::to_string_pretty(&key)? + "\n";
    haltere_log::written::write::<&Path>(&envelope, &text, &[])?;
    eprintln!(
        "hidden with seed {seed}: {}, SHA-256 {}",
        envelope.display(),
        &seal::digest(text.as_bytes())[..16]
    );
    let report = options.out.join("report.html");
    let flights = flown.to_judge.iter().copied().chain(&good);
    let diagnosis = gap::diagnose(arguments(options, flights, Some(&report)))?;
    let took_s = began.elapsed().as_secs_f64();
    if options.json {
        let mut result = story::result(hidden, &flown.early, &diagnosis);
        result["took_s"] = json!((took_s * 10.0).round() / 10.0);
        result["report"] = json!(report);
        result["seed"] = json!(seed);
        print_json(&result)?;
    } else {
        print(&story::story(hidden, &flown.early, &diagnosis))?;
        print(&format!("PAGE    {}\n", report.display()))?;
        print(&format!("TOOK    {took_s:.0} s by the {} bank\n", options.size))?;
        if options.size == "small" {
            print(&format!(
                "        for a verdict: haltere-sim hide{} --seed {seed} --size full\n",
                asked(options)
            ))?;
        }
        print(&format!("NOTE    {REMARK}\n"))?;
        let logs: Vec<_> = bad.iter().chain(&good).map(|flight| flight.path.clone()).collect();
        leavings::offer(&logs, &options.out, "The page and the envelope stay.");
    }
    Ok(true)
}

/// Every effect of the library in turn, a line each, and how often each word.
fn run_all(options: &Options, scene: &Scene, seed: u64) -> Result<bool> {
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let (_, good) = plan(options, seed, "bad");
    fly_all(scene, &Hidden::none(), &good)?;
    let good: Vec<_> = good.iter().filter(|flight| !flight.held_out).collect();
    let (mut rows, mut marks, mut weaker) = (Vec::new(), Vec::new(), 0);
    for Candidate { spec, .. } in candidates() {
        let id = spec.id;
        let hidden = Hidden::draw(Some(id), seed, scene).context("no such effect")?;
        let (bad, _) = plan(options, seed, &format!("bad-{id}"));
        let flown = fly_hidden(scene, hidden, &bad)?;
        let judged = bad.iter().take(1).chain(good.iter().copied());
        let diagnosis = gap::diagnose(arguments(options, judged, None))?;
        let mark = Mark::of(&flown.hidden, &diagnosis);
        marks.push(mark);
        weaker += usize::from(flown.hidden.halvings > 0);
        if options.json {
            rows.push(story::result(&flown.hidden, &flown.early, &diagnosis));
        } else {
            let halved = "/2".repeat(flown.hidden.halvings);
            let strength = format!("{}{halved}", flown.hidden.strength);
            println!("{id:<5}{:<13}{strength:<23}{}", mark.word(), diagnosis.verdict);
        }
    }
    let count = |mark: Mark| marks.iter().filter(|m| **m == mark).count();
    if options.json {
        let result = json!({
            "seed": seed,
            "right": count(Mark::Right),
            "of": candidates().count(),
            "halved": weaker,
            "effects": rows,
        });
        println!("{}", serde_json::to_string_pretty(&result)?);
    } else {
        let counted = Mark::ALL.map(|mark| format!("{} {}", mark.word(), count(mark))).join(", ");
        println!(
            "of {} with seed {seed} by the {} bank: {counted}; {weaker} were halved for flights that ended early",
            candidates().count(),
            options.size
        );
    }
    Ok(true)
}

fn asked(options: &Options) -> String {
    options.effect.as_ref().map_or(String::new(), |id| format!(" --effect {id}"))
}

/// Another one each time, short enough to be typed.
fn any_seed() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::from(now.subsec_nanos()) % 100_000
}

/// Flights of the vehicle with the effect, the one to be diagnosed first, and of the healthy one.
fn plan(options: &Options, seed: u64, name: &str) -> (Vec<Flight>, Vec<Flight>) {
    let one = |name: String, number: u64, bad, held_out| Flight {
        path: options.out.join(format!("{name}.mcap")),
        seed: seed.wrapping_mul(1000).wrapping_add(number),
        bad,
        held_out,
    };
    let good = (1..=GOOD).flat_map(|n| {
        [
            one(format!("good-{n:02}"), n, false, false),
            one(format!("good-held-out-{n:02}"), 100 + n, false, true),
        ]
    });
    let bad = std::iter::once(one(name.to_owned(), 200, true, false));
    let held_out = (1..=HELD_OUT).map(|n| one(format!("{name}-held-out-{n}"), 300 + n, true, true));
    (bad.chain(held_out).collect(), good.collect())
}

/// What was hidden in the end, and in which flights.
struct Flown<'a> {
    hidden: Hidden,
    /// What was done about flights that ended early.
    early: Vec<String>,
    /// The one to be diagnosed, and those of the others that can be held against it.
    to_judge: Vec<&'a Flight>,
}

/// Flies the vehicle with what is hidden, and with half of it where a flight does not come to the end of its mission: a
/// flight that ends early shows little, and most effects look alike in it.
fn fly_hidden<'a>(scene: &Scene, mut hidden: Hidden, flights: &'a [Flight]) -> Result<Flown<'a>> {
    let mut early = Vec::new();
    loop {
        fly_all(scene, &hidden, flights)?;
        let read = |flight: &Flight| {
            Ending::of(&flight.path).with_context(|| flight.path.display().to_string())
        };
        let endings = flights.par_iter().map(read).collect::<Result<Vec<_>>>()?;
        let first = flights.iter().zip(&endings).find_map(|(f, e)| Some((f, e.early.as_ref()?)));
        let last = hidden.spec.is_none() || hidden.halvings == HALVINGS;
        if let Some((flight, words)) = first {
            let then = if last { "judged as it is" } else { "flown again with half of it" };
            let line = format!("{}: {words}: {then}", flight.path.display());
            eprintln!("{line}");
            early.push(line);
            if !last {
                hidden = hidden.halved();
                continue;
            }
        }
        let usable = |(k, ending): &(usize, &Ending)| *k == 0 || ending.refused.is_none();
        let to_judge = endings.iter().enumerate().filter(usable).map(|(k, _)| &flights[k]);
        return Ok(Flown { hidden, early, to_judge: to_judge.collect() });
    }
}

fn fly_all(scene: &Scene, hidden: &Hidden, flights: &[Flight]) -> Result<()> {
    let missions = [missions::diagnostic(scene), missions::held_out(scene)];
    let progress = Progress::new("flights");
    let done = std::sync::atomic::AtomicUsize::new(0);
    flights.par_iter().try_for_each(|flight| {
        let items = &missions[usize::from(flight.held_out)];
        fly_one(scene, hidden, flight, items).with_context(|| flight.path.display().to_string())?;
        let now = 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        progress.at(now, flights.len());
        Ok(())
    })
}

/// A vehicle that crashes or refuses to fly is a flight too, but not a good one.
fn fly_one(
    scene: &Scene,
    hidden: &Hidden,
    flight: &Flight,
    items: &[MISSION_ITEM_INT_DATA],
) -> Result<()> {
    let plant = hidden.within(scene.plant(flight.seed)).and_then(Plant::new);
    let plant = plant.map_err(|problems| anyhow!("{problems}"))?;
    let outcome = record(scene, plant, items, &flight.path)?;
    if !flight.bad && !outcome.landed {
        bail!("a healthy vehicle did not come down on its feet");
    }
    Ok(())
}

/// What `haltere gap diagnose` is given: logs, and nothing of the envelope.
fn arguments<'a>(
    options: &Options,
    flights: impl Iterator<Item = &'a Flight> + Clone,
    report: Option<&Path>,
) -> Vec<std::ffi::OsString> {
    let mut args: Vec<std::ffi::OsString> = Vec::new();
    for flight in flights.clone().filter(|flight| flight.bad) {
        args.push(flight.path.clone().into());
    }
    for (option, held_out) in [("--reference", false), ("--held-out-reference", true)] {
        let good = flights.clone().filter(|flight| !flight.bad && flight.held_out == held_out);
        for flight in good {
            args.extend([option.into(), flight.path.clone().into()]);
        }
    }
    args.extend(["--size".into(), options.size.clone().into(), "--without-advice".into()]);
    if let Some(report) = report {
        args.extend(["--report".into(), report.into(), "--remark".into(), REMARK.into()]);
    }
    if let Some(banks) = &options.banks {
        args.extend(["--banks".into(), banks.into()]);
    }
    args
}

/// The effects that can be hidden, and how strong.
fn list() -> String {
    use std::fmt::Write;
    let mut out = String::from(
        "id    effect                              share of the strong end: low, middle, high\n",
    );
    for Candidate { spec, strengths: [low, middle, high], shown } in candidates() {
        let why = if shown { "" } else { "   not by chance: the flight does not show it" };
        let _ =
            writeln!(out, "{:<5} {:<36}{low:.2} {middle:.2} {high:.2}{why}", spec.id, spec.name);
    }
    out += "Parameters and their plausible ranges: docs/EFFECTS.md, or `haltere-sim effects`.\n";
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(out: &Path, effect: Option<&str>) -> Options {
        Options {
            effect: effect.map(str::to_owned),
            seed: Some(1),
            out: out.to_owned(),
            size: "smallest".to_owned(),
            banks: None,
            list: false,
            all: false,
            json: false,
        }
    }

    #[test]
    fn prop_an_effect_that_there_is_not_is_refused_before_anything_is_flown() {
        let folder = tempfile::tempdir().unwrap();
        let refused = run(&options(folder.path(), Some("Z9"))).unwrap_err().to_string();
        assert!(refused.contains("--effect Z9") && refused.contains("P1"), "{refused}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn prop_the_diagnosis_is_asked_as_a_person_would_ask_it_and_sees_no_envelope() {
        let folder = tempfile::tempdir().unwrap();
        let options = options(folder.path(), None);
        let (bad, good) = plan(&options, 1, "bad");
        let page = folder.path().join("report.html");
        let args = arguments(&options, bad.iter().chain(&good), Some(&page));
        assert!(args.iter().all(|arg| !arg.to_string_lossy().contains("envelope")), "{args:?}");
        // Its options are understood: what is missing is the flight.
        let refused = gap::diagnose(args).unwrap_err().to_string();
        assert!(refused.contains("bad.mcap"), "{refused}");
    }

    #[test]
    fn prop_the_list_has_every_effect_that_can_be_hidden() {
        assert_eq!(list().lines().count(), candidates().count() + 2);
    }
}
