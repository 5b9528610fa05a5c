//! What the list says about an effect.

use nalgebra::Vector3;

use crate::effects::Effect;
use crate::random::Stream;
use crate::room::Room;
use crate::vehicle::Vehicle;

/// Block of the chain that an effect lives in; names of INTERFACES.md.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)] // the names are the meaning
pub enum Block {
    Mission,
    Controller,
    Link,
    InnerLoop,
    Actuators,
    Thrust,
    Aerodynamics,
    Battery,
    Imu,
    Uwb,
    Estimator,
    Timing,
}

impl Block {
    /// Every block, in the order in which one feeds the next.
    pub const CHAIN: [Self; 12] = [
        Self::Mission,
        Self::Controller,
        Self::Link,
        Self::InnerLoop,
        Self::Actuators,
        Self::Thrust,
        Self::Aerodynamics,
        Self::Battery,
        Self::Imu,
        Self::Uwb,
        Self::Estimator,
        Self::Timing,
    ];

    /// Our own software, and what a closed loop makes of a fault elsewhere: a gap shows there and has its cause in
    /// another block. Software that replays bit for bit cannot differ from its simulation.
    pub fn is_consequence(self) -> bool {
        matches!(self, Block::Mission | Block::Controller | Block::Estimator)
    }

    /// Name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Block::Mission => "mission",
            Block::Controller => "controller",
            Block::Link => "link",
            Block::InnerLoop => "inner_loop",
            Block::Actuators => "actuators",
            Block::Thrust => "thrust",
            Block::Aerodynamics => "aerodynamics",
            Block::Battery => "battery",
            Block::Imu => "imu",
            Block::Uwb => "uwb",
            Block::Estimator => "estimator",
            Block::Timing => "timing",
        }
    }
}

/// Part of the nominal vehicle, or a deviation from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Role {
    /// On unless switched off.
    Nominal,
    /// Off unless switched on.
    Deviation(Deviation),
}

/// How `haltere-sim hide` hides a deviation: its strength as a share of the strong end of its plausible range, just detectable,
/// twice and four times as strong, as in the sealed suite (sim/lab/PROTOCOL.md). The laboratory's tests hold the two together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Hidden {
    /// Not at all: the suite lacks it.
    Never,
    /// Where it is asked for. The diagnostic flight in the laboratory does not show it, by the word of the diagnosis:
    /// `not_testable` of `haltere gap diagnose --size small --json`, the same on each of twelve flights of other effects.
    WhenAsked([f64; 3]),
    /// By chance too.
    ByChance([f64; 3]),
}

impl Hidden {
    /// Its strengths, where it is hidden.
    pub fn strengths(self) -> Option<[f64; 3]> {
        match self {
            Self::Never => None,
            Self::WhenAsked(strengths) | Self::ByChance(strengths) => Some(strengths),
        }
    }
}

/// What is said of a deviation beside its physics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// Whether the diagnosis chooses from it unless the user says otherwise. Seven are not chosen from: A12 takes what
    /// backlash of another law does, P8 was not found where it was, T4 is no gap of a vehicle, the rest was not tried.
    pub standard: bool,
    /// How it is hidden.
    pub hidden: Hidden,
    /// The sentence of its verdict, with its numbers left open for `haltere_gap::said`: `{name}` is a parameter, `{}` the
    /// list of those that have words for their sides ([`ParameterSpec::ways`]).
    pub verdict: &'static str,
    /// Usual causes, the likeliest first.
    pub causes: &'static str,
    /// What a person does about it on the vehicle or in the room, the cheapest first.
    pub remedy: &'static str,
    /// What it shows as.
    pub shows: &'static str,
    /// Ids of what it is taken for.
    pub looks_like: &'static [&'static str],
    /// Sentences that say what tells it from these.
    pub apart: &'static str,
}

/// Where the value of a parameter comes from when nobody gives one.
#[derive(Clone, Copy)]
pub enum Source {
    /// The default of the list.
    List,
    /// This number of the vehicle file; a value given for the parameter replaces it there.
    Vehicle(fn(&mut Vehicle) -> &mut f64),
}

