//! Is the best explanation good enough, and what is left if not.

use nalgebra::DVector;

use super::library::Library;
use crate::gap::outcome::Remainder;

/// Statistics that are listed of a remainder, and their least size in sigma.
const LISTED: usize = 5;
const LEAST_LISTED: f64 = 3.0;

/// Standard normal score of a chi-square sum (Wilson & Hilferty 1931): comparable between flights
/// with another number of known statistics.
pub(super) fn score(squared: f64, freedom: usize) -> f64 {
    let k = freedom.max(1) as f64;
    let spread = 2.0 / (9.0 * k);
    ((squared.max(0.0) / k).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// What sticks out of a residual in single statistics: sigma each, unwhitened so that names mean
/// something.
pub(super) fn remainder(
    library: &Library,
    residual: &DVector<f64>,
    left: f64,
    gap: f64,
    names: &[String],
    block: String,
) -> Remainder {
    let plain = library.whitening.undo(residual);
    let mut sized: Vec<(String, f64)> = plain
        .iter()
        .zip(&library.whitening.standard.columns)
        .filter(|(v, _)| v.abs() >= LEAST_LISTED)
        .filter_map(|(v, column)| Some((names.get(*column)?.clone(), *v)))
        .collect();
    sized.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    sized.truncate(LISTED);
    let share = if gap > 0.0 { (left / gap).clamp(0.0, 1.0) } else { 0.0 };
    Remainder { share, block, statistics: sized }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_score_of_chi_square() {
        // 95 % points of chi-square, Abramowitz & Stegun table 26.8: 18.307 at 10, 124.342 at 100.
        assert!((score(18.307, 10) - 1.645).abs() < 0.02);
        assert!((score(124.342, 100) - 1.645).abs() < 0.01);
    }
}
