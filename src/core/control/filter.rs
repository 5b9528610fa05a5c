//! Small state of the loops: low-pass, derivative, integrator, glide. All take `dt_s` as argument.

/// Differences over less time than this say nothing about a rate, s: a hundredth of a period.
const MIN_DT_S: f64 = 1e-4;

/// First-order low-pass on `N` values, backward Euler: stable for any step, and for a time
/// constant of zero it passes its input on. The first input is taken over at once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowPass<const N: usize> {
    value: Option<[f64; N]>,
}

impl<const N: usize> Default for LowPass<N> {
    fn default() -> Self {
        Self { value: None }
    }
}

impl<const N: usize> LowPass<N> {
    /// Starts from `value`.
    pub fn starting_at(value: [f64; N]) -> Self {
        Self { value: Some(value) }
    }

    /// Output so far, if any input came.
    pub fn value(&self) -> Option<[f64; N]> {
        self.value
    }

    /// Takes the input of this step and gives the output.
    pub fn step(&mut self, input: [f64; N], time_constant_s: f64, dt_s: f64) -> [f64; N] {
        let output = match self.value {
            None => input,
            Some(old) => {
                let share =
                    if time_constant_s > 0.0 { dt_s / (time_constant_s + dt_s) } else { 1.0 };
                std::array::from_fn(|i| old[i] + share * (input[i] - old[i]))
            }
        };
        self.value = Some(output);
        output
    }
}

/// Low-passed rate of change of a measurement with three components.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Derivative {
    last: Option<[f64; 3]>,
    filter: LowPass<3>,
}

impl Derivative {
    /// Takes the measurement of this step; gives its rate of change per second.
    pub fn step(&mut self, input: [f64; 3], time_constant_s: f64, dt_s: f64) -> [f64; 3] {
        let rate = match self.last {
            Some(last) if dt_s >= MIN_DT_S => std::array::from_fn(|i| (input[i] - last[i]) / dt_s),
            // Too little time passed, or nothing to compare with: no news.
            _ => self.filter.value().unwrap_or([0.0; 3]),
        };
        self.last = Some(input);
        self.filter.step(rate, time_constant_s, dt_s)
    }
}

/// On which side a limit cuts the output that an integrator feeds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cut {
    /// Not cut.
    #[default]
    No,
    /// The output wanted more than the limit.
    Above,
    /// The output wanted less than the limit.
    Below,
}

impl Cut {
    /// How limiting changed a value.
    pub fn between(wanted: f64, limited: f64) -> Self {
        if wanted > limited {
            Cut::Above
        } else if wanted < limited {
            Cut::Below
        } else {
            Cut::No
        }
    }

    /// The cut seen through a change of sign.
    pub fn flipped(self) -> Self {
        match self {
            Cut::No => Cut::No,
            Cut::Above => Cut::Below,
            Cut::Below => Cut::Above,
        }
    }
}

/// Integrator with conditional anti-windup: while the output is cut it may only move back.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Integrator {
    /// Sum so far, in the unit of the output.
    pub value: f64,
}

impl Integrator {
    /// Adds `increment` unless that would push further into the cut; stays within ±`limit`.
    pub fn add(&mut self, increment: f64, cut: Cut, limit: f64) {
        let blocked = match cut {
            Cut::No => false,
            Cut::Above => increment > 0.0,
            Cut::Below => increment < 0.0,
        };
        if !blocked {
            self.value = (self.value + increment).clamp(-limit, limit);
        }
    }
}

/// An offset that makes an output go on from where it was, and then fades away.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Glide {
    offset: f64,
}

impl Glide {
    /// The output was `from`, the law now says `to`.
    pub fn start(&mut self, from: f64, to: f64) {
        self.offset = from - to;
    }

    /// Offset of this step.
    pub fn offset(&self) -> f64 {
        self.offset
    }

    /// Lets `dt_s` pass.
    pub fn fade(&mut self, time_constant_s: f64, dt_s: f64) {
        self.offset = if time_constant_s > 0.0 {
            self.offset * time_constant_s / (time_constant_s + dt_s)
        } else {
            0.0
        };
    }
}

/// `value` within ±`limit`; NaN becomes 0.
pub fn bounded(value: f64, limit: f64) -> f64 {
    if value.is_nan() { 0.0 } else { value.clamp(-limit, limit) }
}

/// The two components shortened to length `limit` without turning; the flag says whether cut.
pub fn shortened(x: f64, y: f64, limit: f64) -> (f64, f64, bool) {
    let length = x.hypot(y);
    if length > limit {
        let share = limit / length;
        (x * share, y * share, true)
    } else {
        (x, y, false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_integrator_does_not_wind_up_and_comes_back_at_once() {
        let mut i = Integrator::default();
        for _ in 0..1000 {
            i.add(0.01, Cut::Above, 1.0);
        }
        assert_eq!(i.value, 0.0);
        i.add(-0.01, Cut::Above, 1.0);
        assert_eq!(i.value, -0.01);
        for _ in 0..1000 {
            i.add(0.01, Cut::No, 1.0);
        }
        assert_eq!(i.value, 1.0);
    }

    #[test]
    fn prop_shortening_keeps_the_direction() {
        let (x, y, cut) = shortened(3.0, -4.0, 2.0);
        assert!(cut && (x - 1.2).abs() < 1e-12 && (y + 1.6).abs() < 1e-12);
        assert_eq!(shortened(0.3, 0.4, 0.5), (0.3, 0.4, false));
    }

    #[test]
    fn prop_derivative_of_a_ramp_is_its_slope_after_the_filter() {
        let mut d = Derivative::default();
        let mut out = [0.0; 3];
        for i in 0..200 {
            let t = f64::from(i) * 0.01;
            out = d.step([2.0 * t, -t, 0.0], 0.05, 0.01);
        }
        assert!((out[0] - 2.0).abs() < 1e-9 && (out[1] + 1.0).abs() < 1e-9 && out[2] == 0.0);
        // A step without time gives no spike.
        assert_eq!(d.step([100.0, 0.0, 0.0], 0.05, 0.0), out);
    }

    #[test]
    fn prop_glide_starts_at_the_old_output_and_fades() {
        let mut g = Glide::default();
        g.start(1.5, 0.5);
        assert_eq!(0.5 + g.offset(), 1.5);
        for _ in 0..300 {
            g.fade(0.3, 0.01);
        }
        assert!(g.offset().abs() < 1e-4);
    }
}
