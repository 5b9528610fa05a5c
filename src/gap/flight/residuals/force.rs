//! FX, FY, FZ: specific force as measured minus nominal thrust and drag, body axes, m/s².
//!
//! ```text
//! r = f_imu - (D_x (v_x - w_y l), D_y (v_y + w_x l), D_z v_z - T G(h)/m)
//! ```
//! `D` minus the nominal drag rate (1/s), linear in flap rate; `l` centre of pressure above the
//! centre of mass (m); `T` nominal thrust at the lagged flap rate (N); `G` nominal ground factor.
//! The accelerometer's own bias is left in: the channel Bias shows it in another way.

use super::{Channel, Flight, LAG_KNOWN_S, Sheet};
use crate::flight::regress::{Ridge, autocorrelation, log, moments};
use haltere_core::frames::G_MPS2;
use haltere_model::effects::Block;
use nalgebra::Vector3;

/// Noise of a row, m/s², as a correlated one.
const ROW_STD: f64 = 0.6;
/// Length of the wall terms and of the ceiling term, m.
const WALL_M: f64 = 0.5;
const CEILING_M: f64 = 0.3;
/// Length of the ground term, m.
const GROUND_M: f64 = 0.25;
/// Voxels of the floor per side.
const SIDE: usize = 4;

/// Residual at every point, m/s².
pub fn residuals(f: &Flight<'_>) -> Vec<Vector3<f64>> {
    let n = f.nominal;
    let lever = n.vehicle.wings.cop_m;
    (0..f.len())
        .map(|k| {
            let (v, w, hz) = (f.vel_B_mps[k], f.line.rate_B_radps[k], f.flap_hz[k]);
            let drag = Vector3::new(
                -n.drag_per_s(0, hz) * (v.x - w.y * lever),
                -n.drag_per_s(1, hz) * (v.y + w.x * lever),
                -n.drag_per_s(2, hz) * v.z,
            );
            let lift = n.thrust_n(hz) * n.ground_factor(f.height_m[k]) / n.vehicle.body.mass_kg;
            f.line.acc_B_mps2[k] - drag + Vector3::new(0.0, 0.0, lift)
        })
        .collect()
}

const HORIZONTAL: [(&str, Block, &str, &str, f64); 18] = [
    ("x.const", Block::Imu, "m/s²", "constant along body x", 0.5),
    ("y.const", Block::Imu, "m/s²", "constant along body y", 0.5),
    ("x.thrust", Block::Imu, "m/s²", "along body x in proportion to thrust beyond hover", 0.5),
    ("y.thrust", Block::Imu, "m/s²", "along body y in proportion to thrust beyond hover", 0.5),
    ("x.time", Block::Imu, "m/s² per min", "ramp along body x", 0.5),
    ("y.time", Block::Imu, "m/s² per min", "ramp along body y", 0.5),
    ("x.drag", Block::Aerodynamics, "1", "drag along x beyond nominal, as a share", 0.5),
    ("y.drag", Block::Aerodynamics, "1", "drag along y beyond nominal, as a share", 0.5),
    ("x.speed2", Block::Aerodynamics, "1/m", "force along x with speed squared", 0.5),
    ("y.speed2", Block::Aerodynamics, "1/m", "force along y with speed squared", 0.5),
    ("wind.north", Block::Aerodynamics, "m/s", "air towards north everywhere", 0.3),
    ("wind.east", Block::Aerodynamics, "m/s", "air towards east everywhere", 0.3),
    ("wall.north", Block::Aerodynamics, "m/s²", "push off the north wall", 0.6),
    ("wall.east", Block::Aerodynamics, "m/s²", "push off the east wall", 0.6),
    ("wall.south", Block::Aerodynamics, "m/s²", "push off the south wall", 0.6),
    ("wall.west", Block::Aerodynamics, "m/s²", "push off the west wall", 0.6),
    ("x.rate", Block::Aerodynamics, "m/s", "along x with pitch rate", 0.3),
    ("y.rate", Block::Aerodynamics, "m/s", "along y with roll rate", 0.3),
];

