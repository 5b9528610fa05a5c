//! One function per target: bytes in, a panic where something is wrong.
//!
//! None may panic, hang, or grow without bound; what decodes must encode to what decodes the same.

pub mod core;
mod files;
mod wires;

pub use self::core::{ftp, missions, parameters, pilot};
pub use self::files::{config, csv, log, mission_file, outline, recover};
pub use self::wires::{crtp, mavlink, signing, sniffer, tdoa2, tdoa3};

/// A target: bytes in, a panic where something is wrong.
pub type Target = fn(&[u8]);

/// Every target with the name of its folder in the corpus.
pub const ALL: [(&str, Target); 16] = [
    ("sniffer", sniffer),
    ("tdoa2", tdoa2),
    ("tdoa3", tdoa3),
    ("crtp", crtp),
    ("mavlink", mavlink),
    ("signing", signing),
    ("mission_file", mission_file),
    ("missions", missions),
    ("parameters", parameters),
    ("ftp", ftp),
    ("log", log),
    ("outline", outline),
    ("recover", recover),
    ("csv", csv),
    ("config", config),
    ("pilot", pilot),
];
