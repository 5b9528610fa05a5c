//! How far a long task is, for people, on standard error.

mod plan;
mod task;

pub use plan::stages;
pub use task::Progress;
