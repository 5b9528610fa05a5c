//! The balance and what may be added to it: nominal forces, calibrations, and candidate effects with
//! their ids of the effect list.
//!
//! Nominal specific force in body axes (x forward, y right, z down):
//! `f = -z c T - K v + (b_x, b_y, 0)`, with `T = g u/u_h · V/V_ref` from the command, `K` the vehicle's drag by its flap rate in hover over its mass. `c` (weight, thrust
//! scale) and `b` (tilt of trim and reference) are calibrations: refitted with every hypothesis,
//! never called an effect. A candidate is a few columns that are linear in their parameters.

use haltere_core::frames::{B, E, G_MPS2, Vec3};
use haltere_model::effects::{self, Block};
use haltere_model::vehicle::Vehicle;

use haltere_log::import::motion::Sample;

/// Pack voltage at which the command is understood, V per cell: nominal voltage of the cells.
const REFERENCE_CELL_V: f64 = 3.7;

/// A part that is left out of the nominal model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// Thrust does not depend on the voltage.
    Voltage,
    /// The air does not brake.
    Drag,
}

/// The nominal forces.
#[derive(Debug, Clone, PartialEq)]
pub struct Nominal {
    /// Command in hover at the reference voltage.
    hover_frac: f64,
    /// Voltage that the hover command is for, V.
    reference_v: f64,
    /// Drag by mass along the body axes, 1/s.
    drag_per_s: [f64; 3],
    /// Ground effect's length, m.
    ground_m: f64,
    /// Warming time of the motors, s.
    warming_s: f64,
    without: Vec<Part>,
}

impl Nominal {
    /// Of a vehicle, less the parts left out.
    pub fn new(vehicle: &Vehicle, without: &[Part]) -> Self {
        let reference_v = vehicle.battery.cells * REFERENCE_CELL_V;
        let flap_by_mass = 2.0 * vehicle.hover_hz() / vehicle.body.mass_kg;
        Self {
            hover_frac: vehicle.hover_command_v() / reference_v,
            reference_v,
            drag_per_s: vehicle.drag.k_ns_per_m_hz.map(|k| k * flap_by_mass),
            ground_m: vehicle.ground.length_m,
            warming_s: default_of("P7", "tau"),
            without: without.to_vec(),
        }
    }

    /// Whether a part is left out.
    pub fn lacks(&self, part: Part) -> bool {
        self.without.contains(&part)
    }

    /// Thrust by mass per command, m/s².
    fn thrust_mps2(&self, s: &Sample, command_frac: f64) -> f64 {
        let by_voltage =
            if self.lacks(Part::Voltage) { 1.0 } else { s.supply_v / self.reference_v };
        G_MPS2 * command_frac / self.hover_frac * by_voltage
    }

    /// What the balance has to explain: measured specific force less nominal drag.
    pub fn target(&self, s: &Sample) -> Vec3<B> {
        if self.lacks(Part::Drag) {
            s.force_B_mps2
        } else {
            s.force_B_mps2 + self.drag(s.vel_B_mps)
        }
    }

    fn drag(&self, v_B: Vec3<B>) -> Vec3<B> {
        let [x, y, z] = self.drag_per_s;
        Vec3::new(x * v_B.x(), y * v_B.y(), z * v_B.z())
    }
}

/// Sign that physics allows a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sign {
    /// Either.
    Any,
    /// Not below zero.
    Positive,
}

/// One parameter and the force that it brings per unit.
#[derive(Clone, Copy)]
pub struct Column {
    /// Key.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Largest plausible magnitude: an interval wider than this says nothing.
    pub plausible: f64,
    /// Allowed sign.
    pub sign: Sign,
    /// Force per unit of the parameter, body axes, m/s² per unit.
    pub force: fn(&Nominal, &Sample) -> [f64; 3],
}

/// A candidate effect.
#[derive(Clone)]
pub struct Term {
    /// Id in the effect list.
    pub id: &'static str,
    /// What it says, in words.
    pub what: &'static str,
    /// Axes (0 forward, 1 right, 2 down) that it acts on.
    pub axes: &'static [usize],
    /// Its parameters.
    pub columns: Vec<Column>,
}

impl Term {
    /// Name in the effect list.
    pub fn name(&self) -> &'static str {
        spec(self.id).map_or(self.what, |s| s.name)
    }

    /// Block of the chain.
    pub fn block(&self) -> Block {
        spec(self.id).map_or(Block::Aerodynamics, |s| s.block)
    }
}

fn spec(id: &str) -> Option<&'static effects::EffectSpec> {
    effects::ALL.iter().find(|s| s.id == id)
}

fn default_of(id: &str, parameter: &str) -> f64 {
    spec(id)
        .and_then(|s| s.parameters.iter().find(|p| p.name == parameter))
        .map_or(0.0, |p| p.default)
}

const fn column(
    name: &'static str,
    unit: &'static str,
    plausible: f64,
    sign: Sign,
    force: fn(&Nominal, &Sample) -> [f64; 3],
) -> Column {
    Column { name, unit, plausible, sign, force }
}

/// Calibrations: thrust scale and two tilts.
pub fn calibrations() -> Vec<Column> {
    vec![
        column("thrust_scale", "", 1.0, Sign::Positive, |n, s| {
            [0.0, 0.0, -n.thrust_mps2(s, s.command_frac)]
        }),
        column("forward", "m/s2", 2.0, Sign::Any, |_, _| [1.0, 0.0, 0.0]),
        column("right", "m/s2", 2.0, Sign::Any, |_, _| [0.0, 1.0, 0.0]),
    ]
}

