//! Diagnosis of the gap between a flight and the nominal simulator: where it lies, which unmodelled
//! effect causes it, how far it shrinks once that effect is added. It draws no page and never sees the truth of a flight,
//! except where it is asked how far the estimate was off.
//!
//! Begin with [`diagnosis`] and `attribute/mod.rs`. The way of a flight: [`logs`] is gate 0, [`trace`] what may be seen of
//! it, [`smoother`] where it was, `residuals` one channel a file, [`statistics`] its numbers. What it is held against:
//! [`scene`] room, vehicle and companion, [`library`] and [`make_bank`] the simulated flights, where every effect flies
//! beside a twin without it, [`workshop`] what is kept on disk. What is said: `attribute` which effect, with `gate.rs`
//! whether there is a gap at all and `foretold.rs` what it foretells, [`places`] where, [`shrink`] how far, [`advise`] what
//! to fly next, [`accept`] what is written back, [`commission`] the constants with which the simulator flies as accepted
//! flights were flown.
//!
//! ```
//! use haltere_gap::scene::Scene;
//! use haltere_gap::{library, missions};
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
pub mod accepted;
pub mod advise;
pub mod archive;
pub mod attribute;
pub mod axis;
pub mod bank;
pub mod bank_file;
pub mod commission;
pub mod details;
pub mod diagnosis;
pub mod discriminate;
pub mod experiments;
pub mod flight;
pub mod fly;
pub mod held_out;
pub mod kept_file;
pub mod library;
pub mod make_bank;
mod manoeuvres;
pub mod matrix;
pub mod missions;
pub mod nominal;
mod normal;
mod not_flown;
pub mod onset;
pub mod outcome;
pub mod picture;
pub mod places;
pub mod resize;
pub mod said;
pub mod scene;
pub mod shrink;
pub mod trim;
pub mod workshop;

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_killed;

/// Hash of what decides how a simulated flight goes and what is said of a flight (`BANK` in `src/gap/build.rs`). The words
/// of the program are not among it.
pub const BANK_HASH: &str = env!("HALTERE_BANK_HASH");
