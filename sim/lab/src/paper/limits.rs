//! What limits of the vehicle, and of the law with its gains, leave of an error after a step at best: no controller, or none
//! with these gains, comes below.

use haltere_core::control::ControlConfig;
use haltere_core::control::voltage::BaseThrust;
use haltere_core::frames::G_MPS2;

use super::results::Spread;
use super::table_3::{Cell, Flown, Quantity};
use crate::steps::SIZES_M;

/// The least that a cell of `modified` can be: by the limits of the vehicle, and by the law with these gains. What is left
/// of the error at rest counts in both: there and back it adds on one way what it takes off on the other, so that |error|
/// is at least the larger of the two.
pub fn limits(
    control: &ControlConfig,
    modified: &[Flown],
    cell: Cell,
    window_s: f64,
) -> [(String, f64); 2] {
    let (limits, gains) = (&control.limits, &control.gains);
    let [up, down] = accelerations(control, cell.axis);
    let way_m = SIZES_M[cell.size];
    let rest = Spread::of(modified.iter().map(|f| f.of(cell).rest)).mean;
    let over = |errors: &[f64]| {
        let moving: f64 = errors.iter().map(|e| e.max(rest) * FINE_S).sum();
        (moving + rest * (window_s - errors.len() as f64 * FINE_S).max(0.0)) / window_s
    };
    let gain = [gains.pos_x_p_per_s, gains.pos_y_p_per_s, gains.pos_z_p_per_s][cell.axis];
    let most = if cell.axis < 2 { limits.horizontal_mps } else { limits.vertical_mps };
    let law = |a: f64| over(&by_law(gain, most, a, way_m)[cell.of as usize]);
    let by_law = 0.5 * (law(up) + law(down));
    let hard = match cell.of {
        Quantity::Position => {
            0.5 * (over(&fastest_m([up, down], way_m)) + over(&fastest_m([down, up], way_m)))
        }
        Quantity::Velocity => by_law,
    };
    let what = if cell.axis < 2 { "tilt limit" } else { "full and least thrust" };
    let unit = cell.of.unit();
    [
        (format!("{what}, and {rest:.3} {unit} left at rest"), hard),
        (
            format!(
                "a position gain of {gain} 1/s at the {what}, and {rest:.3} {unit} left at rest"
            ),
            by_law,
        ),
    ]
}

/// Greatest acceleration either way along an axis, m/s²: towards +, and towards −.
///
/// z: a = g(T_max/T_hover − 1) up, g(1 − T_min/T_hover) down. x, y: g·tan of the tilt limit, thrust holding the weight.
fn accelerations(control: &ControlConfig, axis: usize) -> [f64; 2] {
    if axis < 2 {
        return [G_MPS2 * control.limits.tilt_deg.to_radians().tan(); 2];
    }
    let hover = BaseThrust::new(&control.voltage).at_frac(FULLEST_V);
    [
        G_MPS2 * (control.limits.thrust_max_frac / hover - 1.0),
        G_MPS2 * (1.0 - control.limits.thrust_min_frac / hover),
    ]
}

/// What is left of a way from rest to rest, m, every [`FINE_S`], as no controller can be faster.
///
/// Forward with a₁ for t₁, then braking with a₂ for t₂ = t₁a₁/a₂, where ½a₁t₁² + ½a₂t₂² is the way. Lag, drag and limits
/// of speed left out: they only add to it.
fn fastest_m([forward, brake]: [f64; 2], way_m: f64) -> Vec<f64> {
    let t_1 = (2.0 * way_m * brake / (forward * (forward + brake))).sqrt();
    let end = t_1 * (1.0 + forward / brake);
    (0..)
        .map(|i| f64::from(i) * FINE_S)
        .take_while(|t| *t < end)
        .map(
            |t| {
                if t < t_1 {
                    way_m - 0.5 * forward * t * t
                } else {
                    0.5 * brake * (end - t).powi(2)
                }
            },
        )
        .collect()
}

/// What is left of a way, m, and how far the velocity is behind its setpoint, m/s, every [`FINE_S`], as the position loop
/// has it at best: its setpoint is gain times what is left, limited; the vehicle comes up to it with its greatest
/// acceleration and is on it from there on.
fn by_law(gain_per_s: f64, most_mps: f64, acceleration: f64, way_m: f64) -> [Vec<f64>; 2] {
    let (mut left_m, mut v) = (way_m, 0.0f64);
    let mut out = [Vec::new(), Vec::new()];
    while left_m > NOTHING_LEFT * way_m {
        let wanted = (gain_per_s * left_m).min(most_mps);
        out[0].push(left_m);
        out[1].push((wanted - v).max(0.0));
        v = (v + acceleration * FINE_S).min(wanted);
        left_m -= v * FINE_S;
    }
    out
}

/// Mean absolute error and standard deviation of the height over a window that begins with a step there or back, at best:
/// with full and least thrust, and with what is left at rest, m.
pub fn least_height_m(control: &ControlConfig, way_m: f64, window_s: f64, rest_m: f64) -> [f64; 2] {
    let [up, down] = accelerations(control, 2);
    let both = [[up, down], [down, up]].map(|a| {
        let left = fastest_m(a, way_m);
        let still_s = (window_s - left.len() as f64 * FINE_S).max(0.0);
        let mean: f64 = left.iter().map(|e| e.max(rest_m) * FINE_S).sum();
        let square: f64 = left.iter().map(|e| e * e * FINE_S).sum();
        [(mean + rest_m * still_s) / window_s, square / window_s]
    });
    [0.5 * (both[0][0] + both[1][0]), (0.5 * (both[0][1] + both[1][1])).sqrt()]
}

/// Highest voltage under load that recorded flights of this vehicle show, V: with it most thrust.
pub const FULLEST_V: f64 = 7.9;
/// Step of the calculation of limits, s, and the share of a way at which it ends.
const FINE_S: f64 = 1e-3;
const NOTHING_LEFT: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_fastest_way_there() {
        // 1 m with 4 m/s² and back: 0.5 s each, and by symmetry half the way on average.
        let left = fastest_m([4.0, 4.0], 1.0);
        let area = left.iter().sum::<f64>() * FINE_S;
        assert!((area - 0.5).abs() < 1e-3 && left.len() == 1000, "{area} {}", left.len());
    }

    #[test]
    fn val_the_law_at_best_leaves_one_over_its_gain() {
        // With no limit in the way the error falls as e^(-gain t); then the velocity is never behind for long.
        let [left, behind] = by_law(1.5, 100.0, 1e6, 1.0);
        let sum = |of: &[f64]| of.iter().sum::<f64>() * FINE_S;
        assert!((sum(&left) - 1.0 / 1.5).abs() < 2e-3, "{}", sum(&left));
        assert!(sum(&behind) < 2e-3, "{}", sum(&behind));
        // Half a metre per second for a tenth of a second, when it takes so long to 1 m/s.
        let [_, behind] = by_law(0.001, 1.0, 10.0, 1000.0);
        assert!((sum(&behind) - 0.05).abs() < 1e-3, "{}", sum(&behind));
    }
}
