//! The languages haltere speaks outside, as pure codecs without I/O.

// Generated code names the crate `mavlink_core`; the alias must stand in the crate root.
extern crate mavlink as mavlink_core;

mod crc;
pub mod lps;
#[allow(missing_docs, clippy::all)]
pub mod mav;
pub mod mav_stream;
mod scanner;
pub mod signing;

/// Folder with `haltere.xml` and the definitions that it includes, as this crate was built from
/// them: for other generators, such as pymavlink's in the tests.
pub const XML_FOLDER: &str = env!("HALTERE_DIALECT_XML");
