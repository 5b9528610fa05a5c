//! The balance of one flight: what its motors held while it hovered, as vertical force and moments.

use haltere_log::import::motors::{MotorFlight, MotorRow};
use haltere_model::rotorcraft::{MOTORS, Rotorcraft};
use nalgebra::{Matrix4, Vector4};
use serde::Serialize;

use crate::normal::median;

/// Length of a piece of the flight, s: long against the motors' lag, short against a climb.
const PIECE_S: f64 = 0.5;
/// Share of a piece's rows that must be there.
const LEAST_SHARE: f64 = 0.8;
/// Fewest pieces that say something: 5 s of hover.
const LEAST_PIECES: usize = 10;
/// Pieces lie within this of the usual height, m: above the ground's cushion and out of take-off and landing.
const BAND_M: f64 = 0.12;
/// Fastest that counts as hover, m/s: with more the air that comes in changes the thrust of the propellers.
const MOST_SPEED_MPS: f64 = 1.0;
/// Without a height: pieces whose thrust lies within this of the usual one, as a share.
const BAND_SHARE: f64 = 0.05;
/// A motor that is told less than this share of what it is usually told does not carry.
const LEAST_COMMAND: f64 = 0.1;

/// What the motors held in hover.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Hover {
    /// Name of the flight.
    pub name: String,
    /// Vertical force, roll, pitch, yaw ([`Rotorcraft::to_balance`]), of the logarithms of the thrusts, so that a difference of two
    /// flights is a share whatever the scale of the commands.
    pub balance: [f64; MOTORS],
    /// Logarithm of how much the moments that were asked for change from row to row.
    pub shake: f64,
    /// Rows a second.
    pub rate_hz: f64,
    /// Length of what was used, s.
    pub hover_s: f64,
    /// Whether pieces were chosen by height.
    pub by_height: bool,
    /// Whether what flew fast was left out.
    pub by_speed: bool,
    /// Acceleration forward, left and up, g. What hovers has none, so this is the offset of the board's accelerometer: a mark of
    /// the board, which no propeller and no load moves.
    pub offset_g: [Option<f64>; 3],
}

impl Hover {
    /// The balance of a flight, or why it has none.
    pub fn of(flight: &MotorFlight, vehicle: &Rotorcraft) -> Result<Self, String> {
        let to_balance = vehicle.to_balance().ok_or("the vehicle file holds no quadrotor")?;
        if vehicle.thrust.voltage_exponent > 0.0
            && flight.rows.iter().any(|row| row.supply_v.is_none_or(|volt| volt <= 0.0))
        {
            return Err(
                "the thrust of these motors goes with the voltage (thrust.voltage_exponent), which was not logged".into()
            );
        }
        let step_s = usual_step_s(&flight.rows).ok_or("it has no rows")?;
        let logged =
            |of: fn(&MotorRow) -> Option<f64>| flight.rows.iter().any(|row| of(row).is_some());
        let [by_height, by_speed] = [logged(|row| row.height_m), logged(|row| row.speed_mps)];
        let pieces = pieces(flight, vehicle, &to_balance, step_s);
        let within = usual_pieces(&pieces, by_height);
        if within.len() < LEAST_PIECES {
            return Err(format!(
                "it hovers {:.1} s at one height, {:.0} s are due",
                within.len() as f64 * PIECE_S,
                LEAST_PIECES as f64 * PIECE_S
            ));
        }
        let middle = |of: &dyn Fn(&Piece) -> f64| median(within.iter().map(|piece| of(piece)));
        Ok(Self {
            name: flight.name.clone(),
            balance: [0, 1, 2, 3].map(|axis| middle(&|piece| piece.balance[axis])),
            shake: 0.5 * middle(&|piece| piece.shake).max(f64::MIN_POSITIVE).ln(),
            rate_hz: 1.0 / step_s,
            hover_s: within.len() as f64 * PIECE_S,
            by_height,
            by_speed,
            offset_g: [0, 1, 2].map(|axis| {
                Some(middle(&|piece| piece.accel_g[axis])).filter(|offset| offset.is_finite())
            }),
        })
    }
}

