//! Tests of the real programs as processes, over real wires.

mod bad_input;
mod beside;
mod campaign;
mod fits;
mod flights;
mod gap;
mod operation;
mod outputs;
mod packages;
mod pymavlink;
mod rotation;
mod square;
mod support;
mod tutorials;
