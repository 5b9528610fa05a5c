//! What the report shows beyond the verdict: gap matrix, onset, floor plan with anchor graph, the
//! signature of the named effect, a strip of time. All of it plain numbers, for the page and for JSON.
//!
//! Anchor graph: mean residuals of pairs `r_ab = n_b - n_a + c_ab`, `n` by least squares with `Σ n = 0`
//! (GAP.md 2.4), told from the median of all. The node part `n` is the anchor's own, the loop part `c` is of the path between.

pub mod details;
pub mod matrix;
pub mod onset;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::bank::archive::Shelf;
use crate::flight::cells::Part;
use crate::flight::residuals::uwb::SIDE;
use crate::picture::details::{Details, fly_nulls, kept_nulls};
use crate::picture::matrix::{Matrix, Square, floor, matrix};
use crate::picture::onset::{Onset, onset};
use crate::scene::Scene;
use crate::shrink::{mean, median};
use haltere_core::measure::AnchorId;
use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use haltere_model::effects::EffectSpec;

/// Null flights, and flights with what was named.
const NULLS: u64 = 48;
const WITH: u64 = 6;
/// First seed: none of a bank's, of a shrink's or of an advice's.
const SEED: u64 = 6_600_000;
/// Bins of a signature.
const BINS: usize = 12;

/// All pictures of one flight.
#[derive(Debug, Clone, Serialize)]
pub struct Picture {
    /// Cells against null flights.
    pub matrix: Matrix,
    /// Since when.
    pub onset: Onset,
    /// Room, anchors, places.
    pub plan: FloorPlan,
    /// The strongest residual over time.
    pub strip: Option<Strip>,
    /// The same over what it depends on.
    pub signature: Option<Signature>,
}

/// The room from above.
#[derive(Debug, Clone, Default, Serialize)]
pub struct FloorPlan {
    /// South and north wall, west and east wall, m.
    pub north_m: [f64; 2],
    /// West and east wall, m.
    pub east_m: [f64; 2],
    /// Anchors with their own part of the gap.
    pub anchors: Vec<Node>,
    /// Paths between anchors with theirs.
    pub paths: Vec<Path>,
    /// Places.
    pub places: Vec<Place>,
}

/// An anchor.
#[derive(Debug, Clone, Serialize)]
pub struct Node {
    /// Id.
    pub id: u8,
    /// North, east, height, m.
    pub position_m: [f64; 3],
    /// Its part of the residuals beyond the null flights, m; absent: not measured.
    pub node_m: Option<f64>,
    /// Sigma.
    pub t: Option<f64>,
}

/// The path between two anchors.
#[derive(Debug, Clone, Serialize)]
pub struct Path {
    /// Ids.
    pub anchors: [u8; 2],
    /// What the anchors' own parts leave, m.
    pub loop_m: f64,
    /// Sigma.
    pub t: Option<f64>,
}

/// A voxel of the floor.
#[derive(Debug, Clone, Serialize)]
pub struct Place {
    /// South and north end, m.
    pub north_m: [f64; 2],
    /// West and east end, m.
    pub east_m: [f64; 2],
    /// Root mean square of the UWB residual, sigma away from null flights; absent: not visited.
    pub uwb_t: Option<f64>,
    /// Whether it survives the false discovery rate.
    pub significant: bool,
    /// Horizontal force beyond null flights, north and east, m/s²; absent: not visited.
    pub force_NE_mps2: Option<[f64; 2]>,
    /// Sigma of its larger component.
    pub force_t: Option<f64>,
}

/// One residual over time.
#[derive(Debug, Clone, Serialize)]
pub struct Strip {
    /// Residual with unit.
    pub label: String,
    /// The flight, one value a second.
    pub real: Vec<Option<f64>>,
    /// Range of 95 % of null flights.
    pub band: Vec<Option<[f64; 2]>>,
    /// Mean of flights with the named effect.
    pub fitted: Vec<Option<f64>>,
}

/// One residual over what it depends on.
#[derive(Debug, Clone, Serialize)]
pub struct Signature {
    /// Residual with unit.
    pub label: String,
    /// Regressor with unit.
    pub regressor: &'static str,
    /// Correlation of the two over the seconds of the flight.
    pub correlation: f64,
    /// Seconds of the flight: regressor, residual.
    pub real: Vec<[f64; 2]>,
    /// Mean of null flights in bins.
    pub nominal: Vec<[f64; 2]>,
    /// Mean of flights with the named effect in bins.
    pub fitted: Vec<[f64; 2]>,
}

