//! Marks of an axis: round values, or powers of ten.

/// Round values between `low` and `high`, about `wanted` of them, with labels of equal precision.
pub(super) fn ticks(low: f64, high: f64, wanted: f64) -> Vec<(f64, String)> {
    let raw = (high - low) / wanted.max(1.0);
    let power = 10f64.powf(raw.log10().floor());
    let step =
        [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= raw * (1.0 - 1e-9));
    let step = step.unwrap_or(10.0 * power);
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let first = (low / step - 1e-9).ceil();
    let count = (high / step + 1e-9).floor() - first;
    (0..=count.clamp(0.0, 100.0) as u32)
        .map(|i| {
            let value = (first + f64::from(i)) * step;
            let value = if value.abs() < step * 1e-6 { 0.0 } else { value };
            (value, format!("{value:.decimals$}").replace('-', "\u{2212}"))
        })
        .collect()
}

/// Every power of ten between two decimal logarithms.
pub(super) fn decades(low: f64, high: f64) -> Vec<(f64, String)> {
    let powers = low.ceil().clamp(-12.0, 12.0) as i32..=high.floor().clamp(-12.0, 12.0) as i32;
    powers
        .map(|power| {
            let label = match power {
                0..=4 => format!("{}", 10_u32.pow(power.unsigned_abs())),
                -3..=-1 => format!("{:.*}", power.unsigned_abs() as usize, 10_f64.powi(power)),
                _ => format!("1e{power}").replace('-', "\u{2212}"),
            };
            (f64::from(power), label)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_ticks_are_round_and_inside() {
        let check = |low, high, wanted, labels: &[&str]| {
            let found: Vec<String> = ticks(low, high, wanted).into_iter().map(|t| t.1).collect();
            assert_eq!(found, labels);
        };
        check(-0.3, 10.2, 5.0, &["0", "5", "10"]);
        check(-0.01, 0.011, 4.0, &["\u{2212}0.01", "0.00", "0.01"]);
        check(7.0, 8.4, 7.0, &["7.0", "7.2", "7.4", "7.6", "7.8", "8.0", "8.2", "8.4"]);
    }

    #[test]
    fn prop_powers_of_ten_are_written_out_where_they_are_short() {
        let labels = |low, high| decades(low, high).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(labels(-1.5, 2.2), ["0.1", "1", "10", "100"]);
        assert_eq!(labels(4.5, 5.0), ["1e5"]);
        assert!(labels(0.2, 0.4).is_empty());
    }
}
