//! What the programs of this folder share with the laboratory: the experiments of the source, flown in lockstep. It
//! opens no port, waits for no clock and never sees the laboratory.
//!
//! ```
//! use haltere_core::control::Version;
//! use haltere_model::PlantConfig;
//! use haltere_sim::{compare::pilot_config, paths::fly_path};
//!
//! // A triangle around the middle of the hall, north and east in metres, and home again.
//! let corners = [[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]];
//! let pilot = pilot_config(None, &[])?;
//! let (score, flight) = fly_path(&pilot, Version::Modified, &corners, PlantConfig::hall(7))?;
//! assert!(flight.landed && !score.crashed);
//! // By the truth of the simulator: mean distance between vehicle and estimate, north, east and down.
//! assert!(score.estimate_m.iter().all(|off_m| *off_m < 0.15), "{score:?}");
//! # Ok::<(), anyhow::Error>(())
//! ```

pub mod compare;
pub mod ending;
pub mod hidden;
pub mod paper;
pub mod paths;
pub mod steps;
pub mod taped;
pub mod variation;
