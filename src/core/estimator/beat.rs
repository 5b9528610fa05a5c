//! Specific force averaged over whole wing beats, the beat being tracked.
//!
//! A wing beat shakes the vehicle by some 0.8 g at 8 to 25 Hz; sampled at 100 Hz its harmonics fold
//! onto low frequencies and look like a bias. The mean over exactly one beat has none of them:
//!
//! ```text
//! ā(t) = (A(t) − A(t − T))/T,   A(t) = ∫ a dt (trapezoids between samples)
//! ```
//!
//! T is the time between upward passages of `a_z` through its own slow mean, interpolated between
//! samples, smoothed, and only believed between [`SHORTEST_S`] and [`LONGEST_S`]. Without a beat (wings
//! at rest) the samples pass unchanged. Price: half a beat of lag, 38 ms at 13 Hz, against 15 ms of the
//! default low-pass. **Symbols.** a specific force, body frame, m/s²; t, T s. **Left out.** Harmonics
//! above half the sampling rate still fold: only those of the beat that are sampled are averaged out.

use nalgebra::Vector3;

/// Beats that are believed, s: 25 to 8 Hz.
const SHORTEST_S: f64 = 0.04;
const LONGEST_S: f64 = 0.125;
/// The slow mean follows within this, s.
const MEAN_S: f64 = 0.5;
/// A passage counts when the force has been this far below the mean since the last one, m/s².
const LEAST_SWING_MPS2: f64 = 1.0;
/// Weight of the newest beat in T.
const NEWEST_WEIGHT: f64 = 0.15;
/// Without a passage for this long there is no beat, s.
const LOST_S: f64 = 0.4;
/// Samples kept: the longest beat at 500 Hz and some.
const KEPT: usize = 80;

/// Tracker and memory.
#[derive(Debug, Clone)]
pub struct Beat {
    /// Time and integral after each sample, oldest overwritten.
    kept: [(f64, Vector3<f64>); KEPT],
    next: usize,
    filled: usize,
    t_s: f64,
    integral: Vector3<f64>,
    last_B: Vector3<f64>,
    mean_z: f64,
    swung: bool,
    passed_s: Option<f64>,
    period_s: Option<f64>,
}

impl Default for Beat {
    fn default() -> Self {
        Self {
            kept: [(0.0, Vector3::zeros()); KEPT],
            next: 0,
            filled: 0,
            t_s: 0.0,
            integral: Vector3::zeros(),
            last_B: Vector3::zeros(),
            mean_z: 0.0,
            swung: false,
            passed_s: None,
            period_s: None,
        }
    }
}

impl Beat {
    /// Takes a sample and gives the mean over the last beat, or the sample without a beat.
    pub fn add(&mut self, dt_s: f64, acc_B: &Vector3<f64>) -> Vector3<f64> {
        if self.filled == 0 || dt_s > LONGEST_S {
            *self = Self { mean_z: acc_B.z, ..Self::default() };
        } else {
            self.track(dt_s, acc_B.z);
            self.t_s += dt_s;
            self.integral += (acc_B + self.last_B) * (0.5 * dt_s);
        }
        self.last_B = *acc_B;
        self.kept[self.next] = (self.t_s, self.integral);
        self.next = (self.next + 1) % KEPT;
        self.filled = (self.filled + 1).min(KEPT);
        self.mean_over_beat().unwrap_or(*acc_B)
    }

    /// Length of a beat, s, while there is one.
    pub fn period_s(&self) -> Option<f64> {
        let alive = self.passed_s.is_some_and(|passed| self.t_s - passed < LOST_S);
        self.period_s.filter(|_| alive)
    }

    fn track(&mut self, dt_s: f64, z: f64) {
        let before = self.last_B.z - self.mean_z;
        self.mean_z += (z - self.mean_z) * dt_s / (MEAN_S + dt_s);
        let now = z - self.mean_z;
        self.swung |= now < -LEAST_SWING_MPS2;
        if !(self.swung && before < 0.0 && now >= 0.0) {
            return;
        }
        self.swung = false;
        let passed_s = self.t_s + dt_s * before / (before - now);
        if let Some(last_s) = self.passed_s.replace(passed_s) {
            let measured_s = passed_s - last_s;
            if (SHORTEST_S..=LONGEST_S).contains(&measured_s) {
                let known_s = self.period_s.unwrap_or(measured_s);
                self.period_s = Some(known_s + (measured_s - known_s) * NEWEST_WEIGHT);
            }
        }
    }

    fn mean_over_beat(&self) -> Option<Vector3<f64>> {
        let period_s = self.period_s()?;
        let wanted_s = self.t_s - period_s;
        // Backwards from the newest to the two samples around the beginning of the beat.
        let (mut later_s, mut later) = (self.t_s, self.integral);
        for back in 2..=self.filled {
            let (t_s, integral) = self.kept[(self.next + KEPT - back) % KEPT];
            if t_s <= wanted_s {
                let share = (wanted_s - t_s) / (later_s - t_s).max(1e-9);
                let begin = integral + (later - integral) * share;
                return Some((self.integral - begin) / period_s);
            }
            (later_s, later) = (t_s, integral);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rms of what is left of the beat, m/s², behind a filter, at this rate of samples and beats.
    fn left(
        sample_hz: f64,
        beat_hz: f64,
        mut filter: impl FnMut(f64, &Vector3<f64>) -> f64,
    ) -> f64 {
        let dt_s = 1.0 / sample_hz;
        let (mut sum, mut n, mut phase) = (0.0, 0.0, 0.3);
        for i in 0..(20.0 * sample_hz) as u32 {
            let t_s = f64::from(i) * dt_s;
            // The beat quickens and slows by 5 % over some seconds, as throttle changes.
            let turn = std::f64::consts::TAU * dt_s * beat_hz;
            phase += turn * (1.0 + 0.05 * (0.7 * t_s).sin());
            let shake = 9.0 * f64::sin(phase) + 4.0 * f64::sin(2.0 * phase + 1.0);
            let out = filter(dt_s, &Vector3::new(0.0, 0.0, -9.8 + shake));
            if t_s > 3.0 {
                sum += (out + 9.8) * (out + 9.8);
                n += 1.0;
            }
        }
        f64::sqrt(sum / n)
    }

    #[test]
    fn prop_the_mean_over_a_beat_holds_little_of_it() {
        for sample_hz in [100.0, 200.0, 500.0] {
            for beat_hz in [9.0, 12.7, 16.0] {
                let mut low_pass = -9.8;
                let passed = left(sample_hz, beat_hz, |dt_s, acc| {
                    low_pass += (acc.z - low_pass) * dt_s / (0.015 + dt_s);
                    low_pass
                });
                let mut beat = Beat::default();
                let averaged = left(sample_hz, beat_hz, |dt_s, acc| beat.add(dt_s, acc).z);
                println!(
                    "{sample_hz} Hz, beat {beat_hz} Hz: {passed:.2} low-passed, {averaged:.2}"
                );
                assert!(averaged < 0.25 * passed, "{sample_hz} {beat_hz}: {averaged} {passed}");
                assert!((beat.period_s().unwrap() * beat_hz - 1.0).abs() < 0.08);
            }
        }
    }

    #[test]
    fn prop_without_a_beat_samples_pass() {
        let mut beat = Beat::default();
        for i in 0..500 {
            let acc = Vector3::new(0.1, 0.0, -9.8 + 0.01 * f64::from(i % 7));
            assert_eq!(beat.add(0.01, &acc), acc);
        }
        assert_eq!(beat.period_s(), None);
    }
}
