//! The catalogue of experiments: manoeuvres and bench actions, with what each costs and which sets of
//! effects it is meant to separate (GAP.md 3.9). One list; what an experiment is worth to somebody is
//! computed in [`crate::advice`], not written here.
//!
//! Costs of flights are flight times in the room of 6 × 6 × 3 m (a test flies them); of bench actions
//! the time with everything at hand. Resolutions are one sigma of a reading by usual tools, and hold
//! what nominal vehicles differ by (turn-on bias of the IMU: effect N11).

use crate::advice::manoeuvres::{
    height_ladder, lean_doublets, long_hover, reversal_dashes, room_edge_square, standard,
    steps_then_hover, straight_dashes, throttle_doublets, under_the_ceiling, yaw_on_the_spot,
};
use crate::scene::Scene;
use haltere_pilot::mission_file::MissionFile;

/// What every flight costs besides flying, s: a charged battery, placing, waiting for alignment, copying
/// the log. Judgement.
const SET_UP_S: f64 = 120.0;

/// One experiment.
#[derive(Debug)]
pub struct Experiment {
    /// Name on the command line and of the mission file.
    pub id: &'static str,
    /// In words.
    pub title: &'static str,
    /// What to do and what to look for.
    pub how: &'static str,
    /// Time that it costs, s; of a flight the flight time.
    pub cost_s: f64,
    /// Sets of effects that it is meant to separate.
    pub separates: &'static [&'static [&'static str]],
    /// Flight or bench.
    pub means: Means,
}

/// How an experiment is done.
#[derive(Debug)]
pub enum Means {
    /// A mission, if the room has space for it.
    Flight(fn(&Scene) -> Result<MissionFile, String>),
    /// Readings that are taken by hand.
    Bench(&'static [Reading]),
}

/// A number that is read off an instrument: a weighted sum of parameters, each relative to "off".
#[derive(Debug)]
pub struct Reading {
    /// What is read.
    pub what: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// One sigma.
    pub resolution: f64,
    /// Effect, parameter, weight; every effect that moves the reading.
    pub of: &'static [(&'static str, &'static str, f64)],
}

const G: f64 = 9.81;
/// m/s² per degree of tilt.
const TILT: f64 = G * 0.017_453;

/// The catalogue, cheap ones of a kind first.
pub static EXPERIMENTS: &[Experiment] = &[
    Experiment {
        id: "yaw-on-the-spot",
        title: "turn on the spot in hover, four headings",
        how: "what stays with the room is wind or draught, what turns with the body is bias, tilt or trim",
        cost_s: 37.0,
        separates: &[
            &["M1", "M4", "L3", "I2", "P6"],
            &["A5", "A6", "M1", "L3"],
            &["U3", "T1", "U11"],
        ],
        means: Means::Flight(yaw_on_the_spot),
    },
    Experiment {
        id: "throttle-doublets",
        title: "throttle doublets of ±4 % and ±12 %",
        how: "constant offsets stay, those in proportion to thrust follow; a limit shows in the large one only",
        cost_s: 39.0,
        separates: &[&["P4", "P5"], &["M1", "M4", "L3", "I2", "P6"], &["P2", "P3"]],
        means: Means::Flight(throttle_doublets),
    },
    Experiment {
        id: "lean-doublets",
        title: "roll and pitch doublets of two sizes and two lengths",
        how: "a lag scales with size, a dead band swallows the small ones, a delay only shifts them",
        cost_s: 49.0,
        separates: &[&["L1", "L2", "T2", "L4", "T3"], &["A11", "I3", "L1"]],
        means: Means::Flight(lean_doublets),
    },
    Experiment {
        id: "reversal-dashes",
        title: "dashes there and back at three speeds, both axes",
        how: "drag in proportion to speed, bent and squared differ where it is fast; a late position shows with speed",
        cost_s: 77.0,
        separates: &[&["A1", "A2", "A3"], &["U3", "T1", "U11"], &["I1", "P1"]],
        means: Means::Flight(reversal_dashes),
    },
    Experiment {
        id: "straight-dashes",
        title: "single dashes in x and in y with a hover between",
        how: "a turned heading pushes every dash to the same side; a coupling turns the nose with the roll command",
        cost_s: 51.0,
        separates: &[&["H1", "L6"], &["H1", "A5"]],
        means: Means::Flight(straight_dashes),
    },
    Experiment {
        id: "room-edge-square",
        title: "square along the walls at two heights",
        how: "a constant bias stays, a survey error turns with the direction, a blocked path has its place",
        cost_s: 62.0,
        separates: &[&["U2", "U4", "U7", "U8", "U5"], &["A10", "A6"]],
        means: Means::Flight(room_edge_square),
    },
    Experiment {
        id: "height-ladder",
        title: "hover at 0.25, 0.35, 0.5 and 0.8 m",
        how: "the ground effect is in the force, multipath is in the UWB",
        cost_s: 37.0,
        separates: &[&["A8", "U6"], &["A8", "A4"]],
        means: Means::Flight(height_ladder),
    },
    Experiment {
        id: "under-the-ceiling",
        title: "hover in steps up to just under the ceiling, and down again",
        how: "a ceiling effect shows in the last half metre only",
        cost_s: 38.0,
        separates: &[&["A9", "A8"], &["A9", "A4"]],
        means: Means::Flight(under_the_ceiling),
    },
    Experiment {
        id: "long-hover",
        title: "hover at one point for 60 s",
        how: "ramps and clocks grow, constant errors stay; charge is used at a steady current",
        cost_s: 70.0,
        separates: &[&["U2", "U8"], &["M1", "M2"], &["P2", "P3"], &["P1", "P7", "P3"]],
        means: Means::Flight(long_hover),
    },
    Experiment {
        id: "steps-then-hover",
        title: "throttle steps early, 40 s of hover, throttle steps again",
        how: "an inner resistance follows the current at once, a lost capacity the charge that was used",
        cost_s: 61.0,
        separates: &[&["P2", "P3"], &["P1", "P7", "P3"], &["P4", "P5"]],
        means: Means::Flight(steps_then_hover),
    },
    Experiment {
        id: "diagnostic",
        title: "the standard diagnostic flight",
        how: "some of everything",
        cost_s: 112.0,
        separates: &[],
        means: Means::Flight(standard),
    },
    Experiment {
        id: "scale",
        title: "weigh the vehicle with battery",
        how: "put it on a kitchen scale; the nominal take-off mass is in the vehicle file",
        cost_s: 60.0,
        separates: &[&["I1", "P1"]],
        means: Means::Bench(&[Reading {
            what: "mass beyond nominal",
            unit: "g",
            resolution: 0.5,
            of: &[("I1", "extra", 1.0)],
        }]),
    },
    Experiment {
        id: "rest-log",
        title: "10 s at rest and level with motors off, then 10 s held with motors on",
        how: "what is there at rest is bias or scale, what comes with the motors is rectified vibration",
        cost_s: 60.0,
        separates: &[&["M3", "M6", "M1"], &["M1", "L3", "I2", "P6"], &["M5", "H2"]],
        means: Means::Bench(&[
            Reading {
                what: "accelerometer x at rest",
                unit: "m/s²",
                resolution: 0.06,
                of: &[("M1", "x", 1.0), ("M4", "pitch", TILT)],
            },
            Reading {
                what: "accelerometer y at rest",
                unit: "m/s²",
                resolution: 0.06,
                of: &[("M1", "y", 1.0), ("M4", "roll", TILT)],
            },
            Reading {
                what: "accelerometer z at rest beyond g",
                unit: "m/s²",
                resolution: 0.06,
                of: &[("M1", "z", 1.0), ("M3", "z", G)],
            },
            Reading {
                what: "change of the mean with motors on",
                unit: "m/s²",
                resolution: 0.05,
                of: &[("M6", "offset", 1.0)],
            },
            Reading {
                what: "gyroscope z at rest",
                unit: "rad/s",
                resolution: 0.004,
                of: &[("M5", "z", 1.0)],
            },
        ]),
    },
    Experiment {
        id: "six-positions",
        title: "six-position check of the accelerometer",
        how: "10 s on each side: the mean of opposite sides is bias, their half difference scale, what leaks sideways misalignment",
        cost_s: 240.0,
        separates: &[&["M1", "M3", "M4", "M6"]],
        means: Means::Bench(&[
            Reading { what: "bias x", unit: "m/s²", resolution: 0.06, of: &[("M1", "x", 1.0)] },
            Reading { what: "bias y", unit: "m/s²", resolution: 0.06, of: &[("M1", "y", 1.0)] },
            Reading { what: "bias z", unit: "m/s²", resolution: 0.06, of: &[("M1", "z", 1.0)] },
            Reading { what: "scale z", unit: "", resolution: 0.005, of: &[("M3", "z", 1.0)] },
            Reading { what: "roll", unit: "deg", resolution: 0.5, of: &[("M4", "roll", 1.0)] },
            Reading { what: "pitch", unit: "deg", resolution: 0.5, of: &[("M4", "pitch", 1.0)] },
        ]),
    },
    Experiment {
        id: "balance",
        title: "balance the vehicle on an edge, along and across",
        how: "the centre of mass is above the edge; mark it and measure to the drawn place",
        cost_s: 180.0,
        separates: &[&["I2", "L3", "P6", "M4"]],
        means: Means::Bench(&[
            Reading { what: "forward", unit: "mm", resolution: 0.7, of: &[("I2", "x", 1.0)] },
            Reading { what: "right", unit: "mm", resolution: 0.7, of: &[("I2", "y", 1.0)] },
        ]),
    },
    Experiment {
        id: "servo-angles",
        title: "measure both servos at neutral with a protractor",
        how: "board on, motors off",
        cost_s: 180.0,
        separates: &[&["L3", "P6", "I2", "M4"]],
        means: Means::Bench(&[
            Reading {
                what: "dihedral",
                unit: "deg",
                resolution: 0.7,
                of: &[("L3", "dihedral", 1.0)],
            },
            Reading { what: "yaw", unit: "deg", resolution: 0.7, of: &[("L3", "yaw", 1.0)] },
        ]),
    },
    Experiment {
        id: "thrust-stand",
        title: "thrust of each wing on a stand at the throttle of hover",
        how: "hold the hub on a scale, wings free, supply at 7.4 V",
        cost_s: 900.0,
        separates: &[&["P1", "I1"], &["P6", "L3", "I2"]],
        means: Means::Bench(&[
            Reading { what: "thrust lost", unit: "", resolution: 0.02, of: &[("P1", "loss", 1.0)] },
            Reading {
                what: "left minus right, half",
                unit: "",
                resolution: 0.01,
                of: &[("P6", "epsilon", 1.0)],
            },
        ]),
    },
    Experiment {
        id: "battery-test",
        title: "inner resistance and capacity of the pack on a charger",
        how: "step load for the resistance, one full discharge for the capacity",
        cost_s: 1800.0,
        separates: &[&["P2", "P3"], &["P1", "P7", "P3"]],
        means: Means::Bench(&[
            Reading {
                what: "resistance beyond nominal",
                unit: "Ω",
                resolution: 0.02,
                of: &[("P2", "extra", 1.0)],
            },
            Reading {
                what: "capacity lost",
                unit: "",
                resolution: 0.03,
                of: &[("P3", "loss", 1.0)],
            },
        ]),
    },
    Experiment {
        id: "tape-measure",
        title: "measure the anchors again",
        how: "distances from each suspect to three others, by tape",
        cost_s: 300.0,
        separates: &[&["U2", "U4", "U7", "U8", "U5"]],
        means: Means::Bench(&[
            Reading { what: "north", unit: "m", resolution: 0.03, of: &[("U7", "north", 1.0)] },
            Reading { what: "east", unit: "m", resolution: 0.03, of: &[("U7", "east", 1.0)] },
            Reading { what: "down", unit: "m", resolution: 0.03, of: &[("U7", "down", 1.0)] },
        ]),
    },
    Experiment {
        id: "anemometer",
        title: "measure the air where it was flown, doors and fans as then",
        how: "a vane or hot-wire anemometer, 30 s to each side",
        cost_s: 180.0,
        separates: &[&["A5", "A6", "M1", "L3"], &["A10", "A6"]],
        means: Means::Bench(&[
            Reading {
                what: "air towards north",
                unit: "m/s",
                resolution: 0.1,
                of: &[("A5", "north", 1.0)],
            },
            Reading {
                what: "air towards east",
                unit: "m/s",
                resolution: 0.1,
                of: &[("A5", "east", 1.0)],
            },
            Reading {
                what: "strongest air in the room",
                unit: "m/s",
                resolution: 0.1,
                of: &[("A6", "speed", 1.0)],
            },
        ]),
    },
    Experiment {
        id: "receipt-log",
        title: "log when the board receives each setpoint",
        how: "compare with the companion's own log over 60 s on the bench, clocks aligned by TIMESYNC",
        cost_s: 300.0,
        separates: &[&["L1", "L2", "T2", "L4", "T3"]],
        means: Means::Bench(&[
            Reading { what: "delay", unit: "ms", resolution: 4.0, of: &[("T2", "delay", 1.0)] },
            Reading {
                what: "longest pause",
                unit: "s",
                resolution: 0.03,
                of: &[("T3", "length", 1.0)],
            },
        ]),
    },
    Experiment {
        id: "heading-check",
        title: "point the nose along a wall and read the heading",
        how: "both ways; half the difference is the misalignment",
        cost_s: 90.0,
        separates: &[&["H1", "L6"], &["H1", "A5"]],
        means: Means::Bench(&[Reading {
            what: "heading off",
            unit: "deg",
            resolution: 2.0,
            of: &[("H1", "angle", 1.0)],
        }]),
    },
];

/// An experiment by its name.
pub fn find(id: &str) -> Option<&'static Experiment> {
    EXPERIMENTS.iter().find(|e| e.id == id)
}

/// What tells at least two of these effects apart, the cheapest first.
pub fn telling_apart(ids: &[String]) -> Vec<&'static Experiment> {
    let of_these = |set: &&[&str]| set.iter().filter(|id| ids.iter().any(|own| own == *id)).count();
    let mut all: Vec<_> =
        EXPERIMENTS.iter().filter(|e| e.separates.iter().any(|set| of_these(set) > 1)).collect();
    all.sort_by(|a, b| a.whole_cost_s().total_cmp(&b.whole_cost_s()));
    all
}

impl Experiment {
    /// Time that it costs with what comes before and after, s.
    pub fn whole_cost_s(&self) -> f64 {
        if self.is_flight() { self.cost_s + SET_UP_S } else { self.cost_s }
    }

    /// Whether it is flown.
    pub fn is_flight(&self) -> bool {
        matches!(self.means, Means::Flight(_))
    }
}

#[cfg(test)]
mod tests;