/// What a parameter says of its effect. How it is drawn and made larger or smaller, and how it is told, follow from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// How much: the distance to "off", to one side of it or only ever to that one.
    Size,
    /// How much, as a limit or a scale that bends a law, "off" at infinity: one over the value.
    Inverse,
    /// How much along one axis of a vector, or to either side of "off".
    Component,
    /// In what form: a length, a time, a threshold. Draws vary it, a weaker effect keeps it.
    Shape,
    /// Which way.
    Direction,
    /// Which one: there is nothing between two of them.
    Which(Choice),
    /// Place in the room along this axis.
    Where(Axis),
    /// A number of the receiver, which the deviation needs and does not change.
    OfTheReceiver,
}

/// What is chosen from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// Anchors of the survey, ascending id, and the kind of error that the anchor of this effect shows: a slot of
    /// `haltere_gap::statistics`.
    Anchor(&'static str),
    /// Walls: north, east, south, west.
    Wall,
}

/// Axis of the room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// To the north.
    North,
    /// To the east.
    East,
}

impl Kind {
    /// Whether it says how much.
    pub fn is_size(self) -> bool {
        matches!(self, Self::Size | Self::Inverse | Self::Component)
    }
}

/// One parameter of an effect.
#[derive(Clone, Copy)]
pub struct ParameterSpec {
    /// Key.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// What it says.
    pub kind: Kind,
    /// Value at which the effect does nothing.
    pub off: f64,
    /// Value when the effect is on and none is given.
    pub default: f64,
    /// Plausible range, lower end.
    pub low: f64,
    /// Plausible range, upper end.
    pub high: f64,
    /// What it is.
    pub doc: &'static str,
    /// Where the default comes from.
    pub source: Source,
    /// What the size has to be seen beside: default and plausible range are the Flapper's, and another vehicle's are as
    /// much larger as this number of its file. `None`: the same on any vehicle.
    pub beside: Option<fn(&Vehicle) -> f64>,
    /// Words for what lies below "off" and above it.
    pub ways: Option<[&'static str; 2]>,
}

impl ParameterSpec {
    /// A parameter of the effect itself.
    pub const fn new(
        name: &'static str,
        unit: &'static str,
        kind: Kind,
        off: f64,
        default: f64,
        [low, high]: [f64; 2],
        doc: &'static str,
    ) -> Self {
        Self {
            name,
            unit,
            kind,
            off,
            default,
            low,
            high,
            doc,
            source: Source::List,
            beside: None,
            ways: None,
        }
    }

    /// Which anchor; `slot`: what the anchor is told by.
    pub const fn anchor(slot: &'static str) -> Self {
        let doc = "place of the anchor in the survey, ascending id";
        Self::new("anchor", "", Kind::Which(Choice::Anchor(slot)), 0.0, 0.0, [0.0, 7.0], doc)
    }

    /// A place along north, in a room of 10 m (m).
    pub const fn north(default: f64, doc: &'static str) -> Self {
        Self::new("north", "m", Kind::Where(Axis::North), default, default, [0.0, 10.0], doc)
    }

    /// The same along east.
    pub const fn east(default: f64, doc: &'static str) -> Self {
        Self::new("east", "m", Kind::Where(Axis::East), default, default, [0.0, 10.0], doc)
    }

    /// Length over which what the air does to the wings fades (m).
    pub const fn decay(default: f64, range: [f64; 2]) -> Self {
        let doc = "length of decay; goes with the wing";
        Self::new("length", "m", Kind::Shape, default, default, range, doc)
            .beside(|v| v.wings.centre_m)
    }

    /// What lies below "off" and above it is said so.
    pub const fn ways(mut self, below: &'static str, above: &'static str) -> Self {
        self.ways = Some([below, above]);
        self
    }

    /// The size goes with this number of the vehicle.
    pub const fn beside(mut self, number: fn(&Vehicle) -> f64) -> Self {
        self.beside = Some(number);
        self
    }

    /// This parameter with default and range as they are for a vehicle.
    pub fn of(&self, vehicle: &Vehicle) -> Self {
        let Some(number) = self.beside else { return *self };
        let times = number(vehicle) / number(&Vehicle::default());
        // What is off where it does nothing at the default, a shape, stays so.
        let off = if self.off == self.default { self.off * times } else { self.off };
        let [default, low, high] = [self.default, self.low, self.high].map(|v| v * times);
        Self { off, default, low, high, ..*self }
    }

    /// `value` as it is told and written down: there is nothing between two choices.
    pub fn told(&self, value: f64) -> f64 {
        if matches!(self.kind, Kind::Which(_)) { value.round() } else { value }
    }

