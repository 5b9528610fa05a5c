//! How fast to sink in the last part of a landing.
//!
//! The speed that the filter states is off by more than the sinking speed now and then: near the floor
//! its UWB counts for little, and an accelerometer that is 0.1 m/s² off is a speed by and by. A vehicle
//! that follows it alone hovers over the floor for minutes (two of 400 flights in turbulence, with UWB twice as noisy). The
//! height cannot run away like that: where it stays behind what was meant to be sunk, more speed is asked for.

/// Lag that is left alone, m: the noise of the height near the floor.
const FREE_LAG_M: f64 = 0.3;
/// Speed for a lag beyond that, 1/s: made up for in two seconds.
const PER_S: f64 = 0.5;
/// Most that is added, as a share of the sinking speed: below twice that speed, from which on it counts as
/// falling (`supervise.rs`).
const MOST_SHARE: f64 = 0.8;

/// The height that was meant to be reached.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct LandingRamp {
    due_m: Option<f64>,
}

impl LandingRamp {
    /// Not in that part of a landing.
    pub fn rest(&mut self) {
        self.due_m = None;
    }

    /// Speed to sink with, m/s, at a height, m, after a step of `dt_s`; `usual_mps` where nothing is amiss.
    pub fn sink_mps(&mut self, height_m: f64, usual_mps: f64, dt_s: f64) -> f64 {
        let due_m = self.due_m.get_or_insert(height_m);
        // Who is ahead has no time to lose again.
        *due_m = (*due_m - usual_mps * dt_s).min(height_m);
        let lag_m = (height_m - *due_m - FREE_LAG_M).max(0.0);
        usual_mps + (PER_S * lag_m).min(MOST_SHARE * usual_mps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_landing_that_goes_as_meant_is_left_alone() {
        let mut ramp = LandingRamp::default();
        for step in 0..400 {
            // 0.25 m/s and noise of 0.1 m.
            let noise_m = if step % 2 == 0 { 0.1 } else { -0.1 };
            let height_m = 0.6 - 0.0025 * f64::from(step) + noise_m;
            assert_eq!(ramp.sink_mps(height_m, 0.25, 0.01), 0.25);
        }
    }

    #[test]
    fn prop_one_that_hovers_is_asked_for_more_but_never_to_fall() {
        let mut ramp = LandingRamp::default();
        let mut last_mps = 0.0;
        for _ in 0..1000 {
            let sink_mps = ramp.sink_mps(0.3, 0.25, 0.01);
            assert!(sink_mps >= last_mps);
            last_mps = sink_mps;
        }
        assert!((last_mps - 0.45).abs() < 1e-12, "{last_mps}");
        ramp.rest();
        assert_eq!(ramp.sink_mps(0.3, 0.25, 0.01), 0.25);
    }
}
