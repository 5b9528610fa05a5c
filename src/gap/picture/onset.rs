//! Since when: the change point of a gap, second by second.
//!
//! ```text
//! r(t) = m₀(t) + a d(t) [t ≥ t₀] + noise of s(t)
//! l(t₀) = max_a Σ_{t ≥ t₀} w [ e² - (e - a z_d)² ] / 2,   e = (r - m₀)/s, z_d = d/s
//! ```
//! `m₀`, `s`: mean and sigma of null flights of the same mission at the same second; `d` what the
//! named effect adds, from flights with it; `a` its size (one that begins late was fitted too small),
//! 0.3 to 5. Only the lines of residuals that the effect moves most are looked at. `w`: weight of a
//! second, (1 - ρ)/(1 + ρ) by the autocorrelation ρ of null flights. Seconds in which the effect
//! would not show carry no weight: an effect of speed may have been there since take-off and show at
//! the first dash, and the interval then says so. Without a named effect the energy of `e` alone is
//! asked: before `t₀` of variance one, after it of a larger one.

use serde::Serialize;

use crate::picture::details::{Details, Line};

/// Lines of residuals that are looked at.
const LINES: usize = 4;
/// An onset whose log likelihood is within this of the best one is not ruled out: 95 % of a
/// likelihood ratio with one degree of freedom is 1.92.
const NOT_RULED_OUT: f64 = 2.0;
/// Log likelihood over "never" below which nothing is said: three sigma and the choice of a second.
const LEAST_GAIN: f64 = 8.0;
/// Largest standardised residual: a bad second must not be the whole gap.
const LARGEST: f64 = 8.0;
/// Size of the effect relative to the fitted one.
const SIZES: [f64; 2] = [0.3, 5.0];
/// Fewest null flights, and flights with the effect.
const LEAST_NULLS: usize = 12;
const LEAST_FLIGHTS: usize = 3;
/// An onset within this of the first second that was looked at is "since take-off", s.
const AT_ONCE: usize = 3;

/// When a gap begins.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Onset {
    /// Most likely, s since the first step with thrust; absent: none stands out.
    pub at_s: Option<f64>,
    /// Earliest and latest that are not ruled out.
    pub not_ruled_out_s: Option<[f64; 2]>,
    /// "Since take-off" is not ruled out.
    pub since_take_off: bool,
    /// Log likelihood over "never".
    pub gain: f64,
    /// Residuals that were looked at.
    pub lines: Vec<String>,
    /// Place of the first of them in the details.
    #[serde(skip)]
    pub strongest: Option<usize>,
}

impl Onset {
    /// In words.
    pub fn words(&self) -> String {
        match (self.at_s, self.not_ruled_out_s, self.since_take_off) {
            (None, ..) => "not told by single seconds".to_owned(),
            (Some(_), Some([_, to]), true) if to < 1.5 * AT_ONCE as f64 => {
                "since take-off".to_owned()
            }
            (Some(_), Some([_, to]), true) => {
                format!("since take-off, or any time up to {to:.0} s: it does not show before")
            }
            (Some(at), Some([from, to]), false) => {
                format!("since {at:.0} s ({from:.0} to {to:.0} s) after the first thrust")
            }
            (Some(at), None, _) => format!("since {at:.0} s after the first thrust"),
        }
    }
}

/// One line against null flights.
struct Standard {
    place: usize,
    name: String,
    /// Standardised residual of the flight; NaN unknown.
    e: Vec<f64>,
    /// Standardised shift by the effect; zero unknown.
    d: Vec<f64>,
    /// Weight of a second.
    weight: f64,
    /// Strength of the effect in this line beyond the noise of its estimate.
    strength: f64,
}

/// Searches the onset. `with`: flights with the named effect, empty without one.
pub fn onset(flight: &Details, nulls: &[Details], with: &[Details]) -> Onset {
    let named = with.len() >= LEAST_FLIGHTS;
    let mut standards: Vec<Standard> = flight
        .lines
        .iter()
        .enumerate()
        .filter_map(|(i, line)| standard(i, line, nulls, if named { with } else { &[] }))
        .collect();
    standards.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    standards.truncate(LINES);
    standards.retain(|s| s.strength > 0.0);
    let length = standards.iter().map(|s| s.e.len()).min().unwrap_or(0);
    // Seconds that any line knows.
    let known = |t: &usize| standards.iter().any(|s| s.e[*t].is_finite());
    let (first, last) = ((0..length).find(known), (0..length).rfind(known));
    let (Some(first), Some(last)) = (first, last) else {
        return Onset {
            at_s: None,
            not_ruled_out_s: None,
            since_take_off: false,
            gain: 0.0,
            lines: Vec::new(),
            strongest: None,
        };
    };
    let likelihood: Vec<(usize, f64)> = (first..=last)
        .map(|t0| (t0, if named { shifted(&standards, t0) } else { louder(&standards, t0) }))
        .collect();
    let best = likelihood.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
    let (at, gain) = best.unwrap_or((first, 0.0));
    let lines = standards.iter().map(|s| s.name.clone()).collect();
    let strongest = standards.first().map(|s| s.place);
    if gain < LEAST_GAIN {
        let (at_s, not_ruled_out_s) = (None, None);
        return Onset { at_s, not_ruled_out_s, since_take_off: false, gain, lines, strongest };
    }
    let open: Vec<usize> =
        likelihood.iter().filter(|(_, l)| gain - l <= NOT_RULED_OUT).map(|(t, _)| *t).collect();
    let (from, to) = (open.first().copied().unwrap_or(at), open.last().copied().unwrap_or(at));
    Onset {
        at_s: Some(at as f64),
        not_ruled_out_s: Some([from as f64, to as f64]),
        since_take_off: from <= first + AT_ONCE,
        gain,
        lines,
        strongest,
    }
}

