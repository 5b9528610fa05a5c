//! Companion autopilot for flapping-wing drones on ultra-wideband positioning.
//!
//! `ARCHITECTURE.md` beside `Cargo.toml` states the layers; `tests/` enforces them.

pub mod checks;
pub mod cli;
pub mod config;
pub mod control;
pub mod ctl;
pub mod drops;
pub mod estimate;
pub mod estimator;
pub mod export;
pub mod fit;
pub mod frames;
pub mod gap;
pub mod geo;
pub mod guard;
pub mod import;
pub mod live;
pub mod lockstep;
pub mod measure;
pub mod mission_file;
pub mod model;
pub mod pilot;
pub mod preflight;
pub mod progress;
pub mod record;
pub mod reference;
pub mod replay;
pub mod report;
pub mod sources;
pub mod store;
pub mod survey;
pub mod tape;
pub mod time;
pub mod topics;
pub mod util_flights;
pub mod uwb;
pub mod watch;
