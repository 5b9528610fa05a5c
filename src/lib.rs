//! Companion autopilot for flapping-wing drones on ultra-wideband positioning.
//!
//! `ARCHITECTURE.md` beside `Cargo.toml` states the layers; `tests/` enforces them.

pub mod checks;
pub mod drops;
pub mod estimate;
pub mod frames;
pub mod measure;
pub mod survey;
pub mod time;
pub mod topics;
