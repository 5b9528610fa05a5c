//! Simulator and companion as processes, what stands between them, and what is told to them: for whatever flies both in real
//! time. The simulator's program is this one, or lies beside it.

mod companion;
mod configuration;
mod endpoint;
pub mod firmware;
mod output;
mod pair;
mod process;
pub mod pty;
pub mod stop;

pub use companion::{Companion, newest_log};
pub use configuration::Wiring;
pub use endpoint::{EXIT_NOT_JUDGED, Endpoint};
pub use output::Output;
pub use pair::{Pair, Setup};
pub use process::{Process, free_port, now_us, told};
