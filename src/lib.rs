//! Companion autopilot for flapping-wing drones on ultra-wideband positioning.
//!
//! `ARCHITECTURE.md` beside `Cargo.toml` states the layers; `tests/` enforces them.

pub use haltere_core::{
    checks, control, drops, estimate, estimator, frames, geo, measure, survey, time, topics,
};

pub use haltere_gap as gap;
pub use haltere_log::{export, import, record, replay};
pub use haltere_model as model;
pub use haltere_model::lockstep;
pub use haltere_pilot as pilot;
pub use haltere_pilot::{guard, mission_file, settings, uwb};

pub mod cli;
pub mod ctl;
pub mod fit;
pub mod live;
pub mod preflight;
pub mod progress;
pub mod reference;
pub mod report;
pub mod sources;
pub mod store;
pub mod tape;
pub mod util_flights;
pub mod watch;
