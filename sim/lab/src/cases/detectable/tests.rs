//! The committed sizes are of these effects, and the detector counts what it says.

use super::*;

#[test]
fn prop_every_effect_of_the_suite_has_a_measured_size_in_its_range() {
    let committed = Detectable::committed();
    assert_eq!((committed.generator.as_str(), committed.suite_seed), (GENERATOR, SUITE_SEED));
    for spec in known().chain(unknown()) {
        let limit = &committed.effects[spec.id];
        assert_eq!((limit.strong, &*limit.unit), (spec.range[1], spec.unit), "{}", spec.id);
        let sizes = [1.0, 2.0, 4.0].map(|times| committed.size(spec, times));
        let strengths = sizes.map(|size| spec.strength(size));
        assert!(strengths.is_sorted(), "{} {sizes:?}", spec.id);
        assert!(strengths[2] <= spec.strongest() * (1.0 + 1e-12), "{} {sizes:?}", spec.id);
        assert!(strengths[0] >= spec.strength(spec.range[0]) - 1e-12, "{} {sizes:?}", spec.id);
        let least = limit.size.map_or(spec.strongest(), |size| spec.strength(size));
        assert!(strengths[0] >= least - 1e-9, "{} {sizes:?}", spec.id);
    }
    assert_eq!(committed.effects.len(), 62);
}

#[test]
fn prop_strength_and_size_are_inverse_and_grow_towards_the_strong_end() {
    for spec in known().chain(unknown()) {
        let [mild, strong] = spec.range;
        assert!(spec.strength(mild) < spec.strength(strong), "{}", spec.id);
        for size in [mild, strong] {
            assert!((spec.size(spec.strength(size)) - size).abs() < 1e-12, "{}", spec.id);
        }
    }
}

#[test]
fn val_the_detector_counts_squares_beyond_the_healthy_width() {
    // One statistic with centre 10 and width 2, one that is there too seldom, one that never moves.
    let flights: Vec<Vec<f64>> = (0..20)
        .map(|i| vec![if i % 2 == 0 { 8.0 } else { 12.0 }, if i < 5 { 1.0 } else { f64::NAN }, 3.0])
        .collect();
    let scale = Scale::of(&flights);
    // Deviations of 2 everywhere: standard deviation 2, by the median absolute one 2.97.
    let (centre, width) = scale.0[0].unwrap();
    assert_eq!(centre, 10.0);
    assert!((width - 2.0 * SIGMA_PER_MAD).abs() < 1e-12);
    assert!(scale.0[1].is_none() && scale.0[2].is_none());
    assert_eq!(scale.distance(&[10.0, 50.0, 50.0]), 0.0);
    let beyond = scale.distance(&[10.0 + 4.5 * width, f64::NAN, 3.0]);
    assert!((beyond - 4.0).abs() < 1e-9, "{beyond}");
}

#[test]
fn val_the_limit_is_the_median_of_the_draws() {
    let spec = known().find(|spec| spec.id == "P1").unwrap();
    let of = |octaves: &[i32]| {
        let draws: Vec<_> = octaves.iter().map(|o| (*o, 0)).collect();
        limit(spec, &draws).size
    };
    assert_eq!(of(&[2, 0, 1]), Some(0.2 * 0.5_f64.powf(1.5)));
    // Half of the draws do not show at all: between the two lies the strong end.
    assert_eq!(of(&[-1, 0, -1, 0]), Some(0.2));
    assert_eq!(of(&[-1, -1, -1, 2]), None);
}
