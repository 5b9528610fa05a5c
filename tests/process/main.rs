//! Tests of the real programs as processes, over real wires.

mod bad_input;
mod flights;
mod gap;
mod pymavlink;
mod support;
