//! Tests of the survey check, in a hall by exact geometry and on the floor of recorded rooms.

use nalgebra::Vector3;

use super::anchor_check::{AnchorCheck, AnchorFit, MOST_HIDDEN_M};
use super::truth::{Noise, hall};
use crate::frames::Vec3;
use crate::measure::{AnchorId, Tdoa};
use crate::survey::Survey;
use crate::time::HostTime;

/// Pairs of neighbours and next neighbours on the ring, by these ranges, m.
fn hear(check: &mut AnchorCheck, range_m: impl Fn(u8) -> f64, noise: &mut Noise) {
    for turn in 0..40 {
        for a in 0..8u8 {
            for step in [1, 2] {
                let b = (a + step) % 8;
                let at = HostTime::from_us(1_000_000 + turn * 20_000);
                check.note(&Tdoa {
                    valid_at: at,
                    received_at: at,
                    anchor_a: AnchorId(a),
                    anchor_b: AnchorId(b),
                    distance_diff_m: range_m(b) - range_m(a) + 0.15 * noise.normal(),
                    std_m: None,
                });
            }
        }
    }
}

/// Anchors with these range biases, in truth moved by `moved`, heard by a vehicle at `p`.
fn stand(
    survey: &Survey,
    p: Vector3<f64>,
    bias_m: &[f64; 8],
    moved: (u8, Vector3<f64>),
    noise: &mut Noise,
) -> AnchorCheck {
    let mut check = AnchorCheck::new(survey, &[]);
    let range_m = |id: u8| {
        let site = survey.position_E_m(AnchorId(id)).unwrap().raw();
        let shift = if moved.0 == id { moved.1 } else { Vector3::zeros() };
        (p - site - shift).norm() + bias_m[usize::from(id)]
    };
    hear(&mut check, range_m, noise);
    check
}

/// What walls usually do, some centimetres, and on the low anchors the floor, 0.2 to 0.5 m.
fn usual(noise: &mut Noise, floor: bool) -> [f64; 8] {
    std::array::from_fn(|i| {
        let wall_m = 0.04 * noise.normal();
        wall_m + if floor && i < 4 { 0.2 + 0.3 * noise.uniform() } else { 0.0 }
    })
}

/// Not in a corner.
fn place(noise: &mut Noise) -> Vector3<f64> {
    Vector3::new(3.0 + 4.0 * noise.uniform(), 3.0 + 4.0 * noise.uniform(), -0.1)
}

#[test]
fn prop_each_anchor_that_is_1_m_off_along_its_line_of_sight_is_named_with_its_size() {
    let (survey, mut noise) = (hall(), Noise(7));
    for id in 0..8u8 {
        let mut named = 0;
        for round in 0..20 {
            let p = place(&mut noise);
            let site = survey.position_E_m(AnchorId(id)).unwrap().raw();
            let way = if round % 2 == 0 { 1.0 } else { -1.0 };
            let bias_m = usual(&mut noise, true);
            let moved = (id, (site - p).normalize() * way);
            let fit = stand(&survey, p, &bias_m, moved, &mut noise).judge(0.1).unwrap();
            if fit.is_at_fault(0.6) {
                assert_eq!(fit.worst, AnchorId(id), "{fit:?}");
                assert!((fit.range_bias_m - way).abs() < 0.5, "{id}: {fit:?}");
                named += 1;
            }
        }
        assert!(named >= 19, "{id}: {named} of 20");
    }
}

/// Flown with a filter that learned the errors of the anchors, two that were exchanged seemed sound until the lift-off.
#[test]
fn regress_two_exchanged_anchors_are_no_survey() {
    let (survey, mut noise) = (hall(), Noise(5));
    let site = |id: usize| survey.position_E_m(AnchorId(id as u8)).unwrap();
    let (mut found, mut flights) = (0, 0);
    while flights < 200 {
        let [a, b] = [0, 0].map(|_| (8.0 * noise.uniform()) as usize);
        let p = place(&mut noise);
        // Where both are as far away nothing has changed.
        if ((p - site(a).raw()).norm() - (p - site(b).raw()).norm()).abs() < 4.0 {
            continue;
        }
        let told: Vec<_> = (0..8)
            .map(|id| {
                (
                    AnchorId(id as u8),
                    site(if id == a {
                        b
                    } else if id == b {
                        a
                    } else {
                        id
                    }),
                )
            })
            .collect();
        let (told, bias_m) = (Survey::new(&told).unwrap(), usual(&mut noise, true));
        let mut check = AnchorCheck::new(&told, &[]);
        let range_m = |id: u8| (p - site(id.into()).raw()).norm() + bias_m[usize::from(id)];
        hear(&mut check, range_m, &mut noise);
        let fit = check.judge(0.1).unwrap();
        flights += 1;
        found += usize::from(fit.fits_nowhere() || fit.is_at_fault(0.6));
    }
    assert!(found >= 180, "{found} of {flights}");
}

