//! Which effect a flight has since another that was accepted, from the means of `points.rs` alone.
//!
//! Every effect is a few columns whose sizes are normal beforehand; its evidence is by how much more probable the flight is with it than
//! without. What healthy flights scatter comes from the accepted one: the scatter within a channel, and by how much more than that its
//! own halves differ.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use haltere_core::survey::Survey;
use nalgebra::{Matrix3, Vector3};

use super::effects::Kind;
use super::points::{Channel, Point};

/// Planes that are tried for a cut: directions, and shares of the flight beyond each.
const DIRECTIONS: usize = 16;
const BEYOND: [f64; 3] = [0.2, 0.33, 0.5];

/// Usual sizes of what is done to a sensor, as deviations about nothing: a tripod that was pushed, m; a scale; a divider, V.
const USUAL_M: f64 = 0.5;
const USUAL_SHARE: f64 = 0.1;
const USUAL_V: f64 = 0.5;

/// Classes of channels, whose scatter is told alike.
const CLASSES: usize = 4;

/// What a flight is judged by.
pub struct Judge<'a> {
    survey: Option<&'a Survey>,
    mean: BTreeMap<Channel, f64>,
    sigma: [f64; CLASSES],
    /// By how much squares are larger than the scatter within a channel says, by its class.
    inflation: [f64; CLASSES],
}

/// What was found: the kinds with their evidence over nothing, best first, those of a cause that cannot be told apart alike.
pub struct Found {
    /// Whether there is a gap at all.
    pub is_gap: bool,
    /// Logarithm of each kind's odds against nothing.
    pub kinds: Vec<(Kind, f64)>,
}

/// What a kind adds to each point per unit, of up to three columns.
type Columns = Vec<Vector3<f64>>;

impl<'a> Judge<'a> {
    /// By an accepted flight.
    pub fn new(accepted: &[Point], survey: Option<&'a Survey>) -> Self {
        let middle = accepted.iter().map(|p| p.at_s).sum::<f64>() / accepted.len().max(1) as f64;
        let (early, late): (Vec<Point>, Vec<Point>) =
            accepted.iter().partition(|point| point.at_s < middle);
        let mut judge = Self {
            survey,
            mean: means(accepted),
            sigma: sigmas(accepted),
            inflation: [1.0; CLASSES],
        };
        let halves =
            Self { survey, mean: means(&early), sigma: judge.sigma, inflation: [1.0; CLASSES] };
        for (class, inflation) in judge.inflation.iter_mut().enumerate() {
            let kinds = halves.kinds(&late).into_iter();
            let of_class =
                kinds.filter(|kind| class_of(*kind) == class && !matches!(kind, Kind::Cut(_)));
            let gains: Vec<f64> = of_class
                .map(|kind| halves.columns(kind, &late, None))
                .map(|columns| halves.normal(&late, &columns).gain() / f64::from(used(&columns)))
                .collect();
            *inflation = (gains.iter().sum::<f64>() / gains.len().max(1) as f64).max(1.0);
        }
        judge
    }

    /// Kinds that these points could show.
    pub fn kinds(&self, points: &[Point]) -> Vec<Kind> {
        let has = |channel: &dyn Fn(&Channel) -> bool| points.iter().any(|p| channel(&p.channel));
        let anchors = self.survey.map_or(0, |survey| survey.ids().len());
        let at = (0..anchors)
            .filter(|k| has(&|channel| matches!(channel, Channel::Pair(a, b) if a == k || b == k)));
        let mut all: Vec<Kind> =
            at.flat_map(|k| [Kind::Moved(k), Kind::Constant(k), Kind::Cut(k)]).collect();
        if has(&|channel| *channel == Channel::Acc) {
            all.extend([Kind::Acceleration, Kind::Rate]);
        }
        if has(&|channel| *channel == Channel::Thrust) {
            all.extend([Kind::Voltage, Kind::Thrust]);
        }
        all
    }

