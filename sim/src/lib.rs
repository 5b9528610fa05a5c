//! What the programs of this folder share with the laboratory: the experiments of the source, flown in lockstep. It
//! opens no port, waits for no clock and never sees the laboratory.

pub mod compare;
pub mod paper;
pub mod paths;
pub mod steps;
pub mod variation;
