//! What goes out: bytes by link, texts, events, records, and what was thrown away.

pub(crate) mod event_list;
pub(crate) mod events;
pub(crate) mod losses;
pub(crate) mod output;
pub(crate) mod passed_on;
pub(crate) mod recording;
pub(crate) mod shelf;
pub(crate) mod voice;
