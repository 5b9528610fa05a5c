//! How probable each cause is, by what accepted flights scatter.
//!
//! Flights of one session repeat to some tenths of a per cent; from session to session another battery, another place of it and other
//! propellers move the balance by more. Four references of one session do not show that. So the scatter of healthy flights
//! is that of the references together with what is usual between sessions, as if it had been seen on some flights before, and its
//! tails are Student's. Against each cause stand "nothing" and "something else".

use haltere_model::rotorcraft::MOTORS;
use nalgebra::Vector4;

use super::causes::{Cause, Kind, Laws, Trial};
use super::hover::Hover;

/// Usual scatter between sessions of vertical force, roll, pitch and yaw, as shares \[CrazyPAD, vehicle E9: all motors in common 5 %;
/// pitch more than roll, since the pack slides fore and aft; yaw most, since the torque of a propeller scatters as well as its thrust\].
const SESSIONS: [f64; MOTORS] = [0.05, 0.005, 0.01, 0.02];
/// The same of the logarithm of the shaking \[CrazyPAD: a quarter between sets of propellers\].
const SESSIONS_SHAKE: f64 = 0.25;
/// Flights that the usual scatter counts as. Few, so that references soon outweigh it.
const SESSIONS_COUNT: f64 = 4.0;
/// Sessions that references are taken for: what they were flown in is not in the logs, and of one hour is one.
const REFERENCE_SESSIONS: f64 = 2.0;
/// Share of what it does by which the law of a cause is off: propellers are not cut to a law, and arms not measured.
const LAW: f64 = 0.15;
/// What changes that are not in the list do to the balance.
const ELSE: [f64; MOTORS] = [0.10, 0.05, 0.05, 0.05];
/// What a change does to the shaking: it is doubled.
const SHAKEN: f64 = 0.7;
/// Offset of an accelerometer that no program corrects, forward, left and up, from board to board, g \[data sheet of the BMI088: 20 mg; up
/// half of it is taken, since the firmware makes gravity at rest 1 g\].
const BOARDS_G: [f64; 3] = [0.02, 0.02, 0.01];
/// Of one board from flight to flight, g \[the same: 0.2 mg/K, of 20 K; CrazyPAD: 4 to 6 mg between states\].
const FLIGHTS_G: f64 = 0.006;
/// What shakes moves it at times, by as much as another board \[CrazyPAD: in one state of fifteen\].
const SHAKEN_MOVES: f64 = 0.05;
/// Weight beforehand of nothing changed; of a change, of a cause at one motor, at two, one that only shakes, and
/// another vehicle, and something else: one fault is more usual than two, references of another vehicle were mixed up as likely as
/// something broke, and another set of propellers is more usual than two faults.
const NOTHING: f64 = 0.5;
const AT_ONE: f64 = 0.55;
const AT_TWO: f64 = 0.15;
const SHAKES: f64 = 0.1;
const ANOTHER: f64 = 0.55;
const SOMETHING_ELSE: f64 = 0.2;
/// Chance that what the balance shows shakes as well: a propeller that is cut is out of balance, a mass that is bound to an arm is not.
const WEAK_SHAKES: f64 = 0.75;
const LOAD_SHAKES: f64 = 0.25;
const ELSE_SHAKES: f64 = 0.5;
/// Yaw that a load at one motor may bring, over the moment that it brings about roll \[CrazyPAD: 1.0 and 1.4 with the smallest and the largest
/// weight; set after both had been seen\]. Why is not known: we suppose that under a propeller it stands in the wash, which turns, and that of
/// two neighbours the washes turn against one another.
const WASH: f64 = 1.0;
/// Rates of two logs whose shaking may be compared differ by this at most, as a share.
const SAME_RATE: f64 = 0.1;

/// Axes of the balance by their place.
const ROLL: usize = 1;
const YAW: usize = 3;

/// What healthy flights of a vehicle look like.
pub struct Healthy {
    mean: Vector4<f64>,
    mean_shake: f64,
    /// Variances of the next flight.
    variance: Vector4<f64>,
    variance_shake: f64,
    mean_offset: [Option<f64>; 3],
    variance_offset: [f64; 3],
    freedom: f64,
    rate_hz: f64,
}

/// Everything that can be said of a vehicle beside nothing.
pub struct Rivals {
    causes: Vec<(Cause, Vec<Trial>)>,
}

/// A flight against what healthy ones look like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Of the balance.
    pub balance: Vector4<f64>,
    /// Of the logarithm of the shaking; `None` where the rates of the logs differ.
    pub shake: Option<f64>,
    /// Of the accelerometer's offsets, g; `None` where it was not logged.
    pub offset_g: [Option<f64>; 3],
}

/// Probabilities, which sum to 1.
pub struct Weighed {
    /// That nothing is changed.
    pub nothing: f64,
    /// That it is another vehicle.
    pub another: f64,
    /// That it is something else that is not in the list.
    pub something_else: f64,
    /// Of each cause, most probable first.
    pub causes: Vec<Candidate>,
}