/// Draws the pictures of a flight. `named`: effects to show beside it; `shelf`: where null flights are kept; `progress`: done, of how many.
pub fn picture(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    flight: &Details,
    references: &[Details],
    named: &[(&EffectSpec, &[f64])],
    shelf: &Shelf,
    progress: impl Fn(usize, usize) + Sync,
) -> Picture {
    let of = (NULLS + if named.is_empty() { 0 } else { WITH }) as usize;
    let seeds = SEED..SEED + NULLS;
    let nulls = kept_nulls(scene, items, flight, seeds, shelf, |k, _| progress(k, of));
    let with = if named.is_empty() {
        Vec::new()
    } else {
        let seeds = SEED + 1000..SEED + 1000 + WITH;
        fly_nulls(scene, items, named, seeds, |k, _| progress(NULLS as usize + k, of))
    };
    of_flights(scene, flight, &nulls, references, &with)
}

/// The same from flights that were flown elsewhere.
pub fn of_flights(
    scene: &Scene,
    flight: &Details,
    nulls: &[Details],
    references: &[Details],
    with: &[Details],
) -> Picture {
    let matrix = matrix(flight, nulls, references);
    // Accepted flights of the airframe are the better "never", where there are enough of them.
    let never = if references.len() >= LEAST_REFERENCES { references } else { nulls };
    let shifted;
    let with = if references.len() >= LEAST_REFERENCES {
        shifted = moved(with, nulls, references);
        &shifted
    } else {
        with
    };
    let onset = onset(flight, never, with);
    let plan = plan(scene, flight, nulls, references, &matrix.squares);
    let strip = onset.strongest.and_then(|i| strip(i, flight, never, with));
    let signature = onset.strongest.and_then(|i| signature(i, flight, never, with));
    Picture { matrix, onset, plan, strip, signature }
}

/// Reference flights from which they replace null flights over time.
const LEAST_REFERENCES: usize = 12;

fn second(from: &[Details], line: usize, t: usize) -> impl Iterator<Item = f64> + '_ {
    from.iter().filter_map(move |d| d.lines.get(line)?.values.get(t).copied())
}

/// Simulated flights moved by what the airframe differs from the simulator, second by second.
fn moved(with: &[Details], nulls: &[Details], references: &[Details]) -> Vec<Details> {
    let mut out = with.to_vec();
    for flight in &mut out {
        for (i, line) in flight.lines.iter_mut().enumerate() {
            for (t, value) in line.values.iter_mut().enumerate() {
                let off = mean(second(references, i, t)) - mean(second(nulls, i, t));
                if off.is_finite() {
                    *value += off;
                }
            }
        }
    }
    out
}

fn strip(i: usize, flight: &Details, nulls: &[Details], with: &[Details]) -> Option<Strip> {
    let line = flight.lines.get(i)?;
    let finite = |v: f64| v.is_finite().then_some(v);
    let band = |t: usize| {
        let middle = mean(second(nulls, i, t));
        let var = mean(second(nulls, i, t).map(|v| (v - middle).powi(2)));
        let half = 1.96 * var.sqrt();
        (middle.is_finite() && half.is_finite()).then_some([middle - half, middle + half])
    };
    Some(Strip {
        label: line.label(),
        real: line.values.iter().map(|v| finite(*v)).collect(),
        band: (0..line.values.len()).map(band).collect(),
        fitted: (0..line.values.len()).map(|t| finite(mean(second(with, i, t)))).collect(),
    })
}

fn signature(i: usize, flight: &Details, nulls: &[Details], with: &[Details]) -> Option<Signature> {
    let line = flight.lines.get(i)?;
    // What the effect adds, or what the flight differs by where none is named.
    let shift: Vec<f64> = (0..line.values.len())
        .map(|t| {
            let own = if with.is_empty() { line.values[t] } else { mean(second(with, i, t)) };
            own - mean(second(nulls, i, t))
        })
        .collect();
    let (k, regressor) = flight
        .regressors
        .iter()
        .enumerate()
        .map(|(k, r)| (k, r, correlation(&r.values, &shift).abs()))
        .filter(|(.., c)| c.is_finite())
        .max_by(|a, b| a.2.total_cmp(&b.2))
        .map(|(k, r, _)| (k, r))?;
    let pairs = |d: &Details| -> Vec<[f64; 2]> {
        let (Some(x), Some(y)) = (d.regressors.get(k), d.lines.get(i)) else { return Vec::new() };
        let both = x.values.iter().zip(&y.values).map(|(x, y)| [*x, *y]);
        both.filter(|p| p.iter().all(|v| v.is_finite())).collect()
    };
    let real = pairs(flight);
    let all = |from: &[Details]| binned(&from.iter().flat_map(&pairs).collect::<Vec<_>>(), &real);
    let (nominal, fitted) = (all(nulls), all(with));
    Some(Signature {
        label: line.label(),
        regressor: regressor.name,
        correlation: correlation(&regressor.values, &line.values),
        real,
        nominal,
        fitted,
    })
}

