//! Tests of leaving out anchors: the arithmetic by exact geometry, and in the filter on a made-up flight.

use nalgebra::Vector3;

use super::bias::Pair;
use super::filter_tests::{Run, middle, quiet};
use super::isolation::{Isolation, LeaveOut, Normal, inverse};
use super::truth::{Noise, Truth, hall};
use super::*;
use crate::measure::Tdoa;

/// No bound on where the position is.
const ANYWHERE: [Vector3<f64>; 2] = [Vector3::new(-1e3, -1e3, -1e3), Vector3::new(1e3, 1e3, 1e3)];

fn at(turn: u64) -> HostTime {
    HostTime::from_us(1_000_000 + 20_000 * turn)
}

/// What is tried: a vehicle at `p`, range biases, and where the position may be found.
struct Case<'a> {
    p: Vector3<f64>,
    bias_m: &'a [f64; 8],
    reach_E_m: [Vector3<f64>; 2],
}

impl<'a> Case<'a> {
    fn new(p: Vector3<f64>, bias_m: &'a [f64; 8]) -> Self {
        Self { p, bias_m, reach_E_m: ANYWHERE }
    }
}

/// The vehicle's filter has it `off` from there, for `turns` of 20 ms: ring of neighbours. Who was left out, and
/// when.
fn fly(
    it: &mut Isolation,
    from: u64,
    turns: u64,
    Case { p, bias_m, reach_E_m }: &Case<'_>,
    off: &mut Vector3<f64>,
    noise: &mut Noise,
) -> Vec<(u64, LeaveOut)> {
    let survey = hall();
    let config = IsolationConfig { leave_out: true, ..IsolationConfig::default() };
    let site = |id: usize| survey.position_E_m(AnchorId(id as u8)).unwrap().raw();
    let mut done = Vec::new();
    for turn in from..from + turns {
        for a in 0..8 {
            let b = (a + 1) % 8;
            let reads = |i: usize, p: Vector3<f64>| (p - site(i)).norm();
            let p_hat = *p + *off;
            let z = reads(b, *p) + bias_m[b] - reads(a, *p) - bias_m[a] + 0.1 * noise.normal();
            let h = (p_hat - site(b)).normalize() - (p_hat - site(a)).normalize();
            it.note(Pair { a, b }, &h, z - (reads(b, p_hat) - reads(a, p_hat)));
        }
        if let Some(out) = it.judge(&config, at(turn), reach_E_m) {
            *off += out.shift_E_m;
            done.push((turn - from, out));
        }
    }
    done
}

fn usual(noise: &mut Noise) -> [f64; 8] {
    std::array::from_fn(|_| 0.1 * noise.normal())
}

#[test]
fn prop_sound_anchors_are_left_alone_wherever_the_filter_is() {
    let mut noise = Noise(7);
    for n in 0..40 {
        let p = middle() + noise.vector(1.5);
        let mut off = noise.vector(0.4);
        let sound = usual(&mut noise);
        let done =
            fly(&mut Isolation::default(), 0, 100, &Case::new(p, &sound), &mut off, &mut noise);
        assert!(done.is_empty(), "{n}: {done:?}");
    }
}

#[test]
fn prop_one_that_is_off_is_found_wherever_it_hangs_and_comes_back() {
    let mut noise = Noise(8);
    for n in 0..40 {
        let (wrong, by_m) = (n % 8, if n % 2 == 0 { 2.0 } else { -2.0 });
        let p = middle() + noise.vector(1.0);
        let mut off = noise.vector(0.3);
        let mut bias_m = usual(&mut noise);
        bias_m[wrong] += by_m;
        let mut it = Isolation::default();
        let done = fly(&mut it, 0, 100, &Case::new(p, &bias_m), &mut off, &mut noise);
        let [(turn, LeaveOut { rank, bias_m: found_m, std_m, .. })] = done[..] else {
            panic!("{n}: at {p:?} {off:?} {bias_m:?}: {done:?}")
        };
        assert_eq!(rank, wrong, "{n}");
        assert!(turn < 50, "{n}: after {turn} turns of 20 ms");
        assert!((found_m - by_m).abs() < 0.6, "{n}: {found_m} m");
        // The position is where the other seven have it, and known about as well as is said.
        assert!(off.norm() < 3.0 * std_m && off.norm() < 0.6, "{n}: {off} of {std_m}");
        assert!(it.is_out(wrong));
        bias_m[wrong] -= by_m;
        let done = fly(&mut it, 100, 400, &Case::new(p, &bias_m), &mut off, &mut noise);
        assert!(done.is_empty() && !it.left_out().contains(&true), "{n}: {done:?}");
    }
}