const VERTICAL: [(&str, Block, &str, &str, f64); 9] = [
    ("z.const", Block::Thrust, "m/s²", "specific force along z beyond nominal, hover", 1.0),
    ("z.thrust", Block::Thrust, "m/s²", "with flap rate beyond hover", 5.0),
    ("z.thrust2", Block::Thrust, "m/s²", "with its square", 5.0),
    ("z.lag", Block::Thrust, "m/s² per 1/s", "with the change of flap rate", 0.5),
    ("z.drag", Block::Aerodynamics, "1/s", "drag along z beyond nominal", 1.0),
    ("z.ground", Block::Aerodynamics, "m/s²", "near the floor", 1.0),
    ("z.ceiling", Block::Aerodynamics, "m/s²", "near the ceiling", 1.0),
    ("z.time", Block::Thrust, "m/s² per min", "ramp", 0.5),
    ("z.speed2", Block::Aerodynamics, "1/m", "with horizontal speed squared", 0.3),
];

/// Writes the statistics; `None` lists them.
pub fn put(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    let mut flat = vec![f64::NAN; HORIZONTAL.len()];
    let mut up = vec![f64::NAN; VERTICAL.len()];
    let mut noise = [[f64::NAN; 5]; 3];
    let mut zones = [f64::NAN; 4];
    let mut supply = f64::NAN;
    if let Some(f) = f {
        let r = residuals(f);
        let (b, left_xy) = horizontal(f, &r);
        flat = b;
        let (b, left_z) = vertical(f, &r);
        up = b;
        let hover: Vec<bool> = (0..f.len()).map(|k| f.hovering(k)).collect();
        for axis in 0..3 {
            let left: Vec<f64> = (0..f.len())
                .map(|k| match (f.clear[k], axis) {
                    (false, _) => f64::NAN,
                    (_, 2) => left_z[k],
                    _ => left_xy[k][axis],
                })
                .collect();
            let all = moments(left.iter().copied());
            let still = moments((0..f.len()).filter(|k| hover[*k]).map(|k| left[k]));
            noise[axis] = [
                log(all.std),
                log(still.std),
                autocorrelation(&left, 10),
                autocorrelation(&left, 25),
                log(all.most),
            ];
        }
        zones = by_place(f, &left_xy);
        supply = slope_on_voltage(f, &r);
    }
    let channel = |name: &str| match name.as_bytes()[0] {
        b'x' => Channel::ForceX,
        b'y' => Channel::ForceY,
        b'z' => Channel::ForceZ,
        _ => Channel::ForceX,
    };
    for ((name, block, unit, meaning, _), value) in HORIZONTAL.iter().zip(&flat) {
        sheet.put((*block, channel(name)), format!("force.{name}"), unit, meaning, *value);
    }
    for ((name, block, unit, meaning, _), value) in VERTICAL.iter().zip(&up) {
        sheet.put((*block, channel(name)), format!("force.{name}"), unit, meaning, *value);
        if *name == "z.lag" {
            sheet.resolved_to(G_MPS2 * LAG_KNOWN_S); // thrust in proportion to flap rate
        }
    }
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let at = (Block::Aerodynamics, channel(name));
        let [std, still, r1, r2, most] = noise[axis];
        sheet.put(at, format!("force.{name}.std"), "ln", "spread of what is left", std);
        sheet.put(at, format!("force.{name}.hover_std"), "ln", "the same in hover", still);
        sheet.put(at, format!("force.{name}.corr_04"), "1", "autocorrelation at 0.4 s", r1);
        sheet.put(at, format!("force.{name}.corr_10"), "1", "autocorrelation at 1 s", r2);
        sheet.put(at, format!("force.{name}.most"), "ln", "largest of what is left", most);
    }
    let at = (Block::Aerodynamics, Channel::ForceX);
    let [most, second, spread, middle] = zones;
    sheet.put(at, "force.zone.most", "ln", "largest mean force of a voxel", most);
    sheet.put(at, "force.zone.second", "ln", "second largest", second);
    sheet.put(at, "force.zone.spread", "ln", "rms of the voxels' mean forces", spread);
    sheet.put(at, "force.zone.middle", "ln", "mean force in the middle of the room", middle);
    let at = (Block::Thrust, Channel::ForceZ);
    sheet.put(at, "force.z.voltage", "m/s² per V", "slope on voltage alone, hover", supply);
}

