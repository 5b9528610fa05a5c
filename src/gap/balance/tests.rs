//! The balance on made flights, whose causes are known to the digit.

use haltere_core::frames::G_MPS2;
use haltere_log::import::motors::{Dropped, MotorFlight, MotorRow};
use haltere_model::rotorcraft::Rotorcraft;

use super::causes::Cause;
use super::fill::fill;
use super::flown::{Answer, FLIGHTS, fly_bank};
use super::hover::Hover;
use super::judge::Judge;
use crate::outcome::Outcome;

fn vehicle() -> Rotorcraft {
    Rotorcraft::from_toml(include_str!("../../../sim/rotorcraft/crazyflie-2.1.toml")).unwrap()
}

/// 20 s at 100 Hz, 12 of them in hover, where the motors are told these shares of a hovering thrust.
fn flight(name: &str, shares: [f64; 4], trembling: f64) -> MotorFlight {
    let hover = 0.027 * G_MPS2 / 4.0 / 0.147;
    let row = |k: u32| {
        let t_s = f64::from(k) * 0.01;
        let is_up = (4.0..16.0).contains(&t_s);
        let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        let of = [1.0, 1.0, -1.0, -1.0].map(|side: f64| 1.0 + side * sign * trembling);
        let command_frac =
            [0, 1, 2, 3].map(|m| if is_up { hover * shares[m] * of[m] } else { 0.0 });
        let height_m = Some(if is_up { 0.5 } else { 0.0 });
        MotorRow {
            t_s,
            command_frac,
            supply_v: None,
            height_m,
            speed_mps: Some(0.0),
            accel_g: [None; 3],
        }
    };
    let rows = (0..2000).map(row).collect();
    MotorFlight { name: name.into(), commands: "made".into(), rows, dropped: Dropped::default() }
}

fn hover(name: &str, shares: [f64; 4], trembling: f64) -> Hover {
    Hover::of(&flight(name, shares, trembling), &vehicle()).unwrap()
}

/// Four accepted flights of a vehicle with trims, as they scatter from hour to hour.
fn references() -> Vec<Hover> {
    let trims = [1.02, 0.95, 1.12, 0.9];
    [1.0, 1.004, 0.997, 1.002]
        .iter()
        .map(|all| hover("r", trims.map(|trim| trim * all), 0.02))
        .collect()
}

fn judged(changed: [f64; 4], trembling: f64) -> super::Report {
    let (references, vehicle) = (references(), vehicle());
    let trims = [1.02, 0.95, 1.12, 0.9];
    let shares = [0, 1, 2, 3].map(|m| trims[m] * changed[m]);
    let report =
        Judge::new(&references, &vehicle).unwrap().report(&hover("f", shares, trembling), &[]);
    println!("{}", report.text());
    report
}

#[test]
fn prop_a_healthy_flight_is_no_gap_and_says_what_could_have_been_seen() {
    let report = judged([1.01, 0.99, 1.01, 1.0], 0.02);
    assert_eq!(report.outcome, Outcome::NoMaterialGap);
    let [loss, load, shaking] = [0, 1, 2].map(|k| report.can_show[k].size.unwrap());
    assert!((0.03..0.12).contains(&loss), "{loss}");
    assert!((2e-4..1.5e-3).contains(&load), "{load}");
    assert!((1.5..4.0).contains(&shaking), "{shaking}");
    assert!(!report.not_checked.is_empty());
}

#[test]
fn prop_what_could_just_be_seen_is_seen_and_half_of_it_is_not() {
    let loss = judged([1.0; 4], 0.02).can_show[0].size.unwrap();
    let weak = |loss: f64| judged([1.0, 1.0, 1.0 / (1.0 - loss), 1.0], 0.02).outcome.kind();
    assert!(weak(1.2 * loss).is_gap());
    assert!(!weak(0.5 * loss).is_gap());
}

#[test]
fn prop_a_cut_propeller_shakes_a_load_does_not_and_without_that_they_are_a_set() {
    let weak = [1.0, 1.0, 1.0 / 0.75, 1.0];
    let report = judged(weak, 0.06);
    let Outcome::Named { effect } = &report.outcome else { panic!("{:?}", report.outcome) };
    assert_eq!(effect.id, "weak_motor M3");
    assert!((effect.theta[0] - 0.25).abs() < 0.04, "{effect:?}");
    let report = judged(weak, 0.02);
    let ids: Vec<&str> = report.outcome.effects().iter().map(|e| e.id.as_str()).collect();
    assert_eq!(ids, ["weak_motor M3", "load M3"]);
    // A tenth of the mass at motor 3: three tenths more there, a tenth beside it, a tenth less across.
    let report = judged([0.9, 1.1, 1.3, 1.1], 0.02);
    let Outcome::Named { effect } = &report.outcome else { panic!("{:?}", report.outcome) };
    assert_eq!(effect.id, "load M3");
    assert!((effect.theta[0] - 0.0027).abs() < 4e-4, "{effect:?}");
    let [low, high] = effect.theta_90[0];
    assert!(low < 0.0027 && 0.0027 < high, "{effect:?}");
}