    /// Judges points.
    pub fn judge(&self, points: &[Point]) -> Found {
        let kinds = self.kinds(points);
        let each = (kinds.len().max(1) as f64).ln();
        let evidence = |kind: Kind| (kind, self.evidence(kind, points) - each);
        let mut kinds: Vec<(Kind, f64)> = kinds.into_iter().map(evidence).collect();
        kinds.sort_by(|a, b| b.1.total_cmp(&a.1));
        let odds: f64 = kinds.iter().map(|(_, evidence)| evidence.min(500.0).exp()).sum();
        Found { is_gap: odds > 1.0, kinds }
    }

    /// Size, in units of what these columns are per unit, from which on a kind is more probable than nothing.
    pub fn smallest(
        &self,
        kind: Kind,
        points: &[Point],
        columns: &[Vector3<f64>],
        of: Vector3<f64>,
    ) -> f64 {
        let each = (self.kinds(points).len().max(1) as f64).ln();
        let Normal { square, .. } = self.normal(points, columns);
        let one = Normal { square, product: square * of };
        let once = one.fit(kind, self.inflation[class_of(kind)]);
        ((each + once.chance) / once.gain).sqrt()
    }

    fn evidence(&self, kind: Kind, points: &[Point]) -> f64 {
        let of = |plane: Option<([f64; 2], f64)>| {
            let normal = self.normal(points, &self.columns(kind, points, plane));
            // A way is only longer.
            let is_shorter = plane.is_some() && normal.product.x < 0.0;
            let fit = normal.fit(kind, self.inflation[class_of(kind)]);
            if is_shorter { -fit.chance } else { fit.gain - fit.chance }
        };
        if !matches!(kind, Kind::Cut(_)) {
            return of(None);
        }
        let tried: Vec<f64> = planes(points).into_iter().map(|plane| of(Some(plane))).collect();
        let best = tried.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = tried.iter().map(|one| (one - best).exp()).sum();
        best + (sum / tried.len().max(1) as f64).ln()
    }

    fn sigma_of(&self, channel: Channel) -> f64 {
        self.sigma[class(channel)]
    }

    /// What a kind adds; of a cut beyond a plane.
    pub fn columns(&self, kind: Kind, points: &[Point], plane: Option<([f64; 2], f64)>) -> Columns {
        let sign = |point: &Point, anchor: usize| match point.channel {
            Channel::Pair(_, b) if b == anchor => 1.0,
            Channel::Pair(a, _) if a == anchor => -1.0,
            _ => 0.0,
        };
        let place = |anchor: usize| {
            let id = self.survey.and_then(|survey| Some((survey, *survey.ids().get(anchor)?)));
            id.and_then(|(survey, id)| survey.position_E_m(id))
        };
        let first = |value: f64| Vector3::new(value, 0.0, 0.0);
        let column = |point: &Point| match kind {
            Kind::Moved(anchor) => place(anchor).map_or(Vector3::zeros(), |at| {
                let away = at.raw() - point.pos_E_m;
                away * (sign(point, anchor) / away.norm().max(1e-3))
            }),
            Kind::Constant(anchor) => first(sign(point, anchor)),
            Kind::Cut(anchor) => plane.map_or(Vector3::zeros(), |([north, east], from)| {
                let is_beyond = north * point.pos_E_m.x + east * point.pos_E_m.y > from;
                first(if is_beyond { sign(point, anchor) } else { 0.0 })
            }),
            Kind::Acceleration if point.channel == Channel::Acc => first(point.base),
            Kind::Rate if matches!(point.channel, Channel::Gyro(_)) => first(point.base),
            // A voltage that is told too high makes the thrust over it too small.
            Kind::Voltage if point.channel == Channel::Thrust => first(-point.base),
            Kind::Thrust if point.channel == Channel::Thrust => first(-1.0),
            _ => Vector3::zeros(),
        };
        points.iter().map(column).collect()
    }

    /// Columns against one another and against what was measured, weighted.
    fn normal(&self, points: &[Point], columns: &[Vector3<f64>]) -> Normal {
        let (mut square, mut product) = (Matrix3::zeros(), Vector3::zeros());
        for (point, column) in points.iter().zip(columns) {
            let Some(mean) = self.mean.get(&point.channel) else { continue };
            let weight = self.sigma_of(point.channel).powi(-2);
            square += column * column.transpose() * weight;
            product += column * (weight * (point.residual - mean));
        }
        Normal { square, product }
    }
}

