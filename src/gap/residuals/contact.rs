//! Visits to the floor: where it carries, nothing is said about flying.
//!
//! The low hover of the diagnostic flight is commanded 0.45 m over the floor, by an estimate that multipath
//! shifts there by some 0.2 m: of healthy simulated vehicles 5 of 60 met the floor meanwhile, in the laboratory's
//! room 16 of 40. They are held by their feet then, the throttle sinks, attitude no longer follows its setpoint,
//! and two such flights among 60 set the limit of evidence to 601, which is 26 without them. The floor shows as a
//! force upward, beyond that at greater height, for as long as it carries:
//!
//! ```text
//! N/m = median(r_z | h > reach) - mean(r_z over the window)
//! ```
//!
//! with `N` the floor's force (N), `m` the mass (kg), `h` the height of the feet (m) and `r_z` of `force.rs` (m/s²,
//! body, down). A whole visit below the reach counts: nobody knows when the feet met the floor first. **Source.**
//! Ours, a balance of forces. **Left out.** A floor that carries less than a twelfth of the weight is not told from
//! a deviation; the bank leaves such flights of healthy vehicles out by the simulator's truth (`make_bank.rs`).
//! **Known to be wrong.** An effect on thrust can look like a floor: seven of ten drawn flights with P1, five of A3,
//! four of I1, which the floor never carried, lose their low hover.

use super::{Flight, force};
use crate::gap::timeline::STEP_S;

/// Feet below this by the smoother: near the floor, m. Chosen: the low hover with 0.2 m of multipath above it.
const REACH_M: f64 = 0.65;
/// Force beyond which the floor carries, m/s², for the time of the window, s. Of 60 healthy simulated flights,
/// those that never met the floor reached 0.70, those that it carried for 0.7 s or longer 1.25 to 2.65. Chosen from
/// these: the window, ten points of the grid, makes one gust no floor.
const CARRIES_MPS2: f64 = 0.8;
const WINDOW_S: f64 = 0.4;

/// Points of visits during which the floor carried.
pub(super) fn carried(f: &Flight<'_>) -> Vec<bool> {
    let mut out = vec![false; f.len()];
    for (from, to, most_mps2) in visits(f) {
        out[from..to].fill(most_mps2 > CARRIES_MPS2);
    }
    out
}

/// Visits near the floor: first point, point behind the last, and the largest force of the floor, m/s².
fn visits(f: &Flight<'_>) -> Vec<(usize, usize, f64)> {
    let r = force::residuals(f);
    let mut high: Vec<f64> =
        f.clear_points().filter(|k| f.height_m[*k] > REACH_M).map(|k| r[k].z).collect();
    let middle = high.len() / 2;
    if high.is_empty() {
        return Vec::new();
    }
    let usual = *high.select_nth_unstable_by(middle, f64::total_cmp).1;
    let window = (WINDOW_S / STEP_S) as usize;
    let mut found = Vec::new();
    let mut from = 0;
    while from < f.len() {
        if f.height_m[from] > REACH_M {
            from += 1;
            continue;
        }
        let to = (from..f.len()).find(|k| f.height_m[*k] > REACH_M).unwrap_or(f.len());
        let force = |at: usize| {
            let sum: f64 = (at..at + window).map(|k| usual - r[k].z).sum();
            sum / window as f64
        };
        let clear = |at: &usize| (*at..at + window).all(|k| f.clear[k]);
        let most = (from..to.saturating_sub(window)).filter(clear).map(force).fold(0.0, f64::max);
        found.push((from, to, most));
        from = to;
    }
    found
}