/// Logarithms of the voltage over the nominal one and of the mean share of the full thrust, the voltage left out of account, of every piece
/// of the hover; none where it was not logged.
pub(super) fn levels(flight: &MotorFlight, vehicle: &Rotorcraft) -> Vec<[f64; 2]> {
    let mut bare = vehicle.clone();
    bare.thrust.voltage_exponent = 0.0;
    let Some((to_balance, step_s)) = bare.to_balance().zip(usual_step_s(&flight.rows)) else {
        return Vec::new();
    };
    let pieces = pieces(flight, &bare, &to_balance, step_s);
    let by_height = flight.rows.iter().any(|row| row.height_m.is_some());
    let level = |piece: &&Piece| [(piece.supply_v / bare.thrust.nominal_v).ln(), piece.balance[0]];
    let within = usual_pieces(&pieces, by_height);
    within.iter().map(level).filter(|level| level[0].is_finite()).collect()
}

/// Half a second in which all motors carry.
struct Piece {
    balance: Vector4<f64>,
    /// Mean square of the second differences of roll and pitch.
    shake: f64,
    /// Not a number where none was logged.
    height_m: f64,
    /// The same.
    supply_v: f64,
    /// The same.
    accel_g: [f64; 3],
}

fn pieces(
    flight: &MotorFlight,
    vehicle: &Rotorcraft,
    to_balance: &Matrix4<f64>,
    step_s: f64,
) -> Vec<Piece> {
    let rows = &flight.rows;
    let usual = median(rows.iter().flat_map(|row| row.command_frac).filter(|u| *u > 0.0));
    let carries = |row: &MotorRow| row.command_frac.iter().all(|u| *u > LEAST_COMMAND * usual);
    let due = (LEAST_SHARE * PIECE_S / step_s).max(3.0) as usize;
    let begin_s = rows.first().map_or(0.0, |row| row.t_s);
    let number = |row: &MotorRow| ((row.t_s - begin_s) / PIECE_S).floor();
    let whole = rows.chunk_by(|a, b| number(a) == number(b));
    let is_slow = |row: &MotorRow| row.speed_mps.is_none_or(|speed| speed < MOST_SPEED_MPS);
    let is_hover = |row: &MotorRow| carries(row) && is_slow(row);
    let whole = whole.filter(|rows| rows.len() >= due && rows.iter().all(is_hover));
    whole
        .map(|rows| {
            let n = rows.len() as f64;
            let shares: Vec<Vector4<f64>> =
                rows.iter().map(|row| to_balance * thrusts(row, vehicle).map(f64::ln)).collect();
            let mean = rows.iter().map(|row| thrusts(row, vehicle)).sum::<Vector4<f64>>() / n;
            let middle = |of: &dyn Fn(&MotorRow) -> Option<f64>| {
                rows.iter().map(|row| of(row).unwrap_or(f64::NAN)).sum::<f64>() / n
            };
            let bends = shares.windows(3).map(|of| {
                let bend = of[0] - 2.0 * of[1] + of[2];
                bend[1].powi(2) + bend[2].powi(2)
            });
            Piece {
                balance: to_balance * mean.map(f64::ln),
                shake: bends.sum::<f64>() / (n - 2.0),
                height_m: middle(&|row| row.height_m),
                supply_v: middle(&|row| row.supply_v),
                accel_g: [0, 1, 2].map(|axis| middle(&|row| row.accel_g[axis])),
            }
        })
        .collect()
}

/// Thrust of each motor, as a share of its full one.
fn thrusts(row: &MotorRow, vehicle: &Rotorcraft) -> Vector4<f64> {
    let thrust = &vehicle.thrust;
    let volt = row.supply_v.map_or(1.0, |volt| volt / thrust.nominal_v);
    let by_voltage = match thrust.voltage_exponent {
        0.0 => 1.0,
        exponent => volt.powf(exponent),
    };
    Vector4::from(row.command_frac).map(|u| u.powf(thrust.command_exponent) * by_voltage)
}

/// The pieces at the height, or else of the thrust, at which most of the flight goes on.
fn usual_pieces(pieces: &[Piece], by_height: bool) -> Vec<&Piece> {
    let of = |piece: &Piece| if by_height { piece.height_m } else { piece.balance[0] };
    let highest = pieces.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
    // Of heights those on the way up and down do not count, of thrusts all do.
    let lowest = if by_height { 0.5 * highest } else { f64::NEG_INFINITY };
    let usual = median(pieces.iter().map(of).filter(|value| *value >= lowest));
    let band = if by_height { BAND_M } else { BAND_SHARE };
    pieces.iter().filter(|piece| (of(piece) - usual).abs() < band).collect()
}

fn usual_step_s(rows: &[MotorRow]) -> Option<f64> {
    let step_s = median(rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s));
    step_s.is_finite().then_some(step_s)
}