fn standard(i: usize, line: &Line, nulls: &[Details], with: &[Details]) -> Option<Standard> {
    let at = |from: &[Details], t: usize| -> Vec<f64> {
        from.iter()
            .filter_map(|d| d.lines.get(i)?.values.get(t).copied())
            .filter(|v| v.is_finite())
            .collect()
    };
    let moments = |values: &[f64]| {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0))
    };
    let n = line.values.len();
    let (mut e, mut d) = (vec![f64::NAN; n], vec![0.0; n]);
    let mut strength = 0.0;
    let mut sigma_of = vec![f64::NAN; n];
    let mut mean_of = vec![f64::NAN; n];
    let mut variances = Vec::new();
    for t in 0..n {
        let null = at(nulls, t);
        if null.len() >= LEAST_NULLS {
            let (mean, var) = moments(&null);
            mean_of[t] = mean;
            sigma_of[t] = var.sqrt();
            variances.push(var);
        }
    }
    // A second in which null flights happen to agree says no more than a usual one.
    variances.sort_by(f64::total_cmp);
    let usual = variances.get(variances.len() / 2).copied().filter(|v| *v > 0.0)?.sqrt();
    for t in 0..n {
        if !mean_of[t].is_finite() {
            continue;
        }
        let sigma = sigma_of[t].max(0.5 * usual);
        e[t] = ((line.values[t] - mean_of[t]) / sigma).clamp(-LARGEST, LARGEST);
        let moved = at(with, t);
        if moved.len() >= LEAST_FLIGHTS {
            let (mean, var) = moments(&moved);
            let z = (mean - mean_of[t]) / sigma;
            // A shift that could be the noise of its own estimate is none.
            let noise =
                (var / moved.len() as f64).sqrt() / sigma + 1.0 / (nulls.len() as f64).sqrt();
            d[t] = if z.abs() > 2.0 * noise { z.clamp(-LARGEST, LARGEST) } else { 0.0 };
            strength += d[t] * d[t];
        }
    }
    let weight = weight(i, nulls, &mean_of, &sigma_of);
    if with.is_empty() {
        strength = e.iter().filter(|v| v.is_finite()).map(|v| v * v - 1.0).sum::<f64>();
    }
    Some(Standard { place: i, name: line.name(), e, d, weight, strength: strength * weight })
}

/// `(1 - ρ)/(1 + ρ)` from neighbouring seconds of null flights.
fn weight(i: usize, nulls: &[Details], mean: &[f64], sigma: &[f64]) -> f64 {
    let (mut product, mut square) = (0.0, 0.0);
    for line in nulls.iter().filter_map(|d| d.lines.get(i)) {
        let z = |t: usize| {
            let value = line.values.get(t).copied().unwrap_or(f64::NAN);
            (value - mean.get(t).copied().unwrap_or(f64::NAN))
                / sigma.get(t).copied().unwrap_or(1.0)
        };
        for t in 1..mean.len() {
            let (a, b) = (z(t - 1), z(t));
            if a.is_finite() && b.is_finite() {
                product += a * b;
                square += 0.5 * (a * a + b * b);
            }
        }
    }
    let rho = if square > 0.0 { (product / square).clamp(0.0, 0.95) } else { 0.0 };
    (1.0 - rho) / (1.0 + rho)
}

/// Log likelihood over "never" of the effect from `t0` on, at its best size.
fn shifted(standards: &[Standard], t0: usize) -> f64 {
    let (mut ed, mut dd) = (0.0, 0.0);
    for s in standards {
        for (e, d) in s.e.iter().zip(&s.d).skip(t0) {
            if e.is_finite() {
                ed += s.weight * e * d;
                dd += s.weight * d * d;
            }
        }
    }
    if dd <= 0.0 {
        return 0.0;
    }
    let size = (ed / dd).clamp(SIZES[0], SIZES[1]);
    size * ed - 0.5 * size * size * dd
}

