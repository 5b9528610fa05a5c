//! The inner-loop board: the link to it, who else speaks there, and what it last said.

mod crazyflie;
pub(crate) mod down;
pub(crate) mod link;
pub(crate) mod misplaced;
pub(crate) mod second_board;

use haltere_dialect::mav_stream::MavSplitter;

use haltere_core::measure::{BatterySample, BoardAttitude, ServoOutput};
use haltere_core::time::HostTime;

use crate::config::PilotConfig;
use crate::view::BoardState;

use down::BoardDown;
use link::news::BoardNews;
use link::peers::Peers;
use link::{BoardLink, LinkConfig};
use misplaced::Lines;

/// A voltage older than this says nothing about the present one, s.
const BATTERY_AGE_S: f64 = 5.0;

/// The link to the board, and what the board last said.
#[derive(Debug)]
pub(crate) struct Board {
    pub(crate) lines: Lines,
    pub(crate) link: BoardLink,
    pub(crate) splitter: MavSplitter,
    pub(crate) peers: Peers,
    pub(crate) bytes_at: HostTime,
    pub(crate) news: Vec<BoardNews>,
    pub(crate) attitude: Option<BoardAttitude>,
    pub(crate) down: BoardDown,
    /// The newest pressure that is one, Pa.
    pub(crate) pressure_pa: Option<(f64, HostTime)>,
    pub(crate) battery: Option<BatterySample>,
    /// What the board last told motors and servos.
    pub(crate) servos: Option<ServoOutput>,
}

impl Board {
    pub(crate) fn new(config: &PilotConfig, at: HostTime) -> Self {
        let link = LinkConfig {
            profile: config.board_profile,
            set_parameters: config.board_set_parameters && !config.flight.shadow,
            shadow: config.flight.shadow,
        };
        Self {
            lines: Lines::default(),
            link: BoardLink::new(link, at),
            splitter: MavSplitter::new(),
            peers: Peers::default(),
            bytes_at: at,
            news: Vec::new(),
            attitude: None,
            down: BoardDown::default(),
            pressure_pa: None,
            battery: None,
            servos: None,
        }
    }

    /// What the other parts may look at.
    pub(crate) fn state(&self) -> BoardState {
        BoardState {
            is_real: self.link.firmware().is_real(),
            obeys: self.link.obeys(),
            is_late: self.link.lateness().is_late(),
            latency_s: self.link.lateness().latency_s(),
            response_lag_s: self.link.response_lag_s(),
            attitude: self.attitude,
        }
    }

    /// Battery voltage, if a fresh one is known, V.
    pub(crate) fn supply_v(&self, at: HostTime) -> Option<f64> {
        self.battery.filter(|b| at.seconds_since(b.received_at) < BATTERY_AGE_S).map(|b| b.supply_v)
    }
}
