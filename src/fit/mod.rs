//! Identification: numbers of the vehicle from flight logs.

pub mod trim;
