//! Diagnosis of the gap between a flight and the nominal simulator: where it lies, which unmodelled
//! effect causes it, how far it shrinks once that effect is added. It draws no page and never sees the truth of a flight,
//! except where it is asked how far the estimate was off.
//!
//! Begin with [`diagnosis`] and `attribute/mod.rs`. The way of a flight: [`flight::logs`] is gate 0, [`flight::trace`] what may be seen of
//! it, [`flight::smoother`] where it was, `residuals` one channel a file, [`flight::statistics`] its numbers. What it is held against:
//! [`scene`] room, vehicle and companion, [`bank::library`] and [`bank::make_bank`] the simulated flights, where every effect flies
//! beside a twin without it, [`bank::workshop`] what is kept on disk. What is said: `attribute` which effect, with `gate.rs`
//! whether there is a gap at all and `foretold.rs` what it foretells, [`places`] where, [`shrink`] how far, [`advice`] what
//! to fly next, [`accept`] what is written back, [`commission`] the constants with which the simulator flies as accepted
//! flights were flown; [`balance`] judges quadrotors of others without any simulator.
//!
//! ```
//! use haltere_gap::bank::{library, missions};
//! use haltere_gap::scene::Scene;
//!
//! // The flight that tells most, for a room; and what can be told apart by it.
//! let scene = Scene::lab()?;
//! let mission = missions::diagnostic_file(&scene);
//! assert!(mission.items.len() > 10);
//! let effects = library::standard();
//! let (vehicle, room) = (&scene.vehicle, &scene.room);
//! for spec in &effects {
//!     assert!(!library::axes(spec, vehicle, room, scene.survey.ids().len()).is_empty(), "{}", spec.id);
//! }
//! # Ok::<(), haltere_core::checks::Problems>(())
//! ```

pub mod accept;
pub mod advice;
pub mod attribute;
pub mod balance;
pub mod bank;
pub mod commission;
pub mod diagnosis;
pub mod flight;
pub mod nominal;
mod normal;
pub mod outcome;
pub mod picture;
pub mod places;
pub mod said;
pub mod scene;
pub mod shrink;

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_killed;

/// Hash of what decides how a simulated flight goes and what is said of a flight (`BANK` in `src/gap/build.rs`). The words
/// of the program are not among it.
pub const BANK_HASH: &str = env!("HALTERE_BANK_HASH");
