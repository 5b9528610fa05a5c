//! The programs of this binary as processes: the endpoint, the companion, and the configuration
//! between them.

mod companion;
mod configuration;
mod endpoint;
mod output;
mod process;

pub use companion::Companion;
pub use configuration::Wiring;
pub use endpoint::Endpoint;
pub use output::Output;
pub use process::{Process, free_port, now_us};
