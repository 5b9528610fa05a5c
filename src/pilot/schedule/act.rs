//! The parts of the core as one call may change them: each is borrowed for itself, so that what takes one leaves the
//! others alone. Whoever needs a single part is a method of that part.

use haltere_core::estimate::Estimate;
use haltere_core::geo::LocalOrigin;
use haltere_core::survey::Survey;

use crate::board::Board;
use crate::clock::Clock;
use crate::config::PilotConfig;
use crate::flight::Flight;
use crate::navigation::Navigation;
use crate::out::Out;
use crate::stations::Stations;
use crate::wish::Wish;

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
