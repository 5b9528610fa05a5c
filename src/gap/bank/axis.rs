//! What one parameter of an effect ranges over in a bank, and how far a value of it is from "no effect".

use serde::{Deserialize, Serialize};

/// Most choices: more anchors than a room has.
const MOST_CHOICES: f64 = 32.0;

/// How the size of an effect follows from a value: none at 0, and twice the size deviates about twice as far.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Size {
    /// The distance to this value, in the parameter's unit.
    From(f64),
    /// A limit or a scale that bends a law, "off" at infinity: one over the value.
    Inverse,
}

/// Range of one parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// Least value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
    /// A choice of one of some, as an anchor is: nothing lies between two of them, and the next one is no nearer than the last.
    pub choice: bool,
    /// Absent: it says where, which way or on what, and not how much.
    pub size: Option<Size>,
}

impl Axis {
    /// What values of unknown origin range over: choices where all are whole and some differ. They tell nothing of sizes.
    pub fn over(values: impl Iterator<Item = f64> + Clone) -> Self {
        let ends = (f64::INFINITY, f64::NEG_INFINITY);
        let (low, high) = values.clone().fold(ends, |(a, b), v| (a.min(v), b.max(v)));
        let whole = high > low && values.clone().all(|v| v.fract() == 0.0);
        Self { low, high, choice: whole && high - low < MOST_CHOICES, size: None }
    }

    /// Whether it is a range at all, and one of choices has few of them.
    pub fn is_sound(&self) -> bool {
        let width = self.high - self.low;
        width.is_finite() && width >= 0.0 && (!self.choice || width < MOST_CHOICES)
    }

    /// Wide enough for this value too.
    pub fn with(self, value: f64) -> Self {
        Self { low: self.low.min(value), high: self.high.max(value), ..self }
    }

    /// Whether "no effect" lies between these values; `None`: not a size, or none that ends.
    pub fn holds_off(&self, [low, high]: [f64; 2]) -> Option<bool> {
        match self.size? {
            Size::From(off) => Some(low <= off && off <= high),
            Size::Inverse => None,
        }
    }

    /// Size at a value as a share of the largest one on the axis; `None`: not a size, or the same everywhere.
    pub fn share(&self, value: f64) -> Option<f64> {
        let size = self.size.filter(|_| self.high > self.low)?;
        let of = |value: f64| match size {
            Size::From(off) => (value - off).abs(),
            Size::Inverse => value.abs().recip(),
        };
        let share = of(value) / of(self.low).max(of(self.high));
        share.is_finite().then_some(share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_no_size_where_an_effect_is_off_and_all_of_it_at_its_strong_end() {
        let drag = Axis { low: -0.6, high: 0.2, choice: false, size: Some(Size::From(0.0)) };
        assert_eq!([-0.6, 0.0, 0.3].map(|v| drag.share(v)), [Some(1.0), Some(0.0), Some(0.5)]);
        let scale = Axis { low: 1.5, high: 3.0, choice: false, size: Some(Size::Inverse) };
        assert_eq!([1.5, 3.0, 6.0].map(|v| scale.share(v)), [Some(1.0), Some(0.5), Some(0.25)]);
        assert_eq!(
            [[-0.1, 0.1], [0.0, 0.1], [0.1, 0.2]].map(|ends| drag.holds_off(ends)),
            [Some(true), Some(true), Some(false)]
        );
        assert_eq!(scale.holds_off([1.5, 3.0]), None);
        let same = Axis { high: -0.6, ..drag };
        assert_eq!(same.share(-0.6), None);
        assert_eq!(scale.with(6.0).high, 6.0);
    }

    #[test]
    fn prop_values_of_unknown_origin_are_choices_when_all_are_whole() {
        let over = |values: &[f64]| Axis::over(values.iter().copied());
        assert_eq!(over(&[0.0, 5.0]), Axis { low: 0.0, high: 5.0, choice: true, size: None });
        assert!(!over(&[0.0, 5.5]).choice && !over(&[2.0, 2.0]).choice);
        assert!(!over(&[0.0, 1e6]).choice);
    }

    #[test]
    fn prop_only_ranges_are_sound() {
        let axis = |low, high, choice| Axis { low, high, choice, size: None }.is_sound();
        assert!(axis(-1.0, 2.0, false) && axis(3.0, 3.0, false) && axis(0.0, 7.0, true));
        assert!(!axis(2.0, -1.0, false) && !axis(f64::NEG_INFINITY, 1.0, false));
        assert!(!axis(0.0, 1e6, true) && !axis(f64::NAN, 1.0, false));
    }
}
