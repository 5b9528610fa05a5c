//! Blocked lines of sight on a made flight: a circle among eight anchors, one blocked on one side.

use crate::util_flights::file::{Event, load_located};
use haltere_core::measure::Tdoa;
use haltere_core::survey::Survey;
use haltere_model::random::Stream;

use super::*;

/// 30 s of a circle of 1.5 m at 1.2 m; `off_m` tells how much too long an anchor's path is.
fn made(off_m: impl Fn(f64, usize) -> f64) -> Flight {
    let corners: Vec<(AnchorId, Vec3<E>)> = (0..8u8)
        .map(|i| {
            let side = |bit: u8| if i & bit == 0 { -3.5 } else { 3.5 };
            (AnchorId(i), Vec3::new(side(1), side(2), if i & 4 == 0 { -0.2 } else { -2.9 }))
        })
        .collect();
    let survey = Survey::new(&corners).unwrap();
    let mut rng = Stream::new(5, "sight");
    let mut events = Vec::new();
    let pos_at = |t_s: f64| {
        let (s, c) = (0.6 * t_s).sin_cos();
        Vec3::<E>::new(1.5 * c, 1.5 * s, -1.2)
    };
    for i in 0..12_000u64 {
        let t_s = i as f64 * 0.0025;
        let at = HostTime::from_us(1_000_000 + i * 2500);
        let (a, b) = ((i % 8) as usize, ((i + 1) % 8) as usize);
        // Without attitude the antenna is taken 9 cm above the pose.
        let tag = pos_at(t_s).raw() + Vector3::new(-0.01245, -0.00127, -0.0908);
        let path = |k: usize| (tag - corners[k].1.raw()).norm() + off_m(t_s, k);
        let distance_diff_m = path(b) - path(a) + 0.06 * rng.normal();
        let (anchor_a, anchor_b) = (AnchorId(a as u8), AnchorId(b as u8));
        events.push(Event {
            at,
            sample: Sample::Tdoa(Tdoa {
                valid_at: at,
                received_at: at,
                anchor_a,
                anchor_b,
                distance_diff_m,
                std_m: None,
            }),
        });
        let pos_E_m = pos_at(t_s - POSE_LATE_S);
        let pose = ReferencePose { valid_at: at, received_at: at, pos_E_m, attitude: None };
        events.push(Event { at, sample: Sample::Pose(pose) });
    }
    Flight { name: "made".into(), survey, events }
}

#[test]
fn prop_a_clear_flight_is_clear_with_the_default_limit_and_with_its_own() {
    let constants = [0.06, -0.05, 0.0, 0.03, -0.04, 0.05, 0.0, -0.02];
    let flight = made(|_, k| constants[k]);
    let found = watch(&flight, &Limit::default());
    // Before the first pose and after the last there is nothing to compare with.
    assert_eq!((found.outcome, found.skipped), (Outcome::NoGap, 4), "{found:?}");
    let limit = Limit::from_clear(std::slice::from_ref(&flight));
    assert_eq!(limit.limit_m, LEAST_LIMIT_M);
    assert_eq!(watch(&flight, &limit).outcome, Outcome::NoGap);
}

#[test]
fn prop_a_blocked_line_is_named_with_its_times_and_place() {
    // Blocked from 8 to 12 s: on the far side of the circle.
    let flight = made(|t_s, k| if k == 5 && (8.0..12.0).contains(&t_s) { 1.6 } else { 0.0 });
    let found = watch(&flight, &Limit::default());
    assert_eq!(found.outcome, Outcome::Named, "{found:?}");
    let b = &found.blocked[0];
    assert_eq!(b.anchor, 5);
    assert!((b.greatest_m - 1.6).abs() < 0.1 && b.times_s.len() == 1);
    let [from, to] = b.times_s[0];
    assert!((from - 8.0).abs() <= 0.5 && (to - 12.0).abs() <= 0.5, "{from} {to}");
    let (s, c) = (0.6f64 * 10.0).sin_cos();
    // Survey x is east.
    assert!((b.place_U_m[0] - 1.5 * s).abs() < 0.5 && (b.place_U_m[1] - 1.5 * c).abs() < 0.5);
    // Three laps, blocked in one of them: at no place in most passes.
    assert_eq!(b.places_blocked, 0);
    assert!(report::text(&[found]).contains("anchor 5"));
}

#[test]
fn prop_a_line_blocked_from_one_side_of_the_room_is_blocked_in_most_passes() {
    let flight = made(|t_s, k| if k == 3 && (0.6 * t_s).cos() > 0.3 { 1.6 } else { 0.0 });
    let b = &watch(&flight, &Limit::default()).blocked[0];
    assert_eq!(b.anchor, 3);
    assert!(b.places_blocked >= 3 && b.places_blocked < b.places_visited, "{b:?}");
    // North of the middle.
    assert!(b.place_U_m[1] > 0.8 && b.times_s.len() >= 3, "{b:?}");
}

#[test]
fn prop_two_blocked_lines_are_both_named() {
    let blocked = |t_s: f64, k| match k {
        2 if (5.0..10.0).contains(&t_s) => 1.4,
        6 if (8.0..15.0).contains(&t_s) => 1.8,
        _ => 0.0,
    };
    let found = watch(&made(blocked), &Limit::default());
    let anchors: Vec<u8> = found.blocked.iter().map(|b| b.anchor).collect();
    assert_eq!((found.outcome, anchors), (Outcome::Several, vec![6, 2]));
}

#[test]
fn prop_too_few_readings_are_not_a_pass() {
    let mut flight = made(|_, _| 0.0);
    flight.events.truncate(100);
    assert_eq!(watch(&flight, &Limit::default()).outcome, Outcome::NotTestable);
}

#[test]
fn val_recorded_flights_are_named_and_cleared_as_their_labels_say() {
    let Some(dir) = crate::recordings::util() else {
        println!("skipped: no data");
        return;
    };
    // Built on the first three; the others were run once when everything was fixed, and came out as
    // here. Wood shades by less than the limit: anchor 1 is off by 0.82 m with the shelf, 0.87 m
    // without.
    let table: [(&str, &[u8]); 12] = [
        ("tdoa_pos/const1-trial1-tdoa2", &[]),
        ("tdoa_pos/const4-trial3-tdoa2-traj1", &[2]),
        ("full/apr26-traj02-tdoa2", &[]),
        ("tdoa_pos/const1-trial1-tdoa3", &[]),
        ("tdoa_pos/const2-trial3-tdoa2", &[]),
        ("tdoa_pos/const4-trial1-tdoa2-traj1", &[]),
        // A metal box that was moved during the flight; nobody wrote down where to.
        ("tdoa_pos/const4-trial5-tdoa2-traj1", &[7, 2]),
        ("full/apr25-traj02-tdoa2", &[]),
        ("full/apr25-traj17-tdoa3", &[]),
        ("full/apr26-traj04-tdoa2-wood", &[]),
        // The metal box stands 1.8 m before anchor 0.
        ("full/apr26-traj11-tdoa2-metal", &[0]),
        ("full/jun05-bolt-test-tdoa2", &[]),
    ];
    for (name, want) in table {
        let flights = load_located(&dir.join(format!("{name}.csv.gz"))).unwrap();
        let found = watch(&flights[0], &Limit::default());
        let anchors: Vec<u8> = found.blocked.iter().map(|b| b.anchor).collect();
        println!("{}", report::text(&[found]));
        assert_eq!(anchors, want, "{name}");
    }
}
