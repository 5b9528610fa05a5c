//! What was flown: logs are written, read, lived through again and given to other programs, and recordings of others are
//! read. It never flies, judges or draws anything.

pub mod export;
pub mod import;
pub mod record;
pub mod replay;

pub(crate) use haltere_core::{
    checks, drops, estimate, estimator, frames, measure, survey, time, topics,
};
pub(crate) use haltere_pilot as pilot;
pub(crate) use haltere_pilot::settings;
