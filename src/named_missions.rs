//! Missions that are built in, by name: the standard flights of the diagnosis and those that show what a fit needs.

use haltere_gap::bank::missions;
use haltere_gap::scene::Scene;
use haltere_pilot::Envelope;
use haltere_pilot::mission_file::MissionFile;

use crate::fit::programs::{Options, Program, plan};

/// The flight that `haltere gap diagnose` judges.
const DIAGNOSTIC: &str = "diagnostic";
const PLAIN: &str = "plain";
const HELD_OUT: &str = "held-out";

/// Speed of the setpoint along a shape, m/s.
pub const SHAPE_SPEED_MPS: f32 = 0.5;
/// Height of a shape, m: as the demo's take-off.
pub const SHAPE_HEIGHT_M: f64 = 1.2;
/// Shapes of the source: corners from the centre, north and east, m.
pub const SHAPES: [(&str, &[[f64; 2]]); 4] = [
    ("straight", &[[-1.2, -0.9], [1.2, 0.9], [-1.2, -0.9]]),
    ("square", &[[0.8, 0.8], [0.8, -0.8], [-0.8, -0.8], [-0.8, 0.8], [0.8, 0.8]]),
    ("rhombus", &[[1.2, 0.0], [0.0, 0.8], [-1.2, 0.0], [0.0, -0.8], [1.2, 0.0]]),
    (
        "hexagon",
        &[
            [0.9, 0.0],
            [0.45, 0.779],
            [-0.45, 0.779],
            [-0.9, 0.0],
            [-0.45, -0.779],
            [0.45, -0.779],
            [0.9, 0.0],
        ],
    ),
];

/// Flights of the fits.
const FITS: [Program; 7] = [
    Program::Drag,
    Program::Thrust,
    Program::Ground,
    Program::Trim,
    Program::Lag,
    Program::Imu,
    Program::Anchors,
];

/// Name of the flight for a fit: `fit-drag`.
fn fit_name(program: Program) -> String {
    format!("fit-{}", program.name())
}

/// Every name.
pub fn names() -> Vec<String> {
    let fits = FITS.into_iter().map(fit_name);
    [DIAGNOSTIC, PLAIN, HELD_OUT].map(str::to_owned).into_iter().chain(fits).collect()
}

/// Where a mission is flown.
#[derive(Debug, Clone)]
pub struct Place {
    /// Room and place of take-off, for the flights of the diagnosis.
    pub scene: Scene,
    /// Volume and limits of the companion, for those of the fits.
    pub envelope: Envelope,
    /// How the flights of the fits are flown.
    pub options: Options,
}

impl Place {
    /// The mission of this name; else why there is none: the name is unknown, or the place is too small.
    pub fn mission(&self, name: &str) -> Result<MissionFile, String> {
        Ok(match name {
            DIAGNOSTIC => missions::diagnostic_file(&self.scene),
            PLAIN => missions::plain_file(&self.scene),
            HELD_OUT => missions::held_out_file(&self.scene),
            other => {
                let program = FITS.into_iter().find(|p| fit_name(*p) == other);
                let program = program.ok_or("no such program")?;
                plan(program, &self.envelope, &self.options)?.mission
            }
        })
    }
}
