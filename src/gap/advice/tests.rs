//! The advice on cases with known answers.

use super::*;
use crate::bank::library;

fn hypothesis(id: &str, probability: f64, theta: &[f64], theta_90: &[[f64; 2]]) -> Hypothesis {
    let spec = library::standard().into_iter().find(|s| s.id == id).unwrap();
    Hypothesis { spec, probability, theta: theta.to_vec(), theta_90: theta_90.to_vec() }
}

fn mass_or_thrust() -> Remaining {
    Remaining::new(
        vec![
            hypothesis("P1", 0.5, &[0.06], &[[0.05, 0.07]]),
            hypothesis("I1", 0.45, &[6.0], &[[5.0, 7.0]]),
            hypothesis("U9", 0.001, &[0.3], &[[0.3, 0.4]]),
        ],
        &[],
        Vec::new(),
    )
}

#[test]
fn prop_what_is_ruled_out_is_not_compared_and_the_rest_sums_to_one() {
    let r = mass_or_thrust();
    assert_eq!(r.candidates.iter().map(|h| h.spec.id).collect::<Vec<_>>(), ["P1", "I1"]);
    assert!((r.prior().iter().sum::<f64>() - 1.0).abs() < 1e-12);
    let kept = Remaining::new(
        vec![
            hypothesis("P1", 0.9, &[0.06], &[[0.05, 0.07]]),
            hypothesis("U9", 0.0, &[0.3], &[[0.3, 0.4]]),
        ],
        &["U9".to_owned()],
        Vec::new(),
    );
    assert_eq!(kept.candidates.len(), 2);
}

#[test]
fn val_a_scale_tells_mass_from_thrust_as_its_resolution_says() {
    let scale = crate::advice::experiments::find("scale").unwrap();
    let Means::Bench(readings) = scale.means else { panic!() };
    let r = mass_or_thrust();
    assert!(read_off(&r, readings) > 0.999);
    // 6 g at 0.5 g.
    assert!((bench_distances(&r, readings)[(0, 1)].sqrt() - 12.0).abs() < 1e-9);
    // A mass of half the resolution is hardly told: the textbook value Φ(0.25) for equal odds.
    let weak = Remaining::new(
        vec![
            hypothesis("P1", 0.5, &[0.03], &[[0.03, 0.03]]),
            hypothesis("I1", 0.5, &[0.25], &[[0.25, 0.25]]),
        ],
        &[],
        Vec::new(),
    );
    assert!((read_off(&weak, readings) - 0.599).abs() < 0.03, "{}", read_off(&weak, readings));
}

#[test]
fn val_the_scale_is_recommended_for_mass_against_thrust() {
    let scene = Scene::lab().unwrap();
    let all = advise(&scene, &mass_or_thrust(), Effort::All, &Shelf::none(), |_, _| {});
    assert_eq!(all.len(), EXPERIMENTS.len());
    for a in &all {
        println!("{} {:?} {:?}", a.experiment, a.correct_after, a.hardest);
    }
    assert_eq!(all[0].experiment, "scale");
    assert!(all[0].gain.unwrap() > 0.4);
    let tape = all.iter().find(|a| a.experiment == "tape-measure").unwrap();
    assert!(tape.gain.unwrap() < 1e-9, "a tape says nothing about mass");
}
