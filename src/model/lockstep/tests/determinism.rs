//! The same seed gives the same flight, to the last byte.

use std::sync::{Arc, Mutex};

use super::*;
use crate::lockstep::fly;

/// Everything the core sent in a flight of a square.
fn flown(seed: u64) -> Vec<(u64, haltere_pilot::LinkId, Vec<u8>)> {
    let sent = Sent::default();
    let mut world = world(seed).with_tap(tap(&sent));
    let flight = fly(&mut world, &square(), 40.0).unwrap();
    assert!(flight.samples.len() > 1000);
    drop(world);
    Arc::try_unwrap(sent).map(Mutex::into_inner).unwrap().unwrap()
}

#[test]
fn prop_a_seed_decides_every_byte() {
    let first = flown(11);
    // A setpoint every 10 ms alone makes that many.
    assert!(first.len() > 3000, "{}", first.len());
    assert!(first == flown(11), "two runs with one seed differ");
    assert!(first != flown(12), "two seeds give one flight");
}