/// Every candidate for this nominal model. A part that is left out stands here under the id that it
/// has as a nominal effect; one that is in, as the deviation from it.
pub fn candidates(nominal: &Nominal) -> Vec<Term> {
    use Sign::{Any, Positive};
    let linear = |sign| {
        vec![
            column("forward", "1/s", 4.0, sign, |_, s| [-s.vel_B_mps.x(), 0.0, 0.0]),
            column("right", "1/s", 4.0, sign, |_, s| [0.0, -s.vel_B_mps.y(), 0.0]),
            column("down", "1/s", 4.0, sign, |_, s| [0.0, 0.0, -s.vel_B_mps.z()]),
        ]
    };
    let square = |along: fn(&Nominal, &Sample) -> [f64; 3],
                  aside: fn(&Nominal, &Sample) -> [f64; 3],
                  down: fn(&Nominal, &Sample) -> [f64; 3]| {
        vec![
            column("forward", "1/m", 2.0, Positive, along),
            column("right", "1/m", 2.0, Positive, aside),
            column("down", "1/m", 2.0, Positive, down),
        ]
    };
    let exponent = column("exponent", "", 1.0, Any, |n, s| {
        [0.0, 0.0, -n.thrust_mps2(s, s.command_frac) * (s.supply_v / n.reference_v - 1.0)]
    });
    let mut terms = Vec::new();
    terms.push(if nominal.lacks(Part::Drag) {
        Term {
            id: "N1",
            what: "drag, linear in speed",
            axes: &[0, 1, 2],
            columns: linear(Positive),
        }
    } else {
        Term { id: "A1", what: "more or less drag", axes: &[0, 1, 2], columns: linear(Any) }
    });
    terms.push(Term {
        id: "A2",
        what: "drag saturates with speed (-|v| v, first order)",
        axes: &[0, 1, 2],
        columns: square(
            |_, s| [s.vel_B_mps.norm() * s.vel_B_mps.x(), 0.0, 0.0],
            |_, s| [0.0, s.vel_B_mps.norm() * s.vel_B_mps.y(), 0.0],
            |_, s| [0.0, 0.0, s.vel_B_mps.norm() * s.vel_B_mps.z()],
        ),
    });
    terms.push(Term {
        id: "A3",
        what: "drag with the square of speed",
        axes: &[0, 1, 2],
        columns: square(
            |_, s| [-s.vel_B_mps.norm() * s.vel_B_mps.x(), 0.0, 0.0],
            |_, s| [0.0, -s.vel_B_mps.norm() * s.vel_B_mps.y(), 0.0],
            |_, s| [0.0, 0.0, -s.vel_B_mps.norm() * s.vel_B_mps.z()],
        ),
    });
    terms.push(Term {
        id: "A4",
        what: "thrust curves with the command",
        axes: &[2],
        columns: vec![column("epsilon", "", 0.5, Any, |n, s| {
            let by_hover = n.thrust_mps2(s, s.command_frac) / G_MPS2;
            [0.0, 0.0, -0.5 * G_MPS2 * (by_hover * by_hover - 1.0)]
        })],
    });
    terms.push(Term {
        id: "A5",
        what: "wind, constant in the room",
        axes: &[0, 1],
        columns: vec![
            column("north", "m/s", 0.6, Any, |n, s| wind(n, s, Vec3::new(1.0, 0.0, 0.0))),
            column("east", "m/s", 0.6, Any, |n, s| wind(n, s, Vec3::new(0.0, 1.0, 0.0))),
        ],
    });
    terms.push(Term {
        id: "A8",
        what: "ground effect",
        axes: &[2],
        columns: vec![column("gain", "", 0.5, Any, |n, s| {
            let near = (-s.height_m / n.ground_m).exp();
            [0.0, 0.0, -n.thrust_mps2(s, s.command_frac) * near]
        })],
    });
    terms.push(Term {
        id: "P4",
        what: "thrust lags behind the command",
        axes: &[2],
        columns: vec![column("lag", "s", 0.2, Positive, |n, s| {
            [0.0, 0.0, n.thrust_mps2(s, s.command_rate_per_s)]
        })],
    });
    terms.push(Term {
        id: "P7",
        what: "motors lose thrust with time since take-off",
        axes: &[2],
        columns: vec![column("loss", "", 0.5, Positive, |n, s| {
            let warm = 1.0 - (-s.t_s / n.warming_s).exp();
            [0.0, 0.0, n.thrust_mps2(s, s.command_frac) * warm]
        })],
    });
    terms.push(if nominal.lacks(Part::Voltage) {
        Term {
            id: "N7",
            what: "thrust falls with the battery voltage",
            axes: &[2],
            columns: vec![Column { sign: Positive, ..exponent }],
        }
    } else {
        let what = "thrust follows the voltage by another power";
        Term { id: "P8", what, axes: &[2], columns: vec![exponent] }
    });
    terms
}

/// What the balance cannot see at all, and why.
pub const BEYOND: &[(&str, &str)] = &[
    ("P1", "thrust gain is calibrated on the flight it is fitted on; weigh, or compare flights"),
    ("I1", "mass is calibrated with the thrust scale; weigh"),
    ("L3", "constant tilt is calibrated with the reference's own; turn on the spot"),
    ("P2", "no current is recorded"),
    ("P3", "no current is recorded"),
];

fn wind(nominal: &Nominal, s: &Sample, towards_E: Vec3<E>) -> [f64; 3] {
    let [x, y, _] = nominal.drag(s.R_EB.inverse() * towards_E).to_array();
    [x, y, 0.0]
}
