//! What the parts of the core may look at of one another, and none of them changes.

use haltere_core::estimate::{Estimate, Health};
use haltere_core::measure::BoardAttitude;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;

use crate::board::Board;
use crate::config::PilotConfig;
use crate::flight::Flight;
use crate::flight::fence::Fence;
use crate::flight::modes::Mode;
use crate::navigation::Navigation;
use crate::out::Out;

/// What every part may look at. Made anew before each call, by [`view!`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct View<'a> {
    pub at: HostTime,
    pub config: &'a PilotConfig,
    pub survey: &'a Survey,
    pub estimate: &'a Estimate,
    pub mode: Mode,
    /// A vehicle stands that nobody flies.
    pub stands: bool,
    pub thrust: Thrust,
    pub board: BoardState,
}

/// The factor is kept within these bounds: seen hover thrusts of boards lie between 0.37 and 0.65.
pub(crate) const HOVER_BOUNDS: [f64; 2] = [0.5, 1.5];

/// The thrust of the newest control step, and the ones that it is held against, 0 to 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Thrust {
    pub sent_frac: f64,
    /// By the configured model, at the present voltage.
    pub base_frac: f64,
    /// That hovers, as far as it is known.
    pub hover_frac: f64,
    /// How much less is needed near the floor, as a factor.
    pub ground_factor: f64,
}

/// The board, as the other parts see it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BoardState {
    /// Its firmware is one that is known.
    pub is_real: bool,
    /// It is in the mode in which it obeys, and flies what it is sent.
    pub obeys: bool,
    /// Its link is late, and by how much, s.
    pub is_late: bool,
    pub latency_s: f64,
    /// How long after a tilt was asked for its attitude shows it, s, where that can be told.
    pub response_lag_s: Option<f64>,
    pub attitude: Option<BoardAttitude>,
}

/// What is kept over a restart, as far as arming must know of it.
pub(crate) trait Kept: std::fmt::Debug {
    /// Why nothing is armed with what is left.
    fn lost_forbids(&self) -> Option<String>;
}

/// What the flight may look at beside itself. Made anew before each call, by [`around!`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Around<'a> {
    pub at: HostTime,
    pub config: &'a PilotConfig,
    pub survey: &'a Survey,
    pub estimate: &'a Estimate,
    pub navigation: &'a Navigation,
    pub board: &'a Board,
    pub kept: &'a dyn Kept,
}

/// What looks at all parts and changes none: conditions, and what is known at rest. Made anew for each row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sight<'a> {
    pub view: View<'a>,
    pub navigation: &'a Navigation,
    pub board: &'a Board,
    pub flight: &'a Flight,
    pub fence: &'a Fence,
    pub kept: &'a dyn Kept,
    pub out: &'a Out,
}

impl<'a> Around<'a> {
    /// Height of the landing gear above the floor by the estimate, m.
    pub fn height_above_floor_m(&self) -> f64 {
        self.config.flight.height_above_floor_m(self.estimate)
    }

    /// What every part may look at, with the flight as it is now.
    pub fn view(&self, flight: &Flight) -> View<'a> {
        View {
            at: self.at,
            config: self.config,
            survey: self.survey,
            estimate: self.estimate,
            mode: flight.mode,
            stands: flight.is_standing(),
            thrust: flight.thrust(self.config),
            board: self.board.state(),
        }
    }

    /// All of it, with the flight as it is now.
    pub fn sight<'b>(&self, flight: &'b Flight, out: &'b Out) -> Sight<'b>
    where
        'a: 'b,
    {
        self.sight_with(self.view(flight), flight, out)
    }

    /// The same where the view is at hand, which costs more than all the rest.
    pub fn sight_with<'b>(&self, view: View<'b>, flight: &'b Flight, out: &'b Out) -> Sight<'b>
    where
        'a: 'b,
    {
        Sight {
            view,
            navigation: self.navigation,
            board: self.board,
            flight,
            fence: &flight.plans.fence,
            kept: self.kept,
            out,
        }
    }
}

impl View<'_> {
    /// Height of the landing gear above the floor by the estimate, m.
    pub fn height_above_floor_m(&self) -> f64 {
        self.config.flight.height_above_floor_m(self.estimate)
    }

    /// Whether the estimate can be flown by.
    pub fn is_usable(&self) -> bool {
        matches!(self.estimate.health, Health::Good | Health::Degraded)
    }
}

/// The view of a [`Pilot`](crate::Pilot) at a time. It borrows field by field, so that a part can be changed beside it.
macro_rules! view {
    ($pilot:expr, $at:expr) => {
        $crate::view::View {
            at: $at,
            config: &$pilot.config,
            survey: &$pilot.survey,
            estimate: &$pilot.estimate,
            mode: $pilot.flight.mode,
            stands: $pilot.flight.is_standing(),
            thrust: $pilot.flight.thrust(&$pilot.config),
            board: $pilot.board.state(),
        }
    };
}
pub(crate) use view;

/// What is around the flight of a [`Pilot`](crate::Pilot) at a time. It borrows field by field as well.
macro_rules! around {
    ($pilot:expr, $at:expr) => {
        $crate::view::Around {
            at: $at,
            config: &$pilot.config,
            survey: &$pilot.survey,
            estimate: &$pilot.estimate,
            navigation: &$pilot.navigation,
            board: &$pilot.board,
            kept: &$pilot.stations.services,
        }
    };
}
pub(crate) use around;
