//! Flight recorder: what the pilot core lived through, as MCAP, and back.
//!
//! A log holds every input of the core in its order, every byte that it sent, the configuration
//! and the build (so that `replay` can live through it again), and the decoded topics (so that
//! log viewers open it directly). All messages are protobuf with their schema in the file.
//!
//! | channel | holds |
//! |---|---|
//! | `/config` | [`pb::Session`], first message of the file, and once more in the chunk behind |
//! | `/in/tag` `/in/board` `/in/ground/N` | bytes as handed to the core |
//! | `/in/event` | links that came up or went down |
//! | `/in/peer` | whose bytes come next on a link of many ends |
//! | `/in/lost` | losses around the core, as told to it |
//! | `/in/file` | what the disk answered to the core |
//! | `/in/recording` | that the recording stopped, or goes on |
//! | `/wake` | wake-ups of the core |
//! | `/out/tag` `/out/board` `/out/ground/N` | bytes that the core sent |
//! | `/imu` `/uwb` `/estimate` `/control` … | decoded topics |
//! | `/glue` | how late the core was woken |
//! | `/hole` | what the recorder itself had to leave out |
//! | `/closing` | last message of a log that was closed properly |

pub mod back;
mod budget;
mod channels;
mod convert;
mod entry;
mod errors;
mod flights;
mod forms;
mod identity;
mod messages;
mod names;
mod outline;
mod patient;
mod queue;
mod reader;
mod recorder;
mod recover;
mod room;
mod scribe;
mod session;
mod source;
mod tail;
mod trim;
mod writer;

pub use channels::{Decoded, GlueState, link_from_name, link_name};
pub use entry::{Entry, RawInput};
pub use errors::{LogEnd, LogError};
pub use flights::{FlightPart, Flights, LogFlight, is_on_floor};
pub use identity::BuildIdentity;
pub use names::{in_the_way, utc_text};
pub use outline::Outline;
pub use reader::{Entries, LogReader};
pub use recorder::{Recorder, RecorderSummary};
pub use recover::{recover, recovered_name};
pub use room::{Limits, Room};
pub use session::Session;
pub use trim::{Trimmed, trim, trimmed_name};
pub use writer::RecordError;

/// Message types of the log, generated from `haltere.proto`.
#[allow(missing_docs, clippy::all)]
pub mod pb {
    include!(concat!(env!("OUT_DIR"), "/haltere.rs"));
}

/// `haltere.proto`, compiled: the schema that is written into every log.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/haltere_descriptors.bin"));

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_damaged;
#[cfg(test)]
mod tests_killed;
#[cfg(test)]
mod tests_room;