fn horizontal(f: &Flight<'_>, r: &[Vector3<f64>]) -> (Vec<f64>, Vec<[f64; 2]>) {
    let prior: Vec<f64> = HORIZONTAL.iter().map(|s| s.4).collect();
    let mut fit = Ridge::new(&prior, ROW_STD);
    let rows = |k: usize| -> [[f64; 18]; 2] {
        let (v, w) = (f.vel_B_mps[k], f.line.rate_B_radps[k]);
        let (sin, cos) = f.yaw_rad[k].sin_cos();
        let thrust = f.thrust_ratio(k) - 1.0;
        let t_min = f.line.t_s[k] / 60.0 - 0.75;
        let d = [f.nominal.drag_per_s(0, f.flap_hz[k]), f.nominal.drag_per_s(1, f.flap_hz[k])];
        let speed = v.xy().norm();
        let p = f.states[k].pos_E_m;
        let room = &f.nominal.room;
        let near = |d: f64| (-d.max(0.0) / WALL_M).exp();
        let (n, e) = (near(room.north_m[1] - p.x), near(room.east_m[1] - p.y));
        let (s, o) = (near(p.x - room.north_m[0]), near(p.y - room.east_m[0]));
        // Pushes off the walls, turned into body axes.
        let (nx, ny) = (-n * cos, n * sin);
        let (ex, ey) = (-e * sin, -e * cos);
        let (sx, sy) = (s * cos, -s * sin);
        let (ox, oy) = (o * sin, o * cos);
        [
            [
                1.0,
                0.0,
                thrust,
                0.0,
                t_min,
                0.0,
                -d[0] * v.x,
                0.0,
                -speed * v.x,
                0.0,
                d[0] * cos,
                d[0] * sin,
                nx,
                ex,
                sx,
                ox,
                w.y,
                0.0,
            ],
            [
                0.0,
                1.0,
                0.0,
                thrust,
                0.0,
                t_min,
                0.0,
                -d[1] * v.y,
                0.0,
                -speed * v.y,
                -d[1] * sin,
                d[1] * cos,
                ny,
                ey,
                sy,
                oy,
                0.0,
                w.x,
            ],
        ]
    };
    for k in f.clear_points() {
        let [x, y] = rows(k);
        fit.row(&x, r[k].x);
        fit.row(&y, r[k].y);
    }
    let b = fit.solve();
    let dot = |x: &[f64]| x.iter().zip(&b).map(|(x, b)| x * b).sum::<f64>();
    let left = (0..f.len())
        .map(|k| {
            let [x, y] = rows(k);
            [r[k].x - dot(&x), r[k].y - dot(&y)]
        })
        .collect();
    let mut b = b;
    let close = |d: &dyn Fn(usize) -> f64| f.clear_points().any(|k| d(k) < 1.2);
    let room = &f.nominal.room;
    let p = |k: usize| f.states[k].pos_E_m;
    for (i, visited) in [
        close(&|k| room.north_m[1] - p(k).x),
        close(&|k| room.east_m[1] - p(k).y),
        close(&|k| p(k).x - room.north_m[0]),
        close(&|k| p(k).y - room.east_m[0]),
    ]
    .into_iter()
    .enumerate()
    {
        if !visited {
            b[12 + i] = f64::NAN;
        }
    }
    (b, left)
}

