//! Checks of values that come from outside: every refusal names key, value, allowed range, unit.

pub mod schema;

use std::fmt::{Display, Write as _};
use std::ops::RangeInclusive;

/// A number as people write it: what was reckoned with is off in its sixteenth digit and prints as 25.200000000000003, what
/// came as a float of 32 bits in its eighth.
pub fn shown(value: f64) -> f64 {
    let single = value as f32;
    let is_single = f64::from(single) == value;
    let text = if is_single { single.to_string() } else { format!("{value:.12e}") };
    text.parse().unwrap_or(value)
}

/// Collects everything that is wrong, so that a user mends a file in one go.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct Problems {
    lines: Vec<String>,
}

impl Problems {
    /// Nothing found yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// One thing that is wrong, as a whole sentence.
    pub fn one(line: impl Into<String>) -> Self {
        Self { lines: vec![line.into()] }
    }

    /// `value` must be finite and inside `allowed`.
    pub fn range(
        &mut self,
        key: impl Display,
        value: f64,
        allowed: RangeInclusive<f64>,
        unit: &str,
    ) {
        if !(value.is_finite() && allowed.contains(&value)) {
            let space = if unit.is_empty() { "" } else { " " };
            let [value, low, high] = [value, *allowed.start(), *allowed.end()].map(shown);
            self.say(format!("{key} = {value}, allowed {low} to {high}{space}{unit}"));
        }
    }

    /// Any other rule, as a whole sentence that names the key and the way out.
    pub fn say(&mut self, line: impl Into<String>) {
        self.lines.push(line.into());
    }

    /// Whether nothing was found.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// What was found.
    pub fn lines(&self) -> &[String] {
        &self.lines
    }

    /// `Err` with everything that was found.
    pub fn into_result(self) -> Result<(), Self> {
        if self.is_empty() { Ok(()) } else { Err(self) }
    }
}

impl Display for Problems {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, line) in self.lines.iter().enumerate() {
            if i > 0 {
                f.write_char('\n')?;
            }
            f.write_str(line)?;
        }
        Ok(())
    }
}

impl std::error::Error for Problems {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_numbers_are_shown_as_people_write_them() {
        for (value, says) in [
            (0.3 - 1.12, "-0.8200000000000001 is -0.82"),
            (6.0 * 4.2, "25.200000000000003 is 25.2"),
            (f64::from(0.1_f32), "0.10000000149011612 is 0.1"),
            (47.397_741_8, "47.3977418 is 47.3977418"),
            (-2.0, "-2 is -2"),
            (f64::NAN, "NaN is NaN"),
            (f64::INFINITY, "inf is inf"),
        ] {
            assert_eq!(format!("{value} is {}", shown(value)), says);
        }
        let mut problems = Problems::new();
        problems.range("limits.low_m", 0.3 - 1.12, 0.0..=6.0 * 4.2, "m");
        assert_eq!(problems.lines(), ["limits.low_m = -0.82, allowed 0 to 25.2 m"]);
    }

    #[test]
    fn prop_refusal_names_key_value_range_and_unit() {
        let mut problems = Problems::new();
        problems.range("control.tilt_limit_deg", 41.0, 5.0..=35.0, "deg");
        problems.range("control.rate", f64::NAN, 0.0..=1.0, "");
        problems.range("fine", 1.0, 0.0..=1.0, "m");
        assert_eq!(
            problems.lines(),
            [
                "control.tilt_limit_deg = 41, allowed 5 to 35 deg",
                "control.rate = NaN, allowed 0 to 1"
            ]
        );
    }
}
