//! Identification: numbers of the vehicle from flight logs.
//!
//! The cores are pure: columns in, parameters with standard errors out. `correlated` says what a
//! standard error is worth when noise lasts; each fit is a file. `tell` takes the columns out of
//! files and says what came of them; `programs` are the flights that show what a fit needs.

pub mod anchors;
pub mod columns;
pub mod correlated;
#[cfg(test)]
mod coverage;
#[cfg(test)]
mod coverage_noise;
pub mod ground;
pub mod imu;
pub mod lag;
pub mod linear;
pub mod outcome;
pub mod polynomial;
pub mod programs;
pub mod source;
pub mod steady;
pub mod tell;
pub mod transient;
pub mod trim;
pub mod value;

pub use value::Value;