#[test]
fn prop_a_sound_survey_is_never_doubted() {
    let (survey, mut noise) = (hall(), Noise(3));
    let nothing = (0, Vector3::zeros());
    for _ in 0..200 {
        let (p, bias_m) = (place(&mut noise), usual(&mut noise, true));
        let fit = stand(&survey, p, &bias_m, nothing, &mut noise).judge(0.1).unwrap();
        assert!(!fit.is_at_fault(0.3) && !fit.fits_nowhere(), "{fit:?}");
    }
    // On a table, or held in a hand: the height is another than expected.
    for height_m in [0.4, 0.8] {
        for _ in 0..50 {
            let p = place(&mut noise) - Vector3::z() * height_m;
            let bias_m = usual(&mut noise, false);
            let fit = stand(&survey, p, &bias_m, nothing, &mut noise).judge(0.1).unwrap();
            assert!(!fit.is_at_fault(0.3), "{fit:?}");
        }
    }
}

#[test]
fn prop_a_floor_that_hides_all_low_anchors_is_seen_as_one() {
    let (survey, mut noise) = (hall(), Noise(9));
    for _ in 0..50 {
        let mut bias_m = usual(&mut noise, true);
        for low in &mut bias_m[..4] {
            *low += 3.0 + noise.uniform();
        }
        let moved = (2, Vector3::zeros());
        let fit = stand(&survey, place(&mut noise), &bias_m, moved, &mut noise).judge(0.1).unwrap();
        assert!(fit.hidden_m > MOST_HIDDEN_M && !fit.is_at_fault(0.6), "{fit:?}");
        assert!(!fit.fits_nowhere(), "{fit:?}");
    }
}

#[test]
fn prop_too_few_anchors_or_values_say_nothing_and_known_biases_are_taken_off() {
    let (survey, mut noise) = (hall(), Noise(1));
    assert_eq!(AnchorCheck::new(&survey, &[]).judge(0.1), None);
    let p = Vector3::new(4.0, 5.0, -0.1);
    let mut check = stand(&survey, p, &[0.0; 8], (0, Vector3::zeros()), &mut noise);
    assert!(check.judge(0.1).is_some());
    check.clear();
    assert_eq!(check.judge(0.1), None);
    // A bias of 1.5 m of anchor 5 that is known, and nonsense that is not taken.
    let mut check = AnchorCheck::new(&survey, &[[5.0, 1.5]]);
    let range = |id: u8| {
        let known = if id == 5 { 1.5 } else { 0.0 };
        (p - survey.position_E_m(AnchorId(id)).unwrap().raw()).norm() + known
    };
    let tdoa = |a: u8, b: u8, diff_m: f64| Tdoa {
        valid_at: HostTime::from_us(1),
        received_at: HostTime::from_us(1),
        anchor_a: AnchorId(a),
        anchor_b: AnchorId(b),
        distance_diff_m: diff_m,
        std_m: None,
    };
    for _ in 0..30 {
        for a in 0..8u8 {
            for b in 0..8u8 {
                check.note(&tdoa(a, b, range(b) - range(a)));
            }
            check.note(&tdoa(a, 99, 1.0));
            check.note(&tdoa(a, (a + 1) % 8, f64::NAN));
        }
    }
    let fit = check.judge(0.1).unwrap();
    assert!(fit.doubt < 1e-3 && fit.hidden_m.abs() < 0.01, "{fit:?}");
}

#[test]
fn prop_survey_of_more_anchors_than_take_part() {
    let anchors: Vec<_> = (0..40u8)
        .map(|i| {
            let f = f64::from(i);
            (AnchorId(i), Vec3::new(f % 7.0 * 2.0, f % 5.0 * 2.0, -(f % 3.0) * 2.0 - 0.2))
        })
        .collect();
    let survey = Survey::new(&anchors).unwrap();
    let mut check = AnchorCheck::new(&survey, &[]);
    let p = Vector3::new(6.0, 4.0, -0.1);
    let range = |id: u8| (p - survey.position_E_m(AnchorId(id)).unwrap().raw()).norm();
    for _ in 0..20 {
        for a in 0..40u8 {
            for b in [(a + 1) % 40, (a + 7) % 40] {
                let at = HostTime::from_us(1);
                check.note(&Tdoa {
                    valid_at: at,
                    received_at: at,
                    anchor_a: AnchorId(a),
                    anchor_b: AnchorId(b),
                    distance_diff_m: range(b) - range(a),
                    std_m: None,
                });
            }
        }
    }
    let fit: AnchorFit = check.judge(0.1).unwrap();
    assert!(fit.anchors == 16 && fit.doubt < 1e-3, "{fit:?}");
}
