//! The doors of the companion: which frames may come in at all, and which go out signed.
//!
//! A [`Door`] stands between a link and the core. It cuts the stream into frames, keeps to a rate,
//! asks the [`KeyRing`] about signatures and lets whole frames through; what it keeps out it counts.
//! Everything behind it, the flight log too, sees only what came through, so a replay needs no key and
//! a log holds none: `SETUP_SIGNING`, which carries the key, ends here.
//!
//! Pure: bytes, times and keys are arguments.
//!
//! ```text
//! link ─► rate ─► frames ─► signature and its time ─► core, log
//! link ◄──────── signature ◄───────────────────────── core, log
//! ```

mod door;
mod rate;
mod ring;

pub use door::{Door, DoorConfig, KeyOffer};
pub use rate::RateLimit;
pub use ring::{KeyRing, MINUTE, Standing, TimeNews};

use haltere_core::keys::NoNumber;
use serde::{Deserialize, Serialize};

/// What a link demands of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Signing {
    /// Signatures are neither looked at nor made.
    #[default]
    Off,
    /// Frames go out signed; unsigned ones come in, wrongly signed ones do not.
    Accept,
    /// Frames go out signed; only signed ones come in, and the exceptions of `signing.unsigned`.
    Require,
}

/// Who may give us a key with `SETUP_SIGNING`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum KeySetup {
    /// Nobody: the key file is changed by hand.
    #[default]
    Never,
    /// Who signs with the key in force.
    Signed,
    /// Anybody on this link.
    Anybody,
}

impl NoNumber for Signing {}
impl NoNumber for KeySetup {}

#[cfg(test)]
mod tests;