/// Log likelihood over "never" of a larger variance from `t0` on.
fn louder(standards: &[Standard], t0: usize) -> f64 {
    standards
        .iter()
        .map(|s| {
            let known: Vec<f64> = s.e.iter().skip(t0).copied().filter(|e| e.is_finite()).collect();
            let n = known.len() as f64;
            let mean = known.iter().map(|e| e * e).sum::<f64>() / n.max(1.0);
            if n < 2.0 || mean <= 1.0 { 0.0 } else { 0.5 * s.weight * n * (mean - 1.0 - mean.ln()) }
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::jitter::jittered;
    use crate::bank::library;
    use crate::bank::missions;
    use crate::flight::trace::Trace;
    use crate::nominal::Nominal;
    use crate::picture::details::{details, fly_nulls};
    use crate::scene::Scene;
    use haltere_model::faults::Fault;
    use haltere_model::lockstep::{Lockstep, fly_watched};

    /// Time since the first thrust that the effect begins at, s.
    const BEGINS_S: f64 = 40.0;

    /// Flights of an effect: that of one says what chance does to it as well.
    const SEEDS: std::ops::Range<u64> = 91..96;

    /// A flight in which an effect switches on in the air; returns the details, and when it did, s
    /// since the first step with thrust.
    fn sudden(
        scene: &Scene,
        id: &str,
        theta: &[f64],
        at_s: Option<f64>,
        seed: u64,
    ) -> (Details, f64) {
        let spec = library::standard().into_iter().find(|s| s.id == id).unwrap();
        let values = spec.parameters.iter().map(|p| p.name.to_owned()).zip(theta.iter().copied());
        let mut fault = Some(Fault::EffectOn { id: id.to_owned(), values: values.collect() });
        let plant = jittered(scene.plant(seed)).unwrap();
        let mut lockstep = Lockstep::new(plant, scene.pilot.clone(), &scene.survey).unwrap();
        let mut trace = Trace::new(scene.survey.clone());
        let mut began_s = f64::NAN;
        fly_watched(&mut lockstep, &missions::plain(scene), 150.0, |l| {
            l.pilot_mut().drain_topics(|topic| trace.take(topic));
            let Some(first) = trace.controls.first() else { return };
            let since_s = l.host_now().seconds_since(first.at);
            if at_s.is_some_and(|at| since_s >= at)
                && let Some(fault) = fault.take()
            {
                began_s = since_s;
                l.plant_mut().inject(fault).unwrap();
            }
        })
        .unwrap();
        (details(&trace, &Nominal::of_scene(scene)).unwrap(), began_s)
    }

    #[test]
    fn val_the_second_of_a_sudden_effect_is_found() {
        let scene = Scene::lab().unwrap();
        let items = missions::plain(&scene);
        let nulls = fly_nulls(&scene, &items, &[], 1000..1024, |_, _| {});
        for (id, theta) in [("U2", &[0.3, 2.0][..]), ("P1", &[0.12]), ("M1", &[0.4, 0.0, 0.0])] {
            let spec = library::standard().into_iter().find(|s| s.id == id).unwrap();
            let with = fly_nulls(&scene, &items, &[(spec, theta)], 2000..2004, |_, _| {});
            let mut late_s = Vec::new();
            let mut blind_s = Vec::new();
            for seed in SEEDS {
                let (flight, began_s) = sudden(&scene, id, theta, Some(BEGINS_S), seed);
                let found = onset(&flight, &nulls, &with);
                let blind = onset(&flight, &nulls, &[]);
                println!("{id}: began {began_s:.1} s, {found:?}, without a name {blind:?}");
                assert!(!found.since_take_off, "{id}: {found:?}");
                late_s.push((found.at_s.unwrap() - began_s).abs());
                blind_s.push((blind.at_s.unwrap() - began_s).abs());
            }
            for all_s in [&mut late_s, &mut blind_s] {
                all_s.sort_by(f64::total_cmp);
            }
            // The middle one is right to the second, and none is off by more than what is not ruled out.
            assert!(
                late_s[SEEDS.count() / 2] <= 1.5 && late_s[SEEDS.count() - 1] <= 5.0,
                "{id}: {late_s:?}"
            );
            // The bias of the accelerometer is too weak to be dated by who does not know it: of sixteen flights half are off
            // by more than 6 s.
            assert!(id == "M1" || blind_s[SEEDS.count() / 2] <= 6.0, "{id}: {blind_s:?}");
        }
    }

    #[test]
    fn val_an_effect_of_the_whole_flight_began_at_take_off_and_none_has_no_onset() {
        let scene = Scene::lab().unwrap();
        let items = missions::plain(&scene);
        let nulls = fly_nulls(&scene, &items, &[], 1000..1024, |_, _| {});
        let spec = library::standard().into_iter().find(|s| s.id == "P1").unwrap();
        let with = fly_nulls(&scene, &items, &[(spec, &[0.12])], 2000..2004, |_, _| {});
        let whole = fly_nulls(&scene, &items, &[(spec, &[0.12])], 3000..3001, |_, _| {});
        let found = onset(&whole[0], &nulls, &with);
        println!("{found:?} {}", found.words());
        assert!(found.since_take_off, "{found:?}");
        let (none, _) = sudden(&scene, "P1", &[0.12], None, SEEDS.start);
        let found = onset(&none, &nulls, &with);
        assert_eq!(found.at_s, None, "{found:?}");
    }
}