fn vertical(f: &Flight<'_>, r: &[Vector3<f64>]) -> (Vec<f64>, Vec<f64>) {
    let prior: Vec<f64> = VERTICAL.iter().map(|s| s.4).collect();
    let mut fit = Ridge::new(&prior, ROW_STD);
    let room = &f.nominal.room;
    let hover_hz = f.nominal.vehicle.hover_hz();
    let row = |k: usize| -> [f64; 9] {
        let ratio = f.flap_hz[k] / hover_hz - 1.0;
        let next = f.flap_hz[(k + 1).min(f.len() - 1)];
        let change = (next - f.flap_hz[k.saturating_sub(1)])
            / (2.0 * crate::flight::timeline::STEP_S * hover_hz);
        let below_m = room.ceiling_m + f.states[k].pos_E_m.z;
        let v = f.vel_B_mps[k];
        [
            1.0,
            ratio,
            ratio * ratio,
            change,
            -v.z,
            (-f.height_m[k].max(0.0) / GROUND_M).exp(),
            (-below_m.max(0.0) / CEILING_M).exp(),
            f.line.t_s[k] / 60.0 - 0.75,
            v.xy().norm_squared(),
        ]
    };
    for k in f.clear_points() {
        fit.row(&row(k), r[k].z);
    }
    let mut b = fit.solve();
    let left = (0..f.len())
        .map(|k| r[k].z - row(k).iter().zip(&b).map(|(x, b)| x * b).sum::<f64>())
        .collect();
    if !f.clear_points().any(|k| f.height_m[k] < 0.5) {
        b[5] = f64::NAN;
    }
    if !f.clear_points().any(|k| room.ceiling_m + f.states[k].pos_E_m.z < 0.8) {
        b[6] = f64::NAN;
    }
    (b, left)
}

/// Mean force of each voxel in the Earth frame: largest, second, rms; and that of the middle.
fn by_place(f: &Flight<'_>, left: &[[f64; 2]]) -> [f64; 4] {
    let mut sums = [[0.0; 3]; SIDE * SIDE];
    let mut middle = [0.0; 3];
    let room = &f.nominal.room;
    let cell = |x: f64, [low, high]: [f64; 2]| {
        (((x - low) / (high - low) * SIDE as f64).max(0.0) as usize).min(SIDE - 1)
    };
    for k in f.clear_points() {
        let (sin, cos) = f.yaw_rad[k].sin_cos();
        let [x, y] = left[k];
        let force = [cos * x - sin * y, sin * x + cos * y, 1.0];
        let p = f.states[k].pos_E_m;
        let i = cell(p.x, room.north_m) * SIDE + cell(p.y, room.east_m);
        let mid_n = p.x - 0.5 * (room.north_m[0] + room.north_m[1]);
        let mid_e = p.y - 0.5 * (room.east_m[0] + room.east_m[1]);
        for c in 0..3 {
            sums[i][c] += force[c];
            if mid_n.hypot(mid_e) < 0.7 {
                middle[c] += force[c];
            }
        }
    }
    let mean = |s: &[f64; 3]| s[0].hypot(s[1]) / (s[2] + 15.0);
    let mut all: Vec<f64> = sums.iter().filter(|s| s[2] > 25.0).map(mean).collect();
    if all.len() < 2 {
        return [f64::NAN; 4];
    }
    let rms = (all.iter().map(|m| m * m).sum::<f64>() / all.len() as f64).sqrt();
    all.sort_by(|a, b| b.total_cmp(a));
    let middle = if middle[2] > 50.0 { log(mean(&middle)) } else { f64::NAN };
    [log(all[0]), log(all[1]), log(rms), middle]
}

fn slope_on_voltage(f: &Flight<'_>, r: &[Vector3<f64>]) -> f64 {
    let points: Vec<usize> =
        f.clear_points().filter(|k| f.hovering(*k) && f.height_m[*k] > 0.6).collect();
    if points.len() < 100 {
        return f64::NAN;
    }
    let n = points.len() as f64;
    let mean = points.iter().map(|k| f.line.supply_v[*k]).sum::<f64>() / n;
    let mut fit = Ridge::new(&[3.0, 3.0], ROW_STD);
    for k in points {
        fit.row(&[1.0, f.line.supply_v[k] - mean], r[k].z);
    }
    fit.solve()[1]
}
