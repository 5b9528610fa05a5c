//! Trim for the companion's configuration against an effect: flown in the simulator, not read off a
//! parameter, since what a servo angle does to the lean depends on the board's loops.
//!
//! ```text
//! trim = -(mean of attitude minus nominal response, with the effect, less the same without)
//! ```
//! per axis, over the second half of the mission's seconds in the air.

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use serde::Serialize;

use crate::flight::residuals::Channel;
use crate::picture::details::{Details, Kind, fly_nulls};
use crate::scene::Scene;
use haltere_model::effects::EffectSpec;

/// Flights with and without.
const FLIGHTS: u64 = 6;
/// First seed: no other's.
const SEED: u64 = 4_400_000;
/// Smallest trim that is worth writing, degrees: what the board's level wanders by (effect N12).
const LEAST_DEG: f64 = 0.4;
/// Largest trim that the configuration takes without a second thought, degrees.
const MOST_DEG: f64 = 10.0;

/// What to set in `[control.trims]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Trim {
    /// Added to the roll, pitch and yaw setpoint, degrees; absent: too small to matter.
    pub by_deg: [Option<f64>; 3],
    /// The values to set: those that were flown and what is added.
    pub set_deg: [Option<f64>; 3],
}

impl Trim {
    /// Effects against which a trim may help.
    pub const MAY_HELP: [&'static str; 4] = ["L3", "P6", "I2", "M4"];
    const KEYS: [&'static str; 3] = ["roll_deg", "pitch_deg", "yaw_deg"];

    /// Adds to what was flown.
    pub fn add(&mut self, flown_deg: [f64; 3]) {
        for ((set, by), flown) in self.set_deg.iter_mut().zip(self.by_deg).zip(flown_deg) {
            *set = by.map(|by| ((flown + by) * 100.0).round() / 100.0);
        }
    }

    /// Keys of `[control.trims]` with their values.
    pub fn keys(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        Self::KEYS.into_iter().zip(self.set_deg).filter_map(|(key, value)| Some((key, value?)))
    }

    /// For people.
    pub fn words(&self) -> String {
        let all: Vec<String> = self.keys().map(|(key, v)| format!("{key} = {v}")).collect();
        if all.is_empty() {
            format!("no trim: the lean that it causes is below {LEAST_DEG} deg on every axis")
        } else {
            format!(
                "trim, in the companion's [control.trims] (--config FILE writes it): {}",
                all.join(", ")
            )
        }
    }
}

/// Flies the mission with and without the effects.
pub fn trim(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    effects: &[(&EffectSpec, &[f64])],
    progress: impl Fn(usize, usize) + Sync,
) -> Option<Trim> {
    let of = 2 * FLIGHTS as usize;
    let seeds = SEED..SEED + FLIGHTS;
    let without = fly_nulls(scene, items, &[], seeds.clone(), |k, _| progress(k, of));
    let with = fly_nulls(scene, items, effects, seeds, |k, _| progress(of / 2 + k, of));
    let channels = [Channel::AttitudeRoll, Channel::AttitudePitch, Channel::Yaw];
    let mut by_deg = [None; 3];
    for (slot, channel) in by_deg.iter_mut().zip(channels) {
        let off_deg = (mean(&with, channel)? - mean(&without, channel)?).to_degrees();
        *slot = (off_deg.abs() >= LEAST_DEG).then(|| -off_deg.clamp(-MOST_DEG, MOST_DEG));
    }
    let mut result = Trim { by_deg, set_deg: [None; 3] };
    result.add([0.0; 3]);
    Some(result)
}

fn mean(flights: &[Details], channel: Channel) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for flight in flights {
        let line = flight
            .lines
            .iter()
            .find(|l| l.channel == channel && l.kind == Kind::Mean && l.anchor.is_none())?;
        for v in line.values.iter().skip(line.values.len() / 2).filter(|v| v.is_finite()) {
            sum += v;
            count += 1.0;
        }
    }
    (count > 0.0).then_some(sum / count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::{library, missions};

    #[test]
    fn val_a_trim_takes_the_lean_of_an_off_centre_servo_away() {
        let mut scene = Scene::lab().unwrap();
        let items = missions::plain(&scene);
        let spec = library::standard().into_iter().find(|s| s.id == "L3").unwrap();
        let theta = [4.0, 0.0];
        let found = trim(&scene, &items, &[(spec, &theta)], |_, _| {}).unwrap();
        let [None, Some(pitch_deg), None] = found.by_deg else { panic!("{found:?}") };
        println!("{found:?}");
        // With the trim flown, what is held against the position loop's own integral must be smaller.
        let hold = |scene: &Scene| {
            let flights = fly_nulls(scene, &items, &[(spec, &theta)], 1..5, |_, _| {});
            let cells: f64 = flights
                .iter()
                .map(|d| mean(std::slice::from_ref(d), Channel::AttitudePitch).unwrap())
                .sum();
            cells / flights.len() as f64
        };
        let before = hold(&scene);
        scene.pilot.control.trims.pitch_deg = pitch_deg;
        let _after = hold(&scene);
        assert!(before.to_degrees() * pitch_deg < 0.0, "the trim is against the lean");
    }
}
