//! Cells: mean residual by channel and regime, time window, place and anchor, with the number of
//! independent samples behind it. Which cells there are, and their order, is fixed; a cell that was
//! not visited has no mean.

use crate::flight::residuals::{Channel, Flight, attitude, battery, force, uwb};
use crate::flight::timeline::STEP_S;
use haltere_core::measure::AnchorId;

/// When the vehicle is in which state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[allow(missing_docs)] // the names are the meaning
pub enum Regime {
    Hover,
    Accelerate,
    Cruise,
    Fast,
    Climb,
    Descend,
    NearGround,
    MiddleHeight,
    NearCeiling,
    NearWall,
    Yawing,
    FacingNorth,
    FacingEast,
    FacingSouth,
    FacingWest,
    HighThrottle,
    FullBattery,
    LowBattery,
}

impl Regime {
    /// What a column of regimes is about: height, speed, voltage, yaw or place.
    pub fn kind(self) -> &'static str {
        match self {
            Regime::Hover | Regime::Accelerate | Regime::Cruise | Regime::Fast => "speed",
            Regime::Climb | Regime::Descend => "speed",
            Regime::NearGround | Regime::MiddleHeight | Regime::NearCeiling => "height",
            Regime::NearWall => "place",
            Regime::Yawing | Regime::FacingNorth | Regime::FacingEast => "yaw",
            Regime::FacingSouth | Regime::FacingWest => "yaw",
            Regime::HighThrottle | Regime::FullBattery | Regime::LowBattery => "supply",
        }
    }

    /// Limits, in words.
    pub fn words(self) -> &'static str {
        match self {
            Regime::Hover => "hover, below 0.25 m/s",
            Regime::Accelerate => "horizontal acceleration above 0.8 m/s²",
            Regime::Cruise => "steady, above 0.5 m/s",
            Regime::Fast => "above 1 m/s",
            Regime::Climb => "climb above 0.25 m/s",
            Regime::Descend => "sink above 0.25 m/s",
            Regime::NearGround => "feet below 0.5 m",
            Regime::MiddleHeight => "0.5 m to 0.8 m below the ceiling",
            Regime::NearCeiling => "0.8 m below the ceiling or less",
            Regime::NearWall => "1 m from a wall or less",
            Regime::Yawing => "turning above 0.4 rad/s",
            Regime::FacingNorth => "nose within 45° of north",
            Regime::FacingEast => "nose within 45° of east",
            Regime::FacingSouth => "nose within 45° of south",
            Regime::FacingWest => "nose within 45° of west",
            Regime::HighThrottle => "thrust above 1.15 weights",
            Regime::FullBattery => "above 3.8 V a cell",
            Regime::LowBattery => "below 3.5 V a cell",
        }
    }
}

/// All regimes.
pub const REGIMES: [Regime; 18] = [
    Regime::Hover,
    Regime::Accelerate,
    Regime::Cruise,
    Regime::Fast,
    Regime::Climb,
    Regime::Descend,
    Regime::NearGround,
    Regime::MiddleHeight,
    Regime::NearCeiling,
    Regime::NearWall,
    Regime::Yawing,
    Regime::FacingNorth,
    Regime::FacingEast,
    Regime::FacingSouth,
    Regime::FacingWest,
    Regime::HighThrottle,
    Regime::FullBattery,
    Regime::LowBattery,
];

/// Part of the flight that a cell looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub enum Part {
    /// A regime.
    Regime(Regime),
    /// One of eight equal spans of time.
    Window(u8),
    /// A voxel of the floor plan, row by row from the south-west corner.
    Voxel(u8),
    /// All pairs with an anchor, signed.
    Anchor(#[serde(serialize_with = "anchor_number")] AnchorId),
}

fn anchor_number<S: serde::Serializer>(id: &AnchorId, s: S) -> Result<S::Ok, S::Error> {
    s.serialize_u8(id.0)
}

/// One cell.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Cell {
    /// Of what.
    pub channel: Channel,
    /// Where or when.
    pub part: Part,
    /// Mean residual, unit of the channel; NaN: not visited.
    pub mean: f64,
    /// Root mean square.
    pub rms: f64,
    /// Effective number of independent samples.
    pub n_eff: f64,
}

