//! What the parts of the core may look at of one another, and none of them changes.

use haltere_core::estimate::{Estimate, Health};
use haltere_core::measure::BoardAttitude;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;

use crate::config::PilotConfig;
use crate::flight::modes::Mode;

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

impl View<'_> {
    /// Height of the landing gear above the floor by the estimate, m.
    pub fn height_above_floor_m(&self) -> f64 {
        -self.estimate.pos_E_m.z() - self.config.flight.gear_height_m
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
