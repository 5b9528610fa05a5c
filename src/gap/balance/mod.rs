//! Diagnosis without a simulator: a quadrotor that hovers holds its forces and moments in balance, and what its motors were
//! told says what of the balance has changed since flights that were accepted.
//!
//! ```text
//! flight ─► hover ─► balance less that of references ─► causes, weighed against "nothing" and "something else" ─► outcome
//! ```
//!
//! [`hover`] is the balance of one flight, [`causes`] what a cause adds to it, [`weigh`] how probable each is by what references
//! scatter, [`judge`] what follows, `said` the words. Nothing is flown, so that a flight takes milliseconds; nothing but the motors' commands is
//! needed, and what is not there is told as not checked. Where the user has a simulator, [`flown`] is what it says that causes do. [`fill`]
//! is the vehicle file from flights.
//!
//! A vehicle that has a bank has a balance too, of forces, actuators and battery: [`beside`] compares what both say.
//!
//! Where it is blind: a weak motor and a load at its place ask nearly the same of the motors, since on recorded flights a load at a motor
//! changes yaw as well. What tells them apart is that a cut propeller shakes; where it does not, they are a set. Thrust that all motors lack
//! alike is a load in the middle, another battery or other propellers.

pub mod beside;
pub mod causes;
pub mod fill;
pub mod flown;
pub mod hover;
pub mod judge;
pub mod report;
pub mod weigh;

mod said;
#[cfg(test)]
mod tests;

pub use hover::Hover;
pub use judge::diagnose;
pub use report::Report;