#[test]
fn prop_two_at_once_are_not_blamed_on_a_third() {
    let mut noise = Noise(9);
    for n in 0..40 {
        let pair = [n % 8, (n + 3) % 8];
        let mut bias_m = usual(&mut noise);
        for i in pair {
            bias_m[i] += 1.5;
        }
        let p = middle() + noise.vector(1.0);
        let done = fly(
            &mut Isolation::default(),
            0,
            200,
            &Case::new(p, &bias_m),
            &mut Vector3::zeros(),
            &mut noise,
        );
        for (_, out) in &done {
            assert!(pair.contains(&out.rank), "{n}: {pair:?} are off, {done:?}");
        }
    }
}

#[test]
fn prop_anchors_that_contradict_one_another_are_told_of_though_none_can_be_named() {
    let mut noise = Noise(11);
    let mut unnamed = 0;
    for n in 0..40 {
        let mut it = Isolation::default();
        let (sound, p) = (usual(&mut noise), middle() + noise.vector(1.0));
        fly(&mut it, 0, 100, &Case::new(p, &sound), &mut Vector3::zeros(), &mut noise);
        assert!(it.contradicted_by_E_m().is_none(), "{n}: all are sound");
        let mut bias_m = sound;
        for i in [n % 8, (n + 2) % 8, (n + 5) % 8] {
            bias_m[i] += 3.0;
        }
        let done =
            fly(&mut it, 100, 100, &Case::new(p, &bias_m), &mut Vector3::zeros(), &mut noise);
        assert!(
            !done.is_empty() || it.contradicted_by_E_m().is_some(),
            "{n}: neither named nor told"
        );
        unnamed += usize::from(it.contradicted_by_E_m().is_some());
    }
    assert!(unnamed > 20, "{unnamed}");
}

#[test]
fn prop_two_blocked_anchors_are_told() {
    let mut noise = Noise(13);
    let (mut told, mut pairs) = (0, 0);
    for i in 0..8 {
        for j in i + 1..8 {
            let (mut it, p) = (Isolation::default(), middle() + noise.vector(1.0));
            let mut bias_m = usual(&mut noise);
            bias_m[i] += 1.5;
            bias_m[j] += 1.5;
            let mut off = Vector3::zeros();
            let done = fly(&mut it, 0, 100, &Case::new(p, &bias_m), &mut off, &mut noise);
            pairs += 1;
            told += usize::from(!done.is_empty() || it.contradicted_by_E_m().is_some());
        }
    }
    println!("{told} of {pairs}");
    assert!(told > 20, "{told} of {pairs}");
}

#[test]
fn prop_an_anchor_is_not_left_out_for_a_place_where_the_vehicle_cannot_be() {
    let mut noise = Noise(12);
    let mut bias_m = usual(&mut noise);
    bias_m[3] += 2.0;
    let anywhere = Case::new(middle(), &bias_m);
    let near = Case {
        reach_E_m: [Vector3::repeat(-0.3), Vector3::repeat(0.3)],
        ..Case::new(middle(), &bias_m)
    };
    let (mut it, mut off) = (Isolation::default(), Vector3::new(0.0, 0.0, 1.0));
    let done = fly(&mut it, 0, 100, &near, &mut off, &mut noise);
    assert!(done.is_empty() && it.contradicted_by_E_m().is_some(), "{done:?}");
    assert_eq!(fly(&mut it, 100, 100, &anywhere, &mut off, &mut noise).len(), 1);
    assert!(it.contradicted_by_E_m().is_none());
}

#[test]
fn prop_without_redundancy_nobody_is_named() {
    // Six anchors heard.
    let mut noise = Noise(10);
    let (survey, p) = (hall(), middle());
    let config = IsolationConfig { leave_out: true, ..IsolationConfig::default() };
    let site = |id: usize| survey.position_E_m(AnchorId(id as u8)).unwrap().raw();
    let mut it = Isolation::default();
    for turn in 0..200 {
        for a in 0..6 {
            let b = (a + 1) % 6;
            let h = (p - site(b)).normalize() - (p - site(a)).normalize();
            let wrong = |i: usize| if i == 2 { 3.0 } else { 0.0 };
            it.note(Pair { a, b }, &h, wrong(b) - wrong(a) + 0.1 * noise.normal());
        }
        assert_eq!(it.judge(&config, at(turn), &ANYWHERE), None);
    }
}

fn leaving_out() -> EstimatorConfig {
    EstimatorConfig {
        isolation: IsolationConfig { leave_out: true, ..IsolationConfig::default() },
        ..quiet()
    }
}

fn spoil(t: &mut Tdoa) {
    t.distance_diff_m += if t.anchor_b.0 == 6 { 2.5 } else { 0.0 };
    t.distance_diff_m -= if t.anchor_a.0 == 6 { 2.5 } else { 0.0 };
}