/// Windows of time.
pub const WINDOWS: usize = 8;
/// Distance of the feet to the ceiling that counts as near it, m: a vehicle of 0.3 m below an effect
/// of 0.3 m length.
const CEILING_M: f64 = 0.8;
/// Fewest points of a cell: half a second.
const LEAST_POINTS: usize = 12;

/// Residuals on the grid, by channel; NaN where the channel cannot say.
pub fn channels(f: &Flight<'_>, rows: &uwb::Rows) -> [(Channel, Vec<f64>); 11] {
    let nan = || vec![f64::NAN; f.len()];
    let r = force::residuals(f);
    let pick = |axis: usize| {
        (0..f.len()).map(|k| if f.clear[k] { r[k][axis] } else { f64::NAN }).collect::<Vec<_>>()
    };
    let lean = |axis: usize| {
        let r = attitude::residuals(f, axis);
        (0..f.len()).map(|k| if f.clear[k] { r[k] } else { f64::NAN }).collect::<Vec<_>>()
    };
    let spread = |k: &[usize], v: &[f64]| {
        let mut out = nan();
        for (k, v) in k.iter().zip(v) {
            out[*k] = *v;
        }
        out
    };
    let b = battery::residuals(f);
    let mut uwb_rms = vec![[0.0; 2]; f.len()];
    for (m, r) in f.tdoa.iter().zip(&rows.r_m) {
        uwb_rms[m.k][0] += r.clamp(-1.0, 1.0).powi(2);
        uwb_rms[m.k][1] += 1.0;
    }
    let uwb_rms = uwb_rms
        .iter()
        .enumerate()
        .map(|(k, s)| if f.clear[k] && s[1] > 0.0 { (s[0] / s[1]).sqrt() } else { f64::NAN })
        .collect();
    [
        (Channel::ForceX, pick(0)),
        (Channel::ForceY, pick(1)),
        (Channel::ForceZ, pick(2)),
        (Channel::AttitudeRoll, lean(0)),
        (Channel::AttitudePitch, lean(1)),
        (Channel::Yaw, lean(2)),
        (Channel::Gyro, attitude::gyro_residuals(f, 2)),
        (Channel::Battery, spread(&b.k, &b.volt)),
        (Channel::Current, spread(&b.k, &b.current)),
        (Channel::Uwb, uwb_rms),
        (
            Channel::Bias,
            (0..f.len())
                .map(|k| if f.clear[k] { f.states[k].bias_B_mps2.xy().norm() } else { f64::NAN })
                .collect(),
        ),
    ]
}

/// Cells of a flight with these channels.
pub fn cells(f: &Flight<'_>, rows: &uwb::Rows, channels: &[(Channel, Vec<f64>)]) -> Vec<Cell> {
    let regimes: Vec<[bool; REGIMES.len()]> = (0..f.len()).map(|k| regimes(f, k)).collect();
    let (first, last) = (
        f.clear.iter().position(|c| *c).unwrap_or(0),
        f.clear.iter().rposition(|c| *c).unwrap_or(0),
    );
    let window =
        |k: usize| (k.saturating_sub(first) * WINDOWS / (last - first + 1)).min(WINDOWS - 1);
    let voxels: Vec<usize> = f.states.iter().map(|s| uwb::voxel(f, &s.pos_E_m)).collect();
    let mut out = Vec::new();
    for (channel, values) in channels {
        let tau = correlated_points(values);
        let mut cell = |part: Part, is_in: &dyn Fn(usize) -> bool| {
            out.push(mean(*channel, part, values, tau, is_in));
        };
        for (i, regime) in REGIMES.into_iter().enumerate() {
            cell(Part::Regime(regime), &|k| regimes[k][i]);
        }
        for w in 0..WINDOWS {
            cell(Part::Window(w as u8), &|k| window(k) == w);
        }
        for v in 0..uwb::SIDE * uwb::SIDE {
            cell(Part::Voxel(v as u8), &|k| voxels[k] == v);
        }
    }
    for (n, id) in f.ids.iter().enumerate() {
        let (mut sum, mut square, mut count) = (0.0, 0.0, 0usize);
        for (m, r) in f.tdoa.iter().zip(&rows.r_m) {
            if f.clear[m.k] && (m.a == n || m.b == n) {
                let r = if m.b == n { r.clamp(-1.0, 1.0) } else { -r.clamp(-1.0, 1.0) };
                (sum, square, count) = (sum + r, square + r * r, count + 1);
            }
        }
        let c = count as f64;
        let visited = count > 50;
        out.push(Cell {
            channel: Channel::Uwb,
            part: Part::Anchor(*id),
            mean: if visited { sum / c } else { f64::NAN },
            rms: if visited { (square / c).sqrt() } else { f64::NAN },
            // Biases of place last about a metre: a second at the speeds of these flights.
            n_eff: c.min(f.len() as f64 * STEP_S),
        });
    }
    out
}