fn correlation(x: &[f64], y: &[f64]) -> f64 {
    let both: Vec<(f64, f64)> = x
        .iter()
        .zip(y)
        .filter(|(x, y)| x.is_finite() && y.is_finite())
        .map(|(x, y)| (*x, *y))
        .collect();
    let (mx, my) = (mean(both.iter().map(|p| p.0)), mean(both.iter().map(|p| p.1)));
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in both {
        xx += (x - mx).powi(2);
        xy += (x - mx) * (y - my);
        yy += (y - my).powi(2);
    }
    if xx > 0.0 && yy > 0.0 { xy / (xx * yy).sqrt() } else { f64::NAN }
}

/// Means over equal spans of the regressor, within the range of the flight.
fn binned(points: &[[f64; 2]], real: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let (low, high) = real
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p[0]), b.max(p[0])));
    if low.partial_cmp(&high) != Some(std::cmp::Ordering::Less) {
        return Vec::new();
    }
    let mut sums = [[0.0; 3]; BINS];
    for [x, y] in points {
        let share = (x - low) / (high - low);
        if (0.0..=1.0).contains(&share) {
            let sum = &mut sums[((share * BINS as f64) as usize).min(BINS - 1)];
            *sum = [sum[0] + x, sum[1] + y, sum[2] + 1.0];
        }
    }
    sums.iter().filter(|s| s[2] >= 3.0).map(|s| [s[0] / s[2], s[1] / s[2]]).collect()
}

fn plan(
    scene: &Scene,
    flight: &Details,
    nulls: &[Details],
    references: &[Details],
    squares: &[Square],
) -> FloorPlan {
    let room = &scene.room;
    let cut = |[low, high]: [f64; 2], k: usize| {
        let step = (high - low) / SIDE as f64;
        [low + k as f64 * step, low + (k + 1) as f64 * step]
    };
    let uwb = |v: usize| {
        let own = |s: &&Square| s.channel == "Uwb" && s.part == Part::Voxel(v as u8);
        squares.iter().find(own)
    };
    let force = |from: &[Details], v: usize, axis: usize| -> Vec<f64> {
        from.iter().map(|d| d.force_NE_mps2.get(v).map_or(f64::NAN, |f| f[axis])).collect()
    };
    let places = (0..SIDE * SIDE)
        .map(|v| {
            let own = flight.force_NE_mps2.get(v).copied().unwrap_or([f64::NAN; 2]);
            let floors = [0, 1].map(|a| floor(&force(nulls, v, a), &force(references, v, a)));
            let (mut off, mut t) = ([f64::NAN; 2], None);
            if let [Some(n), Some(e)] = floors {
                off = [own[0] - n.middle, own[1] - e.middle];
                t = Some((off[0] / n.sigma).abs().max((off[1] / e.sigma).abs()));
            }
            let visited = off.iter().all(|v| v.is_finite());
            Place {
                north_m: cut(room.north_m, v / SIDE),
                east_m: cut(room.east_m, v % SIDE),
                uwb_t: uwb(v).and_then(|s| s.t),
                significant: uwb(v).is_some_and(|s| s.significant),
                force_NE_mps2: visited.then_some(off),
                force_t: t.filter(|_| visited),
            }
        })
        .collect();
    let (anchors, paths) = graph(scene, flight, nulls, references);
    FloorPlan { north_m: room.north_m, east_m: room.east_m, anchors, paths, places }
}

/// Node and loop parts of the anchor graph.
fn graph(
    scene: &Scene,
    flight: &Details,
    nulls: &[Details],
    references: &[Details],
) -> (Vec<Node>, Vec<Path>) {
    let ids = scene.survey.ids();
    let of = |d: &Details| split(&d.pairs_m, ids);
    let own = of(flight);
    let nulls: Vec<_> = nulls.iter().map(of).collect();
    let references: Vec<_> = references.iter().map(of).collect();
    let node_of = |from: &[(Vec<f64>, Vec<f64>)], k: usize| -> Vec<f64> {
        from.iter().map(|s| s.0.get(k).copied().unwrap_or(f64::NAN)).collect()
    };
    let path_of = |from: &[(Vec<f64>, Vec<f64>)], k: usize| -> Vec<f64> {
        from.iter().map(|s| s.1.get(k).copied().unwrap_or(f64::NAN)).collect()
    };
    let anchors = ids
        .iter()
        .enumerate()
        .filter_map(|(k, id)| {
            let p = scene.survey.position_E_m(*id)?;
            let floor = floor(&node_of(&nulls, k), &node_of(&references, k));
            let off = floor.zip(own.0.get(k)).map(|(f, v)| (v - f.middle, f.sigma));
            let off = off.filter(|(v, _)| v.is_finite());
            Some(Node {
                id: id.0,
                position_m: [p.x(), p.y(), -p.z()],
                node_m: off.map(|(v, _)| v),
                t: off.map(|(_, sigma)| sigma),
            })
        })
        .collect();
    let anchors = beside_the_usual(anchors);
    let paths = flight
        .pairs_m
        .iter()
        .enumerate()
        .filter_map(|(k, (a, b, _))| {
            let value = own.1.get(k).copied().filter(|v| v.is_finite())?;
            let floor = floor(&path_of(&nulls, k), &path_of(&references, k));
            let loop_m = floor.map_or(value, |f| value - f.middle);
            let t = floor.map(|f| loop_m / f.sigma);
            Some(Path { anchors: [a.0, b.0], loop_m, t })
        })
        .collect();
    (anchors, paths)
}