/// The normal equations of an effect.
struct Normal {
    square: Matrix3<f64>,
    product: Vector3<f64>,
}

/// What an effect adds to the logarithm of the probability, and what it takes off for being any size.
struct Fit {
    gain: f64,
    chance: f64,
}

impl Normal {
    /// What the columns take off chi-square; those that are nothing take off nothing.
    fn gain(&self) -> f64 {
        let inverse = self.square.pseudo_inverse(1e-9 * self.square.norm());
        inverse.map_or(0.0, |inverse| self.product.dot(&(inverse * self.product)))
    }

    /// With sizes that are usual for a kind.
    fn fit(&self, kind: Kind, inflation: f64) -> Fit {
        let usual = match class_of(kind) {
            0 => USUAL_M,
            _ if kind == Kind::Voltage => USUAL_V,
            _ => USUAL_SHARE,
        };
        let (square, product) = (self.square / inflation, self.product / inflation);
        let with = square * usual.powi(2) + Matrix3::identity();
        let inverse = with.try_inverse().unwrap_or_else(Matrix3::zeros);
        Fit {
            gain: 0.5 * usual.powi(2) * product.dot(&(inverse * product)),
            chance: 0.5 * with.determinant().ln(),
        }
    }
}

/// How many columns are not nothing.
fn used(columns: &[Vector3<f64>]) -> u32 {
    if columns.iter().any(|column| column.y != 0.0 || column.z != 0.0) { 3 } else { 1 }
}

/// Planes through the flown room.
pub fn planes(points: &[Point]) -> Vec<([f64; 2], f64)> {
    let directions = (0..DIRECTIONS).map(|k| 2.0 * PI * k as f64 / DIRECTIONS as f64);
    let plane = |angle: f64, share: f64| {
        let along = [angle.cos(), angle.sin()];
        (along, beyond(points, along, share))
    };
    directions.flat_map(|angle| BEYOND.map(|share| plane(angle, share))).collect()
}

/// Where the plane stands that this share of the points of UWB lies beyond.
pub fn beyond(points: &[Point], [north, east]: [f64; 2], share: f64) -> f64 {
    let uwb = points.iter().filter(|point| matches!(point.channel, Channel::Pair(..)));
    let mut along: Vec<f64> =
        uwb.map(|point| north * point.pos_E_m.x + east * point.pos_E_m.y).collect();
    along.sort_by(f64::total_cmp);
    along.get(((1.0 - share) * along.len() as f64) as usize).copied().unwrap_or(f64::INFINITY)
}

fn class(channel: Channel) -> usize {
    match channel {
        Channel::Pair(..) => 0,
        Channel::Acc => 1,
        Channel::Gyro(_) => 2,
        Channel::Thrust => 3,
    }
}

fn class_of(kind: Kind) -> usize {
    match kind {
        Kind::Moved(_) | Kind::Constant(_) | Kind::Cut(_) => 0,
        Kind::Acceleration => 1,
        Kind::Rate => 2,
        Kind::Voltage | Kind::Thrust => 3,
    }
}

fn means(points: &[Point]) -> BTreeMap<Channel, f64> {
    let mut sums: BTreeMap<Channel, (f64, f64)> = BTreeMap::new();
    for point in points {
        let sum = sums.entry(point.channel).or_default();
        *sum = (sum.0 + point.residual, sum.1 + 1.0);
    }
    sums.into_iter().map(|(channel, (sum, n))| (channel, sum / n)).collect()
}

/// Scatter within a channel of each class.
fn sigmas(points: &[Point]) -> [f64; CLASSES] {
    let means = means(points);
    let mut sums = [(0.0, 0.0); CLASSES];
    for point in points {
        let Some(mean) = means.get(&point.channel) else { continue };
        let sum = &mut sums[class(point.channel)];
        *sum = (sum.0 + (point.residual - mean).powi(2), sum.1 + 1.0);
    }
    sums.map(|(sum, n): (f64, f64)| (sum / n.max(1.0)).sqrt().max(1e-9))
}
