//! One repetition of everything, flown once for all tests here: structure, the laws behind the
//! numbers, a golden of the tables that are quoted elsewhere, and that the page holds every figure.

use std::collections::BTreeSet;
use std::sync::OnceLock;

use super::results::{Cell, Row, Spread, Table, Verdict};
use super::*;

/// The source's figures.
const FIGURES: [&str; 8] = [
    "Figure 3",
    "Figure 4",
    "Figure 5",
    "Figure 6",
    "Figure 7",
    "Figure 8",
    "Figure 9",
    "Figure 10",
];

/// All outcomes, and the simulated seconds that were told and those that were counted.
fn flown() -> &'static (Vec<Outcome>, [u64; 2]) {
    static FLOWN: OnceLock<(Vec<Outcome>, [u64; 2])> = OnceLock::new();
    FLOWN.get_or_init(|| {
        let progress = Progress::silent();
        let bench = Bench { pilot: pilot(None, &[]).unwrap(), repetitions: 1, progress };
        let all: Vec<&Experiment> = EXPERIMENTS.iter().collect();
        let told = EXPERIMENTS.iter().map(|e| (e.cost)(&bench)).sum();
        let outcomes = run_all(&all, &bench);
        (outcomes, [told, bench.progress.done()])
    })
}

fn section(name: &str) -> &'static Section {
    let outcome = flown().0.iter().find(|o| o.experiment.name == name).unwrap();
    outcome.section.as_ref().unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn row(name: &str, what: &str) -> &'static Row {
    let rows = &section(name).rows;
    rows.iter().find(|r| r.what.starts_with(what)).unwrap_or_else(|| {
        panic!("{what}: not among {:?}", rows.iter().map(|r| &r.what).collect::<Vec<_>>())
    })
}

fn ours(name: &str, what: &str) -> f64 {
    row(name, what).ours.mean
}

/// A number of a table, by place.
fn cell(table: &Table, row: usize, column: usize) -> f64 {
    match &table.rows[row][column] {
        Cell::Spread(spread, _) => spread.mean,
        Cell::Text(text) => panic!("{}: {text} is no number", table.title),
    }
}

/// A landing by a weak pack ended in "accelerometer reads another scale" in one of five: the floor carried it while estimate
/// and barometer had it 0.6 m high.
#[test]
fn regress_no_landing_by_a_weak_pack_is_taken_for_a_broken_sensor() {
    let bench =
        Bench { pilot: pilot(None, &[]).unwrap(), repetitions: 5, progress: Progress::silent() };
    super::thrust::run(&bench).unwrap();
}

#[test]
fn prop_every_experiment_runs_and_the_bar_ends_full() {
    let (outcomes, [told, done]) = flown();
    for outcome in outcomes {
        section(outcome.experiment.name);
    }
    assert_eq!(told, done, "the bar counts other seconds than are flown");
    let names: BTreeSet<_> = EXPERIMENTS.iter().map(|e| e.name).collect();
    let numbers: BTreeSet<_> = EXPERIMENTS.iter().map(|e| e.number).collect();
    assert_eq!((names.len(), numbers.len()), (EXPERIMENTS.len(), EXPERIMENTS.len()));
    for e in EXPERIMENTS {
        assert_eq!(find(e.name).unwrap().number, e.number);
        assert_eq!(find(e.number).unwrap().name, e.name);
    }
    let error = find("10").unwrap_err();
    assert!(error.contains("\"10\"") && error.contains("steps (8)"), "{error}");
}

#[test]
fn prop_the_report_stands_alone_and_holds_every_figure() {
    let outcomes = &flown().0;
    let about = About { repetitions: 1, flown_s: 1, took_s: 1.0, changed: &["a<b=1".into()] };
    let page = page::render(outcomes, &about);
    for figure in FIGURES {
        assert!(page.contains(&format!("<h3>{figure}</h3>")), "{figure}");
    }
    assert!(!page.contains("no data in this log"), "a figure is empty");
    for forbidden in ["http:", "https:", "src=", "@import", "NaN", "a<b"] {
        assert!(!page.contains(forbidden), "{forbidden}");
    }
    for e in EXPERIMENTS {
        assert!(page.contains(&format!("id=\"{}\"", e.name)), "{}", e.name);
    }
    let json = print::json(outcomes, &about);
    let text = print::text(outcomes);
    for (e, value) in EXPERIMENTS.iter().zip(json["experiments"].as_array().unwrap()) {
        assert_eq!(value["name"], e.name);
        assert!(value["failed"].is_null() && text.contains(e.title), "{}", e.name);
    }
    let rows = || outcomes.iter().filter_map(|o| o.section.as_ref().ok()).flat_map(|s| &s.rows);
    assert!(rows().all(|r| r.ours.mean.is_finite()), "a number is missing");
    // Whatever the source has is compared, and whatever is not explained says so.
    assert!(rows().filter(|r| r.source.is_some()).count() > 15);
    for r in rows().filter(|r| r.verdict() == Verdict::NotExplained) {
        assert!(r.why_text().starts_with("not explained"), "{}", r.what);
    }
}

#[test]
fn prop_a_failed_experiment_is_reported_and_spares_the_others() {
    let outcomes = [
        Outcome { experiment: &EXPERIMENTS[0], section: Err("seed 7: <fell>".into()) },
        Outcome { experiment: &EXPERIMENTS[1], section: Ok(Section::default()) },
    ];
    let about = About { repetitions: 1, flown_s: 1, took_s: 1.0, changed: &[] };
    let page = page::render(&outcomes, &about);
    assert!(page.contains("FAILED") && page.contains("seed 7: &lt;fell&gt;"));
    assert!(print::text(&outcomes).contains("failed: seed 7"));
}

