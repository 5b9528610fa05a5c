//! Why the simulator does not fly a mission: what became of its flights, and which number of the vehicle file they fail by.
//!
//! A number is suspected by flying: each is replaced by what a file that says only mass, cells and the length of the wing
//! would have, and a few flights are flown again. The number with which most of them come to their end is told.

use haltere_model::Vehicle;

use crate::bank::fly::MOST_LIMIT_S;
use crate::bank::make_bank::{Recipe, flown_by};
use crate::bank::one_flight::End;

/// Flights for each number: enough to tell "most of them" from "none" (judgement).
const FLIGHTS: usize = 6;

/// Part of a vehicle, by its keys in the file, taken over from another.
pub(crate) type Part = (&'static str, fn(&mut Vehicle, &Vehicle), fn(&Vehicle) -> String);

/// Parts that one flies or falls by, simple ones first.
pub(crate) const PARTS: [Part; 10] = [
    (
        "wings.passive_dihedral_rad_per_mps",
        |v, of| v.wings.passive_dihedral_rad_per_mps = of.wings.passive_dihedral_rad_per_mps,
        |v| format!("{:.3}", v.wings.passive_dihedral_rad_per_mps),
    ),
    ("wings.cop_m", |v, of| v.wings.cop_m = of.wings.cop_m, |v| format!("{:.4}", v.wings.cop_m)),
    (
        "drag.k_ns_per_m_hz",
        |v, of| v.drag.k_ns_per_m_hz = of.drag.k_ns_per_m_hz,
        |v| format!("{:.4?}", v.drag.k_ns_per_m_hz),
    ),
    (
        "body.inertia_kgm2",
        |v, of| v.body.inertia_kgm2 = of.body.inertia_kgm2,
        |v| format!("{:?}", v.body.inertia_kgm2),
    ),
    (
        "wings.flap_lag_s",
        |v, of| v.wings.flap_lag_s = of.wings.flap_lag_s,
        |v| format!("{:.3}", v.wings.flap_lag_s),
    ),
    (
        "wings.thrust_n_per_hz, thrust_offset_n, flap_hz_per_v and flap_offset_hz",
        |v, of| {
            v.wings.thrust_n_per_hz = of.wings.thrust_n_per_hz;
            v.wings.thrust_offset_n = of.wings.thrust_offset_n;
            v.wings.flap_hz_per_v = of.wings.flap_hz_per_v;
            v.wings.flap_offset_hz = of.wings.flap_offset_hz;
        },
        |v| format!("hover at {:.2} V of command times voltage", v.hover_command_v()),
    ),
    (
        "pitch_servo",
        |v, of| v.pitch_servo = of.pitch_servo.clone(),
        |v| format!("{} rad/s, {}°", v.pitch_servo.frequency_radps, v.pitch_servo.limit_deg),
    ),
    (
        "yaw_servo",
        |v, of| v.yaw_servo = of.yaw_servo.clone(),
        |v| format!("{} rad/s, {}°", v.yaw_servo.frequency_radps, v.yaw_servo.limit_deg),
    ),
    (
        "battery.capacity_mah, resistance_ohm and hover_w",
        |v, of| {
            v.battery.capacity_mah = of.battery.capacity_mah;
            v.battery.resistance_ohm = of.battery.resistance_ohm;
            v.battery.hover_w = of.battery.hover_w;
        },
        |v| {
            format!(
                "{} mAh, {} Ω, {} W",
                v.battery.capacity_mah, v.battery.resistance_ohm, v.battery.hover_w
            )
        },
    ),
    ("ground", |v, of| v.ground = of.ground.clone(), |v| format!("gain {}", v.ground.gain)),
];

/// In words, for the end of a sentence that says how many flights there are.
pub(crate) fn why(recipe: &Recipe<'_>, ends: &[(End, usize, u64)]) -> String {
    let became: Vec<String> =
        ends.iter().map(|(end, count, _)| format!("{count} {}", end.words())).collect();
    let mut told = became.join(", ");
    let now = &recipe.scene.vehicle;
    let usual = usual(now);
    let tried = PARTS.iter().filter_map(|(key, take, shown)| {
        let mut other = now.clone();
        take(&mut other, &usual);
        if other == *now {
            return None;
        }
        Some((flown_by(recipe, &other, FLIGHTS), *key, shown(now), shown(&other)))
    });
    let before = flown_by(recipe, now, FLIGHTS);
    // The first of equals: the simplest.
    let best = tried.reduce(|best, next| if next.0 > best.0 { next } else { best });
    match best.filter(|(flown, ..)| *flown > before) {
        Some((flown, key, was, would)) => told.push_str(&format!(
            "; vehicle.{key} is the likeliest reason: {was} in the vehicle file, with {would} as usual for its mass and \
             wing {flown} of {FLIGHTS} come to their end, with what is there {before}"
        )),
        None => told.push_str(&format!(
            "; no single key of the vehicle file (--vehicle) mends it: the mission lasts more than {MOST_LIMIT_S} s, the \
             room is another one (--room), or several keys are wrong (haltere vehicle check)"
        )),
    }
    told
}

/// What a file with this mass, pack and wing alone describes.
pub(crate) fn usual(vehicle: &Vehicle) -> Vehicle {
    let text = format!(
        "[body]\nmass_kg = {:?}\n[wings]\ncentre_m = {:?}\n[battery]\ncells = {:?}\n",
        vehicle.body.mass_kg, vehicle.wings.centre_m, vehicle.battery.cells
    );
    Vehicle::from_toml(&text).unwrap_or_else(|_| vehicle.clone())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::make_bank::{BankSize, make};
    use crate::bank::missions;
    use crate::scene::Scene;

    #[test]
    fn val_a_bend_that_is_not_the_vehicles_is_named_with_what_became_of_the_flights() {
        // Wings that bend the wrong way throw the vehicle over on the first dash.
        let mut scene = Scene::lab().unwrap();
        scene.vehicle.wings.passive_dihedral_rad_per_mps = -0.4;
        let items = missions::plain(&scene);
        let size = BankSize { seeds: 0, jitter: 3, draws: 0 };
        let recipe = Recipe { scene: &scene, items: &items, library: &[], size, seed: 1 };
        let made = make(&recipe, |_, _| {});
        assert!(made.bank.jitter.is_empty(), "it flies");
        let said = why(&recipe, &made.ends);
        assert!(said.starts_with("3 "), "{said}");
        assert!(said.contains("vehicle.wings.passive_dihedral_rad_per_mps"), "{said}");
        assert!(said.contains("-0.400 in the vehicle file, with 0.000"), "{said}");
    }
}
