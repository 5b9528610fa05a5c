//! What a cause adds to the balance of a hover, by its size.

use haltere_model::rotorcraft::{MOTORS, Rotorcraft};
use nalgebra::{Matrix4, Vector4};
use serde::Serialize;

/// Largest loss of thrust of a motor that is tried: with more of it no vehicle with a reserve of two hovers under control.
const MOST_LOSS: f64 = 0.45;
/// Largest load that is tried, as a share of the mass.
const MOST_LOAD: f64 = 0.18;
/// Usual size of each, as a deviation about nothing: what still flies is more often small than large.
const USUAL_LOSS: f64 = 0.15;
const USUAL_LOAD: f64 = 0.05;
/// Sizes that are tried of a cause at one motor, and of each of two.
const SIZES: usize = 90;
const SIZES_OF_TWO: usize = 30;

/// What can be named.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A motor with its propeller gives less thrust for the same command: cut, bent or worn, or a weak motor. The size is the loss.
    WeakMotor,
    /// A mass more at the place of a motor. The size is its share of the vehicle's mass.
    Load,
    /// A propeller out of balance, which shows in how much the controller works and not in what it holds.
    Unbalanced,
    /// A load that swings, which shows in the same.
    Swinging,
}

/// A cause at its places.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Cause {
    /// What.
    pub kind: Kind,
    /// Where: motors as the log counts them, from 1. None where it could be any.
    pub motors: Vec<usize>,
}

/// What causes do: flown by a simulator where it has flown them, by a formula where not.
#[derive(Clone)]
pub struct Laws<'a> {
    vehicle: &'a Rotorcraft,
    to_balance: Matrix4<f64>,
    flown: Option<&'a Curves>,
}

/// What causes at one motor add to the balance, by sizes that were flown.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Curves(pub(super) Vec<(Cause, Curve)>);

/// Sizes of a cause, and what each does to the balance.
pub(super) type Curve = Vec<(f64, Vector4<f64>)>;

impl Curves {
    /// At a size, between those that were flown in proportion; `None` where no flight of it is there.
    fn adds(&self, kind: Kind, motor: usize, size: f64) -> Option<Vector4<f64>> {
        let is_it = |cause: &Cause| cause.kind == kind && cause.motors == [motor];
        let (_, curve) = self.0.iter().find(|(cause, _)| is_it(cause))?;
        let next = curve.partition_point(|(at, _)| *at < size).min(curve.len().checked_sub(1)?);
        let (low, from) = match next.checked_sub(1) {
            Some(before) => curve[before],
            None => (0.0, Vector4::zeros()),
        };
        let (high, to) = curve[next];
        Some(from + (to - from) * ((size - low) / (high - low)))
    }
}

impl<'a> Laws<'a> {
    /// For a vehicle; `None`: its file holds no quadrotor.
    pub fn of(vehicle: &'a Rotorcraft, flown: Option<&'a Curves>) -> Option<Self> {
        Some(Self { vehicle, to_balance: vehicle.to_balance()?, flown })
    }
}

/// One size of a cause, with what it does.
pub struct Trial {
    /// Size at each place.
    pub sizes: Vec<f64>,
    /// What it adds to the balance.
    pub adds: Vector4<f64>,
    /// How usual this size is; of all trials of a cause together 1.
    pub weight: f64,
}

impl Cause {
    /// The cause of an id.
    pub fn find(id: &str) -> Option<Self> {
        Self::all().into_iter().find(|cause| cause.id() == id)
    }

    /// Everything that can be named.
    pub fn all() -> Vec<Self> {
        let singles = (1..=MOTORS).map(|motor| vec![motor]);
        let pairs = (1..=MOTORS).flat_map(|a| (a + 1..=MOTORS).map(move |b| vec![a, b]));
        let places: Vec<Vec<usize>> = singles.chain(pairs).collect();
        let of =
            |kind: Kind| places.iter().map(move |motors| Self { kind, motors: motors.clone() });
        let anywhere =
            [Kind::Unbalanced, Kind::Swinging].map(|kind| Self { kind, motors: Vec::new() });
        of(Kind::WeakMotor).chain(of(Kind::Load)).chain(anywhere).collect()
    }

    /// Name for scripts, as `load M3` and `weak_motor M1 M2`.
    pub fn id(&self) -> String {
        let kind = match self.kind {
            Kind::WeakMotor => "weak_motor",
            Kind::Load => "load",
            Kind::Unbalanced => "unbalanced",
            Kind::Swinging => "swinging",
        };
        let places = self.motors.iter().map(|motor| format!(" M{motor}"));
        std::iter::once(kind.to_owned()).chain(places).collect()
    }

    /// All sizes that are tried.
    pub fn trials(&self, laws: &Laws<'_>) -> Vec<Trial> {
        let (most, usual) = match self.kind {
            Kind::WeakMotor => (MOST_LOSS, USUAL_LOSS),
            Kind::Load => (MOST_LOAD, USUAL_LOAD),
            Kind::Unbalanced | Kind::Swinging => {
                return vec![Trial { sizes: Vec::new(), adds: Vector4::zeros(), weight: 1.0 }];
            }
        };
        let count = if self.motors.len() > 1 { SIZES_OF_TWO } else { SIZES };
        let sizes = (1..=count).map(|k| most * k as f64 / count as f64);
        let all: Vec<Vec<f64>> = match self.motors.len() {
            1 => sizes.map(|size| vec![size]).collect(),
            _ => sizes.clone().flat_map(|a| sizes.clone().map(move |b| vec![a, b])).collect(),
        };
        let weight = |sizes: &[f64]| {
            sizes.iter().map(|size| (-0.5 * (size / usual).powi(2)).exp()).product::<f64>()
        };
        let total: f64 = all.iter().map(|sizes| weight(sizes)).sum();
        let trial = |sizes: Vec<f64>| Trial {
            adds: self.adds(&sizes, laws),
            weight: weight(&sizes) / total,
            sizes,
        };
        all.into_iter().map(trial).collect()
    }

    /// What the cause adds to the balance at these sizes.
    ///
    /// A motor that loses the share λ is told `1/(1 - λ)` times as much thrust for what it held. A mass of the share q at a place
    /// adds its weight to the vertical force and the moments of it to roll and pitch, which all motors carry; nothing to yaw.
    ///
    /// What two motors add is the sum of what each adds where a simulator flew each.
    pub fn adds(&self, sizes: &[f64], laws: &Laws<'_>) -> Vector4<f64> {
        let places = || self.motors.iter().zip(sizes);
        let of_flight = laws.flown.and_then(|flown| {
            places().map(|(motor, size)| flown.adds(self.kind, *motor, *size)).sum()
        });
        if let Some(flown) = of_flight.filter(|_| !self.motors.is_empty()) {
            return flown;
        }
        let Laws { vehicle, to_balance, .. } = laws;
        let mut thrusts = Vector4::repeat(1.0);
        let [right_m, forward_m] = vehicle.levers_m();
        for (motor, size) in places().map(|(motor, size)| (motor - 1, size)) {
            match self.kind {
                Kind::WeakMotor => thrusts[motor] /= 1.0 - size,
                Kind::Load => {
                    let at = vehicle.motor[motor];
                    let moments = [1.0, -at.right_m / right_m, at.forward_m / forward_m, 0.0];
                    if let Some(to_thrusts) = to_balance.try_inverse() {
                        thrusts += to_thrusts * Vector4::from(moments) * *size;
                    }
                }
                Kind::Unbalanced | Kind::Swinging => {}
            }
        }
        to_balance * thrusts.map(f64::ln)
    }
}
