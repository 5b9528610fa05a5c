//! How far a long task is, for people, on standard error. Where nobody sees a line move, a few lines say the same.

mod bar;
mod job;
mod line;
mod plan;

pub use bar::Bar;
pub use job::Progress;
pub use line::Line;
pub use plan::stages;
