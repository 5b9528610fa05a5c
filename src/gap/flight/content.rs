//! What a log holds of its flight, so that a flight is known in whichever file it comes: copied, saved again, trimmed or compressed
//! otherwise.
//!
//! Two flights never shake alike: what the IMU measured is as good as a name. Of its samples those with one hash in [`KEPT_OF`] are kept,
//! the same ones in whatever part of the flight (Broder 1997); stamps and the order do not count.

use std::collections::BTreeSet;

use crate::bank::kept_file::fnv;
use crate::flight::trace::Trace;

/// One sample in so many is kept: some thousands of a flight.
const KEPT_OF: u64 = 8;
/// Share of the smaller one that two logs of one flight have in common, at least. Flights of one simulator that begin with the same seed
/// have what was measured before take-off in common, a twentieth.
const SAME: f64 = 0.5;
/// Fewer samples than this are no flight.
const LEAST: usize = 16;

/// Hashes of what the IMU measured.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Content(BTreeSet<u64>);

impl Content {
    /// Of a flight.
    pub fn of(trace: &Trace) -> Self {
        let hash = |sample: &haltere_core::measure::ImuSample| {
            let six = [sample.acc_B_mps2.raw(), sample.rate_B_radps.raw()];
            let bytes: Vec<u8> =
                six.iter().flat_map(|v| v.iter()).flat_map(|x| x.to_bits().to_le_bytes()).collect();
            fnv(&bytes)
        };
        // The last bits of this hash are those that each byte moves least.
        Self(trace.imu.iter().map(hash).filter(|hash| (hash >> 32) % KEPT_OF == 0).collect())
    }

    /// Whether both are logs of one flight, or of parts of one that overlap for the most part.
    pub fn is_of_the_flight_of(&self, other: &Self) -> bool {
        let smaller = self.0.len().min(other.0.len());
        let common = self.0.intersection(&other.0).count();
        smaller >= LEAST && common as f64 > SAME * smaller as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::fly::fly_observed;
    use crate::bank::missions;
    use crate::scene::Scene;

    #[test]
    fn prop_a_flight_is_known_by_what_was_measured() {
        let scene = Scene::lab().unwrap();
        let fly = |seed, items: &[_]| {
            fly_observed(&scene, items, scene.plant(seed), scene.pilot.clone()).unwrap()
        };
        let plain = missions::plain(&scene);
        let flown = fly(5, &plain);
        let whole = Content::of(&flown);
        assert!(whole.is_of_the_flight_of(&whole.clone()));
        // Its last third, with other stamps.
        let mut part = flown.clone();
        part.imu.drain(..2 * flown.imu.len() / 3);
        for sample in &mut part.imu {
            sample.valid_at = sample.valid_at.offset_us(7_000_000);
        }
        let part = Content::of(&part);
        assert!(part.is_of_the_flight_of(&whole) && whole.is_of_the_flight_of(&part));
        // The same vehicle on another day, and by the same seed on another mission.
        let others = [fly(6, &plain), fly(5, &missions::held_out(&scene))];
        for other in others {
            assert!(!Content::of(&other).is_of_the_flight_of(&whole));
        }
        assert!(!Content::default().is_of_the_flight_of(&Content::default()));
    }
}