#[test]
fn prop_the_filter_flies_on_by_the_others_and_says_so() {
    let plain = leaving_out();
    let biased = EstimatorConfig {
        anchor_bias: AnchorBias { estimate: true, ..AnchorBias::default() },
        quality: Quality { learn: true, ..Quality::default() },
        covariance_step_s: 0.004,
        gate: GateConfig { sigma: 10.0, tail_sigma: 1.4, reject: false, ..GateConfig::default() },
        ..plain.clone()
    };
    for config in [plain, biased] {
        let mut run = Run::aligned(config, Truth::flying(middle()));
        run.fly(3.0);
        assert_eq!(run.estimator.estimate().health, Health::Good);
        run.fly_spoiled(4.0, spoil);
        assert_eq!(run.estimator.left_out().collect::<Vec<_>>(), [AnchorId(6)]);
        let now = run.estimator.estimate().at;
        assert_eq!(run.estimator.estimate().health, Health::Degraded);
        assert_eq!(run.estimator.misgiving(now), Some(Misgiving::LeftOut(AnchorId(6))));
        assert_eq!(run.estimator.counts().left_out, 1);
        assert!(run.error_m() < 0.3, "{}", run.error_m());
        run.fly(6.0);
        assert_eq!(run.estimator.left_out().count(), 0);
        assert_eq!(run.estimator.estimate().health, Health::Good);
        assert!(run.error_m() < 0.2, "{}", run.error_m());
    }
}

#[test]
fn prop_whoever_was_left_out_is_judged_anew_on_the_floor() {
    let mut run = Run::aligned(leaving_out(), Truth::flying(middle()));
    run.fly(2.0);
    run.fly_spoiled(3.0, spoil);
    assert_eq!(run.estimator.left_out().count(), 1);
    run.estimator.set_airborne(false);
    // Otherwise health would stay degraded there for ever, and arming be refused with it.
    assert_eq!(run.estimator.left_out().count(), 0);
    let now = run.estimator.estimate().at;
    assert_eq!(run.estimator.estimate_at(now).health, Health::Good);
}

#[test]
fn prop_health_tells_that_too_few_are_heard() {
    let mut run = Run::aligned(leaving_out(), Truth::flying(middle()));
    run.fly(2.0);
    let now = run.estimator.estimate().at;
    assert_eq!(run.estimator.estimate_at(now.offset_us(200_000)).health, Health::Good);
    assert_eq!(run.estimator.estimate_at(now.offset_us(400_000)).health, Health::Degraded);
    assert_eq!(run.estimator.estimate_at(now.offset_us(2_500_000)).health, Health::Lost);
    // A measurement of an unknown anchor is none.
    run.fly_spoiled(2.0, |t| {
        if [t.anchor_a.0, t.anchor_b.0].iter().any(|id| [0, 3, 5].contains(id)) {
            t.anchor_a = AnchorId(99);
        }
    });
    let now = run.estimator.estimate().at;
    assert_eq!(run.estimator.estimate().health, Health::Degraded);
    let few = Misgiving::FewAnchors { heard: 4, least: 7 };
    assert_eq!(run.estimator.misgiving(now), Some(few));
    assert_eq!(few.to_string(), "4 anchors heard, 7 needed to find a wrong one");
    // The gravest is told.
    let later = now.offset_us(2_500_000);
    assert!(matches!(run.estimator.misgiving(later), Some(Misgiving::NothingFused { .. })));
}

/// The fault: after 10 s without UWB the estimate was called good with the first measurements, and was more than 1 m off for 3 s more.
#[test]
fn regress_after_a_loss_in_the_air_health_waits_until_the_estimate_has_settled() {
    let mut run = Run::aligned(leaving_out(), Truth::flying(middle()));
    run.fly(2.0);
    let nothing = |t: &mut Tdoa| t.anchor_a = AnchorId(99);
    run.fly_spoiled(1.0, nothing);
    run.fly(1.0);
    assert_eq!(run.estimator.estimate().health, Health::Good, "a short one is none");
    run.fly_spoiled(2.5, nothing);
    run.fly(1.0);
    let now = run.estimator.estimate().at;
    assert!(
        matches!(run.estimator.misgiving(now), Some(Misgiving::Returns { since_s }) if since_s < 1.1)
    );
    assert_eq!(run.estimator.estimate().health, Health::Degraded);
    let mut landed = run.estimator.clone();
    landed.set_airborne(false);
    assert_eq!(landed.misgiving(now), None);
    run.fly(5.0);
    assert_eq!(run.estimator.estimate().health, Health::Good);
}

#[test]
fn val_the_inverse_is_that_of_the_general_solver_to_the_last_bit() {
    for anchors in [0, 1, 5, 6, 8, 13, MOST_ANCHORS] {
        let live = 3 + anchors;
        let half = Normal::from_fn(|i, j| match i.max(j) < live {
            true => ((31 * i + 7 * j + anchors) as f64).sin() + if i == j { 2.0 } else { 0.0 },
            false => f64::from(u8::from(i == j)) * 1.7,
        });
        let factor = (half * half.transpose()).cholesky().unwrap();
        let ours = inverse(factor.l_dirty(), live).map(f64::to_bits);
        assert_eq!(ours, factor.inverse().map(f64::to_bits), "{anchors} anchors");
    }
}
