//! The vehicle to begin with where the simulator does not fly the mission with the file as it is: that of the file with what the
//! flights themselves and the configuration that flew them say.
//!
//! Each line adds to those above it, and as little is taken as flies:
//!
//! ```text
//! k  = (m g − T₀) / (2 f)            thrust a flap rate, N/Hz, that carries the vehicle at the flap rates of its hover
//! k_i = d_i m / (2 f)                drag along body axis i, N s/(m Hz), of the configuration's drag rates d, 1/s
//! ω_i = least |y − y₀(ω_i)|          frequency of the attitude loops, rad/s, by the attitude that their setpoints brought
//! one part of the file as is usual   for mass, pack and wing
//! ```
//! `f` mean flap rate of a wing in hover by the nominal drive, Hz; `m` mass, kg; `T₀` thrust at no flapping, N; `y` attitude, `y₀` that of
//! the nominal loop.

use haltere_core::frames::G_MPS2;
use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use haltere_model::Vehicle;
use rayon::prelude::*;

use crate::bank::make_bank::{BankSize, Recipe, flown_by};
use crate::bank::not_flown::{PARTS, usual};
use crate::bank::workshop::BANK_SEED;
use crate::flight::residuals::Flight;
use crate::flight::trace::Trace;
use crate::nominal::Nominal;
use crate::scene::Scene;

/// Healthy flights of each vehicle that is tried, and how many of them must come to their end: a bank needs three of four.
const FLIGHTS: usize = 8;
const LEAST: usize = 6;
/// Frequencies of a loop that are tried, as factors: half to twice the file's, in steps of a twentieth.
const FACTORS: std::ops::RangeInclusive<i32> = -14..=14;
const STEP: f64 = 0.05;

/// That vehicle; `None`: none of these is flown.
pub(super) fn begun(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    flights: &[&Trace],
) -> Option<Vehicle> {
    let size = BankSize { seeds: 0, jitter: FLIGHTS, draws: 0 };
    let recipe = Recipe { scene, items, library: &[], size, seed: BANK_SEED };
    let flies = |vehicle: &Vehicle| flown_by(&recipe, vehicle, FLIGHTS) >= LEAST;
    let carried = carried(scene, flights)?;
    let drawn = with_drag(scene, &carried);
    let answers = with_loops(scene, flights, &drawn);
    let as_usual = PARTS.iter().map(|(_, take, _)| {
        let mut other = answers.clone();
        take(&mut other, &usual(&answers));
        other
    });
    let tried = [carried, drawn, answers.clone()].into_iter().chain(as_usual);
    tried.into_iter().find(flies)
}

fn carried(scene: &Scene, flights: &[&Trace]) -> Option<Vehicle> {
    let nominal = Nominal::of_scene(scene);
    let hover_hz = |trace: &&Trace| Flight::new(trace, &nominal).ok()?.hover_hz();
    let hover_hz: Vec<f64> = flights.par_iter().filter_map(hover_hz).collect();
    let hover_hz =
        (!hover_hz.is_empty()).then(|| hover_hz.iter().sum::<f64>() / hover_hz.len() as f64)?;
    let mut vehicle = scene.vehicle.clone();
    let weight_n = vehicle.body.mass_kg * G_MPS2;
    let thrust_n_per_hz = (weight_n - vehicle.wings.thrust_offset_n) / (2.0 * hover_hz);
    vehicle.wings.thrust_n_per_hz = thrust_n_per_hz;
    (thrust_n_per_hz.is_finite() && thrust_n_per_hz > 0.0).then_some(vehicle)
}

fn with_drag(scene: &Scene, vehicle: &Vehicle) -> Vehicle {
    let mut vehicle = vehicle.clone();
    let share = vehicle.body.mass_kg / (2.0 * vehicle.hover_hz());
    for (k, told_per_s) in
        vehicle.drag.k_ns_per_m_hz.iter_mut().zip(scene.pilot.estimator.drag_per_s)
    {
        // Who tells none has not measured it.
        if told_per_s > 0.0 {
            *k = told_per_s * share;
        }
    }
    vehicle
}

fn with_loops(scene: &Scene, flights: &[&Trace], vehicle: &Vehicle) -> Vehicle {
    let of = |vehicle: &Vehicle| Nominal { vehicle: vehicle.clone(), ..Nominal::of_scene(scene) };
    let nominal = of(vehicle);
    let flights: Vec<_> =
        flights.par_iter().filter_map(|trace| Flight::new(trace, &nominal).ok()).collect();
    let mut vehicle = vehicle.clone();
    for axis in 0..3 {
        let left = |step: i32| {
            let mut other = vehicle.clone();
            other.inner_loop.frequency_radps[axis] *= (STEP * f64::from(step)).exp();
            let nominal = of(&other);
            let left = flights.iter().map(|flight| flight.left_by_loop(&nominal, axis));
            (left.sum::<f64>(), other.inner_loop.frequency_radps[axis])
        };
        let best = FACTORS.into_par_iter().map(left).min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, radps)) = best.filter(|(left, _)| left.is_finite()) {
            vehicle.inner_loop.frequency_radps[axis] = radps;
        }
    }
    vehicle
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::fly::fly_observed;
    use crate::bank::missions;

    /// Flights of a vehicle that another file says nothing of: it has slower loops, and hovers at five sevenths of
    /// the command. "0 of 60 simulated flights came to its end" was all that was said.
    #[test]
    fn regress_a_flight_of_another_vehicle_than_the_files_gives_one_to_begin_with() {
        let mut scene = Scene { until_s: Some(20.0), ..Scene::lab().unwrap() };
        let items = missions::plain(&scene);
        let file = scene.vehicle.clone();
        scene.vehicle.wings.thrust_n_per_hz *= 1.4;
        scene.vehicle.inner_loop.frequency_radps =
            scene.vehicle.inner_loop.frequency_radps.map(|w| 0.85 * w);
        let real = scene.vehicle.clone();
        // The companion knows the hover of its own vehicle.
        for c in &mut scene.pilot.control.voltage.base_coefficients_frac {
            *c /= 1.4;
        }
        let flown = fly_observed(&scene, &items, scene.plant(300), scene.pilot.clone()).unwrap();
        assert!(flown.came_as_far_as(scene.until_s));
        scene.vehicle = file.clone();
        let found = begun(&scene, &items, &[&flown]).unwrap();
        let ratio = found.wings.thrust_n_per_hz / real.wings.thrust_n_per_hz;
        assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
        // Thrust alone flies: nothing else is touched.
        assert_eq!(found.inner_loop, file.inner_loop);
        let loops = with_loops(&scene, &[&flown], &found).inner_loop.frequency_radps;
        // Of roll: pitch is moved by speed as well.
        let ratio = loops[0] / real.inner_loop.frequency_radps[0];
        assert!((ratio - 1.0).abs() < 0.15, "{ratio}");
        // What no flight shows is no beginning.
        assert!(begun(&scene, &items, &[]).is_none());
    }
}
