//! UWB: TDOA minus that of the smoothed position, m; as a whole, and anchor by anchor.
//!
//! An error of one anchor's path shows in all pairs with it, and bends the smoothed position. The
//! scan over anchors therefore frees the position in every window of half a second before it asks
//! how much each anchor's own error would explain: as a constant, a displacement, a ramp, an error
//! near the floor, or in one place.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::{Channel, Flight, Sheet};
use crate::flight::regress::{Ridge, cholesky_solve, log, moments};
use crate::flight::smoother::model;
use crate::flight::timeline::STEP_S;
use haltere_core::measure::AnchorId;
use haltere_model::effects::Block;

/// Points of the grid in a window of free position: 0.48 s.
const WINDOW: usize = 12;
/// Columns of an anchor: constant, displacement (3), ramp, near the floor.
const COLUMNS: usize = 6;
/// One sigma of a TDOA in the scan, m: correlated rows count less.
const ROW_STD_M: f64 = 0.5;
/// Prior of each column: m, m (3), m per min, m.
const PRIOR: [f64; COLUMNS] = [0.3, 0.3, 0.3, 0.3, 0.3, 0.3];
/// Height below which paths to the floor's anchors suffer, m, and how high those anchors are.
const LOW_M: f64 = 0.5;
const LOW_ANCHOR_M: f64 = 1.0;
/// Voxels of the floor per side.
pub const SIDE: usize = 4;
/// Error that is an outlier, m.
const OUTLIER_M: f64 = 0.4;

/// Kinds of error of one anchor, their columns, and how they are called.
const KINDS: [(&str, std::ops::Range<usize>); 4] =
    [("bias", 0..1), ("place", 1..4), ("drift", 4..5), ("low", 5..6)];

/// Residual of each TDOA of the flight's list, m, with gradient on the position.
#[derive(Debug, Default)]
pub struct Rows {
    /// m.
    pub r_m: Vec<f64>,
    /// Gradient.
    pub h: Vec<Vector3<f64>>,
    /// Smoothed antenna position, Earth, m.
    pub p: Vec<Vector3<f64>>,
}

/// Residuals of a flight.
pub fn residuals(f: &Flight<'_>) -> Rows {
    let mut rows = Rows::default();
    rows.r_m.reserve(f.tdoa.len());
    rows.h.reserve(f.tdoa.len());
    rows.p.reserve(f.tdoa.len());
    for m in &f.tdoa {
        let (s, next) = (&f.states[m.k], &f.states[(m.k + 1).min(f.len() - 1)]);
        let p = s.pos_E_m + (next.pos_E_m - s.pos_E_m) * m.share;
        let (h, predicted) = model(&p, &f.sites_E_m[m.a], &f.sites_E_m[m.b]);
        rows.r_m.push(m.z_m - predicted);
        rows.h.push(h);
        rows.p.push(p);
    }
    rows
}

/// What was found anchor by anchor.
struct Scan {
    /// Per kind: (gain, estimate, anchor), sorted by gain.
    kinds: [Vec<(f64, f64, usize)>; KINDS.len()],
}

