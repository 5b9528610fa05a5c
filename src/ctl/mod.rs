//! A small ground station: arms, flies and uploads missions over plain MAVLink.
//!
//! For scripts (`haltere ctl`), for the demo and for tests. It knows the vehicle only from the
//! outside, through the messages any ground station uses, and shares no code with the pilot.

mod action;
mod callers;
mod guests;
mod link;
mod mission;
pub mod plan_file;
mod station;
mod transfer;
mod vehicle;

use std::time::Duration;

use haltere_dialect::mav::haltere::{MavCmd, MavMissionResult, MavResult};
use haltere_pilot::settings::{Address, AddressError, HostPort};

pub use action::{Action, Target, USUAL, run};
pub use callers::{Caller, Place, Wanted};
pub use mission::{read_mission, read_plan};
pub use plan_file::PlanFile;
pub use station::{GroundStation, Mode, Setpoint};
pub use vehicle::{LandedState, Vehicle};

/// What can go wrong between a ground station and a vehicle.
#[derive(Debug, thiserror::Error)]
pub enum CtlError {
    /// The address cannot be read.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// A ground station does not use this kind of address.
    #[error(
        "{address}: a ground station uses udpin:HOST:PORT, udpout:HOST:PORT or tcpout:HOST:PORT"
    )]
    Kind {
        /// As given.
        address: Address,
    },
    /// The socket failed.
    #[error("{address}: {error}")]
    Io {
        /// Where.
        address: String,
        /// What the system says.
        error: std::io::Error,
    },
    /// Nobody there.
    #[error(
        "{address}: no heartbeat of a vehicle{wanted} within {} s; {}", waited.as_secs_f64(), heard_instead(others)
    )]
    NoHeartbeat {
        /// Where.
        address: String,
        /// Which one.
        wanted: Wanted,
        /// Others that were heard.
        others: Vec<String>,
        /// How long.
        waited: Duration,
    },
    /// Nothing can be heard there.
    #[error(
        "udpin:{at}: cannot listen there: {why}; end that program; or, if it is the vehicle that listens (a \
         `udpin` endpoint), speak to it with --to udpout:{at}; or give your vehicle another ground endpoint, and name that \
         with --to"
    )]
    Listen {
        /// Where.
        at: HostPort,
        /// Why.
        why: std::io::Error,
    },
    /// It is not ours to choose.
    #[error(
        "{address}: {} vehicles speak here: {}; choose one with --system N or --from IP:PORT, or give each a ground \
         endpoint of its own and name that with --to", vehicles.len(), vehicles.join("; and ")
    )]
    Several {
        /// Where.
        address: String,
        /// Which.
        vehicles: Vec<String>,
    },
    /// A command was answered with a refusal.
    #[error("{command:?} refused: {result:?}{}", quoted(texts))]
    Refused {
        /// The command.
        command: MavCmd,
        /// The answer.
        result: MavResult,
        /// What the vehicle said meanwhile.
        texts: Vec<String>,
    },
    /// A command was not answered.
    #[error(
        "{command:?} not answered after {tries} tries of {} s; a vehicle that demands signatures answers \
         nobody without its key (--signing-key)", each.as_secs_f64()
    )]
    NoAnswer {
        /// The command.
        command: MavCmd,
        /// How often it was sent.
        tries: u32,
        /// How long each time.
        each: Duration,
    },
    /// A mission was refused.
    #[error("mission refused: {result:?}{}", quoted(texts))]
    MissionRefused {
        /// The answer.
        result: MavMissionResult,
        /// What the vehicle said meanwhile.
        texts: Vec<String>,
    },
    /// Something awaited did not happen.
    #[error("waited {} s for {what}, in vain{}", waited.as_secs_f64(), quoted(texts))]
    Timeout {
        /// What was awaited.
        what: String,
        /// How long.
        waited: Duration,
        /// What the vehicle said meanwhile.
        texts: Vec<String>,
    },
    /// The vehicle has fallen silent.
    #[error("no heartbeat for {} s: the companion is gone, or the way to it{}", silent.as_secs_f64(), quoted(texts))]
    Gone {
        /// How long.
        silent: Duration,
        /// What the vehicle said before.
        texts: Vec<String>,
    },
    /// The vehicle was down before its mission was done.
    #[error("the flight ended {}{}", ended_after(*reached, *items), quoted(texts))]
    Ended {
        /// Last item that was done.
        reached: Option<u16>,
        /// Items of the mission.
        items: usize,
        /// What the vehicle said meanwhile.
        texts: Vec<String>,
    },
    /// The mission file cannot be used.
    #[error("{file}: {why}")]
    MissionFile {
        /// Its name.
        file: String,
        /// What is wrong.
        why: String,
    },
}

impl CtlError {
    /// The vehicle cannot yet do what was asked; asking again later makes sense.
    pub fn is_temporary(&self) -> bool {
        matches!(self, CtlError::Refused { result: MavResult::MAV_RESULT_TEMPORARILY_REJECTED, .. })
    }
}

/// A vehicle for people: its number, and where it is.
fn named(caller: &Caller) -> String {
    let from = caller.from.map_or_else(String::new, |from| format!(" at {from}"));
    format!("system {}{from}", caller.system)
}

fn heard_instead(others: &[String]) -> String {
    if others.is_empty() {
        "is `haltere fly` running with a ground endpoint that matches this address?".to_owned()
    } else {
        format!("heard instead: {}", others.join("; and "))
    }
}

/// The vehicle's own words, for the end of an error.
fn quoted(texts: &[String]) -> String {
    if texts.is_empty() {
        String::new()
    } else {
        format!("; the vehicle says: {}", texts.join("; "))
    }
}

fn ended_after(reached: Option<u16>, items: usize) -> String {
    match reached {
        Some(item) => format!("after item {} of {items}", item.saturating_add(1)),
        None => format!("before the first of {items} items was done"),
    }
}