#[test]
fn prop_two_weak_motors_are_a_set_at_these_two() {
    let report = judged([1.2, 1.2, 1.0, 1.0], 0.02);
    let places: Vec<Vec<usize>> =
        report.outcome.effects().iter().map(|e| Cause::find(&e.id).unwrap().motors).collect();
    assert!(!places.is_empty() && places.iter().all(|p| p == &[1, 2]), "{places:?}");
}

#[test]
fn prop_another_vehicle_is_no_fault_of_this_one() {
    let report = judged([0.85, 1.15, 0.8, 1.2], 0.02);
    assert!(matches!(report.outcome, Outcome::NotInLibrary { .. }));
    assert!(report.verdict.starts_with("This is another vehicle"), "{}", report.verdict);
}

#[test]
fn prop_the_accelerometer_tells_another_vehicle_from_a_weak_motor() {
    let vehicle = vehicle();
    let trims = [1.02, 0.95, 1.12, 0.9];
    let of = |changed: f64, offset_g: f64| {
        let mut made = flight("f", [trims[0] * changed, trims[1], trims[2], trims[3]], 0.02);
        made.rows.iter_mut().for_each(|row| row.accel_g = [Some(offset_g), Some(0.0), None]);
        Hover::of(&made, &vehicle).unwrap()
    };
    let references = [of(1.0, 0.002), of(1.002, 0.0), of(0.998, -0.002)];
    let judge = Judge::new(&references, &vehicle).unwrap();
    let own = judge.report(&of(1.15, 0.0), &[]);
    assert_eq!(own.outcome.effects()[0].id, "weak_motor M1", "{}", own.text());
    let other = judge.report(&of(1.15, 0.05), &[]);
    assert!(
        other.another_vehicle > 0.4 && other.verdict.contains("+50 forward"),
        "{}",
        other.text()
    );
}

#[test]
fn prop_what_only_shakes_is_a_propeller_or_a_swinging_load() {
    let report = judged([1.0; 4], 0.06);
    let ids: Vec<&str> = report.outcome.effects().iter().map(|e| e.id.as_str()).collect();
    assert!(ids.contains(&"unbalanced") && ids.contains(&"swinging"), "{ids:?}");
    assert!(report.verdict.contains("3.0 times as much"), "{}", report.verdict);
}

#[test]
fn prop_the_explanation_of_one_flight_foretells_another() {
    let (references, vehicle) = (references(), vehicle());
    let shares = [0.9, 1.1, 1.3, 1.1];
    let trims = [1.02, 0.95, 1.12, 0.9];
    let of =
        |name: &str, all: f64| hover(name, [0, 1, 2, 3].map(|m| all * trims[m] * shares[m]), 0.02);
    let report = Judge::new(&references, &vehicle).unwrap().report(&of("a", 1.0), &[of("b", 1.01)]);
    assert!(report.held_out.unwrap().shrink > 0.9);
}

#[test]
fn prop_what_cannot_be_judged_is_refused_in_words() {
    let vehicle = vehicle();
    let references = references();
    let few = Judge::new(&references[..1], &vehicle).err().unwrap().to_string();
    assert!(few.contains("1 accepted flights") && few.contains("--reference"), "{few}");
    let mut short = flight("short", [1.0; 4], 0.0);
    short.rows.truncate(600);
    let why = Hover::of(&short, &vehicle).unwrap_err();
    assert!(why.starts_with("it hovers 2.0 s"), "{why}");
    let mut by_voltage = vehicle.clone();
    by_voltage.thrust.voltage_exponent = 1.0;
    assert!(Hover::of(&short, &by_voltage).unwrap_err().contains("was not logged"));
    let mut low = flight("low", [1.0; 4], 0.02);
    low.rows.iter_mut().for_each(|row| row.height_m = None);
    let low = Hover::of(&low, &vehicle).unwrap();
    assert!(!low.by_height && low.hover_s > 10.0);
    let mut fast = flight("fast", [1.0; 4], 0.02);
    fast.rows.iter_mut().for_each(|row| row.speed_mps = Some(row.t_s));
    assert_eq!(
        Hover::of(&fast, &vehicle).unwrap_err(),
        "it hovers 0.0 s at one height, 5 s are due"
    );
}