#[test]
fn val_variable_noise_scatters_less_near_the_floor() {
    let nominal = ours("noise", "scatter, constant over variable noise, nominal");
    assert!((1.02..1.20).contains(&nominal), "{nominal}: 2^(1/8) = 1.09 by theory");
    let bias = ours("noise", "mean error, constant over variable noise, nominal");
    assert!((0.97..1.03).contains(&bias), "{bias}: no choice of noise takes a bias away");
}

#[test]
fn val_uwb_corrects_what_the_imu_alone_cannot() {
    let table = &section("drift").tables[0];
    // Rows: filter, IMU alone with three time constants, gyroscope alone; columns from 1: roll and pitch
    // without a bias of the gyroscope, then with a small one.
    for column in [1, 2] {
        assert!(cell(table, 0, column) < cell(table, 2, column), "accelerometer bias: {table:?}");
    }
    for column in [3, 4] {
        assert!(cell(table, 0, column) < 0.5 * cell(table, 4, column), "drift: {table:?}");
    }
}

#[test]
fn val_extrapolation_is_better_with_more_data() {
    let error = |share: u32| ours("extrapolation", &format!("error from the first {share} %"));
    assert!(
        error(10) > error(30) && error(30) > error(90),
        "{} {} {}",
        error(10),
        error(30),
        error(90)
    );
    assert!(error(90) < 8.0, "{} %", error(90));
}

#[test]
fn val_laws_of_drag_and_thrust() {
    let lean = |vehicle: &str, axis: &str| ours("laws", &format!("{vehicle}, lean in {axis}"));
    // Drag of 4.2 and 1.9 1/s: 23 and 11 degrees at 1 m/s; more drag, more lean.
    assert!((20.0..26.0).contains(&lean("flapper-102g", "pitch")));
    assert!((9.0..15.0).contains(&lean("flapper-102g", "roll")));
    assert!(lean("delfly-nimble-like", "pitch") > lean("flapper-102g", "pitch"));
    let r2 = |order: u32| ours("thrust", &format!("R\u{b2} of order {order}"));
    assert!(r2(1) <= r2(2) && r2(2) <= r2(3) && r2(3) < 1.0, "{} {} {}", r2(1), r2(2), r2(3));
    let ratio = ours("ground", "thrust ratio at 0.33 m");
    assert!((0.90..0.94).contains(&ratio), "{ratio}: 0.92 is simulated");
    // The fit finds the source's equation where the data follow it.
    let lambda = row("ground", "\u{3bb} of equation 7");
    assert!((lambda.trials[0].value / 0.00093 - 1.0).abs() < 0.3, "{lambda:?}");
}

#[test]
fn val_integral_action_makes_up_for_a_wrong_base_thrust() {
    let p = ours("height", "height error, P control");
    let pi = ours("height", "height error, PI control");
    assert!((0.9..1.1).contains(&pi) && p > pi, "P {p}, PI {pi}");
}

#[test]
fn val_modified_is_better_than_raw_by_as_much_as_there_is_drag() {
    let ratio = |axis: &str| {
        let of = |size: u32| ours("steps", &format!("raw over modified, {axis} {size} m"));
        (of(1) + of(2)) / 2.0
    };
    let (x, y, z) = (ratio("x"), ratio("y"), ratio("z"));
    assert!(x > 1.5 && x > y && y > z && z > 0.9, "{x} {y} {z}");
    // With the forward drag sideways too, y gains as x does: this is what the report says of y.
    let y_1 = row("steps", "raw over modified, y 1 m");
    assert!(y_1.trials[0].value > 1.5 && y_1.trials[0].change.contains("drag"), "{y_1:?}");
}

/// What the first repetition gave when this was written; a change of the companion or of the simulator
/// that moves them by more than the tolerance should be meant.
#[test]
fn golden_table_3_and_the_shapes() {
    let steps = &section("steps").tables[0];
    let shapes = &section("shapes").tables[0];
    let measured = [(steps, TABLE_3, 0.05), (shapes, ESTIMATES, 0.15)];
    for (table, golden, tolerance) in measured {
        for (r, row) in golden.iter().enumerate() {
            for (c, value) in row.iter().enumerate() {
                let found = cell(table, r, c + 1);
                assert!(
                    (found / value - 1.0).abs() < tolerance,
                    "{}, {:?}, column {}: {found:.4}, was {value}",
                    table.title,
                    table.rows[r][0],
                    c + 1
                );
            }
        }
    }
}

/// Raw and modified position error, m: x, y, z, 1 m and 2 m each.
const TABLE_3: &[&[f64]] = &[
    &[0.1725, 0.0896],
    &[0.3609, 0.2068],
    &[0.1310, 0.0978],
    &[0.2910, 0.2315],
    &[0.0960, 0.0960],
    &[0.2190, 0.2125],
];
/// Error of the estimate in x, y, z, m, by shape.
const ESTIMATES: &[&[f64]] = &[
    &[0.0125, 0.0227, 0.0487],
    &[0.0118, 0.0144, 0.0475],
    &[0.0151, 0.0143, 0.0357],
    &[0.0141, 0.0141, 0.0378],
];

#[test]
fn prop_spread_of_one_repetition_has_no_deviation() {
    assert_eq!(Spread::of([0.5]).text(2), "0.50");
    assert_eq!(Spread::of([0.4, 0.6]).text(2), "0.50 \u{b1} 0.14");
}
