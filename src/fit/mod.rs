//! Identification: numbers of the vehicle from flight logs.
//!
//! The cores are pure: columns in, parameters with standard errors out. `correlated` says what a
//! standard error is worth when noise lasts; each fit is a file.

pub mod correlated;
pub mod linear;
pub mod polynomial;
pub mod steady;
pub mod transient;
pub mod trim;
pub mod value;

pub use value::Value;
