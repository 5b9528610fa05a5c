//! Commands of the laboratory whose work is done by a module of the same or a kindred name beside this folder.

pub mod advise;
pub mod balance;
pub mod blind;
pub mod flights;
pub mod ladder;
pub mod recorded;
pub mod sight;
