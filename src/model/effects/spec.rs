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
    Thrust,
    Aerodynamics,
    Battery,
    Imu,
    Uwb,
    Estimator,
    Timing,
}

impl Block {
    /// Name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Block::Mission => "mission",
            Block::Controller => "controller",
            Block::Link => "link",
            Block::InnerLoop => "inner_loop",
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// On unless switched off.
    Nominal,
    /// Off unless switched on.
    Deviation,
}

/// Where the value of a parameter comes from when nobody gives one.
#[derive(Clone, Copy)]
pub enum Source {
    /// The default of the list.
    List,
    /// This number of the vehicle file; a value given for the parameter replaces it there.
    Vehicle(fn(&mut Vehicle) -> &mut f64),
}

/// One parameter of an effect.
#[derive(Clone, Copy)]
pub struct ParameterSpec {
    /// Key.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
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
}

impl ParameterSpec {
    /// A parameter of the effect itself.
    pub const fn new(
        name: &'static str,
        unit: &'static str,
        off: f64,
        default: f64,
        [low, high]: [f64; 2],
        doc: &'static str,
    ) -> Self {
        Self { name, unit, off, default, low, high, doc, source: Source::List }
    }

    /// Whether it says which one, as the place of an anchor in the survey does, and not how much.
    pub fn is_choice(&self) -> bool {
        matches!(self.name, "anchor" | "wall")
    }

    /// `value` as it is told and written down: there is nothing between two choices.
    pub fn told(&self, value: f64) -> f64 {
        if self.is_choice() { value.round() } else { value }
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
    /// `A1` … `H2` as in GAP.md for deviations, `N…` for nominal effects.
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

impl std::fmt::Debug for EffectSpec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}", self.id, self.name)
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::ALL;

    /// A verdict of two effects said "anchor = 0.52", and what was accepted of it was anchor 1.
    #[test]
    fn bug_a_choice_was_told_as_a_number_between_two() {
        let mut choices = 0;
        for p in ALL.iter().flat_map(|spec| spec.parameters) {
            let which = p.doc.contains("ascending id") || p.name == "wall";
            assert_eq!(p.is_choice(), which, "{}: {}", p.name, p.doc);
            assert_eq!(p.told(0.52), if which { 1.0 } else { 0.52 });
            choices += usize::from(which);
        }
        assert!(choices >= 5, "{choices}");
    }
}