/// A cause with what is known of it.
pub struct Candidate {
    /// It.
    pub cause: Cause,
    /// Its probability.
    pub probability: f64,
    /// Mean of its size at each place.
    pub sizes: Vec<f64>,
    /// Central 90 % of each.
    pub sizes_90: Vec<[f64; 2]>,
}

impl Healthy {
    /// From references, of which there is at least one.
    pub fn of(references: &[Hover]) -> Option<Self> {
        let first = references.first()?;
        let n = references.len() as f64;
        let mean = references.iter().map(|r| Vector4::from(r.balance)).sum::<Vector4<f64>>() / n;
        let mean_shake = references.iter().map(|r| r.shake).sum::<f64>() / n;
        let freedom = SESSIONS_COUNT + n - 1.0;
        let next = (1.0 + 1.0 / n.min(REFERENCE_SESSIONS)) / freedom;
        let variance = |usual: f64, apart: &dyn Fn(&Hover) -> f64| {
            let seen: f64 = references.iter().map(|r| apart(r).powi(2)).sum();
            next * (SESSIONS_COUNT * usual.powi(2) + seen)
        };
        let offsets = |axis: usize| -> Option<Vec<f64>> {
            references.iter().map(|r| r.offset_g[axis]).collect()
        };
        let mean_offset =
            [0, 1, 2].map(|axis| offsets(axis).map(|all| all.iter().sum::<f64>() / n));
        let of_offset = |axis: usize| {
            let apart = |r: &Hover| Some(r.offset_g[axis]? - mean_offset[axis]?);
            variance(FLIGHTS_G, &|r| apart(r).unwrap_or_default())
        };
        let of_axis = |axis: usize| variance(SESSIONS[axis], &|r| r.balance[axis] - mean[axis]);
        Some(Self {
            mean,
            mean_shake,
            variance: Vector4::from_fn(|axis, _| of_axis(axis)),
            variance_shake: variance(SESSIONS_SHAKE, &|r| r.shake - mean_shake),
            mean_offset,
            variance_offset: [0, 1, 2].map(of_offset),
            freedom,
            rate_hz: first.rate_hz,
        })
    }

    /// What a flight has that healthy ones have not.
    pub fn change(&self, hover: &Hover) -> Change {
        let is_comparable = (hover.rate_hz / self.rate_hz - 1.0).abs() < SAME_RATE;
        Change {
            balance: Vector4::from(hover.balance) - self.mean,
            shake: is_comparable.then_some(hover.shake - self.mean_shake),
            offset_g: [0, 1, 2].map(|axis| Some(hover.offset_g[axis]? - self.mean_offset[axis]?)),
        }
    }

    /// A change of these alone, of this board.
    pub fn changed_by(&self, balance: Vector4<f64>, shake: f64) -> Change {
        let offset_g = self.mean_offset.map(|logged| logged.map(|_| 0.0));
        Change { balance, shake: Some(shake), offset_g }
    }

    /// Mean of the balance.
    pub fn mean(&self) -> Vector4<f64> {
        self.mean
    }

    /// Standard deviations of the balance of the next healthy flight.
    pub fn sigma(&self) -> Vector4<f64> {
        self.variance.map(f64::sqrt)
    }

    /// Logarithm of Student's density, but for what is the same for all rivals.
    fn log_density(&self, residual: f64, variance: f64) -> f64 {
        let square = residual.powi(2) / (self.freedom * variance);
        -0.5 * ((self.freedom + 1.0) * square.ln_1p() + variance.ln())
    }

    fn balance_density(&self, residual: Vector4<f64>, more: Vector4<f64>) -> f64 {
        let of = |axis: usize| self.log_density(residual[axis], self.variance[axis] + more[axis]);
        (0..MOTORS).map(of).sum::<f64>().exp()
    }

    /// Density of the shaking; less than usual is no fault, and counts as usual.
    fn shake_density(&self, change: &Change, is_shaken: bool) -> f64 {
        let Some(shake) = change.shake else { return 1.0 };
        let more = if is_shaken { SHAKEN.powi(2) } else { 0.0 };
        self.log_density(shake.max(0.0), self.variance_shake + more).exp()
    }

    /// Density of the accelerometer's offsets, of this board or of another.
    fn offset_density(&self, change: &Change, is_another: bool) -> f64 {
        let of = |axis: usize| {
            let boards = if is_another { 2.0 * BOARDS_G[axis].powi(2) } else { 0.0 };
            Some(self.log_density(change.offset_g[axis]?, self.variance_offset[axis] + boards))
        };
        (0..3).filter_map(of).sum::<f64>().exp()
    }