/// Writes the statistics and returns the anchors that fill the first slot of each kind (bias, place,
/// drift, low, zone); `None` lists the statistics.
pub fn put(f: Option<(&Flight<'_>, &Rows)>, sheet: &mut Sheet) -> Vec<AnchorId> {
    let mut anchors = Vec::new();
    let at = (Block::Uwb, Channel::Uwb);
    let scan = f.map(|(f, rows)| scan(f, rows));
    for (i, (kind, _)) in KINDS.iter().enumerate() {
        let found = scan.as_ref().map(|s| &s.kinds[i]);
        let get = |n: usize| found.and_then(|s| s.get(n)).copied();
        let gain = |n: usize| get(n).map_or(f64::NAN, |g| 0.5 * log(1.0 + g.0));
        let rest = found.filter(|s| s.len() > 2).map_or(f64::NAN, |s| {
            let rest = &s[2..];
            0.5 * log(1.0 + rest.iter().map(|g| g.0).sum::<f64>() / rest.len() as f64)
        });
        let first = get(0).map_or(f64::NAN, |g| g.1);
        let second = get(1).map_or(f64::NAN, |g| g.1);
        let name = |n: &str| format!("uwb.{kind}.{n}");
        sheet.put(at, name("first"), "ln", "evidence for the worst anchor", gain(0));
        sheet.put(at, name("second"), "ln", "for the second", gain(1));
        sheet.put(at, name("rest"), "ln", "mean of the others", rest);
        sheet.put(at, name("size"), "m", "size at the worst anchor", first);
        sheet.put(at, name("size_second"), "m", "size at the second", second);
        if let (Some((f, _)), Some(g)) = (f, get(0)) {
            anchors.push(f.ids[g.2]);
        }
    }
    let zone = f.map(|(f, rows)| zones(f, rows));
    let [first, second, spread, contrast] = zone.map_or([f64::NAN; 4], |z| z.0);
    sheet.put(at, "uwb.zone.first", "m", "largest mean residual, one anchor in one place", first);
    sheet.put(at, "uwb.zone.second", "m", "second largest", second);
    sheet.put(at, "uwb.zone.spread", "ln", "rms over anchors and places", spread);
    sheet.put(at, "uwb.zone.contrast", "m", "first minus that anchor's mean elsewhere", contrast);
    if let (Some((f, _)), Some(z)) = (f, zone) {
        anchors.push(f.ids[z.1]);
    }
    whole(f, sheet);
    noise(f, sheet);
    anchors
}

/// Sums of one window: `UᵀU`, `Uᵀr`, and `UᵀJ` of each anchor.
struct Window {
    uu: Matrix3<f64>,
    ur: Vector3<f64>,
    uj: Vec<[Vector3<f64>; COLUMNS]>,
}

/// Normal equations of one anchor, which is asked alone: lower triangle and right side.
#[derive(Clone, Copy, Default)]
struct Normal {
    jj: [[f64; COLUMNS]; COLUMNS],
    jr: [f64; COLUMNS],
}

fn scan(f: &Flight<'_>, rows: &Rows) -> Scan {
    let anchors = f.sites_E_m.len();
    let mut normal = vec![Normal::default(); anchors];
    let uj = vec![[Vector3::zeros(); COLUMNS]; anchors];
    let mut w = Window { uu: Matrix3::zeros(), ur: Vector3::zeros(), uj };
    let mut window = usize::MAX;
    for (i, m) in f.tdoa.iter().enumerate() {
        let r = rows.r_m[i];
        // Every second one is enough: neighbours share receptions.
        if i % 2 == 1 || !f.clear[m.k] || r.abs() > 1.5 {
            continue;
        }
        if m.k / WINDOW != window {
            close(&mut w, &mut normal);
            window = m.k / WINDOW;
        }
        let (h, p) = (rows.h[i], rows.p[i]);
        // Huber: an outlier must not name an anchor by itself.
        let weight = (0.25 / r.abs().max(0.25)) / (ROW_STD_M * ROW_STD_M);
        w.uu += h * h.transpose() * weight;
        w.ur += h * (r * weight);
        let t_min = f.line.t_s[m.k] / 60.0 - 0.75;
        let low = (1.0 - f.height_m[m.k] / LOW_M).clamp(0.0, 1.0);
        for (n, sign) in [(m.a, -1.0), (m.b, 1.0)] {
            let d = p - f.sites_E_m[n];
            let u = d / d.norm().max(0.05);
            let low = if -f.sites_E_m[n].z < LOW_ANCHOR_M { low } else { 0.0 };
            let x: [f64; COLUMNS] =
                [sign, -sign * u.x, -sign * u.y, -sign * u.z, sign * t_min, sign * low];
            let (normal, uj) = (&mut normal[n], &mut w.uj[n]);
            for c in 0..COLUMNS {
                let weighted = x[c] * weight;
                normal.jr[c] += weighted * r;
                uj[c] += h * weighted;
                for (sum, x) in normal.jj[c].iter_mut().zip(&x[..=c]) {
                    *sum += weighted * x;
                }
            }
        }
    }
    close(&mut w, &mut normal);
    let kinds = std::array::from_fn(|kind| {
        let range = KINDS[kind].1.clone();
        let (first, size) = (range.start, range.len());
        let mut found: Vec<_> = normal
            .iter()
            .enumerate()
            .map(|(n, normal)| {
                let mut a = vec![0.0; size * size];
                for i in 0..size {
                    for j in 0..=i {
                        a[i * size + j] = normal.jj[first + i][first + j];
                    }
                    a[i * size + i] += PRIOR[first + i].powi(-2);
                }
                let g = &normal.jr[range.clone()];
                let b = cholesky_solve(size, &a, g).unwrap_or_else(|| vec![0.0; size]);
                let gain = g.iter().zip(&b).map(|(g, b)| g * b).sum::<f64>();
                let size =
                    if size == 1 { b[0] } else { b.iter().map(|b| b * b).sum::<f64>().sqrt() };
                (gain, size, n)
            })
            .collect();
        found.sort_by(|x, y| y.0.total_cmp(&x.0));
        found
    });
    let mut scan = Scan { kinds };
    if !f.clear_points().any(|k| f.height_m[k] < LOW_M - 0.1) {
        scan.kinds[3].clear();
    }
    scan
}

/// Takes the window's free position out of the normal equations, and empties it: with `U` its columns (Schur
/// complement) `JᵀJ - JᵀU (UᵀU)⁻¹ UᵀJ` and `Jᵀr - JᵀU (UᵀU)⁻¹ Uᵀr`.
fn close(w: &mut Window, normal: &mut [Normal]) {
    let Some(inverse) = (w.uu + Matrix3::identity() * 1e-3).try_inverse() else { return };
    let shift = inverse * w.ur;
    for (normal, uj) in normal.iter_mut().zip(&mut w.uj) {
        for c in 0..COLUMNS {
            normal.jr[c] -= uj[c].dot(&shift);
            let moved = inverse * uj[c];
            for (sum, uj) in normal.jj[c].iter_mut().zip(&uj[..=c]) {
                *sum -= moved.dot(uj);
            }
        }
        *uj = [Vector3::zeros(); COLUMNS];
    }
    w.uu = Matrix3::zeros();
    w.ur = Vector3::zeros();
}

/// Voxel of the floor plan.
pub fn voxel(f: &Flight<'_>, p: &Vector3<f64>) -> usize {
    let room = &f.nominal.room;
    let cell = |x: f64, [low, high]: [f64; 2]| {
        (((x - low) / (high - low) * SIDE as f64).max(0.0) as usize).min(SIDE - 1)
    };
    cell(p.x, room.north_m) * SIDE + cell(p.y, room.east_m)
}

/// Mean residual of each anchor in each place: first, second, spread, contrast; worst anchor.
fn zones(f: &Flight<'_>, rows: &Rows) -> ([f64; 4], usize) {
    let cells = SIDE * SIDE;
    let mut sums = vec![[0.0; 2]; f.sites_E_m.len() * cells];
    for (i, m) in f.tdoa.iter().enumerate() {
        if !f.clear[m.k] || f.height_m[m.k] < 0.5 {
            continue;
        }
        let v = voxel(f, &rows.p[i]);
        let r = rows.r_m[i].clamp(-1.0, 1.0);
        for (n, sign) in [(m.a, -1.0), (m.b, 1.0)] {
            sums[n * cells + v][0] += sign * r;
            sums[n * cells + v][1] += 1.0;
        }
    }
    let mut all: Vec<(f64, usize)> = sums
        .iter()
        .enumerate()
        .filter(|(_, s)| s[1] > 100.0)
        .map(|(i, s)| (s[0] / (s[1] + 100.0), i / cells))
        .collect();
    if all.len() < 4 {
        return ([f64::NAN; 4], 0);
    }
    let rms = (all.iter().map(|m| m.0 * m.0).sum::<f64>() / all.len() as f64).sqrt();
    all.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
    let worst = all[0].1;
    let own: Vec<f64> = all[1..].iter().filter(|m| m.1 == worst).map(|m| m.0).collect();
    let elsewhere = own.iter().sum::<f64>() / own.len().max(1) as f64;
    ([all[0].0, all[1].0, log(rms), all[0].0 - elsewhere], worst)
}

/// Regressions over all pairs.
fn whole(f: Option<(&Flight<'_>, &Rows)>, sheet: &mut Sheet) {
    const NAMES: [(&str, Block, &str, &str, f64); GLOBALS] = [
        ("latency", Block::Timing, "s", "with -h·v: UWB late against IMU", 0.2),
        ("arm_x", Block::Uwb, "m", "antenna forward, turning with the body", 0.2),
        ("arm_y", Block::Uwb, "m", "antenna to the right", 0.2),
        ("arm_z", Block::Uwb, "m", "antenna down", 0.2),
        ("pattern_cos", Block::Uwb, "m", "cosine of the bearing from the nose", 0.2),
        ("pattern_sin", Block::Uwb, "m", "sine of the bearing from the nose", 0.2),
        ("distance", Block::Uwb, "1", "with the difference of distances", 0.1),
        ("low", Block::Uwb, "m", "low anchors near the floor", 0.5),
        ("latency_turn", Block::Timing, "s²", "with h·a", 0.1),
    ];
    let mut b = vec![f64::NAN; NAMES.len()];
    if let Some((f, rows)) = f {
        let x = global_regressors(f, rows);
        // What of each error would be left after the smoother had bent the position to it.
        let mut right = vec![SMatrix::<f64, 3, GLOBALS>::zeros(); f.len()];
        for ((m, x), (h, w)) in f.tdoa.iter().zip(&x).zip(rows.h.iter().zip(f.gains.weights())) {
            for (mut right, x) in right[m.k].column_iter_mut().zip(x) {
                right += h * (w * x);
            }
        }
        let moved = f.gains.respond(&right);
        let prior: Vec<f64> = NAMES.iter().map(|n| n.4).collect();
        let mut fit = Ridge::new(&prior, 1.0);
        for (i, (m, x)) in f.tdoa.iter().zip(&x).enumerate() {
            // Every second one is enough: neighbours share receptions.
            if i % 2 == 1 || !f.clear[m.k] {
                continue;
            }
            let moved = &moved[m.k];
            let left: [f64; GLOBALS] =
                std::array::from_fn(|j| x[j] - rows.h[i].dot(&moved.column(j)));
            fit.row(&left, rows.r_m[i].clamp(-0.6, 0.6));
        }
        b = fit.solve();
        if !f.clear_points().any(|k| f.height_m[k] < LOW_M - 0.1) {
            b[7] = f64::NAN;
        }
    }
    for ((name, block, unit, meaning, _), value) in NAMES.iter().zip(b) {
        sheet.put((*block, Channel::Uwb), format!("uwb.{name}"), unit, meaning, value);
    }
}

/// Number of errors that concern all pairs.
const GLOBALS: usize = 9;

/// How much each of them adds to each TDOA, per unit.
fn global_regressors(f: &Flight<'_>, rows: &Rows) -> Vec<[f64; GLOBALS]> {
    let mut last = usize::MAX;
    let mut R = Matrix3::identity();
    let mut acc = Vector3::zeros();
    let (mut sin, mut cos) = (0.0, 1.0);
    let site = |n: usize| f.sites_E_m[n];
    f.tdoa
        .iter()
        .enumerate()
        .map(|(i, m)| {
            if m.k != last {
                last = m.k;
                let turn = nalgebra::UnitQuaternion::from_axis_angle(
                    &Vector3::z_axis(),
                    f.states[m.k].north_rad,
                );
                R = *(turn * f.line.board[m.k]).to_rotation_matrix().matrix();
                (sin, cos) = f.yaw_rad[m.k].sin_cos();
                let (lo, hi) = (m.k.saturating_sub(2), (m.k + 2).min(f.len() - 1));
                acc = (f.states[hi].vel_E_mps - f.states[lo].vel_E_mps)
                    / ((hi - lo).max(1) as f64 * STEP_S);
            }
            let (h, p) = (rows.h[i], rows.p[i]);
            let (da, db) = (site(m.a) - p, site(m.b) - p);
            let bearing = |d: &Vector3<f64>| {
                let flat = d.xy().norm().max(0.05);
                ((cos * d.x + sin * d.y) / flat, (cos * d.y - sin * d.x) / flat)
            };
            let ((ca, sa), (cb, sb)) = (bearing(&da), bearing(&db));
            let low = (1.0 - f.height_m[m.k] / LOW_M).clamp(0.0, 1.0);
            let is_low = |n: usize| f64::from(u8::from(-site(n).z < LOW_ANCHOR_M));
            let arm = R.tr_mul(&h);
            [
                -h.dot(&f.states[m.k].vel_E_mps),
                arm.x,
                arm.y,
                arm.z,
                cb - ca,
                sb - sa,
                db.norm() - da.norm(),
                low * (is_low(m.b) - is_low(m.a)),
                h.dot(&acc),
            ]
        })
        .collect()
}

/// Spread, tails and clustering.
fn noise(f: Option<(&Flight<'_>, &Rows)>, sheet: &mut Sheet) {
    let mut v = [f64::NAN; 14];
    if let Some((f, rows)) = f {
        let anchors = f.sites_E_m.len();
        // In the air, and of those near the floor; gathered once, for moments go twice through what they are given.
        let mut clear = Vec::with_capacity(rows.r_m.len());
        let mut below = Vec::new();
        for (m, r) in f.tdoa.iter().zip(&rows.r_m).filter(|(m, _)| f.clear[m.k]) {
            clear.push(*r);
            if f.height_m[m.k] < LOW_M {
                below.push(*r);
            }
        }
        let all = moments(clear.iter().copied());
        let low = moments(below.iter().copied());
        // White part: change between two measurements of one pair in short order.
        let mut last = vec![(f64::NAN, 0usize); anchors * anchors];
        let mut steps = Vec::with_capacity(clear.len());
        let mut by_anchor = vec![[0.0; 2]; anchors];
        let mut outliers = vec![[0.0; 2]; f.len() / WINDOW + 1];
        let (mut wild, mut count) = (0.0f64, 0.0f64);
        for (m, r) in f.tdoa.iter().zip(&rows.r_m).filter(|(m, _)| f.clear[m.k]) {
            let r = *r;
            let (was, k) = std::mem::replace(&mut last[m.a * anchors + m.b], (r, m.k));
            if was.is_finite() && m.k - k < 6 {
                let step = (r - was) * std::f64::consts::FRAC_1_SQRT_2;
                steps.push(step);
                if step.abs() < 1.0 {
                    for n in [m.a, m.b] {
                        by_anchor[n][0] += step * step;
                        by_anchor[n][1] += 1.0;
                    }
                }
            }
            let far = f64::from(u8::from(r.abs() > OUTLIER_M));
            outliers[m.k / WINDOW][0] += far;
            outliers[m.k / WINDOW][1] += 1.0;
            (wild, count) = (wild + far, count + 1.0);
        }
        let white = moments(steps.iter().copied());
        let inner = moments(steps.iter().copied().filter(|s| s.abs() < 0.3));
        let mut stds: Vec<f64> =
            by_anchor.iter().filter(|s| s[1] > 50.0).map(|s| 0.5 * log(s[0] / s[1])).collect();
        stds.sort_by(f64::total_cmp);
        let uneven = match stds.len() {
            0..3 => f64::NAN,
            n => stds[n - 1] - stds[n / 2],
        };
        let mut shares: Vec<f64> =
            outliers.iter().filter(|s| s[1] > 0.0).map(|s| s[0] / s[1]).collect();
        shares.sort_by(f64::total_cmp);
        let worst = shares.last().copied().unwrap_or(f64::NAN);
        let bursts = shares.iter().filter(|s| **s > 0.1).count() as f64;
        // Of the flight alone, as the TDOA on the grid are.
        let flown = |r: &&haltere_core::topics::UwbRecord| f.line.place(r.tdoa.valid_at).is_some();
        let fused = f.trace.uwb.iter().filter(flown).filter(|r| r.fused).count() as f64;
        // In the air: how long it stood on the floor before, where nothing moves, is no effect.
        let clear = |r: &&haltere_core::topics::UwbRecord| {
            f.line.place(r.tdoa.valid_at).is_some_and(|p| f.clear[p.0])
        };
        let nis = |r: &haltere_core::topics::UwbRecord| {
            log((r.innovation_m.powi(2) / r.var_innovation_m2.max(1e-9)).min(50.0) + 0.1)
        };
        let nis: Vec<f64> = f.trace.uwb.iter().filter(clear).step_by(4).map(nis).collect();
        let nis = moments(nis.into_iter());
        let span_s = f.len() as f64 * STEP_S;
        v = [
            log(all.std),
            log(white.std),
            log(inner.std),
            log(white.excess.max(0.0) + 1.0),
            log(all.most),
            log(wild / count.max(1.0) + 3e-3),
            log(worst + 0.05),
            log(bursts + 1.0),
            uneven,
            if low.count > 200 { log(low.std) - log(all.std) } else { f64::NAN },
            if low.count > 200 { low.skew } else { f64::NAN },
            log(f.tdoa.len() as f64 / span_s),
            log(1.0 - (fused / f.tdoa.len().max(1) as f64).min(1.0) + 1e-4),
            nis.mean,
        ];
    }
    // Counts come in whole numbers, and most flights count none: one measurement more is no difference.
    let names = [
        ("std", "ln", "spread"),
        ("white", "ln", "spread of its white part"),
        ("inner", "ln", "the same without tails"),
        ("tails", "ln", "excess kurtosis of the white part, plus one"),
        ("most", "ln", "largest"),
        ("wild", "ln", "share of outliers"),
        ("worst", "ln", "largest share in half a second"),
        ("bursts", "ln", "half seconds with many outliers"),
        ("uneven", "ln", "white part of the worst anchor over the median"),
        ("low_std", "ln", "spread near the floor over that of all"),
        ("low_skew", "1", "skewness near the floor"),
        ("rate", "ln", "TDOA per second"),
        ("rejected", "ln", "share that the pilot's filter rejected"),
        ("nis", "ln", "normalised innovation of the pilot's filter"),
    ];
    for ((name, unit, meaning), value) in names.into_iter().zip(v) {
        sheet.put((Block::Uwb, Channel::Uwb), format!("uwb.{name}"), unit, meaning, value);
        sheet.resolved_to(match name {
            // Sampling error of a kurtosis, √(24/n), of 15 000 steps.
            "tails" => 0.04,
            // One outlier among 3500 measurements, and among the 100 of half a second.
            "wild" => 0.1,
            "worst" => 0.2,
            // One half second.
            "bursts" => std::f64::consts::LN_2,
            _ => 0.0,
        });
    }
}
