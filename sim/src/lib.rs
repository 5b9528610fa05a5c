//! What the laboratory holds against its own: which effects `haltere-sim hide` hides, and how strong. It opens no port, waits
//! for no clock and never sees the laboratory.

pub mod hidden;
