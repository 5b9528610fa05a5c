//! The parts of the core as one call may change them: each is borrowed for itself, so that what takes one leaves the
//! others alone. Whoever needs a single part is a method of that part.

use haltere_core::estimate::Estimate;
use haltere_core::geo::LocalOrigin;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_dialect::mav::haltere::MavMessage;

use crate::board::Board;
use crate::clock::Clock;
use crate::config::PilotConfig;
use crate::flight::Flight;
use crate::input::LinkId;
use crate::navigation::Navigation;
use crate::out::Out;
use crate::stations::Stations;
use crate::stations::mission_transfer::Client;
use crate::wish::Wish;

/// A message that a client has said.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Heard<'a> {
    pub at: HostTime,
    pub link: LinkId,
    pub peer: (u8, u8),
    pub id: u32,
    pub message: &'a MavMessage,
}

impl Heard<'_> {
    pub fn client(&self) -> Client {
        Client { link: self.link, peer: self.peer }
    }
}

/// Who may say something.
#[derive(Debug, Clone, Copy)]
pub enum Permit<F> {
    /// Everybody: it changes nothing.
    Look,
    /// Systems among the commanders of their endpoint.
    Command,
    /// Everybody, as far as it only asks.
    Asks(F),
}

/// What a handler of a row acts on.
#[derive(Debug)]
pub(crate) struct Act<'a> {
    pub config: &'a mut PilotConfig,
    pub survey: &'a Survey,
    pub origin: &'a mut LocalOrigin,
    /// The estimate of this step: nobody but its beginning changes it.
    pub estimate: &'a mut Estimate,
    pub clock: &'a mut Clock,
    pub out: &'a mut Out,
    pub navigation: &'a mut Navigation,
    pub board: &'a mut Board,
    pub flight: &'a mut Flight,
    pub stations: &'a mut Stations,
    /// What the parts want changed in one another.
    pub wishes: &'a mut Vec<Wish>,
}