    /// Density of what another vehicle would show: its trims are as usual about none, wherever those of the references lie.
    fn another_density(&self, change: &Change) -> f64 {
        let mut residual = change.balance + self.mean;
        residual[0] = change.balance[0];
        self.balance_density(residual, Vector4::from(ELSE).map(|s| s.powi(2)))
    }
}

impl Rivals {
    /// All causes for a vehicle.
    pub fn of(laws: &Laws<'_>) -> Self {
        let trials = |cause: Cause| {
            let trials = cause.trials(laws);
            (cause, trials)
        };
        Self { causes: Cause::all().into_iter().map(trials).collect() }
    }

    /// The causes with their trials.
    pub fn causes(&self) -> impl Iterator<Item = &(Cause, Vec<Trial>)> {
        self.causes.iter()
    }

    /// How probable each is for what was seen.
    pub fn weigh(&self, change: &Change, healthy: &Healthy) -> Weighed {
        let [this_board, another_board] =
            [false, true].map(|is| healthy.offset_density(change, is));
        let shakes = [false, true].map(|is| healthy.shake_density(change, is));
        let mixed = |chance: f64, [not, is]: [f64; 2]| chance * is + (1.0 - chance) * not;
        let [calm, shaken] =
            [shakes[0] * this_board, shakes[1] * mixed(SHAKEN_MOVES, [this_board, another_board])];
        let either = |chance: f64| mixed(chance, [calm, shaken]);
        let none = healthy.balance_density(change.balance, Vector4::zeros());
        let beside = Vector4::from(ELSE).map(|s| s.powi(2));
        let nothing = NOTHING * none * calm;
        let something_else = (1.0 - NOTHING)
            * SOMETHING_ELSE
            * healthy.balance_density(change.balance, beside)
            * either(ELSE_SHAKES);
        let another = (1.0 - NOTHING)
            * ANOTHER
            * healthy.another_density(change)
            * another_board
            * mixed(ELSE_SHAKES, shakes);
        let count =
            |of: usize| self.causes.iter().filter(|(c, _)| c.motors.len() == of).count() as f64;
        let priors = [SHAKES / count(0), AT_ONE / count(1), AT_TWO / count(2)];
        let mut total = nothing + another + something_else;
        let mut causes = Vec::new();
        for (cause, trials) in &self.causes {
            let prior = (1.0 - NOTHING) * priors[cause.motors.len()];
            let shakes = match cause.kind {
                // Without the shaking nothing is known of these.
                Kind::Unbalanced | Kind::Swinging if change.shake.is_none() => 0.0,
                Kind::Unbalanced | Kind::Swinging => shaken,
                Kind::WeakMotor => either(WEAK_SHAKES),
                Kind::Load => either(LOAD_SHAKES),
            };
            let density = |trial: &Trial| {
                let mut law = trial.adds.map(|value| (LAW * value).powi(2));
                if cause.kind == Kind::Load && cause.motors.len() == 1 {
                    law[YAW] += (WASH * trial.adds[ROLL]).powi(2);
                }
                trial.weight * healthy.balance_density(change.balance - trial.adds, law)
            };
            let densities: Vec<f64> = trials.iter().map(density).collect();
            let evidence = prior * shakes * densities.iter().sum::<f64>();
            total += evidence;
            causes.push(Candidate {
                cause: cause.clone(),
                probability: evidence,
                sizes: marginal(trials, &densities, mean),
                sizes_90: marginal(trials, &densities, central_90),
            });
        }
        causes.iter_mut().for_each(|candidate| candidate.probability /= total);
        causes.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        let [nothing, another, something_else] =
            [nothing, another, something_else].map(|evidence| evidence / total);
        Weighed { nothing, another, something_else, causes }
    }
}

/// A number of the sizes at each place, whose densities are summed over the sizes at the others.
fn marginal<T>(trials: &[Trial], densities: &[f64], of: fn(&mut [(f64, f64)]) -> T) -> Vec<T> {
    let places = trials.first().map_or(0, |trial| trial.sizes.len());
    let total: f64 = densities.iter().sum();
    let at = |place: usize| {
        let sizes = trials.iter().map(|trial| trial.sizes[place]);
        let weights = densities.iter().map(|density| density / total);
        of(&mut sizes.zip(weights).collect::<Vec<_>>())
    };
    (0..places).map(at).collect()
}

fn mean(weighted: &mut [(f64, f64)]) -> f64 {
    weighted.iter().map(|(size, weight)| size * weight).sum()
}

fn central_90(weighted: &mut [(f64, f64)]) -> [f64; 2] {
    weighted.sort_by(|a, b| a.0.total_cmp(&b.0));
    [0.05, 0.95].map(|share| {
        let mut sum = 0.0;
        let at = weighted.iter().find(|(_, weight)| {
            sum += weight;
            sum >= share
        });
        at.or(weighted.last()).map_or(f64::NAN, |(size, _)| *size)
    })
}
