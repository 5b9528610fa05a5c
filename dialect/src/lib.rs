//! The languages haltere speaks outside, as pure codecs: bytes in, messages out, and back. They keep no link and ask no
//! clock.
//!
//! Begin with [`mav_stream`], whose header says what damage costs. `xml/haltere.xml` holds our messages, one file for every
//! generator; `lps` reads the sniffer's frames, TDoA2 and TDoA3; `crtp` the packets of a Crazyflie; `signing` makes and
//! checks signatures as bytes.
//!
//! ```
//! use haltere_dialect::mav::haltere::{MavMessage, PING_DATA};
//! use haltere_dialect::mav_stream::{MavSplitter, encode};
//!
//! let mut bytes = b"noise".to_vec();
//! let ping = MavMessage::PING(PING_DATA { seq: 3, ..Default::default() });
//! encode(&mut bytes, 1, 1, 7, &ping);
//!
//! let mut splitter = MavSplitter::new();
//! splitter.push(&bytes);
//! let mut found = Vec::new();
//! while let Some(frame) = splitter.next() {
//!     // What is no frame is an error with its size, never silence.
//!     found.extend(frame.ok().and_then(|frame| frame.decode().ok()));
//! }
//! assert!(found == [ping]);
//! ```

// Generated code names the crate `mavlink_core`; the alias must stand in the crate root.
extern crate mavlink as mavlink_core;

mod crc;
pub mod crtp;
pub mod lps;
#[allow(missing_docs, clippy::all)]
pub mod mav;
pub mod mav_stream;
mod scanner;
pub mod signing;

/// Folder with `haltere.xml` and the definitions that it includes, as this crate was built from
/// them: for other generators, such as pymavlink's in the tests.
pub const XML_FOLDER: &str = env!("HALTERE_DIALECT_XML");
