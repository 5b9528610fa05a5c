//! What a flight says of itself: its log through gate 0 ([`logs`]), what may be seen of it ([`trace`]), where it was
//! ([`smoother`]), one channel a file ([`residuals`]), its numbers ([`statistics`]).

pub(crate) mod as_flown;
pub mod beside_truth;
pub mod cells;
pub(crate) mod content;
pub mod logs;
pub mod regress;
pub mod residuals;
pub mod seal;
pub mod smoother;
pub mod statistics;
pub mod timeline;
pub mod trace;
