//! What may be wrong with the generator's vehicle and room: the 42 effects of GAP.md section 3 that a
//! diagnosis must name, in functional forms of the generator's own, and 20 that it must not know.
//!
//! `KNOWN` and `UNKNOWN` are the only lists. An entry draws sign, direction, place and anchor,
//! sets fields of [`Deviations`], and notes what it set, in the names of the diagnosis' library
//! where a number of it means the same.

pub mod aero;
pub mod imu;
pub mod inertia;
pub mod inner_loop;
pub mod propulsion;
pub mod timing;
pub mod unknown;
pub mod uwb;

use std::collections::BTreeMap;

use super::noise::Noise;

/// Everything that deviates; the default is the healthy vehicle.
#[derive(Debug, Clone, Default)]
pub struct Deviations {
    /// Air.
    pub aero: aero::Aero,
    /// Motors, wings, battery.
    pub propulsion: propulsion::Propulsion,
    /// Mass and its place.
    pub inertia: inertia::Inertia,
    /// Servos and loops.
    pub inner_loop: inner_loop::InnerLoop,
    /// Accelerometer and gyroscope.
    pub imu: imu::Imu,
    /// Radio.
    pub uwb: uwb::Uwb,
    /// Links and heading.
    pub timing: timing::Timing,
    /// What the library does not have.
    pub unknown: unknown::Unknown,
}

impl Deviations {
    /// Takes over what goes on by itself in effects of the library: turbulence, bursts, pauses, walks.
    pub fn go_on_from(&mut self, old: &Self) {
        self.aero.go_on_from(&old.aero);
        self.uwb.go_on_from(&old.uwb);
        self.timing.go_on_from(&old.timing);
    }
}

/// The room in which places are drawn.
#[derive(Debug, Clone, Copy)]
pub struct Hall {
    /// South and north wall, m.
    pub north_m: [f64; 2],
    /// West and east wall, m.
    pub east_m: [f64; 2],
    /// Ceiling, m.
    pub ceiling_m: f64,
    /// Number of anchors.
    pub anchors: usize,
}

impl Hall {
    /// A place on the usual ways: within the given share of the half sides around the middle.
    pub fn place(&self, rng: &mut Noise, share: f64) -> [f64; 2] {
        let pick =
            |[low, high]: [f64; 2], u: f64| 0.5 * (low + high) + 0.5 * (high - low) * share * u;
        [pick(self.north_m, rng.between(-1.0, 1.0)), pick(self.east_m, rng.between(-1.0, 1.0))]
    }
}

/// What was set.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Set {
    /// Parameters by name.
    pub parameters: BTreeMap<&'static str, f64>,
    /// Anchor, place in the survey.
    pub anchor: Option<u8>,
    /// Place, north and east, m.
    pub place_NE_m: Option<[f64; 2]>,
}

impl Set {
    /// Notes a parameter.
    pub fn note(&mut self, name: &'static str, value: f64) {
        self.parameters.insert(name, value);
    }
}

/// What an entry draws from.
pub struct Draw<'a> {
    /// Size, in the unit of the entry; always positive.
    pub size: f64,
    /// For signs, directions, places.
    pub rng: &'a mut Noise,
    /// The room.
    pub hall: &'a Hall,
    /// What was set.
    pub set: &'a mut Set,
}

/// An effect.
#[derive(Debug)]
pub struct Spec {
    /// Id of GAP.md, `X…` for what the library does not have.
    pub id: &'static str,
    /// Name.
    pub name: &'static str,
    /// Block of the chain, as INTERFACES.md spells it.
    pub block: &'static str,
    /// Unit of the size.
    pub unit: &'static str,
    /// Mild and strong end of the plausible range.
    pub range: [f64; 2],
    /// How strength follows from size.
    pub scale: Scale,
    /// Whether it may begin in flight: something that can break or be switched on.
    pub sudden: bool,
    /// Switches it on.
    pub set: fn(&mut Deviations, &mut Draw<'_>),
}

impl Spec {
    /// Strength of a size.
    pub fn strength(&self, size: f64) -> f64 {
        match self.scale {
            Scale::Size => size,
            Scale::Inverse => 1.0 / size,
            Scale::Below => 1.0 / size - 1.0,
            Scale::Above => size - 1.0,
        }
    }

    /// Size of a strength.
    pub fn size(&self, strength: f64) -> f64 {
        match self.scale {
            Scale::Size => strength,
            Scale::Inverse => 1.0 / strength,
            Scale::Below => 1.0 / (1.0 + strength),
            Scale::Above => 1.0 + strength,
        }
    }

    /// Strength of the strong end of the range.
    pub fn strongest(&self) -> f64 {
        self.strength(self.range[1])
    }

    /// Switches it on in `d`; draws depend on `rng` alone.
    pub fn apply(&self, size: f64, rng: &mut Noise, hall: &Hall, d: &mut Deviations) -> Set {
        let mut set = Set::default();
        (self.set)(d, &mut Draw { size, rng, hall, set: &mut set });
        set
    }
}

/// How the size of an effect becomes a strength: none at 0, and twice the strength deviates about
/// twice as far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// The size itself.
    Size,
    /// A limit or a scale that bends a law: 1 / size.
    Inverse,
    /// A factor below 1: 1 / size - 1.
    Below,
    /// A factor above 1: size - 1.
    Above,
}

/// How strong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Just detectable.
    Low,
    /// Twice as strong.
    Middle,
    /// Four times as strong.
    High,
}

impl Severity {
    /// Times the detectable strength.
    pub fn times(self) -> f64 {
        match self {
            Self::Low => 1.0,
            Self::Middle => 2.0,
            Self::High => 4.0,
        }
    }
}

/// All three.
pub const SEVERITIES: [Severity; 3] = [Severity::Low, Severity::Middle, Severity::High];

/// The 42 effects that the diagnosis must know, in the order of GAP.md.
pub fn known() -> impl Iterator<Item = &'static Spec> {
    let groups: [&'static [Spec]; 7] = [
        aero::SPECS,
        propulsion::SPECS,
        inertia::SPECS,
        inner_loop::SPECS,
        imu::SPECS,
        uwb::SPECS,
        timing::SPECS,
    ];
    groups.into_iter().flatten()
}

/// The effects that no library knows.
pub fn unknown() -> impl Iterator<Item = &'static Spec> {
    unknown::SPECS.iter()
}
