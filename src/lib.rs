//! Companion autopilot for flapping-wing drones on ultra-wideband positioning: what the program `haltere` is made of beside
//! the libraries that it names here. It never needs the simulator's programs.
//!
//! Begin with `live/core.rs`, the threads and deadlines around the pilot core, and `cli/mod.rs`, the commands. [`sources`]
//! says where a configuration comes from, [`store`] is the disk behind the core, [`watch`] the flight in a browser,
//! [`preflight`] what `haltere check` looks at, [`ctl`] a small station, [`fit`] the identification, [`report`] the pages,
//! [`reference`] pages of `docs/` made from the code.
//!
//! `ARCHITECTURE.md` beside `Cargo.toml` states the layers; `tests/` enforces them.
//!
//! ```
//! use haltere::sources::{self, Sources};
//!
//! // As `haltere fly --set flight.takeoff_height_m=1.1` reads it; what is wrong is said at once, with the way out.
//! let told = |set: &str| Sources { overrides: vec![set.into()], ..Sources::default() };
//! let config = sources::load(&told("flight.takeoff_height_m=1.1"))?;
//! assert_eq!(config.flight.takeoff_height_m, 1.1);
//! assert!(sources::load(&told("flight.takeoff_height_m=900")).is_err());
//! # Ok::<(), haltere_core::checks::Problems>(())
//! ```

pub mod cli;
pub mod ctl;
pub mod ending;
pub mod fit;
pub mod live;
pub mod named_missions;
pub mod preflight;
pub mod progress;
pub mod reference;
pub mod report;
pub mod rig;
pub mod simulated;
pub mod sources;
pub mod store;
pub mod tape;
pub mod taped;
pub mod vehicles;
pub mod watch;
