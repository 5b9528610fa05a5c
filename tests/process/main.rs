//! Tests of the real programs as processes, over real wires.

mod bad_input;
mod pymavlink;
mod support;
