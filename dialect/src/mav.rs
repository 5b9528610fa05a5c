//! The generated MAVLink dialect: `common` and the messages of `xml/haltere.xml`.

pub use mavlink::*;

include!(concat!(env!("OUT_DIR"), "/generated/mod.rs"));

use std::fmt::Debug;

use num_traits::FromPrimitive;

/// What a number of a received message means; `None`: the dialect has no name for it.
pub fn known<T: FromPrimitive>(number: impl Into<u64>) -> Option<T> {
    T::from_u64(number.into())
}

/// Its name for people, or the number itself.
pub fn name_of<T: FromPrimitive + Debug>(number: impl Into<u64> + Copy) -> String {
    known::<T>(number).map_or_else(|| number.into().to_string(), |value| format!("{value:?}"))
}