#[test]
fn prop_a_file_is_filled_from_hover_and_says_what_hover_does_not_show() {
    let mut vehicle = vehicle();
    vehicle.thrust.voltage_exponent = 2.0;
    // The pack empties from 4.0 to 3.6 V, thrust goes with the square of it, and all motors give a tenth less than the file says.
    let flights: Vec<MotorFlight> = [1.0, 1.01, 0.99]
        .iter()
        .map(|all| {
            let mut made = flight("a", [all / 0.9; 4], 0.01);
            for row in &mut made.rows {
                let volt = 4.0 - 0.02 * row.t_s;
                row.supply_v = Some(volt);
                let times = (3.7 / volt).powi(2);
                row.command_frac.iter_mut().for_each(|u| *u *= times);
            }
            made
        })
        .collect();
    let filled = fill(&flights, &vehicle).unwrap();
    let [full] = &filled.constants[..] else { panic!("{filled:?}") };
    assert!((full.value / vehicle.thrust.full_n - 0.9).abs() < 0.005, "{full:?}");
    assert!(full.low < full.value && full.value < full.high);
    vehicle.thrust.voltage_exponent = 0.0;
    let filled = fill(&flights, &vehicle).unwrap();
    assert!((filled.constants[1].value - 2.0).abs() < 0.05, "{filled:?}");
    assert!(filled.text().contains("drag_per_s"), "{}", filled.text());
    let text = include_str!("../../../sim/rotorcraft/crazyflie-2.1.toml");
    let new = Rotorcraft::from_toml(&filled.into_text(text).unwrap()).unwrap();
    assert!((new.thrust.voltage_exponent - 2.0).abs() < 0.05 && new.mass_kg == vehicle.mass_kg);
    assert!(fill(&flights[..2], &vehicle).unwrap_err().to_string().contains("at least 3"));
}

/// A simulator that flies as [`flight`] does, but for a weak motor, which it makes weaker than it was told.
fn answer(request: &str) -> Answer {
    let asked: serde_json::Value = serde_json::from_str(request).unwrap();
    let mut shares = [1.0; 4];
    for effect in asked["effects"].as_array().unwrap() {
        if effect["id"] == "weak_motor" {
            let motor = effect["motor"].as_u64().unwrap() as usize;
            shares[motor - 1] /= 1.0 - 1.5 * effect["size"].as_f64().unwrap();
        }
    }
    let rows = flight("s", shares, 0.02).rows;
    let rows: Vec<Vec<f64>> = rows
        .iter()
        .map(|r| [&[r.t_s][..], &r.command_frac, &[r.height_m.unwrap()]].concat())
        .collect();
    let columns = ["t_s", "m1", "m2", "m3", "m4", "height_m"];
    let line = serde_json::json!({ "flight": asked["flight"], "columns": columns, "rows": rows });
    serde_json::from_value(line).unwrap()
}

#[test]
fn prop_what_a_cause_does_is_taken_from_a_simulator_and_what_it_lacks_from_the_formula() {
    let (references, vehicle) = (references(), vehicle());
    let flown = fly_bank(&vehicle, &mut |request| {
        let text = serde_json::to_string(request).unwrap();
        if text.contains("load") { Err("it fell".into()) } else { Ok(answer(&text)) }
    })
    .unwrap();
    assert_eq!((flown.flights, &flown.lost_words()[..]), (FLIGHTS, "12 of 27: it fell"));
    let shares = [1.02, 0.95, 1.12 / 0.7, 0.9];
    let report = Judge::with(&references, &vehicle, Some(&flown))
        .unwrap()
        .report(&hover("f", shares, 0.06), &[]);
    let effect = &report.outcome.effects()[0];
    // Three tenths less thrust, which this simulator makes of a loss of a fifth.
    assert_eq!(effect.id, "weak_motor M3");
    assert!((effect.theta[0] - 0.2).abs() < 0.03, "{effect:?}");
    let told = report.text();
    assert!(told.contains("flew 15 of 27 flights") && told.contains("12 lost: it fell"), "{told}");
}

#[test]
fn prop_a_simulator_that_lies_is_told_and_counted() {
    let vehicle = vehicle();
    let lie = |line: &str| {
        let line = line.to_owned();
        fly_bank(&vehicle, &mut |_| serde_json::from_str(&line).map_err(|why| why.to_string()))
            .unwrap_err()
    };
    for (line, told) in [
        ("{\"flight\": 0, \"error\": \"crashed\"}", "3 of 3: the simulator says: crashed"),
        ("{\"flight\": 0, \"columns\": [\"t_s\"], \"rows\": []}", "no column m1"),
        (
            "{\"flight\": 0, \"columns\": [\"t_s\", \"m1\", \"m2\", \"m3\", \"m4\"], \"rows\": [[0, 7, 0, 0, 0]]}",
            "a command is 7",
        ),
        (
            "{\"flight\": 0, \"columns\": [\"t_s\", \"m1\", \"m2\", \"m3\", \"m4\"], \"rows\": [[0]]}",
            "a row of 1 values under 5",
        ),
        (
            "{\"flight\": 0, \"columns\": [\"t_s\", \"m1\", \"m2\", \"m3\", \"m4\"], \"rows\": []}",
            "it has no rows",
        ),
    ] {
        let why = lie(line);
        assert!(why.starts_with("no healthy flight") && why.contains(told), "{why}");
    }
}