    /// The parameter is a number of the vehicle file.
    pub const fn of_vehicle(mut self, field: fn(&mut Vehicle) -> &mut f64) -> Self {
        self.source = Source::Vehicle(field);
        self
    }
}

/// What an effect is built from.
pub struct Build<'a> {
    /// The vehicle, with all edits by deviations.
    pub vehicle: &'a Vehicle,
    /// The vehicle as the file says: reference for "relative to hover".
    pub nominal: &'a Vehicle,
    /// The room.
    pub room: &'a Room,
    /// Anchors as surveyed, ascending id, Earth frame, m.
    pub sites_E_m: &'a [Vector3<f64>],
    /// Values of the parameters, in the order of the specification.
    pub value: &'a [f64],
    /// Random numbers of this effect alone.
    pub rng: Stream,
}

/// One line of the list.
pub struct EffectSpec {
    /// A letter of its kind and a number, `A1` … `H2`, for deviations, `N…` for nominal effects.
    pub id: &'static str,
    /// Short name.
    pub name: &'static str,
    /// Block that it lives in.
    pub block: Block,
    /// Nominal or deviation.
    pub role: Role,
    /// Parameters.
    pub parameters: &'static [ParameterSpec],
    /// What "off" means.
    pub off: &'static str,
    /// Where equation and numbers come from.
    pub source: &'static str,
    /// The equation, with symbols.
    pub equation: &'static str,
    /// Makes one.
    pub build: fn(Build<'_>) -> Box<dyn Effect>,
}

impl EffectSpec {
    /// What is said of it as a deviation; `None`: it is nominal.
    pub fn deviation(&self) -> Option<&Deviation> {
        match &self.role {
            Role::Nominal => None,
            Role::Deviation(deviation) => Some(deviation),
        }
    }

    /// Kind of error that the anchor of this effect shows; `None`: it has no anchor.
    pub fn anchor_slot(&self) -> Option<&'static str> {
        self.parameters.iter().find_map(|p| match p.kind {
            Kind::Which(Choice::Anchor(slot)) => Some(slot),
            _ => None,
        })
    }

    /// What a person does about it; nothing about what is nominal.
    pub fn remedy(&self) -> &'static str {
        self.deviation().map_or("", |of| of.remedy)
    }
}

impl std::fmt::Debug for EffectSpec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}", self.id, self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::Kind;
    use crate::effects::ALL;
    use crate::vehicle::Vehicle;

    #[test]
    fn prop_sizes_go_with_the_vehicle_and_the_flapper_has_those_of_the_list() {
        let small = Vehicle::from_toml("[body]\nmass_kg = 0.03\n[battery]\ncells = 1").unwrap();
        let flapper = Vehicle::default();
        let of = |id: &str, name: &str, vehicle: &Vehicle| {
            let spec = ALL.iter().find(|s| s.id == id).unwrap();
            spec.parameters.iter().find(|p| p.name == name).unwrap().of(vehicle)
        };
        for p in ALL.iter().flat_map(|spec| spec.parameters) {
            let same = p.of(&flapper);
            assert_eq!((same.low, same.high, same.default), (p.low, p.high, p.default));
        }
        // 6 g on 102 g is 5.9 %, on any vehicle.
        let share = of("I1", "extra", &small).default / (1e3 * small.body.mass_kg);
        assert!((share - 6.0 / 102.0).abs() < 1e-12);
        // A further resistance takes the same share of the voltage in hover.
        let sag = |v: &Vehicle| of("P2", "extra", v).high / v.hover_ohm();
        assert!((sag(&small) / sag(&flapper) - 1.0).abs() < 1e-12);
        assert!(of("I2", "x", &small).high < 5.0 && of("T2", "delay", &small).high == 80.0);
    }

    /// A verdict of two effects said "anchor = 0.52", and what was accepted of it was anchor 1.
    #[test]
    fn bug_a_choice_was_told_as_a_number_between_two() {
        let mut choices = 0;
        for p in ALL.iter().flat_map(|spec| spec.parameters) {
            let which = p.doc.contains("ascending id") || p.name == "wall";
            assert_eq!(matches!(p.kind, Kind::Which(_)), which, "{}: {}", p.name, p.doc);
            assert_eq!(p.told(0.52), if which { 1.0 } else { 0.52 });
            choices += usize::from(which);
        }
        assert!(choices >= 5, "{choices}");
    }
}
