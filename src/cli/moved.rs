//! Commands that the laboratory has now: whoever calls one here is told, in one line, what to call in its place.

use std::ffi::OsString;
use std::process::ExitCode;

/// Wrong usage, as of any command that is not there.
const EXIT_USAGE: u8 = 2;

/// Whatever stood behind the name of such a command.
#[derive(Debug, clap::Args)]
pub struct Moved {
    /// Not looked at.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    args: Vec<OsString>,
}

impl Moved {
    /// Says that another command does what `was` did.
    pub fn now(&self, was: &str, now: &str) -> ExitCode {
        eprintln!("{was} is no more: use `{now}`");
        ExitCode::from(EXIT_USAGE)
    }

    /// Says that the command `was` is `now`, in the laboratory.
    pub fn say(&self, was: &str, now: &str) -> ExitCode {
        say(was, now)
    }
}

/// The same for an option of a command that has stayed.
pub(super) fn say(was: &str, now: &str) -> ExitCode {
    eprintln!("{was} is a matter of the laboratory: use `{now}`");
    ExitCode::from(EXIT_USAGE)
}
