//! Diagnosis of the gap between a flight and the nominal simulator: where it lies, which unmodelled
//! effect causes it, how far it shrinks once that effect is added. It draws no page and never sees the truth of a flight,
//! except where it is asked how far the estimate was off.
//!
//! ```no_run
//! use haltere_gap::door::{Flights, Options, References, Simulator, diagnose, in_words};
//!
//! let flights = Flights {
//!     log: "bad/diagnostic-101.mcap".into(),
//!     held_out: vec!["bad/held-out-101.mcap".into(), "bad/held-out-102.mcap".into()],
//!     ..Flights::default()
//! };
//! let references = References { same_mission: vec!["good".into()], ..References::default() };
//! let diagnosis = diagnose(&flights, &Simulator::default(), &references, &Options::default())?;
//! println!("{}", in_words(&diagnosis));
//! # Ok::<(), haltere_gap::door::Refused>(())
//! ```
//!
//! The way of a flight: [`flight::logs`] is gate 0, [`flight::trace`] what may be seen of it, [`flight::smoother`] where it was,
//! `flight::residuals` one channel a file, [`flight::statistics`] its numbers. What it is held against: [`scene`] room, vehicle and
//! companion, [`bank::library`] and [`bank::make_bank`] the simulated flights, where every effect flies beside a twin without it,
//! [`bank::workshop`] what is kept on disk. What is said: [`attribute`] which effect, [`places`] where, [`shrink`] how far,
//! [`advice`] what to fly next, [`said`] the sentence of an effect, [`accept`] what is written back, [`commission`] the constants with
//! which the simulator flies as accepted flights were flown. [`door`] leads through all of it and says it in plain words.
//! [`balance`] judges quadrotors of others without any simulator.

pub mod accept;
pub mod advice;
pub mod attribute;
pub mod balance;
pub mod bank;
pub mod commission;
pub mod diagnosis;
pub mod door;
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
