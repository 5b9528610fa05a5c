//! The languages haltere speaks outside, as pure codecs without I/O.

// Generated code names the crate `mavlink_core`; the alias must stand in the crate root.
extern crate mavlink as mavlink_core;

#[allow(missing_docs, clippy::all)]
pub mod mav;
