//! Diagnosis of the gap between a flight and the nominal simulator: where it lies, which unmodelled
//! effect causes it, how far it shrinks once that effect is added.

pub mod balance;
pub mod lines_of_sight;
pub mod missions;
pub mod scene;
