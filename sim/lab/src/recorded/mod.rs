//! Studies of the estimator on recorded flights of others (`crate::util_flights`): parameters chosen with one flight
//! left out, every ingredient on and off, cold starts, faults, the floor, and the page of it, `docs/ESTIMATOR.md`.

pub mod cold;
pub mod document;
pub mod floor;
pub mod ingredients;
pub mod integrity;
pub mod ranging;
pub mod search;
