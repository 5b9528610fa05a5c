//! The generated MAVLink dialect: `common` and the messages of `xml/haltere.xml`.

pub use mavlink::*;

include!(concat!(env!("OUT_DIR"), "/generated/mod.rs"));
