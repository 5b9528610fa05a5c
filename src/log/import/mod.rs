//! Recorded flights of other people and other programs: files to one neutral form.
//!
//! Every layout is a file here; all signs and units of a layout are turned once, in its reader. What
//! comes out is in our frames (NED, FRD) and SI. `docs/IMPORT.md` describes the layout of our own.

pub mod boards;
pub mod bounded;
pub mod columns;
pub mod dataflash;
pub mod events;
pub mod flapper;
pub mod motion;
pub mod motors;
pub mod recording;
pub mod stand;
pub mod truth;
pub mod ulog;
pub mod usdlog;

pub use recording::{Error, Recording, Row, Skipped};