/// Most anchors are right: their own parts are told from the middle one's, or one that is off would push all others to its
/// other side. `anchors`: with their sigma for `t`.
fn beside_the_usual(mut anchors: Vec<Node>) -> Vec<Node> {
    let mut parts: Vec<f64> = anchors.iter().filter_map(|a| a.node_m).collect();
    let middle = median(&mut parts);
    for node in &mut anchors {
        node.node_m = node.node_m.map(|part| part - middle);
        node.t = node.node_m.zip(node.t).map(|(part, sigma)| part / sigma);
    }
    anchors
}

/// Node part of every anchor and loop part of every pair.
fn split(pairs: &[(AnchorId, AnchorId, f64)], ids: &[AnchorId]) -> (Vec<f64>, Vec<f64>) {
    let n = ids.len();
    let place = |id: &AnchorId| ids.iter().position(|own| own == id);
    // Laplacian plus one: the gauge Σ n = 0.
    let mut laplacian = DMatrix::from_element(n, n, 1.0);
    let mut right = DVector::zeros(n);
    let mut seen = vec![false; n];
    for (a, b, r) in pairs.iter().filter(|p| p.2.is_finite()) {
        let (Some(a), Some(b)) = (place(a), place(b)) else { continue };
        laplacian[(a, a)] += 1.0;
        laplacian[(b, b)] += 1.0;
        laplacian[(a, b)] -= 1.0;
        laplacian[(b, a)] -= 1.0;
        right[a] -= r;
        right[b] += r;
        (seen[a], seen[b]) = (true, true);
    }
    let nodes = laplacian.lu().solve(&right);
    let node = |k: usize| nodes.as_ref().filter(|_| seen[k]).map_or(f64::NAN, |n| n[k]);
    let loops = pairs
        .iter()
        .map(|(a, b, r)| match (place(a), place(b)) {
            (Some(a), Some(b)) => r - (node(b) - node(a)),
            _ => f64::NAN,
        })
        .collect();
    ((0..n).map(node).collect(), loops)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_biased_anchor_is_a_node_and_a_blocked_path_a_loop() {
        let ids: Vec<AnchorId> = (0..5).map(AnchorId).collect();
        let mut pairs = Vec::new();
        for a in 0..5u8 {
            for b in a + 1..5 {
                let bias = f64::from(u8::from(b == 3)) - f64::from(u8::from(a == 3));
                pairs.push((AnchorId(a), AnchorId(b), 0.2 * bias));
            }
        }
        let (nodes, loops) = split(&pairs, &ids);
        // Gauge: the mean is taken out.
        assert!((nodes[3] - 0.16).abs() < 1e-9 && (nodes[0] + 0.04).abs() < 1e-9, "{nodes:?}");
        assert!(loops.iter().all(|c| c.abs() < 1e-9), "{loops:?}");
        pairs[0].2 += 0.3;
        let (_, loops) = split(&pairs, &ids);
        assert!(loops[0] > 0.15, "{loops:?}");
        let (nodes, loops) = split(&[(AnchorId(0), AnchorId(9), 1.0)], &ids);
        assert!(nodes.iter().all(|n| n.is_nan()) && loops[0].is_nan());
        // One that is off makes no other one heavy.
        let node = |id, part| Node { id, position_m: [0.0; 3], node_m: Some(part), t: Some(0.01) };
        let told = beside_the_usual(
            (0..5).map(|id| node(id, if id == 3 { 0.16 } else { -0.04 })).collect(),
        );
        let heavy: Vec<u8> =
            told.iter().filter(|n| n.t.unwrap().abs() >= 3.0).map(|n| n.id).collect();
        assert_eq!(heavy, [3]);
        assert!((told[3].node_m.unwrap() - 0.2).abs() < 1e-9, "{told:?}");
    }
}