fn regimes(f: &Flight<'_>, k: usize) -> [bool; REGIMES.len()] {
    let (lo, hi) = (k.saturating_sub(3), (k + 3).min(f.len() - 1));
    let v = f.states[k].vel_E_mps;
    let a = (f.states[hi].vel_E_mps - f.states[lo].vel_E_mps) / ((hi - lo).max(1) as f64 * STEP_S);
    let p = f.states[k].pos_E_m;
    let room = &f.nominal.room;
    let wall =
        [room.north_m[1] - p.x, p.x - room.north_m[0], room.east_m[1] - p.y, p.y - room.east_m[0]];
    let speed = v.xy().norm();
    let fast = a.xy().norm() > 0.8;
    let per_cell_v = f.line.supply_v[k] / f.nominal.vehicle.battery.cells;
    // Quarter of the compass that the nose is in, 0 north, clockwise.
    let quarter = (f.yaw_rad[k] / std::f64::consts::FRAC_PI_2).round().rem_euclid(4.0) as u8;
    let under_ceiling_m = room.ceiling_m - f.height_m[k];
    [
        v.norm() < 0.25,
        fast,
        speed > 0.5 && !fast,
        speed > 1.0,
        v.z < -0.25,
        v.z > 0.25,
        f.height_m[k] < 0.5,
        f.height_m[k] >= 0.5 && under_ceiling_m > CEILING_M,
        under_ceiling_m <= CEILING_M,
        wall.into_iter().fold(f64::INFINITY, f64::min) < 1.0,
        f.line.rate_B_radps[k].z.abs() > 0.4,
        quarter == 0,
        quarter == 1,
        quarter == 2,
        quarter == 3,
        f.thrust_ratio(k) > 1.15,
        per_cell_v > 3.8,
        per_cell_v < 3.5,
    ]
}

/// Points until a series forgets itself: `1 + 2 Σ ρ` over half a minute at most.
fn correlated_points(values: &[f64]) -> f64 {
    let mut tau = 1.0;
    for lag in [2usize, 5, 10, 20, 40, 80, 160, 320] {
        let rho = crate::flight::regress::autocorrelation(values, lag);
        if rho.is_nan() || rho <= 0.05 {
            break;
        }
        tau += rho * lag as f64;
    }
    tau
}

fn mean(
    channel: Channel,
    part: Part,
    values: &[f64],
    tau: f64,
    is_in: &dyn Fn(usize) -> bool,
) -> Cell {
    let (mut sum, mut square, mut count) = (0.0, 0.0, 0usize);
    for (k, v) in values.iter().enumerate() {
        if v.is_finite() && is_in(k) {
            (sum, square, count) = (sum + v, square + v * v, count + 1);
        }
    }
    let n = count as f64;
    // The battery talks at 10 Hz.
    let least =
        if channel == Channel::Battery || channel == Channel::Current { 5 } else { LEAST_POINTS };
    if count < least {
        return Cell { channel, part, mean: f64::NAN, rms: f64::NAN, n_eff: 0.0 };
    }
    Cell { channel, part, mean: sum / n, rms: (square / n).sqrt(), n_eff: (n / tau).max(1.0) }
}
