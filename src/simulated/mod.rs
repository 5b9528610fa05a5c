//! Simulated flights as files say them: a scenario with what breaks in it, and campaigns of many. Simulator and laboratory fly
//! them; the companion knows nothing of it.

pub mod built_in;
pub mod campaign;
pub mod faults;
pub mod scenario;
