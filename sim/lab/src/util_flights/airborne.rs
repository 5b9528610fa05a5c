//! Whether the vehicle flies, from the unrest of its accelerometer alone.
//!
//! On the floor with motors off the recorded accelerometer varies by 0.001 g, with motors on by
//! 0.02 g and more. Motors on counts as flying.

use haltere_core::frames::{B, Vec3};
use haltere_core::time::HostTime;

/// Time over which unrest is averaged, s.
const WINDOW_S: f64 = 0.05;
/// Unrest from which it flies, m/s² rms.
const FLIES_MPS2: f64 = 0.15;
/// Unrest below which it may stand, m/s² rms.
const STANDS_MPS2: f64 = 0.08;
/// It stands after this long below, s.
const STANDS_AFTER_S: f64 = 0.5;

/// Memory of the detector.
#[derive(Debug, Clone, Default)]
pub struct Activity {
    last: Option<HostTime>,
    mean: [f64; 3],
    var: f64,
    calm_since: Option<HostTime>,
    airborne: bool,
}

impl Activity {
    /// Takes a reading of the accelerometer.
    pub fn add(&mut self, at: HostTime, acc_B_mps2: &Vec3<B>) {
        let Some(last) = self.last.replace(at) else {
            self.mean = acc_B_mps2.to_array();
            return;
        };
        let dt_s = at.seconds_since(last).clamp(0.0, WINDOW_S);
        let weight = dt_s / (WINDOW_S + dt_s);
        let mut square = 0.0;
        for (mean, value) in self.mean.iter_mut().zip(acc_B_mps2.to_array()) {
            let off = value - *mean;
            *mean += off * weight;
            square += off * off;
        }
        self.var += (square - self.var) * weight;
        if self.var > FLIES_MPS2 * FLIES_MPS2 {
            self.airborne = true;
            self.calm_since = None;
        } else if self.var < STANDS_MPS2 * STANDS_MPS2 {
            let since = *self.calm_since.get_or_insert(at);
            if at.seconds_since(since) > STANDS_AFTER_S {
                self.airborne = false;
            }
        } else {
            self.calm_since = None;
        }
    }

    /// Whether it flies.
    pub fn is_airborne(&self) -> bool {
        self.airborne
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_follows_motors_on_and_off() {
        let mut activity = Activity::default();
        let mut flew = vec![];
        for i in 0..6000u32 {
            let shake = if (2000..4000).contains(&i) { 0.4 } else { 0.01 };
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            let acc = Vec3::new(0.0, shake * sign, -9.8);
            activity.add(HostTime::from_us(u64::from(i) * 1000), &acc);
            flew.push(activity.is_airborne());
        }
        assert!(!flew[1999] && flew[2100] && flew[3999] && flew[4400] && !flew[4900]);
    }
}
