//! What was asked of the disk for programs, which are missions by name.

use crate::stations::mission_transfer::Client;

/// What an answer of the disk is for.
#[derive(Debug)]
pub(crate) enum Job {
    /// The names were asked for.
    Names(Client),
    /// The one with this number is to be loaded.
    Number(Client, u16),
    /// It was found under this name.
    Load(Client, String),
}
