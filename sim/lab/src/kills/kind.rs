//! What is done to the companion's process, and when.

use rand::RngExt as _;
use rand::rngs::Xoshiro256PlusPlus;
use serde::Serialize;

/// What happens to the companion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// SIGKILL; started again 0.05 to 6 s later.
    Killed,
    /// SIGSTOP; SIGCONT 0.3 to 10 s later.
    Paused,
    /// SIGHUP: the terminal is gone.
    HangUp,
    /// SIGINT, as Ctrl-C.
    Interrupt,
    /// SIGTERM, as a service that is stopped.
    Terminate,
    /// SIGINT, and again 0.5 to 2 s later.
    InterruptTwice,
    /// Nobody reads its output, and the pipe is full.
    OutputBlocked,
    /// Who read its output is gone.
    OutputClosed,
}

impl Kind {
    pub const ALL: [Kind; 8] = [
        Kind::Killed,
        Kind::Paused,
        Kind::HangUp,
        Kind::Interrupt,
        Kind::Terminate,
        Kind::InterruptTwice,
        Kind::OutputBlocked,
        Kind::OutputClosed,
    ];

    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Killed => "killed",
            Kind::Paused => "paused",
            Kind::HangUp => "hang-up",
            Kind::Interrupt => "interrupt",
            Kind::Terminate => "terminate",
            Kind::InterruptTwice => "interrupt-twice",
            Kind::OutputBlocked => "output-blocked",
            Kind::OutputClosed => "output-closed",
        }
    }

    /// Whether the board comes down alone: how hard it meets the floor is its own doing then
    /// (INTERFACES.md: 82 % of the thrust of the last second).
    pub fn leaves_board_alone(self) -> bool {
        matches!(self, Kind::Killed | Kind::InterruptTwice)
    }

    /// Whether the program has to end by itself.
    pub fn ends(self) -> bool {
        matches!(self, Kind::Interrupt | Kind::Terminate | Kind::InterruptTwice)
    }

    /// How long it lasts: the pause, the time to the restart or to the second signal, s.
    fn lasts_s(self) -> std::ops::Range<f64> {
        match self {
            // Before the board notices (0.5 s), during its descent, and after it.
            Kind::Killed => 0.05..6.0,
            Kind::Paused => 0.3..10.0,
            Kind::InterruptTwice => 0.5..2.0,
            _ => 0.0..f64::MIN_POSITIVE,
        }
    }
}

/// Part of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// Thrust rises, the floor carries.
    Spool,
    /// On the way to its height.
    Climb,
    /// At it.
    Hover,
    /// On the way down.
    Landing,
    /// Anywhere from the spool to the landing, over two points.
    Any,
}

impl Phase {
    /// The four that can be told apart.
    pub const ALL: [Phase; 4] = [Phase::Spool, Phase::Climb, Phase::Hover, Phase::Landing];

    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Spool => "spool",
            Phase::Climb => "climb",
            Phase::Hover => "hover",
            Phase::Landing => "landing",
            Phase::Any => "any",
        }
    }

    /// What the vehicle says at its beginning; of [`Phase::Any`] the take-off's own beginning.
    pub fn begins_with(self) -> &'static str {
        match self {
            Phase::Spool | Phase::Any => "spool: ",
            Phase::Climb => "takeoff: ",
            Phase::Hover => "hold: ",
            Phase::Landing => "land: ",
        }
    }

    /// Moments after that, s, at a flight of [`HEIGHTS_M`] with default speeds.
    fn moments_s(self) -> std::ops::Range<f64> {
        match self {
            Phase::Spool => 0.0..0.9,
            Phase::Climb => 0.1..2.2,
            Phase::Hover => 0.3..3.0,
            Phase::Landing => 0.1..3.8,
            // From standing with the motors on, over climb, hold and way, into the landing.
            Phase::Any => 0.1..14.0,
        }
    }
}

/// Heights of the flights, m.
pub const HEIGHTS_M: std::ops::Range<f64> = 1.2..2.4;
/// Of [`Phase::Any`], whose moments were chosen for it.
const HEIGHT_M: f64 = 1.2;

/// What is drawn for a flight.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Trial {
    pub n: usize,
    pub kind: Kind,
    pub phase: Phase,
    pub height_m: f64,
    /// After the phase began, s.
    pub at_s: f64,
    pub lasts_s: f64,
}

impl Trial {
    pub fn draw(n: usize, kind: Kind, phase: Phase, rng: &mut Xoshiro256PlusPlus) -> Self {
        let at_s = rng.random_range(phase.moments_s());
        let lasts_s = rng.random_range(kind.lasts_s());
        let height_m = if phase == Phase::Any { HEIGHT_M } else { rng.random_range(HEIGHTS_M) };
        Self { n, kind, phase, height_m, at_s, lasts_s }
    }
}
